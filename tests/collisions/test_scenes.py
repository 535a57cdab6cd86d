"""What a scene says of collisions, and what it refuses."""

from __future__ import annotations

import pickle
import sys
from collections.abc import Callable
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from springgym.model.bodies import (
    Body,
    box,
    capsule,
    cube,
    disk,
    ellipsoid,
    gyroscope,
    rolling_ball,
    rope,
    sphere,
    top,
    union,
)
from springgym.model.collisions import Pair, distance, overlap, shape
from springgym.model.scene import Placed, Scene
from springgym.model.surfaces import Contact, PaperContact, Plane, derived_strength
from springgym.model.surfaces.contact import strength_of_impact
from springgym.scenes import load
from springgym.scenes.plan import OF_ONE_BODY
from springgym.scenes.plots import PLOTS, draw
from springgym.scenes.recording import record
from springgym.scenes.strict_yaml import YamlError
from springgym.simulator import Simulator

CUBE = cube()
BALL = Body("ball", [[0.0, 0.0, 0.0]], 1.0, [], 1.0, 0.0, radius=0.2)


def put(body: Body, place: Any, name: str, **more: Any) -> Placed:
    return Placed(body, body.positions + np.asarray(place, float), name=name, **more)


def beside(second: Body, place: Any = (3.0, 0.0, 0.0), **more: Any) -> Scene:
    """A cube at the origin, and a body."""
    return Scene(bodies=(put(CUBE, (0, 0, 0), "a"), put(second, place, "b")), **{"collisions": "all"} | more)


def test_defaults() -> None:
    """Δ is of the smaller body, k of the softer one; the scene's contact counts where a pair has none."""
    small = cube(0.5, stiffness=3e4)
    (met,) = beside(small, contact=Contact(friction=0.3)).meetings
    assert (met.first, met.second) == (0, 1)
    assert met.contact.friction == 0.3
    assert met.reach == 0.01 * small.swept
    assert met.strength == derived_strength(3e4, 0.5, met.reach)  # masses of 1 kg each
    assert not beside(small, collisions=None).meetings
    (met,) = beside(small, collisions=Contact(friction=0.7, reach=2e-3)).meetings
    assert (met.contact.friction, met.reach) == (0.7, 2e-3)
    (met,) = beside(small, collisions=[Pair("b", 0, Contact(strength=2.0))]).meetings
    assert (met.first, met.second, met.strength) == (0, 1, 2.0)


def test_springs_that_contacts_do_not_strain_do_not_count() -> None:
    """The springs of a sphere that turns, or of a pinned body, do not change the strength of a contact."""
    soft = cube(0.5, stiffness=1e3)
    pinned = put(soft, (0, 0, 0), "a", pinned=tuple(range(8)))
    for body in (rolling_ball(0.2, stiffness=10.0), BALL):
        (met,) = Scene(bodies=(pinned, put(body, (3, 0, 0), "b"))).meetings
        assert met.strength == pytest.approx(strength_of_impact(body.mass, met.reach), rel=1e-12)
    (met,) = Scene(bodies=(pinned, put(CUBE, (3, 0, 0), "b"))).meetings
    assert met.strength == derived_strength(1e5, 1.0, met.reach)
    (met,) = beside(rolling_ball(0.2, stiffness=10.0)).meetings
    assert met.strength == derived_strength(1e5, 0.5, met.reach)


def test_all_collide_unless_said_otherwise() -> None:
    """By the scene's contact; the refusal of a start or a body says how to let them pass."""
    apart = (put(CUBE, (0, 0, 0), "a"), put(CUBE, (3, 0, 0), "b"))
    (met,) = Scene(bodies=apart, contact=Contact(friction=0.3)).meetings
    assert met.contact.friction == 0.3
    for second, place in ((CUBE, (0.9, 0, 0)), (SHEET, (3, 0, 0))):
        bodies = (apart[0], put(second, place, "b"))
        with pytest.raises(ValueError, match=r"'b' .*collisions=None"):
            Scene(bodies=bodies)
        assert not Scene(bodies=bodies, collisions=None).meetings


def test_which_pairs() -> None:
    """All pairs of which a body can move; bodies that are held throughout do not meet each other."""
    held = tuple(range(8))
    bodies = (
        put(CUBE, (0, 0, 0), "a", pinned=held),
        put(CUBE, (0.5, 0, 0), "b", pinned=held),
        put(CUBE, (3, 0, 0), "c"),
    )
    scene = Scene(bodies=bodies, collisions="all")
    assert [met[:2] for met in scene.meetings] == [(0, 2), (1, 2)]
    assert pickle.loads(pickle.dumps(scene)).meetings[0].reach == scene.meetings[0].reach
    assert all(not part.meetings for part in scene.parts)
    assert "collisions 0–2, 1–2" in repr(scene)
    assert not scene.with_(collisions=None).meetings
    assert not Scene(CUBE, collisions="all").meetings


