"""The Gymnasium classes over `Episodes`: one environment, and a native batch."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, ClassVar

import gymnasium as gym
import numpy as np
from gymnasium.utils import seeding
from gymnasium.vector import AutoresetMode
from gymnasium.vector.utils import batch_space

from springgym.envs.task import Episodes, Task
from springgym.measures import Measures
from springgym.rendering import Renderer

RENDER_FPS = 50


class _Common:
    """What the single and the batch environment share."""

    task_type: ClassVar[type[Task]]
    episodes: Episodes

    def _make(
        self,
        copies: int,
        *,
        integrator: str | None = None,
        step: float | None = None,
        dynamics: str = "springs",
        dtype: Any = "float64",
        threads: int = 1,
        randomize: Mapping[str, Sequence[float]] | None = None,
        max_episode_steps: int | None = None,
        **options: Any,
    ) -> None:
        self.episodes = Episodes(
            self.task_type(**options),
            copies,
            integrator=integrator,
            step=step,
            dynamics=dynamics,
            dtype=dtype,
            threads=threads,
            randomize=randomize,
            max_episode_steps=max_episode_steps,
        )

    def _checked(self, action: Any, shape: tuple[int, ...] | None) -> np.ndarray:
        """The action as numbers.

        Raises
        ------
        ValueError
            If it has another shape, or holds what is not a number.
        """
        try:
            checked = np.asarray(action, np.float64)
        except (TypeError, ValueError):
            raise ValueError(f"action {action!r} is not an array of numbers") from None
        if checked.shape != shape:
            raise ValueError(f"action has shape {checked.shape}; it must be {shape}")
        return checked

    def _always(self, copies: Any) -> dict[str, Any]:
        """Arrays (k,) of what ``info`` reports for some copies, after a reset too."""
        episodes, task, m = self.episodes, self.episodes.task, self.episodes.measures
        always: dict[str, Any] = {
            "is_success": episodes.held[copies] >= task.hold,
            "diverged": episodes.diverged[copies],
            "energy": m.energy[copies],
            "energy_drift": m.balance[copies] - episodes.balance[copies],
            "strain": m.strain[copies],
        }
        if episodes.ranges:
            drawn = episodes.factors[copies]
            always["randomization"] = {name: drawn[..., n] for n, name in enumerate(episodes.ranges)}
        return always

    def _stepped(self) -> dict[str, Any]:
        """Arrays (n,) of what ``info`` reports besides after a step."""
        return dict(zip(self.episodes.task.reported, self.episodes.out.T, strict=False))

    def _picture(self, renderer: Renderer, copy: int) -> np.ndarray | None:
        episodes = self.episodes
        positions, _ = episodes.particles
        m = Measures(*(values[copy] for values in episodes.measures))
        marks = episodes.task.marks(m, positions[copy], episodes.action[copy], episodes.goal[copy])
        return renderer.frame(positions[copy], marks)

    def _renderer(self, mode: Any) -> Renderer:
        task = self.episodes.task
        return Renderer(task.look(), task.camera(), task.scenery(), mode=mode, fps=RENDER_FPS)


class SpringEnv(_Common, gym.Env):
    """One environment.

    Parameters
    ----------
    render_mode
        None, "rgb_array" or "human".
    integrator, step, dynamics, dtype
        See `springgym.simulator.Simulator`; the step must be a whole part of the control period.
    randomize
        Ranges (low, high) of factors drawn each episode, by name, out of
        `springgym.envs.task.RANDOMIZABLE`.
    options
        The task's own arguments.
    """

    metadata: dict[str, Any] = {"render_modes": ["human", "rgb_array"], "render_fps": RENDER_FPS}  # noqa: RUF012

    def __init__(self, *, render_mode: str | None = None, **options: Any) -> None:
        if render_mode is not None and render_mode not in self.metadata["render_modes"]:
            raise ValueError(f"render_mode={render_mode!r} is unknown; it is None, 'human' or 'rgb_array'")
        self.render_mode = render_mode
        self._make(1, **options)
        self.observation_space = self.episodes.task.observation_space
        self.action_space = self.episodes.task.action_space
        self._canvas: Renderer | None = None

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[np.ndarray, dict[str, Any]]:
        super().reset(seed=seed)
        self.episodes.begin(np.array([0]), [self.np_random], options or {})
        if self._canvas:
            self._canvas.reset()
        if self.render_mode == "human":
            self.render()
        return self.episodes.observe()[0], _plain(self._always(0))

    def step(self, action: Any) -> tuple[np.ndarray, float, bool, bool, dict[str, Any]]:
        checked = self._checked(action, self.action_space.shape)
        result = self.episodes.step(checked[None])
        if self.render_mode == "human":
            self.render()
        stepped = zip(self.episodes.task.reported, self.episodes.out[0].tolist(), strict=False)
        return (
            self.episodes.observe()[0],
            float(result.reward[0]),
            bool(result.terminated[0]),
            bool(result.truncated[0]),
            _plain(self._always(0)) | dict(stepped),
        )

    def render(self) -> np.ndarray | None:
        if self.render_mode is None:
            gym.logger.warn(
                "render() draws nothing without a render mode: "
                f'make the environment with gym.make("{self.spec.id if self.spec else ""}", '
                'render_mode="rgb_array")'
            )
            return None
        if self._canvas is None:
            self._canvas = self._renderer(self.render_mode)
        return self._picture(self._canvas, 0)

    def close(self) -> None:
        if self._canvas is not None:
            self._canvas.close()
            self._canvas = None

    def get_state(self) -> dict[str, Any]:
        """The true state, with clock and random generator: give it to `set_state`."""
        return {"episodes": self.episodes.state(), "rng": self.np_random.bit_generator.state}

    def set_state(self, state: Mapping[str, Any]) -> None:
        """Return to a state, to the bit: what follows is what followed."""
        self.episodes.restore(state["episodes"])
        self.np_random.bit_generator.state = state["rng"]

    def __getstate__(self) -> dict[str, Any]:
        return {**vars(self), "_canvas": None}  # pictures do not travel


class SpringVectorEnv(_Common, gym.vector.VectorEnv):
    """Many copies stepped by one call, equal to the bit to as many single environments.

    Parameters
    ----------
    num_envs
        How many.
    autoreset_mode
        What happens to a copy whose episode has ended, see `gymnasium.vector.AutoresetMode`.
    max_episode_steps
        Time limit; `gymnasium.make_vec` passes the registered one.
    threads
        Threads that share the copies.
    options
        As for the single environment.
    """

    def __init__(
        self,
        num_envs: int = 1,
        *,
        render_mode: str | None = None,
        autoreset_mode: AutoresetMode | str = AutoresetMode.NEXT_STEP,
        **options: Any,
    ) -> None:
        if num_envs < 1:
            raise ValueError(f"num_envs is {num_envs}; it must be at least 1")
        if render_mode not in (None, "rgb_array"):
            raise ValueError(f"render_mode={render_mode!r}: a batch is drawn as None or 'rgb_array'")
        self.num_envs = num_envs
        self.render_mode = render_mode
        self.autoreset_mode = AutoresetMode(autoreset_mode)
        self.metadata = {
            "render_modes": ["rgb_array"],
            "render_fps": RENDER_FPS,
            "autoreset_mode": self.autoreset_mode,
        }
        self._make(num_envs, **options)
        self.single_observation_space = self.episodes.task.observation_space
        self.single_action_space = self.episodes.task.action_space
        self.observation_space = batch_space(self.single_observation_space, num_envs)
        self.action_space = batch_space(self.single_action_space, num_envs)
        self._generators: list[np.random.Generator] = []
        self._ended = np.zeros(num_envs, bool)
        self._canvases: list[Renderer] = []

    def reset(
        self,
        *,
        seed: int | Sequence[int | None] | None = None,
        options: dict[str, Any] | None = None,
    ) -> tuple[np.ndarray, dict[str, Any]]:
        """Start new episodes in all copies, or in those of ``options["reset_mask"]``.

        Parameters
        ----------
        seed
            Copy i is seeded with ``seed + i``, or with ``seed[i]`` of a list.
        options
            ``reset_mask`` (num_envs,) of bool, and the task's reset options.
        """
        seeds = self._seeds(seed)
        given = dict(options or {})
        mask = self._mask(given.pop("reset_mask", None))
        if not self._generators:
            self._generators = [seeding.np_random(s)[0] for s in seeds]
        else:
            for n in np.flatnonzero(mask):
                if seeds[n] is not None:
                    self._generators[n] = seeding.np_random(seeds[n])[0]
        self._begin(np.flatnonzero(mask), given)
        self._ended[mask] = False
        infos: dict[str, Any] = {}
        always = self._always(slice(None))
        _add(infos, always, mask)
        return self.episodes.observe(), infos

    def step(self, actions: Any) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray, dict[str, Any]]:
        if not self._generators:
            raise gym.error.ResetNeeded("Cannot call env.step() before calling env.reset()")
        checked = self._checked(actions, self.action_space.shape)
        mode, episodes = self.autoreset_mode, self.episodes
        infos: dict[str, Any] = {}
        if mode is AutoresetMode.DISABLED and self._ended.any():
            raise gym.error.ResetNeeded(
                f"the episode of copy {int(np.argmax(self._ended))} has ended: "
                "reset it with options={'reset_mask': …}"
            )
        result = episodes.step(checked)
        if mode is AutoresetMode.NEXT_STEP and self._ended.any():
            fresh = self._ended.copy()
            self._begin(np.flatnonzero(fresh))
            for values in result:
                values[fresh] = 0
        else:
            fresh = np.zeros(self.num_envs, bool)
        reward, terminated, truncated = result
        self._ended = terminated | truncated
        if mode is AutoresetMode.SAME_STEP and self._ended.any():
            fresh = self._ended
            final = episodes.observe()
            infos["final_obs"] = np.full(self.num_envs, None, dtype=object)
            for n in np.flatnonzero(fresh):
                infos["final_obs"][n] = final[n]
            infos["_final_obs"] = fresh.copy()
            infos["final_info"] = {}
            always, stepped = self._always(slice(None)), self._stepped()
            _add(infos["final_info"], always | stepped, fresh)
            infos["_final_info"] = fresh.copy()
            self._begin(np.flatnonzero(fresh))
            self._ended = np.zeros(self.num_envs, bool)
        everyone = np.ones(self.num_envs, bool)
        always, stepped = self._always(slice(None)), self._stepped()
        _add(infos, always, everyone)
        if not fresh.all():
            _add(infos, stepped, ~fresh)
        return episodes.observe(), reward, terminated, truncated, infos

    def _begin(self, copies: np.ndarray, options: Mapping[str, Any] | None = None) -> None:
        self.episodes.begin(copies, [self._generators[n] for n in copies], options or {})
        for n in copies if self._canvases else ():
            self._canvases[n].reset()

    def _seeds(self, seed: int | Sequence[int | None] | None) -> list[int | None]:
        if seed is None:
            return [None] * self.num_envs
        if isinstance(seed, (int, np.integer)):
            return [int(seed) + n for n in range(self.num_envs)]
        if len(seed) != self.num_envs:
            raise ValueError(f"{len(seed)} seeds were given for {self.num_envs} copies")
        return list(seed)

    def _mask(self, mask: Any) -> np.ndarray:
        if mask is None:
            return np.ones(self.num_envs, bool)
        if not isinstance(mask, np.ndarray) or mask.dtype != bool or mask.shape != (self.num_envs,):
            raise ValueError(f"reset_mask must be a bool array of shape ({self.num_envs},), not {mask!r}")
        if not mask.any():
            raise ValueError("reset_mask resets no copy")
        return mask

    def render(self) -> tuple[Any, ...]:
        """A picture of every copy."""
        if self.render_mode is None:
            raise ValueError('make the batch with render_mode="rgb_array" to draw it')
        if not self._canvases:
            self._canvases = [self._renderer(self.render_mode) for _ in range(self.num_envs)]
        return tuple(self._picture(canvas, n) for n, canvas in enumerate(self._canvases))

    def close_extras(self, **kwargs: Any) -> None:
        for canvas in self._canvases:
            canvas.close()
        self._canvases = []

    @property  # type: ignore[misc]
    def np_random(self) -> tuple[np.random.Generator, ...]:  # type: ignore[override]
        """The random generators of the copies."""
        return tuple(self._generators)

    def get_state(self) -> dict[str, Any]:
        """The true state of all copies, with clocks and random generators: give it to `set_state`."""
        return {
            "episodes": self.episodes.state(),
            "rng": [generator.bit_generator.state for generator in self._generators],
            "ended": self._ended.copy(),
        }

    def set_state(self, state: Mapping[str, Any]) -> None:
        """Return to a state, to the bit: what follows is what followed."""
        self.episodes.restore(state["episodes"])
        if not self._generators:
            self._generators = [seeding.np_random(None)[0] for _ in range(self.num_envs)]
        for generator, its in zip(self._generators, state["rng"], strict=True):
            generator.bit_generator.state = its
        self._ended = state["ended"].copy()

    def __getstate__(self) -> dict[str, Any]:
        return {**vars(self), "_canvases": []}  # pictures do not travel


def _add(infos: dict[str, Any], values: Mapping[str, Any], mask: np.ndarray) -> None:
    """Add arrays to ``infos`` as Gymnasium does: zero where the mask is not, with the mask beside them."""
    for name, value in values.items():
        if isinstance(value, dict):
            infos[name] = {}
            _add(infos[name], value, mask)
        else:
            infos[name] = np.where(mask, value, np.zeros((), value.dtype))
        infos[f"_{name}"] = mask.copy()


def _plain(values: Mapping[str, Any]) -> dict[str, Any]:
    """The same with plain Python numbers."""
    return {k: _plain(v) if isinstance(v, dict) else v.item() for k, v in values.items()}
