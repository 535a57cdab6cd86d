"""Checkpoints: the whole state of a training in one file, so that a run can continue as if it had not
stopped."""

from __future__ import annotations

import json
import pickle
import random
import zipfile
from dataclasses import asdict
from typing import TYPE_CHECKING, Any

import numpy as np
import torch
from agent import ALGORITHMS, save_agent
from board import make_logger
from config import ConfigError
from learner import native_env, network_config
from runs import Run
from stable_baselines3 import HerReplayBuffer
from stable_baselines3.common.base_class import BaseAlgorithm
from stable_baselines3.common.off_policy_algorithm import OffPolicyAlgorithm
from stable_baselines3.common.vec_env import VecNormalize

from springgym.cli import whole_file
from springgym.envs.sb3 import StaggeredMonitor

if TYPE_CHECKING:
    from recorder import Recorder

MAY_CHANGE = ("total_timesteps", "log_every", "checkpoint_every", "eval_env_kwargs")
"""Settings that may change when a run is resumed."""


def save_checkpoint(run: Run, env: StaggeredMonitor, model: BaseAlgorithm, recorder: Recorder) -> None:
    """Write the model and all that training depends on into one file, swapped in whole, and the agent.

    To be called between iterations: after an update and before the next step is taken.
    """
    native = native_env(env)
    normalize = model.get_vec_normalize_env()
    logger = model.logger
    state = {
        "env": native.get_state() if hasattr(native, "get_state") else None,
        "monitor": (env.episode_returns, env.episode_lengths, env.episode_count, env.shortened),
        "discounted_returns": normalize.returns if normalize else None,
        "replay_buffer": model.replay_buffer if isinstance(model, OffPolicyAlgorithm) else None,
        "recorder": recorder.state(),
        "logger": (dict(logger.name_to_value), dict(logger.name_to_count), logger.name_to_excluded),
        "random": (random.getstate(), np.random.get_state(), torch.get_rng_state()),  # noqa: NPY002
    }
    with whole_file(run.model) as temporary:
        model.save(temporary)
        with zipfile.ZipFile(temporary, "a") as archive:
            archive.writestr("run.json", json.dumps(asked_for(run)))
            archive.writestr("training_state.pkl", pickle.dumps(state))
            if normalize:
                archive.writestr("vecnormalize.pkl", pickle.dumps(normalize))
    save_agent(run.agent, model)


def load_checkpoint(run: Run, env: StaggeredMonitor, recorder: Recorder) -> BaseAlgorithm:
    """Restore an agent and everything around it as :func:`save_checkpoint` found it.

    Raises
    ------
    ConfigError
        If the checkpoint is damaged, or of another run.
    """
    try:
        with zipfile.ZipFile(run.model) as archive:
            if damaged := archive.testzip():
                raise ConfigError(f"{run.model}: {damaged} in it is damaged")
            whose = json.loads(archive.read("run.json")) if "run.json" in archive.namelist() else None
            if whose is not None:
                check_same(run, whose)
            state = pickle.loads(archive.read("training_state.pkl"))
            normalize = (
                pickle.loads(archive.read("vecnormalize.pkl")) if network_config(run).normalize else None
            )
        return _restore(run, env, recorder, state, normalize, exact=whose is not None)
    except (ConfigError, MemoryError):
        raise
    except Exception as error:  # it may be any file, and be wrong in any way
        reason = " ".join(str(error).split()) or type(error).__name__
        raise ConfigError(
            f"{run.model}: this is not a checkpoint of this run: {reason}. "
            "Restore it from a copy, or start a new run"
        ) from error


def _restore(
    run: Run,
    env: StaggeredMonitor,
    recorder: Recorder,
    state: dict[str, Any],
    normalize: VecNormalize | None,
    exact: bool,
) -> BaseAlgorithm:
    """Put what `load_checkpoint` read into the algorithm."""
    if normalize:
        normalize.set_venv(env)
    if not exact:
        print("the checkpoint is of springgym 0.1.0: the episodes under way start anew")
    elif state["env"] is None:
        print(f"{run.env_id} cannot save its state: the episodes under way start anew")
        exact = False
    else:
        native_env(env).set_state(state["env"])
        env.episode_returns, env.episode_lengths, env.episode_count, *shortened = state["monitor"]
        if shortened:  # checkpoints from before copies were staggered have no such array
            (env.shortened,) = shortened
        if normalize:
            normalize.returns = state["discounted_returns"]
    model = ALGORITHMS[run.algo].load(run.model, env=normalize or env, device="cpu", force_reset=not exact)
    if isinstance(model, OffPolicyAlgorithm):
        model.replay_buffer = state["replay_buffer"]
        if isinstance(model.replay_buffer, HerReplayBuffer):
            model.replay_buffer.set_env(normalize or env)
    logger = make_logger(run, model.num_timesteps)
    values, counts, excluded = state["logger"]
    logger.name_to_value.update(values)
    logger.name_to_count.update(counts)
    logger.name_to_excluded.update(excluded)
    model.set_logger(logger)
    recorder.restore(state["recorder"])
    python_state, numpy_state, torch_state = state["random"]
    random.setstate(python_state)
    np.random.set_state(numpy_state)  # noqa: NPY002
    torch.set_rng_state(torch_state)
    return model


def asked_for(run: Run) -> dict[str, Any]:
    """Return the settings of a run, in the form that JSON has."""
    asked = {"algo": run.algo, "env_id": run.env_id, "seed": run.seed, **asdict(run.config)}
    return dict(json.loads(json.dumps(asked, default=str)))


def check_same(run: Run, whose: dict[str, Any]) -> None:
    """Refuse a ``config.yaml`` that says something else than when the checkpoint was made.

    Raises
    ------
    ConfigError
        Naming what differs.
    """
    for key, value in asked_for(run).items():
        if key not in MAY_CHANGE and whose.get(key) != value:
            raise ConfigError(
                f"{run.folder / 'config.yaml'}: {key} is {value!r}, but the checkpoint was made with "
                f"{whose.get(key)!r}. A run cannot change this: restore the value, or start a new run"
            )
