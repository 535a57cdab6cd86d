"""Cases in which simulators break. Each has a criterion, a measured value and a verdict.

``python -m benchmarks.hard_cases`` runs them, and its exit status is 1 if any fails. Each case has a broken
twin with one deliberate mistake, which its text names and the criterion must detect.
"""

from __future__ import annotations

import argparse
import math
import re
import sys
import warnings
from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import partial
from types import SimpleNamespace
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, DTypeLike

from benchmarks.conditions import progress
from springgym import theory
from springgym.cli import guarded
from springgym.core.language.blocks import numbers
from springgym.dynamics.contact.law import SLOW
from springgym.dynamics.forces.springs import decay
from springgym.dynamics.terms import Decay
from springgym.model.bodies import Body, ball, box, cube, rope, rotation, start, top
from springgym.model.bodies.elasticity import spring_force_and_jacobian
from springgym.model.collisions import distance
from springgym.model.scene import GRAVITY, Placed, Scene
from springgym.model.surfaces import Bowl, Contact, Plane, floor, incline
from springgym.simulator import PrecisionWarning, SimulationDivergedError, Simulator

WEIGHTLESS = (0.0, 0.0, 0.0)
"""Zero gravity, which uses the same compiled code as gravity."""


class Outcome(NamedTuple):
    """The outcome of a case."""

    measured: str
    passed: bool


class Case(NamedTuple):
    """One hard case."""

    number: int
    name: str
    criterion: str
    twin: str
    """what is wrong when it is run ``broken``"""
    run: Callable[[bool], Outcome]


CASES: list[Case] = []
"""All cases, in the order of their numbers."""


def case(function: Callable[[bool], Outcome]) -> Callable[[bool], Outcome]:
    """Add a function of ``broken`` to `CASES`: its docstring names the case, its criterion and its twin."""
    text = " ".join(str(function.__doc__).split()).removesuffix(".")
    name, criterion, twin = re.split(r"\.\s+(?:Wanted|Broken): ", text)
    CASES.append(Case(len(CASES) + 1, name, criterion, twin, function))
    return function


# --- What the cases share -----------------------------------------------------------------------------


def kept_by_nodes(simulator: Simulator) -> np.ndarray:
    """Return the energy (copies,) [J] that nodes keep through impacts, as long as vibrations are small.

    It is H + V(x) − (V(x − h v/2) + V(x + h v/2))/2, with the springs' energy V at the state and at the nodes
    before and after it. Each impulse at a node changes the kinetic energy as the ledger says, and the linear
    springs of a vibration keep the sum. `Simulator.shadow_energy` is kept by all motion between impacts.
    """
    scene = simulator.scene
    x = simulator.positions
    half = simulator.step / 2 * simulator.velocities

    def springs(places: np.ndarray) -> np.ndarray:
        lengths = np.linalg.norm(np.diff(places[:, scene.springs], axis=2)[:, :, 0], axis=2)
        return (scene.of_bodies("stiffness") * (lengths - scene.lengths) ** 2).sum(axis=1) / 2

    return np.asarray(simulator.measure().energy + springs(x) - (springs(x - half) + springs(x + half)) / 2)


def forced(scene: Scene, step: float) -> Simulator:
    """Make a simulator of any step, without the check of the stability limit."""
    made = Simulator(scene)
    vars(made).update(step=step, _control=step)
    return made


def terms(simulator: Simulator) -> Any:
    """Return the arguments of a simulator's kernels, which the broken twins change."""
    return simulator._terms


def set_dampers(simulator: Simulator, decaying: Callable[[float], Decay]) -> None:
    """Change what its dampers do in some time [s]."""
    dampers = terms(simulator).dampers
    whole = simulator.damping_every * simulator.step
    for arrays, time in ((dampers.half, whole / 2), (dampers.whole, whole)):
        for array, value in zip(arrays, decaying(time), strict=True):
            array[:] = value


def drag(simulator: Simulator, share: float) -> None:
    """Take a share of all velocities: the loss that a simulator must not have."""
    numbers(simulator._v)[:] *= 1 - share


def tilt(simulator: Simulator) -> float:
    """Return the angle [rad] of the third axis of copy 0 from the upright."""
    x, y, z = simulator.measure().axis[0]
    return math.atan2(math.hypot(x, y), z)


def fitted_power(x: ArrayLike, y: ArrayLike) -> float:
    """Return the power p of y ∝ xᵖ."""
    return float(np.polyfit(np.log(x), np.log(y), 1)[0])


def refused(make: Callable[[], Any], *words: str) -> bool:
    """Return whether ``make`` raises a ValueError that contains all the words."""
    try:
        make()
    except ValueError as error:
        return all(word in str(error) for word in words)
    return False


# --- Springs ------------------------------------------------------------------------------------------


@case
def stability_limit(broken: bool) -> Outcome:
    """step at the stability limit.

    Wanted: 0.99 of the limit: strain < 1e-3 after 20000 steps; 1.01: refused, and reported if forced.
    Broken: limit of a single oscillator, 2 √(m/k).
    """
    body = cube(damping=0.0)
    noise = np.random.default_rng(1).normal(0.0, 1e-3, (8, 3))
    scene = Scene(body, velocities=noise, gravity=WEIGHTLESS)
    limit = Simulator(scene).largest_step
    if broken:
        limit = 2 * math.sqrt(body.masses.min() / body.stiffness.max())
    stable = forced(scene, 0.99 * limit)
    stable.advance(20000, check=False)
    strain = stable.measure().strain[0]
    refusal = refused(lambda: Simulator(scene, step=1.01 * limit), "unstable")
    try:
        forced(scene, 1.01 * limit).advance(20000)
        reported = False
    except SimulationDivergedError:
        reported = True
    return Outcome(
        f"strain {strain:.1e}; {'refused' if refusal else 'accepted'}, "
        f"{'reported' if reported else 'silent'}",
        bool(strain < 1e-3 and refusal and reported),
    )


