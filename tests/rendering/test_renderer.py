import os
import pickle
import subprocess
import sys

import numpy as np
import pytest
from gymnasium.error import DependencyNotInstalled

from springgym.model.bodies import box
from springgym.model.surfaces import Bowl, Pipe, waves
from springgym.rendering import Arrow, Camera, Look, Marks, Renderer, Scenery, two_tone
from springgym.rendering.canvas import lamp

RED = (210, 30, 30)
GREEN = (30, 180, 60)
BLUE = (30, 60, 210)
FRONT = Camera(eye=(0.0, -4.0, 0.0), target=(0.0, 0.0, 0.0), fov=2.0 * np.arctan(0.25))  # 2 m high
CORNERS = np.array([(1, 1, 1), (1, -1, -1), (-1, 1, -1), (-1, -1, 1)]) * 0.4
FACES = [(0, 1, 2), (0, 3, 1), (0, 2, 3), (1, 3, 2)]
SIZE = (96, 96)


def turned(points, angle):
    c = np.cos(angle)
    s = np.sin(angle)
    return points @ np.array([(c, s, 0), (-s, c, 0), (0, 0, 1)])


def draw(look, positions, marks=None, strain=None, camera=FRONT, scenery=None, size=SIZE):
    return Renderer(look, camera, scenery, size=size).draw(positions, marks, strain).astype(int)


def pixel(picture, point, camera=FRONT):
    """The pixel of a world point."""
    x, y = camera.project(point, picture.shape[1::-1])[0]
    return picture[int(y), int(x)]


def strongest(color):
    return int(np.argmax(color))


def empty(**kwargs):
    return draw(Look(), np.zeros((0, 3)), **kwargs)


@pytest.fixture
def tetrahedron():
    return Look(triangles=FACES, triangle_colors=[RED, GREEN, BLUE, (200, 180, 40)], trace=0)


def test_works_without_a_display():
    code = """
import sys
import numpy as np
from springgym.rendering import Camera, Look, Renderer
renderer = Renderer(Look(radii=[0.3]), Camera((0, -4, 0), (0, 0, 0)))
assert "pygame" not in sys.modules
picture = renderer.draw(np.zeros((1, 3)))
import pygame
assert not pygame.display.get_init()
assert picture.std() > 5
"""
    bare = {k: v for k, v in os.environ.items() if k not in ("DISPLAY", "WAYLAND_DISPLAY", "SDL_VIDEODRIVER")}
    subprocess.run([sys.executable, "-W", "error", "-c", code], env=bare, check=True, timeout=60)


def test_missing_pygame(monkeypatch, tetrahedron):
    renderer = Renderer(tetrahedron, FRONT)
    monkeypatch.setitem(sys.modules, "pygame", None)
    with pytest.raises(DependencyNotInstalled, match=r"drawing needs pygame: pip install .*render"):
        renderer.draw(CORNERS)


@pytest.mark.parametrize("size", [(640, 640), (120, 70), (31, 50)])
def test_shape_and_type(tetrahedron, size):
    picture = Renderer(tetrahedron, FRONT, size=size).draw(CORNERS)
    assert picture.shape == (size[1], size[0], 3)
    assert picture.dtype == np.uint8
    assert picture.flags.writeable
    assert picture.flags.c_contiguous


def test_rotation_changes_the_body_alone(tetrahedron):
    before = draw(tetrahedron, CORNERS)
    after = draw(tetrahedron, turned(CORNERS, 0.5))
    changed = np.abs(before - after).max(axis=2) > 20
    assert changed.mean() > 0.05
    reach = SIZE[0] / 2 * 0.4 * np.sqrt(3) * 1.3  # px; the corners' sphere, enlarged by perspective
    y, x = np.nonzero(changed)
    assert np.hypot(x - 47.5, y - 47.5).max() < reach


