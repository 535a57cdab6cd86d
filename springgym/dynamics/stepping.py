"""The choice of method, step and cycle; and the kinds of dynamics: particles with springs between them, and
the same particles as rigid bodies."""

from __future__ import annotations

import math
from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import replace
from types import MappingProxyType
from typing import Any, NamedTuple

import numpy as np

from springgym.checks import TINY, apart, chosen, instance, number, whole
from springgym.dynamics import methods as integrators
from springgym.dynamics import packing, rigid, stability
from springgym.dynamics.methods.record import Integrator, refusal
from springgym.dynamics.packing import Packed
from springgym.model.bodies import Body
from springgym.model.resolution import longest_step
from springgym.model.scene import Scene

UNEVEN = 1e-9
"""Relative difference from which lengths of springs are not those of a rigid body in another size."""

MOST_STEPS = 100_000
"""Largest number of steps in a control period, which take up to about 0.1 s of computing."""

LONGEST = 0.9
"""Largest step for a wanted error, relative to the stability limit, if bodies touch nothing."""


class StepPlan(NamedTuple):
    """How a simulator takes its steps."""

    method: Integrator
    step: float
    """h [s]"""
    cycle: int
    """number of steps in a cycle of dampers and wrench, see `springgym.dynamics.forces.cycle`"""
    limit: float
    """stability limit [s] of the scene as it was made; of a task, with the fastest bodies of its ranges"""


class StepRequirements(NamedTuple):
    """What a task requires of the steps of its scene."""

    period: float | None = None
    """control period [s], of whole steps and cycles"""
    finest: float = math.inf
    """largest default step [s], if the task chooses it for its impacts; else `springgym.model.resolution`
    does"""
    cycle: int = 1
    """number of steps in a cycle where there is contact and cycles are harmless"""
    randomize: Mapping[str, Sequence[float]] = MappingProxyType({})
    """(low, high) of factors by name. Steps suit the bodies of all of them, and of factors 1."""
    wanted: float | None = None
    """step for a wanted error [s], which is taken instead of a default one if it is possible"""


NO_REQUIREMENTS = StepRequirements()


class Dynamics(NamedTuple):
    """A kind of dynamics: its methods and their steps, and its treatment of starts and parameters."""

    rigid: bool
    """whether each body is packed as a rigid one, too"""
    default: Callable[[Scene], str]
    """returns the name of the default integrator"""
    integrator: Callable[[str], Integrator]
    advance_kernel: Callable[[str, Callable[..., None], bool, bool, bool], Callable[..., None]]
    largest_step: Callable[[Scene, Integrator], float]
    """returns the stability limit [s]"""
    usual_step: Callable[[Scene, Integrator], float]
    """returns the default step [s], impacts aside"""
    settled: Callable[[Packed, np.ndarray, np.ndarray], np.ndarray] | None
    """returns the positions (k, N, 3) of particles that are placed in copies (k,); None if they do not
    change"""
    follow: Callable[[Packed, np.ndarray, Mapping[str, np.ndarray], StepPlan], Any]
    """checks parameters for copies (k,), and returns the values that `packing.derive` sets with them"""


# --- The choice of steps ------------------------------------------------------------------------------------


def plan_steps(
    scene: Scene,
    *,
    dynamics: str = "springs",
    integrator: str | None = None,
    step: float | None = None,
    damping_every: int | None = 1,
    varying: Collection[str] = (),
    task: StepRequirements = NO_REQUIREMENTS,
) -> StepPlan:
    """Return the method, step and cycle of a scene: the given ones, or the default ones of what is None.

    Parameters
    ----------
    scene, dynamics, integrator, step, varying
        See `springgym.simulator.Simulator`.
    damping_every
        Number of steps in a cycle. In a control period, None stands for the cheapest harmless one.
    task
        What else steps must be.

    Raises
    ------
    TypeError, ValueError
        If an argument is not possible, the method does not suit the scene, the step is unstable or so short
        that more than `MOST_STEPS` make a control period, or a control period is not of whole steps and
        cycles.
    """
    instance("scene", scene, Scene)
    kind = DYNAMICS[chosen("dynamics", dynamics, DYNAMICS)]
    if integrator is not None:
        instance("integrator", integrator, str)
    method = kind.integrator(kind.default(scene) if integrator is None else integrator)
    if not kind.rigid and (reason := refusal(method, scene, varying)):
        raise ValueError(reason)
    fastest = _fastest(scene, task.randomize, kind)
    limit = kind.largest_step(fastest, method)
    body = f"this body with randomize={task.randomize}" if task.randomize else "this body"
    given = step is not None
    if step is None:
        step = default_step(fastest, method, dynamics, task.finest)
        if task.wanted is not None:
            step = min(task.wanted, step if scene.can_touch else LONGEST * limit)
    else:
        step = _stable_step(step, limit, method, body, kind)
    each = "rigid bodies have no dampers" if kind.rigid else stability.damps_each_step(scene, method)
    cheapest = damping_every is None and task.period is not None
    cycle = 1 if cheapest else _checked_cycle(damping_every, each)
    if task.period is None:
        return StepPlan(method, step, cycle, limit)
    if given:
        if task.period / step > MOST_STEPS:
            raise ValueError(
                f"step is {step:g} s, {task.period / step:.3g} per control period of {task.period:g} s; "
                f"there must be at most {MOST_STEPS:,}"
            )
        steps = stability.steps_in(task.period, step)
    else:
        if not task.period <= MOST_STEPS * step:
            raise ValueError(
                f"{method.name} needs steps of {step:.3g} s on {body}, more than {MOST_STEPS:,} per control "
                f"period of {task.period:g} s: {_why_short(fastest, kind)}"
            )
        steps = math.ceil(task.period / step - 1e-9)
        # With surfaces, sweeps of dampers alternate in direction. After an even number, copies that began in
        # different periods have the same direction, and a block needs one sweep for all.
        if scene.surfaces and not kind.rigid:
            steps += steps % 2
        steps += -steps % cycle
    if cheapest and not each:
        steps, cycle = _cycles_in(scene, task, steps, exactly=given)
    if steps % cycle:
        raise ValueError(
            f"damping_every is {cycle}; it must divide the {steps} steps of a control period, because "
            "actions change at its end"
        )
    return StepPlan(method, step if given else task.period / steps, cycle, limit)


