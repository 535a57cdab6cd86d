"""A scene pays for what it has, and what it has at zero strength changes no bit of the motion.

The features of `benchmarks.speed`, each absent and then present with nothing to do.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from benchmarks.speed import all_features
from springgym.model.scene import Scene
from springgym.model.surfaces import Bowl, floor
from springgym.simulator import PAPER_STEP, Simulator
from tests.params import slow_but

pytestmark = pytest.mark.own_kernels

FEATURES = all_features()
PLAIN = FEATURES["damping"].off
STANDING = FEATURES["friction"].off
FLOATING = FEATURES["plane out of reach"].off.with_(surfaces=(floor(-1e3),))
BELOW = FEATURES["plane"].off.with_(surfaces=(floor(-1e3),))
STEPS = 200

Pair = tuple[Scene, Scene, dict[str, Any], dict[str, Any]]
RUBBING: dict[str, Any] = {"varying": ("friction", "restitution")}
NOTHING = PLAIN.with_(
    gravity=(0.0, 0.0, 0.0),
    **{name: getattr(FEATURES[name].on, name) for name in ("wrench", "thrust", "drive")},
)
AT_ONCE: dict[str, Pair] = {
    "without surfaces": (
        FEATURES["gravity"].off,
        NOTHING,
        {"varying": ("masses", "stiffness", "lengths", "gravity", "damping"), "ledger": True},
        {"damping": PLAIN.body.damping},
    ),
    "a floor out of reach": (BELOW, BELOW, RUBBING, {"friction": 0.5}),
    "on a floor": (STANDING, STANDING, RUBBING, {"friction": 0.0, "restitution": 1.0}),
}
"""Many features at once, as each pair of scenes is compiled for itself."""

ABSENT_AND_IDLE: dict[str, Pair] = AT_ONCE | {
    "wrench": (*FEATURES["wrench"][:2], {}, {}),
    "thrust": (*FEATURES["thrust"][:2], {}, {}),
    "bowl": (FLOATING, FLOATING.with_(surfaces=(Bowl((0.0, 0.0, 0.0), 10.0),)), {}, {}),
    "damping on a floor": (STANDING, STANDING, {"varying": ("damping",)}, {"damping": STANDING.body.damping}),
}
"""By name: the scene without it, with it, the simulator's options, and values to set to zero."""


def moved(scene: Scene, method: str, values: dict[str, Any] | None = None, **options: Any) -> np.ndarray:
    """Positions and velocities after `STEPS` steps."""
    simulator = Simulator(
        scene, **({"ledger": False, "integrator": method, "step": PAPER_STEP / 2} | options)
    )
    if values:
        simulator.vary(np.arange(1), **{name: np.array([value]) for name, value in values.items()})
    simulator.advance(STEPS)
    return np.array([simulator.positions, simulator.velocities])


CASES = [*((name, "verlet") for name in (*AT_ONCE, "bowl")), ("without surfaces", "rk4")]
TWICE = [("wrench", "pefrl"), ("thrust", "pefrl"), ("damping on a floor", "verlet")]
"""Rounded twice in place of once: splitting methods kick in two halves about what actuators do; and what
surfaces are foreseen to give is added before dampers act, and taken back."""


@pytest.mark.parametrize(("name", "method"), slow_but(CASES, ("without surfaces", "verlet")))
def test_idle_is_absent_to_the_bit(name: str, method: str) -> None:
    off, on, options, values = ABSENT_AND_IDLE[name]
    without = moved(off, method)
    idle = moved(on, method, values, **options)
    np.testing.assert_array_equal(idle, without)
    assert np.abs(without[0] - off.positions).max() > 0.01


@pytest.mark.parametrize(("name", "method"), TWICE)
@pytest.mark.slow
def test_idle_is_absent_but_for_rounding(name: str, method: str) -> None:
    off, on, options, values = ABSENT_AND_IDLE[name]
    np.testing.assert_allclose(moved(on, method, values, **options), moved(off, method), rtol=0, atol=1e-10)


def test_bits_tell_features_apart() -> None:
    """What the test above compares differs where a feature does something."""
    off, on, options, values = AT_ONCE["without surfaces"]
    damped = {name: value + 1.0 for name, value in values.items()}
    assert not np.array_equal(moved(on, "verlet", damped, **options), moved(off, "verlet"))
