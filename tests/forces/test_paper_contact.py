"""The paper's contact: its law as it reads, and what is wrong with it beside the default contact."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest

from springgym.dynamics.forces.paper_contact import CLAMP
from springgym.model.bodies import Body
from springgym.model.scene import Scene
from springgym.model.surfaces import Bowl, Contact, PaperContact, Pipe, Surface, floor, incline
from springgym.simulator import PAPER_STEP, Simulator
from springgym.theory import contact as theory
from tests.forces.test_contact import beads as default_beads

C = 1.0
REACH = 0.02
G = 9.81
BEAD = Body("bead", np.zeros((1, 3)), [1.0], np.zeros((0, 2)), 1.0, 0.0)  # type: ignore[arg-type]
WEIGHTLESS = (0.0, 0.0, 0.0)


def beads(
    positions: Any,
    velocities: Any,
    surface: Surface | None = None,
    gravity: tuple[float, float, float] = (0.0, 0.0, -G),
    step: float | None = None,
    **how: float,
) -> Simulator:
    """Single particles of 1 kg, a copy each, by the paper's settings or with another step of rk4."""
    law = PaperContact(**{"strength": C, "reach": REACH, **how})  # type: ignore[arg-type]
    scene = Scene(BEAD, positions[:1], gravity=gravity, surfaces=(surface or floor(),), contact=law)
    options: Any = {"copies": max(2, len(positions)), "varying": ("friction",)}
    simulator = (
        Simulator(scene, integrator="rk4", step=step, **options)
        if step
        else Simulator.paper(scene, **options)
    )
    where, speed = (np.asarray(rows, float)[:, None] for rows in (positions, velocities))
    simulator.place(where, speed, np.arange(len(positions)))
    return simulator


def accelerations(simulator: Simulator) -> np.ndarray:
    """Accelerations [m/s²] over one short step, (copies, 3)."""
    before = simulator.velocities
    simulator.advance(1)
    return ((simulator.velocities - before) / simulator.step)[:, 0]


HEIGHTS = np.array([0.15, 0.5, 0.9, 0.999, 1.1]) * REACH


def test_force_is_equation_8() -> None:
    simulator = beads(np.outer(HEIGHTS, [0, 0, 1]), np.zeros((5, 3)), gravity=WEIGHTLESS, step=1e-9)
    assert accelerations(simulator)[:, 2] == pytest.approx(theory.force(HEIGHTS, C, REACH), rel=1e-6)


@pytest.mark.parametrize("surface", [Bowl((0, 0, 0), 1.0), Pipe((0, 0, 0), (0, 1, 0), 1.0)])
@pytest.mark.slow
def test_force_is_along_the_normal(surface: Surface) -> None:
    out = np.array([0.6, 0, -0.8])
    places = np.outer(1 - HEIGHTS, out)
    simulator = beads(places, np.zeros((5, 3)), surface, gravity=WEIGHTLESS, step=1e-9)
    expected = np.outer(theory.force(HEIGHTS, C, REACH), -out)
    assert accelerations(simulator) == pytest.approx(expected, rel=1e-6, abs=1e-6)


def test_floor_damping_acts_in_contact_alone_and_never_pulls() -> None:
    """F − c_N v_N, at least 0, where F > 0: on the way in it adds, on the way out it takes, at most all."""
    damping = 400.0
    h = np.array([0.9, 0.9, 0.9, 1.1]) * REACH
    v = np.array([-0.5, 0.5, 5.0, -0.5])
    simulator = beads(
        np.outer(h, [0, 0, 1]), np.outer(v, [0, 0, 1]), gravity=WEIGHTLESS, step=1e-9, damping=damping
    )
    force = theory.force(h, C, REACH)
    assert force[0] > damping * 0.5
    expected = [force[0] + damping * 0.5, force[1] - damping * 0.5, 0, 0]
    assert accelerations(simulator)[:, 2] == pytest.approx(expected, rel=1e-4, abs=1e-4)
    assert simulator.measure().contact_loss[:3] == pytest.approx(
        1e-9 * np.array([damping * 0.25, damping * 0.25, force[2] * 5]), rel=1e-4
    )


