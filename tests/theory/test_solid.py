"""Rayleigh and Ritz against solids whose vibrations and stretch are known in closed form."""

import math

import numpy as np
import pytest
from scipy.optimize import brentq
from scipy.special import spherical_jn

from springgym.theory import solid


def solved(rule, poisson=0.25, axes=None):
    return solid.elastic_solid(rule, 1.0, solid.isotropic(1.0, poisson), axes)


def shear_speed(poisson):
    return math.sqrt(1 / (2 * (1 + poisson)))


# --- Moments ----------------------------------------------------------------------------------------


CUBE = np.array([(x, y, z) for x in (0.0, 1.0) for y in (0.0, 1.0) for z in (0.0, 1.0)])
FACES = np.reshape(
    [int(n) for n in "013 032 467 475 045 051 237 276 026 064 157 173".replace(" ", "")], (-1, 3)
)
MOMENTS = {
    "box": (solid.box_rule((1, 2, 3)), 6.0, (0, 0, 0), (1 / 12, 4 / 12, 9 / 12)),
    "cone": (
        solid.cone_rule(0.6, 2.0),
        math.pi * 0.36 * 2 / 3,
        (0, 0, 1.5),
        (0.15 * 0.36, 0.15 * 0.36, 3 / 80 * 4),
    ),
    "cylinder": (solid.cylinder_rule(0.6, 2.0), math.pi * 0.72, (0, 0, 1.0), (0.09, 0.09, 4 / 12)),
    "ball": (solid.ball_rule(0.6), 4 / 3 * math.pi * 0.216, (0, 0, 0), (0.072,) * 3),
    "polyhedron": (solid.polyhedron_rule(CUBE, FACES), 1.0, (0.5,) * 3, (1 / 12,) * 3),
}
"""Volume, centre and mean squares of the coordinates from it."""


@pytest.mark.parametrize("shape", MOMENTS)
def test_mass_centre_and_inertia(shape):
    rule, volume, centre, squares = MOMENTS[shape]
    found = solid.elastic_solid(rule, 3.0, solid.isotropic(1.0, 0.3))
    assert found.mass == pytest.approx(3 * volume, rel=1e-13)
    assert found.centre == pytest.approx(centre, abs=1e-13)
    second = 3 * volume * np.diag(squares)
    assert found.second == pytest.approx(second, abs=1e-13 * volume)
    assert found.inertia == pytest.approx(np.trace(second) * np.eye(3) - second, abs=1e-12 * volume)


def test_polyhedron_that_is_not_convex():
    """A cube with a pyramid of a quarter of its volume dug into its top: four tetrahedra count negatively."""
    points = np.vstack([CUBE, [0.5, 0.5, 0.25]])
    dug = [f for f in FACES.tolist() if not {1, 3, 5, 7} >= set(f)]
    dug += [(1, 8, 3), (3, 8, 7), (7, 8, 5), (5, 8, 1)]
    rule = solid.polyhedron_rule(points, dug, 2)
    assert (rule.weights < 0).sum() == 4 * (2 + 2) ** 3
    assert rule.weights.sum() == pytest.approx(0.75, rel=1e-13)
    # ∫ z = 1/2 less that of the pyramid, whose centre is at 1/4 + 3/4 · 3/4
    assert rule.weights @ rule.points[:, 2] == pytest.approx(0.5 - 0.25 * 0.8125, rel=1e-13)


# --- Elasticity -------------------------------------------------------------------------------------


def test_orthotropic_of_equal_constants_is_isotropic():
    expected = solid.isotropic(2.0, 0.3)
    shear = 2.0 / 2.6
    assert solid.orthotropic((2.0,) * 3, (0.3,) * 3, (shear,) * 3) == pytest.approx(expected, abs=1e-13)


