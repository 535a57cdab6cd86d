"""Bodies from materials against the solids they stand for."""

import copy
import math
import pickle
import re
from dataclasses import replace
from itertools import cycle, product
from pathlib import Path

import numpy as np
import pytest

from springgym.model.bodies import (
    Body,
    from_points,
    relative_equilibrium,
    softened,
    solid_box,
    solid_hull,
    solid_mesh,
    solid_rope,
    solid_top,
    top,
    vibrations,
)
from springgym.model.bodies.elastic import Elastic
from springgym.model.bodies.lattice import lattice
from springgym.model.bodies.network import Network, bars, calibrated, missed, moment_masses, orbits, response
from springgym.model.materials import MATERIALS
from springgym.model.scene import Scene
from springgym.theory import solid as theory

CUBE = list(product((-0.01, 0.01), repeat=3))
STONE = np.random.default_rng(5).normal(size=(14, 3)) * (0.03, 0.024, 0.018)
SHAPES = {
    "top": lambda material: solid_top(0.03, 0.04, material),
    "slender top": lambda material: solid_top(0.012, 0.04, material),
    "flat top": lambda material: solid_top(0.05, 0.03, material, ring=8),
    "cube": lambda material: solid_box((0.03, 0.03, 0.03), material),
    "brick": lambda material: solid_box((0.06, 0.03, 0.02), material),
    "stone": lambda material: solid_hull(STONE, material),
}
EACH = [*zip(cycle(SHAPES), MATERIALS, strict=False)]
"""Each material in a shape, each shape of a material."""


def reached(body):
    """Lowest frequency over the solid's, and growths under spin over the solid's, measured anew."""
    network = Network(body.positions, body.masses, body.springs)
    now = response(network, body.stiffness, body.solid.axes)
    return math.sqrt(now.squares[0]) / body.solid.frequency, now.stretch / body.solid.stretch


@pytest.mark.parametrize(("shape", "name"), EACH)
def test_every_material_and_shape(shape, name):
    body = SHAPES[shape](name)
    solid = body.solid
    assert isinstance(solid, Elastic)
    assert (body.masses > 0).all()
    assert body.mass == pytest.approx(solid.mass, rel=1e-12)
    size = np.ptp(body.positions, axis=0).max()
    assert np.abs(body.centre - solid.centre).max() < 1e-12 * size
    assert np.abs(body.inertia() - solid.inertia).max() < 1e-12 * np.abs(solid.inertia).max()
    frequency, stretch = reached(body)
    assert frequency == pytest.approx(1, abs=1e-4)
    assert stretch == pytest.approx([1, 1, 1], abs=1e-4)
    assert solid.frequency_ratio == pytest.approx(frequency, abs=1e-9)
    assert solid.stretch_ratios == pytest.approx(stretch, abs=1e-9)
    frequencies, _ = vibrations(body)
    assert frequencies[-1] < 60 * frequencies[0]  # steps are not needlessly small


@pytest.mark.parametrize("shape", SHAPES)
def test_dampers_lose_half_the_loss_factor(shape):
    """ζ = φᵀCφ/2ω is η/2 at the lowest frequency, and rises with it."""
    body = SHAPES[shape]("nylon")
    frequencies, modes = vibrations(body)
    first, second = body.springs.T
    along = body.positions[second] - body.positions[first]
    along /= np.linalg.norm(along, axis=1)[:, None]
    rate = np.einsum("qsi,si->qs", modes[:, second] - modes[:, first], along)
    ratios = (body.damping * rate**2).sum(axis=1) / (2 * frequencies)
    assert ratios[0] == pytest.approx(MATERIALS["nylon"].loss / 2, rel=1e-4)
    assert ratios == pytest.approx(ratios[0] * frequencies / frequencies[0], rel=1e-9)


# --- Broken twins: what would be missed ---------------------------------------------------------------


def test_beech_without_its_grain_misses_its_frequency_fourfold():
    beech = MATERIALS["beech"]
    plain = replace(beech, grain=None, poisson=0.3)
    true, wrong = (vibrations(solid_top(0.03, 0.04, material))[0][0] for material in (beech, plain))
    assert wrong / true == pytest.approx(4.3, abs=0.2)


