"""SpringBilliards: the stroke, what friction and the impact leave of it, and what it has to hit."""

from __future__ import annotations

import gymnasium as gym
import numpy as np
import pytest

from springgym.envs import billiards
from springgym.envs.billiards import CUE, FORCE, FRICTION, MASS, OBJECT, PERIOD, RADIUS
from tests.envs.cases import started
from tests.envs.playing import Policy, play
from tests.envs.test_cheats import classical
from tests.params import slow_but

ENV, COPIES, G = "SpringBilliards-v0", 20, 9.81
IDLE = np.zeros(2, np.float32)
SLOWING = FRICTION * G


def laid(cue: tuple[float, float], other: tuple[float, float], pocket: tuple[float, float]) -> gym.Env:
    """An episode with balls and pocket at places of one's own [m]."""
    env = started(ENV, seed=0)
    episodes = env.unwrapped.episodes
    x = episodes.simulator.positions
    x[0, :, :2] = cue, other
    episodes.simulator.place(x, np.zeros_like(x))
    episodes.goal[0, :2] = pocket
    return env


def velocity(env: gym.Env, body: int) -> np.ndarray:
    return np.array(env.unwrapped.episodes._whole.measures.centre_velocity[0, body, :2])


def stroke(env: gym.Env, angle: float, size: float = 0.5) -> None:
    env.step(size * np.array([np.cos(angle), np.sin(angle)]))


def test_the_stroke_and_friction() -> None:
    """v = (F/m − μ g) T, and μ g slows it: friction is met each step, and rounds nothing."""
    env = laid((0.0, 0.0), (1.5, 1.5), (-1.0, 0.0))
    stroke(env, 0.3)
    begun = (0.5 * FORCE / MASS - SLOWING) * PERIOD
    way = np.array([np.cos(0.3), np.sin(0.3)])
    np.testing.assert_allclose(velocity(env, CUE), begun * way, rtol=2e-3)
    for _ in range(40):
        env.step(IDLE)
    np.testing.assert_allclose(velocity(env, CUE), (begun - SLOWING * 40 * PERIOD) * way, rtol=5e-3)


def test_there_is_one_stroke() -> None:
    """The second one changes no bit; an action that is no stroke leaves it."""
    pair = [laid((0.0, 0.0), (1.5, 1.5), (-1.0, 0.0)) for _ in range(2)]
    for env, later in zip(pair, (IDLE, np.ones(2)), strict=True):
        env.step(np.array([0.09, 0.0]))
        assert (velocity(env, CUE) == 0.0).all()
        stroke(env, 0.0)
        for _ in range(10):
            env.step(later)
    assert velocity(pair[0], CUE)[0] > 1.0
    np.testing.assert_array_equal(velocity(pair[0], CUE), velocity(pair[1], CUE))


def parted(aim: float, away: float = 0.6) -> tuple[np.ndarray, float]:
    """Velocity of a ball that another one, from ``away``, has hit, and the other's speed before that."""
    env = laid((-away, 0.0), (0.0, 0.0), (-1.0, 1.0))
    stroke(env, aim)
    for _ in range(100):
        before = np.linalg.norm(velocity(env, CUE))
        env.step(IDLE)
        if np.linalg.norm(velocity(env, OBJECT)) > 0.0:
            env.step(IDLE)
            return velocity(env, OBJECT), before
    raise AssertionError("it has missed")


def test_a_full_hit() -> None:
    """(1 + e)/2 of the velocity goes on; friction takes up to three periods of μ g from both."""
    after, before = parted(0.0)
    assert after[0] / before == pytest.approx(
        (1 + billiards.RESTITUTION) / 2, abs=3 * SLOWING * PERIOD / before
    )
    assert abs(after[1]) < 1e-6


@pytest.mark.parametrize("away", [0.4, 0.8])
def test_the_impact_makes_errors_larger(away: float) -> None:
    """An aim that is off by δ sends the ball off by (d/D − 1) δ: at a distance d of the centres, D = 2R and
    what contact keeps between them meet. To first order: (d δ/D)² is 1 % here, and D is within 6 % of 2R."""
    error = 0.1 * 2 * RADIUS / away
    after, _ = parted(error, away)
    gained = -np.arctan2(after[1], after[0]) / error
    assert gained == pytest.approx(away / (2 * RADIUS) - 1, rel=0.07)


@pytest.mark.parametrize("step", [PERIOD, PERIOD / 4])
def test_a_step_too_long_for_the_impact_ends_the_episode(step: float) -> None:
    """Without springs no step is unstable; the balls must not pass through one another for that."""
    env = started(ENV, step=step, seed=0)
    x = env.unwrapped.episodes.particles[0][0, :, :2]
    action = (x[OBJECT] - x[CUE]) / np.linalg.norm(x[OBJECT] - x[CUE])
    for n in range(60):
        *_, terminated, _, info = env.step(action if n == 0 else IDLE)
        if terminated:
            break
    assert info["diverged"]
    assert info["too_fast"] > 0


def test_a_ball_in_the_pocket_stays_there() -> None:
    env = laid((-0.5, 0.0), (0.0, 0.0), (0.4, 0.0))
    stroke(env, 0.0)
    rewards = []
    for _ in range(120):
        _, reward, terminated, _, info = env.step(IDLE)
        assert not terminated
        rewards.append(reward)
    assert env.unwrapped.episodes.goal[0, billiards.POTTED] == 1.0
    assert rewards[-1] == 1.0
    assert max(reward for reward in rewards if reward < 1.0) <= 0.2
    assert info["is_success"]
    assert info["away"] < FRICTION * G / billiards.SOFT + 1e-4  # where friction holds it


@pytest.mark.parametrize(("aim", "size"), [(0.3, 0.5), (0.0, 0.2), (0.0, 1.0)])
def test_a_stroke_that_fails_ends_the_episode(aim: float, size: float) -> None:
    """One that misses, one that is too weak, and one that drives the ball beyond the pocket and away."""
    env = laid((-0.5, 0.0), (0.0, 0.0), (0.5, 0.3 if size == 1.0 else 0.0))
    stroke(env, aim, size)
    for _ in range(300):
        *_, terminated, _, info = env.step(IDLE)
        if terminated:
            break
    assert terminated
    assert not info["diverged"]
    assert not info["is_success"]
    assert info["away"] > billiards.POCKET


# --- Ways around the task -------------------------------------------------------------------------------


def waiting(seen: np.ndarray) -> np.ndarray:
    return np.zeros((len(seen), 2), np.float32)


def straight(seen: np.ndarray) -> np.ndarray:
    """Strike straight at the second ball, and push on."""
    return seen[:, :2] / np.linalg.norm(seen[:, :2], axis=1, keepdims=True)


def nearly(seen: np.ndarray) -> np.ndarray:
    """Aim as classical control does, but 0.03 rad beside."""
    right = classical(ENV)(seen)
    return right + 0.03 * np.column_stack([-right[:, 1], right[:, 0]])


@pytest.mark.parametrize("other", slow_but([waiting, straight, nearly], straight))
def test_only_a_precise_stroke_pays(other: Policy) -> None:
    honest, cheat = (play(ENV, policy, COPIES, observation="frame") for policy in (classical(ENV), other))
    assert honest.successes.mean() >= 0.9
    assert cheat.successes.mean() <= 0.25
    assert cheat.returns.mean() < 0.3 * honest.returns.mean()
