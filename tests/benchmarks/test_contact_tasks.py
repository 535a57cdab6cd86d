"""MuJoCo's rigid bodies are those of the tasks, and do what the task says."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import gymnasium as gym
import numpy as np
import pytest

from benchmarks import contact_tasks
from benchmarks.contact_tasks import TASKS, MuJoCoPlay, centre_of, compared, is_fixed, model_xml
from benchmarks.errors import batch
from benchmarks.steady import native
from benchmarks.timing import Case
from springgym.model.bodies import Body
from springgym.model.bodies.body import inertia
from springgym.model.bodies.distances import largest_distances
from springgym.model.surfaces import Contact
from tests.params import slow_but

mujoco: Any = pytest.importorskip("mujoco")
SHORT = {"copies": 2, "max_episode_steps": 1}


def task_of(env_id: str) -> Any:
    return gym.make(env_id).unwrapped.episodes.task  # type: ignore[attr-defined]


def model_of(env_id: str) -> Any:
    return mujoco.MjModel.from_xml_string(model_xml(task_of(env_id).scene))


@pytest.mark.parametrize("env_id", TASKS)
def test_masses_inertias_and_contacts_are_those_of_the_task(env_id: str) -> None:
    scene = task_of(env_id).scene
    model = model_of(env_id)
    moving = [placed for placed in scene.bodies if not is_fixed(placed)]
    assert model.nbody == 1 + len(moving)
    data = mujoco.MjData(model)
    mujoco.mj_kinematics(model, data)
    for placed in moving:
        body: Body = placed.body
        own = model.body(placed.name)
        assert own.mass[0] == pytest.approx(body.masses.sum())
        turn = data.ximat[own.id].reshape(3, 3)
        about = turn @ np.diag(own.inertia) @ turn.T
        wanted = inertia(body.positions - centre_of(body), body.masses)
        np.testing.assert_allclose(about, wanted, atol=1e-6 * np.abs(wanted).max())
    contacts = {scene.contact, scene.collisions} if scene.surfaces else {scene.collisions}
    contacts = {own for own in contacts if isinstance(own, Contact)}
    for friction, margin in zip(model.pair_friction, model.pair_margin, strict=True):
        assert any(friction[0] == friction[1] == own.friction and margin == own.reach for own in contacts)
    usual = mujoco.MjModel.from_xml_string("<mujoco/>").opt
    for name in ("timestep", "integrator", "solver", "cone", "iterations", "tolerance", "disableflags"):
        assert getattr(model.opt, name) == getattr(usual, name), name
    assert list(model.opt.gravity) == list(scene.gravity)


@pytest.mark.parametrize(("env_id", "pairs"), [*zip(TASKS, (1, 3, 9, 1, 1, 10, 1), strict=True)])
def test_all_that_may_touch_may_touch(env_id: str, pairs: int) -> None:
    model = model_of(env_id)
    assert model.npair == pairs
    assert model.ntendon == (2 if env_id == "SpringDuel-v0" else 0)


def test_a_ball_rebounds_with_the_restitution_of_the_task() -> None:
    model = model_of("SpringJuggle-v0")
    model.opt.gravity[:] = 0.0
    data = mujoco.MjData(model)
    mujoco.mj_resetData(model, data)
    ball = model.body("ball").id
    start = model.jnt_qposadr[model.body_jntadr[ball]]
    data.qpos[start : start + 3] = (0.0, 0.0, 0.3)
    speed = model.jnt_dofadr[model.body_jntadr[ball]]
    data.qvel[speed + 2] = -1.0
    mujoco.mj_step(model, data, 500)
    apart = data.qvel[speed + 2] - data.qvel[2]
    assert apart == pytest.approx(task_of("SpringJuggle-v0").scene.collisions.restitution, abs=0.03)


PERIODS = {"SpringTower-v0": 1, "SpringLabyrinth-v0": 40, "SpringDuel-v0": 12}
"""Control periods in which bodies move far enough, and no episode ends."""


def apart_and_driven(env_id: str) -> tuple[float, float]:
    """Return how far MuJoCo's particles are from springgym's, seen from above, after some control periods
    with the same actions, and how far actions have driven these, over the size of their bodies."""
    play = MuJoCoPlay(env_id, **SHORT)
    play.model.opt.timestep /= 16
    play.steps *= 16
    own, idle = (batch(env_id, 2) for _ in range(2))
    for envs in (own, idle, play.envs):
        envs.reset(seed=0)
    play.place(np.arange(2))
    at = own.unwrapped.episodes
    there = play.at.simulator
    for _ in range(PERIODS.get(env_id, 6)):
        play.act()
        *_, terminated, truncated, _ = own.step(play.actions)
        assert not (terminated | truncated).any()
        idle.step(np.zeros_like(play.actions))
        play.at.goal[:] = at.goal
        play.run()
        positions, velocities = np.array([play.particles(data) for data in play.data]).swapaxes(0, 1)
        there.place(positions, velocities, check=False, read=True)
    level = np.array([1.0, 1.0, 0.0])
    ends = at.simulator.positions
    others = (positions, idle.unwrapped.episodes.simulator.positions)
    apart, driven = (
        float(largest_distances(level * of, level * ends, play.scene.sizes).max()) for of in others
    )
    return apart, driven


@pytest.mark.parametrize("env_id", slow_but(TASKS, "SpringShove-v0", "SpringDuel-v0"))
def test_the_same_actions_move_the_same_bodies_alike(env_id: str) -> None:
    """From the start on. Twice the force, or half the mass, would make a difference as large as what actions
    do."""
    apart, driven = apart_and_driven(env_id)
    assert driven > 0.005
    assert apart < 0.3 * driven


def test_play_is_steady_and_its_errors_fall_with_the_step() -> None:
    """Euler's method is of first order."""
    play = MuJoCoPlay("SpringShove-v0", copies=8, max_episode_steps=16)
    assert play.steps * play.model.opt.timestep == pytest.approx(play.at.task.period)
    ages = play.at.time / play.at.task.period
    assert set(np.histogram(ages, bins=4, range=(0, 16))[0]) == {2}
    usual = np.median(play.errors(16))
    play.model.opt.timestep /= 2
    play.steps *= 2
    assert np.median(play.errors(16)) == pytest.approx(usual / 2, rel=0.2)
    assert 1e-4 < usual < 1e-2


