"""A scene in the form that compiled functions take: `Terms`, and the arrays of its parameters."""

from __future__ import annotations

import math
from collections.abc import Callable, Collection, Mapping, Sequence, Set
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, DTypeLike

from springgym.checks import HUGE, TINY
from springgym.core.language.blocks import aligned_zeros, get_copies, numbers, set_copies
from springgym.core.language.kinds import Ragged
from springgym.core.language.memory import block_dtype
from springgym.core.language.ragged import share, stacked
from springgym.dynamics import rigid
from springgym.dynamics.arrays import allocate
from springgym.dynamics.contact.cone import resistance_of
from springgym.dynamics.contact.law import SLOW
from springgym.dynamics.contact.lists import new_lists
from springgym.dynamics.contact.movers import new_turning
from springgym.dynamics.contact.pairs import longest_edge, most_contacts, packed_shapes, parallel
from springgym.dynamics.contact.round import packed_rounds
from springgym.dynamics.contact.rows import new_contacts
from springgym.dynamics.contact.totals import empty_totals
from springgym.dynamics.contact.warm import new_warm_start
from springgym.dynamics.forces.cycle import cycle
from springgym.dynamics.forces.springs import decay, interleaved
from springgym.dynamics.methods.node import Space
from springgym.dynamics.methods.record import Integrator, workspace
from springgym.dynamics.records import PAIR_TOTALS, Collisions, Pairs, RowSpace, Surfaces
from springgym.dynamics.rigid.node import Workspace
from springgym.dynamics.terms import (
    Dampers,
    Decay,
    Drive,
    LastNode,
    PaperLaw,
    Particles,
    Springs,
    Terms,
    Thrust,
    Wrench,
)
from springgym.model.bodies.elasticity import changed_forces, spring_forces
from springgym.model.own_forces import OfBody, to_compiled
from springgym.model.resolution import max_impact_speeds, possible_contacts
from springgym.model.scene import DriveActuator, Scene
from springgym.model.surfaces import Contact, PaperContact, by_kind, coupled, loss_factor, packed_kind, scales
from springgym.model.surfaces.contact import RESISTANCES

__all__ = [
    "PARAMETERS",
    "Options",
    "Packed",
    "Parameter",
    "actuators",
    "coarse_from",
    "decays",
    "derive",
    "derive_pairs",
    "has_nodes",
    "in_order",
    "node_workspace",
    "pack",
    "pack_pairs",
    "renew",
    "reset_flags",
    "rigid_workspace",
    "row_space",
    "shadow_difference",
    "shape",
    "sizes",
    "solves_rows",
    "values",
    "varies",
    "vary",
    "workspaces",
]


class Parameter(NamedTuple):
    """A physical parameter that may differ from copy to copy, with its least and largest value."""

    least: float
    most: float
    extent: str
    """what has one value each: "particles", "springs", "axes" or "bodies", or the "scene" as a whole"""
    stored: Callable[[Terms], Any]
    """a function that returns the array of its values for a body; None if the scene has none"""


def _of(term: object, name: str) -> Any:
    """Return an array of a term; None if the scene has no such term."""
    return None if term is None else getattr(term, name)


PARAMETERS = {
    "masses": Parameter(TINY, HUGE, "particles", lambda terms: terms.particles.mass),
    "stiffness": Parameter(TINY, HUGE, "springs", lambda terms: _of(terms.springs, "stiffness")),
    "damping": Parameter(0.0, HUGE, "springs", lambda terms: _of(terms.dampers, "coefficient")),
    "lengths": Parameter(TINY, HUGE, "springs", lambda terms: _of(terms.springs, "length")),
    "gravity": Parameter(-HUGE, HUGE, "axes", lambda terms: terms.gravity),
    "friction": Parameter(0.0, HUGE, "scene", lambda terms: terms.friction),
    "restitution": Parameter(0.0, 1.0, "scene", lambda terms: terms.loss),
    "strength": Parameter(TINY, HUGE, "bodies", lambda terms: _of(terms.surfaces, "strength")),
}
"""Parameters by name, with the arrays of their values. `vary` also sets the values derived from them."""


