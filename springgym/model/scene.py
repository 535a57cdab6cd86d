"""A scene: bodies, their initial state, and everything that acts on them. Frozen data, checked once."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, field, fields, replace
from functools import cached_property
from itertools import pairwise
from numbers import Real
from typing import Any, Self

import numpy as np

from springgym.checks import (
    TINY,
    array,
    chosen,
    flag,
    indices,
    instance,
    number,
    refusing_unknown,
    shown,
    whole,
    whole_array,
)
from springgym.model.bodies import Body
from springgym.model.collisions import Collisions, Meetings, Shape, as_met, check_apart, meetings, shape
from springgym.model.collisions.meeting import ALL, BodyRef
from springgym.model.identity import digest
from springgym.model.own_forces import checked_forces
from springgym.model.records import ReadOnly, read_only
from springgym.model.surfaces import Contact, PaperContact, Surface, check_heights, check_surfaces, scales
from springgym.model.surfaces.contact import NEAREST, RESISTANCES, without_resistance

__all__ = [
    "MOST_BODIES",
    "MOST_LISTED",
    "MOST_SURFACES",
    "OF_A_BODY",
    "OWN",
    "DriveActuator",
    "Placed",
    "Scene",
    "ThrustActuator",
    "WrenchActuator",
    "squared_lengths",
    "too_short",
]

GRAVITY = (0.0, 0.0, -9.81)

MOST_SURFACES = 100
"""Largest number of surfaces of a scene: each particle is compared with each surface at every step."""

MOST_BODIES = 1000
"""Largest number of bodies of a scene."""

MOST_LISTED = 20
"""Largest number of bodies, and of pairs, that the `repr` of a scene lists."""


@refusing_unknown
@dataclass(frozen=True)
class WrenchActuator:
    """Apply a force and a torque to the body.

    If ``perpendicular``, only the component of the world torque perpendicular to the body's axis acts: it
    tilts the body, and does not spin it.
    """

    perpendicular: bool = False

    def __post_init__(self) -> None:
        object.__setattr__(self, "perpendicular", flag("perpendicular of a wrench", self.perpendicular))


@refusing_unknown
@dataclass(frozen=True)
class ThrustActuator:
    """Apply forces to named particles, along the world's axes or, if ``turns``, along the body's triad."""

    particles: tuple[int, ...]
    turns: bool = False

    def __post_init__(self) -> None:
        particles = whole_array("particles of a thrust", self.particles, (None,))
        object.__setattr__(self, "particles", tuple(particles.tolist()))
        object.__setattr__(self, "turns", flag("turns of a thrust", self.turns))


@refusing_unknown
@dataclass(frozen=True)
class DriveActuator:
    """Accelerate a pinned particle, and limit each component of its velocity [m/s]."""

    particle: int
    speed: float

    def __post_init__(self) -> None:
        object.__setattr__(self, "particle", whole("particle of a drive", self.particle))
        object.__setattr__(self, "speed", number("speed of a drive", self.speed, low=TINY))


@refusing_unknown
@dataclass(frozen=True, eq=False)
class Placed(ReadOnly):
    """A body in a scene, with its initial state, pins, actuators and forces.

    Parameters
    ----------
    body
        The particles and springs.
    positions, velocities : (N, 3), optional
        The state at the start [m], [m/s]. The default is the unstretched shape, at rest.
    pinned
        Particles that do not move (zero inverse mass). The first is the pivot, about which torques and
        angular momenta are taken.
    wrench, thrust, drive
        Actuators of the body, or None.
    forces
        User-defined forces, see `springgym.model.own_forces`. Their particle numbers are those of the body.
    name
        Name of the body in calls, plots and errors of a scene of several bodies. The default is the name of
        ``body``, followed by a number if several bodies share it: "cube0", "cube1".

    Raises
    ------
    TypeError
        If an argument has the wrong type, see `springgym.checks`.
    ValueError
        For a wrong shape, a value that is not finite, a particle that does not exist, or a start that
        `check_start` refuses; the message names it.
    """

    body: Body
    positions: np.ndarray = None  # type: ignore[assignment]
    velocities: np.ndarray = None  # type: ignore[assignment]
    pinned: tuple[int, ...] = ()
    wrench: WrenchActuator | None = None
    thrust: ThrustActuator | None = None
    drive: DriveActuator | None = None
    forces: tuple[Any, ...] = ()
    name: str = None  # type: ignore[assignment]

    def __post_init__(self) -> None:
        body = instance("body", self.body, Body)
        object.__setattr__(self, "name", body.name if self.name is None else instance("name", self.name, str))
        count = len(body.masses)
        for name, default in (("positions", body.positions), ("velocities", np.zeros((count, 3)))):
            given = getattr(self, name)
            self.keep(name, array(name, default if given is None else given, (count, 3)))
        pinned = dict.fromkeys(indices("pinned", self.pinned, count).tolist())
        object.__setattr__(self, "pinned", tuple(pinned))
        kinds = {"wrench": WrenchActuator, "thrust": ThrustActuator, "drive": DriveActuator}
        for name, kind in kinds.items():
            instance(name, getattr(self, name), kind, type(None))
        if self.thrust:
            indices("thrust.particles", self.thrust.particles, count)
            if self.thrust.turns and not body.oriented:
                raise ValueError(
                    f"body-fixed thrust needs a body with an orientation, but markers {body.markers} of body "
                    f"{body.name!r} lie on one line; use turns=False"
                )
        object.__setattr__(self, "forces", checked_forces("forces", self.forces, count))
        if self.drive and self.forces:
            raise ValueError(
                "a body cannot have both forces and a drive, an actuator that moves a pinned particle: the "
                "work of the drive would not include the forces"
            )
        if self.drive and self.drive.particle not in self.pinned:
            raise ValueError(
                f"drive.particle {self.drive.particle} must be pinned, because only the drive moves it"
            )
        self.check_start(self.positions, self.velocities)

    def check_start(
        self, positions: np.ndarray, velocities: np.ndarray, copies: np.ndarray | None = None
    ) -> None:
        """Refuse a start from which no simulation is possible.

        Parameters
        ----------
        positions, velocities : (N, 3) or (k, N, 3)
            [m], [m/s]; numbers that have been checked.
        copies : (k,), optional
            Numbers of the copies in error messages.

        Raises
        ------
        ValueError
            If a pinned particle moves without a drive, or faster than its drive allows; or if the ends of a
            spring coincide, so that it has no direction.
        """

        def refuse(wrong: np.ndarray, what: str) -> None:
            """Raise if anything (N,) or (k, N) is wrong; ``what`` may name the number and the copy."""
            if wrong.any():
                *row, n = np.argwhere(wrong)[0].tolist()
                raise ValueError(
                    what.format(n=n, of=f" of copy {copies[row[0]]}" if row and copies is not None else "")
                )

        if self.pinned and np.count_nonzero(velocities.take(self.pinned, axis=-2)):
            moves = ~self.free & velocities.any(axis=-1)
            if self.drive:
                driven = np.abs(velocities[..., self.drive.particle, :]).max(axis=-1, keepdims=True)
                fast = "particle %d{of} starts faster than its drive moves it, %g m/s at most"
                refuse(driven > self.drive.speed, fast % (self.drive.particle, self.drive.speed))
                moves[..., self.drive.particle] = False
            refuse(moves, "pinned particle {n}{of} has a velocity; it must be zero")
        if (short := too_short(self.body.springs, positions)) is not None:
            refuse(short, "spring {n}{of} starts with both ends at the same position; it has no direction")

    @cached_property
    def free(self) -> np.ndarray:
        """Return a mask of the particles that are not pinned, (N,)."""
        return read_only(~np.isin(np.arange(len(self.body.masses)), self.pinned))

    @property
    def pivot(self) -> int:
        """Return the particle about which torques and angular momenta are taken, the first pinned one.

        It is −1 if no particle is pinned.
        """
        return self.pinned[0] if self.pinned else -1

    def __repr__(self) -> str:
        acting = ", ".join(name for name in ("wrench", "thrust", "drive") if getattr(self, name))
        forces = ", ".join(type(force).__name__ for force in self.forces)
        parts = {"pinned": ", ".join(map(str, self.pinned)), "actuators": acting, "forces": forces}
        rest = "".join(f"; {name} {value}" for name, value in parts.items() if value)
        called = f"{self.name}: " if self.name != self.body.name else ""
        return f"{called}{self.body!r}{rest}"


def too_short(springs: np.ndarray, positions: np.ndarray) -> np.ndarray | None:
    """Return a mask (…, S) of springs too short to have a direction, or None if all are long enough.

    Positions are (…, N, 3) [m].
    """
    short = squared_lengths(springs, positions) < TINY**2
    return short if short.any() else None


def squared_lengths(springs: np.ndarray, positions: np.ndarray) -> np.ndarray:
    """Return the squared lengths (…, S) of springs (S, 2) between positions (…, N, 3) [m²]."""
    first, second = springs.T
    apart = positions.take(second, axis=-2) - positions.take(first, axis=-2)
    return np.asarray(np.einsum("...n,...n", apart, apart))


def _numbered(bodies: tuple[Placed, ...]) -> tuple[Placed, ...]:
    """Return several bodies with a number after each name that comes from a `Body` and is not unique."""
    kinds = [placed.body.name if placed.name == placed.body.name else None for placed in bodies]
    shared = {kind for kind, count in Counter(kinds).items() if count > 1 or not kind} - {None}
    numbers: Counter[str] = Counter()
    named = []
    for placed, kind in zip(bodies, kinds, strict=True):
        if len(bodies) > 1 and kind is not None and kind in shared:
            placed = replace(placed, name=f"{kind or 'body'}{numbers[kind]}")
            numbers[kind] += 1
        named.append(placed)
    return tuple(named)


OWN = ("body", "positions", "velocities", "pinned", "wrench", "thrust", "drive", "forces")
"""Fields of a scene of one body that correspond to those of `Placed`."""


OF_A_BODY = ("positions", "masses", "springs", "stiffness", "damping", "lengths", "markers", "triangles")
"""These arrays of a body decide how it moves and how it is measured."""


@refusing_unknown
@dataclass(frozen=True, eq=False)
class Scene(ReadOnly):
    """A scene: bodies, their start, and what acts on them.

    A scene of one body takes the body and the fields of its `Placed` as arguments. A scene of several bodies
    takes them as ``bodies``. Positions and velocities, of the scene and of its simulation, hold the particles
    of all bodies, one body after another.

    Parameters
    ----------
    body, positions, velocities, pinned, wrench, thrust, drive, forces
        The only body, as in `Placed`. A scene of several bodies has positions and velocities (N, 3), and not
        the others.
    gravity : (3,) or None
        [m/s²]
    surfaces
        Surfaces that free particles collide with, see `springgym.model.surfaces`.
    contact
        The contact of bodies with surfaces, a `Contact` or `PaperContact`.
    bodies
        Several bodies, instead of ``body`` and its fields. In a scene of one body, its `Placed`.
    collisions
        The bodies that collide: "all" by ``contact``; a `Contact` by which all collide; a tuple of `Pair`; or
        None if bodies pass through each other, each as if it were alone.

    Raises
    ------
    TypeError
        If an argument has the wrong type, see `springgym.checks`.
    ValueError
        If `Placed` refuses an argument, two bodies share a name, surfaces do not fit together, a particle
        starts behind a surface, or bodies cannot collide or overlap at the start; the message names it.
    """

    body: Body = None  # type: ignore[assignment]
    positions: np.ndarray = None  # type: ignore[assignment]
    velocities: np.ndarray = None  # type: ignore[assignment]
    pinned: tuple[int, ...] = ()
    gravity: tuple[float, float, float] | None = GRAVITY
    wrench: WrenchActuator | None = None
    thrust: ThrustActuator | None = None
    drive: DriveActuator | None = None
    surfaces: tuple[Surface, ...] = ()
    contact: Contact | PaperContact = field(default_factory=Contact)
    bodies: tuple[Placed, ...] = ()
    forces: tuple[Any, ...] = ()
    collisions: Collisions = ALL

    def __post_init__(self) -> None:
        bodies = self._placed()
        object.__setattr__(self, "bodies", bodies)
        if len(bodies) == 1:
            for name in OWN:
                object.__setattr__(self, name, getattr(bodies[0], name))
        else:
            for name in ("positions", "velocities"):
                self.keep(name, np.concatenate([getattr(placed, name) for placed in bodies]))
        if isinstance(self.gravity, Real):
            raise ValueError(
                f"gravity is {self.gravity}; it must be a vector, such as (0, 0, -9.81), or None"
            )
        if self.gravity is not None:
            object.__setattr__(self, "gravity", tuple(array("gravity", self.gravity, (3,)).tolist()))
        self._check_surfaces()
        self._check_heights(self.positions)
        if isinstance(self.collisions, Sequence) and not isinstance(self.collisions, str):
            object.__setattr__(self, "collisions", tuple(self.collisions))
        self._check_apart(self.positions)

    @cached_property
    def identity(self) -> dict[str, Any]:
        """Return plain data, by name, that determine the motion of the scene except its start, see
        `springgym.model.identity`."""
        met = self.meetings
        made: dict[str, Any] = {
            "gravity": None if self.gravity is None else list(self.gravity),
            "number of bodies": len(self.bodies),
            "number of surfaces": len(self.surfaces),
            "collisions": digest((met.first, met.second)),
            "contact of each pair of bodies": digest(met.how),
            "c of pairs of bodies": digest(met.strength),
            "Δ of pairs of bodies": digest(met.reach),
        }
        made |= {f"surface {n}": repr(surface) for n, surface in enumerate(self.surfaces)}
        contacts = {"": self.contact} if self.surfaces else {}
        contacts |= {f" {n} of bodies": contact for n, contact in enumerate(met.contacts)}
        for of, contact in contacts.items():
            made[f"contact{of}"] = type(contact).__name__
            made |= {f"{own.name} of the contact{of}": getattr(contact, own.name) for own in fields(contact)}
        digests = [{name: digest(getattr(one, name)) for name in OF_A_BODY} for one in self._different]
        for kind, placed in zip(self.kinds, self.bodies, strict=True):
            of = self._of(placed)
            made |= {f"{name}{of}": digests[kind][name] for name in OF_A_BODY}
            made |= {f"radius{of}": placed.body.radius, f"floppy{of}": placed.body.floppy}
            for n, feature in enumerate(placed.body.rounds):
                told = [feature.matrix, feature.centre, np.array(feature.particles, int)]
                made |= {f"round feature {n}{of}": [digest(array) for array in told]}
            made |= {f"pinned{of}": list(placed.pinned), f"forces{of}": digest(placed.forces)}
            made |= {f"{name}{of}": repr(getattr(placed, name)) for name in ("wrench", "thrust", "drive")}
        return made

    @cached_property
    def kinds(self) -> tuple[int, ...]:
        """Return the kind of each body. Bodies of one kind are equal in all properties that determine their
        motion."""
        known: dict[int, int] = {}
        kinds: dict[Any, int] = {}
        for body in (placed.body for placed in self.bodies):
            if id(body) not in known:
                given = tuple(np.asarray(getattr(body, name)).tobytes() for name in OF_A_BODY)
                features = tuple((f.matrix.tobytes(), f.centre.tobytes(), f.particles) for f in body.rounds)
                key = (*given, body.radius, body.floppy, features)
                known[id(body)] = kinds.setdefault(key, len(kinds))
        return tuple(known[id(placed.body)] for placed in self.bodies)

    @cached_property
    def _different(self) -> tuple[Body, ...]:
        """Return the first body of each kind, so that derived quantities are computed once per kind."""
        first = {
            kind: placed.body for kind, placed in reversed(list(zip(self.kinds, self.bodies, strict=True)))
        }
        return tuple(first[kind] for kind in range(len(first)))

    @cached_property
    def shapes(self) -> tuple[Shape, ...]:
        """Return the features of each body that can touch others. Bodies of one kind share them."""
        each = [shape(body) for body in self._different]
        return tuple(each[kind] for kind in self.kinds)

    @property
    def can_touch(self) -> bool:
        """Return whether any body can touch a surface or another body."""
        return bool(self.surfaces or self.meetings)

    @cached_property
    def meetings(self) -> Meetings:
        """Return the pairs of bodies that may collide, with their contact parameters."""
        named = [
            BodyRef(
                placed.name,
                self._different[kind],
                bool(placed.free.any()),
                0 < placed.free.sum() < placed.free.size,
            )
            for kind, placed in zip(self.kinds, self.bodies, strict=True)
        ]
        return meetings(self.collisions, self.contact, named)

    @cached_property
    def resisted(self) -> np.ndarray:
        """Return a mask (pairs,) of pairs of bodies in which rolling or spinning is resisted."""
        skin = np.array([shape.skin for shape in self.shapes], bool)
        met = self.meetings
        return met.of_contacts("resists").astype(bool) & (skin[met.first] | skin[met.second])

    def _placed(self) -> tuple[Placed, ...]:
        if not isinstance(self.bodies, Sequence):
            raise TypeError(f"bodies is {shown(self.bodies)}; it must be a tuple of Placed")
        if not self.bodies:
            return (Placed(**{name: getattr(self, name) for name in OWN}),)
        if self._replaced():
            return (Placed(**{name: getattr(self, name) for name in OWN}, name=self.bodies[0].name),)
        for own in fields(self):
            if own.name in OWN and getattr(self, own.name) is not own.default:
                raise ValueError(
                    f"{own.name} is given as well as bodies; give it in the Placed of each body, or change a "
                    "scene with its method with_"
                )
        bodies = tuple(instance(f"bodies[{n}]", placed, Placed) for n, placed in enumerate(self.bodies))
        if len(bodies) > MOST_BODIES:
            raise ValueError(f"bodies has {len(bodies)} entries, too many: at most {MOST_BODIES}")
        bodies = _numbered(bodies)
        first = dict[str, int]()
        for n, name in enumerate(placed.name for placed in bodies):
            if len(bodies) > 1 and (not name or "." in name):
                raise ValueError(
                    f"bodies[{n}] is called {name!r}; in a scene of several bodies, "
                    "a name must be a non-empty string "
                    "without a dot"
                )
            if first.setdefault(name, n) < n:
                raise ValueError(
                    f"bodies[{first[name]}] and bodies[{n}] are both called {name!r}; give "
                    "each Placed its own name"
                )
        return bodies

    def _replaced(self) -> bool:
        """Return whether `dataclasses.replace` makes the scene from the fields of a scene of one body.

        These fields repeat the contents of ``bodies``. A user who gives a body and ``bodies`` by mistake does
        not also give the same positions or velocities twice. Such a scene is refused, because fields of the
        `Placed` would be lost.
        """
        (first, *others) = self.bodies
        if others or not isinstance(first, Placed) or self.body is not first.body:
            return False
        starts = (self.positions, first.positions), (self.velocities, first.velocities)
        return all(given is not None for given, _ in starts) and any(given is own for given, own in starts)

    def _check_surfaces(self) -> None:
        if not isinstance(self.surfaces, Sequence):
            raise TypeError(f"surfaces is {shown(self.surfaces)}; it must be a tuple of surfaces")
        if len(self.surfaces) > MOST_SURFACES:
            raise ValueError(f"surfaces has {len(self.surfaces)} entries, too many: at most {MOST_SURFACES}")
        made = [instance(f"surfaces[{n}]", surface, Surface) for n, surface in enumerate(self.surfaces)]
        object.__setattr__(self, "surfaces", tuple(made))
        instance("contact", self.contact, Contact, PaperContact)
        self._check_resistance()
        if self.surfaces:
            for body in self._different:
                check_surfaces(self.surfaces, scales(self.contact, body)[1])
            for placed in self.bodies:
                if placed.body.rounds and placed.free.any() and len(placed.pinned) > 1:
                    raise ValueError(
                        f"body {placed.name!r} has a round feature, and surfaces would rotate it "
                        "about a single pin; pin one of its particles, or all"
                    )

    def _check_resistance(self) -> None:
        """Raise ValueError for a rolling or torsional resistance without effect."""
        among: tuple[Contact, ...] = ()
        acting: set[Contact] = set()
        if len(self.bodies) > 1:
            met = self.meetings
            among = tuple(met.contacts)
            acting = {among[n] for n in np.unique(met.how[self.resisted])}
        rolls = bool(self.surfaces) and any(body.rounds for body in self._different)
        for contact in dict.fromkeys((self.contact, *among)):
            if not isinstance(contact, Contact) or not contact.resists or contact in acting:
                continue
            given = ", ".join(f"{name} {getattr(contact, name):g}" for name in RESISTANCES)
            if contact != self.contact:
                raise ValueError(
                    f"a contact in collisions has {given}, which acts on round features; none touches "
                    "another body with this contact"
                )
            if not rolls:
                lacks = "no body has one" if self.surfaces else "the scene has no surfaces"
                raise ValueError(
                    f"the contact has {given}, which acts where round features touch surfaces or other "
                    f"bodies; {lacks}, and no round feature touches another body with this contact"
                )

    def _check_heights(self, positions: np.ndarray, copies: np.ndarray | None = None) -> None:
        if not self.surfaces or self._well_above(positions):
            return
        for placed, own in zip(self.bodies, self.slices, strict=True):
            reach = scales(self.contact, placed.body)[1]
            of = self._of(placed)
            check_heights(self.surfaces, reach, positions[..., own, :], placed.free, placed.body, copies, of)

    def _well_above(self, positions: np.ndarray) -> bool:
        """Return whether all particles are well above all surfaces; False for round features."""
        if any(body.rounds for body in self._different):
            return False
        positions = np.asarray(positions, float)
        least = self._least_heights
        for surface in self.surfaces:
            well = surface.height(positions) >= least
            if np.count_nonzero(well) < well.size:
                return False
        return True

    @cached_property
    def _least_heights(self) -> np.ndarray:
        """Return the least initial height of each particle, (N,) [m]; −∞ for pinned ones."""
        each = [NEAREST * scales(self.contact, body)[1] + body.radius for body in self._different]
        return np.where(self.free, self.of_particles([each[kind] for kind in self.kinds]), -np.inf)

    def _check_apart(self, positions: np.ndarray, copies: np.ndarray | None = None) -> None:
        if not self.meetings:
            return
        names = [placed.name for placed in self.bodies]
        bodies = [placed.body for placed in self.bodies]
        met = as_met(self.shapes, bodies, self.offsets, positions)
        check_apart(self.shapes, names, self.offsets, self.meetings, met, copies)

    def _of(self, placed: Placed) -> str:
        """Return the text after a particle's number in error messages: empty if there is only one body."""
        return "" if len(self.bodies) == 1 else f" of {placed.name!r}"

    def check_start(
        self, positions: np.ndarray, velocities: np.ndarray, copies: np.ndarray | None = None
    ) -> None:
        """Refuse a start from which no simulation is possible.

        Parameters
        ----------
        positions, velocities : (N, 3) or (k, N, 3)
            [m], [m/s] of all bodies, one after another; numbers that have been checked.
        copies : (k,), optional
            Numbers of the copies in error messages.

        Raises
        ------
        ValueError
            If `Placed.check_start` refuses the start of a body, a particle is behind a surface, or bodies
            that collide overlap.
        """
        several = len(self.bodies) > 1
        doubtful = {n for n, placed in enumerate(self.bodies) if placed.pinned} if several else {0}
        short = too_short(self.springs, positions) if several else None
        if short is not None:
            springs = np.flatnonzero(short.any(axis=tuple(range(positions.ndim - 2))))
            ends = np.cumsum([len(placed.body.springs) for placed in self.bodies])
            doubtful |= set(np.searchsorted(ends, springs, side="right").tolist())
        for n in sorted(doubtful):
            placed = self.bodies[n]
            own = self.slices[n]
            try:
                placed.check_start(positions[..., own, :], velocities[..., own, :], copies)
            except ValueError as error:
                if not several:
                    raise
                raise ValueError(f"body {placed.name!r}: {error}") from error
        self._check_heights(positions, copies)
        self._check_apart(positions, copies)

    @cached_property
    def parts(self) -> tuple[Self, ...]:
        """Return for each body a scene that contains this body alone, with the same gravity and surfaces."""
        if len(self.bodies) == 1:
            return (self,)
        edged = without_resistance(self.contact)
        rolls = [bool(self.surfaces and placed.body.rounds) for placed in self.bodies]
        contacts = [self.contact if round_ else edged for round_ in rolls]
        return tuple(
            self.with_(bodies=(placed,), collisions=None, contact=contact)
            for placed, contact in zip(self.bodies, contacts, strict=True)
        )

    @cached_property
    def offsets(self) -> np.ndarray:
        """Return the index of the first particle of each body, and the number of all particles, (bodies +
        1,)."""
        return read_only(np.cumsum([0, *(len(placed.body.masses) for placed in self.bodies)]))

    @cached_property
    def slices(self) -> tuple[slice, ...]:
        """Return for each body the slice of its particles."""
        return tuple(slice(first, last) for first, last in pairwise(self.offsets.tolist()))

    def of_particles(self, each: Sequence[Any]) -> np.ndarray:
        """Return for each particle the value of its body, (N, …), given a value for each body."""
        return np.repeat(np.asarray(each), np.diff(self.offsets), axis=0)

    def number(self, body: int | str | None) -> int:
        """Return the index of a body given by index or name; None stands for the only body.

        Raises
        ------
        TypeError, ValueError
            If there is no such body, or None is given and there are several.
        """
        names = [placed.name for placed in self.bodies]
        if body is None and len(names) == 1:
            return 0
        if body is None or isinstance(body, str):
            if body not in names:
                raise ValueError(f"body is {body!r}; it must be one of {', '.join(map(repr, names))}")
            return names.index(body)
        return whole("body", body, high=len(names) - 1)

    @cached_property
    def free(self) -> np.ndarray:
        """Return a mask of the particles that are not pinned, (N,)."""
        return read_only(np.concatenate([placed.free for placed in self.bodies]))

    @cached_property
    def sizes(self) -> np.ndarray:
        """Return for each particle the size of its body, (N,) [m]."""
        each = [body.size for body in self._different]
        return read_only(self.of_particles([each[kind] for kind in self.kinds]))

    @property
    def pins(self) -> tuple[int, ...]:
        """Return the pinned particles of all bodies, as indices among all particles."""
        each = zip(self.bodies, self.slices, strict=True)
        return tuple(own.start + pin for placed, own in each for pin in placed.pinned)

    def of_bodies(self, name: str) -> np.ndarray:
        """Return a property of the particles or springs of all bodies, one body after another.

        Parameters
        ----------
        name
            "masses" [kg] of the particles; "stiffness" [N/m], "damping" [kg/s], "lengths" [m] of the springs.

        Raises
        ------
        TypeError, ValueError
            If there is no such property.
        """
        chosen("name", name, ("masses", "stiffness", "damping", "lengths"))
        return np.concatenate([getattr(placed.body, name) for placed in self.bodies])

    @property
    def masses(self) -> np.ndarray:
        """Return the masses of the particles of all bodies [kg], (N,)."""
        return self.of_bodies("masses")

    @cached_property
    def springs(self) -> np.ndarray:
        """Return the springs of all bodies as pairs of particles, numbered among all particles, (S, 2)."""
        each = zip(self.bodies, self.slices, strict=True)
        return read_only(np.concatenate([placed.body.springs + own.start for placed, own in each]))

    @cached_property
    def lengths(self) -> np.ndarray:
        """Return the lengths of the springs of all bodies [m], (S,)."""
        return read_only(self.of_bodies("lengths"))

    @property
    def pivot(self) -> int:
        """Return the particle about which torques on the only body are taken, see `Placed.pivot`."""
        return self.pinned[0] if self.pinned else -1

    def with_(self, **changes: Any) -> Self:
        """Return a copy with some fields changed, and check it.

        In a scene of one body, changes to fields of the body, such as ``positions``, also change ``bodies``.
        ``bodies`` replaces all of these fields.

        Raises
        ------
        TypeError, ValueError
            If `Scene` refuses the fields, or a new body has another number of particles than the positions or
            velocities that are kept.
        """
        kept = {own.name: getattr(self, own.name) for own in fields(self) if own.name not in OWN}
        if len(self.bodies) == 1 and "bodies" not in changes:
            (placed,) = self.bodies
            self._check_kept(changes)
            own = {name: changes.pop(name, getattr(placed, name)) for name in OWN}
            own["name"] = None if placed.name == placed.body.name else placed.name
            kept["bodies"] = (Placed(**own),)
        return type(self)(**{**kept, **changes})

    def _check_kept(self, changes: dict[str, Any]) -> None:
        """Raise ValueError for a new body whose particles are not those of the start that is kept."""
        body = changes.get("body")
        count = len(self.positions)
        kept = [name for name in ("positions", "velocities") if name not in changes]
        if kept and isinstance(body, Body) and len(body.masses) != count:
            raise ValueError(
                f"body is {shown(body)}, of {len(body.masses)} particles; it must have {count}, as many as "
                f"the {kept[0]} that the scene keeps, unless you change {' and '.join(kept)}, too (None: the "
                "body's shape, at rest)"
            )

    def _pairs(self) -> str:
        """Return the names of the bodies that may collide, or the number of pairs if they are many."""
        if len(self.meetings) > MOST_LISTED:
            return f"{len(self.meetings)} pairs"
        return ", ".join(f"{met.first}–{met.second}" for met in self.meetings)

    def _kinds(self) -> str:
        """Return the reprs of the bodies or, if they are many, how many there are of each kind."""
        if len(self.bodies) <= MOST_LISTED:
            return " | ".join(map(repr, self.bodies))
        counts = Counter(repr(replace(placed, name=placed.body.name)) for placed in self.bodies)
        return " | ".join(f"{count} × {kind}" for kind, count in counts.items())

    def __repr__(self) -> str:
        parts = {
            "gravity": "" if self.gravity is None else f"{self.gravity} m/s²",
            "surfaces": ", ".join(map(repr, self.surfaces)),
            "contact": repr(self.contact) if self.surfaces else "",
            "collisions": self._pairs(),
        }
        rest = "".join(f"; {name} {value}" for name, value in parts.items() if value)
        return f"Scene({self._kinds()}{rest})"
