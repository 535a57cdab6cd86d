"""Scene-file parser with strict validation: every key is known, has the right type, and occurs once."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import replace
from importlib import resources
from importlib.resources.abc import Traversable
from os.path import isdir, isfile
from pathlib import Path
from typing import Any, Literal, NamedTuple

import numpy as np

from springgym.checks import instance, refusing_unknown, shown, similar, suggestion
from springgym.model import bodies as makers
from springgym.model.bodies import Body, from_mesh, from_points, start, union
from springgym.model.bodies.motion import InitialState
from springgym.model.bodies.precession import heavy_top
from springgym.model.collisions import Collisions, Pair
from springgym.model.collisions.meeting import ALL
from springgym.model.scene import GRAVITY, Placed, Scene
from springgym.model.surfaces import SURFACES, Contact, PaperContact, Plane, Surface, floor, heights, resting
from springgym.scenes.checks import of_all
from springgym.scenes.checks.basis import CHECKS, TOUCHING
from springgym.scenes.plan import RULES, Plan, Plot, Vector, View, check_plot, refuse_twice
from springgym.scenes.strict_yaml import Tree, YamlError, build, changed, fit, read_yaml
from springgym.theory.rope import catenary
from springgym.theory.top import steady_precession

__all__ = ["ALONG", "BESIDE_END", "MADE", "document", "read"]

Changes = Mapping[tuple[str, ...], Any]


def names() -> list[str]:
    """Return the names of the scenes in the package, sorted."""
    return sorted(
        file.name.removesuffix(".yaml") for file in _folder().iterdir() if file.name.endswith(".yaml")
    )


@refusing_unknown
def load(scene: str | Path, changes: Changes | None = None) -> Plan:
    """Read a scene.

    Parameters
    ----------
    scene
        Name of a scene in the package, or path of a YAML file.
    changes
        Values that replace those in the file, by the path of their keys: ``{("start", "spin"): 40.0}``.

    Raises
    ------
    TypeError
        If the scene is neither a string nor a path, or ``changes`` is not a mapping.
    YamlError
        If the file has an error; the message names file, line and key.
    ValueError
        If there is no such scene.
    """
    with _file(scene) as path:
        return read(path, changes)


def document(scene: str | Path) -> Tree:
    """Return the tree of a scene file, unchecked; see `load`."""
    with _file(scene) as path:
        return read_yaml(path)


@contextmanager
def _file(scene: str | Path) -> Iterator[Path]:
    """Return the file of a scene."""
    if instance("scene", scene, str, Path) in names():
        with resources.as_file(_folder() / f"{scene}.yaml") as path:
            yield path
        return
    path = Path(scene)
    if isdir(scene):
        raise ValueError(f"{shown(str(scene))} is a folder; give the name of a scene, or of a YAML file")
    if path.suffix not in (".yaml", ".yml") and not isfile(path):
        known = similar(str(scene), names()) or "; springgym simulate --list shows all"
        raise ValueError(f"no such file, and there is no scene {shown(str(scene))}{known}")
    yield path


def _folder() -> Traversable:
    return resources.files("springgym.scenes")


def read(path: Path, changes: Changes | None = None) -> Plan:
    """Read a scene file, see `load`."""
    tree = changed(read_yaml(path), {} if changes is None else changes)

    def plan(
        title: str,
        duration: float,
        body: object = None,
        bodies: object = None,
        pinned: Sequence[str | int] = (),
        gravity: float | Vector = -GRAVITY[2],
        start: object = None,
        surfaces: object = None,
        contact: object = None,
        collisions: object = None,
        interval: float = 0.01,
        integrator: str = "verlet",
        step: float | None = None,
        trace: str | int | None = None,
        plot: Plot | None = None,
        checks: Sequence[str] = (),
        view: object = None,
    ) -> Plan:
        settings: dict[str, Any] = {
            "duration": duration,
            "interval": interval,
            "integrator": integrator,
            "step": step,
        }
        for name, value in settings.items():
            with _at(tree, name):
                RULES[name](name, value)
        if isinstance(gravity, float) and gravity < 0:
            raise _error(tree, ("gravity",), f"gravity is {gravity:g}; it pulls down if it is positive")
        pull = (0.0, 0.0, -gravity) if isinstance(gravity, float) else gravity
        met = Contact()
        paper = PaperContact()
        if contact is not None:
            met, paper = build(_met, tree, ("contact",), skip=Contact.__dataclass_fields__, file=tree)
        world: dict[str, Any] = {"gravity": pull, "surfaces": _surfaces(tree), "contact": met}
        begun = _bodies(tree, world, body, bodies, pinned, start)
        meet = _collisions(tree)
        _refuse_unused(tree, len(begun), meet)
        try:
            scene = Scene(
                bodies=tuple(one.placed for one in begun),
                collisions=meet,
                **{**world, "gravity": pull if any(pull) else None},
            )
        except (ValueError, TypeError, ArithmeticError) as error:
            raise YamlError(f"{path}: {error}") from error
        _known_checks(tree, ("checks",), checks)
        plot = plot or ("bodies" if len(begun) > 1 else "rotation")
        with _at(tree, "plot"):
            check_plot(plot, len(begun))
        whole = Plan(
            name=path.stem,
            title=title,
            scene=scene,
            paper=paper,
            stretched=all(one.stretched for one in begun),
            **settings,
            trace=_traced(tree, scene, trace),
            plot=plot,
            checks=tuple(checks),
            view=View() if view is None else build(View, tree, ("view",)),
            contacts=not TOUCHING.isdisjoint(checks),
        )
        if bodies is None:
            return whole
        together = of_all(scene, checks)
        each = tuple(name for name in checks if name not in together)
        parts = []
        for part, one in zip(scene.parts, begun, strict=True):
            name = part.bodies[0].name
            own: dict[str, Any] = {"stretched": one.stretched, "trace": None, "plot": "rotation"}
            own["checks"] = (*each, *one.checks)
            with _at(tree, "bodies", name):
                parts.append(replace(whole, name=f"{path.stem}: {name}", scene=part, **own))
        return replace(whole, checks=tuple(together), parts=tuple(parts))

    return build(plan, tree)


def _error(tree: Tree, path: tuple[str, ...], message: str) -> YamlError:
    return YamlError(f"{tree.where[path]}: {'.'.join(path)}: {message}")


@contextmanager
def _at(tree: Tree, *path: str) -> Iterator[None]:
    """Return a context in which errors are those of the value at a path of a file."""
    try:
        yield
    except ValueError as error:
        raise _error(tree, path, str(error)) from error


def _known_checks(tree: Tree, path: tuple[str, ...], checks: Sequence[str]) -> None:
    """Refuse unknown checks, and those given twice."""
    for n, name in enumerate(checks):
        where = tree.where[*path, str(n)]
        if name not in CHECKS:
            raise YamlError(f"{where}: unknown check {shown(name)}{suggestion(name, CHECKS)}")
        if name in checks[:n]:
            raise YamlError(f"{where}: check {name!r} is given twice")


def _refuse_unused(tree: Tree, bodies: int, collisions: Collisions) -> None:
    """Refuse keys of a file without effect: a contact by which nothing can touch, and what belongs to it."""
    surfaces = bool(tree.value.get("surfaces"))
    several = bodies > 1
    if "collisions" in tree.value and not several:
        raise _error(tree, ("collisions",), "a single body collides with no other")
    if tree.value.get("contact") is None:
        return
    if not several and not surfaces:
        raise _error(tree, ("contact",), "a single body has no contact without surfaces")
    pairs = collisions if isinstance(collisions, tuple) else ()
    if not surfaces and collisions != ALL and all(pair.contact for pair in pairs):
        raise _error(tree, ("contact",), "no bodies collide by it, and there are no surfaces")
    if not surfaces and "paper_damping" in tree.value["contact"]:
        raise _error(tree, ("contact", "paper_damping"), "there are no surfaces, which alone it concerns")


def _traced(tree: Tree, scene: Scene, trace: str | int | None) -> int | None:
    """Return the particle whose path is drawn; with several bodies, its name is "body.part"."""
    if trace is None:
        return None
    number = 0
    part = trace
    if "bodies" in tree.value:
        name, _, part = str(trace).partition(".")
        if not part:
            must = "it must be body.part, the name of a body and a part of it or the number of a particle"
            raise _error(tree, ("trace",), f"trace is {shown(trace)}; {must}")
        names = [placed.name for placed in scene.bodies]
        if name not in names:
            raise _error(tree, ("trace",), f"unknown body {shown(name)}{suggestion(name, names)}")
        number = names.index(name)
        part = int(part) if part.isdecimal() else part
    found = _particles(tree, ("trace",), scene.bodies[number].body, (part,))
    if len(found) > 1:
        raise _error(tree, ("trace",), f"{shown(trace)} is {len(found)} particles; trace takes one")
    return scene.slices[number].start + found[0]


# --- Bodies in their places -------------------------------------------------------------------------


BESIDE_END = ("end", "position", "velocity", "kick")
"""Keys of the start of a rope that is held at its end."""


class _Standing(NamedTuple):
    placed: Placed
    stretched: bool
    checks: tuple[str, ...]


def _bodies(
    tree: Tree,
    world: Mapping[str, Any],
    body: object,
    bodies: object,
    pinned: Sequence[str | int],
    start: object,
) -> list[_Standing]:
    """Read the single body of a file, or several with their names."""
    if bodies is None:
        if body is None:
            raise YamlError(f"{tree.where[()]}: the file lacks body")
        return [_standing(tree, (), world, pinned, start)]
    for name in ("body", "pinned", "start"):
        if name in tree.value:
            raise _error(tree, (name,), "beside bodies, it belongs to one of them")
    if not isinstance(bodies, dict) or not bodies:
        raise _error(tree, ("bodies",), f"expected bodies by their names, got {shown(bodies)}")

    def one(
        name: str,
        body: object,
        pinned: Sequence[str | int] = (),
        start: object = None,
        checks: Sequence[str] = (),
    ) -> _Standing:
        standing = _standing(tree, ("bodies", name), world, pinned, start, checks)
        return standing._replace(placed=replace(standing.placed, name=name))

    return [build(one, tree, ("bodies", name), name=name) for name in bodies]


def _standing(
    tree: Tree,
    path: tuple[str, ...],
    world: Mapping[str, Any],
    pinned: Sequence[str | int] = (),
    start: object = None,
    checks: Sequence[str] = (),
) -> _Standing:
    """Read a body with its pins and its start at ``path`` of a file."""
    made = _body(tree, (*path, "body"))
    given: dict[str, Any] = {"body": made, "pinned": _pinned(tree, (*path, "pinned"), made, pinned), **world}
    begun = started(**given) if start is None else build(started, tree, (*path, "start"), **given)
    _refuse_beside_end(tree, (*path, "start"))
    _known_checks(tree, (*path, "checks"), checks)
    try:
        placed = Placed(made, begun.start.positions, begun.start.velocities, given["pinned"])
    except (ValueError, TypeError) as error:
        raise YamlError(f"{tree.where[path]}: {error}") from error
    return _Standing(placed, begun.stretched, tuple(checks))


def _refuse_beside_end(tree: Tree, path: tuple[str, ...]) -> None:
    """Refuse keys of a start that a rope held at its ``end`` does not heed: it hangs at rest, and may be
    moved or pushed as a whole, or kicked."""
    given = tree.at(path) if path in tree.where else None
    if isinstance(given, dict) and given.get("end") is not None:
        for name in given:
            if name not in BESIDE_END:
                others = ", ".join(BESIDE_END)
                raise _error(
                    tree, (*path, name), f"a rope held at its end hangs between its ends; it takes {others}"
                )


# --- Bodies -----------------------------------------------------------------------------------------


def _net(
    positions: Sequence[Vector],
    masses: float | Sequence[float],
    springs: Sequence[tuple[int, int]] = (),
    stiffness: float | Sequence[float] = 1e5,
    damping: float | Sequence[float] = 0.0,
    lengths: Sequence[float] | None = None,
    parts: Mapping[str, Sequence[int]] | None = None,
    markers: tuple[int, int, int] | None = None,
    floppy: bool = False,
) -> Body:
    """Read a body given particle by particle and spring by spring, see `Body`."""
    arrays: dict[str, Any] = {"positions": positions, "masses": masses, "springs": springs}
    arrays |= {"stiffness": stiffness, "damping": damping, "lengths": lengths}
    return Body("net", **arrays, markers=markers, parts=parts or {}, floppy=floppy)  # type: ignore[arg-type]


MADE = (
    "top gyroscope cube box rope ball rolling_ball ellipsoid disk capsule "
    "solid_top solid_box solid_hull solid_rope solid_mesh"
)
"""Functions of `springgym.model.bodies` that scene files call by their names."""

KINDS: dict[str, Callable[..., Body]] = {name: getattr(makers, name) for name in MADE.split()}
KINDS |= {"points": from_points, "mesh": from_mesh, "net": _net}
"""Functions that make bodies, by their names in scene files, except ``union``."""


def _body(tree: Tree, path: tuple[str, ...]) -> Body:
    """Read the body at a path: its ``kind``, and the arguments of the function that makes it."""
    entries = tree.at(path)
    place = tree.where[path]
    if not isinstance(entries, dict) or not isinstance(entries.get("kind"), str):
        raise YamlError(f"{place}: {'.'.join(path)} must be a mapping with a kind")
    kind = entries["kind"]
    if kind == "union":
        parts = entries.get("parts")
        if not isinstance(parts, list) or not parts:
            raise YamlError(f"{place}: a union lacks parts, a list of bodies")
        bodies = [_part(tree, (*path, "parts", str(n))) for n in range(len(parts))]
        return build(union, tree, path, skip=("kind", "parts"), bodies=bodies)
    if kind not in KINDS:
        where = tree.where[*path, "kind"]
        raise YamlError(f"{where}: unknown kind {shown(kind)}{suggestion(kind, [*KINDS, 'union'])}")
    skip = ("kind", "name", "at") if len(path) > 1 else ("kind",)
    given = {}
    if kind in ("mesh", "solid_mesh"):
        if "file" not in entries:
            raise YamlError(f"{place}: {'.'.join(path)} lacks file")
        given["path"] = Path(tree.where[()]).parent / fit(str, tree, (*path, "file"))
        skip = (*skip, "file")
    return build(KINDS[kind], tree, path, skip=skip, **given)


def _part(tree: Tree, path: tuple[str, ...]) -> Body:
    """Read a part of a union: a body with a ``name``, moved to ``at``."""

    def placed(name: str, at: Vector = (0.0, 0.0, 0.0)) -> Body:
        return body.with_(name=name, positions=body.positions + np.array(at))

    body = _body(tree, path)
    others = set(tree.at(path)) - {"name", "at"}
    return build(placed, tree, path, skip=tuple(others))


def _pinned(tree: Tree, path: tuple[str, ...], body: Body, given: Sequence[str | int]) -> tuple[int, ...]:
    """Return pinned particles, each named once."""
    found = _particles(tree, path, body, given)
    with _at(tree, *path):
        refuse_twice("pinned", found)
    return found


def _particles(tree: Tree, path: tuple[str, ...], body: Body, given: Sequence[str | int]) -> tuple[int, ...]:
    """Return particles by number or by the name of a part."""
    found: list[int] = []
    for item in given:
        if isinstance(item, str) and item not in body.parts:
            raise _error(tree, path, f"unknown part {shown(item)}{suggestion(item, body.parts)}")
        particles = (item,) if isinstance(item, int) else body.parts[item]
        for i in particles:
            if not 0 <= i < len(body.masses):
                raise _error(tree, path, f"there is no particle {i}; there are 0 to {len(body.masses) - 1}")
        found += particles
    return tuple(found)


# --- Surfaces ---------------------------------------------------------------------------------------


def _surfaces(tree: Tree) -> tuple[Surface, ...]:
    given = tree.value.get("surfaces")
    if given is None:
        return ()
    if not isinstance(given, list):
        raise _error(tree, ("surfaces",), f"expected a list of surfaces, got {shown(given)}")
    made = []
    for n, entries in enumerate(given):
        path = ("surfaces", str(n))
        kind = entries.get("kind") if isinstance(entries, dict) else None
        if not isinstance(kind, str) or kind not in SURFACES:
            known = suggestion(str(kind), SURFACES)
            raise YamlError(f"{tree.where[path]}: unknown kind of surface {shown(kind)}{known}")
        if entries in given[:n]:
            raise _error(tree, path, "this surface is given twice")
        made.append(build(SURFACES[kind], tree, path, skip=("kind",)))
    return tuple(made)


def _met(file: Tree, paper_damping: float = 0.0) -> tuple[Contact, PaperContact]:
    """Return the contact by default and by the paper's settings, whose c_N is ``paper_damping`` [kg/s]."""
    met: Contact = build(Contact, file, ("contact",), skip=("paper_damping",))
    return met, PaperContact(met.friction, paper_damping, met.strength, met.reach)