SHEET = Body("sheet", np.eye(3), 1.0, [(0, 1), (1, 2), (2, 0)], 1e4, 0.0, triangles=[(0, 1, 2)])
INSIDE_OUT = CUBE.with_(triangles=CUBE.triangles[:, ::-1])
SMALL = cube(side=0.5)
UNFIT = (rolling_ball().with_(rounds=(sphere(0.1), sphere(0.05))), ellipsoid((0.15, 0.1, 0.08)), disk())
CAPSULE = capsule(0.1, 0.3)
ENDS = CAPSULE.positions[:2]
UNEQUAL = (
    (sphere(0.1, ENDS[0]), sphere(0.09, ENDS[1])),
    (sphere(0.1, ENDS[0]), sphere(0.1, 0.9 * ENDS[1])),
    (sphere(0.1, ENDS[0]), sphere(0.1, ENDS[0])),
    (sphere(0.1, ENDS[0], (0, 1, 2, 4)), sphere(0.1, ENDS[1])),
)
STICK = Body("rod", np.array([(0, 0, 0), (1, 0, 0)]), 1.0, [(0, 1)], 1e5, 0.0, radius=0.1)
HALF_INSIDE_OUT = union(
    [CUBE, SMALL.with_(name="small", positions=SMALL.positions + 0.75, triangles=SMALL.triangles[:, ::-1])]
)


@pytest.mark.parametrize(
    ("make", "error", "text"),
    [
        (lambda: beside(SHEET), ValueError, "body 'b' cannot collide: its triangles do not enclose"),
        (lambda: beside(gyroscope()), ValueError, "body 'b' cannot collide: its triangles do not"),
        (lambda: beside(INSIDE_OUT), ValueError, "body 'b' cannot collide: .* normals point inwards"),
        (lambda: beside(HALF_INSIDE_OUT), ValueError, "body 'b' cannot collide: .* normals point inwards"),
        (
            lambda: beside(rope()),
            ValueError,
            "body 'b' cannot collide: it has neither triangles nor a radius",
        ),
        (lambda: beside(box((1, 1, 0.03))), ValueError, "body 'b' cannot collide: it is 0.03 m thick"),
        (lambda: beside(box((1, 1, 0.01))), ValueError, "edge from particle 0 to 4 is 0.01 m long"),
        (lambda: beside(CUBE, collisions="some"), ValueError, "collisions is 'some'; it must be 'all'"),
        (lambda: beside(CUBE, collisions=3), TypeError, "collisions is 3; it must be"),
        (lambda: beside(CUBE, collisions=(1,)), TypeError, r"collisions\[0\] is 1; it must be Pair"),
        (lambda: beside(CUBE, collisions=(Pair("a", "c"),)), ValueError, r"collisions\[0\] names 'c'"),
        (lambda: beside(CUBE, collisions=(Pair("a", 5),)), ValueError, r"collisions\[0\] is 5"),
        (lambda: beside(CUBE, collisions=(Pair("a", 0),)), ValueError, "pairs 'a' with itself"),
        (
            lambda: beside(CUBE, collisions=(Pair("a", "b"), Pair(1, 0))),
            ValueError,
            r"collisions\[1\] pairs 'a' with 'b', which are already paired",
        ),
        (lambda: Pair("a", 1.5), TypeError, "second of a pair is 1.5"),  # type: ignore[arg-type]
        (lambda: Pair("a", "b", "hard"), TypeError, "contact of a pair is 'hard'"),  # type: ignore[arg-type]
        (
            lambda: beside(CUBE, contact=PaperContact()),
            ValueError,
            "cannot collide by the scene's PaperContact",
        ),
        (
            lambda: Scene(bodies=(put(BALL, (0, 0, 0), "a"), put(BALL, (1, 0, 0), "b")), collisions="all"),
            ValueError,
            "bodies 'a' and 'b' have no size or no springs",
        ),
        (lambda: CUBE.with_(radius=0.1), ValueError, "radius is 0.1 m, and there are 12 triangles"),
        *((lambda of=of: beside(of), ValueError, "only surfaces meet ellipsoids and disks") for of in UNFIT),
        *(
            (
                lambda ends=ends: beside(CAPSULE.with_(rounds=ends)),
                ValueError,
                "or two of one radius about two",
            )
            for ends in UNEQUAL
        ),
        *(
            (
                lambda of=of: Scene(bodies=(put(of, (0, 0, 0), "a", pinned=(0,)), put(CUBE, (2, 0, 0), "b"))),
                ValueError,
                "pin all or none",
            )
            for of in (rolling_ball(), CAPSULE)
        ),
        (lambda: Simulator(beside(STICK), dynamics="rigid"), ValueError, "one line"),
        (lambda: replace(BALL, radius=-1.0), ValueError, "radius is -1.0"),
    ],
)
def test_refusals(make: Callable[[], Any], error: type[Exception], text: str) -> None:
    with pytest.raises(error, match=text):
        make()


