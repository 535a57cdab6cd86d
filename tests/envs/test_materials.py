"""Environments whose body is made of a material."""

import gymnasium as gym
import numpy as np
import pytest

import springgym  # noqa: F401


def task_of(env):
    return env.unwrapped.episodes.task


def test_top_of_a_material():
    """Its torques are as strong beside its weight as those of the paper's top."""
    paper, beech = (gym.make("SpringTop-v0", **o) for o in ({}, {"body": {"material": "beech"}}))
    tasks = [task_of(env) for env in (paper, beech)]
    assert tasks[1].body.mass == pytest.approx(710 * np.pi * 0.61**2 / 3)
    moments = [task.body.mass * task.body.centre[2] for task in tasks]
    assert tasks[1].torque / tasks[0].torque == pytest.approx(moments[1] / moments[0])
    assert beech.observation_space == paper.observation_space
    _, info = beech.reset(seed=0)
    for _ in range(5):
        observation, reward, terminated, _, info = beech.step(np.array([0.3, -0.2, 0.1], np.float32))
    assert np.abs(observation).max() < 3
    assert 0 < reward < 1
    assert not terminated
    assert 0 < info["strain"] < 1e-3
    assert abs(info["energy_drift"]) < 1e-3 * info["energy"]


def test_top_of_a_material_pushed_at_its_heart():
    env = gym.make("SpringTop-v0", action="impulse", body={"material": "beech", "softened": 20})
    task = task_of(env)
    paper = task_of(gym.make("SpringTop-v0", action="impulse"))
    arm = task.body.positions[task.upper, 2]
    ratio = task.body.mass * task.body.centre[2] / (paper.body.mass * paper.body.centre[2])
    assert task.impulse * arm == pytest.approx(ratio * paper.impulse)
    env.reset(seed=0)
    env.step(np.ones(3, np.float32))


def test_top_too_soft_for_its_spin():
    with pytest.raises(ValueError, match="has no steady shape"):
        gym.make("SpringTop-v0", body={"material": "rubber"})


@pytest.mark.parametrize(
    ("material", "diameter", "stretch"), [("steel", 0.005, 6.7e-4), ("nylon", 0.01, 0.0130)]
)
def test_rope_of_a_material(material, diameter, stretch):
    """(M + m/2) g L/(E A) of the 4 m that hang, and little of it changes."""
    env = gym.make("SpringRope-v0", material=material, diameter=diameter)
    env.reset(seed=0, options={"sway": 0.0})
    positions, _ = env.unwrapped.episodes.particles
    assert np.linalg.norm(positions[0, -1] - positions[0, 0]) - 4 == pytest.approx(stretch, rel=0.01)
    for _ in range(3):
        _, reward, terminated, _, _ = env.step(np.array([0.5, 0.0], np.float32))
    assert not terminated
    assert reward > 0


@pytest.mark.parametrize("given", [{"material": "steel"}, {"diameter": 0.01}])
def test_rope_of_half_a_material(given):
    with pytest.raises(ValueError, match="give both, or neither"):
        gym.make("SpringRope-v0", **given)
