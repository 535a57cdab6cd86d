"""Quantities over time, with their colours, for the graphs of figures and of the viewer."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from springgym.dynamics.measures import Measures
from springgym.model.scene import Scene
from springgym.rendering.look import BLUE, GREEN, ORANGE, RED, SLATE, TEAL, Color

BLACK: Color = (0, 0, 0)
OCHRE: Color = (211, 155, 42)
PREFIXES = (("k", 1e-3), ("", 1.0), ("m", 1e3), ("µ", 1e6), ("n", 1e9))


class Curve(NamedTuple):
    """A quantity over time, with the style of its graph."""

    values: np.ndarray
    """(T,)"""
    color: Color

    def at(self, n: int, share: float) -> float:
        """Return the value at a fraction ``share`` from time ``n`` to the next, see `Motion.at`."""
        return float(self.values[n] + share * (self.values[n + 1] - self.values[n]))


def scaled(unit: str, *values: np.ndarray) -> tuple[str, float]:
    """Return a unit with the prefix that suits some values, and the factor of the prefix."""
    largest = max(float(np.abs(v).max()) for v in values)
    if (unit.startswith("m") and largest >= 0.02) or 0.05 <= largest < 3000 or not largest:
        return unit, 1.0
    prefix, factor = next((p for p in PREFIXES if largest * p[1] >= 1.0), PREFIXES[-1])
    return prefix + unit, factor


def graphs(m: Measures, scene: Scene) -> dict[str, dict[str, Curve]]:
    """Return the graphs of energies and other quantities, from measures of shape (T,) and (T, 3).

    The energies of gravity and of the springs are relative to their least values.
    """
    lost = m.damping_loss + m.contact_loss + m.friction_loss
    parts = {
        "kinetic": Curve(m.kinetic, BLUE),
        "gravity": Curve(m.gravity - m.gravity.min(), GREEN),
        "springs": Curve(m.elastic - m.elastic.min(), OCHRE),
        "contact": Curve(m.contact, TEAL),
        "lost": Curve(lost - lost[0], RED),
    }
    total = np.sum([curve.values for curve in parts.values()], axis=0)
    name = "energy"
    scale = float(np.abs(total).max())
    moved = max(float(np.ptp(curve.values)) for curve in parts.values())
    if moved < 0.25 * scale:  # beside constant curves, the changes would be invisible
        name = "energy moved"
        scale = moved
        parts = {part: Curve(curve.values - curve.values[0], curve.color) for part, curve in parts.items()}
        total = total - total[0]
    shown = {part: curve for part, curve in parts.items() if np.abs(curve.values).max() > 3e-3 * scale}
    unit, factor = scaled("J", np.array([scale]))
    drawn = {
        f"{name} [{unit}]": {
            part: Curve(factor * curve.values, curve.color)
            for part, curve in (shown | {"sum": Curve(total, BLACK)}).items()
        }
    }
    drawn["height [m]"] = {"height": Curve(m.centre[:, 2], SLATE)}
    if any(len(placed.body.springs) for placed in scene.bodies):
        drawn["strain [%]"] = {"strain": Curve(100 * m.strain, RED)}
    if not turns(scene):
        return drawn
    tilt = np.degrees(np.arctan2(np.hypot(m.axis[:, 0], m.axis[:, 1]), m.axis[:, 2]))
    spin = np.einsum("ti,ti->t", m.angular_velocity, m.axis)
    return drawn | {"tilt [°]": {"tilt": Curve(tilt, ORANGE)}, "spin [rad/s]": {"spin": Curve(spin, TEAL)}}


def turns(scene: Scene) -> bool:
    """Return whether a scene has one body that holds its shape, so that tilt and spin are defined."""
    return len(scene.bodies) == 1 and not scene.body.floppy and len(scene.body.springs) > 0
