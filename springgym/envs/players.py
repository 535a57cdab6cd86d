"""Environments of several agents, as PettingZoo's `ParallelEnv`."""

from __future__ import annotations

from copy import deepcopy
from typing import Any, ClassVar, Literal, Unpack

import numpy as np
from gymnasium import spaces

from springgym.checks import chosen, suggestion, whole
from springgym.core.extras import missing
from springgym.core.guard import guarded
from springgym.envs.base import SingleEnv, SpringEnv, frame_rate, plain_numbers
from springgym.envs.options import Observation, SimulationOptions, mapping
from springgym.envs.registration import register
from springgym.envs.task import SUCCESS
from springgym.envs.tasks.duel import FIRST, SECOND, SpringDuel

try:
    from pettingzoo import ParallelEnv
except ImportError as error:
    raise ImportError(missing("springgym.envs.parallel", "PettingZoo", "pettingzoo")) from error

__all__ = ["OPTIONS", "ParallelDuel", "ParallelOptions", "PlayerOptions", "registered"]

register()  # again, now that PettingZoo is imported

AGENTS = ("first", "second")
OPTIONS = ("tilt", "spin", "other_tilt", "other_spin", "randomize")
"""Reset options of the duel."""


class PlayerOptions(SimulationOptions, total=False):
    """`ParallelDuel` takes these options besides its own arguments."""

    observation: Observation
    action: Literal["push"]


class ParallelOptions(PlayerOptions, total=False):
    """`ParallelDuel` takes these options, and no others."""

    render_mode: Literal["human", "rgb_array", "rgb_array_list"] | None
    max_episode_steps: int


