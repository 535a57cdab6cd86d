"""Top, gyroscope, box, cube and rope against closed forms."""

import numpy as np
import pytest

from springgym.model.bodies import box, cube, gyroscope, rope, top
from springgym.theory import free_body, pendulum
from springgym.theory.top import cone_top_inertia


@pytest.mark.parametrize(
    ("ring", "radius", "height", "mass"), [(12, 0.5, 1, 12), (3, 1, 0.5, 2), (48, 0.2, 2, 5)]
)
def test_top_about_its_tip(ring, radius, height, mass):
    body = top(ring, radius, height, mass)
    theory = cone_top_inertia(mass, radius, height)
    assert body.inertia((0, 0, 0)) == pytest.approx(np.diag([theory.i1, theory.i1, theory.i3]), abs=1e-12)
    assert body.mass * 9.81 * body.centre[2] == pytest.approx(theory.mgl)
    assert (len(body.masses), len(body.springs)) == (ring + 2, 3 * ring + 1)


def test_unbalanced_top_has_one_heavier_particle():
    body = top(scaled={3: 2.0})
    assert body.masses[3] == 2 * body.masses[0]
    assert body.mass == pytest.approx(12.5)
    assert body.centre[1] == pytest.approx(0.5 * 0.5 / 12.5)


def test_gyroscope_about_its_centre():
    body = gyroscope()
    centre = body.positions[body.particle("centre")]
    assert body.centre == pytest.approx(centre, abs=1e-15)
    assert body.inertia(centre) == pytest.approx(np.diag([0.75, 0.75, 1.0]), abs=1e-12)
    tall = gyroscope(axle=2.0, end_mass=1.0)
    assert tall.inertia()[0, 0] == pytest.approx(0.5 * 4 * 0.25 + 2 * 1.0)


def test_cube_is_the_papers():
    body = cube(side=2.0, mass=3.0)
    theory = pendulum.cube_on_vertex(3.0, 2.0)
    assert len(body.springs) == 28
    assert body.inertia() == pytest.approx(3.0 * 2.0**2 / 2 * np.eye(3), abs=1e-12)
    pin = body.positions[0]
    along = (body.positions[6] - pin) / np.linalg.norm(body.positions[6] - pin)
    tensor = body.inertia(pin)
    assert tensor @ along == pytest.approx(theory.i3 * along)
    assert np.sort(np.linalg.eigvalsh(tensor)) == pytest.approx([theory.i3, theory.i1, theory.i1])
    assert np.linalg.norm(body.centre - pin) == pytest.approx(theory.length)


def test_box_has_the_inertia_of_its_corners():
    sides = (1.0, 0.7, 0.4)
    body = box(sides, 2.0)
    assert np.diag(body.inertia()) == pytest.approx(free_body.corner_box_inertia(2.0, sides))
    unequal = box(sides, (0.2, 0.1, 0.1, 0.15, 0.1, 0.1, 0.15, 0.1))
    assert unequal.principal()[0] == pytest.approx([0.158, 0.289, 0.372], abs=5e-4)


@pytest.mark.parametrize("body", [top(), box((1.0, 2.0, 3.0)), cube()], ids=lambda body: body.name)
def test_surface_is_closed_and_faces_outwards(body):
    a, b, c = body.positions[body.triangles].transpose(1, 0, 2)
    outwards = ((a + b + c) / 3 - body.positions.mean(axis=0)) * np.cross(b - a, c - a)
    assert (outwards.sum(axis=1) > 0).all()
    edges = {(t[n], t[(n + 1) % 3]) for t in body.triangles.tolist() for n in range(3)}
    assert {(j, i) for i, j in edges} == edges


def test_rope_hangs_from_the_origin():
    body = rope(beads=9, length=4.0)
    assert body.positions[body.particle("weight")].tolist() == [0, 0, -4]
    assert body.lengths == pytest.approx(np.full(8, 0.5))
    assert body.masses.tolist() == [0.1] * 8 + [70]
    assert body.floppy