class Packed(NamedTuple):
    """A body of a scene in the form that compiled functions take."""

    scene: Scene
    """the scene of this body alone"""
    order: np.ndarray
    """(S,) springs in the order they are stored in"""
    terms: Terms
    twin: tuple[Any, ...]
    """the rigid body and its asymmetry, in rigid dynamics"""


class Options(NamedTuple):
    """The method, the step and the varying parameters for which a scene is packed."""

    method: Integrator
    step: float
    """time of a step, h [s]"""
    every: int
    """steps of a cycle, see `springgym.dynamics.forces.cycle`; 1 without cycles"""
    varying: frozenset[str]
    """names of parameters that differ from copy to copy"""
    blocks: Callable[..., np.ndarray]
    """a function that makes an array of blocks of some shape"""

    def parameter(self, names: Collection[str], value: ArrayLike) -> np.ndarray:
        """Return an array for a value that depends on parameters: blocks of copies if one of them varies."""
        if self.varying.isdisjoint(names):
            return np.array(value, float)
        array = self.blocks(*np.shape(value))
        numbers(array)[:] = np.asarray(value)[..., None]
        return array


def pack(scene: Scene, twin: bool, options: Options) -> tuple[Terms, tuple[Any, ...], tuple[Packed, ...]]:
    """Return the terms of a scene for compiled functions, its rigid bodies if ``twin``, and the part of each
    body.

    Raises
    ------
    ValueError
        If a parameter cannot vary in this scene.
    """
    shared = _shared(scene, options)._replace(collisions=_collisions(scene, twin, options))
    parts = [
        _packed(part, scene, shared._replace(body=n), twin, options) for n, part in enumerate(scene.parts)
    ]
    terms = stacked([part.terms for part in parts])
    twins = stacked([_asymmetric(part.twin, parts, options) for part in parts]) if twin else ()
    views = (part._replace(terms=share(terms, n), twin=share(twins, n)) for n, part in enumerate(parts))
    return terms, twins, tuple(views)


def _shared(scene: Scene, options: Options) -> Terms:
    """Return the terms that all bodies share: gravity, and surfaces without what each body adds."""
    surfaces = scene.surfaces
    contact = scene.contact
    varying = options.varying
    own = [OfBody(n, to_compiled(force)) for n, placed in enumerate(scene.bodies) for force in placed.forces]
    gravity = None
    if scene.gravity is not None:
        gravity = options.parameter({"gravity"}, np.array(scene.gravity, float))
    elif "gravity" in varying:
        raise ValueError("'gravity' cannot vary: the scene has none")
    packed = friction = loss = law = None
    if not surfaces:
        of_pairs = {"friction", "restitution"} if _as_the_scene_says(scene).any() else set()
        if unused := varying & {"friction", "restitution", "strength"} - of_pairs:
            raise ValueError(
                f"{sorted(unused)[0]!r} cannot vary: the scene has no surfaces"
                + ("" if unused == {"strength"} else ", and no bodies that collide as its contact says")
            )
        if "friction" in varying:
            friction = options.parameter({"friction"}, np.array([contact.friction]))
        if "restitution" in varying and isinstance(contact, Contact):
            loss = options.parameter({"restitution"}, loss_factor([contact.restitution]))
    else:
        kinds = (packed_kind(kind, [surfaces[n] for n in same]) for kind, same in by_kind(surfaces).items())
        packed = Surfaces(tuple(kinds), np.zeros(1), 1.0, math.inf, None, coupled(surfaces) or None)
        if contact.friction > 0 or "friction" in varying:
            friction = options.parameter({"friction"}, np.array([contact.friction]))
        if isinstance(contact, PaperContact):
            if "restitution" in varying:
                raise ValueError("'restitution' cannot vary: the paper's contact has no restitution")
            law = PaperLaw(contact.damping, options.step)
        elif contact.restitution < 1 or "restitution" in varying:
            loss = options.parameter({"restitution"}, loss_factor([contact.restitution]))
    return Terms(
        None,  # type: ignore[arg-type]
        gravity=gravity,
        surfaces=packed,
        friction=friction,
        loss=loss,
        paper_law=law,
        own=tuple(own) or None,
    )