@pytest.mark.parametrize(
    ("second", "place", "text"),
    [
        (CUBE, (0.9, 0.1, 0.2), r"bodies 'a' and 'b' start 0.1 m deep in each other, by particle 2 of 'a'"),
        (box((3, 0.2, 0.2)), (0, 0, 0), "start 1 m deep in each other, by the edge"),
        (CUBE, (1 + 1e-6, 0, 0), "only 1e-06 m apart"),
        (BALL, (0.6, 0, 0), "start 0.1 m deep in each other, by particle 0 of 'b'"),
        (rolling_ball(0.1), (0.55, 0, 0), "deep in each other"),
        (BALL, (0, 0, 0), "start 0.7 m deep"),
        (rope(3, 2.0).with_(radius=0.05), (0.52, 0, 1.0), "start 0.03 m deep"),
        (rope(2, 4.0).with_(radius=0.05), (0, 0, 2.0), "start 0.05 m deep"),
        (rope(2, 4.0).with_(radius=0.05), (0.51, 0.51, 2.0), "start 0.0358579 m deep"),
    ],
)
def test_overlapping_starts(second: Body, place: Any, text: str) -> None:
    with pytest.raises(ValueError, match=text):
        beside(second, place)
    assert not beside(second, place, collisions=None).meetings


def test_starts_of_copies() -> None:
    """The copy is named; starts that touch are allowed, up to 1e-3 Δ."""
    scene = beside(CUBE)
    x = np.repeat(scene.positions[None], 6, axis=0)
    x[:, 8:] += (-1.5, 0.1, 0.2)
    scene.check_start(x, 0 * x, np.arange(6))
    x[4, 8:, 0] -= 0.75
    with pytest.raises(ValueError, match=r"start 0\.1 m deep in each other in copy 14"):
        scene.check_start(x, 0 * x, np.arange(10, 16))
    x[4, 8:, 0] += 0.25 + 2e-3 * scene.meetings[0].reach
    scene.check_start(x, 0 * x, np.arange(6))


@pytest.mark.parametrize(
    ("options", "text"),
    [
        ({"integrator": "rk4"}, "rk4 has no node"),
        ({"integrator": "pefrl"}, "pefrl has no node"),
        ({"dynamics": "rigid", "integrator": "suzuki"}, "suzuki has no node"),
    ],
)
def test_methods_that_cannot(options: dict[str, Any], text: str) -> None:
    scene = Scene(
        bodies=(put(cube(damping=0.0), (0, 0, 0), "a"), put(cube(damping=0.0), (2, 0, 0), "b")),
        collisions="all",
    )
    with pytest.raises(ValueError, match=text):
        Simulator(scene, **options)


def test_surface_of_bodies() -> None:
    """Sharp edges, closedness and thickness of shapes with known ones."""
    assert (len(CUBE.edges), CUBE.closed, CUBE.thickness) == (12, True, pytest.approx(1.0))
    cone = top()
    assert (len(cone.edges), cone.closed) == (24, True)  # crown's edges are flat
    assert not gyroscope().closed
    assert rope().with_(radius=0.1).thickness == 0.2
    assert BALL.size == 0.4
    notched = np.array([(0, 0), (2, 0), (2, 2), (1, 1), (0, 2)], float)  # a prism with a reentrant edge
    corners = np.concatenate([np.pad(notched, ((0, 0), (0, 1)), constant_values=z) for z in (0.0, 1.0)])
    faces = [(0, 3, 1), (1, 3, 2), (0, 4, 3), (5, 6, 8), (6, 7, 8), (5, 8, 9)]
    faces += [t for i in range(5) for j in [(i + 1) % 5] for t in ((i, j, j + 5), (i, j + 5, i + 5))]
    pairs = [(i, j) for i in range(10) for j in range(i)]
    prism = Body("prism", corners, 1.0, pairs, 1e4, 0.0, triangles=faces)
    assert prism.closed
    assert len(prism.edges) == 14  # of 15 the notch's is none
    assert (3, 8) not in map(tuple, prism.edges.tolist())
    inside = distance.point_surface(
        np.array([[(0.5, 0.5, 0.5), (1, 1.2, 0.5)]]), corners[prism.triangles][None]
    )
    assert inside[0] == pytest.approx([-0.5, 0.2 / np.sqrt(2)])