def swung_cube(stiffness: float, seconds: float = 1.0, longer: float = 0.0) -> tuple[float, float]:
    """Return the gap [m] of a cube swinging from 2 rad to the rigid one, and its strain."""
    body = cube(stiffness=stiffness, damping=0.0)
    at = theory.pendulum.cube_on_vertex(1.0, 1.0)
    theta, _ = theory.pendulum.motion(at.i1, at.mgl, 2.0, 0.0, np.array([seconds]))
    rigid = start(body, tilt=math.pi - theta[0], pinned=(0,), stretched=False).positions
    began = start(body, tilt=math.pi - 2.0, pinned=(0,), gravity=GRAVITY)
    scene = Scene(body.with_(lengths=body.lengths * (1 + longer)), *began, pinned=(0,))
    count = math.ceil(seconds / Simulator(scene).step)
    simulator = Simulator(scene, step=seconds / count)
    simulator.advance(count)
    return float(np.abs(simulator.positions[0] - rigid).max()), float(simulator.measure().strain[0])


@case
def stiffness_range(broken: bool) -> Outcome:
    """stiffness from 1e3 to 1e9, automatic step.

    Wanted: largest strain · k/Mg < 1, gap to the rigid cube ∝ kᵖ with p = −1.00 ± 0.02.
    Broken: springs made 1e-6 too long.
    """
    stiffness = 10.0 ** np.arange(3, 10)
    gaps, strains = np.transpose([swung_cube(k, longer=1e-6 * broken) for k in stiffness])
    power = fitted_power(stiffness, gaps)
    load = (strains * stiffness / 9.81).max()
    return Outcome(
        f"strain · k/Mg {load:.2f}, p = {power:.3f}, gap {gaps[0]:.0e} … {gaps[-1]:.0e} m",
        bool(load < 1 and abs(power + 1) < 0.02),
    )


@case
def heavy_rope(broken: bool) -> Outcome:
    """rope, 0.1 and 0.01 kg beads under 70 kg.

    Wanted: stretch of every spring at rest is the weight below it over k, to 1e-6.
    Broken: force along u, not û: k times the length.
    """
    worst = 0.0
    for bead in (0.1, 0.01):
        body = rope(bead_mass=bead)
        if broken:
            body = body.with_(stiffness=body.stiffness * body.lengths)
        simulator = Simulator(Scene(body, pinned=(0,)))
        # The bounce dies away as e^(−t/30 s); what is broken hangs by the wrong stretch long before.
        simulator.advance(math.ceil((100 if broken else 600) / simulator.step))
        stretch = -np.diff(simulator.positions[0][:, 2]) - body.lengths
        expected = theory.rope.tensions(body.masses[1:]) / 1e5
        worst = max(worst, float(np.abs(stretch / expected - 1).max()))
    return Outcome(f"relative error {worst:.1e}", worst < 1e-6)


def plucked_cube(damping: float) -> Simulator:
    """Make a free cube that is blown up by 1 %, with a step of a tenth of the limit."""
    body = cube(damping=damping)
    scene = Scene(body, 1.01 * body.positions, gravity=WEIGHTLESS)
    return Simulator(scene, step=Simulator(scene).largest_step / 10)


def energies(simulator: Simulator, samples: int, every: int = 1) -> np.ndarray:
    """Return the energy of copy 0 [J] at the start and after each of so many advances."""
    values = [simulator.measure().energy[0]]
    for _ in range(samples):
        simulator.advance(every, check=False)
        values.append(simulator.measure().energy[0])
    return np.array(values)


def explicit(rates: np.ndarray, time: float) -> Decay:
    """Return the impulses of dampers that have no bound: their rates (4,) times the time [s]."""
    return Decay(*(time * rates))


@case
def damping_range(broken: bool) -> Outcome:
    """damping 0, critical and 100 × critical.

    Wanted: energy never exceeds its least so far by more than (ω h)²/4 = 1 % of the start's.
    Broken: damper as an explicit impulse, c h/2 times the speed.
    """
    critical = 2 * math.sqrt(1e5 * 0.125 / 2)
    worst = 0.0
    with np.errstate(all="ignore"):
        for damping in (0.0, critical, 100 * critical):
            simulator = plucked_cube(damping)
            if broken and damping:
                rates = damping * np.array([1.0, 8.0, 8.0, 1.0])
                set_dampers(simulator, partial(explicit, rates))
            energy = energies(simulator, 500)
            rise = np.max(energy - np.minimum.accumulate(energy)) / energy[0]
            worst = max(worst, np.inf if np.isnan(rise) else float(rise))
    return Outcome(f"rise {worst:.1e}", worst < 0.01)


@case
def fast_spin(broken: bool) -> Outcome:
    """50 rev/s for 10 s, undamped.

    Wanted: spin kept to 1e-6.
    Broken: a drag that takes 1e-6 of the speed each second.
    """
    body = cube(stiffness=1e7, damping=0.0)
    spin = 2 * math.pi * 50
    scene = Scene(body, *start(body, omega=(0.0, 0.0, spin)), gravity=WEIGHTLESS)
    simulator = Simulator(scene)
    second = math.ceil(1 / simulator.step)
    turned = simulator.positions[0]
    worst = 0.0
    for _ in range(10):
        simulator.advance(second)
        if broken:
            drag(simulator, 1e-6)
        worst = max(worst, abs(simulator.measure().angular_velocity[0, 2] / spin - 1))
    moved = np.abs(simulator.positions[0] - turned).max() > 0.01
    return Outcome(f"relative change {worst:.1e}", bool(worst < 1e-6 and moved))


@case
def sleeping_top(broken: bool) -> Outcome:
    """sleeping top 2 % above and below the threshold.

    Wanted: from a tilt of 1e-3 rad, over 20 s: above it stays < 0.02 rad, below it falls as far as theory ±
    10 %.
    Broken: gravity 10 % too strong.
    """
    body = top(damping=0.0)
    tip = body.particle("tip")
    rigid = theory.top.cone_top_inertia(12.0, 0.5, 1.0)
    largest = []
    for share in (1.02, 0.98):
        spin = share * theory.top.sleeping_threshold(rigid)
        began = start(body, tilt=1e-3, spin=spin, pinned=(tip,))
        simulator = Simulator(
            Scene(body, *began, pinned=(tip,), gravity=(0.0, 0.0, -9.81 * (1 + 0.1 * broken)))
        )
        most = 0.0
        for _ in range(1000):
            simulator.advance(math.ceil(0.02 / simulator.step))
            most = max(most, tilt(simulator))
        largest.append(most)
    lowest, _, _ = theory.top.turning_points(rigid, theory.top.TopState(1e-3, spin))
    expected = math.acos(lowest)
    passed = largest[0] < 0.02 and abs(largest[1] / expected - 1) < 0.1
    return Outcome(f"{largest[0]:.4f} rad above; {largest[1]:.3f} of {expected:.3f} rad below", passed)