class ParallelDuel(SingleEnv, ParallelEnv):
    """SpringDuel for two agents, which act at the same time and end together.

    Each agent observes the duel as the agent of `springgym.envs.tasks.duel.SpringDuelEnv` does: its own top
    comes first. The axes of the second agent are turned by half a turn. Each agent has its own reward, of the
    same kind.

    Parameters
    ----------
    render_mode
        None, "rgb_array", "rgb_array_list" or "human".
    max_episode_steps
        Time limit.
    options
        As for `SpringDuelEnv`, without ``opponent`` and ``sparse``.
    """

    task_type = SpringDuel
    also_stored: ClassVar = {"agents": AGENTS}
    metadata: ClassVar[dict[str, Any]] = {
        **SpringEnv.metadata,
        "name": "SpringDuel-v0",
        "render_fps": frame_rate(SpringDuel),
        "is_parallelizable": True,
    }

    def __init__(
        self,
        *,
        render_mode: Literal["human", "rgb_array", "rgb_array_list"] | None = None,
        max_episode_steps: int = 500,
        **options: Unpack[PlayerOptions],
    ) -> None:
        known = ParallelOptions.__annotations__
        for name in options:
            if name not in known:
                raise TypeError(f"ParallelDuel has no argument {name!r}{suggestion(name, known)}")
        if render_mode is not None:
            chosen("render_mode", render_mode, self.metadata["render_modes"])
        self.render_mode = render_mode
        limit = whole("max_episode_steps", max_episode_steps, 1)
        self._answered = np.ones((1, 2))  # full force, in trials for a tolerance
        self._make(1, opponent=self._answer, max_episode_steps=limit, **options)
        self.possible_agents = list(AGENTS)
        self.agents: list[str] = []
        self.observation_spaces = {agent: deepcopy(self.task.observation_space) for agent in AGENTS}
        self.action_spaces = {agent: deepcopy(self.task.action_space) for agent in AGENTS}
        self.state_space = deepcopy(self.task.observation_space)

    @property
    def task(self) -> SpringDuel:
        task = self.episodes.task
        assert isinstance(task, SpringDuel)
        return task

    def observation_space(self, agent: str) -> spaces.Box:
        return self.observation_spaces[agent]

    def action_space(self, agent: str) -> spaces.Box:
        return self.action_spaces[agent]

    def _answer(self, observations: np.ndarray) -> np.ndarray:
        """Return the second agent's action as that of the opponent, which `SpringDuel` calls."""
        return self._answered

    @guarded
    def reset(
        self, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[dict[str, np.ndarray], dict[str, dict[str, Any]]]:
        """Start a new episode. Options that the duel does not have are ignored, as PettingZoo requires."""
        options = {} if options is None else dict(mapping("options", options))
        self._begin(seed, {name: value for name, value in options.items() if name in OPTIONS})
        self.agents = list(AGENTS)
        begun = self._seen(), self._infos(self._outcomes())
        self.episodes.unready = ""
        return begun

    @guarded
    def step(self, actions: dict[str, Any]) -> tuple[dict[str, Any], ...]:
        """Run a control period with the actions of both agents.

        Raises
        ------
        TypeError
            If ``actions`` is not a mapping.
        ValueError
            If an agent in the duel has no action, or its action has a wrong shape.
        gymnasium.error.ResetNeeded
            If no episode has begun.
        """
        if not self.agents:
            self._check_ready("step")
            return {}, {}, {}, {}, {}
        mapping("actions", actions)
        if missing := [name for name in self.agents if name not in actions]:
            raise ValueError(f"actions has no action for {missing[0]!r}")
        first, second = (self._checked(actions[name], self.task.action_space.shape) for name in AGENTS)
        if not np.isfinite(np.asarray(second, float)).all():
            raise ValueError(f"action holds a value that is not finite: {second}")
        self._answered[0] = np.clip(second, -1.0, 1.0)
        result, _ = self.episodes.step(first[None])
        out = self._outcomes()
        terms = len(self.task.terms)
        rewards = {AGENTS[n]: float(out[n, :terms].sum()) for n in (FIRST, SECOND)}
        ended = bool(result.terminated[0])
        cut = bool(result.truncated[0])
        terminations = dict.fromkeys(AGENTS, ended)
        truncations = dict.fromkeys(AGENTS, cut)
        seen = self._seen()
        infos = self._infos(out)
        if ended or cut:
            self.agents = []
        self.episodes.unready = ""
        return seen, rewards, terminations, truncations, infos

    def state(self) -> np.ndarray:
        """Return the state of both tops, which is the observation of the first agent.

        Raises
        ------
        gymnasium.error.ResetNeeded
            If no episode has begun.
        """
        self._check_ready("state")
        return self.episodes.observe()[0]

    def _seen(self) -> dict[str, np.ndarray]:
        m, situation, rows = self.episodes.seen
        second = self.task.seen_by_second(m, situation)
        if self.task.observation == "particles":
            second = self.task.particles_of_second(rows, situation)
        if self.episodes.diverged[0]:
            second = np.zeros_like(second)
        return {"first": self.episodes.observe()[0], "second": second[0]}

    def _outcomes(self) -> np.ndarray:
        """Return what `Task.evaluate` computes for both players, (2, columns)."""
        episodes = self.episodes
        task = self.task
        out = np.zeros((2, len(task.outcome)))
        out[FIRST] = episodes.out[0]
        if not episodes.diverged[0]:
            m, situation, _ = episodes.seen
            second = out[SECOND:]
            as_second = situation._replace(action=self._answered, parameters=task.others)
            task.evaluate(m, as_second, episodes._named(second))
            if not episodes.elapsed[0]:
                second[:, : len(task.terms)] = 0.0  # no reward yet
        return out

    def _infos(self, out: np.ndarray) -> dict[str, dict[str, Any]]:
        always = plain_numbers(self.episodes.info_arrays())
        return {
            name: always
            | {"is_success": bool(out[n, SUCCESS] > 0)}
            | dict(zip(self.task.reported, out[n, :SUCCESS].tolist(), strict=True))
            for n, name in enumerate(AGENTS)
        }


def registered(*, max_cycles: int | None = None, **options: Any) -> ParallelDuel:
    """Make a `ParallelDuel` for `pettingzoo.make`, whose name for the time limit is ``max_cycles``."""
    if max_cycles is not None:
        options["max_episode_steps"] = max_cycles
    return ParallelDuel(**options)