FILE = """
title: two cubes
bodies:
  left: {body: {kind: cube}}
  right: {body: {kind: cube}, start: {position: [1.5, 0, 0]}}
gravity: 0
duration: 0.1
contact: {friction: 0.3}
"""


@pytest.mark.parametrize(
    ("line", "friction"),
    [
        ("", 0.3),
        ("collisions: none", None),
        ("collisions: all", 0.3),
        ("collisions: {friction: 0.5, restitution: 0.8}", 0.5),
        ("collisions: [{first: right, second: left}]", 0.3),
        ("collisions: [{first: right, second: left, contact: {friction: 0.7}}]", 0.7),
    ],
)
def test_scene_files(line: str, friction: float | None, tmp_path: Path) -> None:
    """A file says which bodies meet, and how."""
    file = tmp_path / "two.yaml"
    unused = "contact: {friction: 0.3}\n" if friction != 0.3 else ""  # by which nothing would touch
    file.write_text(FILE.replace(unused, "") + line)
    scene = load(str(file)).scene
    assert [met.contact.friction for met in scene.meetings] == ([] if friction is None else [friction])


def test_a_pickle_holds_no_workspace() -> None:
    """The workspace follows from the scene alone, and is much larger than the state."""
    made = Simulator(Scene(bodies=[put(CUBE, (3.0 * n, 0, 0), f"c{n}") for n in range(30)]))
    kept = sum(array.nbytes for array in made.state().values() if isinstance(array, np.ndarray))
    assert len(pickle.dumps(made)) < 2 * kept


@pytest.mark.parametrize("plot", sorted(set(PLOTS) - set(OF_ONE_BODY)))
def test_other_plots_show_several_bodies(plot: str, tmp_path: Path) -> None:
    file = tmp_path / "two.yaml"
    file.write_text(FILE + f"plot: {plot}")
    draw(record(load(str(file)))).draw_without_rendering()


@pytest.mark.parametrize(
    ("line", "text"),
    [
        ("collisions: some", "two.yaml:9: .*expected all, none, a contact or a list of pairs, got 'some'"),
        ("collisions: [{first: left}]", r"two.yaml:9: .*lacks second"),
        ("collisions: [{first: left, second: up}]", r"collisions\[0\] names 'up'"),
        ("collisions: {rubbing: 1}", "unknown key 'rubbing'"),
        *(
            (f"plot: {plot}", f"two.yaml:9: plot: plot is '{plot}', which shows a scene of one body")
            for plot in OF_ONE_BODY
        ),
    ],
)
def test_scene_files_that_are_wrong(line: str, text: str, tmp_path: Path) -> None:
    file = tmp_path / "two.yaml"
    file.write_text(FILE + line)
    with pytest.raises(YamlError, match=text):
        load(str(file))


def row_of_cubes(count: int) -> tuple[Placed, ...]:
    """Cubes a centimetre apart, each a body of its own, equal to the others."""
    return tuple(put(cube(), (1.01 * n, 0, 0), f"{n}") for n in range(count))


def calls(function: Callable[[], Any]) -> int:
    """How many functions, Python's and others, are called."""
    count = 0

    def told(_frame: Any, event: str, _arg: Any) -> None:
        nonlocal count
        count += event in ("call", "c_call")

    sys.setprofile(told)
    try:
        function()
    finally:
        sys.setprofile(None)
    return count


def test_scenes_grow_with_their_bodies() -> None:
    """Twice the bodies, of four times the pairs, take twice the work to be checked, and to start again."""
    few = row_of_cubes(40)
    many = row_of_cubes(80)
    assert calls(lambda: Scene(bodies=many)) < 2.3 * calls(lambda: Scene(bodies=few))
    one = Scene(bodies=few)
    other = Scene(bodies=many)
    assert len(other.meetings) == 80 * 79 // 2
    again = [partial(scene.check_start, scene.positions, scene.velocities) for scene in (one, other)]
    assert calls(again[1]) < 2.3 * calls(again[0])
    assert calls(lambda: other.identity) < 2.3 * calls(lambda: one.identity)
    assert other.shapes[0] is other.shapes[79]
    assert other.kinds == (0,) * 80
    assert "3160 pairs" in repr(other)


