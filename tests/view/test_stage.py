"""The stage without a browser: colours, contacts and where it is seen from."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

pytest.importorskip("viser")

from springgym import view
from springgym.rendering import Arrow, Marks, look
from springgym.view.stage import FOV, FROM_ACES, LIT, SHEET, TO_ACES, Stage, toned


@cache
def simulated(scene):
    """Return the motion of a scene, which is simulated once for all tests."""
    return view.simulated(scene, {})


@pytest.fixture
def stage():
    server = view._server(0)
    yield Stage(server)
    view._end(server)


def seen(color, light, linear):
    """What three.js makes of the colour of a surface under some light."""
    sent = np.asarray(color, float) / 255
    if not linear:
        sent = np.where(sent <= 0.04045, sent / 12.92, ((sent + 0.055) / 1.055) ** 2.4)
    v = TO_ACES @ (sent * light / 0.6)
    v = (v * (v + 0.0245786) - 0.000090537) / (v * (0.983729 * v + 0.4329510) + 0.238081)
    shown = np.clip(FROM_ACES @ v, 0, 1)
    return 255 * np.where(shown <= 0.0031308, 12.92 * shown, 1.055 * shown ** (1 / 2.4) - 0.055)


@pytest.mark.parametrize("linear", [True, False])
@pytest.mark.parametrize("light", [1.0, LIT])
def test_colors_are_those_of_the_films(light, linear):
    for name in ("BLUE", "ORANGE", "GREEN", "TEAL", "RED", "SLATE", "INK", "STEEL"):
        color = getattr(look, name)
        np.testing.assert_allclose(seen(toned(color, light, linear), light, linear), color, atol=4)
    many = np.array([look.BLUE, look.RED])
    np.testing.assert_array_equal(toned(many, light, linear)[1], toned(look.RED, light, linear))
    white = seen(toned((255, 255, 255), light, linear), light, linear)
    assert white.min() > 220  # as bright as it gets
    assert np.ptp(white) < 3


def test_marks_of_another_moment_are_hidden(stage):
    """A crane that has let go of its last block has no target, and balls that are apart no aim."""
    motion = simulated("block-holds")
    spot = (0.0, 0.0, 0.0)
    beside = (1.0, 0.0, 0.0)
    many = Marks(
        disks=[(spot, 0.1, look.INK)],
        rings=[(spot, 0.1)],
        balls=[(spot, 0.1)],
        lines=[(spot, beside), (spot, beside)],
        edges=[(spot, beside, look.ORANGE)],
        arrows=[Arrow(spot, beside)],
    )
    one = Marks(lines=[(spot, beside)])
    stage.set_up(motion)
    for marks, shown in (
        (many, {"disks0", "rings0", "balls0", "lines0", "lines1", "edges0", "arrows0"}),
        (one, {"lines0"}),
    ):
        stage._draw_marks(motion, marks)
        nodes = {name: node for name, node in stage._nodes.items() if name.startswith("/world/marks/")}
        found = {name.split("/")[3] for name, node in nodes.items() if node.visible}
        assert found == shown
    stage._draw_marks(motion, many)
    assert stage._nodes["/world/marks/lines1"].visible


def test_contacts_are_those_of_the_simulator():
    """A block on a slope: the forces carry its weight, at points where it touches."""
    motion = simulated("block-holds")
    points, vectors, mutual = motion.touches
    there = np.isfinite(points[-1]).all(axis=1)
    assert there.sum() >= 3
    assert not mutual.any()
    weight = motion.arrows["weight"].vectors[-1]
    np.testing.assert_allclose(
        vectors[-1].sum(axis=0), -weight, rtol=0.02, atol=0.02 * np.linalg.norm(weight)
    )
    lowest = np.abs(points[-1, there][:, None] - motion.positions[-1]).max(axis=2).min(axis=1)
    assert lowest.max() < 0.01 * motion.extent
    assert simulated("top").touches is None


@pytest.mark.slow
def test_both_of_two_bodies_feel_a_contact(stage):
    motion = view.simulated("stack", {("duration",): 1.0})
    n = len(motion.times) - 1
    points, vectors, mutual = (of[n] for of in motion.touches)
    there = np.isfinite(points).all(axis=1)
    assert 0 < mutual[there].sum() < there.sum()
    stage.set_up(motion)
    stage.draw(float(motion.times[n]))
    drawn = stage._nodes["/world/contacts/forces"].points
    felt = np.linalg.norm(vectors, axis=1) > 0.02 * motion.extent
    assert len(drawn) == (felt & there).sum() + (felt & there & mutual).sum()
    stage.show(contacts=False)
    stage.draw(0.0)
    assert not stage._nodes["/world/contacts/forces"].visible


def test_a_round_body_shows_its_skin_and_others_their_springs(stage):
    ball = simulated("ball-rolls")
    top = simulated("top")
    assert not ball.glassy
    assert top.glassy
    stage.show(springs=ball.glassy)
    stage.set_up(ball)
    colors = {tuple(mesh.color) for mesh, _ in stage._faces}
    assert len(colors) == 3
    before = [mesh.vertices.copy() for mesh, _ in stage._faces]
    stage.draw(float(ball.times[-1]))
    turned = np.concatenate([mesh.vertices for mesh, _ in stage._faces]) - ball.centre[-1]
    came = np.concatenate(before) - ball.centre[0]
    assert np.abs(turned - came).max() > 0.05  # of a radius of 0.1
    assert all(mesh.opacity is None for mesh, _ in stage._faces)


@pytest.mark.parametrize(
    ("rotation", "aspect", "scene"), [(True, 0.46, "top"), (False, 1.0, "ball-rolls"), (False, 0.46, "top")]
)
def test_all_is_in_the_free_part_of_the_picture(stage, scene, aspect, rotation):
    motion = simulated(scene)
    stage.show(rotation=rotation)
    camera = stage.camera(motion, aspect)
    assert camera.fov == FOV
    x = motion.look.points(motion.positions[::10])
    tips = [
        o[::10, None] + v[::10, None]
        for name, (o, v, _) in motion.arrows.items()
        if rotation and "angular" in name
    ]
    pixels, _ = camera.project(np.concatenate([x, *tips], axis=1).reshape(-1, 3), (1000 * aspect, 1000.0))
    assert pixels.min() > 0
    assert pixels[:, 0].max() < 1000 * max(aspect, 1.3)
    assert pixels[:, 1].max() < (1000 * (1 - SHEET) if aspect < 1 else 1000)


def test_a_torque_runs_around_its_axis(stage):
    motion = simulated("top")
    stage.set_up(motion)
    arrow = look.Arrow((0.0, 0.0, 1.0), (0.0, 0.0, 0.3), radius=0.2)
    stage._draw_mark("/arrow", arrow, motion.extent)
    arc, head = (stage._nodes[name].points for name in ("/arrow/arc", "/arrow"))
    np.testing.assert_allclose(np.hypot(arc[..., 0], arc[..., 1]), 0.2, rtol=1e-5)
    np.testing.assert_allclose(arc[..., 2], 1.0, rtol=1e-6)
    np.testing.assert_array_equal(arc[1:, 0], arc[:-1, 1])
    np.testing.assert_array_equal(head[0, 0], arc[-1, 1])
    turn = np.cross(arc[0, 0], head[0, 1] - head[0, 0])
    assert turn[2] > 0  # by the right hand
    stage._draw_mark("/arrow", replace(arrow, vector=(0.0, 0.0, 0.0)), motion.extent)
    assert not stage._nodes["/arrow/arc"].visible
