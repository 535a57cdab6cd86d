"""Stable-Baselines3 adapter: a natively vectorised Gymnasium environment as an SB3 ``VecEnv``.

SB3's own ``DummyVecEnv`` steps single environments in a Python loop. This adapter hands the whole
batch to the native vector environment, so Python works only for the copies whose episode ended.
"""

from __future__ import annotations

import warnings
from collections.abc import Mapping, Sequence
from copy import deepcopy
from importlib import import_module
from typing import Any, ClassVar

import gymnasium as gym
import numpy as np
from gymnasium.envs.registration import EnvSpec
from gymnasium.vector import AutoresetMode, VectorEnv

from springgym.extras import missing

try:
    from stable_baselines3.common.vec_env import VecEnv, VecMonitor
    from stable_baselines3.common.vec_env.base_vec_env import (
        VecEnvIndices,
        VecEnvObs,
        VecEnvStepReturn,
    )
except ImportError as error:
    raise ImportError(missing("springgym.envs.sb3", "Stable-Baselines3", "agents")) from error

from springgym.envs.base import SpringVectorEnv, Stateful, _check_keys, _own, get_state, set_state
from springgym.envs.starts import spawned

__all__ = ["Monitor", "SB3VecEnv", "StaggeredMonitor", "make_sb3"]


class SB3VecEnv(Stateful, VecEnv):
    """Show a Gymnasium vector environment of ``n`` copies as a Stable-Baselines3 ``VecEnv``.

    ``step`` returns observations ``(n, ...)``, rewards ``(n,)`` float32, dones ``(n,)`` bool and a
    list of ``n`` dicts. All arrays are the caller's own. The dict of a running copy is empty;
    that of a copy whose episode just ended holds the last info of the episode (``is_success``,
    reward terms, ...) and what SB3 asks for: ``terminal_observation``, the observation before the
    reset, and ``TimeLimit.truncated``, true where the episode was cut and not terminated.

    The copies are rows of one object. So :meth:`get_attr`, :meth:`set_attr` and
    :meth:`env_method` act on that object: a value read is the same for every copy, and a value
    cannot be set for some copies only.

    Parameters
    ----------
    vector_env
        Environment with ``metadata["autoreset_mode"]`` ``SAME_STEP``, which is how SB3 resets.

    Raises
    ------
    TypeError
        If ``vector_env`` is not a Gymnasium ``VectorEnv``.
    ValueError
        If it resets in another mode.
    """

    def __init__(self, vector_env: VectorEnv) -> None:
        if not isinstance(vector_env, VectorEnv):
            raise TypeError(
                f"SB3VecEnv wraps a gymnasium.vector.VectorEnv, got {type(vector_env).__name__}; "
                "make one with gymnasium.make_vec"
            )
        mode = vector_env.metadata.get("autoreset_mode")
        if mode != AutoresetMode.SAME_STEP:
            raise ValueError(
                f"SB3VecEnv needs autoreset_mode=AutoresetMode.SAME_STEP, but {vector_env} has "
                f"{mode}; pass it to gymnasium.make_vec, or use springgym.envs.sb3.make_sb3"
            )
        self.vector_env = vector_env
        super().__init__(
            vector_env.num_envs,
            vector_env.single_observation_space,
            vector_env.single_action_space,
        )

    def seed(self, seed: int | Sequence[int] | None = None) -> Sequence[int | None]:
        """Seed the copies for the next reset.

        Parameters
        ----------
        seed
            Of one number every copy gets a seed of its own, which no copy gets of another number:
            `springgym.envs.starts.spawned`. (Stable-Baselines3's own environments count on from the number:
            copies of neighbouring ones begin alike.) A sequence has the seed of each copy. None draws the
            number.

        Raises
        ------
        ValueError
            If a sequence has not one for each copy.
        """
        if isinstance(seed, Sequence):
            if len(seed) != self.num_envs:
                raise ValueError(f"{len(seed)} seeds were given for {self.num_envs} copies")
            self._seeds = list(seed)
        else:
            self._seeds = [*spawned(super().seed(seed)[0], self.num_envs)]  # type: ignore[arg-type]
        return self._seeds

    def reset(self) -> VecEnvObs:
        """Start a new episode in every copy, with the seeds and options set since the last one."""
        seeds = None if all(seed is None for seed in self._seeds) else list(self._seeds)
        options = self._options[0]
        if any(other != options for other in self._options):
            raise ValueError("SB3VecEnv resets all copies with the same options; set one dict")
        # VectorEnv.reset is annotated with one seed, but every vector environment takes a list.
        observations, infos = self.vector_env.reset(seed=seeds, options=options or None)  # type: ignore[arg-type]
        self.reset_infos = [_info_of(infos, i) for i in range(self.num_envs)]
        self._reset_seeds()
        self._reset_options()
        return deepcopy(observations)

    def step_async(self, actions: np.ndarray) -> None:
        """Keep the actions ``(n, ...)`` for :meth:`step_wait`."""
        self._actions = actions

    def step_wait(self) -> VecEnvStepReturn:
        """Step every copy; those that end are reset, and the first observation returned."""
        observations, rewards, terminated, truncated, infos = self.vector_env.step(self._actions)
        dones = terminated | truncated
        sb3_infos: list[dict[str, Any]] = [{} for _ in range(self.num_envs)]
        new_episode = {k: v for k, v in infos.items() if not k.endswith(("final_obs", "final_info"))}
        for i in np.flatnonzero(dones).tolist():
            info = _info_of(infos.get("final_info", {}), i)
            info["terminal_observation"] = deepcopy(infos["final_obs"][i])
            info["TimeLimit.truncated"] = bool(truncated[i] and not terminated[i])
            sb3_infos[i] = info
            self.reset_infos[i] = _info_of(new_episode, i)
        return deepcopy(observations), np.array(rewards, dtype=np.float32), dones, sb3_infos

    @property
    def _unready(self) -> str:
        return _own(self.vector_env)._unready

    def get_state(self) -> dict[str, Any]:
        """Return the state of the vector environment, see `springgym.get_state`."""
        return get_state(self.vector_env)

    def set_state(self, state: Mapping[str, Any]) -> None:
        """Return to a state, see `springgym.set_state`."""
        set_state(self.vector_env, state)

    def close(self) -> None:
        """Close the vector environment."""
        self.vector_env.close()

    def get_attr(self, attr_name: str, indices: VecEnvIndices = None) -> list[Any]:
        """Return the vector environment's attribute, once for each copy asked for."""
        value = getattr(self.vector_env, attr_name)
        return [value for _ in self._get_indices(indices)]

    def set_attr(self, attr_name: str, value: object, indices: VecEnvIndices = None) -> None:
        """Set the vector environment's attribute, which all copies share.

        Raises
        ------
        ValueError
            If ``indices`` leaves out a copy.
        """
        if sorted(self._get_indices(indices)) != list(range(self.num_envs)):
            raise ValueError(
                f"cannot set {attr_name!r} for copies {indices} only: all {self.num_envs} copies "
                "share one environment; leave out indices"
            )
        setattr(self.vector_env, attr_name, value)

    def env_method(
        self,
        method_name: str,
        *method_args: object,
        indices: VecEnvIndices = None,
        **method_kwargs: object,
    ) -> list[Any]:
        """Call the vector environment's method once; return its result for each copy asked for."""
        result = getattr(self.vector_env, method_name)(*method_args, **method_kwargs)
        return [result for _ in self._get_indices(indices)]

    def env_is_wrapped(self, wrapper_class: type[gym.Wrapper], indices: VecEnvIndices = None) -> list[bool]:
        """Return false for each copy: a native copy has no wrappers of its own."""
        return [False for _ in self._get_indices(indices)]

    def get_images(self) -> Sequence[np.ndarray | None]:
        """Return one RGB frame ``(height, width, 3)`` of each copy."""
        frames: Any = self.vector_env.render()
        return [None] * self.num_envs if frames is None else list(frames)