def _packed(part: Scene, scene: Scene, shared: Terms, twin: bool, options: Options) -> Packed:
    """Pack a body of a scene by itself, with each kind of term that any body of the scene has."""
    body = part.body
    parameter = options.parameter
    # a rope's dampers act on its motion, not only on vibrations, so their order decides its accuracy
    count = len(body.masses)
    order = np.arange(len(body.springs)) if body.floppy else interleaved(body.springs, count)
    first, second = body.springs[order].T.astype(np.uint32)
    rigid_body: tuple[Any, ...] = ()
    if twin:
        rigid_body = rigid.terms(
            part, options.method, options.varying, lambda value: parameter({"masses", "lengths"}, value)
        )
    dampers = None
    if any(of.body.damping.any() for of in scene.bodies) or "damping" in options.varying:
        half, whole = (
            Decay(*(parameter({"damping", "masses"}, value) for value in decaying))
            for decaying in decays(part, order, options.every * options.step, body.damping, body.masses)
        )
        dampers = Dampers(parameter({"damping"}, body.damping[order]), half, whole, paired=body.floppy)
    surfaces = shared.surfaces
    nodes = has_nodes(scene, options.method)
    if surfaces is not None:
        c, reach = scales(part.contact, body)
        round_bodies = any(of.body.radius > 0 for of in scene.bodies)
        surfaces = surfaces._replace(
            strength=parameter({"strength"}, np.array([c])),
            reach=reach,
            coarse_from=coarse_from(part, twin, options.step)[-1].item() if nodes else math.inf,
            radius=float(body.radius) if round_bodies else None,
            totals=options.blocks(PAIR_TOTALS) if nodes and shared.collisions is None else None,
        )
    actuators = _actuators(part, scene, options.blocks)
    last = None
    if nodes and dampers is not None and not twin:
        last = LastNode(options.blocks(count, 3), options.blocks(1))
    terms = shared._replace(
        particles=Particles(
            parameter({"masses"}, body.masses),
            parameter({"masses"}, part.free / body.masses),
            np.array(part.free),
        ),
        springs=Springs(
            np.ascontiguousarray(first),
            np.ascontiguousarray(second),
            parameter({"lengths"}, body.lengths[order]),
            parameter({"stiffness"}, body.stiffness[order]),
        ),
        dampers=dampers,
        surfaces=surfaces,
        last=last,
        cycle=cycle(options.every, nodes, options.blocks) if options.every > 1 else None,
        rounds=packed_rounds(body) if part.surfaces and any(of.body.rounds for of in scene.bodies) else None,
        **actuators,
    )
    return Packed(part, order, terms, rigid_body)


def has_nodes(scene: Scene, method: Integrator) -> bool:
    """Return whether steps have nodes: the method handles contact, and bodies may touch something."""
    return method.meets_surfaces and scene.can_touch


def solves_rows(scene: Scene, method: Integrator, twin: bool) -> bool:
    """Return whether contacts are solved together: of bodies that collide, that roll, or that are rigid."""
    rolls = any(placed.body.rounds for placed in scene.bodies)
    return has_nodes(scene, method) and bool(scene.meetings or twin or rolls)


def _collisions(scene: Scene, twin: bool, options: Options) -> Collisions | None:
    """Return the record of the contacts that one solver handles together, or None if there are none."""
    if not solves_rows(scene, options.method, twin):
        return None
    pairs = pack_pairs(scene, twin, options)
    count = len(pairs.reach)
    totals, stored, fresh = map(options.blocks, (count * PAIR_TOTALS, len(scene.bodies), 1))
    changing = aligned_zeros((len(totals), 1 + count), block_dtype(np.int64, 1))
    warm = new_warm_start(pairs, len(scene.bodies), options.blocks)
    collisions = Collisions(pairs, totals, stored, fresh, changing, warm)
    empty_totals(collisions, slice(None))
    return collisions


