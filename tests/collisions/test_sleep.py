"""Resting bodies fall asleep and wake again; calls of any length, batches and restored states agree."""

from __future__ import annotations

import copy
import pickle
import time
from dataclasses import replace
from functools import cache
from typing import Any, NamedTuple

import numpy as np
import pytest

from springgym.bodies import cube
from springgym.contact.sleep import ASLEEP, DOZE, Sleep, find_ready
from springgym.contact.totals import ENTRIES, TOUCHING
from springgym.core.blocks import at, block_array, set_copies, to_copies
from springgym.core.compiling import kernel
from springgym.scene import Placed, Scene, WrenchActuator
from springgym.simulator import Simulator
from springgym.surfaces import Contact, floor

LIMIT = 1e-3
"""[m/s] What is slower rests."""

BLOCK = cube(side=0.1, mass=0.5, stiffness=1e5, damping=3)
REACH = 0.01 * BLOCK.swept
FALLEN = 0.7
"""[m] From so high the last block of a tower falls, onto three that sleep by then."""


def block(x: float, z: float, name: str, **more: Any) -> Placed:
    start = BLOCK.positions - BLOCK.positions.mean(axis=0) + (x, 0.0, 0.05 + 0.5 * REACH + z)
    return Placed(BLOCK, start, name=name, **more)


@cache
def scene(fallen: float = FALLEN, blocks: int = 4, **more: Any) -> Scene:
    """A tower, the last block of which falls, and a block that is alone."""
    heights = [n * 0.102 + (fallen if n == blocks - 1 else 0.0) for n in range(blocks)]
    bodies = [block(0.0, z, f"block{n}") for n, z in enumerate(heights)]
    return Scene(
        bodies=(*bodies, block(1.0, 0.0, "alone")),
        surfaces=(floor(),),
        contact=Contact(friction=0.6, restitution=0.2),
        collisions="all",
        **more,
    )


def everything(simulator: Simulator) -> list[np.ndarray]:
    """Return what a simulator reports about its copies, as arrays that two simulators can be compared by."""
    return [
        simulator.positions,
        simulator.velocities,
        simulator.asleep,
        *simulator.measure(),
        *simulator.pairs(),
    ]


def same(one: Simulator, other: Simulator, n: int = 0, k: int = 0) -> bool:
    """Tell whether a copy of one is as one of the other, to the bit, and all that is told of it."""
    told = zip(everything(one), everything(other), strict=True)
    return all(a[n].tobytes() == b[k].tobytes() for a, b in told)


# --- Who is ready -------------------------------------------------------------------------------------


class Two(NamedTuple):
    """The bodies of pairs."""

    first: np.ndarray
    second: np.ndarray


class Met(NamedTuple):
    """The pairs that have contacts."""

    length: np.ndarray
    met: np.ndarray


class Known(NamedTuple):
    """As much of a problem of contacts as islands follow from."""

    pairs: Two
    contacts: Met
    totals: Any


@kernel
def ready_bodies(ready: Any, known: Any, sleep: Any) -> None:
    own = Known(known.pairs, known.contacts, at(known.totals, 0))
    find_ready(at(ready, 0), own, Sleep(at(sleep.rested, 0), sleep.limit, sleep.pinned))


CASES: list[tuple[list[float], list[tuple[int, int]], list[int]]] = [
    ([1.0, 1.0, 1.0, 1.0], [], [1, 1, 1, 1]),
    ([1.0, 0.0, 1.0, 1.0], [], [1, 0, 1, 1]),
    ([1.0, 0.0, 1.0, 1.0], [(0, 1)], [0, 0, 1, 1]),
    ([0.0, 1.0, 1.0, 1.0], [(2, 3), (1, 2), (0, 1)], [0, 0, 0, 0]),
    ([0.0, 1.0, 1.0, 1.0], [(2, 3), (0, 1)], [0, 0, 1, 1]),
    ([ASLEEP, ASLEEP, 0.9 * DOZE, 1.1 * DOZE], [(0, 1)], [1, 1, 0, 1]),
    ([1.0, 1.0, 1.0, 0.0], [(0, 1), (1, 2), (2, 3)], [0, 0, 0, 0]),
]


