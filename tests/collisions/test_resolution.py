"""The impacts that steps resolve: frequencies of contacts, default steps, highest speeds, what is told."""

from __future__ import annotations

import math
import re
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from springgym.dynamics.contact.law import SLOW
from springgym.model.bodies import ball, box, cube, disk, rolling_ball, rope
from springgym.model.resolution import (
    COARSENESS,
    QUICK,
    TURN,
    WRONG,
    PossibleContacts,
    max_impact_speed,
    max_impact_speeds,
    mobility,
    possible_contacts,
)
from springgym.model.scene import Placed, Scene
from springgym.model.surfaces import Contact, PaperContact, floor, scales
from springgym.simulator import PrecisionWarning, Simulator, UnresolvedContactError
from springgym.theory.contact import rebound
from tests.collisions.movers import G, World, alone, automatic, body, scene, world
from tests.forces.test_contact import beads

LOSSY = Contact(0.3, 0.5)
HARD = Contact(restitution=0.5, strength=0.003, reach=0.01)
"""A contact for single particles and ropes, whose springs give none."""


# --- The frequency of contacts ----------------------------------------------------------------------------


def test_mobility_of_simple_bodies() -> None:
    """Spheres 1/M; four of the particles of a box at its corners 4/M; ropes 1/m; the edge of a thin disk that
    is tilted by 45° 1/M + R²/2 I."""
    assert mobility(rolling_ball(0.1, mass=2.0)) == pytest.approx(1 / 2)
    assert mobility(cube(1.0, mass=3.0)) == pytest.approx(4 / 3)
    assert mobility(box((0.1, 0.2, 0.5), mass=3.0)) == pytest.approx(4 / 3)
    assert mobility(ball(0.1, mass=4.0)) == 1 / 4
    assert mobility(rope()) == pytest.approx(1 / rope().masses.min())
    flat = disk(0.1)
    moment = flat.principal()[0].min()
    assert mobility(flat) == pytest.approx(1 / flat.mass + 0.5 * 0.1**2 / moment, rel=0.01)


def test_frequency_is_that_of_a_body_that_hardly_leaves_its_rest() -> None:
    """ω_c² = 2 c W/Δ³: that of a particle below the edge of the barrier, measured by its period there."""
    c = 0.02
    reach = 0.01
    depth = 1e-4
    law = Contact(strength=c, reach=reach)
    of = possible_contacts(Scene(ball(0.1), np.array([[0, 0, 1.0]]), surfaces=(floor(),), contact=law), True)
    simulator = beads([[0, 0, reach * (1 - depth)]], [[0, 0, 0.0]], law, gravity=(0, 0, 0), step=1e-5)
    start = simulator.positions[0, 0, 2]
    simulator.advance(1)
    pushed = (simulator.positions[0, 0, 2] - start) / (0.5 * 1e-5**2) / (reach * depth)
    assert of.frequency[1, 0] ** 2 == pytest.approx(pushed, rel=1e-3)


# --- The error of the loss --------------------------------------------------------------------------------


