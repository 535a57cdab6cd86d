"""The contact of bodies, and checks of surfaces that a scene combines. Frozen data, checked once."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from springgym.checks import TINY, apart, array, instance, number, refusing_unknown
from springgym.model.bodies import Body, vibrations
from springgym.model.surfaces.plane import Plane, floor
from springgym.model.surfaces.round import heights
from springgym.model.surfaces.surface import Surface
from springgym.theory.contact import rest_height

DEFAULT_REACH = 0.01
"""The default contact margin Δ, as a fraction of `Body.swept`."""

NEAREST = 1e-3
"""The least height at the start, in units of Δ. Below it the energy c/h of the barrier is too large."""

SOFTEST = 0.005
"""The least derived strength c, in units of k Δ³. At the edge of the barrier the stiffness of contact, 2
c/Δ³, is then a hundredth of a spring's."""

STIFFEST = 0.05
"""The largest derived strength c, in units of k Δ³. At the edge of the barrier the stiffness of contact is
then a tenth of a spring's, so that impacts do not excite the springs."""

IMPACT = 10.0
"""Between `SOFTEST` and `STIFFEST`, the derived c is the least at which a corner of a block that strikes at
this speed [m/s] stays a tenth of Δ away."""

RESISTANCES = ("rolling_resistance", "torsional_resistance")
"""Names of the options of a `Contact` that concern only round features."""


@refusing_unknown
@dataclass(frozen=True)
class Contact:
    """The contact of bodies with surfaces and each other: a barrier that conserves energy, and friction.

    Parameters
    ----------
    friction
        μ, static and kinetic; 0 for ice.
    restitution
        e, rebound speed divided by impact speed, from 0 to 1, of impacts far above w, 4 mm/s. Slower ones
        rebound with more, see `springgym.theory.contact.rebound`, and resting contact is damped.
    strength, reach
        c [N·m²] and Δ [m]. By default Δ is `DEFAULT_REACH` of `Body.swept`, and c is `derived_strength`.
    rolling_resistance, torsional_resistance
        ρ and τ [m] of round features on surfaces and on other bodies. With the push J, a couple of at most
        ρ J opposes turning about tangents of the surface (rolling), and one of at most τ J turning about its
        normal (spinning). They stop rotation, but do not reverse it: a ball of radius R rests on slopes up to
        the angle arctan ρ/R. Their loss counts as friction. They do not act on particles.

    Raises
    ------
    ValueError
        If a value is out of bounds; the message names it.
    """

    friction: float = 0.0
    restitution: float = 1.0
    strength: float | None = None
    reach: float | None = None
    rolling_resistance: float = 0.0
    torsional_resistance: float = 0.0

    def __post_init__(self) -> None:
        _check(self, ("friction", *RESISTANCES), ("strength", "reach"))
        object.__setattr__(self, "restitution", number("restitution", self.restitution, 0.0, 1.0))

    @property
    def resists(self) -> bool:
        """Whether the rolling or the torsional resistance is positive."""
        return any(getattr(self, name) > 0 for name in RESISTANCES)


def without_resistance(contact: Contact | PaperContact) -> Contact | PaperContact:
    """Return the same contact without rolling and torsional resistance."""
    if isinstance(contact, Contact) and contact.resists:
        return replace(contact, **dict.fromkeys(RESISTANCES, 0.0))
    return contact


@refusing_unknown
@dataclass(frozen=True)
class PaperContact:
    """The paper's contact with surfaces, see `springgym.dynamics.forces.paper_contact`; for rk4 only.

    Parameters
    ----------
    friction
        μ
    damping
        c_N [kg/s]
    strength, reach
        As for `Contact`.
    """

    friction: float = 0.0
    damping: float = 0.0
    strength: float | None = None
    reach: float | None = None

    def __post_init__(self) -> None:
        _check(self, ("friction", "damping"), ("strength", "reach"))


def _check(contact: object, not_negative: tuple[str, ...], positive: tuple[str, ...]) -> None:
    for name in not_negative + positive:
        value = getattr(contact, name)
        if value is not None or name not in positive:
            low = 0.0 if name in not_negative else TINY
            object.__setattr__(contact, name, number(f"{name} of the contact", value, low))