def test_without_calibration_frequency_and_growth_are_far_off():
    """Bars of equal section and the right size, which the calibration starts from."""
    body = solid_top(0.03, 0.04, "steel")
    plain = 210e9 / 7800 * bars(Network(body.positions, body.masses, body.springs))
    frequency, stretch = reached(body.with_(stiffness=plain, solid=body.solid))
    assert abs(math.log(frequency)) > 0.2
    assert np.abs(np.log(stretch)).max() > 0.5


def test_crown_at_the_top_would_have_no_masses():
    """The paper's arrangement: Σ m z² = 0.75 M h² at the least, where the cone has 0.6."""
    crown = top(radius=0.75, height=1.0).positions
    assert moment_masses(crown, theory.cone_rule(0.75, 1.0)) is None
    heart = solid_top(0.75, 1.0, "steel").positions
    masses = moment_masses(heart, theory.cone_rule(0.75, 1.0))
    shares = masses / masses.sum()
    assert shares[:12] == pytest.approx(np.full(12, 0.025), rel=1e-9)
    assert shares[12:] == pytest.approx([0.675, 0.025], rel=1e-9)


# --- Tops -------------------------------------------------------------------------------------------


@pytest.mark.parametrize(("ratio", "ring"), [(0.3, 4), (0.5, 8), (1.5, 5), (3.0, 12)])
def test_tops_of_all_shapes(ratio, ring):
    for material in ("steel", "rubber"):
        frequency, stretch = reached(solid_top(ratio * 0.04, 0.04, material, ring))
        assert frequency == pytest.approx(1, abs=1e-3)
        assert stretch == pytest.approx([1, 1, 1], abs=1e-3)


@pytest.mark.parametrize(
    ("ratio", "name"), [*zip(cycle([0.3, 0.5, 0.75, 1.0, 2.0]), MATERIALS, strict=False)]
)
def test_precession_slows_by_two_thirds_of_what_it_does_in_a_solid_or_more(ratio, name):
    """The contraction along the axis is out of reach for so few springs; this is what is left of it."""
    solid = solid_top(ratio * 0.04, 0.04, name).solid
    assert 0.62 < solid.precession_ratio < 1.02
    assert f"slowing of its precession × {solid.precession_ratio:.2f}" in repr(solid)


def test_top_is_symmetric():
    body = solid_top(0.03, 0.04, "steel")
    groups = orbits(Network(body.positions, body.masses, body.springs), [rotation(2 * math.pi / 12)])
    assert groups.max() == 3  # rim, spokes, flanks, axis
    for group in range(4):
        assert np.ptp(body.stiffness[groups == group]) < 1e-14 * body.stiffness.max()
    moments, _ = body.principal()
    assert moments[0] == pytest.approx(moments[1], rel=1e-14)


def rotation(angle):
    c = math.cos(angle)
    s = math.sin(angle)
    return np.array([[c, -s, 0], [s, c, 0], [0, 0, 1.0]])


def test_growth_under_spin_is_that_of_the_springs():
    """`relative_equilibrium`, which knows nothing of calibration, stretches the body by s ω²."""
    body = solid_top(0.03, 0.04, "rubber")
    spin = 30.0
    for axis in range(3):
        omega = spin * np.eye(3)[axis]
        grown = body.with_(positions=relative_equilibrium(body, omega), lengths=body.lengths)
        share = grown.inertia()[axis, axis] / body.inertia()[axis, axis] - 1
        # ω²/ω₁² = 5e-4 is the next order
        assert share == pytest.approx(body.solid.stretch[axis] * spin**2, rel=5e-3)
        assert share > 5e-5


def test_ritz_in_si():
    """The solid of a body, solved without scaling."""
    steel = MATERIALS["steel"]
    body = solid_top(0.03, 0.04, "steel")
    found = theory.elastic_solid(theory.cone_rule(0.03, 0.04), steel.density, steel.elasticity())
    assert body.solid.frequency == pytest.approx(found.frequencies[0], rel=1e-9)
    assert body.solid.stretch == pytest.approx(found.stretch, rel=1e-9)
    assert body.solid.inertia == pytest.approx(found.inertia, rel=1e-9, abs=1e-18)


