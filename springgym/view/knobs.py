"""Sliders of a scene: which numbers of its file they change, and their ranges."""

from __future__ import annotations

import inspect
import math
from collections.abc import Callable, Iterator, Mapping
from typing import Any, NamedTuple

from springgym.model.scene import GRAVITY
from springgym.scenes.reading import KINDS, document

MOST_BODIES = 40
"""The largest number of bodies for which the viewer shows sliders; more would be unusable."""


class Knob(NamedTuple):
    """A slider on a number of a scene file."""

    path: tuple[str, ...]
    """the path of keys"""
    label: str
    value: float
    """the number in the file"""
    low: float
    high: float
    step: float
    exponent: bool = False
    """whether the slider shows log₁₀ of the number"""

    @property
    def body(self) -> str:
        """Name of the body that it belongs to, in scenes of several bodies; else ""."""
        return self.path[1] if self.path[0] == "bodies" else ""

    @property
    def start(self) -> float:
        """Return the slider's position for the file's value."""
        return math.log10(self.value) if self.exponent else self.value

    def number(self, shown: float) -> float:
        """Return the number for a position of the slider."""
        if shown == self.start:
            return self.value
        return 10.0**shown if self.exponent else shown


def _linear(unit: str, low: float, high: float, step: float, most: float = math.inf) -> Callable[..., Knob]:
    """Return a function that makes a `Knob` from ``low`` to ``high`` or, if that is more, twice the value."""

    def knob(path: tuple[str, ...], value: float) -> Knob:
        label = f"{path[-1].replace('_', ' ')} {unit}".strip()
        return Knob(path, label, value, min(low, 2 * value), min(max(high, 2 * value), most), step)

    return knob


def _share(unit: str) -> Callable[..., Knob | None]:
    """Return a function that makes a `Knob` from 0.2 to 4 times a value, or returns None if it is 0."""

    def knob(path: tuple[str, ...], value: float) -> Knob | None:
        if value <= 0:
            return None
        step = 10.0 ** math.floor(math.log10(value / 20))
        label = f"{path[-1].replace('_', ' ')} {unit}"
        return Knob(path, label, value, max(step, round(value / 5 / step) * step), 4 * value, step)

    return knob


def _decades(unit: str) -> Callable[..., Knob | None]:
    """Return a function that makes a logarithmic `Knob` from 0.01 to 10 times a value, or None if it is 0."""

    def knob(path: tuple[str, ...], value: float) -> Knob | None:
        if value <= 0:
            return None
        start = math.log10(value)
        label = f"log₁₀ {path[-1]} {unit}"
        return Knob(path, label, value, round(start - 2, 1), round(start + 1, 1), 0.05, True)

    return knob


KNOBS: dict[str, dict[str, Callable[..., Knob | None]]] = {
    "start": {
        "spin": _linear("[rad/s]", 0.0, 100.0, 0.5),
        "tilt": _linear("[rad]", 0.0, 1.5, 0.01),
        "precession": _linear("[rad/s]", 0.0, 10.0, 0.1),
    },
    "body": {
        "mass": _share("[kg]"),
        "ring_mass": _share("[kg]"),
        "end_mass": _share("[kg]"),
        "radius": _share("[m]"),
        "height": _share("[m]"),
        "length": _share("[m]"),
        "stiffness": _decades("[N/m]"),
        "damping": _linear("[kg/s]", 0.0, 200.0, 1.0),
    },
    "contact": {
        "friction": _linear("μ", 0.0, 1.5, 0.01),
        "restitution": _linear("", 0.0, 1.0, 0.01, 1.0),
        "rolling_resistance": _share("[m]"),
        "torsional_resistance": _share("[m]"),
    },
}
"""Sliders by the section of a scene file, and its key."""


def knobs(scene: str) -> list[Knob]:
    """Return the sliders of a scene, named as in `springgym.scenes.load`."""
    return list(_found(document(scene).value))


def _found(text: Mapping[str, Any]) -> Iterator[Knob]:
    bodies = text.get("bodies")
    if not isinstance(bodies, Mapping) or len(bodies) > MOST_BODIES:
        bodies = {}
    for name, body in bodies.items():
        yield from _of_body(body, ("bodies", name)) if isinstance(body, Mapping) else ()
    yield from _of_body(text, ())
    if text.get("surfaces"):
        yield from _section(text, (), "contact", {"friction": 0.0, "restitution": 1.0})
    gravity = text.get("gravity", -GRAVITY[2])
    if isinstance(gravity, (int, float)):
        yield _linear("[m/s²]", 0.0, 25.0, 0.1)(("gravity",), float(gravity))
    for n, surface in enumerate(text.get("surfaces") or ()):
        if isinstance(surface, Mapping) and isinstance(surface.get("angle"), (int, float)):
            angle = float(surface["angle"])
            yield Knob(("surfaces", str(n), "angle"), "slope [rad]", angle, 0.0, max(0.8, 2 * angle), 0.01)


def _of_body(text: Mapping[str, Any], path: tuple[str, ...]) -> Iterator[Knob]:
    """Yield the sliders of a body's start and construction, from its part of a file at ``path``."""
    body = text.get("body")
    kind = body.get("kind") if isinstance(body, Mapping) else None
    yield from _section(text, path, "start", {})
    yield from _section(text, path, "body", _numbers(KINDS[kind]) if kind in KINDS else {})


def _section(
    text: Mapping[str, Any], path: tuple[str, ...], section: str, defaults: Mapping[str, float]
) -> Iterator[Knob]:
    given = text.get(section)
    values = {**defaults, **(given if isinstance(given, Mapping) else {})}
    for key, knob in KNOBS[section].items():
        value = values.get(key)
        if not isinstance(value, (int, float)) or isinstance(value, bool):
            continue
        if made := knob((*path, section, key), float(value)):
            yield made


def _numbers(make: Callable[..., Any]) -> dict[str, float]:
    """Return the arguments of a function whose defaults are numbers."""
    return {
        name: parameter.default
        for name, parameter in inspect.signature(make).parameters.items()
        if type(parameter.default) in (int, float)
    }