def _collisions(tree: Tree) -> Collisions:
    """Return the collisions of a file: "all", "none", a contact for all pairs, or a list of pairs, each with
    or without a ``contact``."""
    given = tree.value.get("collisions", ALL)
    if given is None or given == "none":
        return None
    if isinstance(given, dict):
        how: Contact = build(Contact, tree, ("collisions",))
        return how
    if isinstance(given, list):

        def pair(n: str, first: str, second: str, contact: object = None) -> Pair:
            how = None if contact is None else build(Contact, tree, ("collisions", n, "contact"))
            return Pair(first, second, how)

        return tuple(build(pair, tree, ("collisions", str(n)), n=str(n)) for n in range(len(given)))
    if given != ALL:
        raise _error(
            tree, ("collisions",), f"expected all, none, a contact or a list of pairs, got {shown(given)}"
        )
    return ALL


# --- Starts -----------------------------------------------------------------------------------------


ALONG = 1e-3
"""A position along a plane may be off it by this fraction, as files round its components."""


class _Beginning(NamedTuple):
    start: InitialState
    stretched: bool


def started(
    body: Body,
    pinned: tuple[int, ...],
    gravity: Vector,
    surfaces: tuple[Surface, ...],
    contact: Contact,
    tilt: float | None = None,
    azimuth: float = 0.0,
    roll: float = 0.0,
    hanging: bool = False,
    rotation: Vector = (0.0, 0.0, 0.0),
    spin: float = 0.0,
    precession: float | Literal["slow", "fast"] = 0.0,
    omega: Vector = (0.0, 0.0, 0.0),
    position: Vector = (0.0, 0.0, 0.0),
    velocity: Vector = (0.0, 0.0, 0.0),
    height: float | Literal["rest"] | None = None,
    end: Vector | None = None,
    kick: Mapping[str, Vector] | None = None,
    stretched: bool = True,
) -> _Beginning:
    """Return a body's start, by `springgym.model.bodies.start`; the precession may be "slow" or "fast".

    These are the steady precessions of a heavy top. The body is moved so that its lowest particle is at
    ``height`` [m] above the first surface, a plane (or above z = 0); at "rest" the lowest particles share the
    weight. ``end`` is where the end of a rope is held at first, with the rope hanging between. ``kick`` adds
    velocities [m/s] to parts or particles.
    """
    if isinstance(precession, str):
        roots = steady_precession(heavy_top(body, pinned, gravity), tilt or 0.0, spin)
        precession = roots[precession == "fast"]
    positions, velocities = start(
        body,
        tilt=tilt,
        azimuth=azimuth,
        roll=roll,
        hanging=hanging,
        rotation=rotation,
        spin=spin,
        precession=precession,
        omega=omega,
        position=position,
        velocity=velocity,
        pinned=pinned,
        gravity=gravity,
        stretched=stretched and end is None,
    )
    if height is not None:
        plane = surfaces[0] if surfaces else floor()
        positions = _lifted(body, positions, gravity, plane, contact, height, position)
    if end is not None:
        positions = _hung(body, positions[0], np.array(end), gravity)
    for name, change in (kick or {}).items():
        if name not in body.parts and not name.isdecimal():
            raise ValueError(f"kick names an unknown part {shown(name)}{suggestion(name, body.parts)}")
        particles = body.parts[name] if name in body.parts else (int(name),)
        if max(particles) >= len(body.masses):
            raise ValueError(f"kick names particle {name}; there are 0 to {len(body.masses) - 1}")
        velocities[list(particles)] += change
    return _Beginning(InitialState(positions, velocities), stretched)