def _as_the_scene_says(scene: Scene) -> np.ndarray:
    """Return a mask (pairs,) of the `Pairs` that have the scene's contact, and vary with it."""
    among = scene.meetings.by(scene.contact)
    return np.concatenate([among, np.ones(len(scene.bodies) if scene.surfaces else 0, bool)])


def pack_pairs(scene: Scene, twin: bool, options: Options) -> Pairs:
    """Return the pairs of a scene's bodies that collide, and then of each body and the surfaces."""
    met = scene.meetings
    count = len(scene.bodies) if scene.surfaces else 0
    bodies = [placed.body for placed in scene.bodies]
    c, reach = np.array([scales(scene.contact, body) for body in bodies[:count]]).reshape(-1, 2).T

    def of_all(name: str) -> np.ndarray:
        below = getattr(scene.contact, name) if count else 0.0
        return np.concatenate([met.of_contacts(name), np.full(count, below)])

    frictions = of_all("friction")
    restitutions = of_all("restitution")
    varying = options.varying if _as_the_scene_says(scene).any() else frozenset()
    rubs = frictions.any() or "friction" in varying
    loses = bool((restitutions < 1).any()) or "restitution" in varying
    longest = [longest_edge(body, shape) for body, shape in zip(bodies, scene.shapes, strict=True)]
    resisted = np.concatenate([scene.resisted, [bool(body.rounds) for body in bodies[:count]]]).astype(bool)
    strength = np.concatenate([met.strength, c])
    return Pairs(
        among=len(met),
        first=np.concatenate([met.first, np.arange(count)]),
        second=np.concatenate([met.second, np.full(count, -1)]),
        reach=np.concatenate([met.reach, reach]),
        coarse_from=coarse_from(scene, twin, options.step),
        least_reach=float(np.min(met.reach)) if len(met) else 1.0,
        parallel=parallel(met, longest),
        strength=options.parameter({"strength"} & varying if count else (), strength),
        friction=options.parameter({"friction"} & varying, frictions) if rubs else None,
        resistance=resistance_of(*(np.where(resisted, of_all(name), 0.0) for name in RESISTANCES)),
        loss=options.parameter({"restitution"} & varying, loss_factor(restitutions)) if loses else None,
        radius=np.array([shape.radius for shape in scene.shapes]),
        single=np.array([len(body.masses) == 1 for body in bodies]),
        shapes=packed_shapes(scene.shapes, scene.offsets[:-1]) if len(met) else None,
        most=most_contacts(met, scene.shapes)[0] if len(met) else 0,
    )


def coarse_from(scene: Scene, twin: bool, step: float) -> np.ndarray:
    """Return the speeds [m/s] above which contacts of pairs, and of bodies with surfaces, count as coarse.

    Impacts slower than w count as none: they lose as by a damper.
    """
    return np.maximum(max_impact_speeds(possible_contacts(scene, not twin), step), SLOW)


def workspaces(
    scene: Scene,
    method: Integrator,
    collisions: Collisions | None,
    twin: bool,
    dtype: DTypeLike,
    threads: int,
) -> list[Any]:
    """Return the workspace of each thread, elements of ``dtype``, for springs or the rigid ``twin``."""
    pairs = None if collisions is None else collisions.pairs
    if not twin and has_nodes(scene, method):
        return [node_workspace(scene, pairs, dtype) for _ in range(threads)]
    if twin and pairs is not None:
        return [rigid_workspace(scene, pairs, dtype) for _ in range(threads)]
    return [workspace(method, scene, dtype) for _ in range(threads)]


