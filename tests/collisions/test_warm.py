"""Contacts of many bodies start from what the last node gave."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from springgym.bodies import cube
from springgym.scene import Placed, Scene
from springgym.simulator import Simulator
from springgym.surfaces import Contact, floor

BLOCK = cube(side=0.1, mass=0.5, stiffness=1e5, damping=30)
REACH = 0.01 * BLOCK.swept
GRAVITY = 9.81
COUNT = 12


def column(count: int = COUNT) -> Scene:
    """Blocks on each other, so near that they touch."""
    heights = 0.05 + 0.5 * REACH + (0.1 + 0.5 * REACH) * np.arange(count)
    middle = BLOCK.positions - BLOCK.positions.mean(axis=0)
    bodies = tuple(
        Placed(BLOCK, np.add(middle, (0, 0, height)), name=f"block{n}") for n, height in enumerate(heights)
    )
    contact = Contact(friction=0.6, restitution=0.2)
    return Scene(bodies=bodies, surfaces=(floor(),), contact=contact, collisions="all")


def pair_of(first: np.ndarray, second: np.ndarray, count: int) -> np.ndarray:
    """Return the pair of each two of some blocks that all meet."""
    return np.asarray(first * count - first * (first + 1) // 2 + second - first - 1)


def pushes_and_law(simulator: Simulator) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return the pair of each contact of two blocks, its force and what the law says of its gap [N]."""
    found, meetings = simulator.contacts(), simulator.scene.meetings
    between = found.there[0] & (found.second[0] >= 0)
    pair = pair_of(found.first[0][between], found.second[0][between], len(simulator.scene.bodies))
    push = (found.force * found.normal).sum(axis=-1)[0][between]
    c, reach, gap = meetings.strength[pair], meetings.reach[pair], found.gap[0][between]
    return pair, push, c / gap**2 - c / reach**2


def held(simulator: Simulator) -> np.ndarray:
    """Return the force with which each block holds the one above, over the weight above."""
    found, (pair, _, _) = simulator.contacts(), pushes_and_law(simulator)
    between = found.there[0] & (found.second[0] >= 0)
    count = len(simulator.scene.bodies)
    one, above = np.arange(count - 1), np.arange(1, count)
    forces = np.bincount(pair, -found.force[0, between, 2])[pair_of(one, above, count)]
    return np.array(forces / ((count - above) * BLOCK.mass * GRAVITY))


RIGID: dict[str, Any] = {"dynamics": "rigid", "step": 1e-3}


@pytest.mark.parametrize(
    ("options", "count", "seconds"),
    [
        pytest.param({}, COUNT, 1.5, id="springs"),
        pytest.param(RIGID, 3, 1.0, id="rigid", marks=pytest.mark.slow),
    ],
)
def test_what_rests_is_held_as_the_law_says(options: dict[str, Any], count: int, seconds: float) -> None:
    """Two sweeps from nothing miss the law by four fifths of the largest force, eight sweeps by a half.

    Rigid bodies tremble, and what they hold is off by a thousandth, where rounding moves their arms.
    """
    simulator = Simulator(column(count), **options)
    simulator.advance(round(seconds / simulator.step))
    _, push, law = pushes_and_law(simulator)
    assert np.abs(push - law).max() < 1e-3 * push.max()
    np.testing.assert_allclose(held(simulator), 1.0, atol=2e-6)
    assert np.abs(simulator.velocities).max() < 5e-6