# --- Boxes and lattices -----------------------------------------------------------------------------


def test_cube_has_nine_particles():
    body = solid_box((0.03, 0.03, 0.03), "steel")
    assert (len(body.masses), len(body.springs)) == (9, 32)
    assert body.masses[:8] == pytest.approx(np.full(8, body.mass / 24))
    assert body.masses[8] == pytest.approx(2 / 3 * body.mass)
    assert body.positions[body.particle("corner 6")] == pytest.approx([0.015, 0.015, -0.015])


@pytest.mark.parametrize(("sides", "counts"), [((1.0, 1.0, 1.0), (2, 2, 2)), ((1.0, 0.8, 1.3), (3, 2, 4))])
def test_lattice_is_isotropic_with_a_quarter(sides, counts):
    """Strained evenly, it has the energy of the continuum, for any strain."""
    network, stiffness = lattice(sides, counts)
    c = theory.isotropic(1.0, 0.25)
    rng = np.random.default_rng(3)
    for _ in range(6):
        strain = rng.normal(size=(3, 3))
        strain = (strain + strain.T) / 2
        apart = network.positions[network.springs[:, 1]] - network.positions[network.springs[:, 0]]
        longer = np.einsum("si,ij,sj->s", apart, strain, apart) / np.linalg.norm(apart, axis=1)
        energy = 0.5 * np.sum(stiffness * longer**2)
        assert energy == pytest.approx(0.5 * np.prod(sides) * np.einsum("ij,ijkl,kl", strain, c, strain))
    assert network.masses.min() > 0
    second = (network.masses * network.positions.T) @ network.positions
    assert second == pytest.approx(np.prod(sides) / 12 * np.diag(np.square(sides)), abs=1e-13)


def lattice_ratios(n):
    """Frequency and growth of a cube of n³ cells over those of the solid with ν = ¼."""
    network, stiffness = lattice((1.0, 1.0, 1.0), (n, n, n))
    solid = theory.elastic_solid(theory.box_rule((1, 1, 1), degree=12), 1.0, theory.isotropic(1.0, 0.25))
    now = response(network, stiffness, np.eye(3))
    return math.sqrt(now.squares[0]) / solid.frequencies[0], now.stretch[0] / solid.stretch[0]


def test_lattice_of_few_cells_is_near_the_solid():
    frequency, stretch = lattice_ratios(4)
    assert frequency == pytest.approx(1.10, abs=0.01)
    assert stretch == pytest.approx(1, abs=0.02)


@pytest.mark.slow
def test_lattice_converges_to_the_solid():
    """The frequency to second order; the growth is within 1.5 % from 4 cells on, and crosses it at 5."""
    (f4, s4), (f6, s6), (f8, s8) = (lattice_ratios(n) for n in (4, 6, 8))
    assert f4 > f6 > f8 > 1
    assert np.log((f4 - 1) / (f8 - 1)) / np.log(2) == pytest.approx(2, abs=0.25)
    assert [s4, s6, s8] == pytest.approx([1, 1, 1], abs=0.015)
    assert [s6, s8] == pytest.approx([1, 1], abs=0.006)


# --- Hulls and meshes -------------------------------------------------------------------------------


def test_hull_with_too_few_corners_gets_middles_of_edges():
    """A flat six-sided prism: no masses at its corners and centre have its moments."""
    angle = np.arange(6) * math.pi / 3
    points = [(math.cos(a), math.sin(a), z) for a in angle for z in (-0.5, 0.5)]
    body = solid_hull(points, "oak")
    assert len(body.masses) > 13
    assert reached(body)[0] == pytest.approx(1, abs=1e-4)
    assert from_points(points).mass == 1 + 1 / 12  # which asks for no moments