def test_same_input_gives_same_pixels(tetrahedron):
    scenery = Scenery(floor=-1.0, vertical=((0, 0, -1), 2.0))
    camera = Camera.framing((0, 0, 0), 3.0)
    marks = Marks(rings=[((0.5, 0.5, -1), 0.2)], arrows=[Arrow((0, 0, 0), (0, 0, 1))], text=["spin 1"])
    fresh = Renderer(tetrahedron, camera, scenery, size=SIZE)
    used = Renderer(tetrahedron, camera, scenery, size=SIZE)
    for angle in np.linspace(0, 2, 9):
        used.draw(turned(CORNERS * (1 + angle), angle), Marks(balls=[((1, 0, 0), 0.3)]))
    used.reset()
    np.testing.assert_array_equal(used.draw(CORNERS, marks), fresh.draw(CORNERS, marks))


@pytest.mark.parametrize("order", [(0, 1), (1, 0)])
@pytest.mark.parametrize("near", [0, 1])
def test_nearer_faces_hide_farther(order, near):
    patch = np.array([(-0.5, 0, -0.5), (0.5, 0, -0.5), (0, 0, 0.6)])
    away = np.array([0, 1.0, 0])
    positions = np.concatenate([patch + away * (near != k) for k in (0, 1)])
    triangles = np.array([(0, 1, 2), (3, 4, 5)])[list(order)]
    colors = np.array([RED, GREEN])[list(order)]
    picture = draw(Look(triangles=triangles, triangle_colors=colors), positions)
    assert strongest(pixel(picture, (0, 0, 0))) == near


def test_only_the_outside_of_a_closed_surface_is_drawn():
    patch = np.array([(-0.5, 0, -0.5), (0.5, 0, -0.5), (0, 0, 0.6)])
    outwards = Look(triangles=[(0, 1, 2)])
    inwards = Look(triangles=[(0, 2, 1)])
    sheet = Look(triangles=[(0, 2, 1)], opacity=0.5)
    background = empty()
    assert np.abs(draw(outwards, patch) - background).max() > 50
    assert np.abs(draw(inwards, patch) - background).max() == 0
    half = np.abs(draw(sheet, patch) - background).max()
    assert 20 < half < np.abs(draw(outwards, patch) - background).max()


def test_balls_and_bars_hide_each_other_by_distance():
    look = Look(bars=[(0, 1)], bar_radius=0.05, bar_colors=RED, radii=[0, 0, 0.2], ball_colors=BLUE)
    bar = np.array([(-0.8, 0, 0), (0.8, 0, 0)])
    for y, seen in ((-0.5, 2), (0.5, 0)):
        picture = draw(look, np.concatenate([bar, [(0, y, 0)]]))
        assert strongest(pixel(picture, (0, y, 0))) == seen
        assert strongest(pixel(picture, (-0.6, 0, 0))) == 0


def test_a_ball_on_one_of_several_bodies_is_whole():
    """On the far end of a slab, of which the sides and the lower face are nearer; behind a box, it is not."""
    above = Camera(eye=(0.0, -4.0, 3.0), target=(0.0, 0.0, 0.0), fov=FRONT.fov)
    slab = box((1.6, 1.6, 0.2))
    block = box((0.3, 0.2, 0.4))
    faces = np.concatenate([slab.triangles, block.triangles + 8])
    look = Look(triangles=faces, triangle_colors=GREEN, radii=[*[0] * 16, 0.1], ball_colors=RED)
    for beside, seen in ((0.4, 0), (0.0, 1)):
        standing = block.positions + np.array((0.0, 0.4, 0.3))
        picture = draw(look, np.vstack([slab.positions, standing, (beside, 0.65, 0.2)]), camera=above)
        for height in (0.13, 0.2, 0.27):
            assert strongest(pixel(picture, (beside, 0.65, height), above)) == seen


def test_a_nearer_ball_hides_the_body_and_its_outline():
    look = Look(triangles=FACES, radii=[0, 0, 0, 0, 0.25], ball_colors=RED)
    positions = np.concatenate([CORNERS, [(0.2, -1.0, 0.2)]])
    both = draw(look, positions)
    ball = draw(Look(radii=look.radii, ball_colors=RED), positions)
    (x, y), depth = FRONT.project(positions[4], SIZE)
    radius = 0.25 * FRONT.pixels_per_radian(SIZE[1]) / depth
    columns, rows = np.meshgrid(np.arange(96) + 0.5, np.arange(96) + 0.5)
    inside = np.hypot(columns - x, rows - y) < radius - 1.5
    assert inside.sum() > 300
    np.testing.assert_array_equal(both[inside], ball[inside])
    assert np.abs(both - ball)[~inside].max() > 50


