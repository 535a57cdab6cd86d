import sys
from functools import partial

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial import ConvexHull

from springgym.model.bodies import ball, box, from_mesh, from_points, rolling_ball, rope, solid_mesh, union
from springgym.model.bodies.irregular import braces, convex_hull

trimesh = pytest.importorskip("trimesh")

TETRAHEDRON = [(0.26, 0, -0.09), (-0.14, 0.24, -0.08), (-0.12, -0.23, -0.10), (0.03, 0.02, 0.27)]


def volume(points, triangles):
    return np.linalg.det(points[triangles] - points.mean(axis=0)).sum() / 6


@settings(deadline=None)
@given(seed=st.integers(0, 10_000), count=st.integers(4, 40))
def test_hull_against_qhull(seed, count):
    points = np.random.default_rng(seed).normal(size=(count, 3)) * (1, 10, 0.1)
    triangles = convex_hull(points)
    reference = ConvexHull(points)
    assert set(triangles.ravel().tolist()) == set(reference.vertices.tolist())
    # positive for each triangle: all face outwards
    assert (np.linalg.det(points[triangles] - points.mean(axis=0)) > 0).all()
    assert volume(points, triangles) == pytest.approx(reference.volume, rel=1e-9)
    assert len(triangles) == 2 * len(reference.vertices) - 4  # Euler


def test_hull_of_a_grid_has_eight_corners():
    line = np.linspace(0, 1, 4)
    grid = np.stack(np.meshgrid(line, line, line), axis=-1).reshape(-1, 3)
    triangles = convex_hull(grid)
    assert len(triangles) == 12
    assert volume(grid, triangles) == pytest.approx(1.0)


def test_tetrahedron_with_its_centre():
    body = from_points(TETRAHEDRON, (1.2, 1.0, 1.1, 1.3), 2.4, stiffness=1e5, damping=30.0)
    assert len(body.springs) == 10
    assert body.masses.tolist() == [1.2, 1.0, 1.1, 1.3, 2.4]
    assert body.positions[:4].tolist() == [list(map(float, p)) for p in TETRAHEDRON]
    assert body.positions[body.particle("centre")] == pytest.approx(np.mean(TETRAHEDRON, axis=0))


@settings(deadline=None, max_examples=40)
@given(seed=st.integers(0, 1000), count=st.integers(4, 30))
def test_hull_with_centre_is_rigid_and_keeps_its_mass(seed, count):
    body = from_points(np.random.default_rng(seed).normal(size=(count, 3)), mass=3.0, centre_mass=1.0)
    assert body.floppy_modes() == 0
    assert body.mass == pytest.approx(4.0)


def test_points_inside_are_left_out():
    points = [*TETRAHEDRON, (0.0, 0.0, 0.0)]
    assert len(from_points(points).masses) == 5
    with pytest.raises(ValueError, match=r"point 4 at .* lies inside the hull"):
        from_points(points, mass=(1.0,) * 5)


@pytest.mark.parametrize(
    ("points", "mass", "message"),
    [
        ([(0, 0, 0), (1, 0, 0), (0, 1, 0), (1, 1, 0)], 1.0, "the 4 points have no volume"),
        ([(0, 0, 0), (1, 1, 1), (2, 2, 2), (4, 4, 4)], 1.0, "the 4 points have no volume"),
        (TETRAHEDRON, (1.0, 2.0), "mass is"),
        (TETRAHEDRON, (1.0, 2.0, -1.0, 1.0), r"mass\[2\] is -1.0"),
    ],
)
def test_points_error_names_the_offender(points, mass, message):
    with pytest.raises(ValueError, match=message):
        from_points(points, mass)


def test_braces_make_a_floppy_net_rigid():
    ring = np.array([(np.cos(a), np.sin(a), z) for z in (0, 1) for a in np.arange(5) * 2 * np.pi / 5])
    sides = [(n, (n + 1) % 5) for n in range(5)]
    net = np.array([*sides, *[(i + 5, j + 5) for i, j in sides], *[(n, n + 5) for n in range(5)]])
    added = braces(ring, net)
    assert len(added) == 3 * 10 - 6 - 15  # a prism has 15 independent edges
    assert len(braces(ring, np.vstack([net, added]))) == 0
    assert len(braces(ring, np.vstack([net, added[1:]]))) == 1


