"""A task learnt in seconds: push a point on a line to the origin and hold it there.

``Toy-v0`` saves its state, ``ToyForgetful-v0`` cannot; both are natively vectorised, and the
single environment is a row of the vector one.
"""

from __future__ import annotations

import copy
import os
import signal
from typing import ClassVar

import gymnasium as gym
import numpy as np
from gymnasium.vector import AutoresetMode, VectorEnv
from gymnasium.vector.utils import batch_space

LIMIT = 40

# For the tests of stopping: press Ctrl-C, or be killed, at this call of step.
interrupt_at: int | None = None
KILL_AT = os.environ.get("TOY_KILL_AT")


class ForgetfulToyVectorEnv(VectorEnv):
    def __init__(
        self,
        num_envs: int = 1,
        max_episode_steps: int = LIMIT,
        autoreset_mode: AutoresetMode = AutoresetMode.SAME_STEP,
        render_mode: str | None = None,
        push: float = 0.2,
        observation: str = "particles",
    ) -> None:
        assert observation in ("particles", "features")
        self.metadata = {"autoreset_mode": autoreset_mode, "render_fps": 25}
        self.num_envs = num_envs
        self.limit = max_episode_steps
        self.push = push
        self.render_mode = render_mode
        self.single_observation_space = gym.spaces.Box(-10.0, 10.0, (2,), np.float32)
        self.single_action_space = gym.spaces.Box(-1.0, 1.0, (1,), np.float32)
        self.observation_space = batch_space(self.single_observation_space, num_envs)
        self.action_space = batch_space(self.single_action_space, num_envs)
        self.rngs = [np.random.default_rng() for _ in range(num_envs)]
        self.state = np.zeros((num_envs, 2))
        self.clock = np.zeros(num_envs, dtype=np.int64)
        self.buffer = np.zeros((num_envs, 2), np.float32)
        self.calls = 0

    def _start(self, copies):
        for i in copies:
            self.state[i] = self.rngs[i].uniform(-1.0, 1.0), 0.0
            self.clock[i] = 0

    def _observe(self):
        self.buffer[:] = self.state  # reused on purpose: a caller must copy
        return self.buffer

    def reset(self, *, seed=None, options=None):
        seeds = seed if isinstance(seed, list) else [seed] * self.num_envs
        for i, one in enumerate(seeds):
            if one is not None:
                self.rngs[i] = np.random.default_rng(one)
        self._start(range(self.num_envs))
        return self._observe(), {}

    def step(self, actions):
        self.calls += 1
        if self.calls == interrupt_at:
            raise KeyboardInterrupt
        if str(self.calls) == KILL_AT:
            os.kill(os.getpid(), signal.SIGKILL)
        position, speed = self.state.T
        speed = speed + self.push * np.clip(actions[:, 0], -1.0, 1.0)
        self.state = np.column_stack([position + 0.2 * speed, 0.95 * speed])
        self.clock += 1
        distance = np.abs(self.state[:, 0])
        reward = 1.0 / (1.0 + 9.0 * distance**2)
        terminated = distance > 2.0
        truncated = self.clock >= self.limit
        infos = {}
        done = terminated | truncated
        if done.any():
            final_obs = np.full(self.num_envs, None, dtype=object)
            for i in np.flatnonzero(done):
                final_obs[i] = self._observe()[i].copy()
            infos = {
                "final_obs": final_obs,
                "_final_obs": done,
                "final_info": {
                    "is_success": (distance < 0.1) & truncated,
                    "_is_success": done,
                    "distance": distance,
                    "_distance": done,
                },
                "_final_info": done,
            }
            self._start(np.flatnonzero(done))
        return self._observe(), reward, terminated, truncated, infos

    def render(self):
        return tuple(np.full((32, 32, 3), 40 * i, np.uint8) for i in range(self.num_envs))


class ToyVectorEnv(ForgetfulToyVectorEnv):
    def get_state(self):
        return copy.deepcopy((self.rngs, self.state, self.clock))

    def set_state(self, state):
        self.rngs, self.state, self.clock = copy.deepcopy(state)


class ToyEnv(gym.Env):
    metadata: ClassVar = {"render_modes": ["rgb_array"], "render_fps": 25}

    def __init__(self, render_mode: str | None = None, **kwargs) -> None:
        self.render_mode = render_mode
        self.row = ToyVectorEnv(1, render_mode=render_mode, **kwargs)
        self.observation_space = self.row.single_observation_space
        self.action_space = self.row.single_action_space

    def reset(self, *, seed=None, options=None):
        super().reset(seed=seed)
        observations, _ = self.row.reset(seed=seed)
        self.position = observations[0, 0]
        return observations[0].copy(), {}

    def step(self, action):
        observations, rewards, terminated, truncated, infos = self.row.step(action[None])
        over = bool(terminated[0] or truncated[0])
        observation = infos["final_obs"][0] if over else observations[0].copy()
        self.position = observation[0]
        return observation, float(rewards[0]), bool(terminated[0]), bool(truncated[0]), {}

    def render(self):
        pixels = np.zeros((32, 64, 3), np.uint8)
        pixels[:, int(np.clip(16 * self.position + 32, 0, 63))] = 255
        return pixels


for name, vector in (("Toy-v0", ToyVectorEnv), ("ToyForgetful-v0", ForgetfulToyVectorEnv)):
    gym.register(name, entry_point=ToyEnv, vector_entry_point=vector, max_episode_steps=LIMIT)