def test_sharp_edges_are_outlined_and_flat_ones_are_not():
    look = Look(triangles=[(0, 1, 2), (0, 2, 3)])
    for fold, outlined in ((0.0, False), (1.0, True)):  # the diagonal lies fold nearer the eye
        square = np.array([(-0.5, -fold, -0.5), (0.5, 0, -0.5), (0.5, -fold, 0.5), (-0.5, 0, 0.5)])
        picture = draw(look, square, size=(200, 200)).sum(axis=2)
        ridge = 0.5 * (square[0] + square[2])
        x, y = FRONT.project(ridge, (200, 200))[0].astype(int)
        darker_face = min(picture[y, x + 8], picture[y, x - 8])
        assert (picture[y, x] < 0.8 * darker_face) == outlined


def test_faces_to_the_lamp_are_brighter():
    base = np.array([(-0.5, 0, -0.5), (0.5, 0, -0.5), (0, 0, 0.6)])
    dark, lit = (
        pixel(
            draw(Look(triangles=[(0, 1, 2)]), base + lean * np.array([(0, 0, 0), (0, 0, 0), (0, 1, 0)])),
            (0, 0, 0),
        )
        for lean in (-0.9, 0.9)  # looking down, looking up
    )
    assert lit.sum() > 1.2 * dark.sum()


@pytest.mark.parametrize("height", [0.7, 1.2])
def test_shadow_lies_along_the_light(height):
    camera = Camera.framing((0, 0, 0), 3.0, elevation=0.9)
    scenery = Scenery(floor=0.0)
    size = (320, 320)
    ball = np.array([0.3, 0.1, height])
    shown = draw(Look(radii=[0.1]), [ball], camera=camera, scenery=scenery, size=size)
    dark = (empty(camera=camera, scenery=scenery, size=size) - shown).sum(axis=2)
    x, y = np.meshgrid(np.arange(320) + 0.5, np.arange(320) + 0.5)
    at_ball = camera.project(ball, size)[0]
    dark[np.hypot(x - at_ball[0], y - at_ball[1]) < 16] = 0  # its picture's radius is 12 px
    middle = np.array([(x * dark).sum(), (y * dark).sum()]) / dark.sum()
    light = lamp(camera)
    expected = camera.project(ball - light * height / light[2], size)[0]
    assert dark.max() > 60
    assert np.hypot(*(expected - at_ball)) > 25
    np.testing.assert_allclose(middle, expected, atol=1.5)  # half a pixel of the shadow's mask


def arc(angles):
    return np.column_stack([0.8 * np.cos(angles), np.zeros(len(angles)), 0.8 * np.sin(angles)])


def orange(picture, point):
    """Return how much of the trace's colour is near a world point."""
    x, y = FRONT.project(point, picture.shape[1::-1])[0].astype(int)
    patch = picture[y - 2 : y + 3, x - 2 : x + 3]
    return (patch[..., 0] - patch[..., 2]).max()


def test_trace_passes_through_moments_that_are_not_drawn():
    """Of a half circle in ten moments, only the ends are drawn: a straight line, unless it is followed."""
    look = Look(trace=0, trace_length=20)
    points = arc(np.linspace(0.0, np.pi, 11))
    top = (0.0, 0.0, 0.8)
    across = (0.0, 0.0, 0.0)
    plain = Renderer(look, FRONT, size=SIZE)
    followed = Renderer(look, FRONT, size=SIZE)
    plain.draw(points[:1])
    picture = plain.draw(points[-1:]).astype(int)
    assert orange(picture, across) > 60 > 20 > orange(picture, top)
    followed.follow(points[:1])
    followed.draw(points[:1])
    for point in points[1:]:
        followed.follow(point[None])
    first = followed.draw(points[-1:]).astype(int)
    assert orange(first, top) > 60 > 20 > orange(first, across)
    np.testing.assert_array_equal(followed.draw(points[-1:]), first)  # drawing adds no moment
    followed.reset()
    followed.draw(points[:1])
    assert orange(followed.draw(points[-1:]).astype(int), across) > 60