@case
def flips(broken: bool) -> Outcome:
    """flips about the middle axis (Dzhanibekov).

    Wanted: 20 intervals, each theory's ± 1e-3.
    Broken: one corner 10 % heavier than theory has it.
    """
    body = box((1.0, 0.7, 0.4), [0.125 * (1 + 0.1 * broken), *[0.125] * 7], 1e6, 0.0)
    omega = (0.2, 6.0, 0.2)
    interval = theory.free_body.flip_interval(
        theory.free_body.corner_box_inertia(1.0, (1.0, 0.7, 0.4)), omega
    )
    simulator = Simulator(Scene(body, *start(body, omega=omega), gravity=WEIGHTLESS))
    every = math.ceil(interval / 400 / simulator.step)
    times: list[float] = []
    before = 0.0
    when = 0.0
    while len(times) < 21 and simulator.time[0] < 25 * interval:
        simulator.advance(every)
        x = simulator.positions[0]
        along = float((x[2] - x[1]) @ simulator.measure().angular_momentum[0])
        if before * along < 0:
            times.append(when + (simulator.time[0] - when) * before / (before - along))
        before = along
        when = simulator.time[0]
    worst = float(np.abs(np.diff(times) / interval - 1).max(initial=0.0))
    return Outcome(f"{len(times) - 1} intervals, worst {worst:.1e}", len(times) == 21 and worst < 1e-3)


@case
def million_steps(broken: bool) -> Outcome:
    """a million undamped steps.

    Wanted: energy within 1e-4 and without trend (halves agree to 1e-6), P and L to 1e-11.
    Broken: a drag that takes 1e-9 of the speed every 10000 steps.
    """
    body = box((1.0, 0.7, 0.4), damping=0.0)
    began = start(body, omega=(1.0, 3.0, 2.0), velocity=(0.01, 0.02, 0.03))
    simulator = Simulator(Scene(body, *began, gravity=WEIGHTLESS))
    first = simulator.measure()
    energy = []
    for _ in range(100):
        simulator.advance(10000)
        if broken:
            drag(simulator, 1e-9)
        energy.append(simulator.measure().energy[0] / first.energy[0] - 1)
    last = simulator.measure()
    change = max(
        float(
            np.linalg.norm(getattr(last, name) - getattr(first, name)) / np.linalg.norm(getattr(first, name))
        )
        for name in ("momentum", "angular_momentum")
    )
    band = np.abs(energy).max()
    trend = abs(np.mean(energy[:50]) - np.mean(energy[50:]))
    return Outcome(
        f"energy {band:.1e}, trend {trend:.1e}, P and L {change:.1e}",
        bool(band < 1e-4 and trend < 1e-6 and change < 1e-11),
    )


@case
def printed_sign(broken: bool) -> Outcome:
    """equation 3 with the printed sign.

    Wanted: c < 0 is refused; the damper takes energy: < 0.9 of the start's after 500 steps.
    Broken: the sign of the damper turned round.
    """
    simulator = plucked_cube(10.0)
    if broken:
        damping = -simulator.scene.body.damping
        set_dampers(simulator, lambda time: decay(damping, 8.0, 8.0, time))
    energy = energies(simulator, 500)
    refusal = refused(lambda: cube(damping=-10.0), "damping is -10.0")
    ratio = energy[-1] / energy[0]
    return Outcome(
        f"energy × {ratio:.3g}, c < 0 {'refused' if refusal else 'accepted'}", bool(ratio < 0.9 and refusal)
    )


@case
def squeezed(broken: bool) -> Outcome:
    """a spring of no length, a spring inside out.

    Wanted: forces and 5000 steps finite.
    Broken: spring force without a guard at L = 0.
    """
    body = cube(damping=0.0)
    collapsed = body.positions.copy()
    inverted = body.positions.copy()
    collapsed[0] = collapsed[6] + (0.0 if broken else 1e-12)  # scenes refuse 0
    inverted[0] = 1.5 * inverted[6]
    largest = 0.0
    for positions in (collapsed, inverted):
        if broken:
            with np.errstate(all="ignore"):
                values, _ = spring_force_and_jacobian(body, positions)
        else:
            simulator = Simulator(Scene(body, positions, gravity=WEIGHTLESS))
            simulator.advance(5000, check=False)
            values = np.array([*simulator.positions[0], *simulator.velocities[0]])
        largest = max(largest, float(np.abs(values).max()))  # not a number stays one
        if not np.isfinite(values).all():
            largest = math.nan
            break
    return Outcome(f"largest value {largest:.3g}", math.isfinite(largest))


# --- Contact ------------------------------------------------------------------------------------------


def contact_simulator(scene: Scene, broken: bool) -> Simulator:
    """Make a simulator of the default method, or of the paper's: a force that is sampled, and a clamp."""
    return Simulator.paper(scene) if broken else Simulator(scene)


@case
def fast_drop(broken: bool) -> Outcome:
    """drop at 20 m/s, speed · step > reach.

    Wanted: no particle below the floor, and no apex above the start by more than 1 %.
    Broken: the paper's contact: sampled force and clamp.
    """
    body = cube(damping=0.0)
    began = start(body, rotation=(0.3, 0.5, 0.2), position=(0.0, 0.0, 21.0))
    scene = Scene(body, *began, surfaces=(floor(),), contact=Contact(reach=0.005))
    simulator = contact_simulator(scene, broken)
    lowest = np.inf
    highest = 0.0
    fallen = False
    for _ in range(600):
        simulator.advance(math.ceil(0.02 / simulator.step), check=False)
        lowest = min(lowest, simulator.positions[0][:, 2].min())
        height = simulator.measure().centre[0, 2]
        fallen |= bool(height < 2)
        highest = max(highest, height if fallen else 0.0)
    fast = 20 * simulator.step > 0.005
    return Outcome(
        f"lowest {lowest:.1e} m, apex {highest:.2f} of 21 m",
        bool(fast and fallen and lowest > 0 and highest < 21 * 1.01),
    )


