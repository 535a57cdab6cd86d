"""Take the first steps that need no extra, in an empty folder, with the springgym that is installed.

    python tools/first_steps.py                             # one step of SpringTop-v0
    python tools/first_steps.py SpringTumble-v0 SpringDuel-v0

It makes every environment, takes a step in the named ones, lets a published agent act, and lists the scenes.
"""

from __future__ import annotations

import math
import sys
from importlib.metadata import version

import gymnasium as gym

import springgym
from springgym.cli import main
from springgym.envs.registration import ENVIRONMENTS

if __name__ == "__main__":
    for package in ("springgym", "gymnasium", "numpy", "numba", "pyyaml", "tqdm"):
        print(f"{package} {version(package)}", end="  ", flush=True)
    print(f"Python {sys.version.split()[0]}")
    assert "site-packages" in springgym.__file__, springgym.__file__
    assert main(["simulate", "--list"]) == 0
    for name in sys.argv[1:] or ["SpringTop-v0"]:
        env = gym.make(name)
        env.reset(seed=0)
        reward = float(env.step(env.action_space.sample())[1])
        assert math.isfinite(reward), name
        print(f"{name}: reward {reward:.3f}", flush=True)
    agent = springgym.load_agent("SpringTop-v0")
    env = agent.make()
    policy = agent.policy(env)
    observation, _ = env.reset(seed=0)
    assert float(env.step(policy(observation))[1]) > 0
    for row in ENVIRONMENTS:
        gym.make(row.id)
    print(f"{len(ENVIRONMENTS)} environments, and an agent")
