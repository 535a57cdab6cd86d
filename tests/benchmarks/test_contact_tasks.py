"""MuJoCo's rigid bodies are those of the tasks, and do what the task says."""

from __future__ import annotations

import math
from typing import Any

import gymnasium as gym
import numpy as np
import pytest

from benchmarks import contact_tasks
from benchmarks.contact_tasks import TASKS, MuJoCoPlay, centre_of, compared, is_fixed, model_xml
from benchmarks.steady import NATIVE
from springgym.bodies import Body
from springgym.bodies.body import inertia
from springgym.bodies.distances import largest_distances
from springgym.surfaces import Contact
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


@pytest.mark.parametrize(
    ("env_id", "pairs"),
    [("SpringBalance-v0", 1), ("SpringShove-v0", 3), ("SpringStack-v0", 9), ("SpringJuggle-v0", 1)]
    + [("SpringLabyrinth-v0", 1), ("SpringTower-v0", 10), ("SpringDuel-v0", 1)],
)
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


def largest(env_id: str, actions: int = 2) -> tuple[float, float]:
    """Return how far MuJoCo's particles are from springgym's after control periods from a start with the same
    actions, and how far these have moved, over the size of their bodies."""
    play = MuJoCoPlay(env_id, **SHORT)
    play.model.opt.timestep /= 32
    play.steps *= 32
    own: Any = gym.make_vec(env_id, num_envs=2, **NATIVE)
    own.reset(seed=0)
    episodes, there = own.unwrapped.episodes, play.at.simulator
    play.envs.reset(seed=0)
    play.place(np.arange(2))
    started = there.positions
    for _ in range(actions):
        play._act()
        own.step(play.actions)
        play.run()
        states = np.array([play.particles(data) for data in play.data])
        there.place(*states.swapaxes(0, 1), check=False, read=True)
    sizes = play.scene.sizes
    ends = episodes.simulator.positions
    return (
        float(largest_distances(states[:, 0], ends, sizes).max()),
        float(largest_distances(ends, started, sizes).max()),
    )


@pytest.mark.parametrize("env_id", slow_but(TASKS, "SpringShove-v0", "SpringDuel-v0"))
def test_the_same_actions_move_the_same_bodies_alike(env_id: str) -> None:
    """From the start, before bodies meet. Springs vibrate a little, and contacts are otherwise stiff."""
    apart, moved = largest(env_id)
    assert moved > 0.01
    assert apart < 0.05 * moved