@case
def below_and_corner(broken: bool) -> Outcome:
    """start below the floor, corner of two planes.

    Wanted: below: refused by particle; thrown into the corner at 10 m/s: the energy that nodes keep of a body
    that rings, at most 1 + 1e-3 of the start's.
    Broken: the paper's contact.
    """
    body = cube(damping=0.0)
    refusal = refused(lambda: Scene(body, surfaces=(floor(),)), "particle 4")
    surfaces = (floor(), Plane((0.0, 0.0, 0.0), (1.0, 0.0, 0.0)))
    began = start(body, rotation=(0.3, 0.5, 0.2), position=(1.5, 0.0, 1.5), velocity=(-7.0, 0.0, -7.0))
    scene = Scene(body, *began, surfaces=surfaces, contact=Contact(reach=0.005))
    simulator = contact_simulator(scene, broken)

    def energy() -> float:
        return float((simulator.measure().energy if broken else kept_by_nodes(simulator))[0])

    first = energy()
    most = -math.inf
    for _ in range(200):
        simulator.advance(10, check=False)
        most = max(most, energy() / first)
    turned = simulator.measure().centre_velocity[0, 0] > 1
    return Outcome(
        f"{'refused' if refusal else 'accepted'}; energy at most {most:.6f}",
        bool(refusal and turned and most < 1 + 1e-3),
    )


@case
def hundred_bounces(broken: bool) -> Outcome:
    """100 undamped bounces.

    Wanted: a cube, steps of a tenth of the limit: energy within (ω h)²/4 = 1 % of the start's.
    Broken: the paper's contact, at the paper's step.
    """
    body = cube(damping=0.0)
    began = start(body, rotation=(0.3, 0.5, 0.2), omega=(1.0, 2.0, 0.5), position=(0.0, 0.0, 1.8))
    scene = Scene(body, *began, surfaces=(floor(),))
    simulator = contact_simulator(scene, broken)
    if not broken:
        simulator = Simulator(scene, step=simulator.largest_step / 10)
    first = simulator.measure().energy[0]
    bounces = 0
    touched = False
    worst = 0.0
    while bounces < 100 and simulator.time[0] < 200:
        simulator.advance(10, check=False)
        measured = simulator.measure()
        touches = bool(measured.contact[0] > 0)
        bounces += touches and not touched
        touched = touches
        worst = max(worst, abs(float(measured.energy[0]) / first - 1))
    return Outcome(f"{bounces} bounces, {worst:.1e}", bool(bounces == 100 and worst < 0.01))


def pair(damping: float) -> Body:
    """Make two particles side by side that bounce as one."""
    x = np.array([[0.0, 0, 0], [1, 0, 0]])
    one = np.ones(1)
    return Body("pair", x, np.ones(2), np.array([(0, 1)]), 100 * one, damping * one, floppy=True)


@case
def restitution(broken: bool) -> Outcome:
    """restitution 0 … 1.

    Wanted: rebound over impact speed as asked for, ± 1e-3.
    Broken: loss 2 % too large.
    """
    worst = 0.0
    for asked in (0.0, 0.2, 0.4, 0.6, 0.8, 0.99, 1.0):
        contact = Contact(friction=0.5, restitution=asked, strength=0.05, reach=0.02)
        body = pair(1.0)
        began = start(body, position=(0.5, 0.0, 0.03), velocity=(0.0, 0.0, -1.0))
        scene = Scene(body, *began, gravity=WEIGHTLESS, surfaces=(floor(),), contact=contact)
        if asked == 1.0:
            scene = scene.with_(body=pair(0.0), contact=Contact(strength=0.05, reach=0.02))
        simulator = Simulator(scene, step=1e-4)
        if broken and asked < 1:
            loss = terms(simulator).loss
            (numbers(loss) if loss.dtype.names else loss)[:] *= 1.02
        simulator.advance(2000 if asked else 20000)
        rebound = simulator.velocities[0][:, 2].max()
        worst = max(worst, abs(float(rebound) - theory.contact.rebound(1.0, asked, SLOW)))
    return Outcome(f"error {worst:.1e}", worst < 1e-3)


def resting_cube(angle: float, friction: float, gravity: tuple[float, float, float] = GRAVITY) -> Simulator:
    """Return a cube after 2 s on a slope that rises towards x."""
    body = cube(damping=30.0)
    normal = np.array([-math.sin(angle), 0.0, math.cos(angle)])
    contact = Contact(friction=friction, restitution=0.3, strength=0.05, reach=0.02)
    height = 0.5 + theory.contact.rest_height(9.81 / 4 * math.cos(angle), 0.05, 0.02)
    began = start(body, rotation=(0.0, -angle, 0.0), position=tuple(height * normal))
    scene = Scene(body, *began, gravity=gravity, surfaces=(incline(angle),), contact=contact)
    return Simulator(scene)


def drift(simulator: Simulator, seconds: float) -> float:
    """Return the distance that the centre of mass moves [m]."""
    before = simulator.measure().centre[0]
    simulator.advance(math.ceil(seconds / simulator.step))
    return float(np.linalg.norm(simulator.measure().centre[0] - before))


@case
def slope(broken: bool) -> Outcome:
    """slope at atan μ ± 1°.

    Wanted: 1° below: < 1e-5 m of creep in 10 s; 1° above: g (sin α − μ cos α) ± 1 %.
    Broken: friction 6 % too small.
    """
    limit = math.atan(0.5)
    friction = 0.5 * (1 - 0.06 * broken)
    steep = limit + math.radians(1)
    below = resting_cube(limit - math.radians(1), friction)
    drift(below, 2.0)
    creep = drift(below, 10.0)
    above = resting_cube(steep, friction)
    drift(above, 1.0)
    speeds = []
    for _ in range(2):
        speeds.append(np.linalg.norm(above.measure().centre_velocity[0]))
        began = above.time[0]
        drift(above, 2.0)
    ratio = (speeds[1] - speeds[0]) / (above.time[0] - began) / theory.contact.slope_acceleration(steep, 0.5)
    return Outcome(
        f"creep {creep:.1e} m; acceleration × {ratio:.4f}", bool(creep < 1e-5 and abs(ratio - 1) < 0.01)
    )


@case
def rest(broken: bool) -> Outcome:
    """cube at rest for 60 s.

    Wanted: on a floor off level by 0.1°: < 1e-6 m.
    Broken: friction forgotten.
    """
    lean = math.radians(0.1)
    simulator = resting_cube(0.0, 0.5, (9.81 * math.sin(lean), 0.0, -9.81 * math.cos(lean)))
    if broken:
        terms(simulator).friction[:] = 0.0
    drift(simulator, 2.0)
    moved = drift(simulator, 60.0)
    return Outcome(f"{moved:.1e} m", moved < 1e-6)