def test_orthotropic_answers_a_pull_and_a_shear_by_its_constants():
    young = (1.858, 0.774, 12.205)
    poisson = (0.526, 0.076, 0.045)
    shear = (0.195, 0.899, 0.595)
    tensor = solid.orthotropic(young, poisson, shear)
    stress = np.zeros((3, 3))
    stress[0, 0] = 1.0
    strain = np.linalg.solve(tensor.reshape(9, 9) + antisymmetric(), stress.ravel()).reshape(3, 3)
    assert np.diag(strain) == pytest.approx(np.array([1, -0.526, -0.076]) / 1.858)
    stress = np.zeros((3, 3))
    stress[0, 2] = stress[2, 0] = 1.0
    strain = np.linalg.solve(tensor.reshape(9, 9) + antisymmetric(), stress.ravel()).reshape(3, 3)
    assert strain[0, 2] == pytest.approx(1 / (2 * 0.899))  # G_xz


def antisymmetric():
    """Return what makes a map of matrices invertible that takes no notice of their antisymmetric parts."""
    swap = np.eye(9).reshape(3, 3, 3, 3).transpose(1, 0, 2, 3).reshape(9, 9)
    return (np.eye(9) - swap) / 2


def test_constants_of_no_material_are_refused():
    with pytest.raises(ValueError, match=r"no material has E = \[1.0, 1.0, 1.0\] Pa, nu = \[0.6"):
        solid.orthotropic((1, 1, 1), (0.6, 0.6, 0.6), (1, 1, 1))


# --- Vibrations -------------------------------------------------------------------------------------


def nearest(found, expected):
    return found.frequencies[np.abs(found.frequencies - expected).argmin()]


@pytest.mark.parametrize("poisson", [0.1, 0.25, 0.45])
def test_sphere_of_lamb(poisson):
    """Twisting: x j₂'(x) = j₂(x) with x = ω a/c_t; breathing: tan y = y/(1 − (c_l y/2 c_t)²), y = ω a/c_l."""
    found = solved(solid.ball_rule(1.0), poisson)
    ct = shear_speed(poisson)
    twist = brentq(lambda x: x * spherical_jn(2, x, True) - spherical_jn(2, x), 2.0, 3.0)
    assert twist == pytest.approx(2.5011, abs=1e-4)
    assert nearest(found, twist * ct) == pytest.approx(twist * ct, rel=1e-6)
    ratio = math.sqrt(2 * (1 - poisson) / (1 - 2 * poisson))  # c_l/c_t
    breath = brentq(lambda y: math.sin(y) * (1 - (ratio * y / 2) ** 2) - y * math.cos(y), 1.0, 3.1)
    assert nearest(found, breath * ratio * ct) == pytest.approx(breath * ratio * ct, rel=1e-5)
    if poisson == 0.25:
        lowest = found.frequencies[:10] / ct
        assert lowest == pytest.approx([2.5011] * 5 + [2.640] * 5, abs=2e-4)  # Lamb 1882


@pytest.mark.parametrize("poisson", [0.1, 0.31, 0.49])
def test_modes_of_lame_in_a_cube(poisson):
    """Shear that leaves all faces free, at ω = √2 π c_t/a whatever Poisson's ratio is."""
    expected = math.sqrt(2) * math.pi * shear_speed(poisson)
    assert nearest(solved(solid.box_rule((1, 1, 1)), poisson), expected) == pytest.approx(expected, rel=1e-5)


def test_rod():
    """Without contraction across it a bar stretches at ω = π √(E/ρ)/L, and under spin by s = ρ L²/5E."""
    found = solved(solid.box_rule((1, 1, 12)), 0.0)
    expected = math.pi / 12
    assert nearest(found, expected) == pytest.approx(expected, rel=1e-9)
    assert found.stretch[:2] == pytest.approx([144 / 5] * 2, rel=0.01)  # (thickness/length)² is 0.007


def test_bar_bends_as_the_beam_of_timoshenko():
    """Thickness/length is 1/12: Euler's (4.730/L)² √(EI/ρA), less 2 % by shear and turning of sections."""
    found = solved(solid.box_rule((1, 1, 12), degree=10))
    euler = (4.730041 / 12) ** 2 / math.sqrt(12)
    assert 0.955 * euler < found.frequencies[0] < 0.985 * euler


