"""What a body hides: against straight ways from the eye that are followed point by point."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from springgym.bodies import box
from springgym.rendering import Arrow, Camera, Look, Marks, Renderer, Scenery, occlusion
from springgym.rendering.look import RED
from springgym.rendering.occlusion import Occluders

EYE = np.array([0.3, -4.0, 0.8])
HALF = np.array([0.5, 0.3, 0.4])
BOX = box(tuple(2 * HALF))
CORNERS = BOX.positions - BOX.positions.mean(axis=0)
STARTS = np.array([(-0.7, 0.2, -0.3), (0.4, -0.3, 0.5)])
STOPS = np.array([(0.6, -0.4, 0.1), (0.4, -0.3, 0.5)])  # the second is a ball
RADII = np.array([0.12, 0.35])


def inside_box(x, grown):
    return (np.abs(x) < grown * HALF).all(axis=-1)


def inside_rods(x, grown):
    along = STOPS - STARTS
    length = np.maximum((along**2).sum(axis=1), 1e-30)
    share = np.clip(((x[..., None, :] - STARTS) * along).sum(axis=-1) / length, 0.0, 1.0)
    apart = np.linalg.norm(x[..., None, :] - STARTS - share[..., None] * along, axis=-1)
    return (apart < grown * RADII).any(axis=-1)


BODIES = {
    "box": (Look(triangles=BOX.triangles), CORNERS, inside_box),
    "rods": (
        Look(bars=[(0, 1)], bar_radius=RADII[0], radii=[0, 0, RADII[1]]),
        np.array([STARTS[0], STOPS[0], STARTS[1]]),
        inside_rods,
    ),
}


def hidden(look, positions, points, eye=EYE):
    return Occluders(eye, look, positions, np.asarray(look.opacity)).hide(points)


@pytest.mark.parametrize("name", BODIES)
def test_what_a_body_hides(name):
    look, positions, inside = BODIES[name]
    points = np.random.default_rng(0).uniform(-1.5, 1.5, (2000, 3))
    ways = EYE + np.linspace(0.0, 0.99, 400)[:, None, None] * (points - EYE)
    surely, perhaps = (inside(ways, grown).any(axis=0) for grown in (0.9, 1.1))
    found = hidden(look, positions, points)
    assert 100 < surely.sum() < 1000
    assert (perhaps & ~surely).sum() < 250
    assert found[surely].all()
    assert not found[~perhaps].any()


def test_a_surface_does_not_hide_itself():
    faces = CORNERS[BOX.triangles]
    facing = (np.cross(faces[:, 1] - faces[:, 0], faces[:, 2] - faces[:, 0]) * (EYE - faces[:, 0])).sum(1) > 0
    found = hidden(*BODIES["box"][:2], faces.mean(axis=1))
    np.testing.assert_array_equal(found, ~facing)
    assert 4 <= facing.sum() <= 6


def test_the_back_of_a_surface_is_not_drawn_and_hides_nothing():
    triangle, behind = np.array([(-1, 0, -1), (1, 0, -1), (0, 0, 1.0)]), np.array([[0.0, 1.0, 0.0]])
    assert hidden(Look(triangles=[(0, 1, 2)]), triangle, behind)
    assert not hidden(Look(triangles=[(0, 2, 1)]), triangle, behind)


def test_glass_hides_nothing_and_what_is_lost_does_neither_harm_nor_hide():
    behind = np.array([[0.0, 1.0, 0.0], [np.nan, 1.0, 0.0]])
    glass = Look(triangles=BOX.triangles, opacity=0.5)
    np.testing.assert_array_equal(hidden(BODIES["box"][0], CORNERS, behind), [True, False])
    assert not hidden(glass, CORNERS, behind).any()
    for value in (np.nan, np.inf, 1e200):
        lost = CORNERS.copy()
        lost[:] = value
        assert not hidden(BODIES["box"][0], lost, behind).any()
        assert not hidden(BODIES["rods"][0], lost[:3], behind).any()
    assert not hidden(Look(), np.zeros((0, 3)), behind).any()
    assert hidden(*BODIES["box"][:2], np.zeros((0, 3))).shape == (0,)


@pytest.mark.parametrize("name", BODIES)
def test_parts_of_a_body_hide_what_all_of_it_hides(name, monkeypatch):
    points = np.random.default_rng(1).uniform(-1.0, 1.0, (50, 3))
    whole = hidden(*BODIES[name][:2], points)
    monkeypatch.setattr(occlusion, "_AT_ONCE", 50)  # one surface at a time
    np.testing.assert_array_equal(hidden(*BODIES[name][:2], points), whole)
    assert 0 < whole.sum() < 50


# --- In pictures --------------------------------------------------------------------------------------

FRONT = Camera(eye=(0.0, -4.0, 0.0), target=(0.0, 0.0, 0.0), fov=0.6)
SIZE = (120, 120)
YELLOW = (240, 225, 120)
SHAPES = {
    "box": (Look(triangles=BOX.triangles, triangle_colors=YELLOW), CORNERS),
    "ball": (Look(radii=[0.35], ball_colors=YELLOW), np.zeros((1, 3))),
    "bar": (Look(bars=[(0, 1)], bar_radius=0.3, bar_colors=YELLOW), np.array([(0, 0, -0.6), (0, 0, 0.6)])),
}
MARKS = {
    "line": lambda y: Marks(lines=[((-1, y, 0), (1, y, 0))]),
    "ring": lambda y: Marks(rings=[((0, y + np.sign(y), 0), 1.0)]),  # its nearest or farthest point
    "ball": lambda y: Marks(balls=[((0, y, 0), 0.15)]),
    "arrow": lambda y: Marks(arrows=[Arrow((-0.8, y, 0), (1.6, 0, 0), RED)]),
    "around": lambda y: Marks(arrows=[Arrow((0, y + 0.5, 0), (0, 0, 1.6), RED, 0.5)]),
    "vertical": lambda y: Scenery(vertical=((0, y, -1), 2.0)),
    "trace": lambda y: [(x, y, 0.0) for x in np.linspace(-1, 1, 11)],
}
PALE = ("arrow", "around", "trace")


def seen(shape, mark, y, camera=FRONT, strain=None):
    """How much the mark at y, of which the middle is in the middle of the picture, changes it there."""
    look, positions = SHAPES[shape]
    given, pictures = MARKS[mark](y), []
    for shown in (False, True):
        traced = replace(look, trace=len(positions), trace_length=11)
        renderer = Renderer(
            traced if mark == "trace" else look, camera, given if shown and mark == "vertical" else None, SIZE
        )
        path = given if mark == "trace" and shown else [(9.0, 9.0, 9.0)]
        for point in path:
            renderer.follow(np.vstack([positions, point]))
        marks = given if shown and isinstance(given, Marks) else None
        pictures.append(renderer.draw(np.vstack([positions, path[-1]]), marks, strain).astype(int))
    return np.abs(pictures[1] - pictures[0])[57:63, 57:63].max()


@pytest.mark.parametrize("shape", SHAPES)
@pytest.mark.parametrize("mark", MARKS)
def test_a_body_hides_the_marks_behind_it(shape, mark):
    """Nothing is seen of what is fixed, and arrows and traces show faintly; before the body, all are seen."""
    behind, before = seen(shape, mark, 0.9), seen(shape, mark, -0.9)
    assert before > 40
    if mark in PALE:
        assert 0.15 * before < behind < 0.65 * before
    else:
        assert behind == 0


@pytest.mark.parametrize("mark", [*PALE, "line"])
def test_glass_shows_the_marks_behind_it(mark):
    assert seen("box", mark, 0.9, strain=[]) > 0.9 * seen("box", mark, -0.9, strain=[])