def test_a_rehearsal_changes_nothing() -> None:
    play = MuJoCoPlay("SpringShove-v0", **SHORT)
    before = [play.state(data) for data in play.data]
    play.rehearse()
    np.testing.assert_array_equal([play.state(data) for data in play.data], before)
    play.run()
    assert not np.array_equal([play.state(data) for data in play.data], before)


def test_rows_are_speeds_and_their_ratios_in_a_round(monkeypatch: pytest.MonkeyPatch) -> None:
    """By the solver whose median is the fastest."""
    speeds = {
        "springgym": [40.0, 90.0, 60.0],
        "MuJoCo Newton": [10.0, 20.0, 15.0],
        "MuJoCo CG": [20.0, 30.0, 10.0],
        "springgym, single": [5.0, 15.0, 5.0],
    }
    cases = [Case({"environment": "a", "program": name, "copies": 1}, lambda: None, 1.0) for name in speeds]
    monkeypatch.setattr(contact_tasks, "cases_of", lambda *_: iter(cases))
    monkeypatch.setattr(contact_tasks, "rates", lambda *_: list(speeds.values()))
    found = {row.what["program"]: row for row in compared(("a",), 3)}
    assert set(found) == {*speeds, "springgym / MuJoCo CG", "springgym, single / MuJoCo CG"}
    assert found["springgym"][1:5] == (60.0, 40.0, 90.0, "env steps/s")
    assert found["springgym / MuJoCo CG"][1:5] == (3.0, 2.0, 6.0, "times")
    assert found["springgym, single / MuJoCo CG"][1:5] == (0.5, 0.25, 0.5, "times")


def test_solvers_that_err_more_than_the_default_do_not_count(monkeypatch: pytest.MonkeyPatch) -> None:
    errors = {"Newton": 1.0, "CG": 1.9, "PGS": 2.1}
    solvers = {getattr(mujoco.mjtSolver, f"mjSOL_{name.upper()}"): name for name in errors}

    def found(play: MuJoCoPlay, periods: int) -> np.ndarray:
        return np.array([0.1, errors[solvers[play.model.opt.solver]], 9.0])

    monkeypatch.setattr(MuJoCoPlay, "errors", found)
    cases = [*contact_tasks.cases_of("SpringShove-v0", 2, 1, max_episode_steps=2)]
    names = ["springgym", "MuJoCo Newton", "MuJoCo CG", "springgym, single"]
    assert [case.what["program"] for case in cases] == names
    assert cases[1].facts == {"step_ms": 2.0, "error": 1.0, "largest": 9.0}
    for case in cases:
        case.begin()
        case.run()


def mean_length(envs: Any, steps: int, step: Callable[[], None]) -> float:
    """Return the mean length of episodes while a batch is stepped so many times."""
    ends = []
    take = envs.step

    def counted(actions: np.ndarray) -> Any:
        result = take(actions)
        ends.append(np.count_nonzero(result[2] | result[3]))
        return result

    envs.step = counted
    for _ in range(steps):
        step()
    return len(ends) * envs.num_envs / sum(ends)


@pytest.mark.parametrize("env_id", TASKS)
@pytest.mark.slow
def test_episodes_last_as_long_in_mujoco(env_id: str) -> None:
    """Random play ends alike, in the mean. springgym's batch needs a step more, for the reset."""
    theirs = MuJoCoPlay(env_id)
    ours = native(env_id, 64)

    def step_theirs() -> None:
        theirs.run()
        theirs.begin()

    def step_ours() -> None:
        ours.begin()
        ours.run()

    found = mean_length(theirs.envs, 400, step_theirs)
    assert found == pytest.approx(mean_length(ours.envs, 200, step_ours) - 1, rel=0.25)
