"""Angular velocity from angular momentum, also of particles on a line or in a point."""

from __future__ import annotations

import numpy as np
import pytest

from springgym.model.bodies import Body
from springgym.model.bodies.rotations import rotation
from springgym.model.scene import Scene
from springgym.simulator import Simulator

PLACES = rotation((1, 2, 3), 0.7)


def turning(positions: np.ndarray, omega: np.ndarray) -> np.ndarray:
    """ω as measured, of particles in a row that turn with ``omega``, in many orientations (copies, 3)."""
    count = len(positions)
    springs = np.array([(n, n + 1) for n in range(count - 1)], int).reshape(-1, 2)
    body = Body("row", positions, np.linspace(1.0, 2.0, count), springs, 1e3, 0.0, floppy=True)
    about = rotation((1, 0, 1), 0.3)
    x = [body.positions - body.centre]
    axes = [omega]
    for _ in range(199):
        x.append(x[-1] @ about.T)
        axes.append(about @ axes[-1])
    simulator = Simulator(Scene(body, gravity=None), copies=len(x))
    simulator.place(np.array(x), np.cross(np.array(axes)[:, None], x))
    return simulator.measure().angular_velocity - axes


def test_of_a_line_is_across_it() -> None:
    """Its inertia is singular, but for round-off: in some places its determinant is positive, in some not."""
    line = np.outer([0.0, 1.0, 2.5], PLACES[0])
    assert np.abs(turning(line, 3.0 * PLACES[1])).max() < 1e-12


def test_of_two_particles() -> None:
    assert np.abs(turning(np.outer([0.0, 1.0], PLACES[0]), 3.0 * PLACES[2])).max() < 1e-12


@pytest.mark.parametrize("bend", [1.0, 1e-2, 1e-4])
def test_of_a_bent_line_has_all_parts(bend: float) -> None:
    bent = np.outer([0.0, 1.0, 2.5], PLACES[0]) + np.outer([0.0, bend, 0.0], PLACES[1])
    omega = 3.0 * PLACES[0] + PLACES[1]  # along it too
    assert np.abs(turning(bent, omega)).max() < 1e-14 / bend**2


def test_of_a_point_is_none() -> None:
    assert np.abs(turning(np.zeros((1, 3)), np.zeros(3))).max() == 0.0
