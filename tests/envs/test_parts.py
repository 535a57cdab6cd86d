"""What follows a control period is found part by part, by several threads or of new episodes alone."""

from __future__ import annotations

import copy
from typing import Any

import gymnasium as gym
import numpy as np
import pytest

from springgym import simulator
from springgym.core.language.blocks import WIDTH
from tests.envs.test_contract import same

WIDE = WIDTH[np.dtype(float)]
"""The number of copies in a block in double precision."""


def batch(copies: int, **options: Any) -> Any:
    return gym.make_vec("SpringTop-v0", num_envs=copies, vectorization_mode="vector_entry_point", **options)


@pytest.mark.parametrize("observation", ["particles", "features"])
@pytest.mark.parametrize("copies", [33, 40])
def test_threads_find_the_same(copies: int, observation: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """Also where the last block holds a single copy, whose arrays would be of another type by themselves."""
    monkeypatch.setattr(simulator, "WORTH_A_THREAD", 0)
    options: dict[str, Any] = {"observation": observation, "max_episode_steps": 3}
    one, two = (batch(copies, threads=threads, **options) for threads in (1, 2))
    same(one.reset(seed=0), two.reset(seed=0))
    parts = []
    judge = two.episodes._judge
    monkeypatch.setattr(two.episodes, "_judge", lambda *of, **to: (parts.append(of[:2]), judge(*of, **to)))
    for action in np.random.default_rng(0).uniform(-1, 1, (5, copies, 3)).astype(np.float32):
        same(one.step(action), two.step(action))
    assert len(set(parts)) == (1 if copies % WIDE == 1 else 2)


@pytest.mark.parametrize(("copies", "which"), [(5, 3), (49, 20), (49, 48)])
def test_a_copy_that_begins_alone(copies: int, which: int) -> None:
    """First of all that compiled functions are given, it is read as it is among many."""
    first = batch(copies)
    first.reset(seed=0)
    action = np.full((copies, 3), 0.5, np.float32)
    first.step(action)
    second = copy.deepcopy(first)  # which finds its functions anew
    mask = np.arange(copies) == which
    both = [envs.reset(seed=7, options={"reset_mask": mask}) for envs in (first, second)]
    same(*both)
    for envs in (first, second):
        envs.step(action)
    third = batch(copies)
    third.reset(seed=7)
    same(first.step(action), second.step(action))
    observations, *_, info = first.step(action)
    for _ in range(3):
        seen, *_, its = third.step(action)
    np.testing.assert_array_equal(observations[which], seen[which])
    assert info["tilt"][which] == its["tilt"][which]


@pytest.mark.parametrize("begun", [[3], [2 * WIDE + 3, 5], [5 * WIDE], [0, WIDE + 4, 2 * WIDE + 4]], ids=str)
def test_few_copies_begin_in_their_blocks(begun: list[int]) -> None:
    """They are what they are where all copies are looked at, and the others stay as they were."""
    copies = 5 * WIDE + 1  # the last block has one
    blocks, whole = (batch(copies) for _ in range(2))
    whole.unwrapped.episodes._sees_parts = False  # as functions of a user's own are taken
    for envs in (blocks, whole):
        envs.reset(seed=0)
        envs.episodes.elapsed[begun] = 499
    for action in np.random.default_rng(0).uniform(-1, 1, (3, copies, 3)).astype(np.float32):
        same(blocks.step(action), whole.step(action))


def test_what_was_returned_stays() -> None:
    """No step writes to what an earlier one gave, be it of a copy that has begun since."""
    envs = batch(5, max_episode_steps=2)
    envs.reset(seed=0)
    given = []
    for action in np.random.default_rng(0).uniform(-1, 1, (6, 5, 3)).astype(np.float32):
        result = envs.step(action)
        given.append((result, copy.deepcopy(result)))
    for result, kept in given:
        same(result, kept)
