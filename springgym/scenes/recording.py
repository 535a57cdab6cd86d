"""Simulation of plans, and recording of their states."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from springgym.checks import apart, chosen, flag, function, instance, refusing_unknown
from springgym.dynamics.contact.totals import PairReadings
from springgym.dynamics.contacts import Contacts
from springgym.dynamics.measures import SIZE, Measures, view
from springgym.dynamics.methods.record import Integrator
from springgym.dynamics.stepping import DYNAMICS
from springgym.scenes.plan import Plan
from springgym.simulator import SimulationDivergedError, Simulator

__all__ = ["MOST_BYTES", "MOST_STEPS", "Progress", "Recording", "contacts_of", "record", "rigid_twin"]

Progress = Callable[[Iterable[Any]], Iterable[Any]]
"""A function that wraps an iterator, to show progress."""

MOST_STEPS = 10_000_000
"""Largest number of steps between recorded states: some seconds without progress or reaction to Ctrl-C."""

MOST_BYTES = 4_000_000_000
"""Largest size of all recorded states [bytes]."""


@dataclass(frozen=True, eq=False)
class Recording:
    """A simulated plan, with its states at T times."""

    plan: Plan
    simulator: str
    """description of the simulator"""
    integrator: Integrator
    step: float
    """time of a step [s]"""
    times: np.ndarray
    """(T,) times of the states [s], from 0"""
    positions: np.ndarray
    """(T, N, 3) positions of the particles [m]"""
    velocities: np.ndarray
    """(T, N, 3) velocities of the particles [m/s]"""
    measures: Measures
    """measures of all bodies together, of shape (T,) or (T, 3)"""
    bodies: tuple[Measures, ...]
    """measures of each body"""
    pairs: PairReadings
    """readings of pairs of bodies since the start, (T, pairs) in the order of `Scene.meetings`"""
    complete: bool
    """False if the simulation was interrupted"""
    shadow: tuple[float, float]
    """`Simulator.shadow_energy` at the start and at the end [J]; NaN if it is not known"""
    contacts: tuple[Contacts, ...] = ()
    """`Simulator.contacts` at each time, if requested or needed by a check, and available"""

    @property
    def parts(self) -> tuple[Recording, ...]:
        """Return a recording of each body by itself, in the form that a scene of this body alone would
        give."""
        plan = self.plan
        if not plan.parts:
            return (self,)
        each = zip(plan.parts, plan.scene.parts, plan.scene.slices, self.bodies, strict=True)
        return tuple(
            replace(
                self,
                plan=replace(part, scene=scene, duration=plan.duration, interval=plan.interval),
                positions=self.positions[:, own],
                velocities=self.velocities[:, own],
                measures=m,
                bodies=(m,),
                pairs=PairReadings(*(of[:, :0] for of in self.pairs)),
                shadow=(math.nan, math.nan),
                contacts=(),
            )
            for part, scene, own, m in each
        )


@refusing_unknown
def record(
    plan: Plan, *, dynamics: str = "springs", contacts: bool = False, progress: Progress = iter
) -> Recording:
    """Simulate a plan.

    Parameters
    ----------
    plan
        The plan. A whole number of intervals is fitted into its duration, and a whole number of steps into
        the interval; if the plan has a step, the interval is rounded to a whole number of them instead.
    dynamics
        "springs", or "rigid" for the rigid twin, which has its own method and, unless it rolls, its own step.
    contacts
        Whether to record the contacts, too, even if no check needs them. They are left out if the scene or
        the method cannot report them.
    progress
        A function that wraps the iterator over states, to show progress. Ctrl-C ends the simulation; the
        recording then holds the states so far, if there are at least two.

    Raises
    ------
    SimulationDivergedError
        If the simulation diverges.
    TypeError
        If an argument has the wrong type.
    ValueError
        If the integrator or the step does not fit the scene, or there are too many steps or states.
    """
    instance("plan", plan, Plan)
    chosen("dynamics", dynamics, DYNAMICS)
    flag("contacts", contacts)
    function("progress", progress)
    plan = replace(plan, interval=plan.duration / max(1, round(plan.duration / plan.interval)))
    simulator = _simulator(plan, dynamics)
    steps = max(1, round(plan.interval / simulator.step))
    count = 1 + max(1, round(plan.duration / (steps * simulator.step)))
    _check_size(plan, simulator.step, steps, count)
    positions = np.zeros((count, *plan.scene.positions.shape))
    velocities = np.zeros_like(positions)
    rows = np.zeros((count, SIZE))
    several = len(plan.scene.bodies) > 1
    each = np.zeros((count, len(plan.scene.bodies), SIZE)) if several else rows[:, None]
    told: list[PairReadings] = []
    touching: list[Contacts] = []
    floppy = any(placed.body.floppy for placed in plan.scene.bodies)
    done = 0
    shadow = [math.nan, math.nan]
    try:
        for n in progress(range(count)):
            if n > 0:
                simulator.advance(steps, check=not floppy)  # a cord may double its length
            simulator.read()
            read = simulator.readout
            rows[n] = read.rows[0]
            positions[n] = read.positions[0]
            velocities[n] = read.velocities[0]
            each[n] = read.bodies[0]
            told.append(simulator.pairs())
            if (contacts or plan.contacts) and (found := contacts_of(simulator)) is not None:
                touching.append(found)
            if not np.isfinite(velocities[n]).all():
                raise SimulationDivergedError(f"{plan.name} diverged before t = {simulator.time[0]:g} s")
            if n in (0, count - 1):
                shadow[n > 0] = _shadow(simulator)
            done = n + 1
    except KeyboardInterrupt:
        if done < 2:
            raise
    return Recording(
        plan=plan,
        simulator=repr(simulator),
        integrator=simulator.integrator,
        step=simulator.step,
        times=simulator.step * steps * np.arange(done),
        positions=positions[:done],
        velocities=velocities[:done],
        measures=view(rows[:done]),
        bodies=tuple(view(each[:done, n]) for n in range(each.shape[1])),
        pairs=PairReadings(*(np.concatenate(of) for of in zip(*told[:done], strict=True))),
        complete=done == count,
        shadow=(shadow[0], shadow[1]),
        contacts=tuple(touching[:done]),
    )


def contacts_of(simulator: Simulator) -> Contacts | None:
    """Return the current contacts of a simulator; None if `Simulator.contacts` cannot report them."""
    if not instance("simulator", simulator, Simulator).scene.can_touch:
        return None
    try:
        return simulator.contacts()
    except ValueError:
        return None


def _shadow(simulator: Simulator) -> float:
    try:
        return float(simulator.shadow_energy()[0])
    except ValueError:
        return math.nan


def _check_size(plan: Plan, step: float, steps: int, count: int) -> None:
    """Raise ValueError for runs that would take too many steps, or not fit into memory."""
    bodies = [placed.body for placed in plan.scene.bodies]
    if step > plan.duration * (1 + 1e-9):
        given, most = apart(step, plan.duration)
        raise ValueError(f"a step of {given} s is longer than the run of {most} s")
    if steps > MOST_STEPS:
        why = "take a longer one"
        if plan.step is None:
            stiffness = max(body.stiffness.max(initial=0) for body in bodies)
            damping = max(body.damping.max(initial=0) for body in bodies)
            why = (
                f"masses from {plan.scene.masses.min():g} kg, stiffness up to {stiffness:g} N/m and damping "
                f"up to {damping:g} kg/s ask for it"
            )
        raise ValueError(
            f"a step of {step:g} s makes {steps:g} steps in an interval of {plan.interval:g} s; at most "
            f"{MOST_STEPS:g} are allowed: {why}"
        )
    told = SIZE * (1 + len(bodies) if len(bodies) > 1 else 1)
    told += len(PairReadings._fields) * len(plan.scene.meetings)
    size = count * (2 * plan.scene.positions.nbytes + 8 * told)
    if size > MOST_BYTES:
        raise ValueError(
            f"{plan.duration:g} s at intervals of {plan.interval:g} s are {count:g} states of "
            f"{size / 1e9:.3g} GB, and at most {MOST_BYTES / 1e9:g} GB are kept: take a longer interval or a "
            "shorter duration"
        )


def _simulator(plan: Plan, dynamics: str) -> Simulator:
    # Dampers act in every step: with cycles bodies ring for longer, and theory is of bodies that do not ring.
    # A rigid body's own step may not resolve the impacts that the plan's does.
    step = plan.step if dynamics == "springs" or plan.scene.surfaces else None
    options: dict[str, Any] = {"dynamics": dynamics, "damping_every": 1, "step": step}
    if dynamics == "springs":
        options["integrator"] = plan.integrator
    simulator = Simulator(plan.scene, **options)
    if step is not None:
        return simulator
    options["step"] = plan.interval / math.ceil(plan.interval / simulator.step - 1e-9)
    return Simulator(plan.scene, **options)


def rigid_twin(recording: Recording) -> Recording | None:
    """Simulate the plan of a recording with a rigid body, at the same times; on surfaces, in the same steps.

    Return None if a body or the scene has no rigid twin, or if bodies collide: after some impacts, springs
    and twin follow different paths.
    """
    if instance("recording", recording, Recording).plan.scene.meetings:
        return None
    interval = float(recording.times[1]) if len(recording.times) > 1 else recording.plan.interval
    duration = float(recording.times[-1])
    try:
        plan = replace(recording.plan, interval=interval, duration=duration, step=recording.step)
        return record(plan, dynamics="rigid")
    except ValueError:
        return None
