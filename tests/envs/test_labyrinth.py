"""SpringLabyrinth: the ball rolls as on a slope, falls where it should, and has to take the way."""

from __future__ import annotations

import gymnasium as gym
import numpy as np
import pytest

from springgym.envs.tasks import labyrinth
from springgym.envs.tasks.labyrinth import FIRST_HOLE, HALF, HOLE, LEANING, LEGS, PASSED, RADIUS, TILT
from tests.envs.cases import make_vec, started, task_type
from tests.envs.playing import play
from tests.envs.test_cheats import classical
from tests.params import slow_but

COPIES = 8
ENV = "SpringLabyrinth-v0"
IDLE = np.zeros(2, np.float32)


def without_holes(goal: np.ndarray) -> None:
    """Take the holes of boards with these goals (n, G) away."""
    goal[:, FIRST_HOLE:LEANING] = 10.0


def put(env: gym.Env, place: tuple[float, float]) -> None:
    """Put the ball on a place of the board, at rest [m]."""
    simulator = env.unwrapped.episodes.simulator
    x = simulator.positions
    x[0, :, :2] += np.array(place) - x[0, :, :2].mean(axis=0)
    simulator.place(x, np.zeros_like(x))


@pytest.mark.parametrize("angles", [(0.1, 0.0), (-0.06, 0.15)])
def test_the_ball_rolls_as_a_solid_one_on_a_slope(angles: tuple[float, float]) -> None:
    """5/7 of the weight's part along the board, which is g (sin a cos b, sin b); it turns as it goes."""
    env = started(ENV, seed=0)
    put(env, (0.0, 0.0))
    episodes = env.unwrapped.episodes
    without_holes(episodes.goal)
    episodes.goal[0, LEANING:PASSED] = angles
    speeds = []
    for _ in range(30):
        env.step(IDLE)
        speeds.append(episodes.measures.centre_velocity[0].copy())
    a, b = angles
    along = 9.81 * np.array([np.sin(a) * np.cos(b), np.sin(b)])
    found = (speeds[-1] - speeds[4])[:2] / (25 * 0.02)
    np.testing.assert_allclose(found, 5 / 7 * along, rtol=1e-3, atol=1e-6)
    turning = episodes.measures.angular_velocity[0]
    np.testing.assert_allclose(RADIUS * turning[:2], [-speeds[-1][1], speeds[-1][0]], rtol=2e-3, atol=1e-4)


def test_the_board_leans_as_asked_and_no_farther() -> None:
    env = started(ENV, seed=0)
    episodes = env.unwrapped.episodes
    without_holes(episodes.goal)
    for n in range(1, 26):
        env.step(np.array([1.0, -0.5], np.float32))
        wanted = np.clip(0.4 * 0.02 * n * np.array([1.0, -0.5]), -TILT, TILT)
        np.testing.assert_allclose(episodes.goal[0, LEANING:PASSED], wanted, atol=1e-12)
    assert wanted.tolist() == [TILT, pytest.approx(-0.1)]


@pytest.mark.slow
def test_the_weight_is_that_of_the_ball() -> None:
    """A heavy ball, and a weak gravity: what acts along the board is g of both."""
    ranges = {"masses": (0.5, 2.0), "gravity": (0.5, 1.0)}
    envs = make_vec(ENV, 2, "native", "Disabled", randomize=ranges)
    speeds = []
    for factors in ({"masses": 2.0, "gravity": 1.0}, {"masses": 0.5, "gravity": 0.5}):
        envs.reset(seed=[0, 0], options={"randomize": factors})
        episodes = envs.unwrapped.episodes
        without_holes(episodes.goal)
        episodes.goal[:, LEANING] = 0.05
        for _ in range(10):
            envs.step(np.zeros((2, 2), np.float32))
        speeds.append(episodes.measures.centre_velocity[0, 0])
    np.testing.assert_allclose(speeds, 5 / 7 * 9.81 * np.sin(0.05) * 0.2 * np.array([1.0, 0.5]), rtol=3e-3)


def test_holes_are_beside_the_way() -> None:
    """The middle of no hole is nearer to the way than 7.5 cm, and all are on the board."""
    envs = make_vec(ENV, 200, "native", "Disabled")
    envs.reset(seed=0)
    goal = envs.unwrapped.episodes.goal
    points = goal[:, :FIRST_HOLE].reshape(200, -1, 1, 2)
    holes = goal[:, FIRST_HOLE:LEANING].reshape(200, 1, -1, 2)
    legs = points[:, 1:] - points[:, :-1]
    arms = holes - points[:, :-1]
    share = np.clip((arms * legs).sum(-1) / (legs * legs).sum(-1), 0.0, 1.0)
    away = np.linalg.norm(arms - share[..., None] * legs, axis=-1)
    assert away.min() > 0.075
    assert np.abs(holes).max() < HALF
    assert len(np.unique(goal[:, :2], axis=0)) == 200


