"""`error=True`: what it reports is the error of the control period, and nothing else changes."""

from __future__ import annotations

import copy
from typing import Any

import gymnasium as gym
import numpy as np
import pytest

import springgym
from springgym.model.bodies import cube
from springgym.model.bodies.distances import largest_distance, largest_distances
from springgym.model.scene import Scene
from springgym.simulator import Simulator
from tests.envs.cases import make_vec
from tests.envs.test_contract import answered, compare_with_sync
from tests.params import slow_but

RANDOM = {name: reach for name, reach in answered("SpringTop-v0").items() if name != "actuator"}
"""What other tests compile, too."""


def batch(copies: int = 3, **options: Any) -> Any:
    return make_vec("SpringTop-v0", copies, "native", **{"autoreset": "NextStep"} | options)


def actions(*shape: int) -> np.ndarray:
    return np.random.default_rng(0).uniform(-1, 1, shape).astype(np.float32)


def plainly(info: dict[str, Any]) -> dict[str, Any]:
    return {name: value for name, value in info.items() if not name.endswith("step_error")}


RIGID = {"dynamics": "rigid"}


@pytest.mark.parametrize(
    "options", slow_but([{}, RIGID, {"randomize": RANDOM}, {"dtype": "float32"}], {}, RIGID)
)
def test_nothing_else_changes(options: dict[str, Any]) -> None:
    plain = batch(**options)
    watched = batch(error=True, **options)
    (before, _), (seen, its) = (envs.reset(seed=1) for envs in (plain, watched))
    np.testing.assert_array_equal(seen, before)
    assert (its["step_error"] == 0).all()
    assert its["_step_error"].all()
    for action in actions(5, 3, 3):
        old = plain.step(action)
        new = watched.step(action)
        for mine, other in zip(new[:4], old[:4], strict=True):
            np.testing.assert_array_equal(mine, other)
        np.testing.assert_equal(plainly(new[4]), old[4])
        assert (new[4]["step_error"] > 0).all()
        assert new[4]["step_error"].shape == (3,)
    assert plain.unwrapped.episodes.error is None


@pytest.mark.parametrize(
    ("randomize", "every", "off"),
    slow_but([(None, None, 0.03), (RANDOM, None, 0.03), (RANDOM, 1, 0.005)], (None, None, 0.03)),
)
def test_it_is_the_distance_from_finer_steps(
    randomize: dict[str, Any] | None, every: int | None, off: float
) -> None:
    """From a reference with h/16, given the same state, actions and parameters: 1/256 of the error off.

    Where dampers act once in a cycle, fast vibrations turn far in one, and terms beyond the leading one show.
    """
    envs = batch(error=True, randomize=randomize, damping_every=every)
    episodes = envs.unwrapped.episodes
    simulator = episodes.simulator
    task = episodes.task
    varying = {"masses", "stiffness", "damping", "lengths", "gravity"} if randomize else ()
    exact = Simulator(task.scene, copies=3, step=simulator.step / 16, damping_every=1, varying=varying)
    assert (simulator.damping_every > 1) == (every is None)
    envs.reset(seed=2)
    body = task.scene.body
    for n, factors in enumerate(episodes.factors if randomize else ()):
        by = dict(zip(RANDOM, factors, strict=True))
        exact.vary(
            [n],
            masses=by["masses"] * body.masses,
            stiffness=by["stiffness"] * body.stiffness,
            damping=by["damping"] * body.damping,
            lengths=by["scale"] * body.lengths,
            gravity=by["gravity"] * np.array(task.scene.gravity),
        )
    for action in actions(4, 3, 3):
        exact.place(simulator.positions, simulator.velocities)
        *_, info = envs.step(action)
        exact.actuate(**task.actuate(np.clip(action.astype(float), -1, 1)))
        exact.advance(16 * episodes.steps)
        for n in range(3):
            true = largest_distance(simulator.positions[n], exact.positions[n], body.size)
            assert info["step_error"][n] == pytest.approx(true, rel=off)
            assert 1e-7 < true < 1e-3


def test_copies_report_what_single_environments_do() -> None:
    assert compare_with_sync("SpringTop-v0", "SameStep", 30, 3, error=True) > 0


def test_states_and_copies_of_an_environment() -> None:
    """A state of an environment that does not estimate is one of one that does."""
    first, second = (gym.make("SpringTop-v0", error=error, randomize=RANDOM) for error in (False, True))
    first.reset(seed=3)
    second.reset(seed=4)
    for action in actions(3, 3):
        first.step(action)
        second.step(action)
    third = copy.deepcopy(second)
    for env in (second, third):
        springgym.set_state(env, springgym.get_state(first))
    action = actions(3)
    *_, plain = first.step(action)
    *_, own = second.step(action)
    *_, copied = third.step(action)
    assert plainly(own) == plain
    assert own == copied
    assert 0 < own["step_error"] < 1e-3


@pytest.mark.parametrize("mode", ["NextStep", "SameStep"])
def test_a_new_episode_has_no_error_yet(mode: str) -> None:
    envs = batch(error=True, autoreset=mode, max_episode_steps=2)
    envs.reset(seed=0)
    *_, info = envs.step(actions(3, 3))
    assert (info["step_error"] > 0).all()
    for _ in range(1 if mode == "SameStep" else 2):
        *_, info = envs.step(actions(3, 3))
    assert (info["step_error"] == 0).all()
    if mode == "SameStep":
        assert (info["final_info"]["step_error"] > 0).all()


def test_of_a_scene_of_ones_own() -> None:
    env = springgym.make_scene_env(
        Scene(cube(), velocities=np.cross((3.0, 0.0, 0.0), cube().positions - cube().centre)),
        reward=lambda m, s: m.energy,
        actuators={"force": 20.0},
        error=True,
    )
    env.reset(seed=0)
    *_, info = env.step(env.action_space.sample())
    assert 0 < info["step_error"] < 1e-3
    assert type(info["step_error"]) is float


def test_distances_of_copies() -> None:
    """Those of `largest_distance`, copy by copy; infinite of a copy that is nowhere."""
    body = cube()
    x = body.positions + np.random.default_rng(0).normal(size=(3, len(body.masses), 3))
    x[2, 0, 0] = np.nan
    found = largest_distances(x, body.positions[None], np.full(len(body.masses), body.size))
    assert found[:2] == pytest.approx([largest_distance(own, body.positions, body.size) for own in x[:2]])
    assert found[2] == np.inf


def test_a_method_that_chooses_its_steps_is_refused() -> None:
    with pytest.raises(ValueError, match="integrator is 'dopri5', which chooses its own steps; error"):
        gym.make("SpringTop-v0", error=True, integrator="dopri5")


def test_only_a_simulator_of_the_same_scene_is_taken_over() -> None:
    one = Simulator(Scene(cube()))
    other = Simulator(Scene(cube()), copies=2)
    with pytest.raises(ValueError, match="made like this simulator but for its step"):
        one.take_over(other)
    with pytest.raises(TypeError, match="other is 3"):
        one.take_over(3)  # type: ignore[arg-type]