def row_space(scene: Scene, pairs: Pairs, twin: bool, dtype: DTypeLike) -> RowSpace:
    """Return the workspace in which a thread solves contacts."""
    bodies = [placed.body for placed in scene.bodies]
    count = len(scene.positions)
    among = most_contacts(scene.meetings, scene.shapes)[1] if pairs.among else 0
    features = (len(of.rounds) or len(of.masses) for of in bodies)
    turns = np.array([twin or bool(body.rounds) for body in bodies])
    for of in (pairs.first, pairs.second):
        turns[of[: pairs.among][scene.resisted]] = True
    first = 2 * np.arange(len(bodies)) if twin else scene.offsets[:-1]
    balls = np.array([of.turns and pairs.among > 0 for of in scene.shapes])
    pivots = np.array([placed.pivot if placed.free.any() else -1 for placed in scene.bodies])
    turning = new_turning(turns, balls, first, pivots, dtype)
    below = sum(features) * len(scene.surfaces)
    return allocate(
        RowSpace,
        {"rows": max(2 * len(bodies), count), "bodies": len(bodies)},
        dtype,
        lists=new_lists(pairs, count, dtype) if pairs.among else None,
        contacts=new_contacts(pairs, among, below, len(bodies), turning, dtype),
    )


def node_workspace(scene: Scene, pairs: Pairs | None, dtype: DTypeLike) -> Space:
    """Return the workspace of a thread for nodes of bodies of springs.

    If contacts of bodies are solved together (``pairs``), each body has its own arrays; else bodies pass
    nodes one by one and share them.
    """
    bodies = [placed.body for placed in scene.bodies]
    counts = {
        "particles": [len(body.masses) for body in bodies],
        "springs": [len(body.springs) for body in bodies],
    }

    def rows(*shape: int, of: str = "particles", kind: DTypeLike = dtype) -> Any:
        ends = np.cumsum([0, *counts[of]])
        if pairs is None or len(bodies) == 1:
            return aligned_zeros((max(counts[of]), *shape), kind)
        return Ragged(aligned_zeros((int(ends[-1]), *shape), kind), ends)

    return Space(
        a=rows(3),
        b=rows(3),
        w=rows(3),
        direction=rows(3, of="springs"),
        pushes=aligned_zeros((len(scene.surfaces), 3), dtype),
        busy=rows(kind=bool),
        rows=None if pairs is None else row_space(scene, pairs, False, dtype),
    )


def rigid_workspace(scene: Scene, pairs: Pairs, dtype: DTypeLike) -> Workspace:
    """Return the workspace of a thread for rigid bodies that may touch something."""
    extents = {"bodies": len(scene.bodies), "particles": len(scene.positions)}
    return allocate(Workspace, extents, dtype, rows=row_space(scene, pairs, True, dtype))


def _actuators(part: Scene, scene: Scene, blocks: Callable[..., np.ndarray]) -> dict[str, Any]:
    """Pack the actuators of a body, and idle ones of the kinds that only other bodies of the scene have."""
    terms: dict[str, Any] = {}
    markers = np.array(part.body.markers, np.uint32)
    if any(placed.wrench for placed in scene.bodies):
        axial = 1.0 if part.wrench is None else float(not part.wrench.perpendicular)
        terms["wrench"] = Wrench(blocks(3), blocks(3), blocks(3), markers, part.pivot, axial)
    if any(placed.thrust for placed in scene.bodies):
        named, turns = (part.thrust.particles, part.thrust.turns) if part.thrust else ((), False)
        terms["thrust"] = Thrust(np.array(named, np.uint32), blocks(len(named), 3), markers, turns)
    if any(placed.drive for placed in scene.bodies):
        drive = part.drive or DriveActuator(0, HUGE)
        terms["drive"] = Drive(drive.particle if part.drive else -1, blocks(3), drive.speed)
    return terms


def _asymmetric(twin: tuple[Any, ...], parts: list[Packed], options: Options) -> tuple[Any, ...]:
    """Return a rigid body with an asymmetry, even if it is 0, where another body has one."""
    body, asymmetry = twin
    if asymmetry is None and any(part.twin[1] is not None for part in parts):
        asymmetry = options.parameter({"masses", "lengths"}, np.zeros(1))
    return body, asymmetry


