"""What a body hides of marks and traces."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from springgym.model.bodies import box
from springgym.rendering import Arrow, Camera, Look, Marks, Renderer, Scenery
from springgym.rendering.look import RED

BOX = box((1.0, 0.6, 0.8))
CORNERS = BOX.positions - BOX.positions.mean(axis=0)
FRONT = Camera(eye=(0.0, -4.0, 0.0), target=(0.0, 0.0, 0.0), fov=0.6)
SIZE = (120, 120)
YELLOW = (240, 225, 120)
SHAPES = {
    "nothing": (Look(), np.zeros((0, 3))),
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
PALE = ("arrow", "around", "trace", "ball")


def seen(shape, mark, y, camera=FRONT, strain=None):
    """How much the mark at y, of which the middle is in the middle of the picture, changes it there."""
    look, positions = SHAPES[shape]
    given = MARKS[mark](y)
    pictures = []
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


@pytest.mark.parametrize("shape", ["box", "ball", "bar"])
@pytest.mark.parametrize("mark", MARKS)
def test_a_body_hides_the_marks_behind_it(shape, mark):
    """Nothing is seen of what is fixed; arrows, traces and targets show faintly. Before it, all are seen."""
    behind = seen(shape, mark, 0.9)
    before = seen(shape, mark, -0.9)
    assert before > 40
    if mark in PALE:
        assert 0.15 * before < behind < 0.65 * before
    else:
        assert behind == 0


@pytest.mark.parametrize("mark", [*PALE, "line"])
def test_glass_shows_the_marks_behind_it(mark):
    assert seen("box", mark, 0.9, strain=[]) > 0.9 * seen("nothing", mark, 0.9)


def test_a_line_on_a_face_is_seen():
    assert seen("box", "trace", -0.3) > 0.9 * seen("box", "trace", -0.9)


@pytest.mark.parametrize("lost", [np.nan, np.inf, 1e200])
def test_what_is_lost_hides_nothing(lost):
    """Of a ball and a box, of which one is not there, only the other hides the line behind."""
    look = Look(triangles=BOX.triangles, radii=[*[0.0] * 8, 0.35])
    for gone, hides in ((slice(0, 8), True), (slice(8, 9), True), (slice(0, 9), False)):
        positions = np.vstack([CORNERS, np.zeros((1, 3))])
        positions[gone] = lost
        with_line, without = (
            Renderer(look, FRONT, None, SIZE).draw(positions, Marks(lines=lines)).astype(int)
            for lines in ([((-1, 0.9, 0), (1, 0.9, 0))], ())
        )
        assert (np.abs(with_line - without)[57:63, 57:63].max() == 0) == hides
