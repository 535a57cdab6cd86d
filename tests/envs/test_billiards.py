"""SpringBilliards: the stroke, what friction and the impact leave of it, and what it has to hit."""

from __future__ import annotations

from typing import Any

import gymnasium as gym
import numpy as np
import pytest

from springgym.envs.tasks import billiards
from springgym.envs.tasks.billiards import CUE, FORCE, FRICTION, MASS, OBJECT, PERIOD, PERIODS, RADIUS
from tests.envs.cases import started
from tests.envs.playing import Policy, play
from tests.envs.test_cheats import classical
from tests.params import slow_but

ENV = "SpringBilliards-v0"
COPIES = 100
G = 9.81
SLOWING = FRICTION * G

Ways = tuple[np.ndarray, float, bool, dict[str, Any]]


def laid(cue: tuple[float, float], other: tuple[float, float], pocket: tuple[float, float]) -> gym.Env:
    """An episode with balls and pocket at places of one's own [m]."""
    env = started(ENV, seed=0)
    episodes = env.unwrapped.episodes
    x = episodes.simulator.positions
    x[0, :, :2] = cue, other
    episodes.simulator.place(x, np.zeros_like(x))
    episodes.goal[0, :2] = pocket
    episodes.memory[0] = np.inf
    return env


def struck(env: gym.Env, angle: float, size: float = 0.5) -> Ways:
    """Return velocities (periods, balls, 2) after each control period of a stroke, and how it ends."""
    episodes = env.unwrapped.episodes
    velocities = []
    episodes.each_period = lambda: velocities.append(episodes.seen[0].centre_velocity[0, :, :2].copy())
    _, reward, terminated, _, info = env.step(size * np.array([np.cos(angle), np.sin(angle)]))
    return np.array(velocities), float(reward), terminated, info


def test_an_episode_is_one_stroke() -> None:
    """The ball's speed is (F/m − μ g) T after the first control period; then only friction, μ g, slows it."""
    velocities, reward, terminated, info = struck(laid((0.0, 0.0), (1.5, 1.5), (-1.0, 0.0)), 0.3)
    assert terminated
    assert len(velocities) == PERIODS
    begun = (0.5 * FORCE / MASS - SLOWING) * PERIOD
    way = np.array([np.cos(0.3), np.sin(0.3)])
    np.testing.assert_allclose(velocities[0, CUE], begun * way, rtol=2e-3)
    np.testing.assert_allclose(velocities[40, CUE], (begun - SLOWING * 40 * PERIOD) * way, rtol=5e-3)
    assert not velocities[:, OBJECT].any()
    assert info["min_distance"] == np.hypot(2.5, 1.5)
    assert not info["is_success"]
    assert 0.0 < reward < 1e-3


def test_copies_strike_as_single_environments_do() -> None:
    """To the bit, though copies differ in when balls meet and fall."""
    envs: Any = gym.make_vec(ENV, 3, vectorization_mode="vector_entry_point")
    seen, _ = envs.reset(seed=4)
    actions = classical(ENV)(gym.make_vec(ENV, 3, observation="features").reset(seed=4)[0])
    _, rewards, *_ = envs.step(actions)
    x = envs.unwrapped.episodes.particles[0]
    for n, action in enumerate(actions):
        env = gym.make(ENV)
        np.testing.assert_array_equal(env.reset(seed=4 + n)[0], seen[n])
        assert env.step(action)[1] == rewards[n]
        np.testing.assert_array_equal(env.unwrapped.episodes.particles[0][0], x[n])  # type: ignore[attr-defined]


def test_each_control_period_is_filmed() -> None:
    env = gym.make(ENV, render_mode="rgb_array_list")
    env.reset(seed=0)
    (start,) = env.render()  # type: ignore[misc]
    env.step(np.array([0.5, 0.0]))
    film: Any = env.render()
    assert len(film) == PERIODS
    assert (film[0] != start).any()
    assert env.render() == []