class Monitor(Stateful, VecMonitor):
    """A `VecMonitor` that returns to a state with what it monitors: episodes are reported as they went on."""

    counted: ClassVar[tuple[str, ...]] = ("episode_returns", "episode_lengths")
    """arrays (n,) of what it remembers of the copies"""

    @property
    def _unready(self) -> str:
        return _own(self.venv)._unready

    def get_state(self) -> dict[str, Any]:
        """Return the state of the vector environment, and the counts of the monitor."""
        return {"env": get_state(self.venv)} | {name: getattr(self, name).copy() for name in self.counted}

    def set_state(self, state: Mapping[str, Any]) -> None:
        """Return to a state, to the bit: what follows is what followed.

        Raises
        ------
        ValueError
            If the state is not one of this environment. Nothing is changed then.
        """
        _check_keys(state, ("env", *self.counted))
        for name in self.counted:
            given, own = np.asarray(state[name]), getattr(self, name)
            if given.shape != own.shape or given.dtype != own.dtype:
                raise ValueError(
                    f"state[{name!r}] is {given.dtype} of shape {given.shape}; it must be {own.dtype} of "
                    f"shape {own.shape}"
                )
        set_state(self.venv, state["env"])
        for name in self.counted:
            getattr(self, name)[:] = state[name]