@pytest.mark.parametrize("pinned", [None, 1])
def test_islands_fall_asleep_together(pinned: int | None) -> None:
    """What touches, through others, a body that has not rested stays awake; what is pinned is no bridge.

    All cases are copies of one block, whose contacts have rows in all of them.
    """
    pairs = [(a, b) for a in range(4) for b in range(a + 1, 4)]
    first, second = (np.array(of) for of in zip(*pairs, strict=True))
    rested, totals = (block_array(len(CASES), (n,), float) for n in (4, len(pairs) * ENTRIES))
    ready = block_array(len(CASES), (4,), float)
    set_copies(rested, np.arange(len(CASES)), np.array([case[0] for case in CASES]))
    touching = np.zeros((len(CASES), len(pairs), ENTRIES))
    touching[:, :, TOUCHING] = [[pair in case[1] for pair in pairs] for case in CASES]
    set_copies(totals, np.arange(len(CASES)), touching.reshape(len(CASES), -1))
    known = Known(Two(first, second), Met(np.array([len(pairs), 0]), np.arange(len(pairs))), totals)
    ready_bodies(ready, known, Sleep(rested, LIMIT, np.arange(4) == (-1 if pinned is None else pinned)))
    expected = np.array([case[2] for case in CASES])
    if pinned is not None:
        expected[2] = [1, 1, 1, 1]  # 1 is pinned, and so has nothing to rest
        expected[1] = [1, 1, 1, 1]
        expected[3:5] = [0, 1, 1, 1]
        expected[6] = [1, 1, 0, 0]
    assert to_copies(ready, len(CASES)).tolist() == expected.tolist()


# --- What is refused ----------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("of", "options", "error", "says"),
    [
        ({}, {"sleep": 0.0}, ValueError, "sleep"),
        ({}, {"sleep": -1e-3}, ValueError, "sleep"),
        ({}, {"sleep": float("nan")}, ValueError, "sleep"),
        ({}, {"sleep": True}, TypeError, "sleep"),
        ({}, {"sleep": "1e-3"}, TypeError, "sleep"),
        ({}, {"sleep": (1e-3, 0.1)}, TypeError, "sleep"),
        ({}, {"sleep": LIMIT, "dynamics": "rigid"}, ValueError, "rigid bodies do not sleep"),
        ({"collisions": None}, {"sleep": LIMIT}, ValueError, "no bodies of the scene collide"),
    ],
)
def test_who_cannot_sleep(of: Any, options: Any, error: type[Exception], says: str) -> None:
    with pytest.raises(error, match=says):
        Simulator(scene().with_(**of), **options)


def test_what_is_pushed_cannot_sleep() -> None:
    """An actuator may begin to push at any time, and nothing would wake its body."""
    bodies = scene().bodies
    pushed = (replace(bodies[0], wrench=WrenchActuator()), *bodies[1:])
    with pytest.raises(ValueError, match="body 'block0' has actuators"):
        Simulator(scene().with_(bodies=pushed), sleep=LIMIT)


# --- Sleep --------------------------------------------------------------------------------------------


@pytest.mark.slow
def test_a_tower_sleeps_wakes_and_sleeps_again() -> None:
    """Three blocks and one that is alone fall asleep; a fourth falls onto the three, and wakes these."""
    simulator, awake = Simulator(scene(), sleep=LIMIT), Simulator(scene())
    asleep, balances = [], []
    for _ in range(32):
        simulator.advance(100)
        awake.advance(100)
        asleep.append(simulator.asleep[0].tolist())
        balances.append([of.measure().balance[0] for of in (simulator, awake)])
    tower = [True, True, True, False, True]
    assert tower in asleep
    woken = [False, False, False, False, True]
    assert woken in asleep[asleep.index(tower) :]
    assert asleep[-1] == [True] * 5
    assert not awake.asleep.any()
    ends = [of.positions[0].reshape(5, 8, 3).mean(axis=1) for of in (simulator, awake)]
    np.testing.assert_allclose(*ends, atol=2e-4)
    kept = np.abs(np.diff(balances, axis=1)).max()
    assert kept < 2e-3  # of 7 J, of which the impact alone misses 4e-3, with sleep or without


