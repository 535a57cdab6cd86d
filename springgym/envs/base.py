"""The Gymnasium classes: single environments and native batches."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from copy import deepcopy
from dataclasses import replace
from typing import Any, ClassVar

import gymnasium as gym
import numpy as np
from gymnasium import spaces
from gymnasium.envs.registration import EnvSpec
from gymnasium.utils import seeding
from gymnasium.vector import AutoresetMode
from gymnasium.vector.utils import batch_space
from gymnasium.wrappers import TimeLimit
from numpy.typing import ArrayLike

from springgym.checks import chosen, flag, hides, indices, instance, refuse_unknown, shown, whole
from springgym.core.guard import Guard, guarded
from springgym.envs.episodes import NOT_BEGUN, Episodes, StartedEpisodes
from springgym.envs.options import Autoreset, Settings, arguments, plain
from springgym.envs.task import Task
from springgym.envs.tolerance import SAFETY, Choice, chosen_for
from springgym.model.identity import check_array, check_keys
from springgym.rendering import Renderer

__all__ = [
    "OF_ONE",
    "SingleEnv",
    "SpringEnv",
    "SpringVectorEnv",
    "Stateful",
    "frame_rate",
    "get_state",
    "set_state",
]


class Stateful:
    """An object with a state that `get_state` returns and `set_state` restores."""

    @property
    def _unready(self) -> str:
        """Reason why it cannot be stepped: no episode, or an interrupted call; empty if it can."""
        raise NotImplementedError

    def get_state(self) -> dict[str, Any]:
        """Return the full state, with clocks and random generators, for `set_state`."""
        raise NotImplementedError

    def set_state(self, state: Mapping[str, Any]) -> None:
        """Restore a state exactly: the same actions then give bit-identical results."""
        raise NotImplementedError


class Common(Stateful):
    """Common part of single and batch environments. Use by one thread at a time, see `Guard`."""

    _guard: Guard
    task_type: ClassVar[type[Task]]
    episodes: Episodes
    render_mode: str | None
    _canvases: Sequence[Renderer] = ()
    """the renderers of all copies, once they are drawn"""
    _film: Sequence[np.ndarray] = ()
    """pictures since the last call of ``render``, if it returns a list"""
    chosen: Choice | None = None
    """the method and the steps chosen for a tolerance; None if none was given"""
    _spec: EnvSpec | None = None
    compute_reward: Callable[[object, object, object], Any]
    """see `springgym.envs.goals.Goals.compute_reward`; only with ``goals=True``"""

    def __init_subclass__(cls, task: type[Task] | None = None) -> None:
        super().__init_subclass__()
        if task is not None:
            cls.task_type = task

    def _make(self, copies: int, /, *, tolerance: float | None = None, **options: Any) -> None:
        self._guard = Guard()
        kind = type(self)
        settings = Settings(**{name: options.pop(name) for name in Settings._fields if name in options})
        refuse_unknown(kind.__name__, options, self.task_type, Settings, Common._make, kind.__init__)
        task = self.task_type(**options)
        given = arguments(self.task_type, options)
        given = {name: value for name, value in given.items() if name not in ("body", "scene")}
        if tolerance is None:
            self.episodes = Episodes(task, copies, settings, given)
        else:
            if settings.step is not None:
                raise ValueError("step and tolerance are both given; a tolerance chooses the step")
            self.chosen = chosen_for(task, copies, tolerance, settings)
            bound = SAFETY * self.chosen.error
            self.episodes = Episodes(task, copies, settings, given, self.chosen.plan, bound)
        self.episodes.each_period = self._show_period if self.render_mode else None
        if self.episodes.goals is not None:
            self.compute_reward = self.episodes.goals.compute_reward

    @property
    def _unready(self) -> str:
        return self.episodes.unready

    @property
    def spec(self) -> EnvSpec | None:
        """Return the spec, writable as JSON, from which `gymnasium.make` makes this environment again."""
        return self._spec

    @spec.setter
    def spec(self, spec: EnvSpec | None) -> None:
        self._spec = None if spec is None else replace(spec, kwargs=plain(spec.kwargs))

    def _check_ready(self, call: str) -> None:
        if self.episodes.unready:
            raise gym.error.ResetNeeded(
                f"Cannot call env.{call}() before calling env.reset(): {self.episodes.unready}"
            )

    def _checked(self, action: object, shape: tuple[int, ...] | None) -> np.ndarray:
        """Return the action as numbers.

        Raises
        ------
        ValueError
            If it has another shape, or does not hold numbers.
        gymnasium.error.ResetNeeded
            If no episode has begun, or the last call was interrupted.
        """
        self._check_ready("step")
        if action.__class__ is not np.ndarray and hides(action):
            raise ValueError(f"action is {shown(action)}; it must be an array without hidden values")
        try:
            given = np.asarray(action)
        except ValueError:
            given = np.array(None)
        if given.dtype.kind not in "fiu":
            raise ValueError(f"action {action!r} is not an array of numbers")
        if given.shape != shape:
            raise ValueError(f"action has shape {given.shape}; it must be {shape}")
        return given

    def _draw(self) -> tuple[Any, ...]:
        """Draw a picture of every copy."""
        task = self.episodes.task
        episodes = self.episodes
        if not self._canvases:
            mode: Any = "human" if self.render_mode == "human" else "rgb_array"
            self._canvases = [
                Renderer(task.look(), task.camera(), task.scenery(), mode=mode, fps=frame_rate(task))
                for _ in range(episodes.copies)
            ]
            self._show_new(range(episodes.copies))
        pictures = []
        for n, canvas in enumerate(self._canvases):
            _, s = episodes.seen_of(n)
            if not episodes.diverged[n]:
                canvas.camera = canvas.camera.keeping(task.framed(s), canvas.size)
            pictures.append(canvas.draw(task.points(s), episodes.marks(n)))
        return tuple(pictures)

    def _show_new(self, copies: Iterable[int]) -> None:
        """Restart the pictures of some copies, whose traces begin where these are now."""
        for n in copies if self._canvases else ():
            self._canvases[n].reset()
            self._canvases[n].follow(self.episodes.particles[0][n])
            self._canvases[n].camera = self.episodes.task.camera()

    def _show_period(self) -> None:
        """Add the state to the pictures after a control period."""
        for canvas, positions in zip(self._canvases, self.episodes.particles[0], strict=False):
            canvas.follow(positions)
        self._show()

    def _show(self) -> None:
        """Show the state in the window, or add a picture of it to the film, depending on the render mode."""
        if self.render_mode == "human":
            self._draw()
        elif self.render_mode == "rgb_array_list":
            self._film = (*self._film, *self._draw())

    def close_extras(self, **kwargs: object) -> None:
        for canvas in self._canvases:
            canvas.close()
        self._canvases = []

    @guarded
    def __getstate__(self) -> dict[str, Any]:
        return {**vars(self), "_canvases": []}  # renderers are not copied


class SingleEnv(Common):
    """An environment of one copy, for one agent or several: its state, random generator and pictures."""

    also_stored: ClassVar[Mapping[str, Sequence[str]]] = {}
    """names of further lists in the state, and the names that each may hold"""
    _np_random: np.random.Generator | None = None
    _np_random_seed: int | None = None

    @property
    def np_random(self) -> np.random.Generator:
        """Return the random generator; it is seeded at random before the first reset."""
        if self._np_random is None:
            self._np_random, self._np_random_seed = seeding.np_random(None)
        return self._np_random

    @np_random.setter
    def np_random(self, generator: np.random.Generator) -> None:
        self._np_random = instance("np_random", generator, np.random.Generator)
        self._np_random_seed = -1

    @property
    def np_random_seed(self) -> Any:
        """Return the seed of `np_random`; −1 if the generator was set and not seeded."""
        return self._np_random_seed if self.np_random else None

    def _begin(self, seed: object, options: Mapping[str, Any] | None) -> None:
        """Begin an episode. If this raises an error, nothing changes, not even the random generator."""
        given = _seed("seed", seed)
        rng, known = (self.np_random, self._np_random_seed) if given is None else seeding.np_random(given)
        self.episodes.begin(np.array([0]), [rng], options)
        self._np_random = rng
        self._np_random_seed = known
        self._show_begin()

    def _show_begin(self) -> None:
        """Show the state from which to go on. A film begins anew, as its pictures are of other steps."""
        self._show_new([0])
        self._film = ()
        self._show()

    @guarded
    def render(self) -> Any:
        if self.render_mode is None:
            gym.logger.warn(
                "render() draws nothing without a render mode: "
                'make the environment with render_mode="rgb_array"'
            )
            return None
        self._check_ready("render")
        if self.render_mode == "rgb_array_list":
            film = self._film
            self._film = ()
            return list(film)
        return self._draw()[0]

    @guarded
    def get_state(self) -> dict[str, Any]:
        """Return the full state, with clock and random generator, for `set_state`."""
        return {
            "episodes": self.episodes.state(),
            "rng": self.np_random.bit_generator.state,
            "seed": self.np_random_seed,
            "ready": not self.episodes.unready,
            **{name: list(getattr(self, name)) for name in self.also_stored},
        }

    @guarded
    def set_state(self, state: Mapping[str, Any]) -> None:
        """Restore a state exactly: the same actions then give bit-identical results.

        The state may have been edited, see `springgym.set_state`. Wrappers do not change: the time limit that
        `gymnasium.make` adds continues to count from where it was. `springgym.set_state` sets it, too.

        Raises
        ------
        TypeError, ValueError
            If the state belongs to an environment that differs in more than its time limit, or holds what no
            state can; the message says how. Nothing changes then.
        """
        check_keys("state", state, (*OF_ONE, *self.also_stored))
        rng = _restored("state['rng']", state["rng"])
        seed = whole("state['seed']", state["seed"], -1, high=np.inf)
        ready = flag("state['ready']", state["ready"])
        stored = {}
        for name, known in self.also_stored.items():
            own = instance(f"state[{name!r}]", state[name], list)
            stored[name] = [chosen(f"a name in state[{name!r}]", one, known) for one in own]
        self.episodes.restore(state["episodes"])
        self._np_random = rng
        self._np_random_seed = seed
        vars(self).update(stored)
        self.episodes.unready = "" if ready else NOT_BEGUN
        self._show_begin()

    def close(self) -> None:
        self.close_extras()


class SpringEnv(SingleEnv, gym.Env[np.ndarray, np.ndarray]):
    """A single environment.

    A concrete class belongs to a task, ``class OwnEnv(SpringEnv, gym.Env, task=Own)``. It has `gymnasium.Env`
    among its direct bases, because some libraries require it there.

    Parameters
    ----------
    render_mode
        None, "rgb_array", "human", or "rgb_array_list": the pictures of all control periods since the last
        call of ``render``, ``reset`` or ``set_state``. Fetch them in time: each takes some MB.
    integrator, step, damping_every, dynamics, dtype
        See `springgym.simulator.Simulator`. The control period must be a whole number of steps, and a whole
        number of cycles of ``damping_every`` steps.
    randomize
        Ranges (low, high) of factors that each episode draws, by the names in
        `springgym.envs.randomisation.RANDOMIZABLE`.
    error
        Whether to report ``info["step_error"]``: the difference of each control period from the same one with
        finer steps, see `springgym.envs.error`. A step then costs three times as much.
    tolerance
        Largest error of a control period, relative to the body's size. It chooses the step and, unless you
        give one, the integrator, see `springgym.envs.tolerance`. The environment tries them when it is made,
        which takes seconds. ``info["error_bound"]`` is the estimated bound.
    sparse
        Whether the reward is 1 in steps where the aim is met and 0 otherwise, instead of the shaped reward.
        ``info`` still contains the terms of the shaped reward.
    goals
        Whether observations hold the goal as separate entries, like Gymnasium-Robotics' ``GoalEnv``: a dict
        of ``observation``, the particles without the goal, ``achieved_goal`` and ``desired_goal``. The
        environment then has ``compute_reward(achieved_goal, desired_goal, info)``, see
        `springgym.envs.goals.Goals`. Needs ``sparse=True``, and a task with `Task.goal_tolerances`.
    max_episode_steps
        Time limit. The default is none, because `gymnasium.make` adds the registered one with a wrapper.
    options
        Arguments of the task.
    """

    metadata: dict[str, Any] = {"render_modes": ["human", "rgb_array", "rgb_array_list"]}  # noqa: RUF012
    observation_space: spaces.Box
    action_space: spaces.Box

    def __init_subclass__(cls, task: type[Task] | None = None) -> None:
        super().__init_subclass__(task)
        if task is not None:
            cls.metadata = SpringEnv.metadata | {"render_fps": frame_rate(task)}

    def __init__(self, *, render_mode: str | None = None, **options: Any) -> None:
        if render_mode is not None:
            chosen("render_mode", render_mode, self.metadata["render_modes"])
        self.render_mode = render_mode
        self._make(1, **options)
        task = self.episodes.task
        self.metadata = type(self).metadata | {"render_fps": frame_rate(task)}
        self.observation_space = self.episodes.observation_space  # type: ignore[assignment]
        self.action_space = task.action_space

    @guarded
    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[np.ndarray, dict[str, Any]]:
        """Start a new episode. If this raises an error, nothing changes, not even the random generator.

        Parameters
        ----------
        seed
            A new seed for the random generator.
        options
            The task's reset options.
        """
        self._begin(seed, options)
        begun = self._seen(self.episodes.observe()), self._info()
        self.episodes.unready = ""
        return begun

    @guarded
    def step(self, action: object) -> tuple[np.ndarray, float, bool, bool, dict[str, Any]]:
        checked = self._checked(action, self.action_space.shape)
        result, seen = self.episodes.step(checked[None])
        seen = self._seen(self.episodes.observe(seen))
        info = self._info()
        self.episodes.unready = ""
        return seen, result.reward.item(), result.terminated.item(), result.truncated.item(), info

    def _seen(self, seen: np.ndarray) -> Any:
        return _of_copy(self.episodes.to_user_observation(seen), 0)

    def _info(self) -> dict[str, Any]:
        return plain_numbers(self.episodes.info_arrays())


class SpringVectorEnv(Common, gym.vector.VectorEnv[np.ndarray, np.ndarray, np.ndarray]):
    """A batch of copies, stepped in one call; results are bit-identical to those of single environments.

    A concrete class has `gymnasium.vector.VectorEnv` among its own bases, see `SpringEnv`.

    Parameters
    ----------
    num_envs
        Number of copies.
    autoreset_mode
        How a copy is reset when its episode has ended, see `gymnasium.vector.AutoresetMode`.
    max_episode_steps
        Time limit; `gymnasium.make_vec` passes the registered one.
    threads
        Number of threads that share the copies.
    options
        As for the single environment.
    """

    single_observation_space: spaces.Box
    single_action_space: spaces.Box
    observation_space: spaces.Box
    action_space: spaces.Box

    def __init__(
        self,
        num_envs: int = 1,
        *,
        render_mode: str | None = None,
        autoreset_mode: Autoreset = AutoresetMode.NEXT_STEP,
        **options: Any,
    ) -> None:
        num_envs = whole("num_envs", num_envs, 1)
        if render_mode is not None:
            chosen("render_mode of a batch", render_mode, ["rgb_array"])
        modes = [mode.value for mode in AutoresetMode]
        if not isinstance(autoreset_mode, AutoresetMode):
            autoreset_mode = AutoresetMode(chosen("autoreset_mode", autoreset_mode, modes))
        self.num_envs = num_envs
        self.render_mode = render_mode
        self.autoreset_mode = autoreset_mode
        self._make(num_envs, **options)
        task = self.episodes.task
        self.metadata = {
            "render_modes": ["rgb_array"],
            "render_fps": frame_rate(task),
            "autoreset_mode": self.autoreset_mode,
        }
        self.single_observation_space = self.episodes.observation_space  # type: ignore[assignment]
        self.single_action_space = task.action_space
        self.observation_space = batch_space(self.single_observation_space, num_envs)  # type: ignore[assignment]
        self.action_space = batch_space(task.action_space, num_envs)  # type: ignore[assignment]
        self._generators: list[np.random.Generator] = []
        self._seeds: list[int] = []
        self._ended = np.zeros(num_envs, bool)

    @guarded
    def reset(
        self, *, seed: int | Sequence[int | None] | None = None, options: dict[str, Any] | None = None
    ) -> tuple[np.ndarray, dict[str, Any]]:
        """Start new episodes in all copies, or in those of ``options["reset_mask"]``.

        If this raises an error, nothing changes, not even the random generators.

        Parameters
        ----------
        seed
            Copy i is seeded with ``seed + i``, or with ``seed[i]`` of a list.
        options
            ``reset_mask`` (num_envs,) of bool, and the task's reset options.
        """
        seeds = self._given_seeds(seed)
        mask, given = self._mask(options)
        generators = list(self.np_random)
        known = list(self.np_random_seed)
        for n in np.flatnonzero(mask):
            if seeds[n] is not None:
                generators[n], known[n] = seeding.np_random(seeds[n])
        started = np.flatnonzero(mask)
        self.episodes.begin(started, [generators[n] for n in started], given)
        self._generators = generators
        self._seeds = known
        self._ended[mask] = False
        self._show_new(started)
        infos: dict[str, Any] = {}
        _add(infos, self.episodes.info_arrays(), mask)
        seen = self.episodes.to_user_observation(self.episodes.observe())
        self.episodes.unready = ""
        return seen, infos

    @guarded
    def step(self, actions: object) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray, dict[str, Any]]:
        checked = self._checked(actions, self.action_space.shape)
        mode = self.autoreset_mode
        episodes = self.episodes
        infos: dict[str, Any] = {}
        if mode is AutoresetMode.DISABLED and self._ended.any():
            raise gym.error.ResetNeeded(
                f"the episode of environment {int(np.argmax(self._ended))} has ended: "
                "reset it with options={'reset_mask': …}"
            )
        result, seen = episodes.step(checked)
        reward, terminated, truncated = result
        begun = None
        if mode is AutoresetMode.NEXT_STEP and np.count_nonzero(self._ended):
            begun = self._begin(self._ended)
            for values in result:
                values[begun.copies] = 0
        self._ended = terminated | truncated
        if mode is AutoresetMode.SAME_STEP and np.count_nonzero(self._ended):
            fresh = self._ended
            final = episodes.to_user_observation(episodes.observe(seen))
            infos["final_obs"] = np.full(self.num_envs, None, dtype=object)
            for n in np.flatnonzero(fresh):
                infos["final_obs"][n] = deepcopy(_of_copy(final, n))
            infos["_final_obs"] = fresh.copy()
            infos["final_info"] = {}
            _add(infos["final_info"], self.episodes.info_arrays(), fresh)
            infos["_final_info"] = fresh.copy()
            begun = self._begin(fresh)
            self._ended = np.zeros(self.num_envs, bool)
        _add(infos, self.episodes.info_arrays(), np.ones(self.num_envs, bool))
        seen = episodes.to_user_observation(episodes.observe(seen, begun))
        episodes.unready = ""
        return seen, reward, terminated, truncated, infos

    def _begin(self, fresh: np.ndarray) -> StartedEpisodes:
        """Start new episodes in some copies (num_envs,) of bool."""
        copies = fresh.nonzero()[0]
        begun = self.episodes.begin(copies, [self._generators[n] for n in copies], None)
        self._show_new(copies)
        return begun

    def _given_seeds(self, seed: int | Sequence[int | None] | None) -> list[int | None]:
        if isinstance(seed, np.ndarray) and seed.ndim:
            seed = list(seed)
        if not isinstance(seed, Sequence) or isinstance(seed, (str, bytes)):
            first = _seed("seed", seed)
            return [None if first is None else first + n for n in range(self.num_envs)]
        if len(seed) != self.num_envs:
            raise ValueError(f"{len(seed)} seeds were given for {self.num_envs} environments")
        return [_seed(f"seed[{n}]", given) for n, given in enumerate(seed)]

    def _mask(self, options: Mapping[str, Any] | None) -> tuple[np.ndarray, Mapping[str, Any] | None]:
        """Return a mask (num_envs,) of the copies to reset, and the other options."""
        if not isinstance(options, Mapping) or "reset_mask" not in options:
            return np.ones(self.num_envs, bool), options
        mask = options["reset_mask"]
        if not isinstance(mask, np.ndarray) or mask.dtype != bool or mask.shape != (self.num_envs,):
            raise ValueError(f"reset_mask must be a bool array of shape ({self.num_envs},), not {mask!r}")
        if not mask.any():
            raise ValueError("reset_mask must select at least one environment")
        if self.episodes.unready and not mask.all():
            raise ValueError(
                f"reset_mask leaves out some, and {self.episodes.unready}: reset all environments"
            )
        return mask.copy(), {name: value for name, value in options.items() if name != "reset_mask"}

    @guarded
    def render(self) -> tuple[Any, ...]:
        """Draw a picture of every copy."""
        if self.render_mode is None:
            raise ValueError('make the batch with render_mode="rgb_array" to draw it')
        self._check_ready("render")
        return self._draw()

    @property  # type: ignore[override]
    def np_random(self) -> tuple[np.random.Generator, ...]:
        """Return the random generators of the copies. Before the first reset they are seeded at random."""
        if not self._generators:
            pairs = [seeding.np_random(None) for _ in range(self.num_envs)]
            self._generators = [rng for rng, _ in pairs]
            self._seeds = [seed for _, seed in pairs]
        return tuple(self._generators)

    @np_random.setter
    def np_random(self, generators: np.random.Generator | Sequence[np.random.Generator]) -> None:
        given = list(generators) if isinstance(generators, Sequence) else [generators]
        if len({id(rng) for rng in given if isinstance(rng, np.random.Generator)}) != self.num_envs:
            raise ValueError(
                f"np_random must be {self.num_envs} different random generators, one for each environment; "
                f"rng.spawn({self.num_envs}) makes them of one"
            )
        self._generators, self._seeds = given, [-1] * self.num_envs

    @property
    def np_random_seed(self) -> tuple[int, ...]:  # type: ignore[override]
        """Return the seeds of `np_random`, −1 where the generator was set and not seeded."""
        return tuple(self._seeds) if self.np_random else ()

    @guarded
    def get_state(self, copies: ArrayLike | None = None) -> dict[str, Any]:
        """Return the full state of some copies or all, with clocks and random generators, for `set_state`.

        Parameters
        ----------
        copies : (k,), optional
            Indices of copies, or a mask. The state is then that of a batch of k copies.

        Raises
        ------
        TypeError, ValueError
            If there are no such copies.
        """
        own = self._some(copies)
        generators = self.np_random
        seeds = self.np_random_seed
        return {
            "episodes": self.episodes.state(None if copies is None else own),
            "rng": [generators[n].bit_generator.state for n in own],
            "seed": [seeds[n] for n in own],
            "ready": not self.episodes.unready,
            "ended": self._ended[own],
        }

    @guarded
    def set_state(self, state: Mapping[str, Any], copies: ArrayLike | None = None) -> None:
        """Restore a state exactly in all copies or in some: the same actions then give bit-identical results.

        Parameters
        ----------
        state
            A state of this batch, or of one made in the same way.
        copies : (k,), optional
            Indices of the copies to set, or a mask. The state must then have k copies, or one copy (for
            example of a single environment), which all k continue. Each gets its own random generator with
            the state from there. So autoreset draws the same as the single environment would, and the same in
            all copies of one state.

        Raises
        ------
        TypeError, ValueError
            If the state belongs to an environment that differs in more than its time limit and number of
            copies, or holds what no state can; the message says how. If there are no such copies. If no
            episode has begun in the state, or in copies here that are not set. Nothing changes then.
        """
        own = self._some(copies)
        single = isinstance(state, Mapping) and set(state) == set(OF_ONE)
        if single and copies is None:
            raise ValueError(
                "the state is that of a single environment; name copies, those that are to continue it"
            )
        check_keys("state", state, OF_ONE if single else (*OF_ONE, "ended"))
        where = None if copies is None else own
        count = self.episodes.count_in(state["episodes"], where)
        if single:
            state = {**state, "rng": [state["rng"]], "seed": [state["seed"]], "ended": np.zeros(1, bool)}
        check_array("ended", state["ended"], (count,), self._ended.dtype)
        rngs = _list_of(count, "rng", state)
        known = [whole("state['seed']", seed, -1, high=np.inf) for seed in _list_of(count, "seed", state)]
        ready = flag("state['ready']", state["ready"])
        if copies is not None:
            self._check_begun(ready, own)
        generators = list(self.np_random)
        seeds = list(self.np_random_seed)
        for n, copy in enumerate(own):
            generators[copy] = _restored("state['rng']", rngs[n % count])
            seeds[copy] = known[n % count]
        self.episodes.restore(state["episodes"], where)
        self._generators = generators
        self._seeds = seeds
        self._ended[own] = state["ended"]
        self.episodes.unready = "" if ready else NOT_BEGUN
        self._show_new(own)

    def _some(self, copies: ArrayLike | None) -> np.ndarray:
        """Return indices (k,) of copies, checked; all if None."""
        if copies is None:
            return np.arange(self.num_envs)
        own = indices("copies", copies, self.num_envs, once=True)
        if not len(own):
            raise ValueError(f"copies is {shown(copies)}; it must name a copy")
        return own

    def _check_begun(self, ready: bool, own: np.ndarray) -> None:
        """Raise ValueError if no episode has begun in the state, or in copies here that are not set."""
        if not ready:
            raise ValueError("state['ready'] is False; to be set into copies, its episode must have begun")
        if self.episodes.unready and len(own) < self.num_envs:
            raise ValueError(f"copies leaves out some, and {self.episodes.unready}: reset or set all copies")


# --- States, through wrappers -------------------------------------------------------------------------


def get_state(env: object, copies: ArrayLike | None = None) -> dict[str, Any]:
    """Return the full state of an environment or of a native batch.

    The state holds positions and velocities, clocks, goals, factors, time limits and random generators, and
    the counts of the monitor of `springgym.envs.sb3.make_sb3`. It does not hold the state of other wrappers.
    To copy an environment with its wrappers, use `copy.deepcopy`.

    Parameters
    ----------
    env
        An environment from `gymnasium.make`, `gymnasium.make_vec`, `springgym.make_scene_env`,
        `springgym.envs.parallel` or `springgym.envs.sb3.make_sb3`.
    copies : (k,), optional
        For a native batch: indices of k copies, or a mask. The state holds these copies only.

    Raises
    ------
    TypeError
        If it is not an environment of springgym, or if it is a loop of Gymnasium's over several; or if
        copies are named, and it is not a native batch.
    ValueError
        If there are no such copies.
    """
    own = holder(env)
    return dict(own.get_state(*_named(own, copies)))


def set_state(env: Any, state: Mapping[str, Any], copies: ArrayLike | None = None) -> None:
    """Set the state that `get_state` returned, to the bit, in an environment or in copies of a native batch.

    The same actions then have the same results. The time limit that `gymnasium.make` adds is set, too. The
    state may have been edited: the episode then continues from the edited positions, velocities, goals or
    factors, see `springgym.simulator.Simulator.state`.

    Parameters
    ----------
    env
        As for `get_state`.
    state
        A state of this environment, or of one made in the same way.
    copies : (k,), optional
        For a native batch: the copies to set. The state must have k copies, or one copy, which all of them
        continue; see `SpringVectorEnv.set_state`.

    Raises
    ------
    TypeError
        If it is not an environment of springgym, or if it is a loop of Gymnasium's over several; or if
        copies are named, and it is not a native batch.
    TypeError, ValueError
        If the state does not fit this environment, see `SingleEnv.set_state`, or there are no such copies.
        Nothing changes then.
    """
    own = holder(env)
    unready = own._unready
    where = _named(own, copies)
    own.set_state(state, *where)
    if env is not own and unready:  # wrappers need a first reset, too
        env.reset()
        own.set_state(state, *where)
    while isinstance(env, gym.Wrapper):
        if isinstance(env, TimeLimit):
            env._elapsed_steps = int(own.episodes.elapsed[0])  # type: ignore[assignment]
        env = env.env


def holder(env: object) -> Any:
    """Return the springgym object inside the wrappers, which holds the state."""
    own = getattr(env, "unwrapped", env)
    if not isinstance(own, Common):  # those of Stable-Baselines3 have a monitor, whose counts are state
        own = env
        while not isinstance(own, Stateful) and hasattr(own, "venv"):
            own = own.venv
    if not isinstance(own, Stateful):
        raise TypeError(f"env is {env!r}; it must be an environment, or a native batch, of springgym")
    return own


def _named(own: object, copies: ArrayLike | None) -> tuple[ArrayLike, ...]:
    """Return the argument that selects copies of a native batch, as a tuple; empty if none are selected."""
    if copies is not None and not isinstance(own, SpringVectorEnv):
        raise TypeError(
            f"copies is {shown(copies)}; leave it out: only a native batch of gymnasium.make_vec has "
            f"copies to choose, and env is a {type(own).__name__}"
        )
    return () if copies is None else (copies,)


OF_ONE = ("episodes", "rng", "seed", "ready")
"""The keys in the state of a single environment; the state of a batch has "ended", too."""


def _list_of(count: int, name: str, state: Mapping[str, Any]) -> list[Any]:
    """Return an entry of the state of a batch that is a list with one thing for each copy."""
    given: list[Any] = instance(f"state[{name!r}]", state[name], list)
    if len(given) != count:
        raise ValueError(f"state[{name!r}] has {len(given)} entries; it must have {count}, one for each copy")
    return given


class _Unseeded(np.random.bit_generator.ISeedSequence):
    """The seed of generators whose state is set at once; to compute one takes several times as long."""

    def generate_state(self, n_words: int, dtype: Any = np.uint32) -> np.ndarray:
        return np.zeros(n_words, dtype)


def _restored(name: str, state: Any) -> np.random.Generator:
    """Return a random generator with a given state.

    Raises
    ------
    ValueError
        If it is not the state of a generator of NumPy.
    """
    try:
        kind = getattr(np.random, state["bit_generator"])
        bits: Any = kind(_Unseeded()) if issubclass(kind, np.random.BitGenerator) else None
        bits.state = state
    except Exception:  # NumPy raises many kinds
        raise ValueError(
            f"{name} is {shown(state)}; it must be the state of a random generator of NumPy"
        ) from None
    return np.random.Generator(bits)


# --- Of info, and of the spec -------------------------------------------------------------------------


def frame_rate(task: Task | type[Task]) -> float:
    """Return the frames per second that show a task in real time, with one frame for each control period."""
    rate = 1 / task.period
    return round(rate) if abs(rate - round(rate)) < 1e-9 * rate else rate


def _seed(name: str, seed: object) -> int | None:
    """Return a seed as an int of any length: seeds that Gymnasium draws have 128 bits."""
    return None if seed is None else whole(name, seed, high=np.inf)


def _of_copy(seen: Any, copy: Any) -> Any:
    """Return the observation of one copy, from those of all copies."""
    return {name: own[copy] for name, own in seen.items()} if isinstance(seen, dict) else seen[copy]


def _add(infos: dict[str, Any], values: Mapping[str, Any], mask: np.ndarray) -> None:
    """Add arrays to ``infos`` in Gymnasium's form: zero outside the mask, with the mask as ``_NAME``."""
    every = np.count_nonzero(mask) == len(mask)
    masks = np.empty((len(values), len(mask)), bool)
    masks[:] = mask
    for (name, value), own in zip(values.items(), masks, strict=True):
        if isinstance(value, dict):
            infos[name] = {}
            _add(infos[name], value, mask)
        else:
            infos[name] = value.copy() if every else np.where(mask, value, np.zeros((), value.dtype))
        infos[f"_{name}"] = own


def plain_numbers(values: Mapping[str, Any]) -> dict[str, Any]:
    """Return the values of a single copy as plain Python numbers."""
    return {k: v.item() if v.__class__ is np.ndarray else plain_numbers(v) for k, v in values.items()}
