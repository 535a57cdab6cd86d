"""Episodes of a batch of copies of a task, stepped together."""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from functools import partial
from typing import Any, NamedTuple

import numpy as np
from gymnasium import spaces
from numba.extending import is_jitted
from numpy.random import Generator

from springgym import checks
from springgym.checks import HUGE, suggestion, sum_of_squares
from springgym.core.compiler.decorators import SameTypes, kernel
from springgym.dynamics import measures
from springgym.dynamics.measures import Measures
from springgym.dynamics.stability import steps_in
from springgym.dynamics.stepping import StepPlan, StepRequirements, plan_steps
from springgym.envs import observation, randomisation
from springgym.envs.error import StepError
from springgym.envs.goals import Goals, mark_reached
from springgym.envs.goals import bound as bound_goals
from springgym.envs.observation import Situation
from springgym.envs.options import Settings, mapping
from springgym.envs.randomisation import NOMINAL
from springgym.envs.task import SUCCESS, TERMINATED, Task
from springgym.model.identity import check_array, check_keys, check_same
from springgym.model.scene import squared_lengths
from springgym.rendering import Marks
from springgym.simulator import STRAIN_LIMIT, Simulator, copies_in, most_copies

__all__ = [
    "ALWAYS_FINITE",
    "BROKEN_OFF",
    "CLEARED",
    "NOT_BEGUN",
    "OF_PAIRS",
    "SPARSE",
    "STATE",
    "Episodes",
    "OptionsProbe",
    "Part",
    "StartedEpisodes",
    "Step",
    "advance_clocks",
    "clip_and_scale",
    "finish_step",
    "plan_of",
]

SPARSE = -1
"""Value for the number of the reward's terms, with which the reward is 1 if the aim is met."""

NOT_BEGUN = "no episode has begun"
"""Reason why copies must be reset before a first step."""

BROKEN_OFF = "the last step or reset broke off in the middle"
"""Reason why copies must be reset before another step."""


class Step(NamedTuple):
    """The results of a step for every copy."""

    reward: np.ndarray
    terminated: np.ndarray
    truncated: np.ndarray


class StartedEpisodes(NamedTuple):
    """Copies whose episodes have begun and must be observed."""

    copies: np.ndarray
    """(k,) the indices of these copies"""
    parts: list[Part]
    """parts of the batch that hold these copies, and maybe others"""


class Part(NamedTuple):
    """Consecutive copies: views of the arguments of a task's functions, and of their outcome."""

    measures: Measures
    situation: Situation
    rows: np.ndarray
    out: np.ndarray
    outcome: np.ndarray
    """``out`` as records, see `Episodes._named`"""
    held: np.ndarray
    elapsed: np.ndarray
    diverged: np.ndarray
    unresolved: np.ndarray
    """whether steps cannot resolve contacts of a copy, see `springgym.simulator.Simulator.unresolved`"""
    copies: slice
    """the indices of these copies in the batch"""


STATE = ("goal", "memory", "time", "factors", "elapsed", "held", "balance", "action", "out", "diverged")
"""Arrays of `Episodes` that change; strengths of actuators and parameters of the simulator follow from the
factors."""

ALWAYS_FINITE = ("time", "factors", "action")
"""Arrays of `STATE` whose numbers are finite even after divergence."""

OF_PAIRS = ("pairs_touching", "pairs_impulse", "pairs_min_gap", "pairs_late_contacts", "coarse_contacts")
"""Names in ``info`` of the fields of `springgym.dynamics.contacts.PairSums`, in their order."""

CLEARED = ("elapsed", "time", "held", "action", "out", "diverged")
"""Arrays of `STATE` that are 0 where an episode begins."""


class OptionsProbe(dict[str, Any]):
    """Empty reset options that record which names a task looks for in them."""

    def __init__(self) -> None:
        super().__init__()
        self.names: dict[str, None] = {}

    def __contains__(self, name: object) -> bool:
        self.names[str(name)] = None
        return False


