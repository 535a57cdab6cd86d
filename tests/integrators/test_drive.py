"""A driven particle moves as it is told, whatever the method, and no faster than it may."""

from __future__ import annotations

import numpy as np
import pytest

from springgym.model.bodies import Body, top
from springgym.model.scene import DriveActuator, Scene
from springgym.simulator import Simulator

ACCELERATION = np.array([3.0, -2.0, 0.0])
SPEED = 1.5
STEP = 5e-4
DURATION = 1.0


@pytest.mark.parametrize("name", ["rk4", pytest.param("tr_bdf2", marks=pytest.mark.slow)])
def test_drive_reaches_its_speed_and_keeps_it(name: str) -> None:
    x = np.array([[0, 0, 0], [0, 0, -0.5], [0, 0, -1.0]])
    rope = Body("rope", x, np.array([0.1, 0.1, 1.0]), np.array([(0, 1), (1, 2)]), 1e4, 1.0, floppy=True)
    scene = Scene(rope, x, pinned=(0,), drive=DriveActuator(0, SPEED))
    made = Simulator(scene, integrator=name, step=STEP)
    made.actuate(acceleration=ACCELERATION[None])
    made.advance(round(DURATION / STEP))
    # each axis: a t until the speed is reached after |v/a|, then v t; a method may be late by one step
    rise = np.minimum(SPEED / np.maximum(np.abs(ACCELERATION), 1e-9), DURATION)
    way = np.sign(ACCELERATION) * (0.5 * np.abs(ACCELERATION) * rise**2 + SPEED * (DURATION - rise))
    late = 1.01 * STEP * np.abs(ACCELERATION)
    assert (np.abs(made.velocities[0, 0]) <= np.where(ACCELERATION != 0, SPEED + late, 0.0)).all()
    assert (np.abs(made.positions[0, 0] - way) <= late * DURATION).all()
    assert np.linalg.norm(made.positions[0, 2] - x[2]) > 0.5


def test_a_body_that_its_pivot_carries_along_does_not_turn() -> None:
    body = top()
    velocity = np.array([1.0, 0.5, 0.0])
    omega = np.array([0.3, -0.2, 7.0])
    tip = body.particle("tip")
    carried = velocity + np.cross(omega, body.positions - body.positions[tip])
    scene = Scene(body, velocities=carried, pinned=(tip,), drive=DriveActuator(tip, SPEED))
    assert Simulator(scene).measure().angular_velocity[0] == pytest.approx(omega, abs=1e-12)
