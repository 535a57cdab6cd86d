"""Factors that each episode draws from given ranges."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.random import Generator

from springgym import checks
from springgym.checks import TINY
from springgym.envs.options import mapping
from springgym.model.scene import GRAVITY, Scene
from springgym.model.surfaces import Contact

__all__ = [
    "NOMINAL",
    "OF_SPRINGS",
    "RANDOMIZABLE",
    "Ranges",
    "checked_ranges",
    "drawn",
    "parameters",
    "stretched",
    "varying",
    "weight_of",
]

RANDOMIZABLE = ("masses", "stiffness", "damping", "scale", "gravity", "friction", "restitution", "actuator")
"""Parameters for which `randomize` accepts a range of factors, if the scene has them."""

NOMINAL: Mapping[str, float] = dict.fromkeys(RANDOMIZABLE, 1.0)
"""The factors of an episode without randomisation: 1 for each parameter."""

OF_SPRINGS = ("stiffness", "damping")
"""Names that a rigid body does not have; ``scale`` multiplies the lengths of springs, see `stretched`, and
thereby the size of a rigid body."""

Ranges = dict[str, tuple[float, float]]
"""(low, high) of factors by name, out of `RANDOMIZABLE`."""


def checked_ranges(randomize: Mapping[str, Sequence[float]] | None, dynamics: str) -> Ranges:
    """Return the ranges given by a user, after checking them.

    Raises
    ------
    TypeError, ValueError
        If a factor does not exist, or a range is not one; the message names it.
    """
    ranges: Ranges = {}
    if randomize is None:
        return ranges
    for name, given in mapping("randomize", randomize).items():
        if name not in RANDOMIZABLE:
            raise ValueError(f"cannot randomize {name!r}; {', '.join(RANDOMIZABLE)} can be")
        if dynamics == "rigid" and name in OF_SPRINGS:
            raise ValueError(f"cannot randomize {name!r}: a rigid body has no springs")
        low, high = checks.array(f"randomize[{name!r}]", given, (2,), low=TINY).tolist()
        if low > high:
            raise ValueError(f"randomize[{name!r}] is {given!r}; it must be (low, high) with low ≤ high")
        ranges[name] = (low, high)
    return ranges


def varying(ranges: Mapping[str, Any], scene: Scene) -> set[str]:
    """Return the names of the simulator's parameters that vary under the ranges.

    Raises
    ------
    ValueError
        If a range allows a restitution above 1, or concerns gravity in a scene without gravity.
    """
    if scene.surfaces and isinstance(scene.contact, Contact) and "restitution" in ranges:
        highest = scene.contact.restitution * ranges["restitution"][1]
        if highest > 1:
            given, _ = checks.apart(highest, 1.0)
            raise ValueError(
                f"randomize['restitution'] allows a restitution of {given}; it must be at most 1"
            )
    if "gravity" in ranges and scene.gravity is None:
        raise ValueError("cannot randomize 'gravity': the scene has no gravity")
    return {"lengths" if name == "scale" else name for name in ranges} - {"actuator"}


def drawn(ranges: Ranges, rng: Generator, options: dict[str, Any]) -> dict[str, float]:
    """Return the factors of an episode, by the names in `RANDOMIZABLE`.

    ``options["randomize"]`` fixes some factors, and is removed from the options. The others are drawn from
    their ranges, and are 1 without a range.

    Raises
    ------
    TypeError, ValueError
        If a fixed factor has no range, or lies outside of its range; the message names it.
    """
    given = mapping("reset option 'randomize'", options.pop("randomize")) if "randomize" in options else {}
    for name in given:
        if name not in ranges:
            raise ValueError(
                f"reset cannot set the factor of {name!r}: "
                f"randomize was given {', '.join(ranges) or 'nothing'} when the environment was made"
            )
    factors = dict(NOMINAL)
    for name, (low, high) in ranges.items():
        factors[name] = rng.uniform(low, high)
        if name in given:
            factors[name] = checks.number(f"reset option 'randomize', {name!r},", given[name], low, high)
    return factors


def weight_of(mass: Any, factors: Mapping[str, float]) -> Any:
    """Return the weight [N] of a mass, or of masses, [kg] in an episode of these factors."""
    return -GRAVITY[2] * factors["gravity"] * factors["masses"] * mass


def stretched(scene: Scene, scale: float | np.ndarray) -> np.ndarray:
    """Return the factors of the lengths of all springs (…, S), for factors () or (…, 1) of the scale.

    They are ``scale``, but 1 in bodies whose round features touch other bodies, as radii do not vary.
    """
    met = {n for of in (scene.meetings.first, scene.meetings.second) for n in of.tolist()}
    spheres = [n in met and shape.skin for n, shape in enumerate(scene.shapes)]
    springs = [len(placed.body.springs) for placed in scene.bodies]
    return np.where(np.repeat(spheres, springs), 1.0, scale)


def parameters(scene: Scene, ranges: Ranges, factors: Mapping[str, float]) -> dict[str, np.ndarray]:
    """Return the parameters of one copy for `Simulator.vary`, from its factors."""
    values = {name: scene.of_bodies(name) * factors[name] for name in ("masses", "stiffness", "damping")}
    values["lengths"] = scene.of_bodies("lengths") * stretched(scene, factors["scale"])
    if scene.gravity is not None:
        values["gravity"] = np.array(scene.gravity) * factors["gravity"]
    if isinstance(scene.contact, Contact):
        values["friction"] = np.array(scene.contact.friction * factors["friction"])
        values["restitution"] = np.array(scene.contact.restitution * factors["restitution"])
    names = varying(ranges, scene)
    return {name: value for name, value in values.items() if name in names}
