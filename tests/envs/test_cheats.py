"""Ways around a task that agents have found do not pay."""

from __future__ import annotations

import numpy as np
import pytest
from controllers import make_controller

from tests.envs.cases import task_type
from tests.envs.playing import Played, Policy, play

COPIES = 8


def classical(env_id: str, **options: str) -> Policy:
    return make_controller("classical", env_id, options, task_type(env_id)(**options).action_space)


pendulum_torque = classical("SpringPendulum-v0")
free_top_push = classical("SpringFreeTop-v0")
top_torque = classical("SpringTop-v0")


def pendulum(policy, action: str = "torque") -> Played:
    return play("SpringPendulum-v0", policy, COPIES, observation="features", action=action)


def free_top(policy) -> Played:
    return play("SpringFreeTop-v0", policy, COPIES, observation="features")


@pytest.fixture(scope="module")
def honest_pendulum() -> Played:
    return pendulum(pendulum_torque)


@pytest.fixture(scope="module")
def honest_top() -> Played:
    return free_top(free_top_push)


@pytest.mark.parametrize("action", ["torque", "impulse"])
def test_cube_cannot_be_spun_into_a_sleeping_top(honest_pendulum: Played, action: str) -> None:
    """The torque has no part along the diagonal, the impulse no arm about it: full action along it, for
    10 s, spins nothing."""
    cheat = pendulum(lambda seen: seen[:, :3] / np.abs(seen[:, :3]).max(axis=1, keepdims=True), action)
    assert (cheat.lengths == 250).all()
    assert cheat.largest["spin"].max() < 1e-3
    assert cheat.returns.max() < 0.01 < 0.5 < honest_pendulum.returns.min()


def test_cube_that_comes_spinning_gains_little(honest_pendulum: Played) -> None:
    """While it swings up, full torque along the diagonal is added: the way up is not shorter."""

    def greedy(seen: np.ndarray) -> np.ndarray:
        return np.clip(pendulum_torque(seen) + 2 * seen[:, :3], -1, 1)

    cheat = pendulum(greedy)
    assert cheat.largest["spin"].max() < 1e-3
    assert cheat.returns.mean() < honest_pendulum.returns.mean()


def whirl(seen: np.ndarray) -> np.ndarray:
    """Turn the cube about the vertical, as fast as the end of the episode allows."""
    speed = 4 * np.linalg.norm(seen[:, 3:6], axis=1)
    return np.outer(np.clip(3 * (7.5 - speed), -1, 1), [0.0, 0.0, 1.0])


def test_whirling_does_not_lift_the_cube(honest_pendulum: Played) -> None:
    """On a conical pendulum without spin I₁Ω² n_z = −Mgl: it stays below the pin at any speed."""
    cheat = pendulum(whirl)
    assert cheat.largest["angular_speed"].min() > 5.0
    assert cheat.returns.max() < 0.1
    assert cheat.returns.max() < 0.2 * honest_pendulum.returns.min()
    assert not cheat.successes.any()


def test_whirling_too_fast_ends_the_episode() -> None:
    cheat = pendulum(lambda seen: np.tile([0.0, 0.0, 1.0], (COPIES, 1)))
    assert (cheat.lengths < 250).all()


def test_spinning_the_pinned_top_up_is_not_enough() -> None:
    """Torque about the axis alone keeps the spin wanted, but it precesses on, tilted."""
    honest, cheat = (
        play("SpringTop-v0", policy, COPIES, observation="features")
        for policy in (top_torque, lambda seen: top_torque(seen) * np.float32([0, 0, 1]))
    )
    assert cheat.lengths.max() == 500
    assert cheat.returns.max() < 0.25 < 0.5 < honest.returns.min()
    assert not cheat.successes.any()


def test_spinning_the_top_up_ends_the_episode(honest_top: Played) -> None:
    """At 26 rad/s the top would stand by itself; beyond 12.5 rad/s the episode is over."""

    def spin_up(seen: np.ndarray) -> np.ndarray:
        return np.column_stack([free_top_push(seen)[:, :2], np.ones(COPIES)])

    cheat = free_top(spin_up)
    assert (cheat.lengths < 100).all()
    assert cheat.returns.max() < 0.2 < 0.8 < honest_top.returns.min()


def test_spin_at_the_edge_of_the_band_does_not_pay(honest_top: Played) -> None:
    """At 12.2 rad/s it nearly stands by itself, but earns little more than half, and never succeeds."""

    def fast(seen: np.ndarray) -> np.ndarray:
        return np.column_stack([free_top_push(seen)[:, :2], np.clip(2 * (4.2 - 4 * seen[:, 6]), -1, 1)])

    cheat = free_top(fast)
    assert (cheat.lengths == 500).all()
    assert cheat.returns.max() < 0.6 * honest_top.returns.min()
    assert not cheat.successes.any()
