"""A scene: a body, how it starts, and what acts on it. Frozen data, checked once."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any, Self

import numpy as np

from springgym.bodies import Body
from springgym.checks import TINY, array, flag, indices, instance, number, shown, whole, whole_array
from springgym.records import ReadOnly
from springgym.surfaces import (
    Contact,
    Dish,
    PaperContact,
    Plane,
    Surface,
    check_heights,
    check_surfaces,
    scales,
)

GRAVITY = (0.0, 0.0, -9.81)

MOST_SURFACES = 100
"""A scene has no more: each particle is compared with each surface at every step."""


@dataclass(frozen=True)
class WrenchActuator:
    """A force and a torque on the whole body; ``axial`` keeps the world torque's part along its axis."""

    axial: bool = True

    def __post_init__(self) -> None:
        object.__setattr__(self, "axial", flag("axial of a wrench", self.axial))


@dataclass(frozen=True)
class ThrustActuator:
    """Forces on named particles, fixed in the world or, if ``turns``, in the body's triad."""

    particles: tuple[int, ...]
    turns: bool = False

    def __post_init__(self) -> None:
        particles = whole_array("particles of a thrust", self.particles, (None,))
        object.__setattr__(self, "particles", tuple(particles.tolist()))
        object.__setattr__(self, "turns", flag("turns of a thrust", self.turns))


@dataclass(frozen=True)
class DriveActuator:
    """A pinned particle moved by its acceleration, each component of its speed [m/s] limited."""

    particle: int
    speed: float

    def __post_init__(self) -> None:
        object.__setattr__(self, "particle", whole("particle of a drive", self.particle))
        object.__setattr__(self, "speed", number("speed of a drive", self.speed, low=TINY))


