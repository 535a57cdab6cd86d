"""The step that is chosen when none is given."""

from __future__ import annotations

import math

import numpy as np
import pytest

from springgym.dynamics import stability
from springgym.dynamics.methods import METHODS, integrator
from springgym.dynamics.stepping import StepRequirements, plan_steps
from springgym.model.bodies import Body, cube, rope
from springgym.model.scene import Scene
from springgym.simulator import Simulator

VERLET = integrator("verlet")


def hung(damping: float) -> Scene:
    return Scene(rope(damping=damping), pinned=(0,))


def axial(scene: Scene) -> complex:
    """The slowest mode along a hanging rope, −rate + i ω [1/s]: M z̈ + C ż + K z = 0."""
    body = scene.body
    stretch = np.eye(len(body.lengths)) - np.eye(len(body.lengths), k=-1)  # of springs, by the free particles
    pull = stretch.T / body.masses[1:, None]
    stiff = pull * body.stiffness @ stretch
    damped = pull * body.damping @ stretch
    nothing = np.zeros_like(stiff)
    modes = np.linalg.eigvals(np.block([[nothing, np.eye(len(stiff))], [-stiff, -damped]]))
    slow = modes[modes.imag > 0]
    return complex(slow[np.argmin(slow.imag)])


def lost(scene: Scene, step: float | None) -> float:
    """Share of energy that a bounce along a rope loses in 0.25 s, over what theory has it lose."""
    mode = axial(scene)
    body = scene.body
    down = np.linspace(0.0, 1e-4, len(body.masses))  # the weight is heavy: almost a straight line
    positions = body.positions - np.outer(down, (0, 0, 1))
    simulator = Simulator(scene.with_(positions=positions, gravity=None), step=step)
    before = simulator.measure().energy[0]
    simulator.advance(round(0.25 / simulator.step))
    after = simulator.measure().energy[0]
    return float(math.log(before / after) / (-2 * mode.real * simulator.time[0]))


def test_it_is_a_share_of_the_stability_limit_and_a_whole_part_of_the_period() -> None:
    scene = Scene(cube())
    expected = stability.SAFETY * stability.largest_step(scene, VERLET)
    assert plan_steps(scene).step == expected
    assert plan_steps(scene, task=StepRequirements(0.01)).step == 0.01 / math.ceil(0.01 / expected)


def test_the_longest_steps_that_are_taken_are_stable_and_the_limit_is_refused() -> None:
    """At the limit itself, a mode would grow with time: 4 times in 2e5 steps."""
    body = cube(damping=0.0)
    scene = Scene(body, velocities=np.random.default_rng(1).normal(0.0, 1e-6, (8, 3)), gravity=None)
    limit = stability.largest_step(scene, VERLET)
    for step in (limit, (1 - 1e-4) * limit):
        with pytest.raises(ValueError, match="unstable"):
            Simulator(scene, step=step)
    simulator = Simulator(scene, step=(1 - 1.01e-3) * limit, varying=("stiffness",))
    with pytest.raises(ValueError, match="unstable in copy 0"):
        simulator.vary([0], stiffness=body.stiffness * (1 + 2e-3))

    def largest_strain() -> float:
        found = []
        for _ in range(100):
            simulator.advance(7)
            found.append(simulator.measure().strain[0])
        return max(found)

    early = largest_strain()
    simulator.advance(200_000)
    assert largest_strain() < 1.2 * early


def test_strong_dampers_lose_what_they_should() -> None:
    scene = hung(1000.0)
    step = Simulator(scene).step
    amiss, less = (abs(1 - lost(scene, h)) for h in (step, step / 2))
    assert amiss < 0.01
    assert less < 0.4 * amiss  # second order
    # at the stability limit's share alone, c = 1000 acts like 300
    assert lost(scene, stability.SAFETY * stability.largest_step(scene, VERLET)) < 0.5


def test_only_methods_that_split_the_dampers_off_are_held_back() -> None:
    scene = hung(1000.0)
    rate = stability.highest_decay_rate(scene)
    for name in METHODS:
        method = integrator(name)
        step = stability.usual_step(scene, method)
        if name in ("verlet", "symplectic_euler"):
            assert step == stability.DECAY / rate
        elif method.implicit:
            assert step == 1e-3
        else:
            assert step == stability.SAFETY * stability.largest_step(scene, method)


def test_weak_dampers_do_not_matter() -> None:
    assert plan_steps(hung(30.0)).step == plan_steps(hung(0.0)).step


def test_a_body_without_springs_has_no_frequency() -> None:
    ball = Body("ball", np.zeros((1, 3)), np.ones(1), np.zeros((0, 2), int), 1.0, 0.0)
    assert str(stability.highest_frequency(Scene(ball))) == "0.0"  # not −0.0
    assert plan_steps(Scene(ball)).step == 1e-3