def test_trace_appears_fades_and_is_forgotten():
    look = Look(trace=0, trace_length=20)
    renderer = Renderer(look, FRONT, size=SIZE)
    path = np.column_stack([np.linspace(-0.7, 0.7, 20), np.zeros(20), np.zeros(20)])
    for point in path:
        picture = renderer.draw([point]).astype(int)
    background = empty()
    change = np.abs(picture - background).max(axis=2)[47:49].max(axis=0)
    young = change[int(48 + 0.6 * 48)]
    old = change[int(48 - 0.3 * 48)]
    assert young > 100
    assert 10 < old < 0.7 * young
    renderer.reset()
    np.testing.assert_array_equal(renderer.draw([path[0]]), background)


def test_springs_show_their_strain():
    look = Look(springs=[(0, 1), (2, 3), (4, 5)], strain_scale=1e-3, triangles=[(0, 1, 4)])
    z = np.repeat([0.5, 0.0, -0.5], 2)
    positions = np.column_stack([np.tile([-0.8, 0.8], 3), np.zeros(6), z])
    picture = draw(look, positions, strain=[1e-3, -1e-3, 0.0], size=(200, 200))
    stretched, squeezed, slack = (pixel(picture, (0.3, 0, h)) for h in (0.5, 0.0, -0.5))
    assert stretched[0] > stretched[2] + 100
    assert squeezed[2] > squeezed[0] + 100
    assert np.ptp(slack) < 30
    plain = draw(look, positions, size=(200, 200))
    assert np.abs(pixel(plain, (0.3, 0, -0.5)) - slack).max() > 30  # no springs unless asked


def test_marks_are_where_they_should_be():
    background = empty()
    ball = draw(Look(), np.zeros((0, 3)), Marks(balls=[((0.4, 0, 0.3), 0.1)]))
    assert strongest(pixel(ball, (0.4, 0, 0.3))) == 1
    arrow = draw(Look(), np.zeros((0, 3)), Marks(arrows=[Arrow((0, 0, 0), (0.6, 0, 0), BLUE)]))
    assert strongest(pixel(arrow, (0.3, 0, 0))) == 2
    assert np.abs(arrow - background)[:, :46].max() == 0
    assert np.abs(arrow - background)[:, int(48 + 0.62 * 48) :].max() == 0
    assert np.abs(arrow - background)[[*range(42), *range(54, 96)]].max() == 0
    rail = draw(Look(), np.zeros((0, 3)), Marks(lines=[((-0.5, 0, 0.5), (0.5, 0, 0.5))]))
    assert np.abs(pixel(rail, (0.4, 0, 0.5)) - pixel(background, (0.4, 0, 0.5))).max() > 40
    text = draw(Look(), np.zeros((0, 3)), Marks(text=["spin 49.8 rad/s"]))
    assert np.abs(text - background)[:30].max() > 100
    assert np.abs(text - background)[30:].max() == 0
    above = Camera.framing((0, 0, 0), 2.0, elevation=1.2)
    ring = draw(Look(), np.zeros((0, 3)), Marks(rings=[((0.2, 0, 0), 0.4)]), camera=above)
    for angle in (0.0, 2.0, 4.0):
        edge = (0.2 + 0.4 * np.cos(angle), 0.4 * np.sin(angle), 0)
        assert strongest(pixel(ring, edge, above)) == 1


def test_edges_have_their_colour():
    ends = ((-0.5, 0, 0.5), (0.5, 0, 0.5))
    given = draw(Look(), np.zeros((0, 3)), Marks(edges=[(*ends, BLUE)]))
    assert strongest(pixel(given, (0.4, 0, 0.5))) == 2
    plain = draw(Look(), np.zeros((0, 3)), Marks(lines=[ends]))
    assert np.ptp(pixel(plain, (0.4, 0, 0.5))) < 40


