"""Contacts of many bodies start from what the last node gave."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from springgym.dynamics.contacts import Contacts
from springgym.model.bodies import cube
from springgym.model.collisions.meeting import Meetings
from springgym.model.scene import Placed, Scene
from springgym.model.surfaces import Contact, floor
from springgym.simulator import Simulator

BLOCK = cube(side=0.1, mass=0.5, stiffness=1e5, damping=30)
REACH = 0.01 * BLOCK.swept
GRAVITY = 9.81
COUNT = 12


def column() -> Scene:
    """Blocks on each other, so near that they touch."""
    heights = 0.05 + 0.5 * REACH + (0.1 + 0.5 * REACH) * np.arange(COUNT)
    middle = BLOCK.positions - BLOCK.positions.mean(axis=0)
    bodies = tuple(
        Placed(BLOCK, np.add(middle, (0, 0, height)), name=f"block{n}") for n, height in enumerate(heights)
    )
    contact = Contact(friction=0.6, restitution=0.2)
    return Scene(bodies=bodies, surfaces=(floor(),), contact=contact, collisions="all")


def pushes_and_law(found: Contacts, meetings: Meetings) -> tuple[np.ndarray, np.ndarray]:
    """Return the normal force of each contact of two blocks, and that of the law at its gap [N]."""
    between = found.there[0] & (found.second[0] >= 0)
    push = (found.force * found.normal).sum(axis=-1)[0][between]
    c = meetings.strength[0]
    reach = meetings.reach[0]
    gap = found.gap[0][between]
    return push, c / gap**2 - c / reach**2


def held(found: Contacts) -> np.ndarray:
    """Return the force with which each block holds the one above, over the weight above."""
    first = found.first[0]
    above = found.second[0] == found.first[0] + 1
    forces = np.bincount(first[above], -found.force[0, above, 2])
    return np.array(forces / (np.arange(COUNT - 1, 0, -1) * BLOCK.mass * GRAVITY))


RIGID: dict[str, Any] = {"dynamics": "rigid", "step": 1e-3}


@pytest.mark.parametrize(
    ("options", "seconds"),
    [pytest.param({}, 1.5, id="springs"), pytest.param(RIGID, 4.0, id="rigid", marks=pytest.mark.slow)],
)
def test_what_rests_is_held_as_the_law_says(options: dict[str, Any], seconds: float) -> None:
    """Two sweeps from nothing miss the law by four fifths of the largest force, eight sweeps by a half.

    Rigid blocks never rest, and walk, if rounding moves their arms or sweeps end at 1e-3 Δ.
    """
    simulator = Simulator(column(), **options)
    simulator.advance(round(seconds / simulator.step))
    found = simulator.contacts()
    push, law = pushes_and_law(found, simulator.scene.meetings)
    assert np.abs(push - law).max() < 1e-3 * push.max()
    np.testing.assert_allclose(held(found), 1.0, atol=2e-6)
    assert np.abs(simulator.velocities).max() < 5e-6
