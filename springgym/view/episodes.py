"""Episodes of environments as motions, with a trained agent, random actions or no actions."""

from __future__ import annotations

from typing import Any

import gymnasium as gym
import numpy as np

import springgym.envs.registration
from springgym.checks import counted
from springgym.dynamics import measures
from springgym.envs.agent import Policy, alone
from springgym.envs.registration import spec_of
from springgym.envs.trained import Agent, load_agent
from springgym.scenes import film
from springgym.scenes.graphs import graphs
from springgym.scenes.recording import contacts_of
from springgym.view.motion import Motion, lacking, touches
from springgym.view.page import Changes, Subject

INTERVAL = 5e-3
"""Longest time between two states [s]: control periods are too long to show a spin."""
SEEDS = 20
"""Number of episodes to choose from."""


def episodes(agent: Agent, first: int) -> Subject:
    """Return a subject with episodes of an agent from consecutive seeds."""
    names = [f"seed {first + n}" for n in range(SEEDS)]

    def make(name: str, changes: Changes) -> Motion:
        return played(agent, int(name.split()[1]))

    return Subject("episode", names, make, lambda name: ())


def find_agent(agent: str | None, env_id: str) -> Agent:
    """Find an agent by name.

    Parameters
    ----------
    agent
        A run folder, or the id of a published agent's environment, which also determine the environment; or
        "noop" or None, or "random".
    env_id
        Id of the environment for "noop", None and "random".

    Raises
    ------
    ValueError
        If there is no such agent.
    """
    springgym.envs.registration.register()
    if agent in (None, "noop", "random"):
        spec_of(env_id)
    if agent in (None, "noop"):
        return Agent("no action", env_id, {}, _zero)
    if agent == "random":
        return Agent("random actions", env_id, {}, _random)
    if agent == "classical":
        raise ValueError(
            "springgym view does not show classical control; use "
            f"springgym watch classical --env {env_id} --browser"
        )
    found = load_agent(agent)
    if ":" in found.env_id and found.env_id != env_id:
        raise ValueError(f"{agent} names a module to import; to allow this, pass {found.env_id}, too")
    return found


def _zero(env: gym.Env) -> Policy:
    return lambda observations: np.zeros((len(observations), *env.action_space.shape), np.float32)  # type: ignore[misc]


def _random(env: gym.Env) -> Policy:
    env.action_space.seed(0)
    return lambda observations: np.stack([env.action_space.sample() for _ in observations])


SUCCESS = {True: "success · ", False: "no success · ", None: ""}
"""Part of the summary of an episode, by whether it succeeded; None if its task has no aim."""

ACTUATORS = ("terms.wrench.", "terms.thrust.", "terms.drive.")
"""Prefixes of the values that actions set, in the state of a simulator."""


def played(agent: Agent, seed: int) -> Motion:
    """Return the motion of one episode of an agent."""
    try:
        env = gym.make(agent.env_id, **agent.env_kwargs)
    except gym.error.Error as error:
        raise ValueError(f"{agent.env_id}: {error}") from error
    if env.spec is None or env.spec.max_episode_steps is None:
        raise ValueError(f"{agent.env_id} has no time limit: register it with max_episode_steps")
    inner: Any = env.unwrapped
    if not hasattr(inner, "episodes"):
        raise ValueError(f"{agent.env_id} is not a springgym environment")
    policy = agent.policy(env)
    task = inner.episodes.task
    simulator = inner.episodes.simulator
    observation, info = env.reset(seed=seed)
    every = simulator.damping_every
    cycles = inner.episodes.steps // every
    parts = min(cycles, max(1, round(task.period / INTERVAL)))
    rows = []
    bodies = []
    positions = []
    marks = []
    touching = []
    times = [0.0]
    before = simulator.state()

    def keep() -> None:
        rows.append(simulator.readout.rows[0].copy())
        bodies.append(simulator.readout.bodies[0].copy())
        positions.append(task.points(inner.episodes.seen_of(0)[1]))
        marks.append(inner.episodes.marks(0))
        if (found := contacts_of(simulator)) is not None:
            touching.append(found)

    def repeat() -> None:
        """Repeat the same control period, to record intermediate states."""
        nonlocal before
        start = times[-1]
        after = simulator.state()
        acting = {name: values for name, values in after.items() if name.startswith(ACTUATORS)}
        simulator.restore(before | acting)
        taken = 0
        for n in range(1, parts):
            until = every * round(n * cycles / parts)
            simulator.advance(until - taken, check=False, read=True)
            taken = until
            keep()
            times.append(start + taken * simulator.step)
        simulator.restore(after)
        simulator.read()
        keep()
        times.append(start + task.period)
        before = after

    keep()
    inner.episodes.each_period = repeat
    total = 0.0
    over = False
    while not over:
        observation, reward, terminated, truncated, info = env.step(policy(alone(observation))[0])
        total = total + float(reward)
        over = terminated or truncated
    m = measures.view(np.stack(rows))
    x = np.stack(positions)
    of_bodies = [measures.view(own) for own in np.stack(bodies, axis=1)]
    look = task.look()
    camera = task.camera()
    away = np.subtract(camera.eye, camera.target)
    env.close()
    steps = round(times[-1] / task.action_period)
    return Motion(
        title=agent.env_id if agent.name == agent.env_id else f"{agent.env_id}: {agent.name}",
        times=np.array(times),
        positions=x,
        look=look,
        scenery=task.scenery(),
        lengths=task.scene.of_bodies("lengths"),
        centre=m.centre,
        fastest=film.turning(task.scene, of_bodies),
        direction=(
            float(np.arctan2(away[1], away[0])),
            float(np.arctan2(away[2], np.hypot(away[0], away[1]))),
        ),
        graphs=graphs(m, task.scene),
        touches=touches(task.scene, touching, x),
        marks=marks,
        camera=camera,
        note=lacking(task.scene),
        summary=(
            f"{counted(steps, 'step')} of {task.action_period:g} s · return {total:.4g} ({total / steps:.3f} "
            f"per step) · {SUCCESS[info.get('is_success')]}largest strain {m.strain.max():.1e}"
        ),
    )
