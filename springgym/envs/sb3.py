"""Stable-Baselines3 adapter: a natively vectorised Gymnasium environment as an SB3 ``VecEnv``.

SB3's own ``DummyVecEnv`` steps single environments in a Python loop. This adapter steps the whole batch by
the native vector environment, so that Python code runs only for copies whose episodes have ended.
"""

from __future__ import annotations

import math
import warnings
from collections.abc import Mapping, Sequence
from copy import deepcopy
from importlib import import_module
from inspect import signature
from typing import Any, ClassVar

import gymnasium as gym
import numpy as np
from gymnasium.envs.registration import EnvSpec, load_env_creator
from gymnasium.vector import AutoresetMode, VectorEnv

from springgym.checks import flag, instance, whole
from springgym.core.extras import missing

try:
    from stable_baselines3.common.vec_env import VecEnv, VecMonitor
    from stable_baselines3.common.vec_env.base_vec_env import VecEnvIndices, VecEnvObs, VecEnvStepReturn
except ImportError as error:
    raise ImportError(missing("springgym.envs.sb3", "Stable-Baselines3", "agents")) from error

from springgym.envs.base import SpringVectorEnv, Stateful, get_state, holder, set_state
from springgym.envs.options import mapping
from springgym.envs.starts import spawn_seeds
from springgym.model.identity import check_array, check_keys

__all__ = ["Monitor", "SB3VecEnv", "StaggeredMonitor", "make_sb3"]


class SB3VecEnv(Stateful, VecEnv):
    """Wraps a Gymnasium vector environment of ``n`` copies as a Stable-Baselines3 ``VecEnv``.

    ``step`` returns observations ``(n, ...)``, rewards ``(n,)`` float32, dones ``(n,)`` bool and a
    list of ``n`` dicts. The caller owns all arrays. The dict of a running copy is empty. If the
    episode of a copy has just ended, its dict holds the last info of the episode (``is_success``,
    reward terms, ...) and two entries for SB3: ``terminal_observation``, the observation before the
    reset, and ``TimeLimit.truncated``, true if the episode was truncated and not terminated.

    The copies are rows of one object, and :meth:`get_attr`, :meth:`set_attr` and :meth:`env_method` act
    on that object. So all copies return the same value, and you cannot set a value for some copies only.

    Parameters
    ----------
    vector_env
        Environment whose ``metadata["autoreset_mode"]`` is ``SAME_STEP``, as SB3 requires.

    Raises
    ------
    TypeError
        If ``vector_env`` is not a Gymnasium ``VectorEnv``.
    ValueError
        If it has another autoreset mode.
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
            vector_env.num_envs, vector_env.single_observation_space, vector_env.single_action_space
        )

    def seed(self, seed: int | Sequence[int] | None = None) -> Sequence[int | None]:
        """Seed the copies for the next reset.

        Parameters
        ----------
        seed
            From one number, `springgym.envs.starts.spawn_seeds` makes a seed for every copy. Copies seeded
            from different numbers never share a seed. (In Stable-Baselines3's own environments, copy i gets
            the number plus i, so runs of neighbouring numbers share starts.) A sequence holds the seed of
            each copy. None draws the number.

        Raises
        ------
        ValueError
            If a sequence has another length than there are copies.
        """
        if isinstance(seed, Sequence):
            if len(seed) != self.num_envs:
                raise ValueError(f"{len(seed)} seeds were given for {self.num_envs} environments")
            self._seeds = list(seed)
        else:
            self._seeds = [*spawn_seeds(super().seed(seed)[0], self.num_envs)]  # type: ignore[arg-type]
        return self._seeds

    def reset(self) -> VecEnvObs:
        """Start a new episode in every copy, with the seeds and options that were set since the last
        reset."""
        seeds = None if all(seed is None for seed in self._seeds) else list(self._seeds)
        options = self._options[0]
        if any(other != options for other in self._options):
            raise ValueError("SB3VecEnv resets all environments with the same options; give a single dict")
        # VectorEnv.reset is annotated with one seed, but every vector environment takes a list.
        observations, infos = self.vector_env.reset(seed=seeds, options=options or None)  # type: ignore[arg-type]
        self.reset_infos = [_info_of(infos, i) for i in range(self.num_envs)]
        self._reset_seeds()
        self._reset_options()
        return deepcopy(observations)

    def step_async(self, actions: np.ndarray) -> None:
        """Store the actions ``(n, ...)`` for :meth:`step_wait`."""
        self._actions = actions

    def step_wait(self) -> VecEnvStepReturn:
        """Step every copy. If an episode ends, reset the copy and return its first observation."""
        observations, rewards, terminated, truncated, infos = self.vector_env.step(self._actions)
        dones = terminated | truncated
        sb3_infos: list[dict[str, Any]] = [{} for _ in range(self.num_envs)]
        ended = np.flatnonzero(dones).tolist()
        if ended:
            new_episode = {k: v for k, v in infos.items() if not k.endswith(("final_obs", "final_info"))}
        for i in ended:
            info = _info_of(infos.get("final_info", {}), i)
            info["terminal_observation"] = deepcopy(infos["final_obs"][i])
            info["TimeLimit.truncated"] = bool(truncated[i] and not terminated[i])
            sb3_infos[i] = info
            self.reset_infos[i] = _info_of(new_episode, i)
        return deepcopy(observations), np.array(rewards, dtype=np.float32), dones, sb3_infos

    @property
    def _unready(self) -> str:
        return holder(self.vector_env)._unready

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
        """Return the vector environment's attribute, once for each requested copy."""
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
                f"cannot set {attr_name!r} for environments {indices} only: all {self.num_envs} share one "
                "object; leave out indices"
            )
        setattr(self.vector_env, attr_name, value)

    def env_method(
        self, method_name: str, *method_args: object, indices: VecEnvIndices = None, **method_kwargs: object
    ) -> list[Any]:
        """Call the vector environment's method once; return its result for each requested copy."""
        result = getattr(self.vector_env, method_name)(*method_args, **method_kwargs)
        return [result for _ in self._get_indices(indices)]

    def env_is_wrapped(self, wrapper_class: type[gym.Wrapper], indices: VecEnvIndices = None) -> list[bool]:
        """Return false for each copy: a native copy has no wrappers."""
        return [False for _ in self._get_indices(indices)]

    def get_images(self) -> Sequence[np.ndarray | None]:
        """Return one RGB frame ``(height, width, 3)`` of each copy."""
        frames: Any = self.vector_env.render()
        return [None] * self.num_envs if frames is None else list(frames)


