"""Every environment can be solved by a classical controller, and by nothing less."""

from __future__ import annotations

from typing import Any

import pytest
from controllers import CLASSICAL, make_controller

from springgym.envs.registration import find
from tests.envs.cases import IDS, KINDS, make, task_type
from tests.envs.playing import Played, play

SOLVED = 0.8
"""Share of episodes in which classical control must succeed."""


def run(env_id: str, action: str, name: str, copies: int, **arguments: Any) -> Played:
    env = make(env_id, action=action)
    policy = make_controller(name, env_id, {"action": action}, env.action_space)
    return play(env_id, policy, copies, action=action, observation="features", **arguments)


def check(env_id: str, action: str, copies: int) -> None:
    """It earns what the registry says that the task is solved at, as the mean of all steps."""
    row, _ = find(env_id)  # type: ignore[misc]
    earned = row.reward_threshold / row.max_episode_steps
    classical = run(env_id, action, "classical", copies)
    assert classical.successes.mean() >= SOLVED - 1 / copies
    assert classical.returns.mean() >= earned
    for name in ("noop", "random"):
        idle = run(env_id, action, name, copies)
        assert idle.successes.mean() <= 0.1
        assert idle.returns.mean() < 0.25 * earned


def test_every_action_mode_has_a_classical_controller() -> None:
    assert {env_id: list(actions) for env_id, actions in CLASSICAL.items()} == {
        env_id: list(task_type(env_id).actions) for env_id in IDS
    }


@pytest.mark.parametrize(
    ("env_id", "action"), [(env_id, next(iter(task_type(env_id).actions))) for env_id in KINDS]
)
def test_classical_succeeds_and_idleness_does_not(env_id: str, action: str) -> None:
    check(env_id, action, 8)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("env_id", "action"), [(env_id, action) for env_id in IDS for action in task_type(env_id).actions]
)
def test_rates_on_100_held_out_seeds(env_id: str, action: str) -> None:
    check(env_id, action, 100)
