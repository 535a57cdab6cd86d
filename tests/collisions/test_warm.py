"""Contacts of many bodies start from what the last node gave."""

from __future__ import annotations

from functools import cache
from typing import Any

import numpy as np
import pytest

from springgym.bodies import cube
from springgym.core.blocks import WIDTH
from springgym.scene import Placed, Scene
from springgym.simulator import Simulator
from springgym.surfaces import Contact, floor
from tests.copies import check_alone, check_calls, reported

BLOCK = cube(side=0.1, mass=0.5, stiffness=1e5, damping=30)
REACH = 0.01 * BLOCK.swept
GRAVITY = 9.81
COUNT = 12


@cache
def column(askew: float = 1.0) -> Scene:
    """Blocks on each other, so near that they touch; askew, each is turned, and beside the one below."""
    bodies = []
    for n in range(COUNT):
        angle = askew * 0.1 * (n % 3)
        turned = np.array([[np.cos(angle), -np.sin(angle), 0], [np.sin(angle), np.cos(angle), 0], [0, 0, 1]])
        start = (BLOCK.positions - BLOCK.positions.mean(axis=0)) @ turned.T
        height = 0.05 + 0.5 * REACH + n * (0.1 + 0.5 * REACH)
        aside = (askew * 0.003 * (n % 2), askew * 0.002 * (n % 3), height)
        bodies.append(Placed(BLOCK, start + aside, name=f"block{n}"))
    contact = Contact(friction=0.6, restitution=0.2)
    return Scene(bodies=tuple(bodies), surfaces=(floor(),), contact=contact, collisions="all")


def falling(copies: int) -> tuple[np.ndarray, np.ndarray]:
    """Return positions and velocities (copies, N, 3) of columns each of which falls at a speed of its own."""
    speeds = 0.02 * np.arange(copies)[:, None, None] * np.array([0.3, 0.1, -1.0])
    x = np.tile(column().positions, (copies, 1, 1))
    return x, speeds + 0.0 * x


def start(copies: int) -> Simulator:
    """Return a simulator of columns that fall."""
    simulator = Simulator(column(), copies=copies)
    simulator.place(*falling(copies))
    return simulator


def pair_of(first: np.ndarray, second: np.ndarray) -> np.ndarray:
    """Return the pair of each two of `COUNT` blocks that all meet."""
    return np.asarray(first * COUNT - first * (first + 1) // 2 + second - first - 1)


def pushes_and_law(simulator: Simulator) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return the pair of each contact of two blocks, its force and what the law says of its gap [N]."""
    found, meetings = simulator.contacts(), simulator.scene.meetings
    between = found.there[0] & (found.second[0] >= 0)
    pair = pair_of(found.first[0][between], found.second[0][between])
    push = (found.force * found.normal).sum(axis=-1)[0][between]
    c, reach, gap = meetings.strength[pair], meetings.reach[pair], found.gap[0][between]
    return pair, push, c / gap**2 - c / reach**2


def held(simulator: Simulator) -> np.ndarray:
    """Return the force with which each block holds the one above, over the weight above."""
    found, (pair, _, _) = simulator.contacts(), pushes_and_law(simulator)
    between = found.there[0] & (found.second[0] >= 0)
    one, above = np.arange(COUNT - 1), np.arange(1, COUNT)
    forces = np.bincount(pair, -found.force[0, between, 2])[pair_of(one, above)]
    return np.array(forces / ((COUNT - above) * BLOCK.mass * GRAVITY))


RIGID: dict[str, Any] = {"dynamics": "rigid", "step": 1e-3}


@pytest.mark.parametrize(
    ("options", "seconds", "off"),
    [
        pytest.param({}, 1.5, 2e-6, id="springs"),
        pytest.param(RIGID, 2.0, 2e-5, id="rigid", marks=pytest.mark.slow),
    ],
)
def test_what_rests_is_held_as_the_law_says(options: dict[str, Any], seconds: float, off: float) -> None:
    """Two sweeps from nothing miss the law by four fifths of the largest force, eight sweeps by a half.

    Turns of rigid bodies from nothing that agree to 1e-9 Δ leave a hundredth of the largest force open.
    """
    simulator = Simulator(column(0.0), **options)
    simulator.advance(round(seconds / simulator.step))
    _, push, law = pushes_and_law(simulator)
    assert np.abs(push - law).max() < 1e-3 * push.max()
    np.testing.assert_allclose(held(simulator), 1.0, atol=off)


def test_calls_of_any_length_are_one() -> None:
    check_calls(start(1), (1, 60, 9, 0, 130))


@pytest.mark.slow
@pytest.mark.parametrize("options", [{}, RIGID], ids=["springs", "rigid"])
def test_copies_of_a_batch_are_single_ones_to_the_bit(options: dict[str, Any]) -> None:
    copies = WIDTH[np.dtype(float)] + 3
    x, v = falling(copies)
    chosen = (0, 4, copies - 1)
    batch = check_alone(lambda count: Simulator(column(), copies=count, **options), x, v, [250], chosen)
    assert not np.any(batch.unresolved)


@pytest.mark.slow
def test_states_hold_what_contacts_start_from() -> None:
    one, other = start(3), start(2)
    one.advance(200)
    other.advance(77)
    other.restore(one.state(copies=[2]), copies=[1])
    one.advance(100)
    other.advance(100)
    assert reported(one, 2) == reported(other, 1)


@pytest.mark.slow
def test_copies_that_are_placed_start_from_nothing() -> None:
    fresh, placed = start(2), start(2)
    x, v = falling(1)
    placed.advance(150)
    placed.place(x, v, copies=[0])
    fresh.advance(100)
    placed.advance(100)
    assert reported(fresh, 0) == reported(placed, 0)
