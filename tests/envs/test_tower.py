"""SpringTower: a block swings as a pendulum, falls when it is let go, and only a tower that stands counts."""

from __future__ import annotations

import gymnasium as gym
import numpy as np
import pytest

from springgym.envs.tasks.tower import ARENA, CARRIED, CORNERS, FORCE, MASS, SIDES, SUNK
from springgym.model.bodies import rotation
from tests.envs.cases import make, started
from tests.envs.playing import Policy, play
from tests.envs.test_cheats import classical

ENV = "SpringTower-v0"
COPIES = 8
G = 9.81
GAP = 0.0149  # between blocks that rest on one another [m]
HEIGHT = SIDES[2]
WAIT = np.array([0.0, 0.0, 0.0, -1.0], np.float32)
WEIGHTLESS = np.array([0.0, 0.0, (1 - CARRIED) * MASS * G / FORCE, -1.0])
"""The action that carries a block."""


def begun(held: int, centres: dict[int, tuple[float, float, float]], tilt: float = 0.0) -> gym.Env:
    """An episode with some blocks elsewhere, leaning towards x [rad], and another one held."""
    env = started(ENV, seed=0)
    episodes = env.unwrapped.episodes
    episodes.goal[:] = held
    x = episodes.simulator.positions
    corners = np.array(SIDES) / 2 * np.array([(-1, -1, 1), (1, -1, 1), (1, 1, 1), (-1, 1, 1)])
    block = np.vstack([corners, corners * (1, 1, -1)]) @ rotation((0, 1, 0), tilt).T
    for k, centre in centres.items():
        x[0, CORNERS * k : CORNERS * (k + 1)] = block + centre
    episodes.simulator.place(x, np.zeros_like(x))
    return env


def tower(aside: float = 0.0) -> dict[int, tuple[float, float, float]]:
    """Centres of four blocks on one another, the last one so far aside along a diagonal [m]."""
    x = aside / np.sqrt(2)
    return {k: (x * (k == 3), x * (k == 3), HEIGHT / 2 + k * HEIGHT + (k + 1) * GAP) for k in range(4)}


def centre(env: gym.Env, k: int) -> np.ndarray:
    return np.array(env.unwrapped.episodes._whole.measures.centre[0, k])


def test_a_block_swings_as_a_pendulum_while_it_does_not_go_aside() -> None:
    """I n'' = −l M g n, with l = h/2 and I = M (w² + h²)/4; the force is vertical.

    An amplitude a slows it by a²/16, 2e-4 of a turn here, and a block that hangs is longer by its strain.
    """
    env = begun(1, {1: (0.5, 0.0, 0.6)}, tilt=0.05)
    rate = np.sqrt(2 * G * HEIGHT / (SIDES[0] ** 2 + HEIGHT**2))
    found = []
    for _ in range(22):
        env.step(WEIGHTLESS)
        found.append(env.unwrapped.episodes._whole.measures.axis[0, 1, 0])
    wanted = 0.05 * np.cos(rate * 0.04 * np.arange(1, 23))
    np.testing.assert_allclose(found, wanted, atol=0.05 * 0.03)
    np.testing.assert_allclose(centre(env, 1)[:2], [0.5, 0.0], atol=1e-4)


def test_what_is_let_go_falls_and_the_next_block_is_lifted() -> None:
    env = begun(1, {0: (0, 0, HEIGHT / 2 + GAP), 1: (0.0, 0.0, 0.9), 2: (0.6, 0.0, 0.4)})
    env.step(np.array([0.0, 0.0, 0.0, 1.0]))  # held through this period, with 0.9 of its weight
    height = centre(env, 1)[2]
    sinks = (1 - CARRIED) * G
    for _ in range(4):
        *_, terminated, _, info = env.step(np.array([0.0, 0.0, 1.0, -1.0]))
    assert not terminated
    assert info["held_block"] == 2
    fallen = sinks * 0.04 * 0.16 + G * 0.16**2 / 2
    np.testing.assert_allclose(height - centre(env, 1)[2], fallen, rtol=2e-2)
    velocity = env.unwrapped.episodes._whole.measures.centre_velocity[0, 2, 2]
    np.testing.assert_allclose(velocity, -G * 0.04 + (FORCE / MASS - sinks) * 0.16, rtol=2e-2)