@pytest.mark.parametrize("restitution", [0.8, 0.5, 0.2, 0.0])
def test_loss_of_the_fastest_impacts(restitution: float) -> None:
    """In the worst phase of a step it is wrong by a quarter of `WRONG` to `WRONG`, if hard or soft. The
    restitution is right to 0.03 from 0.5 on, to 0.08 at 0.2, and to 0.2 at 0."""
    reach = 0.02
    step = 1e-3
    phases = 16
    angle = np.repeat([0.03, 0.05, 0.1, 0.2, 0.25], phases)
    frequency = angle / step
    of = PossibleContacts(
        frequency**2 * reach**3 / 2,
        np.full(len(angle), reach),
        np.stack([frequency, frequency]),
        np.full(len(angle), np.inf),
        np.ones(len(angle), bool),
        0,
    )
    speed = max_impact_speeds(of, step)
    phase = np.tile(np.arange(phases) / phases, len(angle) // phases)
    zero = np.zeros(len(angle))
    height = 1.01 * reach + phase * speed * step
    simulator = beads(
        np.column_stack([zero, zero, height]),
        np.column_stack([zero, zero, -speed]),
        Contact(restitution=restitution, strength=1.0, reach=reach),
        gravity=(0, 0, 0),
        step=step,
    )
    simulator.vary(np.arange(len(angle)), strength=of.strength)
    simulator.advance(400)
    kept = simulator.velocities[:, 0, 2] / speed
    own = np.array([rebound(each, restitution, SLOW) for each in speed[::phases]])
    wrong = (kept**2).reshape(-1, phases) - own[:, None] ** 2
    worst = np.abs(wrong).max(axis=1) / (1 - own**2)
    assert (worst < WRONG).all()
    assert (worst > WRONG / 4).all()
    off = np.abs(kept.reshape(-1, phases) - own[:, None]).max()
    assert off < {0.8: 0.03, 0.5: 0.03, 0.2: 0.08, 0.0: 0.2}[restitution]


# --- Default steps ----------------------------------------------------------------------------------------


@pytest.mark.parametrize("dynamics", ["springs", "rigid"])
@pytest.mark.parametrize(
    ("mover", "on"), [("ball", "mate"), ("die", "floor"), ("die", "block"), ("capsule", "block")]
)
def test_default_steps_resolve_contacts(mover: str, on: str, dynamics: str) -> None:
    """ω_c h ≤ `TURN`, and impacts at 0.1 m/s are fine; a surface that takes no energy asks for nothing."""
    lossy, elastic = (alone(scene(body(mover), on, Contact(0.3, e), 0.0203), on) for e in (0.5, 1.0))
    step = automatic(lossy, dynamics)
    of = possible_contacts(lossy, dynamics == "springs")
    assert of.frequency.max() * step <= TURN * (1 + 1e-12)
    assert max_impact_speeds(of, step).min() > 0.1
    if on == "floor" and dynamics == "rigid":
        assert automatic(elastic, dynamics) == 1e-3 > 10 * step


# --- The highest speed ------------------------------------------------------------------------------------


def cubes(restitution: float, stiffness: float = 1e5) -> Scene:
    """Two cubes of 1 kg and 1 m, 2 cm apart, without gravity."""
    of = cube(stiffness=stiffness, damping=0.0)
    bodies = tuple(Placed(of, np.add(of.positions, (1.02 * n, 0, 0)), name=f"{n}") for n in range(2))
    return Scene(bodies=bodies, gravity=None, collisions=Contact(restitution=restitution, reach=0.005))


def test_speed_of_cubes_in_fine_steps() -> None:
    """Δ ω/3 of the slowest vibration, ω² = 8 k/m, without loss. With loss Δ ω/10, at e = 0 too, if the
    contact is much softer than the springs, and 0 if it is not."""
    assert max_impact_speed(cubes(1.0)) == pytest.approx(0.005 / 3 * math.sqrt(8e5), rel=1e-3)
    for restitution in (0.9, 0.5, 0.0):
        of = cubes(restitution, 1e7)
        assert max_impact_speed(of) == pytest.approx(0.005 / 10 * math.sqrt(8e7), rel=2e-2)
        assert max_impact_speed(cubes(restitution)) == 0.0


def test_steps_limit_the_speed() -> None:
    """Without loss to Δ/5 a step; with loss to `WRONG`, and to 0 if a step does not resolve ω_c."""
    for step, speed in ((7e-4, QUICK * 0.005 / 7e-4), (1e-4, max_impact_speed(cubes(1.0)))):
        simulator = Simulator(cubes(1.0), step=step)
        assert simulator.max_impact_speed == pytest.approx(speed)
        assert f"accurate up to {speed:.3g} m/s)" in repr(simulator)
    of = Scene(ball(0.1), np.array([[0, 0, 1.0]]), surfaces=(floor(),), contact=HARD)
    low = math.sqrt(2 * 0.003 / 0.01**3)
    for step in (1e-3, 1e-4):
        high = math.sqrt(WRONG / COARSENESS) / step
        expected = 0.01 * math.sqrt(low * (high - low))  # v²/(Δ² ω_c) = Ω − ω_c
        assert Simulator(of, step=step).max_impact_speed == pytest.approx(expected)
    assert Simulator(of, step=4e-3).max_impact_speed == 0.0
    assert Simulator(Scene(cube())).max_impact_speed == math.inf


def test_rigid_bodies_have_no_vibrations() -> None:
    raised = np.add(cube().positions, (0, 0, 2.0))
    of = Scene(cube(), raised, surfaces=(floor(),), contact=Contact(restitution=0.0))
    springs, rigid = (Simulator(of, dynamics=how, step=1e-4).max_impact_speed for how in ("springs", "rigid"))
    assert springs < max_impact_speed(of) < rigid < math.inf


def test_softest_contact_counts() -> None:
    """Of several contacts; surfaces have theirs; a body that is held does not vibrate."""
    soft = cube(stiffness=1e5)
    stiff = cube(stiffness=1e7)
    far = stiff.positions + np.array([3.0, 0.0, 2.0])
    bodies = (Placed(soft, np.add(soft.positions, (0, 0, 2)), name="soft"), Placed(stiff, far, name="stiff"))
    law = Contact(reach=0.01)
    both = Scene(bodies=bodies, collisions=law)
    on_floor = Scene(stiff, far, surfaces=(floor(),), contact=law)
    assert max_impact_speed(on_floor) == pytest.approx(10 * max_impact_speed(both))
    for on in ({"collisions": law}, {"collisions": None, "surfaces": (floor(),), "contact": law}):
        held = Placed(soft, bodies[0].positions, pinned=tuple(range(8)), name="soft")
        assert max_impact_speed(Scene(bodies=(held, bodies[1]), **on)) == max_impact_speed(on_floor)


def test_what_no_contact_strains() -> None:
    """Single particles and ropes have no shape to vibrate about, and round bodies are pushed as a whole."""
    raised = np.add(cube().positions, (0, 0, 2.0))
    on: dict[str, Any] = {"surfaces": (floor(),)}
    for of in (
        Scene(cube()),
        Scene(cube(), raised, contact=PaperContact(), **on),
        Scene(ball(0.1), np.array([[0, 0, 1.0]]), contact=HARD, **on),
        Scene(rope(), np.add(rope().positions, (0, 0, 50)), contact=HARD, **on),
        Scene(rolling_ball(), np.add(rolling_ball().positions, (0, 0, 1)), contact=LOSSY, **on),
    ):
        assert max_impact_speed(of) == math.inf


# --- What is told -----------------------------------------------------------------------------------------


def test_coarse_contacts_of_particles_are_counted() -> None:
    """Above the highest speed alone, in that copy alone, since it was placed."""
    most = Simulator(
        Scene(ball(0.1), np.array([[0, 0, 1.0]]), surfaces=(floor(),), contact=HARD), step=1e-3
    ).max_impact_speed
    speeds = np.array([0.98, 1.02]) * most
    simulator = beads([[0, 0, 0.011]] * 2, np.outer(speeds, (0, 0, -1)), HARD, gravity=(0, 0, 0), step=1e-3)
    simulator.advance(1000)
    assert (simulator.coarse_contacts > 0).tolist() == [False, True]
    state = simulator.state()
    simulator.place([[0, 0, 0.011]], [[0, 0, -speeds[0]]])
    assert not simulator.coarse_contacts.any()
    simulator.restore(state)
    assert (simulator.coarse_contacts > 0).tolist() == [False, True]
    simulator.pairs(forget=True)
    assert not simulator.coarse_contacts.any()


@pytest.mark.parametrize("dynamics", ["springs", "rigid"])
def test_a_ball_dropped_by_default(dynamics: str) -> None:
    """From 20 cm it is too fast for the default step: an error or a warning names a step, which is fine."""
    of = rolling_ball()
    height = 0.2
    reach = scales(LOSSY, of)[1]
    step = automatic(alone(scene(of, "floor", LOSSY, height, tilt=0.0), "floor"), dynamics)

    def dropped(law: Contact, step: float) -> World:
        return world(of, "floor", law, height, dynamics=dynamics, step=step, tilt=0.0)

    told = UnresolvedContactError if dynamics == "springs" else PrecisionWarning
    names = r"a strength of (\S+) N·m² or more and a step of at most (\S+) s"
    coarse = dropped(LOSSY, step)
    with pytest.raises(told, match=names) as caught:
        coarse.simulator.advance(math.ceil(0.22 / step))
    named = re.search(names, str(caught.value))
    assert named
    strength, finer = map(float, named.groups())
    assert finer > step / 20
    fine = dropped(replace(LOSSY, strength=strength), finer)
    fine.simulator.advance(math.ceil(0.22 / finer))
    fall = math.sqrt(2 * G * (height - reach))
    rises = 0.5 * fine.velocity()[:, 2] ** 2 + G * (fine.centre()[:, 2] - 0.1 - reach)
    lost = 1 - rises / (0.5 * fall**2)
    np.testing.assert_allclose(lost, 1 - rebound(fall, 0.5, SLOW) ** 2, rtol=1.2 * WRONG)
    assert fine.simulator.coarse_contacts.max() <= 2  # the speed that is named has three digits
