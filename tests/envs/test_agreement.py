"""Return and success agree: what succeeds more earns more, and rewards fall where success ends."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import Any

import numpy as np
import pytest
from controllers import make_controller

import springgym
from springgym.envs.trained import published
from tests.envs.cases import make, started
from tests.envs.playing import Played, Policy, play

COPIES = 40
CERTAIN = 0.25
"""Difference of two shares of `COPIES` episodes that chance makes once in a hundred pairs, or less often:
2.3 √(2 · 0.25 / 40)."""


@pytest.mark.parametrize(
    ("env_id", "arguments", "inside", "outside"),
    [
        ("SpringDetumble-v0", {}, {"speed": 0.1}, {"speed": 0.3}),
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


def degraded(policy: Policy, size: int) -> Iterator[Policy]:
    """A policy with more and more noise, with less and less strength, pushed to a side, and late."""
    rng = np.random.default_rng(0)

    def shaken(size: int, by: float) -> Policy:
        return lambda seen: np.clip(policy(seen) + by * rng.normal(size=(len(seen), size)), -1, 1)

    def late(periods: int) -> Policy:
        past: list[np.ndarray] = []

        def act(seen: np.ndarray) -> np.ndarray:
            past.append(policy(seen))
            return past[-1 - periods] if len(past) > periods else np.zeros_like(past[-1])

        return act

    yield policy
    for noise in (0.3, 0.6, 1.0, 1.5, 2.5):
        yield shaken(size, noise)
    for gain in (0.5, 0.25, 0.1):
        yield lambda seen, gain=gain: gain * policy(seen)  # type: ignore[misc]
    for push in (0.1, 0.2, 0.4):
        yield lambda seen, push=push: np.clip(policy(seen) + push, -1, 1)  # type: ignore[misc]
    for periods in (2, 4, 8):
        yield late(periods)


def family(env_id: str, make_policy: Callable[[Any], Policy], **arguments: Any) -> list[Played]:
    """What a policy and its degraded versions reach."""
    env = make(env_id, **arguments)
    policy, size = make_policy(env), env.action_space.shape[0]
    return [
        play(env_id, lambda seen, act=act: act(seen).astype(np.float32), COPIES, **arguments)  # type: ignore[misc]
        for act in degraded(policy, size)
    ]


def concordance(returns: np.ndarray, successes: np.ndarray) -> float:
    """Return the rank correlation of pairs whose success differs for certain (Goodman & Kruskal's gamma)."""
    more, earned = np.subtract.outer(successes, successes), np.subtract.outer(returns, returns)
    apart = np.abs(more) > CERTAIN
    return float(np.mean((np.sign(more) * np.sign(earned))[apart]))


def test_concordance() -> None:
    success = np.array([0.0, 0.1, 0.5, 1.0])
    assert concordance(success, success) == 1.0
    assert concordance(-success, success) == -1.0
    assert concordance(np.array([0.2, 0.1, 0.5, 1.0]), success) == 1.0  # 0.0 and 0.1 are not apart
    assert concordance(np.array([0.0, 0.6, 0.5, 1.0]), success) == pytest.approx(3 / 5)


@pytest.mark.parametrize(
    ("env_id", "arguments"),
    [
        ("SpringRope-v0", {}),
        ("SpringDetumble-v0", {}),
        ("SpringDetumble-v0", {"start": "flat"}),
        ("SpringPendulum-v0", {}),
        ("SpringGyroscope-v0", {}),
        ("SpringGyroscope-v0", {"hard": True}),
    ],
)
@pytest.mark.slow
def test_what_succeeds_more_earns_more(env_id: str, arguments: dict[str, Any]) -> None:
    """Over classical control, the published agent of the task, and what is left of both if degraded."""
    pytest.importorskip("torch")

    def controller(env: Any) -> Policy:
        return make_controller("classical", env_id, arguments, env.action_space)

    found = family(env_id, controller, **arguments, observation="frame")
    assert found[0].successes.mean() >= 0.9
    if not arguments:
        agent = springgym.load_agent(env_id)
        found += family(env_id, lambda env: agent.policy(env), observation=seen_by(env_id))
    returns, successes = (
        np.array([getattr(one, name).mean() for one in found]) for name in Played._fields[:2]
    )
    assert successes.min() < 0.1
    assert concordance(returns, successes) >= 0.9


def seen_by(env_id: str) -> str:
    """The observation of the published agent."""
    text = (published(env_id) / "config.yaml").read_text(encoding="utf-8")
    return "frame" if "observation: frame" in text else "particles"


def test_the_fastest_flat_spin_can_be_stopped_in_time() -> None:
    env = make("SpringDetumble-v0")
    policy = make_controller("classical", "SpringDetumble-v0", {"start": "flat"}, env.action_space)
    asked: dict[str, Any] = {"start": "flat", "observation": "frame"}
    assert play("SpringDetumble-v0", policy, 16, {"speed": 6.0}, **asked).successes.all()


def test_a_crane_that_leaves_its_place_ends_the_episode() -> None:
    env = started("SpringRope-v0", seed=0, options={"distance": 2.0})
    terminated = truncated = False
    while not terminated and not truncated:
        *_, terminated, truncated, info = env.step(np.array([1.0, 0.0], np.float32))
        assert terminated == (info["error"] > 10.0)
    assert terminated
    assert not info["is_success"]


def test_the_spin_of_either_sign_is_of_order_one() -> None:
    """Of the easier task it is shown as before: from the usual spin."""
    spins = {}
    for hard in (True, False):
        env = make("SpringGyroscope-v0", observation="frame", hard=hard)
        seen, infos = zip(*(env.reset(seed=seed) for seed in range(40)), strict=True)
        entry, spin = np.array(seen)[:, 6], np.array([info["spin"] for info in infos])
        assert entry == pytest.approx(spin / 35 if hard else (spin - 35) / 20, abs=1e-5)
        spins[hard] = entry
    assert np.abs(spins[True]).max() < 1.4
    assert spins[True].min() < 0 < spins[True].max()