@pytest.mark.parametrize("most", [1, 1000, 1_000_000])
def test_boxes_that_overlap(most: int, monkeypatch: pytest.MonkeyPatch) -> None:
    """In pieces, the same are found as at once, ties and all, in the order of the pairs."""
    random = np.random.default_rng(3)
    met = Scene(bodies=row_of_cubes(30)).meetings
    low = np.round(random.uniform(0, 3, (5, 30, 3)), 1)
    high = low + np.round(random.uniform(0, 1, low.shape), 1)
    meet = (low[:, :, None] <= high[:, None]) & (low[:, None] <= high[:, :, None])
    wanted = np.argwhere(meet.all(axis=-1)[:, met.first, met.second].T)
    monkeypatch.setattr(overlap, "BOXES", most)
    found = np.transpose(overlap.overlapping(met, low, high))
    assert len(wanted) > 50
    assert found.tolist() == wanted.tolist()


ROD = rope(2, 1.0).with_(radius=0.05)


@pytest.mark.parametrize("bodies", [(CUBE, CUBE), (top(), CUBE), (CUBE, BALL), (ROD, top()), (CUBE, ROD)])
def test_planes_separate_bodies_by_no_more_than_their_distance(bodies: tuple[Body, Body]) -> None:
    random = np.random.default_rng(0)
    shapes = tuple(map(shape, bodies))
    turns = np.linalg.qr(random.normal(size=(2, 300, 3, 3)))[0]
    first, second = (body.positions @ turn for body, turn in zip(bodies, turns, strict=True))
    second = second + random.uniform(-1.5, 1.5, (300, 1, 3))
    gaps = overlap.separation(shapes, first, second)
    apart = np.min([found.apart.min(axis=1) for found in overlap._distances(shapes, first, second)], axis=0)
    assert (gaps[apart < 0] < 0).all()
    assert (gaps[apart > 0] < apart[apart > 0] + 1e-12).all()
    assert (gaps[apart > 0.1] > 0).mean() > 0.7
    assert 5 < (apart < 0).sum() < 250


def test_overlapping_starts_of_many() -> None:
    """The first pair that is wrong is named, of which every other kind of body is looked at, too."""
    bodies = [put(CUBE, (1.01 * n, 0, 0), f"c{n}") for n in range(20)]
    bodies += [put(BALL, (1.01 * n, 0, 0.8), f"b{n}") for n in range(20)]
    scene = Scene(bodies=tuple(bodies), collisions=Contact(strength=1.0, reach=0.01))
    x = np.repeat(scene.positions[None], 2, axis=0)
    x[1, 8 * 20 + 3, 2] -= 0.15  # a ball, into the cube below
    with pytest.raises(ValueError, match=r"'c3' and 'b3' start 0\.05 m deep in each other in copy 6"):
        scene.check_start(x, 0 * x, np.array([5, 6]))
    x[:, 8 * 10 : 8 * 11, 0] += 0.02  # a cube, into the next
    with pytest.raises(ValueError, match=r"'c3' and 'b3'"):
        scene.check_start(x, 0 * x, np.array([5, 6]))
    x[1] = scene.positions
    with pytest.raises(ValueError, match=r"'c10' and 'c11' start 0.01 m deep in each other in copy 5"):
        scene.check_start(x, 0 * x, np.array([5, 6]))


def test_starts_of_several_are_refused_by_body() -> None:
    """The particle and the spring that are wrong are named by the body's own numbers."""
    ground = Plane((0, 0, -1), (0, 0, 1))
    scene = Scene(bodies=tuple(put(CUBE, (2 * n, 0, 0), f"c{n}") for n in range(4)), surfaces=(ground,))
    x = scene.positions.copy()
    x[8 * 2 + 3] = x[8 * 2 + 1]
    with pytest.raises(ValueError, match=r"body 'c2': spring \d+ starts with both ends"):
        scene.check_start(x, 0 * x)
    x = np.repeat(scene.positions[None], 2, axis=0)
    x[1, 8 * 3 + 5, 2] = -1.5
    with pytest.raises(ValueError, match=r"particle 5 of 'c3' of copy 9 starts 0.5 m behind surface 0"):
        scene.check_start(x, 0 * x, np.array([8, 9]))
