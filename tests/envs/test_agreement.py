"""Return and success agree: what succeeds more earns more, and rewards fall where success ends."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from controllers import make_controller
from evaluate import INTERFACE

import springgym
from springgym.envs.registration import ALL_IDS
from tests.envs.cases import IDS, KINDS, make, started, task_type
from tests.envs.playing import Played, Policy, play
from tests.params import slow_unless


@pytest.mark.parametrize(
    ("env_id", "arguments", "inside", "outside"),
    [
        ("SpringDetumble-v0", {}, {"angular_speed": 0.1}, {"angular_speed": 0.3}),
        ("SpringPendulum-v0", {}, {"tilt": 0.05}, {"tilt": 0.3}),
        ("SpringRope-v0", {}, {"distance": 0.02, "sway": 0.0}, {"distance": 0.2, "sway": 0.0}),
        ("SpringGyroscope-v0", {}, {"angle": 0.03}, {"angle": 0.2}),
        ("SpringGyroscope-v0", {"hard": True}, {"angle": 0.03}, {"angle": 0.2}),
    ],
)
def test_rewards_halve_at_twice_what_success_allows(
    env_id: str, arguments: dict[str, Any], inside: dict[str, Any], outside: dict[str, Any]
) -> None:
    """After one control period without action, from either start, the best of what is drawn besides."""
    env = make(env_id, **arguments)
    found = []
    for options in (inside, outside):
        rewards = []
        for seed in range(60):
            env.reset(seed=seed, options=options)
            rewards.append(float(env.step(np.zeros(env.action_space.shape, np.float32))[1]))
        found.append(max(rewards))
    assert found[0] > 0.8
    assert found[1] < 0.5 * found[0]


def degraded(policy: Policy, noise: float, bias: float) -> Policy:
    """A controller whose actions are in part random, for five steps at a time, and whose eyes are off."""
    rng = np.random.default_rng(0)
    step = 0
    wrong = 0.0
    held = 0.0

    def act(seen: np.ndarray) -> np.ndarray:
        nonlocal step, wrong, held
        wrong = bias * rng.standard_normal(seen.shape) if step == 0 else wrong
        actions = policy(seen + wrong)
        held = rng.uniform(-1.0, 1.0, actions.shape) if step % 5 == 0 else held
        step += 1
        return np.clip((1.0 - noise) * actions + noise * held, -1.0, 1.0).astype(np.float32)

    return act


def family(env_id: str, policy: Policy, **arguments: Any) -> list[Played]:
    """What a policy and its degraded versions reach."""
    kinds = [(0.0, 0.0), (0.1, 0.0), (0.2, 0.0), (0.4, 0.0), (1.0, 0.0), (0.0, 0.05), (0.0, 0.1), (0.0, 0.2)]
    return [play(env_id, degraded(policy, *own), 50, **arguments) for own in kinds]


MISSED = {"SpringShove-v0": [pytest.mark.xfail(reason="γ is 0.88: noise costs success first", strict=True)]}


@pytest.mark.parametrize(
    ("env_id", "with_published"),
    [
        *(
            pytest.param(one, False, marks=slow_unless(one in KINDS))
            for one in ALL_IDS
            if "Sparse" not in one
        ),
        *(pytest.param(one, True, marks=(pytest.mark.slow, *MISSED.get(one, ()))) for one in IDS),
    ],
)
def test_returns_rank_as_successes_do(env_id: str, with_published: bool) -> None:
    """Goodman and Kruskal's γ is at least 0.9 over pairs of agents whose success rates differ by over 0.2."""
    exact = make_controller("classical", env_id, {}, task_type(env_id)().action_space)
    played = family(env_id, exact, observation="features")
    if with_published:
        agent = springgym.load_agent(env_id)
        env = agent.make()
        interface = {name: value for name, value in agent.env_kwargs.items() if name in INTERFACE}
        played += family(env_id, agent.policy(env), **interface)
        env.close()
    success = np.array([own.successes.mean() for own in played])
    earned = np.array([own.returns.mean() for own in played])
    more = success[:, None] - success > 0.2
    assert np.count_nonzero(more) >= 5
    ranked = np.sign(earned[:, None] - earned)[more]
    assert ranked.mean() >= 0.9  # Goodman and Kruskal's γ


@pytest.mark.parametrize(
    "env_id",
    [
        "SpringTopHard-v0",
        "SpringTopImpulseHard-v0",
        pytest.param("SpringFreeTopRough-v0", marks=pytest.mark.slow),
    ],
)
def test_starts_can_be_met(env_id: str) -> None:
    """Slow tops that lean too far fall whatever is done, and a tip that sticks has to be pushed off."""
    exact = make_controller("classical", env_id, {}, task_type(env_id)().action_space)
    assert play(env_id, exact, 200, observation="features").successes.mean() >= 0.97


def test_the_fastest_flat_spin_can_be_stopped_in_time() -> None:
    env = make("SpringDetumble-v0")
    policy = make_controller("classical", "SpringDetumble-v0", {"start": "flat"}, env.action_space)
    asked: dict[str, Any] = {"start": "flat", "observation": "features"}
    assert play("SpringDetumble-v0", policy, 16, {"angular_speed": 6.0}, **asked).successes.all()


def test_a_crane_that_leaves_its_place_ends_the_episode() -> None:
    env = started("SpringRope-v0", seed=0, options={"distance": 2.0})
    terminated = truncated = False
    while not terminated and not truncated:
        *_, terminated, truncated, info = env.step(np.array([1.0, 0.0], np.float32))
        assert terminated == (info["distance"] > 10.0)
    assert terminated
    assert not info["is_success"]


def test_the_spin_of_either_sign_is_of_order_one() -> None:
    """Of the easier task it is shown as before: from the usual spin."""
    spins = {}
    for hard in (True, False):
        env = make("SpringGyroscope-v0", observation="features", hard=hard)
        seen, infos = zip(*(env.reset(seed=seed) for seed in range(40)), strict=True)
        entry = np.array(seen)[:, 6]
        spin = np.array([info["spin"] for info in infos])
        assert entry == pytest.approx(spin / 35 if hard else (spin - 35) / 20, abs=1e-5)
        spins[hard] = entry
    assert np.abs(spins[True]).max() < 1.4
    assert spins[True].min() < 0 < spins[True].max()