def decays(
    part: Scene, order: np.ndarray, time: float, damping: np.ndarray, masses: np.ndarray
) -> tuple[Decay, Decay]:
    """Return the decays by dampers during half of a time [s] and during all of it.

    Damping (…, S) is in the order of the body's springs, masses are (…, N).
    """
    inverse = part.free / masses
    first, second = part.body.springs[order].T
    given = (damping[..., order], inverse[..., first], inverse[..., second])
    return decay(*given, time / 2), decay(*given, time)


def actuators(packed: Packed) -> dict[str, np.ndarray]:
    """Return the arrays of blocks from which a body's actuators read their values, by name."""
    scene = packed.scene
    terms = packed.terms
    arrays: dict[str, np.ndarray] = {}
    if scene.wrench:
        names = ("force", "torque", "body_torque") if scene.body.oriented else ("force", "torque")
        arrays |= {name: _of(terms.wrench, name) for name in names}
    if scene.thrust:
        arrays["thrust"] = _of(terms.thrust, "force")
    if scene.drive:
        arrays["acceleration"] = _of(terms.drive, "acceleration")
    return arrays


# --- Parameters that vary -----------------------------------------------------------------------------


def varies(packed: Packed, name: str) -> bool:
    """Return whether copies have their own values of a parameter."""
    place = PARAMETERS[name].stored(packed.terms)
    return place is not None and place.dtype.names is not None


def shape(packed: Packed, name: str) -> tuple[int, ...]:
    """Return the shape of a parameter's value, for one body."""
    body = packed.scene.body
    extents = {"particles": (len(body.masses),), "springs": (len(body.springs),), "axes": (3,)}
    return extents.get(PARAMETERS[name].extent, ())


def values(packed: Packed, name: str, index: np.ndarray) -> np.ndarray:
    """Return the current values of ``masses`` (k, N), or ``stiffness``, ``damping`` or ``lengths`` (k, S), in
    the body's order."""
    if not varies(packed, name):
        of_body = getattr(packed.scene.body, name)
        return np.broadcast_to(of_body, (len(index), len(of_body)))
    return in_order(packed, name, get_copies(PARAMETERS[name].stored(packed.terms), index))


def in_order(packed: Packed, name: str, stored: np.ndarray) -> np.ndarray:
    """Return values (k, …) of a parameter in the body's order, from those in the order they are stored in."""
    found = stored.astype(float)
    if PARAMETERS[name].extent == "springs":
        found[:, packed.order] = found.copy()
    return found


def sizes(packed: Packed, lengths: np.ndarray) -> np.ndarray:
    """Return the sizes (k,) of a rigid body whose springs have ``lengths`` (k, S), as factors of its own."""
    of_body = packed.scene.body.lengths[:1]
    return lengths[:, 0] / of_body if len(of_body) else np.ones(len(lengths))


def reset_flags(terms: Terms) -> list[np.ndarray]:
    """Return the arrays whose zeros mark a copy as just reset: only its positions and velocities count."""
    kept: list[np.ndarray | Ragged] = [] if terms.cycle is None else [terms.cycle.marks]
    kept += [] if terms.last is None else list(terms.last)
    kept += [] if terms.surfaces is None or terms.surfaces.totals is None else [terms.surfaces.totals]
    found = [of.values if isinstance(of, Ragged) else of for of in kept]
    if terms.collisions is not None and terms.collisions.warm is not None:
        found.append(terms.collisions.warm.pair)
    return found


def renew(terms: Terms, index: np.ndarray) -> None:
    """Reset the memory of some copies (k,), of one body or of all: positions and velocities stay."""
    for array in reset_flags(terms):
        set_copies(array, index, 0.0)


