"""What is timed is steady play: copies are of every age, and actions are drawn anew."""

from __future__ import annotations

from contextlib import ExitStack
from typing import Any

import numpy as np
import pytest

from benchmarks import steady
from benchmarks.environments import cases_of, collecting, compiled_alone
from benchmarks.steady import RandomPlay, SinglePlay

ID = "SpringPendulum-v0"
LIMIT = 24


def ages(envs: Any) -> np.ndarray:
    """Return how many steps ago the episode of each copy began."""
    if hasattr(envs, "envs"):  # a loop over single environments
        each = [env.unwrapped.episodes for env in envs.envs]
        return np.array([own.time[0] / own.task.period for own in each])
    native = getattr(envs.unwrapped, "vector_env", envs).unwrapped
    return np.asarray(native.episodes.time / native.episodes.task.period)


def are_spread(envs: Any) -> bool:
    """Return whether each quarter of the time limit holds about a quarter of the copies."""
    counts, _ = np.histogram(ages(envs), bins=4, range=(0, LIMIT))
    return bool((counts > 0.15 * counts.sum()).all())


def test_every_speed_is_of_copies_of_every_age() -> None:
    """It fails for what is measured right after a reset, and for clocks that start together."""
    with ExitStack() as stack:
        cases = {case.what["how"]: case for case in cases_of(ID, stack, 64, max_episode_steps=LIMIT)}
    assert {"single", "SyncVectorEnv", "native"} <= set(cases)
    for how, case in cases.items():
        play = case.run.__self__  # type: ignore[attr-defined]
        assert isinstance(play, RandomPlay)
        if how == "single":  # a run has every age
            assert isinstance(play, SinglePlay)
            assert case.units == play.shape[0] >= LIMIT
            continue
        assert are_spread(play.envs), how
        before = play.actions
        case.begin()
        case.run()
        assert not np.array_equal(play.actions, before)
        assert are_spread(play.envs), how
        assert case.units == 2 * 64


def test_copies_that_start_together_are_found(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(steady, "fractions", lambda limit, copies: np.zeros(copies, int))
    assert not are_spread(steady.native(ID, 64, max_episode_steps=LIMIT).envs)
    monkeypatch.undo()
    monkeypatch.setattr(RandomPlay, "warmed", lambda play, limit: play)
    assert not are_spread(steady.native(ID, 64, max_episode_steps=LIMIT).envs)


def test_the_period_alone_is_of_copies_of_every_age() -> None:
    case = compiled_alone(ID, 64, {}, {"max_episode_steps": LIMIT})
    case.begin()
    simulator = case.begin.__closure__[1].cell_contents  # type: ignore[attr-defined]
    began = simulator.positions
    assert np.ptp(began, axis=0).max() > 0.1  # just after a reset all cubes hang
    case.run()
    assert np.abs(simulator.positions - began).max() > 0
    case.begin()
    np.testing.assert_array_equal(simulator.positions, began)


@pytest.mark.parametrize("loop", [False, True])
def test_ppo_collects_from_copies_of_every_age(loop: bool) -> None:
    pytest.importorskip("stable_baselines3")
    from stable_baselines3.common.env_util import make_vec_env

    from springgym.envs.sb3 import make_sb3

    given = {"max_episode_steps": LIMIT}
    if loop:
        envs: Any = make_vec_env(ID, 16, seed=0, env_kwargs=given)
    else:
        envs = make_sb3(ID, 16, 0, stagger=True, env_kwargs=given)
    run = collecting(envs, LIMIT)
    assert are_spread(envs)
    run()
    assert are_spread(envs)