def loss_factor(restitution: ArrayLike) -> np.ndarray:
    """Return the loss factors β [1] that give restitutions (…), see `springgym.dynamics.contact.law`.

    Raises
    ------
    TypeError, ValueError
        If a restitution is not a number in [0, 1].
    """
    square = array("restitution", restitution, (), (None,), high=1.0, low=0.0) ** 2
    return np.asarray((1.0 - square) / (1.0 + square))


def derived_strength(
    stiffness: float | np.ndarray, mass: float | np.ndarray, reach: float | np.ndarray
) -> np.ndarray:
    """Return the default strength c [N·m²], for numbers or arrays of one shape.

    A corner of a block counts as at most a quarter of its mass. From ½ (m/4) v² = c (Δ − h)²/(h Δ²) and
    h = Δ/10 follows c = m v² Δ/64.8. c is limited to the range from `SOFTEST` to `STIFFEST` times k Δ³.

    Parameters
    ----------
    stiffness
        k [N/m] of the stiffest spring of a body, or of the softer one of two bodies.
    mass
        m [kg] of a body, or the reduced mass of two bodies.
    reach
        Δ [m]
    """
    each, which = np.unique(reach, return_inverse=True)
    cubes = np.array([one**3 for one in each.tolist()])  # NumPy's power may differ in the last bit
    edge = stiffness * cubes[which]
    return np.clip(strength_of_impact(mass, reach), SOFTEST * edge, STIFFEST * edge)


def strength_of_impact(mass: float | np.ndarray, reach: float | np.ndarray) -> np.ndarray:
    """Return the strength c [N·m²] at which a corner that strikes at `IMPACT` stays a tenth of Δ away.

    `derived_strength` limits it by the stiffness of the springs.
    """
    return np.asarray(mass * IMPACT**2 * reach / 64.8)


@lru_cache(maxsize=256)
def slowest_vibration(body: Body) -> float:
    """Return ω [rad/s] of a free body's slowest vibration; infinite if it is floppy or does not vibrate."""
    if body.floppy or len(body.masses) < 2:
        return math.inf
    return float(vibrations(body)[0][0])


def scales(contact: Contact | PaperContact, body: Body) -> tuple[float, float]:
    """Return c [N·m²] and Δ [m] for a body, see `Contact`.

    Raises
    ------
    ValueError
        If one of them has no value, and cannot be derived because the body has no size or no springs.
    """
    reach = contact.reach
    strength = contact.strength
    if reach is None:
        reach = DEFAULT_REACH * body.swept
    if strength is None:
        strength = float(derived_strength(float(body.stiffness.max(initial=0.0)), body.mass, reach))
    if not (reach > 0 and strength > 0):
        raise ValueError(
            f"body {body.name!r} has no size or no springs to derive the contact from; "
            "give strength and reach of the contact"
        )
    return strength, reach


@refusing_unknown
def resting(
    body: Body,
    positions: ArrayLike,
    contact: Contact | PaperContact,
    plane: Plane | None = None,
    gravity: ArrayLike = (0.0, 0.0, -9.81),
) -> np.ndarray:
    """Return positions (N, 3) [m] moved along a plane's normal, to the height where it supports the body.

    The lowest particles, or round features, share the weight equally. So a body rests there if it stands or
    lies level, with its centre of mass above the middle of them. If its springs are soft, they yield first.

    Parameters
    ----------
    body, positions : (N, 3)
        The body, and the positions of its particles before [m].
    contact
        The contact of the body with the plane, as in the scene.
    plane
        The plane; by default the floor z = 0.
    gravity : (3,)
        As in the scene [m/s²].

    Raises
    ------
    TypeError, ValueError
        If an argument has the wrong type or shape, or gravity does not press the body onto the plane.
    """
    instance("body", body, Body)
    instance("contact", contact, Contact, PaperContact)
    if plane is None:
        plane = floor()
    instance("plane", plane, Plane)
    places = array("positions", positions, body.positions.shape)
    weight = -body.mass * float(np.dot(array("gravity", gravity, (3,)), plane.normal))
    if weight <= 0:
        raise ValueError("gravity does not press the body onto the plane, so it cannot rest there")
    strength, reach = scales(contact, body)
    found = heights(body, places, plane)
    carriers = int(np.sum(found < found.min() + 1e-3 * reach))
    height = rest_height(weight / carriers, strength, reach)
    return np.asarray(places + (height - found.min()) * np.array(plane.normal))