def default_step(
    scene: Scene, method: Integrator, dynamics: str = "springs", finest: float = math.inf
) -> float:
    """Return the default step [s]; it resolves impacts, unless a task knows the ``finest`` that they need."""
    if math.isinf(finest) and method.meets_surfaces:
        finest = longest_step(scene)
    return min(DYNAMICS[dynamics].usual_step(scene, method), finest)


def _stable_step(step: float, limit: float, method: Integrator, body: str, kind: Dynamics) -> float:
    """Return a given step [s], after checking that it is stable on a body with a limit [s]."""
    step = number("step", step, low=TINY)
    if not stability.is_unstable(step, limit):
        return step
    given, most = apart(step, stability.REFUSED * limit)
    own = "It chooses its own steps up to the given one. " if method.controlled else ""
    softer = "" if kind.rigid else ", softer springs or heavier particles"
    raise ValueError(
        f"a step of {given} s is unstable: {method.name} on {body} allows at most {most} s. {own}Take a "
        f"smaller step{softer}"
    )


def _checked_cycle(cycle: int | None, each: str) -> int:
    """Return a given cycle; ``each`` is the reason why dampers must act in each step, if there is one."""
    cycle = whole("damping_every", cycle, 1, stability.LONGEST_CYCLE)
    if cycle > 1 and cycle % 2:
        raise ValueError(f"damping_every is {cycle}; it must be 1 or even, because a cycle has a middle")
    if cycle > 1 and each:
        raise ValueError(f"damping_every is {cycle}; it must be 1: {each}")
    return cycle


def _cycles_in(scene: Scene, task: StepRequirements, steps: int, exactly: bool) -> tuple[int, int]:
    """Return the number of steps in a control period, at least or ``exactly`` ``steps``, and in a cycle: with
    contact, that of the task."""
    assert task.period is not None
    of = stability.varied(stability.vibrations(scene), task.randomize)
    if not scene.can_touch:
        return stability.cycles_in(of, task.period, steps, exactly)
    within = steps if exactly else steps + -steps % (2 * task.cycle)
    if within % task.cycle or not stability.cycles_harmless(of, task.period / within, task.cycle):
        return steps, 1
    return within, task.cycle


def _fastest(scene: Scene, ranges: Mapping[str, Sequence[float]], kind: Dynamics) -> Scene:
    """Return a scene with the stiffest and lightest bodies of ranges (low, high) of factors, and of 1."""
    if not ranges:
        return scene
    least = {name: min(low, 1.0) for name, (low, _) in ranges.items()}
    most = {name: max(high, 1.0) for name, (_, high) in ranges.items()}

    def fastest(body: Body) -> Body:
        return body.with_(
            stiffness=body.stiffness * most.get("stiffness", 1.0),
            damping=body.damping * most.get("damping", 1.0),
            masses=body.masses * least.get("masses", 1.0),
        )

    bodies = (replace(placed, body=fastest(placed.body)) for placed in scene.bodies)
    scene = scene.with_(bodies=tuple(bodies))
    if kind.rigid and scene.gravity is not None:  # a body swings about its pin as √(g/l)
        pull = most.get("gravity", 1.0) / least.get("scale", 1.0)
        scene = scene.with_(gravity=tuple((pull * np.array(scene.gravity)).tolist()))
    return scene