# --- Meshes -----------------------------------------------------------------------------------------


@pytest.fixture
def mesh(tmp_path):
    def write(shape, suffix="stl"):
        path = tmp_path / f"shape.{suffix}"
        shape.export(path)
        return path

    return write


@pytest.mark.parametrize("suffix", ["stl", "obj"])
def test_ball_by_volume_and_by_area(mesh, suffix):
    path = mesh(trimesh.creation.icosphere(subdivisions=1, radius=2.0), suffix)
    solid = from_mesh(path, 6.0)
    shell = from_mesh(path, 6.0, by="area")
    for body in (solid, shell):
        assert body.mass == pytest.approx(6.0)
        assert body.centre == pytest.approx([0, 0, 0], abs=1e-6)  # STL has single precision
        assert body.floppy_modes() == 0
    # a quarter of the solid's mass sits at the centre, the rest at r = 2: 2/3 of 4.5 · 2²
    assert solid.principal()[0] == pytest.approx([12, 12, 12], rel=1e-6)
    assert shell.principal()[0] == pytest.approx([16, 16, 16], rel=1e-6)


def test_centre_of_mass_by_volume_is_the_solids(mesh):
    wedge = trimesh.convex.convex_hull([(0, 0, 0), (3, 0, 0), (0, 1, 0), (0, 0, 1), (3, 1, 0), (0, 1, 2)])
    body = from_mesh(mesh(wedge, "obj"), 2.0, scale=0.1)
    assert body.centre == pytest.approx(0.1 * wedge.center_mass, abs=1e-7)  # OBJ has 8 digits
    assert np.ptp(body.positions, axis=0) == pytest.approx(0.1 * wedge.extents, abs=1e-7)


def test_hollow_mesh_needs_area(mesh):
    path = mesh(trimesh.creation.torus(1.0, 0.3, 10, 6))
    with pytest.raises(ValueError, match="so far from convex that vertex"):
        from_mesh(path)
    body = from_mesh(path, 5.0, by="area")
    assert body.floppy_modes() == 0
    # a thin shell of a torus: I₃ = M (R² + 3 r²/2); a coarse mesh lies within 10 %
    assert body.principal()[0][2] == pytest.approx(5.0 * (1 + 1.5 * 0.09), rel=0.1)


def test_mesh_errors_name_the_file(tmp_path, mesh, monkeypatch):
    with pytest.raises(FileNotFoundError, match=r"mesh file .*nothing.stl: No such file"):
        from_mesh(tmp_path / "nothing.stl")
    (tmp_path / "bad.obj").write_text("no mesh")
    with pytest.raises(ValueError, match=r"bad\.obj"):
        from_mesh(tmp_path / "bad.obj")
    with pytest.raises(ValueError, match="has 642 vertices"):
        from_mesh(mesh(trimesh.creation.icosphere(subdivisions=3)))
    open_box = trimesh.creation.box()
    open_box.update_faces(np.arange(12) > 1)
    with pytest.raises(ValueError, match="not a closed surface"):
        from_mesh(mesh(open_box))
    with pytest.raises(ValueError, match="by is 'colour'"):
        from_mesh(mesh(trimesh.creation.box()), by="colour")
    monkeypatch.setitem(sys.modules, "trimesh", None)
    with pytest.raises(ImportError, match=r"needs trimesh: pip install .*mesh"):
        from_mesh(tmp_path / "nothing.stl")


@pytest.mark.parametrize(
    ("name", "text"),
    [("a.stl", ""), ("a.stl", "solid a\nendsolid a\n"), ("a.obj", "a letter\n"), ("a.obj", "v 0 0 0\n")],
    ids=["empty", "solid of nothing", "text", "corners alone"],
)
def test_files_without_triangles_are_told_as_such(tmp_path, name, text):
    (tmp_path / name).write_text(text)
    with pytest.raises(ValueError, match=r"a\.(stl|obj) holds no triangles"):
        from_mesh(tmp_path / name)


