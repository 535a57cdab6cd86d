"""The script for RLlib, which has an environment of its own: what it refuses, and, there, that it learns."""

import importlib.util
from types import SimpleNamespace

import gymnasium as gym
import numpy as np
import pytest
import rllib_ppo
import torch


def test_no_runner_shares_a_start_with_another():
    bases = []
    for seed in (0, 1):
        for worker in range(8):
            asked = SimpleNamespace(seed=seed)
            runner = SimpleNamespace(_seed=seed + worker, worker_index=worker, config=asked)
            rllib_ppo.seed_apart(env_runner=runner, env=None)
            bases.append(runner._seed)
    assert np.diff(sorted(bases)).min() > 1e6  # copies count on from there


class Still:
    """A module that does nothing: means of 0, then logarithms of deviations."""

    def forward_inference(self, batch):
        return {"action_dist_inputs": torch.zeros(len(batch["obs"]), 6)}


def test_evaluation_is_that_of_the_other_scripts():
    from evaluate import evaluate

    noop = evaluate("noop", "SpringTop-v0", {}, 8)
    earned, success = rllib_ppo.evaluate(Still(), "SpringTop-v0", {}, 8)
    assert earned == pytest.approx(np.mean(noop.returns_per_step), rel=1e-5)
    assert success == noop.success_rate


@pytest.mark.slow
@pytest.mark.skipif(
    importlib.util.find_spec("tree") is None or not gym.__version__.startswith("1.2."),
    reason="needs agents/rllib-constraints.txt",
)
def test_it_trains_on_two_runners_and_goes_on(tmp_path):
    asked = ["SpringTop-v0", "--runners", "2", "--episodes", "4", "--out", str(tmp_path / "run")]
    assert rllib_ppo.main([*asked, "--timesteps", "4096"]) == 0
    assert rllib_ppo.main([*asked, "--timesteps", "8192", "--resume"]) == 0
    steps = [line.split(",")[0] for line in (tmp_path / "run" / "metrics.csv").read_text().splitlines()]
    assert steps == ["timesteps", "4096", "8192"]