def shadow_difference(packed: Packed, x: np.ndarray, v: np.ndarray, step: float, nodes: bool) -> np.ndarray:
    """Return the shadow energy of steps h [s] less the energy of a body in copies (k, N, 3) [J].

    With the springs' energy V and the forces F of springs and gravity, it is (h²/12) v·V″v − (h²/24) Σ |F|²/m
    for steps that kick, drift and kick, and (h²/12) Σ |F|²/m − (h²/24) v·V″v for steps that drift to a node
    and on: the first terms of the modified Hamiltonian (Hairer, Lubich and Wanner, Geometric Numerical
    Integration, IX.3, by the formula of Baker, Campbell and Hausdorff in III.4).
    """
    index = np.arange(len(x))
    masses, stiffness, lengths = (values(packed, name, index) for name in ("masses", "stiffness", "lengths"))
    springs = packed.scene.body.springs
    terms = packed.terms
    force = spring_forces(springs, stiffness, lengths, x)
    if terms.gravity is not None:
        gravity = get_copies(terms.gravity, index) if varies(packed, "gravity") else terms.gravity[None]
        force += masses[..., None] * gravity[:, None]
    pushed = (packed.scene.free / masses * (force**2).sum(axis=2)).sum(axis=1)
    stretched = -(v * changed_forces(springs, stiffness, lengths, x, v)).sum(axis=(1, 2))
    of_both = 2 * pushed - stretched if nodes else 2 * stretched - pushed
    return np.asarray(step**2 / 24 * of_both)


def vary(packed: Packed, index: np.ndarray, given: Mapping[str, np.ndarray]) -> None:
    """Set parameters of some copies (k,) to checked values by name, each (k, …); then `derive` the rest."""
    renew(packed.terms, index)
    for name, value in given.items():
        if name == "restitution":
            value = loss_factor(value)
        if PARAMETERS[name].extent in ("scene", "bodies"):
            value = value[:, None]
        elif PARAMETERS[name].extent == "springs":
            value = value[:, packed.order]
        set_copies(PARAMETERS[name].stored(packed.terms), index, value)


def derive(
    packed: Packed, index: np.ndarray, time: float, names: Set[str], shapes: list[dict[str, np.ndarray]]
) -> None:
    """Set the values of some copies (k,) that follow from parameters that have changed.

    Parameters
    ----------
    time
        Time for which dampers act at once [s].
    names
        Names of these parameters.
    shapes
        `rigid.shape_values` of each copy in rigid dynamics, if masses or lengths have changed.
    """
    terms = packed.terms
    if "masses" in names:
        inverse = terms.particles.free / values(packed, "masses", index)
        set_copies(terms.particles.inverse_mass, index, inverse)
    if packed.twin and shapes:
        rigid.set_shapes(packed.twin, index, shapes)
    if terms.dampers and names & {"masses", "damping"}:
        damping = values(packed, "damping", index)
        masses = values(packed, "masses", index)
        of = decays(packed.scene, packed.order, time, damping, masses)
        for arrays, decaying in zip((terms.dampers.half, terms.dampers.whole), of, strict=True):
            for array, value in zip(arrays, decaying, strict=True):
                set_copies(array, index, value)


def derive_pairs(
    collisions: Collisions | None, scene: Scene, index: np.ndarray, parts: Sequence[Packed], names: Set[str]
) -> None:
    """Set the contact parameters of all pairs that have the scene's contact, in some copies (k,).

    They follow from those of the scene and of its bodies, of which some have changed.
    """
    contact = scene.contact
    of = _as_the_scene_says(scene)
    if collisions is None or not isinstance(contact, Contact) or not of.any():
        return
    pairs = collisions.pairs
    arrays = {"friction": pairs.friction, "restitution": pairs.loss, "strength": pairs.strength}
    for name, array in arrays.items():
        if name in names and array is not None and array.dtype.names:
            rows = get_copies(array, index)
            own = np.hstack([get_copies(PARAMETERS[name].stored(part.terms), index) for part in parts])
            if name == "strength":
                rows[:, pairs.among :] = own
            else:
                rows[:, of] = own[:, :1]
            set_copies(array, index, rows)
