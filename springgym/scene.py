"""A scene: a body, how it starts, and what acts on it. Frozen data, checked once."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import Any, Self

import numpy as np

from springgym.bodies import Body
from springgym.surfaces import Contact, PaperContact, Surface, check_heights, check_surfaces, scales

GRAVITY = (0.0, 0.0, -9.81)


@dataclass(frozen=True)
class WrenchActuator:
    """A force and a torque on the whole body; ``axial`` keeps the world torque's part along its axis."""

    axial: bool = True


@dataclass(frozen=True)
class ThrustActuator:
    """Forces on named particles, fixed in the world or, if ``turns``, in the body's triad."""

    particles: tuple[int, ...]
    turns: bool = False


@dataclass(frozen=True)
class DriveActuator:
    """A pinned particle moved by its acceleration, each component of its speed [m/s] limited."""

    particle: int
    speed: float


@dataclass(frozen=True, eq=False)
class Scene:
    """All that is simulated.

    Parameters
    ----------
    body
        Particles and springs.
    positions, velocities : (N, 3), optional
        Where it starts [m] and how it moves [m/s]: the unstretched shape, at rest, if not given.
    pinned
        Particles that are held (zero inverse mass).
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
    ValueError
        Naming the offender: a wrong shape, a value that is not finite, a particle that does not exist,
        a pinned particle that moves, a particle that starts behind a surface, surfaces that cannot be
        together.
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
        shape = self.body.positions.shape
        for name, default in (("positions", self.body.positions), ("velocities", np.zeros(shape))):
            given = getattr(self, name)
            array = np.array(default if given is None else given, float)
            if array.shape != shape:
                raise ValueError(f"{name} must have shape {shape}, not {array.shape}")
            if not np.isfinite(array).all():
                raise ValueError(
                    f"{name} of particle {np.argwhere(~np.isfinite(array))[0][0]} are not finite"
                )
            array.setflags(write=False)
            object.__setattr__(self, name, array)
        named = {"pinned": self.pinned}
        if self.thrust:
            named["thrust.particles"] = self.thrust.particles
        if self.drive:
            named["drive.particle"] = (self.drive.particle,)
        for name, particles in named.items():
            for i in particles:
                if not 0 <= i < shape[0]:
                    raise ValueError(f"{name} names particle {i}; the body has 0 to {shape[0] - 1}")
        if self.drive and self.drive.particle not in self.pinned:
            raise ValueError(f"drive.particle {self.drive.particle} must be pinned: the drive alone moves it")
        for i in self.pinned:
            if self.velocities[i].any() and not (self.drive and self.drive.particle == i):
                raise ValueError(f"pinned particle {i} has velocity {self.velocities[i]}; it must be zero")
        if self.gravity is not None and not np.isfinite(self.gravity).all():
            raise ValueError(f"gravity is {self.gravity}; it must be finite")
        object.__setattr__(self, "surfaces", tuple(self.surfaces))
        if self.surfaces:
            _, reach = scales(self.contact, self.body)
            check_surfaces(self.surfaces, reach)
            check_heights(self.surfaces, reach, self.positions, self.free)

    @property
    def free(self) -> np.ndarray:
        """Which particles are not pinned, (N,)."""
        return ~np.isin(np.arange(len(self.body.masses)), self.pinned)

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