def _why_short(scene: Scene, kind: Dynamics) -> str:
    """Return a description of what limits the step most."""
    if kind.rigid:
        return "it starts to turn too fast"
    found = []
    for placed in scene.bodies:
        body = placed.body
        stiffness = np.zeros(len(body.masses))
        damping = np.zeros(len(body.masses))
        for end in body.springs.T:
            np.add.at(stiffness, end, body.stiffness)
            np.add.at(damping, end, body.damping)
        rate = np.maximum(np.sqrt(stiffness / body.masses), damping / body.masses) * placed.free
        n = int(np.argmax(rate))
        what = (
            f"particle {n} of {body.masses[n]:.3g} kg is held by springs of {stiffness[n]:.3g} N/m and "
            f"dampers of {damping[n]:.3g} kg/s in all"
        )
        found.append((float(rate[n]), what))
    return max(found)[1]


# --- The kinds of dynamics ----------------------------------------------------------------------------------


def _check_stable(packed: Packed, index: np.ndarray, given: Mapping[str, np.ndarray], plan: StepPlan) -> None:
    """Raise ValueError for parameters of a body that make the step of a copy unstable.

    With stiffness at most a times and masses at least 1/b times those of the scene, K ≤ a K₀ and
    M ≥ M₀/b, so that ω² ≤ a b ω₀²; likewise for dampers. Only if that bound does not suffice, the limit is
    computed.
    """
    names = ("masses", "stiffness", "damping")
    if not given.keys() & set(names) or plan.limit == np.inf:
        return
    body = packed.scene.body
    now = {name: given.get(name, packing.values(packed, name, index)) for name in names}
    lighter = (body.masses / now["masses"]).max(axis=1)
    faster = np.sqrt(lighter * (now["stiffness"] / body.stiffness).max(axis=1, initial=0.0))
    if np.isfinite(plan.method.real_limit):
        damped = now["damping"] > body.damping
        with np.errstate(divide="ignore"):
            more = np.divide(now["damping"], body.damping, out=np.ones(damped.shape), where=damped)
        faster = np.maximum(faster, lighter * more.max(axis=1, initial=0.0))
    for n in np.flatnonzero(plan.step * faster > stability.REFUSED * plan.limit):
        own = body.with_(**{name: values[n] for name, values in now.items()})
        limit = stability.largest_step(packed.scene.with_(body=own), plan.method)
        if stability.is_unstable(plan.step, limit):
            step, most = apart(plan.step, stability.REFUSED * limit)
            raise ValueError(
                f"these {', '.join(given)} make the step of {step} s unstable in copy {index[n]}: "
                f"{plan.method.name} allows at most {most} s there"
            )


def _shapes(
    packed: Packed, index: np.ndarray, given: Mapping[str, np.ndarray], plan: StepPlan
) -> list[dict[str, np.ndarray]]:
    """Return the values of rigid bodies of the given masses and lengths of springs.

    Raises
    ------
    ValueError
        If one has no inertia, or the lengths of one are not those of its body times one factor.
    """
    if given.keys().isdisjoint({"masses", "lengths"}):
        return []
    masses, lengths = (given.get(name, packing.values(packed, name, index)) for name in ("masses", "lengths"))
    factors = lengths / packed.scene.body.lengths
    uneven = np.ptp(factors, axis=1) > UNEVEN * factors[:, 0] if factors.size else np.zeros(len(index), bool)
    if uneven.any():
        raise ValueError(
            f"lengths of body {packed.scene.body.name!r} in copy {index[np.argmax(uneven)]} are not those of "
            "the body times one factor; a rigid body can only be larger or smaller as a whole"
        )
    scales = packing.sizes(packed, lengths)
    return [rigid.shape_values(packed.scene, *own) for own in zip(masses, scales, strict=True)]


def _settled(packed: Packed, x: np.ndarray, index: np.ndarray) -> np.ndarray:
    """Return the positions (k, N, 3) of particles of copies (k,) moved onto their rigid shapes [m]."""
    masses, lengths = (packing.values(packed, name, index) for name in ("masses", "lengths"))
    return rigid.settled(packed.scene, x, masses, packing.sizes(packed, lengths), index)


DYNAMICS = {
    "springs": Dynamics(
        rigid=False,
        default=lambda scene: "verlet",
        integrator=integrators.integrator,
        advance_kernel=integrators.advance_kernel,
        largest_step=stability.largest_step,
        usual_step=stability.usual_step,
        settled=None,
        follow=_check_stable,
    ),
    "rigid": Dynamics(
        rigid=True,
        default=rigid.default,
        integrator=rigid.integrator,
        advance_kernel=rigid.advance_kernel,
        largest_step=rigid.largest_step,
        usual_step=rigid.usual_step,
        settled=_settled,
        follow=_shapes,
    ),
}
"""Kinds of dynamics by name."""