@dataclass(frozen=True, eq=False)
class Scene(ReadOnly):
    """All that is simulated.

    Parameters
    ----------
    body
        Particles and springs.
    positions, velocities : (N, 3), optional
        Where it starts [m] and how it moves [m/s]: the unstretched shape, at rest, if not given.
    pinned
        Particles that are held (zero inverse mass): torques and angular momenta count from the first.
    gravity : (3,) or None
        [m/s²]
    wrench, thrust, drive
        Actuators; None for what there is not.
    surfaces
        What bounds where the free particles may be: planes, or a dish.
    contact
        How the body meets them.

    Raises
    ------
    TypeError
        Naming what is of the wrong kind, see `springgym.checks`.
    ValueError
        Naming the offender: a wrong shape, a value that is not finite, a particle that does not exist,
        a start that `check_start` refuses, surfaces that cannot be together.
    """

    body: Body
    positions: np.ndarray = None  # type: ignore[assignment]
    velocities: np.ndarray = None  # type: ignore[assignment]
    pinned: tuple[int, ...] = ()
    gravity: tuple[float, float, float] | None = GRAVITY
    wrench: WrenchActuator | None = None
    thrust: ThrustActuator | None = None
    drive: DriveActuator | None = None
    surfaces: tuple[Surface, ...] = ()
    contact: Contact | PaperContact = field(default_factory=Contact)

    def __post_init__(self) -> None:
        body = instance("body", self.body, Body)
        count = len(body.masses)
        for name, default in (("positions", body.positions), ("velocities", np.zeros((count, 3)))):
            given = getattr(self, name)
            self.keep(name, array(name, default if given is None else given, (count, 3)))
        pinned = dict.fromkeys(indices("pinned", self.pinned, count).tolist())
        object.__setattr__(self, "pinned", tuple(pinned))
        if self.gravity is not None:
            object.__setattr__(self, "gravity", tuple(array("gravity", self.gravity, (3,)).tolist()))
        kinds = {"wrench": WrenchActuator, "thrust": ThrustActuator, "drive": DriveActuator}
        for name, kind in kinds.items():
            instance(name, getattr(self, name), kind, type(None))
        if self.thrust:
            indices("thrust.particles", self.thrust.particles, count)
            if self.thrust.turns and not body.oriented:
                raise ValueError(
                    f"thrust cannot turn with body {body.name!r}: the particles {body.frame} of its frame "
                    "lie on one line and tell no orientation; it must be fixed in the world"
                )
        if self.drive and self.drive.particle not in self.pinned:
            raise ValueError(f"drive.particle {self.drive.particle} must be pinned: the drive alone moves it")
        self._check_surfaces()
        self.check_start(self.positions, self.velocities)

    def _check_surfaces(self) -> None:
        if not isinstance(self.surfaces, Sequence):
            raise TypeError(f"surfaces is {shown(self.surfaces)}; it must be a tuple of surfaces")
        if len(self.surfaces) > MOST_SURFACES:
            raise ValueError(f"surfaces are {len(self.surfaces)}; there must be at most {MOST_SURFACES}")
        made = [instance(f"surfaces[{n}]", surface, Plane, Dish) for n, surface in enumerate(self.surfaces)]
        object.__setattr__(self, "surfaces", tuple(made))
        instance("contact", self.contact, Contact, PaperContact)
        if self.surfaces:
            check_surfaces(self.surfaces, scales(self.contact, self.body)[1])

    def check_start(self, positions: np.ndarray, velocities: np.ndarray, copies: Any = None) -> None:
        """Refuse what cannot be started from.

        Parameters
        ----------
        positions, velocities : (N, 3) or (k, N, 3)
            [m], [m/s], checked to be numbers.
        copies : (k,), optional
            What errors call the copies.

        Raises
        ------
        ValueError
            If a pinned particle moves and is not driven, or driven faster than it can be; if the ends of a
            spring are at the same place, so that it has no direction; if a particle is behind a surface.
        """

        def refuse(wrong: np.ndarray, what: str) -> None:
            """Raise if anything (N,) or (k, N) is wrong; ``what`` may name the number and the copy."""
            if wrong.any():
                *row, n = np.argwhere(wrong)[0].tolist()
                raise ValueError(
                    what.format(n=n, of=f" of copy {copies[row[0]]}" if row and copies is not None else "")
                )

        if self.pinned:
            moves = ~self.free & velocities.any(axis=-1)
            if self.drive:
                driven = np.abs(velocities[..., self.drive.particle, :]).max(axis=-1, keepdims=True)
                fast = "particle %d{of} starts faster than its drive moves it, %g m/s at most"
                refuse(driven > self.drive.speed, fast % (self.drive.particle, self.drive.speed))
                moves[..., self.drive.particle] = False
            refuse(moves, "pinned particle {n}{of} has a velocity; it must be zero")
        first, second = self.body.springs.T
        apart = np.abs(positions[..., second, :] - positions[..., first, :]).max(axis=-1)
        refuse(apart < TINY, "spring {n}{of} starts with both ends at the same place; it has no direction")
        if self.surfaces:
            check_heights(self.surfaces, scales(self.contact, self.body)[1], positions, self.free, copies)

    @cached_property
    def free(self) -> np.ndarray:
        """Which particles are not pinned, (N,)."""
        free = ~np.isin(np.arange(len(self.body.masses)), self.pinned)
        free.setflags(write=False)
        return free

    @property
    def pivot(self) -> int:
        """The particle that torques and angular momenta count from: the first pinned one, else −1."""
        return self.pinned[0] if self.pinned else -1

    def with_(self, **changes: Any) -> Self:
        """A copy with some fields changed, checked anew."""
        return replace(self, **changes)

    def __repr__(self) -> str:
        acting = ", ".join(name for name in ("wrench", "thrust", "drive") if getattr(self, name))
        parts = {
            "pinned": ", ".join(map(str, self.pinned)),
            "gravity": "" if self.gravity is None else f"{self.gravity} m/s²",
            "actuators": acting,
            "surfaces": ", ".join(map(repr, self.surfaces)),
            "contact": repr(self.contact) if self.surfaces else "",
        }
        rest = "".join(f"; {name} {value}" for name, value in parts.items() if value)
        return f"Scene({self.body!r}{rest})"