def coupled(surfaces: tuple[Surface, ...]) -> bool:
    """Return whether the impulse of a surface depends on other surfaces, or on the end of a particle's path.

    It does not if all surfaces are planes, and any two of them face each other or are at a right angle.
    """
    flat = all(isinstance(surface, Plane) for surface in surfaces)
    return not flat or any(abs(dot) > 1e-12 and dot > -1 + 1e-12 for _, _, dot in _planes(surfaces))


def check_surfaces(surfaces: tuple[Surface, ...], reach: float) -> None:
    """Raise ValueError for surfaces between which contact cannot be computed.

    Raises
    ------
    ValueError
        If two planes meet at less than a right angle, or face each other at less than 4 Δ.
    """
    for i, j, dot in _planes(surfaces):
        first = surfaces[i]
        second = surfaces[j]
        assert isinstance(first, Plane)
        assert isinstance(second, Plane)
        if dot < -1 + 1e-12:
            gap = -(first.offset + second.offset)
            if gap < 4 * reach:
                given, least = apart(gap, 4 * reach)
                raise ValueError(
                    f"surfaces {i} and {j} face each other {given} m apart; because each of them reaches "
                    f"{reach:g} m, they must be at least {least} m apart"
                )
        elif dot < -1e-9:
            angle = 180 - math.degrees(math.acos(max(-1.0, dot)))
            raise ValueError(
                f"surfaces {i} and {j} meet at {apart(angle, 90.0)[0]}°; they must meet at 90° or more, "
                "because particles could pass through a sharper notch"
            )


def _planes(surfaces: tuple[Surface, ...]) -> list[tuple[int, int, float]]:
    """Return the planes i < j and the product of their normals."""
    planes = [(n, surface.normal) for n, surface in enumerate(surfaces) if isinstance(surface, Plane)]
    return [(i, j, float(np.dot(a, b))) for i, a in planes for j, b in planes if i < j]


def check_heights(
    surfaces: tuple[Surface, ...],
    reach: Any,
    positions: np.ndarray,
    free: Any,
    body: Body,
    copies: Any = None,
    owner: str = "",
) -> None:
    """Raise ValueError for starts behind or too near a surface.

    Parameters
    ----------
    reach
        Δ of the body's contact [m].
    positions : (N, 3) or (k, N, 3)
        [m]
    free : (N,)
        The particles that surfaces act on: those that are not pinned.
    body
        The body. Its round features must be above the surface or, if it has none, its balls, rods or
        particles.
    copies : (k,), optional
        Numbers of the copies, for error messages.
    owner
        Text after the particle's number in error messages: " of" and the body, if there are several bodies.

    Raises
    ------
    ValueError
        If a start is refused; the message names the particle or feature, the copy and the surface.
    """
    what, acts = ("round feature", np.array(True)) if body.rounds else ("particle", free)
    for n, surface in enumerate(surfaces):
        found = heights(body, positions, surface)
        wrong = ~(found >= NEAREST * reach) & acts
        if wrong.any():
            *row, part = first = np.argwhere(wrong)[0].tolist()
            h = found[tuple(first)]
            of = f" of copy {copies[row[0]]}" if row and copies is not None else ""
            height, least = apart(abs(h), NEAREST * reach)
            where = f"{height} m behind" if h < 0 else f"only {height} m above"
            finds = ". springgym.model.surfaces.resting finds where it rests"
            hint = finds if isinstance(surface, Plane) else ""
            raise ValueError(
                f"{what} {part}{owner}{of} starts {where} surface {n}, {surface}; it must be at least "
                f"{least} m above; the surface's force ends at {reach:g} m{hint}"
            )