def plan_of(task: Task, settings: Settings, wanted: float | None = None) -> StepPlan:
    """Return how the scene of a task takes its steps; they are at most ``wanted`` seconds, if that is given.

    Raises
    ------
    TypeError, ValueError
        If a setting is not possible, see `springgym.dynamics.stepping.plan_steps`.
    """
    ranges = randomisation.checked_ranges(settings.randomize, settings.dynamics)
    return plan_steps(
        task.scene,
        dynamics=settings.dynamics,
        integrator=settings.integrator,
        step=settings.step,
        damping_every=settings.damping_every,
        varying=randomisation.varying(ranges, task.scene),
        task=StepRequirements(task.period, task.finest, task.damping_every, ranges, wanted),
    )


class Episodes:
    """Copies of a task, each in its own episode, which are stepped together."""

    def __init__(
        self,
        task: Task,
        copies: int,
        settings: Settings,
        arguments: Mapping[str, Any] | None = None,
        plan: StepPlan | None = None,
        error_bound: float | None = None,
    ) -> None:
        self.task = task
        self.copies = checks.whole("num_envs", copies, 1, most_copies(task.scene))
        self.parameters = task.parameters
        self.unready = NOT_BEGUN
        """the reason why copies must be reset before a step; empty if they need not"""
        self.each_period: Callable[[], None] | None = None
        """a function to call after each control period"""
        self.max_episode_steps = _checked_limit(settings.max_episode_steps)
        sparse = checks.flag("sparse", settings.sparse)
        if sparse and not task.has_aim:
            raise ValueError(
                "sparse is True, and there is no aim to meet; give success, or achieved and goal_tolerances"
            )
        self.goals = _goals_of(task, sparse) if checks.flag("goals", settings.goals) else None
        """the goals, if observations have them as separate entries; else None"""
        self.plan = plan_of(task, settings) if plan is None else plan
        self.ranges = randomisation.checked_ranges(settings.randomize, settings.dynamics)
        scene = task.scene
        made: dict[str, Any] = {
            **{name: getattr(settings, name) for name in ("dynamics", "dtype", "threads")},
            "integrator": self.plan.method.name,
            "copies": copies,
            "varying": randomisation.varying(self.ranges, scene),
        }
        self.simulator = Simulator(scene, step=self.plan.step, damping_every=self.plan.cycle, **made)
        self.error = StepError(self.simulator, **made) if checks.flag("error", settings.error) else None
        self.steps = steps_in(task.period, self.plan.step)
        self.goal = np.zeros((copies, task.goal_size))
        self.memory = np.zeros((copies, len(task.memory)))
        self.strength = np.ones((copies, 1))
        self.factors = np.ones((copies, len(self.ranges)))
        self.elapsed = np.zeros(copies, np.int64)
        self.time = np.zeros(copies)
        """time since the episode began [s]; ``elapsed`` counts for the time limit, and may start above 0"""
        self.held = np.zeros(copies, np.int64)
        self.balance = np.zeros(copies)
        """energy balance at the start of the episode [J]"""
        self.action = np.zeros((copies, task.action_space.shape[0]))
        """clipped to ±1"""
        self._given, self._driven = np.zeros_like(self.action), np.zeros_like(self.action)
        self._apart = len(scene.bodies) > 1
        functions = (task.evaluate, task.move, task.remember)
        self._trusts = all(is_jitted(function) for function in functions if function is not None)
        if task.prepare is not None:
            self.simulator.read()
            task.prepare(*self._seen_in(slice(None)))
        self.rewarded = SPARSE if sparse else len(task.terms)
        self.out = np.zeros((copies, len(task.outcome)))
        """the last results of `Task.evaluate`, a column for each name in `Task.outcome`"""
        self.diverged = np.zeros(copies, bool)
        self._succeeded, self._drift = np.zeros(copies, bool), np.zeros(copies)
        self._bound_of_error = None if error_bound is None else np.full(copies, error_bound)
        self._names = np.dtype([(name, self.out.dtype) for name in task.outcome])
        self._first_memory = np.array(task.memory, float)
        particles = task.particles if self.goals is None else task.particles.without_goal()
        self._columns = observation.columns(particles)
        self._seen_size = task.observation_size if self.goals is None else particles.size(0)
        self._of = {
            "task": type(task).__name__,
            **(arguments or {}),
            "sparse": sparse,
            "goals": self.goals is not None,
            "randomize": {name: list(reach) for name, reach in self.ranges.items()},
        }
        """the identity of a state, besides that of the simulator"""
        self._use_kernels()

    # --- Episodes ---------------------------------------------------------------------------------

    def begin(
        self, copies: np.ndarray, generators: Sequence[Generator], options: Mapping[str, Any] | None
    ) -> StartedEpisodes:
        """Start new episodes in some copies (k,), each drawing from its own generator.

        If this raises an error, nothing changes, not even the generators. Otherwise the copies are `unready`
        until the environment has completed its step or reset and clears the flag.

        Raises
        ------
        TypeError, ValueError
            If the task does not have an option, or a value is invalid or out of range; the message names it.
        """
        given = {} if options is None else dict(mapping("options", options))
        before = [rng.bit_generator.state for rng in generators]
        try:
            return self._begin(copies, generators, given)
        except BaseException:
            for rng, state in zip(generators, before, strict=True):
                rng.bit_generator.state = state
            raise

    def _begin(
        self, copies: np.ndarray, generators: Sequence[Generator], options: dict[str, Any]
    ) -> StartedEpisodes:
        check = bool(options or self.ranges or self.task.checks_starts)
        left = [dict(options) for _ in generators]
        drawn = [
            randomisation.drawn(self.ranges, rng, own) for rng, own in zip(generators, left, strict=True)
        ]
        positions, velocities, goals = self.task.draw_starts(generators, left, drawn)
        for own in filter(None, left):
            name = next(iter(own))
            probe = OptionsProbe()
            randomisation.drawn(self.ranges, generators[0], probe)
            self.task.draw_starts(generators[:1], [probe], drawn[:1])
            raise ValueError(
                f"{type(self.task).__name__} has no reset option {name!r}{suggestion(name, probe.names)}"
            )
        if check:
            self._check_strain(positions, drawn)
        before = list(map(self._drawn, self.factors[copies])) if self.ranges else []
        was = self.unready
        self.unready = BROKEN_OFF
        try:
            self._vary(copies, drawn)
            self.simulator.place(positions, velocities, copies, check=check, read=True)
        except (TypeError, ValueError) as error:  # an option is refused
            self._vary(copies, before)
            self.unready = was
            error.args = (re.sub(r"\bcopy (?=\d)", "environment ", str(error)),)
            raise
        if self.error is not None:
            self.error.last[copies] = 0.0
        goal = np.array(goals, float).reshape(len(copies), self.goal.shape[1])
        self._reset_rows(copies, goal)
        parts = self._parts_with(copies)
        if self._remember is not None:
            memory = self.memory.copy()
            for part in parts:
                self._remember(*part[:2], memory[part.copies])
            self.memory[copies] = memory[copies]
        if self.task.metrics:
            fresh = np.zeros(self.out.shape)
            for part in parts:
                self._evaluate(*part[:2], self._named(fresh[part.copies]))
            metrics = slice(len(self.task.terms), len(self.task.reported))  # no reward yet
            self.out[copies, metrics] = fresh[copies, metrics]
        return StartedEpisodes(copies, parts)

    def _reset_rows(self, copies: np.ndarray, goal: np.ndarray) -> None:
        """Reset the arrays of some copies (k,), whose episodes begin with goals (k, G)."""
        for name in CLEARED:
            getattr(self, name)[copies] = 0
        self.goal[copies] = goal
        self.memory[copies] = self._first_memory
        self.balance[copies] = self.measures.balance[copies]

    def _check_strain(self, positions: np.ndarray, drawn: Sequence[Mapping[str, float]]) -> None:
        """Raise ValueError if positions (k, N, 3) at the start strain springs beyond the divergence limit."""
        if self.simulator.dynamics == "rigid":
            return
        scene = self.simulator.scene
        lengths = scene.lengths[None]
        if "scale" in self.ranges:
            scales = np.array([[factors["scale"]] for factors in drawn])
            lengths = randomisation.stretched(scene, scales) * lengths
        stretch = np.sqrt(squared_lengths(scene.springs, np.asarray(positions))) / lengths
        strain = np.abs(stretch - 1.0).max(axis=1, initial=0.0)
        if (wrong := ~(strain <= STRAIN_LIMIT)).any():
            n = int(np.argmax(wrong))
            factors = ", ".join(f"{name} × {drawn[n][name]:g}" for name in self.ranges)
            raise ValueError(
                f"{type(self.task).__name__} would start with a strain of {strain[n]:.3g}"
                f"{f' ({factors})' if factors else ''}; it must be at most {STRAIN_LIMIT}"
            )

    def step(self, action: np.ndarray) -> tuple[Step, np.ndarray | None]:
        """Step all copies by the control periods of a step; `observe` returns their observations then.

        ``action`` (n, A) is clipped to [−1, 1]. The copies are `unready` afterwards, as by `begin`.

        Raises
        ------
        ValueError
            If ``action`` holds a value that is not finite; nothing changes.
        """
        simulator = self.simulator
        copies = self.copies
        self._given[:] = action
        if not self._take(self._given, self.strength, self.action, self._driven):
            raise ValueError(f"action holds a value that is not finite: {action}")
        self.unready = BROKEN_OFF
        result = Step(np.empty(copies), np.empty(copies, bool), np.empty(copies, bool))
        seen = self._empty_observations(copies) if self._sees_parts else None
        if self.error is not None:
            self.error.last[:] = 0.0
        for left in reversed(range(self.task.periods)):
            simulator.actuate(**self.driven_by(self._driven))
            if self.error is not None:
                self.error.finer.take_over(simulator)
            judge = self._end_period if left else partial(self._judge, result=result, seen=seen)
            if self._judges_parts:
                simulator.advance(self.steps, check=False, read=True, then=judge)
            else:
                simulator.advance(self.steps, check=False, read=True)
                judge(0, copies)
            if self.error is not None:
                self.error.estimate(simulator, self.steps)
            if self.each_period is not None:
                self.each_period()
        return result, seen

    def _end_period(self, first: int, last: int) -> None:
        """End a control period that is not the last one of a step, in some copies, see `_judge`."""
        own = self._part(first, last)
        self._pass_period(own)
        if self._remember is not None:
            self._remember(*own[:2], self.memory[own.copies])

    def _pass_period(self, own: Part) -> None:
        """Count the time of a control period, and move the goals."""
        self._tick(self.time[own.copies], float(self.task.period))
        if self._move is not None:
            self._move(*own[:2], self.goal[own.copies])

    def driven_by(self, actions: np.ndarray) -> dict[str, np.ndarray]:
        """Return actuator values by name for the next control period, from actions (n, A) in [−1, 1].

        ``actions`` are already scaled by `strength`. Values of `Task.respond` are added, and scaled here.
        """
        acting = self.task.actuate(actions)
        for name, values in self.task.respond(*self._whole[:2]).items():
            acting[name] = values * self.strength.reshape(-1, *(1,) * (values.ndim - 1))
        return acting

    def _judge(self, first: int, last: int, result: Step, seen: np.ndarray | None) -> None:
        """Return the outcome, end and observation of the copies from ``first`` to the one before ``last``."""
        own = self._part(first, last)
        share = own.copies
        self._pass_period(own)
        if own is not self._whole:
            result = Step(*(values[share] for values in result))
            seen = None if seen is None else seen[share]
        self._evaluate(*own[:2], own.outcome)
        if self.goals is not None:
            mark_reached(*self._achieved(own), self.goals.ends, self.goals.within, own.out[:, SUCCESS])
        terms = self.rewarded
        wins = self.task.wins
        limit = self.max_episode_steps
        ends = (own.held, own.elapsed, limit, own.diverged, own.unresolved)
        self._finish(own.rows, own.out, terms, wins, *ends, result)
        if self._remember is not None:
            self._remember(*own[:2], self.memory[share])
        if seen is not None:
            self._write_observations(own, seen)

    def observe(self, seen: np.ndarray | None = None, begun: StartedEpisodes | None = None) -> np.ndarray:
        """Return the observations of all copies, (n, D), float32.

        Parameters
        ----------
        seen
            The observations that `step` returned. Only the copies that have ``begun`` since are observed
            again.
        begun
            The copies that `begin` returned.
        """
        if seen is None:
            seen = self._empty_observations(self.copies)
            self._write_observations(self._whole, seen)
        elif begun is not None:
            room = self._empty_observations(self.copies)
            for part in begun.parts:
                self._write_observations(part, room[part.copies])
            seen[begun.copies] = room[begun.copies]
        return seen

    def info_arrays(self) -> dict[str, Any]:
        """Return ``info`` as arrays (n,) by name, views that the next step overwrites."""
        np.greater_equal(self.held, self.task.hold_steps, out=self._succeeded)
        np.subtract(self.measures.balance, self.balance, out=self._drift)
        if self.task.scene.meetings:
            self._info.update(zip(OF_PAIRS, self.simulator.pair_sums(), strict=True))
        return self._info

    def _info_views(self) -> dict[str, Any]:
        """Return the arrays of `info_arrays`, as views except for those of pairs."""
        views: dict[str, Any] = {"is_success": self._succeeded} if self.task.has_aim else {}
        views |= {
            "diverged": self.diverged,
            "energy": self.measures.energy,
            "energy_drift": self._drift,
            "strain": self.measures.strain,
        }
        if self.error is not None:
            views["step_error"] = self.error.last
        if self._bound_of_error is not None:
            views["error_bound"] = self._bound_of_error
        if self.task.scene.meetings:
            views |= dict.fromkeys(OF_PAIRS)
        if self.ranges:
            views["randomization"] = dict(zip(self.ranges, self.factors.T, strict=True))
        return views | dict(zip(self.task.reported, self.out.T[:SUCCESS], strict=True))

    @property
    def observation_space(self) -> spaces.Box | spaces.Dict:
        """The space of one copy's observations."""
        box = spaces.Box(-observation.BOUND, observation.BOUND, (self._seen_size,), np.float32)
        return box if self.goals is None else self.goals.space(box)

    def to_user_observation(self, seen: np.ndarray) -> Any:
        """Return the observation; for a goal environment, with the achieved and the desired goal."""
        if self.goals is None:
            return seen
        achieved, desired = self._achieved(self._whole)
        bound_goals(achieved, self.diverged)
        bound_goals(desired, np.zeros(self.copies, bool))
        return {"observation": seen, "achieved_goal": achieved, "desired_goal": desired}

    def _achieved(self, own: Part) -> tuple[np.ndarray, np.ndarray]:
        """Achieved and desired goals of some copies, (n, K) each."""
        assert self.goals is not None
        assert self._achieve is not None
        achieved, desired = np.empty((2, len(own.out), self.goals.size))
        self._achieve(*own[:2], achieved, desired)
        return achieved, desired

    def _empty_observations(self, copies: int) -> np.ndarray:
        return np.empty((copies, self._seen_size), np.float32)

    def _write_observations(self, own: Part, seen: np.ndarray) -> None:
        """Write the observations of some copies to ``seen``."""
        if self._bound is None:
            self._observe(own.rows, own.situation, self._columns, own.diverged, seen)
        else:
            self._observe(*own[:2], seen)
            self._bound(seen, own.diverged)

    def _parts_with(self, copies: np.ndarray) -> list[Part]:
        """Return parts that together hold some copies (k,): the blocks that they are in, or all copies.

        User-defined functions get all copies. An array of one row has another type than larger ones, see
        `SameTypes`: a last block of one copy is joined with the block before it.
        """
        width = self.simulator.width
        last = max(self.copies - 2, 0) // width
        blocks = {min(copy // width, last) for copy in copies.tolist()}
        if not self._sees_parts or 2 * len(blocks) > last:
            return [self._whole]
        ends = [self.copies if n == last else (n + 1) * width for n in blocks]
        return [self._part(n * width, end) for n, end in zip(blocks, ends, strict=True)]

    def _part(self, first: int, last: int) -> Part:
        """Return the copies from ``first`` to the one before ``last``."""
        if (first, last) not in self._parts:
            copies = slice(first, last)
            out = self.out[copies]
            self._parts[first, last] = Part(
                *self._seen_in(copies),
                self.simulator.readout.rows[copies],
                out,
                self._named(out),
                self.held[copies],
                self.elapsed[copies],
                self.diverged[copies],
                self.simulator.unresolved[copies],
                copies,
            )
        return self._parts[first, last]

    def _seen_in(self, copies: slice) -> tuple[Measures, Situation]:
        """Return the arguments of a task's functions for some copies."""
        rows, x, v, bodies = (values[copies] for values in self.simulator.readout)
        m = measures.view(bodies if self._apart else rows)
        action, goal, time, memory = (
            values[copies] for values in (self.action, self.goal, self.time, self.memory)
        )
        situation = Situation(x, v, action, goal, time, memory, self.parameters)
        if not self._trusts:  # user-defined functions get read-only views
            return Measures(*map(_locked, m)), Situation(*map(_locked, situation))
        return m, situation

    # --- Randomisation ----------------------------------------------------------------------------

    def _drawn(self, factors: np.ndarray) -> dict[str, float]:
        """Return by name the factors of an episode, of which those with ranges are given."""
        return {**NOMINAL, **dict(zip(self.ranges, factors, strict=True))}

    def _vary(self, copies: np.ndarray, drawn: Sequence[Mapping[str, float]]) -> None:
        """Set the parameters of some copies (k,) by their factors."""
        if not (self.ranges and len(copies)):
            return
        if values := self._parameters(drawn):
            self.simulator.vary(copies, **values)
        self._note(copies, drawn)

    def _parameters(self, drawn: Sequence[Mapping[str, float]]) -> dict[str, np.ndarray]:
        """Return the parameters of the simulators for the factors of k copies."""
        each = [randomisation.parameters(self.simulator.scene, self.ranges, factors) for factors in drawn]
        return {name: np.stack([own[name] for own in each]) for name in each[0]}

    def _note(self, copies: np.ndarray | slice, drawn: Sequence[Mapping[str, float]]) -> None:
        """Store the factors of some copies (k,)."""
        self.factors[copies] = [[factors[name] for name in self.ranges] for factors in drawn]
        self.strength[copies] = [[factors["actuator"]] for factors in drawn]

    # --- State ------------------------------------------------------------------------------------

    def state(self, copies: np.ndarray | None = None) -> dict[str, Any]:
        """Return a copy of the state of some copies (k,) or all, with the identity of the environment."""
        own = slice(None) if copies is None else copies
        arrays = {name: getattr(self, name)[own].copy() for name in STATE}
        simulator = self.simulator.state(copies, parameters=False)
        return {"of": dict(self._of), **arrays, "simulator": simulator}

    def restore(self, state: Mapping[str, Any], copies: np.ndarray | None = None) -> None:
        """Restore a state that `state` returned, exactly, or one that was edited since.

        The copies are `unready` afterwards, as by `begin`.

        Parameters
        ----------
        state
            A state of as many copies as there are here, unless ``copies`` is given.
        copies
            (k,) copies to set; all if None. The state has k copies or one, see `Simulator.restore`.

        Raises
        ------
        TypeError, ValueError
            If the state belongs to something else, or holds what no state can. Nothing changes then.
        """
        count = self.count_in(state, copies)
        for name in STATE:
            own = getattr(self, name)
            check_array(name, state[name], (count, *own.shape[1:]), own.dtype, name in ALWAYS_FINITE)
        for column, most in self.task.counts_in_goal:
            values = state["goal"][:, column]
            possible = (values >= 0) & (values <= most) & (values == np.floor(values))
            if not possible.all():
                wrong = values[np.argmin(possible)]
                raise ValueError(
                    f"state['goal'] has {wrong:g} in column {column}; it must be whole, from 0 to {most}"
                )
        chosen = slice(None) if copies is None else copies
        drawn: list[dict[str, float]] = []
        if self.ranges and not (self.factors[chosen] == state["factors"]).all():
            self._check_factors(state["factors"])
            given = np.broadcast_to(state["factors"], self.factors[chosen].shape)
            drawn = list(map(self._drawn, given))
        was = self.unready
        self.unready = BROKEN_OFF
        try:
            parameters = self._parameters(drawn) if drawn else {}
            self.simulator.restore(state["simulator"], copies, parameters=parameters)
        except (TypeError, ValueError):  # an option is refused
            self.unready = was
            raise
        for name in STATE:
            getattr(self, name)[chosen] = state[name]
        if drawn:
            self._note(chosen, drawn)
        self.simulator.read(copies)

    def _check_factors(self, factors: np.ndarray) -> None:
        """Raise ValueError if a factor (k, factors) is outside of the range that it and 1 are in."""
        for (name, (low, high)), column in zip(self.ranges.items(), factors.T, strict=True):
            what = f"state['factors'] of {name!r}"
            checks.array(what, column, column.shape, low=min(low, 1.0), high=max(high, 1.0))

    def count_in(self, state: Mapping[str, Any], copies: np.ndarray | None) -> int:
        """Return the number of copies that a state for copies (k,) may hold: k or 1, or all if None.

        Raises
        ------
        TypeError, ValueError
            If the state has neither one nor k copies, or belongs to something else.
        """
        check_keys("state['episodes']", state, ("of", *STATE, "simulator"))
        check_same("the state", state["of"], self._of)
        return self.copies if copies is None else copies_in(state["simulator"], len(copies))

    def _named(self, out: np.ndarray) -> np.ndarray:
        """Return a view of outcomes (n, columns) as records (n,) with the names of `Task.outcome`."""
        return out.view(self._names)[:, 0]

    def _use_kernels(self) -> None:
        self.measures = measures.view(self.simulator.readout.rows)
        self._info = self._info_views()
        self._parts: dict[tuple[int, int], Part] = {}
        self._whole = self._part(0, self.copies)
        features = self.task.observation != "particles"
        observe = self.task.observe_features if features else observation.observe_particles
        self._sees_parts = self._trusts and is_jitted(observe)
        width = self.simulator.width
        self._judges_parts = self._sees_parts and self.copies % width != 1  # see `_seen_alone`
        self._take = SameTypes(clip_and_scale)
        self._tick = SameTypes(advance_clocks)
        self._evaluate = SameTypes(self.task.evaluate)
        self._finish = SameTypes(finish_step)
        self._observe = SameTypes(observe)
        self._move = None if self.task.move is None else SameTypes(self.task.move)
        self._achieve = (
            None if self.goals is None or self.task.achieve is None else SameTypes(self.task.achieve)
        )
        self._remember = None if self.task.remember is None else SameTypes(self.task.remember)
        self._bound = SameTypes(observation.bound) if features else None

    def __getstate__(self) -> dict[str, Any]:
        return {
            name: value
            for name, value in vars(self).items()
            if name not in ("measures", "_info", "_parts", "_whole") and not isinstance(value, SameTypes)
        }  # views do not survive being copied

    def __setstate__(self, state: dict[str, Any]) -> None:
        vars(self).update(state)
        self._use_kernels()

    @property
    def seen(self) -> tuple[Measures, Situation, np.ndarray]:
        """Return the arguments of a task's functions for all copies, and the rows of their measures."""
        return self._whole[:3]

    def seen_of(self, copy: int) -> tuple[Measures, Situation]:
        """Return the arguments of a task's functions for one copy now; the next step does not change them."""
        m, situation = self._whole[:2]
        own = (values[copy].copy() for values in situation[:-1])
        return Measures(*(values[copy].copy() for values in m)), Situation._make((*own, situation.parameters))

    def marks(self, copy: int) -> Marks:
        """Return the marks of a picture of one copy: its step, whether it succeeds now, and the task's.

        Those of the task follow the bodies, and are left out if the bodies are lost.
        """
        m, s = self.seen_of(copy)
        lost = not max(sum_of_squares(s.x), sum_of_squares(s.v)) <= HUGE
        marks = Marks() if lost else self.task.marks(m, s)
        step = f"step {-(-round(self.time[copy] / self.task.period) // self.task.periods)}"
        self.info_arrays()
        success = ("success",) if self._succeeded[copy] else ()
        return replace(marks, text=(step, *success, *marks.text))

    @property
    def particles(self) -> tuple[np.ndarray, np.ndarray]:
        """Return positions and velocities after the last step or start, (n, N, 3) each. Do not change
        them."""
        return self.simulator.readout.positions, self.simulator.readout.velocities


# --- Checks ---------------------------------------------------------------------------------------


def _locked(array: np.ndarray) -> np.ndarray:
    """Return a view that cannot be written to."""
    view = array.view()
    view.flags.writeable = False
    return view


def _goals_of(task: Task, sparse: bool) -> Goals:
    """Return the goals of a task, after checking that observations can have them as separate entries."""
    name = type(task).__name__
    if not task.goal_tolerances:
        raise ValueError(f"goals is True; it must be False: {name} has no goal that observations tell apart")
    if not sparse:
        raise ValueError(
            "goals is True, and sparse False; give sparse=True, too: "
            "the shaped reward depends on more than what is achieved"
        )
    if task.observation != "particles":
        raise ValueError(
            f"goals is True, and observation {task.observation!r}; it must be 'particles', from which "
            "the goal can be left out"
        )
    return Goals(task.goal_tolerances)


def _checked_limit(steps: int | None) -> int:
    """Return a time limit; −1 without one."""
    if steps is None or (isinstance(steps, int) and steps == -1):
        return -1
    return checks.whole("max_episode_steps", steps, 1)


# --- Compiled -------------------------------------------------------------------------------------


@kernel
def clip_and_scale(given: np.ndarray, strength: np.ndarray, action: np.ndarray, driven: np.ndarray) -> bool:
    """Clip and scale the given actions. Return False, and change nothing, if one is not finite."""
    for c in range(given.shape[0]):
        for n in range(given.shape[1]):
            if not math.isfinite(given[c, n]):
                return False
    for c in range(given.shape[0]):
        for n in range(given.shape[1]):
            action[c, n] = min(max(given[c, n], -1.0), 1.0)
            driven[c, n] = action[c, n] * strength[c, 0]
    return True


@kernel
def advance_clocks(time: np.ndarray, period: float) -> None:
    """Advance the clocks by a control period; times stay whole multiples of it."""
    for c in range(time.size):
        time[c] = period * (math.floor(time[c] / period + 0.5) + 1.0)


@kernel
def finish_step(
    rows: np.ndarray,
    out: np.ndarray,
    terms: int,
    wins: bool,
    held: np.ndarray,
    elapsed: np.ndarray,
    limit: int,
    diverged: np.ndarray,
    unresolved: np.ndarray,
    result: Step,
) -> None:
    """Sum rewards, count steps, end episodes. A copy that has diverged ends with reward 0, as does one with
    contacts that a step cannot resolve, which counts as diverged.

    The terms of the reward are the first ``terms`` columns; if `SPARSE`, the reward is whether the aim is
    met. After a failure it is not, unless the episode ``wins`` by its end.
    """
    success = out.shape[1] + SUCCESS
    terminated = out.shape[1] + TERMINATED
    for c in range(out.shape[0]):
        total = 0.0
        for n in range(rows.shape[1]):
            total += rows[c, n]
        sound = math.isfinite(total) and rows[c, measures.AT.strain] <= STRAIN_LIMIT
        diverged[c] = unresolved[c] or not sound
        if diverged[c]:
            out[c, :] = 0.0
            out[c, terminated] = 1.0
        if out[c, terminated] > 0 and not wins:
            out[c, success] = 0.0
        result.reward[c] = 0.0
        for n in range(terms):
            result.reward[c] += out[c, n]
        if terms == SPARSE and out[c, success] > 0:
            result.reward[c] = 1.0
        held[c] = held[c] + 1 if out[c, success] > 0 else 0
        elapsed[c] += 1
        result.terminated[c] = out[c, terminated] > 0
        result.truncated[c] = 0 <= limit <= elapsed[c]