@pytest.mark.parametrize("tone", [0, 60, 128, 255])
@pytest.mark.parametrize("where", ["text", "key"])
def test_words_can_be_read_before_any_background(tone, where):
    """The contrast of WCAG 2 between the words and what is just around them is 4.5 at least."""
    ground = Scenery(disks=[((0, 0, -5), 60.0, (tone, tone, tone))])
    above = Camera.framing((0, 0, 0), 2.0, elevation=1.2)
    marks = Marks(text=["spin 49.8 rad/s"]) if where == "text" else Marks(key=[(BLUE, "spin 49.8 rad/s")])
    picture = draw(Look(), np.zeros((0, 3)), marks, None, above, ground, (200, 200))
    without = draw(Look(), np.zeros((0, 3)), Marks(), None, above, ground, (200, 200))
    changed = np.abs(picture - without).max(axis=2) > 0
    shares = np.where(picture <= 10, picture / 3294.6, ((picture / 255 + 0.055) / 1.055) ** 2.4)
    light = (shares @ (0.2126, 0.7152, 0.0722))[changed]
    dark = np.percentile(light, 2)
    bright = np.percentile(light, 60)
    assert (bright + 0.05) / (dark + 0.05) >= 4.5


@pytest.mark.parametrize("sign", [1, -1])
def test_an_arrow_around_an_axis(sign):
    """Half a turn about the upright, the middle of it nearest to the eye, by the right hand."""
    camera = Camera.framing((0, 0, 0), 2.0, azimuth=0.0, elevation=1.2)
    radius = 0.6
    size = (300, 300)
    mark = Arrow((0, 0, 0), (0, 0, sign * np.pi * radius), BLUE, radius)
    picture = draw(Look(), np.zeros((0, 3)), Marks(arrows=[mark]), camera=camera, size=size)
    blue = (picture[..., 2] - picture[..., 0] > 60).astype(int)

    def around(angle, share=1.0):
        at = share * radius * np.array([np.cos(angle), np.sin(angle), 0.0])
        return pixel(blue, at, camera)

    assert all(around(angle) for angle in np.linspace(-1.4, 1.4, 15))
    assert not any(around(angle) for angle in np.linspace(1.8, 4.5, 15))
    assert not any(around(angle, share) for angle in np.linspace(-3, 3, 15) for share in (0.0, 0.7, 1.3))
    head, tail = (
        sum(around(end * angle, share) for angle in np.linspace(1.3, 1.6, 31) for share in (0.955, 1.045))
        for end in (sign, -sign)
    )
    assert head > 10 > tail


@pytest.mark.parametrize("radius", [0.0, 0.5])
def test_a_vanishing_arrow_is_left_out(radius):
    marks = Marks(arrows=[Arrow((0, 0, 0), (0, 0, 0), RED, radius)])
    np.testing.assert_array_equal(draw(Look(), np.zeros((0, 3)), marks), empty())


@pytest.mark.parametrize(
    "scenery",
    [
        Scenery(floor=-0.5),
        Scenery(planes=[((0, 1, 0), (0, -2, 0))]),
        Scenery(surfaces=[Bowl((0, 0, 0.5), 1.0)]),
        Scenery(surfaces=[Pipe((0, 0, 0.5), (1, 0.5, 0), 1.0)]),
        Scenery(surfaces=[waves(0.1, 1.0, 1.5, 0.1)]),
        Scenery(vertical=((0, 0, -0.5), 1.0)),
    ],
)
def test_scenery_is_drawn_and_can_be_exchanged(scenery):
    camera = Camera.framing((0, 0, 0), 2.0)
    renderer = Renderer(Look(), camera, size=SIZE)
    without = renderer.draw(np.zeros((0, 3))).astype(int)
    renderer.scenery = scenery
    shown = renderer.draw(np.zeros((0, 3))).astype(int)
    assert np.abs(shown - without).max() > 15
    np.testing.assert_array_equal(shown, empty(camera=camera, scenery=scenery))
    renderer.camera = Camera.framing((0, 0.1, 0), 2.2, azimuth=0.3, elevation=0.5)
    assert np.abs(renderer.draw(np.zeros((0, 3))).astype(int) - shown).max() > 15


