"""Linear control by the cross-entropy method, the simplest agent that may solve a task.

A policy is a ← clip(W o + b). A generation draws policies around a mean. They all play the same episodes at
once, in one native batch. Mean and spread then move to those of the best policies.
"""

from __future__ import annotations

import csv
import io
import json
import zipfile
from pathlib import Path
from typing import Any

import gymnasium as gym
import numpy as np
from config import ConfigError, LinearConfig, making
from gymnasium import spaces
from runs import HELD_OUT_SEED, Run, time_limit

from springgym.cli import whole_file, write_text
from springgym.envs.agent import LAYERS
from springgym.envs.sb3 import SB3VecEnv, make_sb3

WEIGHT, BIAS = (f"{LAYERS['linear'][1]}.{name}" for name in ("weight", "bias"))


class Search:
    """The search of a run, which goes on from its checkpoint if there is one: the same bits either way."""

    def __init__(self, run: Run, columns: tuple[str, ...]) -> None:
        assert isinstance(run.config, LinearConfig)
        self.run = run
        self.config = run.config
        self.columns = columns
        copies = self.config.population * self.config.episodes
        with making(run.env_id):
            adapter = make_sb3(run.env_id, copies, env_kwargs=run.config.env_kwargs).unwrapped
        assert isinstance(adapter, SB3VecEnv)
        self.env: gym.vector.VectorEnv = adapter.vector_env
        seen = self.env.single_observation_space
        done = self.env.single_action_space
        if not isinstance(seen, spaces.Box) or not isinstance(done, spaces.Box) or len(seen.shape) != 1:
            raise ConfigError(f"{run.env_id}: linear control maps numbers to numbers, not {seen} to {done}")
        self.inputs = seen.shape[0]
        self.outputs = done.shape[0]
        self.low = done.low
        self.high = done.high
        self.limit = time_limit(self.env.spec)  # type: ignore[arg-type]
        size = self.outputs * (self.inputs + 1)
        self.rng = np.random.default_rng(run.seed)
        self.mean, self.spread = np.zeros(size), np.full(size, self.config.spread)
        self.timesteps = 0
        self.seconds = 0.0
        self.rows = np.zeros((0, len(columns)))

    @property
    def path(self) -> Path:
        """Return the checkpoint: arrays of numbers and a text."""
        return self.run.folder / "search.npz"

    def generation(self) -> None:
        """Draw policies, let them play, and go to where the best are. The first policy is the mean itself."""
        config = self.config
        drawn = self.mean + self.spread * self.rng.standard_normal((config.population, self.mean.size))
        drawn[0] = self.mean
        seeds = self.rng.integers(0, HELD_OUT_SEED, config.episodes).tolist()
        returns, lengths, successes, taken = self._play(drawn, seeds)
        best = drawn[np.argsort(-returns.mean(axis=1), kind="stable")[: config.elites]]
        left = 1.0 - config.share_done(self.timesteps, self.seconds)
        self.mean = best.mean(axis=0)
        self.spread = np.sqrt(best.var(axis=0) + (left * config.extra_spread) ** 2)
        self.timesteps += taken
        mean = returns[0].mean() / self.limit
        row = dict.fromkeys(self.columns, np.nan) | {
            "timesteps": self.timesteps,
            "reward_per_step": returns[0].sum() / lengths[0].sum(),
            "episodes": returns.size,
            "return_per_step": mean,
            "episode_length": lengths[0].mean(),
            "success_rate": successes[0].mean(),
        }
        self.rows = np.vstack([self.rows, [row[name] for name in self.columns]])

    def _play(self, policies: np.ndarray, seeds: list[int]) -> tuple[np.ndarray, np.ndarray, np.ndarray, int]:
        """Return, length and success (population, episodes), and how many steps were taken in all."""
        count = len(policies)
        episodes = len(seeds)
        matrices = policies.reshape(count, self.outputs, self.inputs + 1)
        weight = matrices[:, None, :, :-1]
        bias = matrices[:, None, :, -1]
        observations, _ = self.env.reset(seed=seeds * count)  # type: ignore[arg-type]  # it takes a list
        returns = np.zeros(count * episodes)
        lengths = np.zeros(count * episodes, int)
        successes = np.zeros(count * episodes)
        running = np.ones(count * episodes, bool)
        taken = 0
        unknown = np.full(count * episodes, np.nan)
        while running.any():
            seen = np.asarray(observations, float).reshape(count, episodes, self.inputs)
            actions = np.einsum(
                "peoi,pei->peo", np.broadcast_to(weight, (count, episodes, *weight.shape[2:])), seen
            )
            actions = np.clip(actions + bias, self.low, self.high).reshape(-1, self.outputs)
            observations, rewards, terminated, truncated, infos = self.env.step(actions.astype(np.float32))
            taken += len(running)
            returns += running * rewards
            lengths += running
            over = running & (terminated | truncated)
            if over.any():
                successes[over] = infos["final_info"].get("is_success", unknown)[over]
            running &= ~over
        shape = (count, episodes)
        return returns.reshape(shape), lengths.reshape(shape), successes.reshape(shape), taken

    def save(self) -> None:
        """Write the checkpoint, then what is made of it: agent and learning curve."""
        self.rows[-1, self.columns.index("seconds")] = round(self.seconds, 2)
        with whole_file(self.path) as temporary:
            np.savez(
                temporary,
                mean=self.mean,
                spread=self.spread,
                clock=np.array([self.timesteps, self.seconds]),
                rows=self.rows,
                generator=json.dumps(self.rng.bit_generator.state),
            )
        self.write()

    def write(self) -> None:
        """Write agent and learning curve."""
        matrix = self.mean.reshape(self.outputs, self.inputs + 1).astype(np.float32)
        with whole_file(self.run.agent) as temporary:
            arrays: dict[str, Any] = {WEIGHT: matrix[:, :-1], BIAS: matrix[:, -1]}
            np.savez(temporary, **arrays)
        text = io.StringIO()
        table = csv.writer(text, lineterminator="\n")
        table.writerow(self.columns)
        whole = [name in ("timesteps", "episodes") for name in self.columns]
        for row in self.rows.tolist():
            cells = zip(row, whole, strict=True)
            table.writerow(["" if cell != cell else int(cell) if as_int else cell for cell, as_int in cells])
        write_text(self.run.folder / "metrics.csv", text.getvalue())

    def load(self) -> None:
        """Go on from the checkpoint.

        Raises
        ------
        ConfigError
            If it is damaged, or of another run.
        """
        try:
            with np.load(self.path, allow_pickle=False) as found:
                arrays: dict[str, Any] = dict(found)
            for name in ("mean", "spread"):
                if arrays[name].shape != self.mean.shape or not np.isfinite(arrays[name]).all():
                    raise ValueError(f"{name} belongs to another policy")
            self.rng.bit_generator.state = json.loads(str(arrays["generator"]))
            self.mean = arrays["mean"]
            self.spread = arrays["spread"]
            self.rows = arrays["rows"]
            self.timesteps, self.seconds = int(arrays["clock"][0]), float(arrays["clock"][1])
        except (OSError, ValueError, KeyError, TypeError, EOFError, zipfile.BadZipFile) as error:
            raise ConfigError(f"{self.path}: this is not a checkpoint of this run: {error}") from error