# --- Bodies, numbers, batches -------------------------------------------------------------------------


@case
def rings(broken: bool) -> Outcome:
    """rings of 6 to 48, automatic step.

    Wanted: spinning at 40 rad/s for 1 s: strain < 0.01, energy within 1e-4.
    Broken: the step of the smallest ring for all.
    """
    strain = 0.0
    worst = 0.0
    shared = None
    with np.errstate(all="ignore"):
        for ring in (6, 12, 24, 48):
            body = top(ring=ring, damping=0.0)
            tip = body.particle("tip")
            began = start(body, tilt=0.3, spin=40.0, pinned=(tip,), gravity=GRAVITY)
            scene = Scene(body, *began, pinned=(tip,))
            shared = shared or Simulator(scene).step
            simulator = forced(scene, shared) if broken else Simulator(scene)
            energy = energies(simulator, 100, math.ceil(0.01 / simulator.step))
            change = np.abs(energy / energy[0] - 1).max()
            stretched = simulator.measure().strain[0]
            worst, strain = (float(np.maximum(*pair)) for pair in ((worst, change), (strain, stretched)))
    return Outcome(f"strain {strain:.1e}, energy {worst:.1e}", strain < 0.01 and worst < 1e-4)


def thrown_cube(metres_away: float, dtype: DTypeLike) -> np.ndarray:
    """Return positions (8, 3) of a spinning cube after 1 s [m], about where it started."""
    body = cube(damping=0.0)
    began = start(body, omega=(1.0, 3.0, 2.0), position=(metres_away, 0.0, 0.0))
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", PrecisionWarning)
        simulator = Simulator(Scene(body, *began, gravity=WEIGHTLESS), dtype=dtype)
    simulator.advance(2000, check=False)
    return simulator.positions[0].astype(float) - (metres_away, 0.0, 0.0)


@case
def single_precision(broken: bool) -> Outcome:
    """float32, and 1 km from the origin.

    Wanted: float32: positions within 1e-4 m after 2000 steps; float64 1 km away: within 1e-6 m.
    Broken: both at once: float32 at 1 km.
    """
    exact = thrown_cube(0.0, np.float64)
    single = np.abs(thrown_cube(1e3 * broken, np.float32) - exact).max()
    far = np.abs(thrown_cube(1e3, np.float64) - exact).max()
    return Outcome(f"float32 {single:.1e} m, 1 km {far:.1e} m", bool(single < 1e-4 and far < 1e-6))


@case
def wild_actions(broken: bool) -> Outcome:
    """largest random and bang-bang actions, 1e5 steps of every environment.

    Wanted: observations and rewards finite, nothing diverges, no warning.
    Broken: a step of 1.5 times the stability limit.
    """
    import gymnasium as gym

    from springgym.envs.registration import ENVIRONMENTS, register

    register()
    random = np.random.default_rng(2)
    copies = 64
    bad = []
    steps = 0
    for row in ENVIRONMENTS:
        with warnings.catch_warnings(), np.errstate(all="ignore" if broken else "warn"):
            warnings.simplefilter("ignore" if broken else "error")
            env: Any = gym.make_vec(row.id, num_envs=copies, vectorization_mode="vector_entry_point")
            if broken:
                simulator = env.unwrapped.episodes.simulator
                vars(simulator).update(
                    step=1.5 * simulator.largest_step, _control=1.5 * simulator.largest_step
                )
            env.reset(seed=3)
            low = env.action_space.low
            high = env.action_space.high
            for n in range(10 if broken else math.ceil(1e5 / copies)):
                drawn = random.uniform(low, high)
                action = drawn if n // 50 % 2 else np.where(drawn > 0.5 * (low + high), high, low)
                observation, reward, _, _, info = env.step(action.astype(np.float32))
                steps += copies
                if info["diverged"].any() or not (
                    np.isfinite(observation).all() and np.isfinite(reward).all()
                ):
                    bad.append(row.id)
                    break
            env.close()
    return Outcome(f"{steps:.1e} steps; failed: {', '.join(bad) or 'none'}", not bad)


def starts(copies: int) -> tuple[np.ndarray, np.ndarray]:
    """Return positions and velocities (copies, 8, 3) of cubes that spin at random."""
    random = np.random.default_rng(4)
    began = [start(cube(damping=0.0), omega=random.normal(0, 3, 3).tolist()) for _ in range(copies)]
    return np.array([s.positions for s in began]), np.array([s.velocities for s in began])


def moved_batch(copies: int, positions: np.ndarray, velocities: np.ndarray, threads: int = 1) -> np.ndarray:
    """Return positions and velocities (copies, 2, 8, 3) after 4000 steps; odd copies start anew at half."""
    scene = Scene(cube(damping=0.0), gravity=WEIGHTLESS)
    simulator = Simulator(scene, copies=copies, threads=threads)
    simulator.place(positions, velocities)
    simulator.advance(2000, check=False)
    anew = np.arange(1, copies, 2)
    if len(anew):
        simulator.place(positions[anew], velocities[anew], anew)
    simulator.advance(2000, check=False)
    return np.stack([simulator.positions, simulator.velocities], axis=1)


@case
def batches(broken: bool) -> Outcome:
    """batch, threads and resets against single copies.

    Wanted: no bit differs among 11 copies, on 1 and 3 threads, half of them reset.
    Broken: one coordinate of copy 6 moved by its last bit.
    """
    positions, velocities = starts(11)
    given = positions.copy()
    if broken:
        given[6, 0, 0] = np.nextafter(given[6, 0, 0], 10.0)
    batch = moved_batch(11, given, velocities)
    threaded = moved_batch(11, given, velocities, threads=3)
    single = []
    for n in range(11):
        scene = Scene(cube(damping=0.0), positions[n], velocities[n], gravity=WEIGHTLESS)
        simulator = Simulator(scene)
        simulator.advance(2000 if n % 2 else 4000)
        single.append(np.stack([simulator.positions[0], simulator.velocities[0]]))
    differ = int((batch != np.array(single)).sum() + (batch != threaded).sum())
    return Outcome(f"{differ} numbers differ", differ == 0)