def test_nothing_of_the_floor_is_above_the_horizon():
    wide = Camera(eye=(0, -1, 0.5), target=(0, 0, 0.5), fov=2.2)
    change = np.abs(empty(camera=wide, scenery=Scenery(floor=0.0)) - empty(camera=wide)).max(axis=(1, 2))
    assert change[:48].max() == 0
    assert change[60:].max() > 10


def test_the_floor_hides_the_wall_beneath_it():
    camera = Camera.framing((0, 0, 0.2), 2.0, azimuth=-np.pi / 2, elevation=0.4)
    wall = ((0, 0.6, 0), (0, -1, 0))
    floor, both = (empty(camera=camera, scenery=Scenery(floor=0.0, planes=p)) for p in ((), (wall,)))
    edge = int(camera.project((0, 0.6, 0), SIZE)[0][1])
    np.testing.assert_array_equal(floor[edge + 2 :], both[edge + 2 :])
    assert np.abs(floor - both)[:edge].max() > 10


def test_the_back_of_a_plane_is_not_drawn():
    behind = Scenery(planes=[((0, -1, 0), (0, 1, 0))])  # between the eye and the body, facing away
    np.testing.assert_array_equal(empty(scenery=behind), empty())


def test_the_body_hides_the_vertical_behind_it():
    scenery = Scenery(vertical=((0, 0.5, -1), 2.0))
    look = Look(radii=[0.3], ball_colors=RED)
    lone = draw(look, np.zeros((1, 3)))
    with_line = draw(look, np.zeros((1, 3)), scenery=scenery)
    change = np.abs(with_line - lone).max(axis=2)[:, 46:51].max(axis=1)
    assert change[:30].max() > 50
    assert change[38:59].max() == 0


@pytest.mark.parametrize("lost", [np.nan, np.inf])
def test_what_touches_a_lost_particle_is_left_out(tetrahedron, lost):
    camera = Camera.framing((0, 0, 0), 2.5)
    scenery = Scenery(floor=-0.6, surfaces=[Bowl((0, 0, 0.5), 1.0)])
    chain = Look(radii=[0.2, 0.2], bars=[(0, 1)], springs=[(0, 1)])
    one = Look(radii=[0.0, 0.2], springs=[(0, 1)])
    positions = np.array([(lost, lost, 0.0), (0.3, 0.0, 0.0)])
    seen = [draw(look, positions, None, [0.0], camera, scenery) for look in (chain, one)]
    np.testing.assert_array_equal(*seen)
    gone = draw(tetrahedron, CORNERS * lost, camera=camera, scenery=scenery)
    np.testing.assert_array_equal(gone, empty(camera=camera, scenery=scenery))
    assert np.abs(seen[0] - gone).max() > 50


def test_a_body_too_near_or_behind_the_eye_does_no_harm(tetrahedron):
    for distance in (3.7, 4.0, 4.3):
        picture = draw(tetrahedron, CORNERS - np.array([0, distance, 0]))
        assert picture.shape == (96, 96, 3)
    np.testing.assert_array_equal(draw(tetrahedron, CORNERS - np.array([0, 8, 0])), empty())


def test_window_shows_what_the_array_shows(monkeypatch, tetrahedron):
    import pygame

    monkeypatch.setenv("SDL_VIDEODRIVER", "dummy")
    window = Renderer(tetrahedron, FRONT, size=SIZE, mode="human", fps=1000)
    assert not pygame.display.get_init()
    marks = Marks(text=["spin 3"])
    assert window.draw(CORNERS, marks) is None
    assert window.draw(turned(CORNERS, 0.3), marks) is None
    shown = pygame.surfarray.array3d(pygame.display.get_surface()).swapaxes(0, 1)
    array = Renderer(tetrahedron, FRONT, size=SIZE)
    array.draw(CORNERS)
    np.testing.assert_array_equal(shown, array.draw(turned(CORNERS, 0.3), marks))
    array.close()
    assert pygame.display.get_init()
    window.close()
    assert not pygame.display.get_init()
    window.close()