def test_only_the_lowest_frequency_is_right():
    """Of a steel bar, the table of the page: bending, torsion and stretching, by their places in order."""
    body = solid_box((0.02, 0.02, 0.2), "steel")
    steel = MATERIALS["steel"]
    rule = theory.box_rule((0.02, 0.02, 0.2))
    solid = theory.elastic_solid(rule, steel.density, steel.elasticity()).frequencies / (2 * math.pi)
    springs = vibrations(body)[0] / (2 * math.pi)
    page = (Path(__file__).parents[2] / "docs" / "materials.md").read_text(encoding="utf-8")
    rows = re.findall(
        r"^\| (?:first|second|third) \w+ \| (\d+) \| (\d+) \| [+−]?([\d.]+)", page, re.MULTILINE
    )
    assert len(rows) == 5
    for (of_solid, of_springs, off), n, m in zip(rows, (0, 2, 4, 5, 7), (0, 2, 4, 6, 5), strict=True):
        assert float(of_solid) == pytest.approx(solid[n], rel=3e-3)
        assert float(of_springs) == pytest.approx(springs[m], abs=1)
        assert 100 * abs(float(of_springs) / float(of_solid) - 1) == pytest.approx(float(off), abs=0.5)


def test_random_hulls():
    for seed in range(4):
        points = np.random.default_rng(seed).normal(size=(12, 3))
        body = solid_hull(points * 0.02, "abs")
        frequency, stretch = reached(body)
        assert frequency == pytest.approx(1, abs=1e-3)
        assert stretch == pytest.approx([1, 1, 1], abs=1e-3)
        assert np.abs(body.inertia() - body.solid.inertia).max() < 1e-12 * body.inertia().max()


def test_hull_far_from_the_origin():
    away = np.array([1.0, 2.0, 3.0])
    near = solid_hull(STONE, "steel")
    far = solid_hull(STONE + away, "steel")
    assert far.centre == pytest.approx(near.centre + away)
    assert far.stiffness == pytest.approx(near.stiffness, rel=1e-6)
    assert far.solid.centre == pytest.approx(far.centre, abs=1e-13)


def test_hull_that_is_thin_and_lies_aslant():
    turn = np.linalg.qr(np.random.default_rng(1).normal(size=(3, 3)))[0]
    thin = STONE * (1, 1, 0.1)
    straight = solid_hull(thin, "steel")
    aslant = solid_hull(thin @ turn.T, "steel")
    assert aslant.solid.frequency == pytest.approx(straight.solid.frequency, rel=1e-6)
    assert reached(aslant)[0] == pytest.approx(1, abs=1e-4)
    with pytest.raises(ValueError, match="the points of the surface are too flat or slender"):
        solid_hull(STONE * (1, 1, 0.01), "steel")


def test_too_symmetric_a_hull_says_what_it_misses():
    """A tetrahedron with its centre: two kinds of springs for a frequency and a growth that do not fit."""
    body = solid_hull([(1, 1, 1), (1, -1, -1), (-1, 1, -1), (-1, -1, 1)], "steel")
    assert 0.85 < body.solid.frequency_ratio < 0.97
    assert f"× {body.solid.frequency_ratio:.4f}" in repr(body)


def test_mesh(tmp_path):
    trimesh = pytest.importorskip("trimesh")
    path = tmp_path / "egg.stl"
    egg = trimesh.creation.icosphere(subdivisions=1)
    egg.vertices *= (1, 0.8, 0.7)
    egg.export(path)
    body = solid_mesh(path, "brass", scale=0.02)
    frequency, stretch = reached(body)
    assert body.name == "egg"
    assert body.mass == pytest.approx(8500 * egg.volume * 0.02**3, rel=1e-6)  # STL holds single precision
    assert frequency == pytest.approx(1, abs=1e-3)
    assert stretch == pytest.approx([1, 1, 1], abs=1e-3)
    assert len(body.parts["surface"]) == len(body.masses) - 1