@case
def diverging_copy(broken: bool) -> Outcome:
    """one copy of a batch diverges.

    Wanted: the error names it; no bit of its neighbours changes.
    Broken: 1e-15 of its speed leaks into the next copy.
    """
    positions, velocities = starts(11)
    clean = moved_batch(11, positions, velocities)
    wild = velocities.copy()
    wild[4] *= 1e9
    if broken:
        wild[5] += 1e-15 * wild[4]
    with np.errstate(all="ignore"):
        moved = moved_batch(11, positions, wild)
        simulator = Simulator(Scene(cube(damping=0.0), gravity=WEIGHTLESS), copies=11)
        simulator.place(positions, wild)
        try:
            simulator.advance(100)
            named = False
        except SimulationDivergedError as error:
            named = "copy 4" in str(error)
    others = np.arange(11) != 4
    differ = int((moved[others] != clean[others]).sum())
    return Outcome(f"{'named' if named else 'not named'}, {differ} numbers differ", named and differ == 0)


@case
def unbalanced(broken: bool) -> Outcome:
    """unbalanced top against its rigid twin.

    Wanted: gap after 1 s ∝ kᵖ over k = 1e6 … 1e8 with p = −1.00 ± 0.02.
    Broken: the twin of the balanced top.
    """
    stiffness = np.array([1e6, 1e7, 1e8])
    gaps = []
    for k in stiffness:
        body = top(stiffness=k, damping=0.0, scaled={0: 2.0})
        tip = body.particle("tip")
        crown = body.particle("crown")
        began = start(body, tilt=0.4, spin=20.0, pinned=(tip,), gravity=GRAVITY)
        simulator = Simulator(Scene(body, *began, pinned=(tip,)))
        count = math.ceil(1 / simulator.step)
        simulator = Simulator(simulator.scene, step=1 / count)
        simulator.advance(count)
        other = top(damping=0.0) if broken else body
        began = start(other, tilt=0.4, spin=20.0, pinned=(tip,), stretched=False)
        twin = Simulator(Scene(other, *began, pinned=(tip,)), dynamics="rigid", step=1e-3)
        twin.advance(1000)
        gaps.append(float(np.linalg.norm(simulator.positions[0, crown] - twin.positions[0, crown])))
    power = fitted_power(stiffness, gaps)
    return Outcome(f"p = {power:.3f}, gap {gaps[0]:.0e} … {gaps[-1]:.0e} m", abs(power + 1) < 0.02)


@case
def degenerate(broken: bool) -> Outcome:
    """degenerate input.

    Wanted: each refused where it is made, by an error that names the offender.
    Broken: a body that is not checked.
    """
    make: Any = SimpleNamespace if broken else Body
    corners = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1.0]])
    pairs = [(0, 1), (0, 2), (0, 3), (1, 2), (1, 3), (2, 3)]
    sound = {
        "name": "body",
        "positions": corners,
        "masses": np.ones(4),
        "springs": pairs,
        "stiffness": np.full(6, 1e4),
        "damping": np.zeros(6),
    }

    def changed(name: str, place: int | tuple[int, ...], value: float) -> dict[str, Any]:
        array = np.array(sound[name], float)
        array[place] = value
        return {name: array}

    inputs: list[tuple[str, dict[str, Any], tuple[str, ...]]] = [
        ("zero-length spring", changed("positions", 1, 0.0), ("spring 0", "same position")),
        ("zero mass", changed("masses", 2, 0.0), ("masses[2]",)),
        ("negative mass", changed("masses", 3, -1.0), ("masses[3]",)),
        ("mass not a number", changed("masses", 1, math.nan), ("masses[1]",)),
        ("stiffness not a number", changed("stiffness", 4, math.nan), ("stiffness[4]",)),
        ("negative stiffness", changed("stiffness", 5, -1.0), ("stiffness[5]",)),
        ("damping not a number", changed("damping", 2, math.nan), ("damping[2]",)),
        ("position not a number", changed("positions", (2, 1), math.nan), ("positions[2, 1]",)),
        ("in pieces", {"springs": pairs[:1], "stiffness": 1e4, "damping": 0.0}, ("particle 3",)),
        ("floppy", {"springs": pairs[:5], "stiffness": 1e4, "damping": 0.0}, ("1 zero-energy mode",)),
        ("spring to nothing", {"springs": [*pairs[:5], (2, 9)]}, ("springs[5, 1]", "9")),
        ("spring to itself", {"springs": [*pairs[:5], (2, 2)]}, ("spring 5", "itself")),
        ("no particles", {"positions": np.zeros((0, 3)), "masses": [], "springs": []}, ("0 particles",)),
    ]
    passed = [name for name, change, words in inputs if refused(partial(make, **sound | change), *words)]
    missing = [name for name, _, _ in inputs if name not in passed]
    return Outcome(
        f"{len(passed)} of {len(inputs)} refused{': not ' + ', '.join(missing) if missing else ''}",
        not missing,
    )


# --- Bodies that collide ------------------------------------------------------------------------------

LEFT, RIGHT = slice(0, 8), slice(8, 16)
"""The particles of two cubes."""

EDGE_UP = rotation((0, 0, 1), math.pi / 4)
EDGE_ASIDE = rotation((0, 1, 0), math.pi / 4)
CORNER = rotation((0, 1, 0), math.atan(math.sqrt(0.5))) @ EDGE_UP
"""Rotations of a cube after which an upright edge, an edge along y, or a corner points to ±x."""


LOSSLESS = Contact()
"""Contact without loss or friction; its strength follows from the bodies."""


def two_cubes(copies: int, contact: Contact = LOSSLESS) -> Simulator:
    """Return undamped cubes of 1 m that collide without loss, far apart."""
    body = cube(damping=0.0)
    bodies = (Placed(body, name="left"), Placed(body, np.add(body.positions, (4.0, 0.0, 0.0)), name="right"))
    return Simulator(Scene(bodies=bodies, gravity=WEIGHTLESS, contact=contact), copies=copies)


def momenta(simulator: Simulator) -> np.ndarray:
    """Return momentum and angular momentum about the origin, (copies, 6)."""
    m = simulator.scene.masses[:, None]
    x = simulator.positions
    v = simulator.velocities
    return np.concatenate([(m * v).sum(axis=1), (m * np.cross(x, v)).sum(axis=1)], axis=1)