def _lifted(
    body: Body,
    positions: np.ndarray,
    gravity: Vector,
    surface: Surface,
    contact: Contact,
    height: float | Literal["rest"],
    position: Vector,
) -> np.ndarray:
    """Return positions moved along the normal of a plane to a height of the lowest particle."""
    if not isinstance(surface, Plane):
        raise ValueError("height needs a plane; give a position above other surfaces")
    away = float(np.dot(position, surface.normal))
    if abs(away) > ALONG * float(np.linalg.norm(position)):
        raise ValueError(
            f"position is {position}, {away:g} m along the normal of the plane, beside a height above the "
            "plane; it must be along the plane"
        )
    if height == "rest":
        try:
            return resting(body, positions, contact, surface, gravity)
        except ValueError as error:
            raise ValueError(f"height: {error}") from None
    found = heights(body, positions, surface)
    return positions + (height - found.min()) * np.array(surface.normal)


def _hung(body: Body, first: np.ndarray, last: np.ndarray, gravity: Vector) -> np.ndarray:
    """Hang a rope between its ends."""
    if body.name != "rope" or any(gravity[:2]) or not gravity[2] < -1e-9:
        raise ValueError("end needs a rope, and gravity straight down")
    across = (last - first) * (1, 1, 0)
    span = float(np.linalg.norm(across))
    if not span > 0:
        raise ValueError("end is straight below or above the other end; it must lie to the side")
    hanging = catenary(
        span, float(last[2] - first[2]), body.masses[1:-1], body.lengths, body.stiffness, -gravity[2]
    )
    sideways, up = hanging.points.T
    return first + np.outer(sideways, across / span) + np.outer(up, (0, 0, 1))