def test_mesh_that_is_not_convex(tmp_path):
    """An L of three cubes."""
    trimesh = pytest.importorskip("trimesh")
    outline = [(0, 0), (2, 0), (2, 1), (1, 1), (1, 2), (0, 2)]
    points = np.array([(x, y, z) for z in (0, 1) for x, y in outline], float)
    caps = [(0, 1, 2), (0, 2, 3), (0, 3, 4), (0, 4, 5)]
    faces = [t[::-1] for t in caps] + [tuple(n + 6 for n in t) for t in caps]
    for n in range(6):
        m = (n + 1) % 6
        faces += [(n, m, m + 6), (n, m + 6, n + 6)]
    path = tmp_path / "l.stl"
    trimesh.Trimesh(points, faces).export(path)
    body = solid_mesh(path, "steel", scale=0.01)
    assert body.mass == pytest.approx(7800 * 3e-6, rel=1e-6)
    assert body.centre == pytest.approx([0.01 * 5 / 6, 0.01 * 5 / 6, 0.005], rel=1e-6)
    assert reached(body)[0] == pytest.approx(1, abs=0.03)


# --- Ropes ------------------------------------------------------------------------------------------


@pytest.mark.parametrize("name", ["steel", "nylon"])
@pytest.mark.parametrize("beads", [2, 10])
def test_rope(name, beads):
    material = MATERIALS[name]
    section = math.pi * 0.01**2 / 4
    body = solid_rope(name, 0.01, length=4.0, end_mass=20.0, beads=beads)
    assert 1 / (1 / body.stiffness).sum() == pytest.approx(material.young * section / 4)
    assert body.mass == pytest.approx(20 + material.density * section * 4)
    # stretched by its own weight as a continuous cable is, (M + m/2) g L/EA: half of the mass at the ends
    below = np.cumsum(body.masses[:0:-1])[::-1]
    stretch = (9.81 * below / body.stiffness).sum()
    expected = 9.81 * 4 * (20 + (body.mass - 20) / 2) / (material.young * section)
    assert stretch == pytest.approx(expected, rel=1e-12)
    assert body.solid.mass == pytest.approx(body.mass - 20)


# --- The rest ---------------------------------------------------------------------------------------


def test_softened_body_is_as_of_softened_material():
    for body, made in (
        (softened(solid_top(0.03, 0.04, "beech"), 50), solid_top(0.03, 0.04, "beech", softened=50)),
        (softened(solid_rope("nylon", 0.01), 50), solid_rope("nylon", 0.01, softened=50)),
    ):
        assert body.stiffness == pytest.approx(made.stiffness, rel=1e-9)
        assert body.damping == pytest.approx(made.damping, rel=1e-9)
        assert body.solid.material == made.solid.material
        assert repr(body) == repr(made)
    solid = solid_top(0.03, 0.04, "steel").solid
    softer = solid_top(0.03, 0.04, "steel", softened=100).solid
    assert softer.frequency == pytest.approx(solid.frequency / 10)
    assert softer.stretch == pytest.approx(solid.stretch * 100)
    assert softer.damping_ratio == pytest.approx(solid.damping_ratio)


def test_repr_says_what_is_exact_what_was_reached_and_what_is_missed():
    said = repr(solid_top(0.03, 0.04, "steel"))
    assert "as a cone of steel: mass, centre and inertia exact; lowest frequency 29836 Hz × 1," in said
    assert "growth under spin × 1, 1, 1, slowing of its precession × 0.78; damping ratio 0.0001 there" in said
    assert "not matched: a Poisson's ratio of 0.31" in repr(solid_box((1, 1, 1), "steel", cells=2))
    assert "as a cable of nylon, 10 mm thick" in repr(solid_rope("nylon", 0.01))


def test_changed_body_stands_for_no_solid():
    body = solid_top(0.03, 0.04, "steel")
    assert body.with_(name="other", parts={}).solid is body.solid
    for name in ("positions", "masses", "stiffness", "damping", "lengths", "springs"):
        assert body.with_(**{name: getattr(body, name)}).solid is None
    assert isinstance(body.with_(stiffness=body.stiffness, solid=body.solid), Body)


def arrays(record):
    """All arrays that a record holds, by name, those of records in it among them."""
    for name, value in vars(record).items():
        if isinstance(value, np.ndarray):
            yield name, value
        elif hasattr(value, "__dict__"):
            yield from ((f"{name}.{inner}", array) for inner, array in arrays(value))