def test_a_closed_renderer_travels_and_draws_again(tetrahedron):
    renderer = Renderer(tetrahedron, FRONT, Scenery(floor=-1.0), size=SIZE)
    first = renderer.draw(CORNERS)
    renderer.close()
    np.testing.assert_array_equal(pickle.loads(pickle.dumps(renderer)).draw(CORNERS), first)
    np.testing.assert_array_equal(renderer.draw(CORNERS), first)


@pytest.mark.parametrize(
    ("made", "drawn", "message"),
    [
        ({}, {"positions": np.zeros((3, 3))}, "positions are 3; the look draws 4 particles"),
        ({}, {"positions": np.zeros((4, 2))}, r"positions is .*it must be an array of shape \(n, 3\)"),
        ({}, {"positions": np.zeros(12)}, r"positions is .*it must be an array of shape \(n, 3\)"),
        ({}, {"strain": [0.0]}, r"strain is .*it must be an array of shape \(0,\)"),
        ({"mode": "ansi"}, {}, "ansi"),
        ({"size": (0, 64)}, {}, "size"),
        ({"size": (64,)}, {}, "size"),
    ],
)
def test_what_cannot_be_drawn_is_refused(tetrahedron, made, drawn, message):
    with pytest.raises(ValueError, match=message):
        Renderer(tetrahedron, FRONT, **made).draw(**{"positions": CORNERS, **drawn})


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"triangles": [(0, 1, -1)]}, "triangles.*-1"),
        ({"bars": [(0, -2)]}, "bars.*-2"),
        ({"triangles": FACES, "triangle_colors": np.zeros((3, 3))}, "triangle_colors"),
        ({"radii": [0.1], "ball_colors": (0, 0, 300)}, "ball_colors"),
        ({"radii": [-0.1]}, "radii"),
        ({"bars": [(0, 1)], "bar_radius": [0.1, 0.2]}, "bar_radius"),
        ({"opacity": 0.0}, "opacity"),
        ({"strain_scale": 0.0}, "strain_scale"),
        ({"trace": -1}, "trace"),
        ({"trace_length": 1}, "trace_length"),
    ],
)
def test_wrong_look(arguments, message):
    with pytest.raises(ValueError, match=message):
        Look(**arguments)


def test_look_counts_particles():
    assert Look().particles == 0
    assert Look(triangles=[(0, 1, 5)], radii=[0.1] * 3).particles == 6
    assert Look(springs=[(0, 7)], trace=2).particles == 8
    assert Look(radii=[0.1] * 9, trace=2).particles == 9
    assert Look(trace=4).particles == 5


def test_two_tone():
    colors = two_tone(12, blocks=4, colors=(RED, BLUE), odd=GREEN)
    assert colors.dtype == np.uint8
    expected = [RED] * 3 + [BLUE] * 3 + [RED] * 3 + [GREEN] * 3
    np.testing.assert_array_equal(colors, expected)
    assert {tuple(c) for c in two_tone(7).tolist()} == {tuple(c) for c in two_tone(12).tolist()}


@pytest.mark.parametrize("count", [4, 7, 12, 24])
def test_sectors_look_the_same_after_a_whole_turn_alone(count):
    colors = two_tone(count)
    for turned in range(1, count):
        assert (np.roll(colors, turned, axis=0) != colors).any()


def test_what_lies_on_a_large_face_is_seen_whole():
    """A block on the near end of a slab, whose middle is nearer to the eye than that of the block's side."""
    corners = 2 * box().positions
    triangles = box().triangles
    camera = Camera(eye=(0.0, -6.0, 4.0), target=(0.0, 0.0, 0.0), fov=0.6)
    slab = corners * (1, 1, 0.1)
    block = corners * 0.15
    for place in ((0.0, 0.7, 0.25), (0.5, 0.0, 0.25), (0.0, -0.7, 0.25), (0.0, 0.7, -0.25)):
        at = [block + place, slab]
        for order in (1, -1):  # whichever is named first
            look = Look(
                triangles=np.concatenate([triangles, triangles + 8]),
                triangle_colors=np.repeat([RED, BLUE][::order], 12, axis=0),
            )
            picture = draw(look, np.concatenate(at[::order]), camera=camera)
            low, high = np.array([0.0, -0.15, -0.12]), np.array([0.0, -0.15, 0.12])  # of its side
            seen = [strongest(pixel(picture, np.add(place, spot), camera)) for spot in (low, high)]
            assert seen == ([0, 0] if place[2] > 0 else [2, 2]), place