def test_the_error_is_the_largest_of_all_control_periods() -> None:
    """The impact's, though nothing moves in the last one."""
    found = []
    for aim in (0.0, 1.0):
        env = started(ENV, seed=0, error=True)
        x = env.unwrapped.episodes.particles[0][0, :, :2]
        bearing = np.arctan2(*(x[OBJECT] - x[CUE])[::-1]) + aim
        found.append(struck(env, bearing)[-1]["step_error"])
    assert found[0] > 10.0 * found[1] > 0.0


def parted(aim: float, away: float = 0.6) -> tuple[np.ndarray, float]:
    """Velocity of a ball that another one, from ``away``, has hit, and the other's speed before that."""
    velocities, *_ = struck(laid((-away, 0.0), (0.0, 0.0), (-1.0, 1.0)), aim)
    met = int(np.argmax(np.linalg.norm(velocities[:, OBJECT], axis=1) > 0.0))
    assert met
    return velocities[met + 1, OBJECT], float(np.linalg.norm(velocities[met - 1, CUE]))


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
def test_a_step_too_long_for_the_impact_earns_nothing(step: float) -> None:
    """Without springs no step is unstable; the balls must not pass through one another for that."""
    env = started(ENV, step=step, seed=0)
    x = env.unwrapped.episodes.particles[0][0, :, :2]
    _, reward, terminated, info = struck(env, np.arctan2(*(x[OBJECT] - x[CUE])[::-1]), 1.0)
    assert terminated
    assert info["diverged"]
    assert info["coarse_contacts"] > 0
    assert reward == 0.0


def test_a_ball_in_the_pocket_stays_there() -> None:
    env = laid((-0.5, 0.0), (0.0, 0.0), (0.4, 0.0))
    velocities, reward, terminated, info = struck(env, 0.0)
    assert terminated
    assert info["is_success"]
    assert reward == pytest.approx(1.0 - 0.1 * 0.5**2 / 2, abs=1e-6)
    assert info["min_distance"] < FRICTION * G / billiards.SOFT + 1e-4  # where friction holds it
    assert np.linalg.norm(velocities[-1, OBJECT]) < 1e-3


@pytest.mark.parametrize(("aim", "size"), [(0.3, 0.5), (0.0, 0.2), (0.0, 1.0)])
def test_a_stroke_that_fails(aim: float, size: float) -> None:
    """One that misses, one that is too weak, and one that drives the ball beyond the pocket and away."""
    env = laid((-0.5, 0.0), (0.0, 0.0), (0.5, 0.3 if size == 1.0 else 0.0))
    _, reward, terminated, info = struck(env, aim, size)
    assert terminated
    assert not info["diverged"]
    assert not info["is_success"]
    assert info["min_distance"] > billiards.POCKET
    assert reward < 0.2


# --- Ways around the task -------------------------------------------------------------------------------


def waiting(seen: np.ndarray) -> np.ndarray:
    return np.zeros((len(seen), 2), np.float32)


def straight(seen: np.ndarray) -> np.ndarray:
    """Strike straight at the second ball."""
    return seen[:, :2] / np.linalg.norm(seen[:, :2], axis=1, keepdims=True)


def nearly(seen: np.ndarray) -> np.ndarray:
    """Aim as classical control does, but 0.03 rad beside."""
    right = classical(ENV)(seen)
    return right + 0.03 * np.column_stack([-right[:, 1], right[:, 0]])


@pytest.mark.parametrize("other", slow_but([waiting, straight, nearly], straight))
def test_only_a_precise_stroke_pays(other: Policy) -> None:
    honest, cheat = (play(ENV, policy, COPIES, observation="features") for policy in (classical(ENV), other))
    assert honest.successes.mean() >= 0.9
    assert cheat.successes.mean() <= 0.25
    assert cheat.returns.mean() < 0.3 * honest.returns.mean()