SOUP = trimesh.creation.box(extents=(1.0, 2.0, 3.0)).triangles.reshape(-1, 3)
"""Corners of the twelve triangles of a box, each on its own: (36, 3)."""


def soup(*more, noise=0.0, unit=1.0):
    """Return the text of an OBJ file of a box, each triangle with corners of its own, and ``more`` faces."""
    corners = unit * (SOUP + noise * np.random.default_rng(0).uniform(-1, 1, SOUP.shape))
    lines = [f"v {x!r} {y!r} {z!r}" for x, y, z in corners.tolist()]
    faces = [*np.arange(36).reshape(-1, 3).tolist(), *more]
    return "\n".join([*lines, *("f " + " ".join(str(corner + 1) for corner in face) for face in faces)])


@pytest.mark.parametrize(
    ("text", "unit"),
    [
        (soup((0, 0, 1)), 1.0),
        (soup((0, 0, 0)), 1.0),
        (soup((0, 1, 2)), 1.0),
        (soup((1, 2, 0), (0, 2, 1)), 1.0),
        *((soup((3, 3, 4), noise=1e-7, unit=unit), unit) for unit in (1e-9, 1e-3, 1.0, 1e6)),
    ],
    ids=["corner twice", "one corner", "face twice", "face thrice", "nm", "mm", "m", "km"],
)
def test_faces_without_area_and_faces_again_are_left_out(tmp_path, text, unit):
    """As programs export them; corners in one place are one, whatever the unit."""
    path = tmp_path / "box.obj"
    path.write_text(soup())
    clean = from_mesh(path)
    path.write_text(text)
    body = from_mesh(path, scale=1 / unit)
    np.testing.assert_array_equal(body.springs, clean.springs)
    np.testing.assert_array_equal(body.triangles, clean.triangles)
    np.testing.assert_allclose(body.positions, clean.positions, atol=1e-6)
    np.testing.assert_allclose(body.masses, clean.masses, rtol=1e-6)


def test_where_a_surface_is_open_is_told(tmp_path):
    """At the first edge; a wall inside, with three triangles at an edge, is as wrong as a hole."""
    path = tmp_path / "box.obj"
    path.write_text("\n".join(soup().split("\n")[:-1]))
    with pytest.raises(
        ValueError, match=r"at the edge from \[.*\] to \[.*\] there is 1 triangle; there must"
    ):
        from_mesh(path)
    corners = {tuple(corner): n for n, corner in enumerate(SOUP.tolist())}
    across = [corners[0.5 * i, 1.0 * j, 1.5 * k] for i, j, k in ((1, 1, 1), (1, 1, -1), (-1, -1, 1))]
    path.write_text(soup(across))
    with pytest.raises(ValueError, match=r"not a closed surface: at the edge from .* there (is 1|are 3) tri"):
        from_mesh(path)


SIDES = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]
"""Sides of a box whose corner 4 i + 2 j + k lies at (i, j, k), anticlockwise as seen from outside."""


def test_inertia_depends_on_the_diagonals_of_a_file(mesh):
    """As `from_mesh` says: the same box, divided along the one diagonal or the other of each side."""
    corners = np.array(list(np.ndindex(2, 2, 2))) * [1.0, 2.0, 3.0]
    moments = []
    for first in (0, 1):
        turned = [np.roll(side, first) for side in SIDES]
        faces = [side[list(own)] for side in turned for own in ((0, 1, 2), (0, 2, 3))]
        moments.append(from_mesh(mesh(trimesh.Trimesh(corners, faces, process=False), "obj")).principal()[0])
    assert np.abs(moments[1] / moments[0] - 1).max() > 1e-3


def shifted(shape, *shift):
    shape = shape.copy()
    shape.apply_translation(shift)
    return shape


def inside_out(shape):
    shape = shape.copy()
    shape.invert()
    return shape


def one_flipped(shape):
    shape = shape.copy()
    shape.faces[3] = shape.faces[3][::-1]
    return shape