class Monitor(Stateful, VecMonitor):
    """A `VecMonitor` whose counts are part of the state, so that episodes are reported correctly
    afterwards."""

    counted: ClassVar[tuple[str, ...]] = ("episode_returns", "episode_lengths")
    """names of the arrays (n,) with its counts for each copy"""

    @property
    def _unready(self) -> str:
        return holder(self.venv)._unready

    def get_state(self) -> dict[str, Any]:
        """Return the state of the vector environment, and the counts of the monitor."""
        counts = {name: getattr(self, name).copy() for name in self.counted}
        return {"env": get_state(self.venv), **counts}

    def set_state(self, state: Mapping[str, Any]) -> None:
        """Restore a state exactly: the same actions then give bit-identical results.

        Raises
        ------
        TypeError, ValueError
            If the state is not one of this environment, or holds what no state can. Nothing is changed then.
        """
        check_keys("state", state, ("env", *self.counted))
        for name in self.counted:
            own = getattr(self, name)
            check_array(name, state[name], own.shape, own.dtype)
        set_state(self.venv, state["env"])
        for name in self.counted:
            getattr(self, name)[:] = state[name]


class StaggeredMonitor(Monitor):
    """A monitor for copies that reach their time limit at different steps.

    Copies that start together and run until their time limit also end together. Each batch that an algorithm
    learns from then contains the same part of all episodes. Here, a reset starts the clock of copy i of n at
    i/n of the time limit, so its first episode is truncated earlier. Observations and rewards do not change.
    The return of such a shortened episode would be too small, so it ends without ``info["episode"]`` and
    without ``info["is_success"]``.

    Copies start together if the environment is not a native batch of springgym, or has no time limit.
    """

    counted = (*Monitor.counted, "shortened")

    def __init__(self, venv: SB3VecEnv) -> None:
        super().__init__(venv)
        self.shortened = np.zeros(venv.num_envs, bool)
        """Copies whose clock did not start at 0."""

    def reset(self) -> VecEnvObs:
        """Start a new episode in every copy, and set the clocks to different fractions of the time limit."""
        observations = super().reset()
        native = self.unwrapped.vector_env  # type: ignore[attr-defined]
        if isinstance(native, SpringVectorEnv) and native.episodes.max_episode_steps > 0:
            elapsed = np.arange(self.num_envs) * native.episodes.max_episode_steps // self.num_envs
            native.episodes.elapsed[:] = elapsed
            self.shortened = elapsed > 0
        return observations

    def step_wait(self) -> VecEnvStepReturn:
        """Step every copy. Shortened episodes are not reported."""
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
    """Make ``num_envs`` copies of an environment for Stable-Baselines3, as a native batch if possible.

    If the environment has no native batch, this warns that single environments run one after another, which
    is slow.

    Parameters
    ----------
    env_id
        Id of a registered environment, or a spec as that of `springgym.make_scene_env`. The environment has a
        native batch if it was registered with a ``vector_entry_point`` that takes ``autoreset_mode``.
    num_envs
        Number of copies.
    seed
        Seed of the first episodes, see `SB3VecEnv.seed`. Runs of different seeds share no start. None draws
        a seed.
    stagger
        Whether to spread the ends of episodes over time, see `StaggeredMonitor`. Use it for training, not
        for evaluation.
    env_kwargs
        Arguments of the environment. Use this for names that `make_sb3` takes itself.
    **kwargs
        Further arguments of the environment.

    Returns
    -------
    Monitor
        The adapted environment. Finished episodes have ``info["episode"]``.

    Raises
    ------
    TypeError, ValueError
        If an argument has the wrong type or value; the message names it.

    Examples
    --------
    >>> env = make_sb3("SpringTop-v0", num_envs=64, seed=0)
    >>> model = stable_baselines3.PPO("MlpPolicy", env).learn(100_000)
    """
    instance("env_id", env_id, str, EnvSpec)
    num_envs = whole("num_envs", num_envs, 1)
    seed = None if seed is None else whole("seed", seed, high=math.inf)
    stagger = flag("stagger", stagger)
    mapping("env_kwargs", {} if env_kwargs is None else env_kwargs)
    mode: dict[str, Any] = {"autoreset_mode": AutoresetMode.SAME_STEP}
    if _has_native_copies(env_id):
        mode |= {"vectorization_mode": "vector_entry_point"}
    else:
        name = env_id.id if isinstance(env_id, EnvSpec) else env_id
        warnings.warn(
            f"{name} was registered without a vector_entry_point that takes autoreset_mode: environments run "
            "one after another, and not in one compiled call",
            stacklevel=2,
        )
        mode = {"vectorization_mode": "sync", "vector_kwargs": mode}
    vector_env = gym.make_vec(env_id, num_envs=num_envs, **mode, **(env_kwargs or {}), **kwargs)
    env = (StaggeredMonitor if stagger else Monitor)(SB3VecEnv(vector_env))
    if seed is not None:
        env.seed(seed)
    return env


def _has_native_copies(env_id: str | EnvSpec) -> bool:
    """Return whether an environment has a native batch with the autoreset that SB3 requires.

    Gymnasium's own batches, as that of CartPole, take no ``autoreset_mode``. For an unknown id the result is
    True, so that Gymnasium raises its error.
    """
    spec: EnvSpec | None
    if isinstance(env_id, EnvSpec):
        spec = env_id
    else:
        module, _, name = env_id.rpartition(":")
        if module:
            import_module(module)
        spec = gym.registry.get(name)
    if spec is None:
        return True
    entry = spec.vector_entry_point
    if entry is None:
        return False
    taken = signature(load_env_creator(entry) if isinstance(entry, str) else entry).parameters.values()
    return any(one.name == "autoreset_mode" or one.kind is one.VAR_KEYWORD for one in taken)


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