@pytest.mark.slow
def test_calls_of_any_length_give_the_same_bits() -> None:
    whole = Simulator(scene(), sleep=LIMIT)
    whole.advance(3000)
    cut = Simulator(scene(), sleep=LIMIT)
    for steps in (1, 2, 697, 300, 999, 1, 1000):
        cut.advance(steps)
    assert same(whole, cut)


@pytest.mark.slow
@pytest.mark.parametrize("sleep", [LIMIT, None])
def test_copies_sleep_as_if_alone(sleep: float | None) -> None:
    """Copies of a block in which a body falls from other heights sleep and wake at other times.

    Those that do not sleep are told to the bit as if they were alone, too.
    """
    copies, calls = 11, (700, 300, 1400)
    starts = np.repeat(scene().positions[None], copies, axis=0)
    starts[:, scene().slices[3], 2] += 0.02 * np.arange(copies)[:, None]
    starts[:, scene().slices[4], 2] += 0.001 * np.arange(copies)[::-1, None]
    batch = Simulator(scene(), sleep=sleep, copies=copies, unresolved="count")
    batch.place(starts, np.zeros_like(starts))
    alone = [Simulator(scene(), sleep=sleep, unresolved="count") for _ in range(copies)]
    mixed = False
    for one, start in zip(alone, starts, strict=True):
        one.place(start, np.zeros_like(start))
    for steps in calls:
        for simulator in (batch, *alone):
            simulator.advance(steps)
        mixed |= bool((batch.asleep.any(axis=0) & ~batch.asleep.all(axis=0)).any())
        assert all(same(batch, one, n) for n, one in enumerate(alone))
    assert mixed == (sleep is not None)


@pytest.mark.slow
def test_what_sleeps_is_told_with_its_contacts() -> None:
    """Contact forces on sleeping bodies balance their weights, but for the sway before they fell asleep."""
    simulator = Simulator(scene(0.0), sleep=LIMIT)
    simulator.advance(2500)
    assert simulator.asleep.all()
    found = simulator.contacts()
    carried = np.zeros((5, 3))
    for side, sign in ((found.first, 1.0), (found.second, -1.0)):
        on = found.there[0] & (side[0] >= 0)
        np.add.at(carried, side[0, on], sign * found.force[0, on])
    np.testing.assert_allclose(carried[:, 2], 0.5 * 9.81, rtol=0.02)
    assert simulator.asleep.all()


@pytest.mark.slow
def test_what_changes_a_copy_wakes_it() -> None:
    """New places and parameters wake the bodies of a copy alone; a restored state sleeps as it did."""
    simulator = Simulator(scene(0.0), sleep=LIMIT, copies=3, varying=["gravity"])
    simulator.advance(2500)
    assert simulator.asleep.all()
    state = simulator.state()
    for other in (copy.deepcopy(simulator), pickle.loads(pickle.dumps(simulator))):
        other.advance(100)
        assert other.asleep.all()
    simulator.vary([1], gravity=(0.0, 0.0, -4.0))
    assert simulator.asleep.all(axis=1).tolist() == [True, False, True]
    simulator.advance(2500)
    assert simulator.asleep.all()
    simulator.place(scene(0.0).positions, scene(0.0).velocities, [2])
    assert simulator.asleep.any(axis=1).tolist() == [True, True, False]
    simulator.restore(state)
    assert simulator.asleep.all()
    with pytest.raises(ValueError, match="sleep"):
        Simulator(scene(0.0), copies=3, varying=["gravity"]).restore(state)


@pytest.mark.slow
def test_what_sleeps_costs_next_to_nothing() -> None:
    simulator = Simulator(scene(0.0), sleep=LIMIT)
    simulator.advance(10)
    taken = []
    for _ in range(2):
        before = time.process_time()
        simulator.advance(500)
        taken.append(time.process_time() - before)
        simulator.advance(2500)
    assert simulator.asleep.all()
    assert taken[1] < taken[0] / 10