def deepest(simulator: Simulator) -> float:
    """Return the depth of a corner or an edge of one of two cubes in the other [m], in any copy: 0 if they
    are apart."""
    x = simulator.positions
    body = simulator.scene.bodies[0].body
    depth = 0.0
    for own, other in ((LEFT, RIGHT), (RIGHT, LEFT)):
        faces = x[:, other][:, body.triangles]
        inside = -float(distance.point_surface(x[:, own], faces).min())
        depth = max(depth, inside, float(distance.pierced(x[:, own][:, body.edges], faces).max()))
    return depth


def leave_out(simulator: Simulator, *kinds: int) -> None:
    """Let its bodies collide without their vertices (0), faces (1) or edges (2)."""
    for kind in kinds:
        terms(simulator).collisions.pairs.shapes.start[kind] = 0


def thrown(rows: list[tuple[np.ndarray, np.ndarray, tuple[float, float]]], speed: float) -> Simulator:
    """Return cubes turned in ways and offset across x, 3 cm apart, that approach each other along x."""
    simulator = two_cubes(len(rows))
    body = simulator.scene.bodies[0].body
    x = np.zeros((len(rows), 16, 3))
    for n, (left, right, aside) in enumerate(rows):
        x[n, LEFT] = body.positions @ left.T
        x[n, RIGHT] = body.positions @ right.T
        gap = 0.03 + x[n, LEFT, 0].max() - x[n, RIGHT, 0].min()
        x[n, RIGHT] += (gap, *aside)
    v = np.zeros_like(x)
    v[:, LEFT, 0] = speed / 2
    v[:, RIGHT, 0] = -speed / 2
    simulator.place(x, v)
    return simulator


def parted(simulator: Simulator, speed: float, most: float = 0.05) -> Outcome:
    """Let two cubes collide, and check that they part and lose at most a share ``most`` of their energy."""
    kept = momenta(simulator)
    energy = simulator.measure().energy
    depth = 0.0
    for _ in range(60):
        simulator.advance(math.ceil(0.2 / speed / 60 / simulator.step), check=False)
        depth = max(depth, deepest(simulator))
    told = simulator.pairs()
    moved = float(np.abs(momenta(simulator) - kept).max())
    gained = float(np.abs(simulator.measure().energy / energy - 1).max())
    wrong = int(told.late_contacts.sum() + told.touching.sum())
    hit = bool((told.impulse > 0.5 * speed).all())
    return Outcome(
        f"P and L {moved:.0e}, energy {gained:.1e}, {depth:.2g} m deep, {wrong} missed or still touching",
        bool(hit and moved < 1e-12 * speed and gained < most and depth == 0 and not wrong),
    )


@case
def random_impacts(broken: bool) -> Outcome:
    """random impacts of two cubes at 2 m/s.

    Wanted: 128 of any orientation and spin: P and L to 1e-13 of their size, none missed, none inside the
    other after, H − (h²/8) Σ m |a|² in 99 of 100 to 2e-3 with c = k Δ³/2, and to 1e-2 with the softer c of
    a scene that gives none.
    Broken: a corner that bodies take for heavier than it is, by 1e-9.
    """
    body = cube(damping=0.0)
    reach = float(two_cubes(1).scene.meetings.reach[0])
    stiff = replace(LOSSLESS, strength=0.5 * float(body.stiffness.max()) * reach**3, reach=reach)
    told = []
    well = []
    for name, contact, bound in (("c = k Δ³/2", stiff, 2e-3), ("default", LOSSLESS, 1e-2)):
        words, worst, rest = impacts_of_cubes(two_cubes(128, contact), broken)
        told.append(f"{name}: {words}")
        well.append(rest and worst < bound)
    return Outcome("; ".join(told), all(well))


def impacts_of_cubes(simulator: Simulator, broken: bool) -> tuple[str, float, bool]:
    """Return what was measured, in words, the error of energy, and whether all else is as it should be."""
    copies = simulator.copies
    speed = 2.0
    random = np.random.default_rng(1)
    body = simulator.scene.bodies[0].body
    radius = math.sqrt(0.75)
    way, side = random.normal(size=(2, copies, 3))
    way /= np.linalg.norm(way, axis=1)[:, None]
    side -= (side * way).sum(axis=1)[:, None] * way
    side *= 0.5 * radius * random.random((copies, 1)) / np.linalg.norm(side, axis=1)[:, None]
    x, v = np.zeros((2, copies, 16, 3))
    for own, sign in ((LEFT, 1), (RIGHT, -1)):
        turns = [rotation(random.normal(size=3), random.uniform(0, math.pi)) for _ in range(copies)]
        arm = np.array([body.positions @ turn.T for turn in turns])
        spin = speed / radius * random.uniform(-1, 1, size=(copies, 1, 3))
        x[:, own] = arm + sign * (1.03 * radius * way + 0.5 * side)[:, None]
        v[:, own] = np.cross(spin, arm) - (0.5 * sign * speed * way)[:, None]
    simulator.place(x, v)
    if broken:
        terms(simulator).particles.inverse_mass.values[3] *= 1 - 1e-9
    kept = momenta(simulator)
    energy = kept_by_nodes(simulator)
    simulator.advance(math.ceil(2.2 * body.swept / speed / simulator.step), check=False)
    told = simulator.pairs()
    hit = told.impulse[:, 0] > 0
    size = float(np.abs(kept).max())
    moved = float(np.abs(momenta(simulator) - kept).max()) / size
    gained = np.abs(kept_by_nodes(simulator) / energy - 1)[hit & ~told.touching[:, 0]]
    worst = float(np.quantile(gained, 0.99))
    missed = int(told.late_contacts.sum())
    depth = deepest(simulator)
    words = (
        f"{int(hit.sum())} hits, P and L {moved:.0e}, energy {worst:.1e}, {missed} missed, {depth:.2g} m deep"
    )
    return words, worst, bool(hit.sum() > 100 and moved < 1e-13 and not missed and depth == 0)


@case
def crossed_edges(broken: bool) -> Outcome:
    """crossed edges of two cubes at 10 m/s.

    Wanted: eight ways: they part, P and L to 1e-12, energy to 10 %, no corner inside.
    Broken: edges do not meet.
    """
    offsets = [(0.3 * math.cos(n), 0.3 * math.sin(n)) for n in range(8)]
    simulator = thrown([(EDGE_UP, EDGE_ASIDE, offset) for offset in offsets], 10.0)
    if broken:
        leave_out(simulator, 2)
    return parted(simulator, 10.0, 0.1)