@pytest.mark.parametrize(
    "travel",
    [pickle.dumps, copy.deepcopy, copy.copy, lambda record: record.with_()],
    ids=["pickle", "deepcopy", "copy", "with_"],
)
def test_records_travel_and_cannot_be_spoilt(travel):
    body = solid_top(0.03, 0.04, "beech")
    assert body.centre[2] > 0  # kept from now on
    scene = Scene(body, pinned=body.parts["tip"])
    assert scene.free.any()
    for record in (body, scene, solid_rope("nylon", 0.01)):
        copied = travel(record)
        copied = pickle.loads(copied) if isinstance(copied, bytes) else copied
        assert repr(copied) == repr(record)
        for (name, array), (_, before) in zip(arrays(copied), arrays(record), strict=False):
            assert np.array_equal(array, before)
            with pytest.raises(ValueError, match="read-only"):
                array.flat[0] = 1
            assert name
    assert "body.solid.stretch" in dict(arrays(scene))
    kept = pickle.loads(pickle.dumps(body)).solid.material
    assert kept == body.solid.material
    assert kept.sources == MATERIALS["beech"].sources


def test_calibration_that_cannot_reach_ends_where_it_is_best():
    """All springs alike, and twice the growth that goes with the frequency."""
    body = solid_box((1.0, 1.0, 1.0), "steel")
    network = Network(body.positions, body.masses / 7800, body.springs)
    solid = theory.elastic_solid(theory.box_rule((1, 1, 1)), 1.0, theory.isotropic(1.0, 0.31))
    target = float(solid.frequencies[0]), 2 * solid.stretch

    def gap(stiffness):
        now = response(network, stiffness, np.eye(3))
        return missed(math.sqrt(now.squares[0]) / target[0], now.stretch / target[1])

    found = calibrated(network, np.eye(3), *target, np.zeros(len(body.springs), int), bars(network))
    assert gap(found) <= gap(bars(network))
    assert gap(found) > 0.1
    assert np.isfinite(found).all()


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: solid_top(0.03, 0.04, "cheese"), "material is 'cheese'; it must be one of steel"),
        (
            lambda: solid_top(0.03, 4.0, "steel"),
            r"radius is 0\.03 and height 4; neither must be more than 100",
        ),
        (lambda: solid_top(0.03, 0.04, "steel", ring=3), "ring is 3; it must be a whole number from 4 to 40"),
        (
            lambda: solid_box((1, 1, 1), "steel", cells=9),
            r"sides are \(1, 1, 1\) and cells 9; such a box has 1000 particles, and must have at most 400",
        ),
        (lambda: solid_box((1, 1, 1), "oak", cells=2), "cells is 2; a box of 'oak' must have 1"),
        (lambda: lattice((1, 1, 2), (2, 2, 2)), r"cells of 0.5 × 0.5 × 1 are too far from cubes"),
        (lambda: lattice((1, 1, 1), (1, 2, 2)), "at least two cells along each side, not 1"),
        (lambda: solid_hull([(0, 0, 0), (1, 0, 0), (0, 1, 0), (1, 1, 0)], "steel"), "have no volume"),
        (lambda: solid_rope("steel", 0.01, beads=1), "beads is 1; it must be a whole number from 2"),
        (lambda: vibrations(solid_rope("steel", 0.01)), "is floppy: it does not vibrate about its shape"),
    ],
)
def test_errors_name_the_offender(make, message):
    with pytest.raises(ValueError, match=message):
        make()


def test_vibration_of_a_pair():
    """Two masses on a spring have one, at √(k (1/m + 1/M)), and five rigid motions; one mass has none."""
    pair = Body("pair", [(0, 0, 0), (0.3, 0.4, 0)], [2.0, 3.0], [(0, 1)], 60.0, 0.0)
    frequencies, modes = vibrations(pair)
    assert frequencies == pytest.approx([math.sqrt(60 * (1 / 2 + 1 / 3))])
    assert np.einsum("qni,n,qni->q", modes, pair.masses, modes) == pytest.approx([1.0])
    point = Body("point", [(0, 0, 0)], [1.0], np.zeros((0, 2), int), [], [])
    assert vibrations(point)[0].shape == (0,)