def test_friction_opposes_sliding_up_to_its_cap() -> None:
    """μ F against v_t, at most m |v_t|/2τ (the printed equation 9 has it along v_t)."""
    friction = 0.5
    h = 0.9 * REACH
    force = float(theory.force(h, C, REACH))
    fast = 3.0
    slow = 1e-4
    for step, speed, expected in ((1e-9, fast, friction * force), (PAPER_STEP, slow, slow / 2 / PAPER_STEP)):
        simulator = beads([[0, 0, h]], [[0, speed, 0]], gravity=(0, 0, -force), step=step, friction=friction)
        before = simulator.velocities[0, 0, 1]
        simulator.advance(1)
        lost = (before - simulator.velocities[0, 0, 1]) / step
        # The cap is proportional to the speed of each stage: RK4's share of an exponential decay.
        share = 1.0 if speed == fast else (1 - 0.5 / 2 + 0.25 / 6 - 0.125 / 24)
        assert lost == pytest.approx(expected * share, rel=1e-5)
        assert simulator.measure().friction_loss[0] > 0


def test_clamp_puts_particles_at_a_tenth_of_the_reach_and_stops_them() -> None:
    simulator = beads([[0, 0, 3e-3]], [[0.7, 0, -40.0]], strength=1e-6)
    simulator.advance(1)
    assert simulator.positions[0, 0, 2] == pytest.approx(CLAMP * REACH, rel=1e-12)
    assert simulator.velocities[0, 0] == pytest.approx([0.7, 0, 0], abs=1e-12)


def test_friction_creeps_where_it_should_hold() -> None:
    """On a slope held by friction, the paper's lets a particle creep at 2 τ g sin α; the default holds it."""
    angle = 0.3
    friction = 0.6
    slope = incline(angle)
    start = theory.rest_height(G * math.cos(angle), C, REACH) * np.asarray(slope.normal)
    simulator = beads([start], [[0, 0, 0]], slope, friction=friction)
    simulator.advance(2000)
    moved = np.linalg.norm(simulator.positions[0, 0] - start)
    assert moved == pytest.approx(2 * PAPER_STEP * G * math.sin(angle) * simulator.time[0], rel=0.01)

    how = Contact(friction=friction, strength=C, reach=REACH)
    default = default_beads([start], [[0, 0, 0]], how, (slope,), step=PAPER_STEP)
    default.advance(2000)
    assert np.linalg.norm(default.positions[0, 0] - start) < 1e-9


# Height [m], c [N·m²], Δ [m], and the least growth of the energy in 20 s by the paper's contact.
DROPS = [(5.0, 0.3, 0.01, 30), (1.0, 10.0, 0.01, 100), (0.5, 3.0, 0.005, 1e5)]


@pytest.mark.parametrize(("height", "strength", "reach", "growth"), DROPS)
def test_clamp_creates_energy_where_the_default_keeps_it(
    height: float, strength: float, reach: float, growth: float
) -> None:
    paper = beads([[0, 0, height]], [[0, 0, 0]], strength=strength, reach=reach)
    how = Contact(strength=strength, reach=reach)
    default = default_beads([[0, 0, height]], [[0, 0, 0]], how, step=PAPER_STEP)
    start = default.measure().energy[0]
    worst = 0.0
    for _ in range(200):
        paper.advance(200)
        default.advance(200)
        worst = max(worst, abs(default.measure().energy[0] / start - 1))
    assert paper.measure().energy[0] / start > growth
    assert worst < 2e-3


def test_the_paper_is_one_thing() -> None:
    scene = Scene(
        BEAD, [[0, 0, 1.0]], surfaces=(floor(),), contact=Contact(friction=0.3, strength=C, reach=REACH)
    )
    paper = Simulator.paper(scene)
    assert (paper.integrator.name, paper.step) == ("rk4", 5e-4)
    assert paper.scene.contact == PaperContact(friction=0.3, strength=C, reach=REACH)
    assert Simulator.paper(scene.with_(surfaces=())).scene.contact == scene.contact


def test_what_makes_no_sense_with_it_is_refused() -> None:
    paper = PaperContact(strength=C, reach=REACH)
    scene = Scene(BEAD, [[0, 0, 1.0]], surfaces=(floor(),), contact=paper)
    with pytest.raises(ValueError, match="verlet has no place for them"):
        Simulator(scene)
    with pytest.raises(ValueError, match="'restitution' cannot vary"):
        Simulator.paper(scene, varying=("restitution",))
    with pytest.raises(ValueError, match=r"restitution is 0\.5; the paper's settings have a damping"):
        Simulator.paper(scene.with_(contact=Contact(restitution=0.5, strength=C, reach=REACH)))
    with pytest.raises(ValueError, match="damping of the contact is -1"):
        PaperContact(damping=-1)