def sights(camera, size, count):
    """Unit vectors from the eye through the middles of some pixels, and these pixels."""
    spots = np.random.default_rng(1).integers(0, size, (count, 2))
    return camera.rays(size)[spots[:, 1], spots[:, 0]], spots


def test_in_a_crowd_each_pixel_shows_what_is_nearest():
    """Sixty-four cubes in a grid, in colours of their own: the one that a way from the eye meets first."""
    cube = 0.8 * box().positions
    triangles = box().triangles
    size = (240, 240)
    places = np.stack(np.meshgrid(*[np.arange(4.0)] * 3), axis=-1).reshape(-1, 3)
    places = np.random.default_rng(1).permutation(places)
    colors = np.stack([63 * (np.arange(64) // n % 4) for n in (1, 4, 16)], axis=-1)
    camera = Camera(eye=(9.0, -7.0, 6.0), target=(1.5, 1.5, 1.5), fov=0.8)
    faces = np.concatenate([triangles + 8 * n for n in range(64)])
    corners = np.concatenate(cube + places[:, None])
    picture, grey = (
        draw(Look(triangles=faces, triangle_colors=table), corners, camera=camera, size=size)
        for table in (np.repeat(colors, 12, axis=0), (126, 126, 126))
    )
    ways, spots = sights(camera, size, 2000)
    low, high = ((places[:, None] + sign * 0.4 - camera.eye) / ways for sign in (-1, 1))
    enters = np.minimum(low, high).max(axis=2)
    leaves = np.maximum(low, high).min(axis=2)
    found = np.where(enters < leaves - 0.05, enters, np.inf)  # not by a corner
    sure = (found < np.inf).any(axis=0) & ((enters < leaves - 0.05) == (enters < leaves + 0.05)).all(axis=0)
    assert sure.sum() > 150
    nearest = colors[found.argmin(axis=0)]
    x, y = spots[sure].T
    share = nearest[sure] / 126
    edges = np.abs(picture[y, x] - share * grey[y, x]).max(axis=1) > 25  # an outline, or a smooth edge
    assert edges.mean() < 0.1


def test_bars_and_balls_are_where_they_are_seen():
    """In perspective: pixels that look through less, or more, than their radius."""
    camera = Camera(eye=(0.3, -2.0, 0.8), target=(0.0, 0.0, 0.0), fov=0.9)
    size = (240, 240)
    start = np.array([(-0.7, -0.6, -0.3), (0.3, 0.3, 0.4)])
    stop = np.array([(0.5, 0.6, 0.1)] * 2)
    radius = 0.2
    stop[1] = start[1]  # a ball
    look = Look(bars=[(0, 1)], bar_radius=radius, bar_colors=RED, radii=[0, 0, radius], ball_colors=RED)
    places = np.stack([start[0], stop[0], start[1]])
    shown = np.abs(draw(look, places, camera=camera, size=size) - empty(camera=camera, size=size)).max(axis=2)
    ways, spots = sights(camera, size, 400)
    along = camera.eye + np.linspace(1.0, 4.0, 300)[:, None, None] * ways
    axis = start + np.linspace(0.0, 1.0, 100)[:, None, None] * (stop - start)
    apart = np.array([np.linalg.norm(along[..., None, :] - at, axis=-1).min(axis=(0, 2)) for at in axis])
    seen = shown[spots[:, 1], spots[:, 0]] > 20
    least = apart.min(axis=0)
    assert 40 < (least < 0.9 * radius).sum() < 200
    assert seen[least < 0.9 * radius].all()
    assert not seen[least > 1.1 * radius].any()
