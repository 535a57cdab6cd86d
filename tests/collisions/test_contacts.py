"""What `Simulator.contacts` tells: of bodies and of surfaces, against weights, momenta and geometry."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from springgym.dynamics.contacts import Contacts
from springgym.model.bodies import ball, cube
from springgym.model.scene import Placed, Scene
from springgym.model.surfaces import Contact, PaperContact, Plane
from springgym.simulator import Simulator
from springgym.theory.contact import energy
from tests.collisions.cases import CUBE
from tests.collisions.stepped import Stepped, full

FLOOR = Plane((0, 0, 0), (0, 0, 1))
BLOCK = cube(damping=200.0)
REACH = 0.01 * BLOCK.swept


def tower(**more: Any) -> Scene:
    """Two blocks, one on the other, on the floor, almost at rest."""
    low = -BLOCK.positions[:, 2].min() + 0.7 * REACH
    bodies = tuple(
        Placed(BLOCK, np.add(BLOCK.positions, (0, 0, low + n * (1 + 0.7 * REACH))), name=f"{n}")
        for n in range(2)
    )
    return Scene(bodies=bodies, surfaces=(FLOOR,), contact=Contact(restitution=0.0, friction=0.5), **more)


def of_copy(found: Contacts, copy: int) -> list[np.ndarray]:
    """What is told of one copy, without padding."""
    there = found.there[copy]
    return [of[copy][there] for of in found[1:]]


def test_what_rests_is_carried() -> None:
    """The floor carries both, the lower block the upper one; in each copy of a batch as in one alone."""
    scene = tower()
    one = Stepped(scene, copies=1)
    many = Stepped(scene, copies=3)
    x = np.repeat(scene.positions[None], 3, axis=0)
    x[1, :, 0] += 0.5
    x[2, :, 2] += 30.0  # which is aloft
    many.place(x, 0 * x)
    for world in (one, many):
        world.run(round(2.0 / world.step))
    found = many.simulator.contacts()
    weight = BLOCK.mass * 9.81
    for copy in (0, 1):
        floor = found.surface[copy] == 0
        assert np.sum(floor) == 4
        assert (found.first[copy][floor] == 0).all()
        assert (found.second[copy][floor] == -1).all()
        carried = found.force[copy][floor].sum(axis=0)
        np.testing.assert_allclose(carried, (0, 0, 2 * weight), atol=1e-5 * weight)
        between = found.there[copy] & ~floor
        assert between.any()
        np.testing.assert_allclose(
            -found.force[copy][between].sum(axis=0), (0, 0, weight), atol=1e-5 * weight
        )
        np.testing.assert_allclose(found.normal[copy][floor], 4 * [(0, 0, 1)], atol=1e-9)
        np.testing.assert_allclose(found.normal[copy][between], np.sum(between) * [(0, 0, -1)], atol=1e-3)
        assert (found.gap[copy][found.there[copy]] > 0).all()
        assert (found.gap[copy] < REACH).all()
    corners = np.sort(found.particle[0][found.surface[0] == 0])
    np.testing.assert_array_equal(corners, np.flatnonzero(BLOCK.positions[:, 2] < 0))
    assert not found.there[2].any()
    assert not found.impulse[2].any()
    assert (found.first[2] == -1).all()
    for own, others in zip(of_copy(one.simulator.contacts(), 0), of_copy(found, 0), strict=True):
        np.testing.assert_array_equal(own, others)


def test_where_balls_touch() -> None:
    """Between the rims of two balls, along the line of their centres."""
    small = ball(0.1, 0.2)
    large = ball(0.3, 1.0)
    along = np.array([2.0, 1.0, -2.0]) / 3
    bodies = (Placed(small, name="a"), Placed(large, -0.404 * along[None], name="b"))
    scene = Scene(bodies=bodies, gravity=None, collisions=Contact(strength=1e-3, reach=5e-3))
    simulator = full(scene)
    found = simulator.contacts()
    told = simulator.pairs()
    assert found.there.shape == (1, 1)
    assert told.touching[0, 0]
    assert told.energy[0, 0] == pytest.approx(float(energy(0.004, 1e-3, 5e-3)))
    assert told.min_gap[0, 0] == pytest.approx(0.004)
    assert (found.first[0, 0], found.second[0, 0], found.surface[0, 0]) == (0, 1, -1)
    np.testing.assert_allclose(found.normal[0, 0], along, rtol=1e-12)
    np.testing.assert_allclose(found.gap[0, 0], 0.004, rtol=1e-9)
    np.testing.assert_allclose(found.point[0, 0], -0.102 * along, rtol=1e-12)
    assert found.impulse[0, 0] @ along > 0
    simulator.advance(1)
    np.testing.assert_allclose(simulator.measure("a").momentum[0], found.impulse[0, 0], rtol=1e-12)


def test_a_body_in_a_corner() -> None:
    """One particle meets two walls: each is told by itself, and both together carry it."""
    slopes = (Plane((0, 0, 0), (1, 0, 1)), Plane((0, 0, 0), (-1, 0, 1)))
    grain = ball(0.05, 0.2)
    scene = Scene(
        grain,
        [[0.0, 0.0, np.sqrt(2) * 0.052]],
        surfaces=slopes,
        contact=Contact(strength=1e-3, reach=5e-3, restitution=0.0, friction=0.2),
    )
    simulator = Simulator(scene)
    simulator.advance(round(2.0 / simulator.step))
    found = simulator.contacts()
    assert found.surface.tolist() == [[0, 1]]
    np.testing.assert_allclose(found.force[0].sum(axis=0), (0, 0, 9.81 * 0.2), atol=1e-6)
    np.testing.assert_allclose(found.force[0, 0] * (-1, 1, 1), found.force[0, 1], atol=1e-6)
    np.testing.assert_allclose(found.normal[0], np.array([(1, 0, 1), (-1, 0, 1)]) / np.sqrt(2), atol=1e-9)


def test_who_has_none_to_tell() -> None:
    free = Simulator(Scene(CUBE), copies=3).contacts()
    assert free.there.shape == (3, 0)
    assert free.force.shape == (3, 0, 3)
    lifted = Scene(CUBE, np.add(CUBE.positions, (0, 0, 2)), surfaces=(FLOOR,))
    paper = lifted.with_(contact=PaperContact())
    for simulator, text in (
        (Simulator(paper, integrator="rk4", step=1e-4), "need a method with nodes"),
        (Simulator(tower(collisions=None)), "give the scene collisions"),
    ):
        with pytest.raises(ValueError, match=text):
            simulator.contacts()