@case
def corners_and_faces(broken: bool) -> Outcome:
    """a corner into a corner, flush faces.

    Wanted: at 5 m/s, and offset by up to 1e-3 m: they part, P and L to 1e-12, energy to 5 %, no corner
    inside.
    Broken: corners meet no faces.
    """
    offsets = [(0.0, 0.0), (1e-6, 0.0), (1e-4, -1e-5), (1e-3, 1e-3)]
    rows = [(turn, turn, offset) for turn in (CORNER, np.eye(3)) for offset in offsets]
    simulator = thrown(rows, 5.0)
    if broken:
        leave_out(simulator, 1)
    return parted(simulator, 5.0)


@case
def stack_at_rest(broken: bool) -> Outcome:
    """a stack of three at rest for 60 s, pulled aside by a twentieth of its weight.

    Wanted: still a stack; after 20 s: no faster than 1e-6 m/s, no farther than 1e-5 m, energy lost < 1e-5
    J.
    Broken: bodies that do not rub.
    """
    body = cube(0.5, damping=100.0)
    bodies = tuple(
        Placed(body, np.add(body.positions, (0.0, 0.0, 0.2562 + 0.5085 * n)), name=f"{n}") for n in range(3)
    )
    scene = Scene(
        bodies=bodies,
        gravity=(9.81 / 20, 0.0, -9.81),
        surfaces=(floor(),),
        contact=Contact(friction=0.5, restitution=0.5),
    )
    simulator = Simulator(scene)
    if broken:
        terms(simulator).collisions.pairs.friction[:] = 0.0
    simulator.advance(math.ceil(20 / simulator.step), check=False)
    x = simulator.positions
    first = simulator.measure()
    fastest = 0.0
    for _ in range(60):
        simulator.advance(math.ceil(1 / simulator.step), check=False)
        fastest = max(fastest, float(np.abs(simulator.velocities).max()))
    last = simulator.measure()
    lost = sum(
        abs(float(getattr(last, name)[0] - getattr(first, name)[0]))
        for name in ("damping_loss", "contact_loss", "friction_loss")
    )
    crept = float(np.abs(simulator.positions - x).max())
    moved = float(np.abs(simulator.positions - scene.positions).max())
    return Outcome(
        f"{moved:.2g} m from its start; {fastest:.0e} m/s, {crept:.0e} m, {lost:.0e} J",
        moved < 0.03 and fastest < 1e-6 and crept < 1e-5 and lost < 1e-5,
    )


@case
def heap(broken: bool) -> Outcome:
    """20 cubes and balls dropped into a bowl.

    Wanted: after 6 s all lie in it: none missed or left out, no two in each other, the balance of energy
    within 1 % of what was lost.
    Broken: bodies a million times softer than they are to each other.
    """
    random = np.random.default_rng(6)
    stone = cube(0.3, 1.0, damping=40.0)
    marble = ball(0.15)
    bodies = []
    for n in range(20):
        body = marble if n % 4 == 3 else stone
        place = np.array([0.6 * (n % 2) - 0.3, 0.6 * (n // 2 % 2) - 0.3, 0.6 + 0.6 * (n // 4)])
        turned = body.positions @ rotation(random.normal(size=3), random.uniform(0, math.pi)).T
        bodies.append(Placed(body, turned + place + 0.02 * random.normal(size=3), name=f"{n}"))
    law = Contact(friction=0.3, restitution=0.4, strength=0.5 * 1e5 * 0.005**3, reach=0.005)
    scene = Scene(bodies=tuple(bodies), surfaces=(Bowl((0.0, 0.0, 2.0), 2.0),), contact=law)
    simulator = Simulator(scene, step=Simulator(scene).step / 4)
    if broken:
        terms(simulator).collisions.pairs.strength[:] *= 1e-6
    first = simulator.measure()
    simulator.advance(math.ceil(6 / simulator.step), check=False)
    last = simulator.measure()
    told = simulator.pairs()
    try:
        scene.check_start(simulator.positions, 0 * simulator.velocities)
        apart = True
    except ValueError:
        apart = False
    lost = float(first.energy[0] - last.energy[0])
    share = abs(float(last.balance[0] - first.balance[0])) / lost
    wrong = int(told.late_contacts.sum() + told.overflow.sum())
    far = float(np.linalg.norm(simulator.positions[0, :, :2], axis=1).max())
    return Outcome(
        f"{int(told.touching.sum())} pairs touch, {wrong} missed or left out, "
        f"{'apart' if apart else 'in each other'}, balance {share:.1e} of {lost:.0f} J, "
        f"{far:.2f} m from the middle",
        bool(apart and not wrong and share < 0.01 and far < 1.8 and told.touching.sum() >= 10),
    )


# --- Command ------------------------------------------------------------------------------------------


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command, and return its exit status."""
    parser = argparse.ArgumentParser(
        "benchmarks.hard_cases", description="Run the cases where simulators break."
    )
    parser.add_argument("cases", nargs="*", type=int, metavar="N", help="numbers of cases; default: all")
    parser.add_argument("--broken", action="store_true", help="run the broken twins: each must fail")
    args = parser.parse_args(arguments)
    return guarded(parser.prog, lambda: run(args), extra="bench")


def run(args: argparse.Namespace) -> int:
    """Print the table; 1 if a case fails, or with ``--broken`` if one does not.

    Raises
    ------
    ValueError
        If there is no case of a number.
    """
    if unknown := set(args.cases) - {case.number for case in CASES}:
        raise ValueError(f"there is no case {min(unknown)}; there are 1 to {len(CASES)}")
    good = True
    for each in progress([case for case in CASES if case.number in (args.cases or [case.number])], "cases"):
        outcome = each.run(args.broken)
        good &= outcome.passed is not args.broken
        print(f"{each.number:3} {'pass' if outcome.passed else 'FAIL'}  {each.name}")
        print(f"          wanted:   {each.criterion}")
        if args.broken:
            print(f"          broken:   {each.twin}")
        print(f"          measured: {outcome.measured}", flush=True)
    return 0 if good else 1


if __name__ == "__main__":
    sys.exit(main())