BOX = trimesh.creation.box()
SMALL = trimesh.creation.box(extents=(0.5, 0.5, 0.5))
SHEET = trimesh.Trimesh(
    [(0, 0, 0), (1, 0, 0), (0, 1, 0), (1, 1, 0)], [(0, 1, 3), (0, 3, 2), (0, 2, 1), (1, 2, 3)], process=False
)
NO_SOLIDS = {
    "one triangle flipped": (one_flipped(BOX), r"at the edge from \[.*fix_winding"),
    "apart": (BOX + shifted(BOX, 3, 0, 0), "is 2 solids"),
    "one of three inside out": (
        BOX + shifted(inside_out(BOX), 3, 0, 0) + shifted(BOX, 6, 0, 0),
        "does not enclose a solid",
    ),
    "at a corner": (BOX + shifted(BOX, 1, 1, 1), "is 2 solids"),
    "overlapping": (BOX + shifted(BOX, 0.5, 0.3, 0.2), "cut or cover"),
    "twice": (BOX + SMALL, "cut or cover"),
    "nothing": (SHEET, "does not enclose a solid"),
}


@pytest.mark.parametrize("what", NO_SOLIDS)
@pytest.mark.parametrize(
    "make", [from_mesh, partial(from_mesh, by="area"), partial(solid_mesh, material="steel")]
)
def test_a_closed_mesh_that_is_no_solid_is_refused(mesh, what, make):
    """Each edge is in two triangles, and yet no volume, mass or centre follows from them."""
    shape, message = NO_SOLIDS[what]
    assert shape.is_watertight
    with pytest.raises(ValueError, match=message):
        make(mesh(shape))


def test_a_mesh_inside_out_is_turned_and_may_have_a_cavity(mesh):
    assert from_mesh(mesh(inside_out(BOX))).closed
    body = solid_mesh(mesh(BOX + inside_out(SMALL)), "steel")
    assert body.mass == pytest.approx(7800 * (1 - 0.5**3))
    assert body.closed


# --- Unions -----------------------------------------------------------------------------------------


def moved(body, name, shift):
    return body.with_(name=name, positions=body.positions + shift)


def test_union_of_two_boxes_that_share_a_face():
    left = box((1.0, 1.0, 1.0), mass=2.0)
    right = moved(box((1.0, 1.0, 1.0), mass=4.0), "right", (1.0, 0.0, 0.0))
    both = union([left, right], "beam")
    assert len(both.masses) == 12
    assert both.mass == pytest.approx(6.0)
    assert both.centre == pytest.approx([4.0 / 6.0, 0, 0])
    about = (0.0, 0.0, 0.0)
    assert both.inertia(about) == pytest.approx(left.inertia(about) + right.inertia(about))
    assert len(both.springs) == 28 + 28 - 6  # six pairs within the shared face
    assert np.sum(both.stiffness == 2e5) == 6
    assert len(both.triangles) == 12 + 12 - 4
    assert set(both.parts["box"]) & set(both.parts["right"]) == set(
        np.flatnonzero(both.positions[:, 0] == 0.5).tolist()
    )


@pytest.mark.parametrize(("shift", "added"), [((1, 1, 0), 1), ((1, 1, 1), 3)], ids=["edge", "corner"])
def test_union_is_braced_where_it_could_fold(shift, added):
    both = union([box(), moved(box(), "other", shift)])
    shared = {(1, 1, 0): 1, (1, 1, 1): 0}[shift]
    assert len(both.springs) == 56 - shared + added
    assert both.floppy_modes() == 0


def test_union_errors_name_the_offender():
    with pytest.raises(ValueError, match="body 'far' does not touch"):
        union([box(), moved(box(), "other", (1, 0, 0)), moved(box(), "far", (5, 0, 0))])
    with pytest.raises(ValueError, match="they must differ"):
        union([box(), moved(box(), "box", (1, 0, 0))])
    for body, has in (
        (box().with_(radius=0.1, triangles=()), "a radius"),
        (box().with_(lengths=0.9 * box().lengths), "springs of other lengths"),
        (ball(0.1).with_(radius=0.0), "no springs"),
        (rope(), "no shape of its own"),
        (rolling_ball(0.1), "round features"),
    ):
        with pytest.raises(ValueError, match=f"has {has}, which a union does not keep"):
            union([body, moved(box(), "other", (1, 0, 0))])