@pytest.mark.parametrize("poisson", [0.0, 0.3, 0.45])
def test_spinning_disc(poisson):
    """Plane stress: u = (1 − ν) ρω² r ((3 + ν) R² − (1 + ν) r²)/8E, dI/I = (1 − ν)(7 + ν) ρω²R²/12E."""
    found = solved(solid.cylinder_rule(1.0, 0.02), poisson)
    expected = (1 - poisson) * (7 + poisson) / 12
    assert found.stretch[2] == pytest.approx(expected, rel=1e-4)
    rim = solid.elastic_solid(
        solid.cylinder_rule(1.0, 0.02), 1.0, solid.isotropic(1.0, poisson), marks=[(0.6, 0.8, 0.01)]
    ).moved[2, 0]
    assert rim == pytest.approx(np.array([0.6, 0.8, 0]) * (1 - poisson) / 4, abs=1e-4)


@pytest.mark.parametrize(
    ("rule", "sizes"),
    [(solid.box_rule, [(1, 1, 1)]), (solid.cone_rule, [0.75, 1.0]), (solid.ball_rule, [1.0])],
)
def test_converges_from_above(rule, sizes):
    """Rayleigh and Ritz: with every degree lower frequencies and larger responses."""
    coarse, middle, fine = (solved(rule(*sizes, degree=degree)) for degree in (4, 6, 8))
    assert coarse.frequencies[0] > middle.frequencies[0] * (1 - 1e-12) > fine.frequencies[0] * (1 - 2e-12)
    assert coarse.frequencies[0] > 1.0001 * fine.frequencies[0]
    assert (coarse.stretch < middle.stretch * (1 + 1e-12)).all()
    assert (middle.stretch < fine.stretch * (1 + 1e-12)).all()
    assert fine.frequencies[0] == pytest.approx(middle.frequencies[0], rel=3e-3)


def test_almost_incompressible_solids_do_not_lock():
    """Polynomials of high degree have room to keep the volume: ν = 0.4999 differs little from 0.49."""
    almost, less = (solved(solid.cone_rule(0.75, 1.0), poisson) for poisson in (0.4999, 0.49))
    assert almost.frequencies[0] == pytest.approx(less.frequencies[0], rel=0.004)


def test_scales_with_size_and_material():
    small = solved(solid.cone_rule(0.75, 1.0))
    large = solid.elastic_solid(solid.cone_rule(1.5, 2.0), 5.0, solid.isotropic(7.0, 0.25))
    assert large.frequencies[:9] == pytest.approx(small.frequencies[:9] * math.sqrt(7 / 5) / 2, rel=1e-9)
    assert large.stretch == pytest.approx(small.stretch * 5 * 4 / 7, rel=1e-9)


@pytest.mark.parametrize("sides", [(1, 2, 3), (1, 2, 0.05), (1, 0.03, 0.05)])
def test_axes_turn_with_the_solid(sides):
    """Of beech, which turns as well. Thin ones need polynomials along their own axes."""
    turn = np.linalg.qr(np.random.default_rng(1).normal(size=(3, 3)))[0]
    rule = solid.box_rule(sides, degree=6)
    c = solid.orthotropic((1.858, 0.774, 12.205), (0.526, 0.076, 0.045), (0.195, 0.899, 0.595))
    turned = np.einsum("ai,bj,ck,dl,ijkl->abcd", turn, turn, turn, turn, c)
    mark = np.array(sides) / 2
    straight = solid.elastic_solid(rule, 1.0, c, marks=[mark])
    tilted = solid.elastic_solid(
        rule._replace(points=rule.points @ turn.T + (1, 2, 3)), 1.0, turned, turn, [turn @ mark + (1, 2, 3)]
    )
    # to round-off, of which eigenvalues have as much as the largest of them, 1e8 times the lowest
    assert tilted.stretch == pytest.approx(straight.stretch, rel=1e-7)
    assert tilted.frequencies[:9] == pytest.approx(straight.frequencies[:9], rel=1e-7)
    size = np.abs(straight.moved).max()
    assert tilted.moved @ turn == pytest.approx(straight.moved, abs=1e-8 * size)