@pytest.mark.parametrize("inside", [True, False])
def test_a_ball_above_a_hole_falls(inside: bool) -> None:
    env = started(ENV, seed=0)
    hole = env.unwrapped.episodes.goal[0, FIRST_HOLE : FIRST_HOLE + 2]
    without_holes(others := env.unwrapped.episodes.goal.copy())
    others[0, FIRST_HOLE : FIRST_HOLE + 2] = hole
    env.unwrapped.episodes.goal[:] = others
    put(env, (hole[0], hole[1] + (0.95 if inside else 1.05) * HOLE))
    *_, terminated, _, info = env.step(IDLE)
    assert terminated == inside
    assert (info["clearance"] < 0.0) == inside
    assert not info["is_success"]


def test_waiting_does_not_pay() -> None:
    played = play(ENV, lambda seen: np.zeros((COPIES, 2), np.float32), COPIES)
    assert (played.lengths == 600).all()
    assert played.returns.max() < 1e-3
    assert not played.successes.any()


@pytest.mark.parametrize("holes", slow_but([True, False], False))
def test_the_end_is_not_reached_past_the_way(holes: bool) -> None:
    """A ball that rolls straight to the end falls; without holes it arrives, and has earned little."""
    envs = make_vec(ENV, COPIES, "native", "SameStep", observation="features")
    seen, _ = envs.reset(seed=1_000_000)
    episodes = envs.unwrapped.episodes
    control = classical(ENV)
    if not holes:
        without_holes(episodes.goal)
    first = episodes.goal[:, :2].copy()
    end = episodes.goal[:, 2 * LEGS : 2 * LEGS + 2]
    earned = np.zeros(COPIES)
    over = np.zeros(COPIES, bool)
    arrived = np.zeros(COPIES, bool)
    for _ in range(599):
        place = episodes.measures.centre[:, :2]
        seen[:, 8:16] = np.hstack([first - place, *[end - place] * 3]) / labyrinth.WAY_UNIT
        seen, reward, terminated, _, info = envs.step(control(seen))
        over |= terminated
        earned += reward * ~over
        arrived |= (np.linalg.norm(end - episodes.measures.centre[:, :2], axis=1) < 0.02) & ~over
        assert not info["is_success"][~over].any()
    assert (over.mean() > 0.7) if holes else (arrived.sum() >= COPIES - 2)
    assert earned.max() / 600 < 0.15


def test_leaving_the_board_ends_the_episode() -> None:
    """The episode ends before anything is earned, and without an error."""
    played = play(ENV, lambda seen: np.tile(np.float32([1.0, 0.3]), (COPIES, 1)), COPIES)
    assert played.lengths.max() < 100
    assert played.returns.max() < 0.05
    assert not played.successes.any()


def test_the_ball_stays_on_the_board() -> None:
    """However the board is shaken, the ball cannot be thrown over holes: the gap stays within the reach."""
    envs = make_vec(ENV, COPIES, "native", "SameStep")
    envs.reset(seed=0)
    rng = np.random.default_rng(0)
    episodes = envs.unwrapped.episodes
    for _ in range(200):
        envs.step(rng.choice([-1.0, 1.0], (COPIES, 2)).astype(np.float32))
        height = episodes.measures.centre[:, 2] - RADIUS
        assert height.min() > 0.0
        assert height.max() < labyrinth.REACH


def test_points_are_drawn_on_a_tilted_board() -> None:
    """The side that the board leans to is lower, and nothing is stretched."""
    env = started(ENV, seed=0)
    task = env.unwrapped.episodes.task
    _, s = env.unwrapped.episodes.seen_of(0)
    level = task.points(s)
    s.goal[LEANING:PASSED] = 0.1, -0.05
    tilted = task.points(s)
    corner = int(np.argmax(level[:, 0] - level[:, 1] + 9 * (level[:, 2] == 0.0)))
    a = 0.1
    b = -0.05
    x, y = level[corner, :2]
    assert tilted[corner, 2] == pytest.approx(-x * np.sin(a) * np.cos(b) - y * np.sin(b), rel=1e-9)
    np.testing.assert_allclose(np.linalg.norm(tilted, axis=1), np.linalg.norm(level, axis=1), rtol=1e-12)
    assert len(level) == len(task_type(ENV)().scene.positions) + 8 + 4 * LEGS + 24 * labyrinth.HOLES