def test_no_action_moves_nothing() -> None:
    """The crane carries nine tenths of a block that stands, and contact gives way by 1 mm."""
    env = started(ENV, seed=0)
    before = env.unwrapped.episodes.particles[0].copy()
    for _ in range(50):
        _, reward, *_ = env.step(np.zeros(4))
    np.testing.assert_allclose(env.unwrapped.episodes.particles[0], before, atol=2e-3)
    assert reward < 0.01


@pytest.mark.parametrize(("aside", "success"), [(0.0, True), (0.03, True), (0.06, False)])
def test_a_tower_that_stands_is_success(aside: float, success: bool) -> None:
    env = begun(4, tower(aside))
    for _ in range(40):
        _, reward, terminated, _, info = env.step(np.zeros(4))
        assert not terminated
    assert info["is_success"] == success
    assert aside - 1e-3 < info["distance"] < aside + 0.02  # on contact that gives way, it leans
    assert reward > 0.9


def test_a_block_in_its_place_is_worth_more_once_it_is_let_go() -> None:
    """Held, it is worth a quarter, and the tower is none."""
    held = begun(3, tower())
    free = begun(4, tower())
    for _ in range(40):
        earned = held.step(WAIT)[1]
        more = free.step(WAIT)[1]
    info = held.step(WAIT)[4]
    assert not info["is_success"]
    assert 0.55 < earned / more < 0.59  # (1/7 + 2/7 + 4/7/4) of what all of it earns


@pytest.mark.parametrize(
    ("moved", "ends"),
    [
        ({1: (0.0, 0.0, 1.5 * HEIGHT - SUNK + 0.01)}, False),
        ({1: (0.0, 0.0, 1.5 * HEIGHT - SUNK - 0.01)}, True),
        ({1: (0.5, 0.0, HEIGHT / 2 + GAP)}, True),
        ({2: (ARENA - 0.02, 0.0, 0.2)}, False),
        ({2: (ARENA + 0.02, 0.0, 0.2)}, True),
        ({2: (0.6, 0.0, ARENA + 0.05)}, True),
    ],
)
def test_what_ends_an_episode(moved: dict[int, tuple[float, float, float]], ends: bool) -> None:
    """A block that is let go and lies too low, or one beyond the arena; the others are out of the way."""
    aside = {0: (-0.6, 0.0, HEIGHT / 2 + GAP)} if 1 in moved else {0: tower()[0], 1: tower()[1]}
    env = begun(2, aside | {3: (-1.2, 0.0, HEIGHT / 2 + GAP)} | moved)
    *_, terminated, _, info = env.step(np.zeros(4))
    assert terminated == ends
    assert not info["diverged"]


def test_a_tower_is_knocked_down() -> None:
    """The next block, drawn against it with all there is, takes it along."""
    env = begun(2, {k: tower()[k] for k in (0, 1)} | {2: (-0.9, 0.0, 1.5 * HEIGHT + 3 * GAP)})
    for _ in range(60):
        *_, terminated, _, info = env.step(np.array([1.0, 0.0, WEIGHTLESS[2], -1.0]))
        if terminated:
            break
    assert terminated
    assert not info["diverged"]
    assert info["pairs_impulse"] > 0.5


# --- Ways around the task -------------------------------------------------------------------------------


def without_letting_go(seen: np.ndarray) -> np.ndarray:
    action = classical(ENV)(seen)
    action[:, 3] = -1.0
    return action


def at_once(seen: np.ndarray) -> np.ndarray:
    return np.tile(np.array([0.0, 0.0, 0.0, 1.0], np.float32), (len(seen), 1))


@pytest.mark.parametrize("cheat", [without_letting_go, at_once])
@pytest.mark.slow
def test_cheats_do_not_pay(cheat: Policy) -> None:
    honest, other = (play(ENV, policy, COPIES, observation="features") for policy in (classical(ENV), cheat))
    assert honest.successes.mean() > 0.8
    assert not other.successes.any()
    assert other.returns.max() < 0.2 * honest.returns.mean()


@pytest.mark.slow
def test_classical_control_builds_lower_towers() -> None:
    played = play(ENV, classical(ENV, blocks=3), 20, observation="features", blocks=3)
    assert played.successes.mean() >= 0.9


@pytest.mark.parametrize(("blocks", "message"), [(1, "from 2 to 5"), (6, "from 2 to 5"), (True, "whole")])
def test_numbers_of_blocks_that_are_refused(blocks: int, message: str) -> None:
    with pytest.raises((TypeError, ValueError), match=message):
        make(ENV, blocks=blocks)
