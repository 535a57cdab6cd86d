"""Dampers and the wrench that act once in several steps."""

from __future__ import annotations

import math
from functools import partial
from typing import Any

import gymnasium as gym
import numpy as np
import pytest

from springgym.dynamics import stability
from springgym.dynamics.methods import integrator
from springgym.model.bodies import cube, rope, start, top
from springgym.model.scene import DriveActuator, Placed, Scene, ThrustActuator, WrenchActuator
from springgym.model.surfaces import Contact, floor
from springgym.simulator import Simulator
from tests.copies import check_calls
from tests.integrators.problems import error, oscillator, reference, simulator, tetrahedron
from tests.params import slow_but

EVERY = 6
STEP = 2e-3
FAR, NEAR = -9.0, -0.03
"""Heights of a floor [m] that is never touched, and of one that is."""
VERLET = integrator("verlet")


def scene_of(height: float | None) -> Scene:
    """A soft body that falls about its pin; with a floor at a ``height``, if that is given."""
    scene = tetrahedron("verlet", 1.0)
    if height is None:
        return scene
    return scene.with_(surfaces=(floor(height),), contact=Contact(friction=0.4, restitution=0.5))


def spun(every: int = EVERY, height: float | None = None, **options: Any) -> Simulator:
    """Make the simulator of a soft body that falls about its pin, and is turned."""
    made = simulator(scene_of(height), "verlet", STEP, damping_every=every, **options)
    made.actuate(torque=[3.0, -2.0, 4.0], body_torque=[0.5, 1.0, -0.5])
    return made


def seen(made: Simulator) -> list[np.ndarray]:
    """All that is read of a copy, first among several."""
    measures = made.measure()
    return [
        made.positions[0],
        made.velocities[0],
        *(entry[0] for entry in (measures.work, measures.damping_loss, measures.energy)),
    ]


def assert_same(one: list[np.ndarray], other: list[np.ndarray]) -> None:
    for mine, its in zip(one, other, strict=True):
        np.testing.assert_array_equal(mine, its)


@pytest.mark.parametrize(
    ("every", "height"), slow_but([(2, None), (EVERY, None), (EVERY, NEAR)], (2, None), (EVERY, None))
)
def test_calls_cut_at_cycles_give_the_same_bits(every: int, height: float | None) -> None:
    made = spun(every, height, copies=1)
    check_calls(made, [every * cycles for cycles in (1, 1, 3, 0, 5)], 7 * every)
    assert abs(seen(made)[2]) > 0.01  # work
    assert seen(made)[3] > 1e-4  # and losses