class StaggeredMonitor(Monitor):
    """Monitor copies that do not all reach their time limit in the same step.

    Copies that start together and run for as long as their time limit end together, again and again: each
    batch that an algorithm learns from then holds the same part of all episodes. Here a reset starts the
    clock of copy i of n at i/n of the time limit, so that its first episode is cut that much earlier. What
    the copies see, and how they are rewarded, is as it was. Such a shortened episode would be reported with
    too small a return: it ends without ``info["episode"]`` and without ``info["is_success"]``.

    Copies of an environment that is not a native batch of springgym, or has no time limit, start together.
    """

    counted = (*Monitor.counted, "shortened")

    def __init__(self, venv: SB3VecEnv) -> None:
        super().__init__(venv)
        self.shortened = np.zeros(venv.num_envs, bool)
        """Copies whose clock did not start at 0."""

    def reset(self) -> VecEnvObs:
        """Start a new episode in every copy, with its clock at its share of the time limit."""
        observations = super().reset()
        native = self.unwrapped.vector_env  # type: ignore[attr-defined]
        if isinstance(native, SpringVectorEnv) and native.episodes.max_episode_steps > 0:
            elapsed = np.arange(self.num_envs) * native.episodes.max_episode_steps // self.num_envs
            native.episodes.elapsed[:] = elapsed
            self.shortened = elapsed > 0
        return observations

    def step_wait(self) -> VecEnvStepReturn:
        """Step every copy; shortened episodes end without a report."""
        observations, rewards, dones, infos = super().step_wait()
        for i in np.flatnonzero(dones & self.shortened):
            infos[i] = {k: v for k, v in infos[i].items() if k not in ("episode", "is_success")}
            self.shortened[i] = False
        return observations, rewards, dones, infos


def make_sb3(
    env_id: str | EnvSpec,
    num_envs: int,
    seed: int | None = None,
    *,
    stagger: bool = False,
    env_kwargs: Mapping[str, Any] | None = None,
    **kwargs: Any,
) -> Monitor:
    """Make ``num_envs`` copies of an environment for Stable-Baselines3: native ones if it has them.

    Without them it warns that single environments are stepped one after the other, which is slow.

    Parameters
    ----------
    env_id
        Registered environment, or a spec as that of `springgym.make_scene_env`. It has native copies if it
        was registered with a ``vector_entry_point``, which takes ``autoreset_mode``.
    num_envs
        Number of copies.
    seed
        Of the first episodes, see `SB3VecEnv.seed`: runs of different seeds share no start. None draws them.
    stagger
        Spread the ends of the episodes over time, see `StaggeredMonitor`: for training, not for evaluation.
    env_kwargs
        Arguments of the environment, whatever their names.
    **kwargs
        More of them.

    Returns
    -------
    Monitor
        The adapted environment; finished episodes carry ``info["episode"]``.

    Examples
    --------
    >>> env = make_sb3("SpringTop-v0", num_envs=64, seed=0)
    >>> model = stable_baselines3.PPO("MlpPolicy", env).learn(100_000)
    """
    mode: dict[str, Any] = {"autoreset_mode": AutoresetMode.SAME_STEP}
    if _has_native_copies(env_id):
        mode |= {"vectorization_mode": "vector_entry_point"}
    else:
        name = env_id.id if isinstance(env_id, EnvSpec) else env_id
        warnings.warn(
            f"{name} was registered without a vector_entry_point: its copies are stepped one after the "
            "other, and not in one compiled call",
            stacklevel=2,
        )
        mode = {"vectorization_mode": "sync", "vector_kwargs": mode}
    vector_env = gym.make_vec(env_id, num_envs=num_envs, **mode, **(env_kwargs or {}), **kwargs)
    env = (StaggeredMonitor if stagger else Monitor)(SB3VecEnv(vector_env))
    if seed is not None:
        env.seed(seed)
    return env


def _has_native_copies(env_id: str | EnvSpec) -> bool:
    if isinstance(env_id, EnvSpec):
        return env_id.vector_entry_point is not None
    module, _, name = env_id.rpartition(":")
    if module:
        import_module(module)
    return name not in gym.registry or gym.registry[name].vector_entry_point is not None


def _info_of(infos: dict[str, Any], i: int) -> dict[str, Any]:
    """Copy ``i``'s entries of Gymnasium's batched infos: ``{"key": (n,), "_key": mask}``."""
    info = {}
    for key, values in infos.items():
        if key.startswith("_") and key[1:] in infos:
            continue
        if f"_{key}" in infos and not infos[f"_{key}"][i]:
            continue
        if isinstance(values, dict):
            info[key] = _info_of(values, i)
        else:
            value = values[i]
            info[key] = value.item() if isinstance(value, np.generic) else deepcopy(value)
    return info
