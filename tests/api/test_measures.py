"""Measures of bodies for which something is undefined: it is zero, never rounding divided by rounding."""

from __future__ import annotations

import numpy as np
import pytest

from springgym.dynamics.measures import FIELDS, Measures
from springgym.model.bodies import Body, ball, rigid_velocities, rope, rotation
from springgym.model.scene import Placed, Scene
from springgym.scenes import film
from springgym.simulator import Simulator

ALONE = ball(0.03, 0.17)
PAIR = Body("pair", [(0, 0, 0), (0.4, 0, 0)], [1.0, 2.0], [(0, 1)], 1e4, 1.0)
STRAIGHT = rope(4, 1.5, 0.1, 0.2, 1e4, 1.0)
PLACES = [(0, 0, 0), (0.1, 0.3, 0), (0.1, 0.8, 0.2), (0.5, 1.0, 0.1)]
BENT = STRAIGHT.with_(positions=PLACES, lengths=None, markers=(0, 1, 3))

UNDEFINED = {
    "alone": (ALONE, {"angular_velocity", "side", "axis", "strain", "elastic"}),
    "pair": (PAIR, {"along", "side"}),
    "straight": (STRAIGHT, {"along", "side"}),
    "bent": (BENT, set()),
}
"""Bodies, and their measures that are undefined; "along" is ω along the line of the particles."""

SPIN = np.array([3.0, -2.0, 5.0])
"""Angular velocity [rad/s], of which a part is about any line."""


def moving(body: Body, seed: int) -> Placed:
    """Return a body at a place with negative coordinates, turned at random, that turns and moves."""
    rng = np.random.default_rng(seed)
    x = body.positions @ rotation(rng.normal(size=3), 1.0).T - rng.uniform(0.3, 9.0, 3)
    return Placed(body, x, rigid_velocities(x, SPIN, [-1.3, 2.1, 0.4]), name=f"n{seed}")


def check(m: Measures, x: np.ndarray, undefined: set[str], rounding: float) -> None:
    """Check that measures (1, …) of a body at ``x`` (N, 3) are zero if undefined, and else are not."""
    assert all(np.isfinite(values).all() for values in m)
    assert not np.signbit(m.strain).any()
    for name in ("angular_velocity", "side", "axis", "strain", "elastic"):
        value = getattr(m, name)[0]
        if name in undefined:
            assert not np.any(value), name
        elif FIELDS[name] == 3:
            assert np.linalg.norm(value) > 0.5, name
    if "angular_velocity" not in undefined:
        expected = SPIN
        if "along" in undefined:
            line = (x[1] - x[0]) / np.linalg.norm(x[1] - x[0])
            expected = SPIN - SPIN @ line * line
        np.testing.assert_allclose(m.angular_velocity[0], expected, atol=rounding)


@pytest.mark.parametrize("dtype", [np.float64, np.float32], ids=["64", "32"])
@pytest.mark.parametrize("name", UNDEFINED)
def test_what_is_undefined_of_a_body_is_zero(name: str, dtype: type) -> None:
    body, undefined = UNDEFINED[name]
    rounding = 1e-9 if dtype is np.float64 else 1e-2
    for seed in range(4):
        placed = moving(body, seed)
        simulator = Simulator(Scene(bodies=(placed,), gravity=None), dtype=dtype, step=1e-4)
        check(simulator.measure(), placed.positions, undefined, rounding)
    simulator.advance(20)
    spins = simulator.measure().angular_velocity
    assert np.linalg.norm(spins) < 1.1 * np.linalg.norm(SPIN)


def test_what_is_undefined_of_one_of_several_bodies_is_zero() -> None:
    """And of all together: ω along the line of two particles. Films take their speed from that."""
    placed = [moving(body, seed) for seed, (body, _) in enumerate(UNDEFINED.values())]
    several = Scene(bodies=tuple(placed), gravity=None, collisions=None)
    simulator = Simulator(several, step=1e-4)
    for one, (_, undefined) in zip(placed, UNDEFINED.values(), strict=True):
        check(simulator.measure(one.name), one.positions, undefined, 1e-9)
    two = Scene(bodies=(moving(ALONE, 0), moving(ALONE, 1)), gravity=None, collisions=None)
    simulator = Simulator(two, step=1e-4)
    apart = np.diff(simulator.positions[0], axis=0)[0]
    assert abs(simulator.measure().angular_velocity[0] @ apart) < 1e-9 * np.linalg.norm(apart)
    assert film.turning(two, [simulator.measure(n) for n in (0, 1)]) == 0.0