@pytest.mark.parametrize("steps", [1, EVERY - 1, EVERY + 1, 3 * EVERY // 2])
def test_calls_that_end_amid_a_cycle_are_refused(steps: int) -> None:
    made = spun()
    before = seen(made)
    with pytest.raises(ValueError, match=f"steps is {steps}; it must be a multiple of damping_every, 6"):
        made.advance(steps)
    assert_same(seen(made), before)
    made.advance(2 * EVERY)


LEFT = cube(stiffness=2e3, damping=20.0)
RIGHT = cube(stiffness=5e3, damping=10.0)
CUBES = Scene(
    bodies=(
        Placed(
            LEFT, LEFT.positions, np.cross((0, 0, 3.0), LEFT.positions), wrench=WrenchActuator(), name="left"
        ),
        Placed(RIGHT, np.add(RIGHT.positions, (1.3, 0.2, 0.1)), np.full((8, 3), (-3.0, 0, 0)), name="right"),
    ),
    gravity=None,
    collisions=Contact(friction=0.4, restitution=0.5),
)
"""A soft cube that turns, and another that flies against it."""


def struck(copies: int = 1, every: int = EVERY, finer: int = 1) -> Simulator:
    made = Simulator(CUBES, step=5e-4 / finer, copies=copies, damping_every=every)
    made.actuate(**{"left.torque": np.tile([3.0, -2.0, 4.0], (copies, 1))})
    return made


def assert_struck(made: Simulator, copy: int = 0) -> None:
    """Bodies have met, and both contact and dampers have taken energy."""
    told = made.pairs()
    measures = made.measure()
    assert told.impulse[copy, 0] > 0.5
    assert told.contact_loss[copy, 0] > 1e-2
    assert measures.damping_loss[copy] > 1e-2


@pytest.mark.own_kernels
@pytest.mark.parametrize(
    ("make", "cycles"),
    [
        pytest.param(spun, 4, id="free"),
        pytest.param(partial(spun, height=NEAR), 4, id="floor", marks=pytest.mark.slow),
        pytest.param(struck, 66, id="bodies", marks=pytest.mark.slow),
    ],
)
def test_copies_in_first_and_second_cycles_are_as_alone(make: Any, cycles: int) -> None:
    batch = make(copies=11)
    begun = batch.positions[0], batch.velocities[0]
    ages = {0: 0}
    for copy, before in ((2, 3), (7, 1), (9, 2), (4, 1)):
        steps = before * EVERY
        batch.advance(steps)
        batch.place(*begun, copies=[copy])
        ages = {other: age + steps for other, age in ages.items()} | {copy: 0}
    batch.advance(cycles * EVERY)
    for copy, age in ages.items():
        alone = make(copies=1)
        alone.advance(age + cycles * EVERY)
        assert (alone.measure().contact_loss[0] > 1e-4) == alone.scene.can_touch
        assert_same([values[copy] for values in (batch.positions, batch.velocities)], seen(alone)[:2])
        assert batch.measure().balance[copy] == alone.measure().balance[0]


@pytest.mark.slow
def test_colliding_bodies_give_the_same_bits_in_calls_cut_at_cycles() -> None:
    made = struck()
    check_calls(made, [EVERY * cycles for cycles in (3, 19, 1, 0, 43)], 3 * EVERY)
    assert_struck(made)


@pytest.mark.slow
def test_ledger_of_colliding_bodies_closes() -> None:
    gaps = []
    for finer in (1, 4):
        made = struck(finer=finer)
        before = made.measure().balance[0]
        made.advance(396 * finer)
        gaps.append(abs(made.measure().balance[0] - before))
        assert_struck(made)
    assert gaps[0] < 1e-4
    assert gaps[1] < gaps[0] / 10


@pytest.mark.slow
def test_colliding_bodies_move_as_with_dampers_in_every_step() -> None:
    """In cycles of two steps the error is no more than doubled; in longer ones it falls with the step."""
    ends = {}
    for every, finer in ((1, 1), (2, 1), (EVERY, 1), (EVERY, 8), (1, 64)):
        made = struck(every=every, finer=finer)
        made.advance(396 * finer)
        ends[every, finer] = made.positions[0]
    exact = ends.pop((1, 64))
    errors = {how: np.abs(end - exact).max() for how, end in ends.items()}
    assert errors[2, 1] < 2 * errors[1, 1] < 1e-2
    assert errors[EVERY, 8] < errors[EVERY, 1] / 5


def test_a_state_of_other_cycles_is_refused() -> None:
    with pytest.raises(ValueError, match="damping_every"):
        spun(2).restore(spun().state())


@pytest.mark.parametrize("height", slow_but([None, FAR], None))
def test_order_stays_two(height: float | None) -> None:
    counts = 240 * np.array([1, 2, 4])
    duration = 0.6
    errors = []
    for count in counts.tolist():
        made = simulator(scene_of(height), "verlet", duration / count, damping_every=EVERY)
        made.advance(count)
        errors.append(error(made, reference(1.0, duration)))
    assert errors[0] < 0.05
    assert -np.polyfit(np.log(counts), np.log(errors), 1)[0] == pytest.approx(2, abs=0.15)


@pytest.mark.parametrize("height", slow_but([None, FAR], None))
def test_ledger_closes(height: float | None) -> None:
    counts = 240 * np.array([1, 2, 4])
    gaps = []
    for count in counts.tolist():
        made = simulator(scene_of(height), "verlet", 0.6 / count, damping_every=EVERY)
        made.actuate(torque=[[1.0, 4.0, 3.0]])
        before = made.measure()
        made.advance(count)
        after = made.measure()
        gaps.append(abs(after.balance[0] - before.balance[0]))
        assert abs(after.work[0]) > 1.0
        assert after.damping_loss[0] > 0.5
    assert -np.polyfit(np.log(counts), np.log(gaps), 1)[0] > 1.85


def test_strong_dampers_add_no_energy() -> None:
    """Linear springs at 0.99 of the limit, dampers that stop all in one of the longest cycles."""
    body = cube(stiffness=1e4, damping=1e3)
    scene = Scene(body, body.positions * [1.02, 1.0, 0.98], gravity=None)
    made = simulator(
        scene, "verlet", 0.99 * stability.largest_step(scene, VERLET), damping_every=stability.LONGEST_CYCLE
    )
    energies = []
    for _ in range(200):
        made.advance(2 * stability.LONGEST_CYCLE, check=False)
        energies.append(made.shadow_energy()[0])
    assert max(energies) <= 1.001 * energies[0]
    assert energies[-1] < 0.5 * energies[0]


# --- How long a cycle is ------------------------------------------------------------------------------


def tops(damping: float) -> Scene:
    body = top(damping=damping)
    tip = body.parts["tip"]
    return Scene(
        body, *start(body, spin=50.0, pinned=tip), pinned=tip, wrench=WrenchActuator(perpendicular=True)
    )


@pytest.mark.parametrize(("damping", "most"), [(1.0, 10), (100.0, 10), (500.0, 4), (1e4, 1)])
def test_the_stronger_the_dampers_the_shorter_the_cycle(damping: float, most: int) -> None:
    steps, every = stability.cycles_in(stability.vibrations(tops(damping)), 0.02, 40, exactly=False)
    assert every <= most
    assert every == 1 or every**2 * damping / 1e6 * stability.FINE_TURN <= 0.02 / steps


@pytest.mark.parametrize(("turn", "rings"), [(0.5, True), (0.46, False)])
def test_no_vibration_lasts(turn: float, rings: bool) -> None:
    """Dampers do nothing where a vibration has no speed when they act: at each quarter, to and fro."""
    stiffness = 200.0
    damping = 0.5
    frequency = math.sqrt(2 * stiffness)
    step = 2 * math.sin(turn * math.pi / 2) / frequency  # a step is this share of a half of its period
    scene = oscillator("verlet", stiffness, damping, stretch=0.0, speed=0.01)
    of = stability.vibrations(scene)
    np.testing.assert_allclose([of.frequency, of.rate], [[frequency], [damping]], rtol=1e-12)
    assert stability.cycles_harmless(of._replace(slowness=0.0), step, EVERY) is not rings
    made = simulator(scene, "verlet", step, damping_every=EVERY)
    began = made.shadow_energy()[0]
    made.advance(20 * EVERY)
    left = made.shadow_energy()[0] / began
    exact = math.exp(-2 * damping * 20 * EVERY * step)
    assert left == pytest.approx(1.0 if rings else exact, rel=0.3)
    assert exact < 1e-3


REASONS = {
    "dampers act on the motion of a floppy body": (Scene(rope(), pinned=(0,)), {}),
    "the scene has no dampers": (tops(0.0), {}),
    "thrust: forces on single particles": (Scene(cube(), thrust=ThrustActuator((0,))), {}),
    "drive: forces on single particles": (Scene(cube(), pinned=(0,), drive=DriveActuator(0, 1.0)), {}),
    "rk4 cannot run dampers in cycles": (tops(100.0), {"integrator": "rk4"}),
    "rigid bodies have no dampers": (tops(100.0), {"dynamics": "rigid"}),
}


@pytest.mark.parametrize("reason", REASONS)
def test_where_all_acts_at_every_step(reason: str) -> None:
    scene, options = REASONS[reason]
    assert Simulator(scene, damping_every=1, **options).damping_every == 1
    with pytest.raises(ValueError, match=f"damping_every is 2; it must be 1: {reason.rpartition(': ')[2]}"):
        Simulator(scene, damping_every=2, **options)


@pytest.mark.parametrize(
    "scene",
    [tops(100.0), tops(100.0).with_(surfaces=(floor(-0.5),)), pytest.param(CUBES, marks=pytest.mark.slow)],
    ids=["free", "floor", "bodies"],
)
def test_cycles_are_asked_for(scene: Scene) -> None:
    assert Simulator(scene).damping_every == 1
    made = Simulator(scene, damping_every=4)
    assert made.damping_every == 4
    assert "damping every 4" in repr(made)


@pytest.mark.own_kernels  # of whose arrays it reads one
@pytest.mark.parametrize("name", stability.VARIED)
def test_what_varies_decays_for_a_cycle(name: str) -> None:
    made = Simulator(tops(100.0), varying=[name, "damping"], damping_every=4)
    made.vary([0], damping=np.full(37, 50.0))
    weaker = Simulator(tops(50.0), step=made.step, damping_every=4)
    wanted = weaker._terms.dampers.whole.loss
    np.testing.assert_allclose(numbers_of(made._terms.dampers.whole.loss), wanted, rtol=1e-14)


def numbers_of(array: np.ndarray) -> np.ndarray:
    return array["lanes"][0, :, 0]


@pytest.mark.parametrize("every", [3, 0, -2, 12, True, 2.0, "4", math.nan, [2], np.array([2])])
def test_wrong_cycles_are_refused(every: Any) -> None:
    with pytest.raises((TypeError, ValueError), match="damping_every"):
        Simulator(tops(100.0), damping_every=every)


# --- Environments -------------------------------------------------------------------------------------


def episodes(env_id: str = "SpringTop-v0", **options: Any) -> Any:
    return gym.make(env_id, **options).unwrapped.episodes


@pytest.mark.parametrize("env_id", ["SpringTop-v0", "SpringGyroscope-v0", "SpringPendulum-v0"])
def test_a_control_period_is_of_whole_cycles(env_id: str) -> None:
    at = episodes(env_id)
    every = at.simulator.damping_every
    step = at.simulator.step
    assert every > 1
    assert at.steps % every == 0
    assert at.steps * step == pytest.approx(at.task.period)
    assert stability.cycles_harmless(stability.vibrations(at.task.scene), step, every)
    watched = episodes(env_id, error=True)
    assert watched.error.finer.damping_every == every


@pytest.mark.own_kernels
@pytest.mark.slow
def test_a_task_among_surfaces_says_its_cycle() -> None:
    at = episodes("SpringFreeTop-v0")
    assert (at.simulator.damping_every, at.steps % 4) == (at.task.damping_every, 0)
    assert episodes("SpringFreeTop-v0", step=0.02 / 45).simulator.damping_every == 1
    assert episodes("SpringFreeTop-v0", damping_every=1).simulator.damping_every == 1
    assert episodes("SpringFreeTop-v0", damping_every=4).steps % 4 == 0
    assert episodes("SpringTumble-v0").simulator.damping_every == 1


@pytest.mark.own_kernels
@pytest.mark.slow
def test_a_task_of_colliding_bodies_says_its_cycle() -> None:
    at = episodes("SpringDuel-v0")
    assert (at.simulator.damping_every, at.steps % 4) == (at.task.damping_every, 0) == (2, 0)
    assert episodes("SpringDuel-v0", damping_every=1).simulator.damping_every == 1
    assert episodes("SpringTower-v0").simulator.damping_every == 1


def test_a_given_pace_is_kept() -> None:
    assert episodes(step=0.02 / 50).simulator.damping_every in (1, 2, 10)
    assert episodes(damping_every=1).simulator.damping_every == 1
    assert episodes(damping_every=6).steps == 42
    drawn = episodes(randomize={"masses": (0.9, 1.1)})
    of = stability.varied(stability.vibrations(drawn.task.scene), {"masses": (0.9, 1.1)})
    assert of.frequency.min() < 0.96 * stability.vibrations(drawn.task.scene).frequency.min()
    assert stability.cycles_harmless(of, drawn.simulator.step, drawn.simulator.damping_every)
    assert episodes(randomize={"gravity": (0.9, 1.1)}).simulator.damping_every > 1
    assert episodes(dynamics="rigid").simulator.damping_every == 1
    with pytest.raises(ValueError, match="it must divide the 40 steps"):
        episodes(step=5e-4, damping_every=6)
    for every in (0, 3, True, "4"):
        with pytest.raises((TypeError, ValueError), match="damping_every"):
            episodes(damping_every=every)
