"""Surfaces: heights and their gradients, and beads in pipes, on uneven ground and between surfaces."""

from __future__ import annotations

import dataclasses
import math
import pickle
from typing import Any, NamedTuple

import numpy as np
import pytest

from springgym.core import compiled, load
from springgym.core.language.vec import vec
from springgym.core.language.vectors import dot
from springgym.model.scene import Scene
from springgym.model.surfaces import (
    SURFACES,
    Bowl,
    HeightField,
    Pipe,
    Plane,
    Surface,
    check_gradient,
    floor,
    incline,
    waves,
)
from springgym.simulator import Simulator
from tests.forces.test_contact import (
    BEAD,
    PIPE,
    REACH,
    TROUGH,
    G,
    among,
    at_rest_height,
    beads,
    contact,
    state,
)

HILLS = HeightField(np.random.default_rng(4).uniform(-0.1, 0.1, (7, 9)), 0.25, (-0.75, -1.0))

EACH = [
    pytest.param((incline(0.3), floor()), id="planes"),
    pytest.param((Bowl((0.1, 0.2, 0.5), 1.0),), id="bowl"),
    pytest.param((Pipe((0.1, 0.0, 0.5), (1.0, 2.0, 0.3), 1.0),), id="pipe"),
    pytest.param((HILLS,), id="height field"),
    pytest.param((floor(), PIPE, Bowl((0, 0, 0), 1.2), incline(0.2)), id="several kinds"),
]


# --- Pipes --------------------------------------------------------------------------------------------


@pytest.mark.parametrize("surface", [PIPE, TROUGH], ids=["pipe", "waves"])
@pytest.mark.slow
def test_a_hundred_bounces_keep_the_energy(surface: Surface) -> None:
    """And what slides keeps it; the level of the energy is that of where the bead may rest."""
    places = np.array([[0.3, 0, -0.9], [0.5, 0, 0], [0.9, 0, 0], [0, 0.6, -0.6]]) + PIPE.point
    velocities = np.array([[0, 1.0, 0], [0, 0, 0], [0, 3.0, 0], [2.0, 0, 0]])
    if surface is TROUGH:
        places = np.array([[0.5, 0, 0.2], [0.3, 0, 0.0], [0.45, 0.2, 0.0], [0.1, 0, 0.3]])
        velocities = np.zeros((4, 3))
    simulator = beads(places, velocities, surfaces=among(surface))
    low = -0.5 if surface is PIPE else -0.1
    start = simulator.measure().energy - G * low
    bounces = np.zeros(4)
    last = np.ones(4)
    for _ in range(2000):
        simulator.advance(10, check=False)
        energy = simulator.measure().energy - G * low
        assert energy / start == pytest.approx(np.ones(4), abs=2e-3)
        heights = surface.height(state(simulator)[0])
        assert heights.min() > 0
        inside = np.where(heights < 2 * REACH, -1.0, 1.0)
        bounces += (inside > 0) & (last < 0)
        last = inside
    assert bounces.max() >= 30


# --- Height fields ------------------------------------------------------------------------------------


@pytest.mark.slow
def test_a_bead_swings_in_a_trough_with_the_period_of_its_bend() -> None:
    """A bead at a height h over ground of curvature κ = a (2π/λ)² swings a little with ω² = g κ (1 + κ h).

    That is the bend of z = f + h √(1 + f′²). Of a line at the distance h it would be κ/(1 − κ h): 0.6 % more.
    """
    kappa = 0.1 * (2 * math.pi) ** 2
    h = at_rest_height(G)
    omega = math.sqrt(G * kappa * (1 + kappa * h))
    swing, fine = 1e-3, waves(0.1, 1.0, 1.0, 0.005)  # the bend of a spline errs in second order
    simulator = beads(
        [[0.5 + swing, 0, -0.1 + h + 0.5 * swing**2 * kappa]], [[0, 0, 0]], surfaces=among(fine)
    )
    steps = round(10.25 * 2 * math.pi / omega / 1e-3)
    simulator.advance(steps)
    x, _ = state(simulator)
    assert x[0, 0] - 0.5 == pytest.approx(swing * math.cos(omega * steps * 1e-3), abs=0.02 * swing)


def test_a_level_or_straight_field_is_a_plane() -> None:
    x, y = np.meshgrid(np.arange(4.0), np.arange(5.0), indexing="ij")
    field = HeightField(0.2 * x - 0.1 * y, 1.0)
    plane = Plane((0, 0, 0), (-0.2, 0.1, 1.0))
    places = np.random.default_rng(2).uniform(-9, 9, (50, 3))
    assert field.height(places) == pytest.approx(plane.height(places), abs=1e-12)
    two = HeightField([[0.0, 1.0], [0.0, 1.0]], 0.5, (3.0, 0.0))
    assert two.height(np.array([9.0, 2.0, 4.0])) == pytest.approx(0.0, abs=1e-12)


def test_a_height_field_goes_through_its_heights_and_errs_in_fourth_order() -> None:
    x = np.array(HILLS.corner)[0] + 0.25 * np.arange(7)
    y = np.array(HILLS.corner)[1] + 0.25 * np.arange(9)
    grid = np.stack([*np.meshgrid(x, y, indexing="ij"), np.array(HILLS.heights)], axis=-1)
    assert np.abs(HILLS.height(grid)).max() < 1e-15
    errors = []
    for spacing in (0.1, 0.05, 0.025):
        ground = waves(0.1, 1.0, 1.5, spacing).net(np.zeros(3), 0.5)
        errors.append(np.abs(ground[..., 2] - 0.1 * np.cos(2 * math.pi * ground[..., 0])).max())
    assert errors[0] / errors[1] == pytest.approx(16, rel=0.2)
    assert errors[1] / errors[2] == pytest.approx(16, rel=0.2)


def test_a_height_differs_from_the_distance_as_its_module_says() -> None:
    """κ d² tan² θ/2 at a distance d from ground of curvature κ and slope tan θ, to first order."""
    x = 0.6
    slope = 0.1 * 2 * math.pi * -math.sin(2 * math.pi * x)
    bend = -0.1 * (2 * math.pi) ** 2 * math.cos(2 * math.pi * x)
    cosine = 1 / math.sqrt(1 + slope**2)
    fine = waves(0.1, 1.0, 1.0, 0.005)
    d = 2e-3
    place = np.array([x - d * slope * cosine, 0.0, 0.1 * math.cos(2 * math.pi * x) + d * cosine])
    expected = 0.5 * bend * cosine**3 * d**2 * slope**2
    assert fine.height(place) - d == pytest.approx(expected, rel=0.05)


# --- Several ------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    "surfaces",
    [
        pytest.param((PIPE, waves(0.1, 1.0, 2.0, 0.04, level=-0.3)), id="a pipe over uneven ground"),
        pytest.param(
            (PIPE, Plane((0, -0.5, 0), (0, 1, 0)), Plane((0, 0.5, 0), (0, -1, 0))), id="a pipe with ends"
        ),
        pytest.param(
            (Bowl((0.1, 0, 0.5), 1.0), floor(-0.1), Plane((0.1, 0, 0), (1, 0, 0))),
            id="half of a bowl with a level bottom",
        ),
    ],
)
@pytest.mark.slow
def test_surfaces_of_several_kinds_meet_a_bead_together(surfaces: tuple[Surface, ...]) -> None:
    draw = np.random.default_rng(3)
    places = np.array([0.5, 0, 0.5]) + draw.uniform(-0.3, 0.3, (8, 3))
    simulator = beads(places, draw.uniform(-2, 2, (8, 3)), surfaces=surfaces)
    low = -0.5 if surfaces[0] is PIPE else -0.1
    start = simulator.measure().energy - G * low
    for _ in range(200):
        simulator.advance(50, check=False)
        assert min(surface.height(state(simulator)[0]).min() for surface in surfaces) > 0
        energy = simulator.measure().energy - G * low
        assert energy / start == pytest.approx(np.ones(8), abs=0.01)


# --- Kinds of one's own -----------------------------------------------------------------------------------


@compiled
def slanted(place: Any, k: int, own: Any) -> Any:
    return 0.8 * place[2] - 0.6 * place[0] - load(own.level, k)


@compiled
def steep(place: Any, k: int, own: Any) -> Any:
    return place[2] - 0.75 * place[0] - 1.25 * load(own.level, k)


@compiled
def upwards(place: Any, k: int, own: Any) -> Any:
    return vec(-0.6, 0.0, 0.8)


@compiled
def not_a_unit(place: Any, k: int, own: Any) -> Any:
    return vec(-0.75, 0.0, 1.0)


@compiled
def downwards(place: Any, k: int, own: Any) -> Any:
    return vec(0.6, 0.0, -0.8)


@compiled
def without_k(place: Any, own: Any) -> Any:
    return place[2]


@compiled
def misspelt(place: Any, k: int, own: Any) -> Any:
    return place[2] - load(own.levels, k)


@compiled
def no_vector(place: Any, k: int, own: Any) -> Any:
    return place[2]


def kind_of(height: Any, gradient: Any, packed: Any = None, slope: float = 0.6, rise: float = 0.8) -> Surface:
    """A slope of a kind of one's own; ``height`` and ``gradient`` are its compiled functions."""

    class Slopes(NamedTuple):
        level: Any

    for name, function in (("height", height), ("gradient", gradient)):
        if function is not None:
            setattr(Slopes, name, staticmethod(function))

    class Slope(Surface):
        def height(self, positions: np.ndarray) -> np.ndarray:
            return np.asarray(rise * positions[..., 2] - slope * positions[..., 0] - 0.1 * rise / 0.8)

        @classmethod
        def packed(cls, surfaces: Any) -> Any:
            return packed(Slopes) if packed else Slopes(np.full(len(surfaces), 0.1))

        def net(self, middle: np.ndarray, extent: float) -> np.ndarray:
            return np.zeros((2, 2, 3))

    return Slope()


PLACES = np.random.default_rng(5).uniform(-0.3, 0.3, (9, 3))


@pytest.mark.parametrize("surfaces", EACH)
def test_every_kind_passes_the_check_of_its_gradient(surfaces: tuple[Surface, ...]) -> None:
    for surface in surfaces:
        check_gradient(surface, PLACES)
    check_gradient(surfaces[0], PLACES[:1])
    if surfaces[0] is HILLS:
        check_gradient(HILLS, np.add(PLACES, [5.0, -4.0, 0.0]))  # beyond the grid


def test_a_kind_of_one_s_own_passes_too() -> None:
    check_gradient(kind_of(slanted, upwards), PLACES)


@pytest.mark.parametrize(
    ("own", "error", "says"),
    [
        (
            kind_of(slanted, downwards),
            ValueError,
            r"gradient of Slope is \[0.6, 0.0, -0.8\]; it must be \[-0.6, 0",
        ),
        (kind_of(steep, upwards), ValueError, "the compiled height of Slope is .*; it must be"),
        (
            kind_of(steep, not_a_unit, None, 0.75, 1.0),
            ValueError,
            "length of the gradient of Slope is 1.25; it m",
        ),
        (kind_of(slanted, no_vector), TypeError, "Slopes does not compile: "),
        (kind_of(misspelt, upwards), TypeError, "does not compile: .*'levels'"),
        (
            kind_of(without_k, upwards),
            TypeError,
            r"is height\(place, own\); it must be height\(place, k, own\)",
        ),
        (kind_of(None, upwards), TypeError, r"no compiled function height\(place, k, own\)"),
        (kind_of(slanted, lambda place, k, own: place), TypeError, "no compiled function gradient"),
        (
            kind_of(slanted, upwards, lambda kind: [0.1]),
            TypeError,
            r"packed gave is \[0.1\]; it must be a named",
        ),
        (kind_of(slanted, upwards, lambda kind: kind(0.1)), TypeError, "level is 0.1; it must be an array"),
        (kind_of(slanted, upwards, lambda kind: kind(np.zeros(3))), ValueError, "3 rows for 1 surfaces"),
    ],
)
def test_mistakes_in_a_kind_of_one_s_own_are_found(own: Surface, error: type[Exception], says: str) -> None:
    with pytest.raises(error, match=says):
        check_gradient(own, PLACES)


@pytest.mark.parametrize(
    "given", [None, PLACES[0], PLACES[:, :2], PLACES[:0], "x", np.full((2, 3), math.nan)]
)
def test_places_of_a_check_are_checked(given: Any) -> None:
    with pytest.raises((TypeError, ValueError), match="places"):
        check_gradient(floor(), given)
    with pytest.raises(TypeError, match=r"surface is .*; it must be Surface"):
        check_gradient(given, PLACES)


def test_a_surface_that_no_way_leads_to_is_told() -> None:
    """The height of this one is 1 + x² + y² + z²: nothing lies on it."""

    @compiled
    def height(place: Any, k: int, own: Any) -> Any:
        return 1.0 + dot(place, place)

    @compiled
    def gradient(place: Any, k: int, own: Any) -> Any:
        return 2.0 * place

    nowhere = kind_of(height, gradient)
    nowhere.height = lambda positions: 1 + (positions**2).sum(-1)  # type: ignore[method-assign]
    with pytest.raises(ValueError, match="no path along the gradient leads from the places to the Slope"):
        check_gradient(nowhere, PLACES)


def test_a_simulator_refuses_a_kind_without_its_functions() -> None:
    with pytest.raises(TypeError, match="no compiled function gradient"):
        Simulator(scene_of(kind_of(slanted, None)))


# --- What scenes and pictures ask of them -----------------------------------------------------------------


def test_scene_files_know_every_kind() -> None:
    assert {Plane, Bowl, Pipe, HeightField} <= {kind for kind in SURFACES.values() if isinstance(kind, type)}


@pytest.mark.parametrize("surface", [Bowl((0.1, 0.2, 0.5), 1.0), PIPE, HILLS, incline(0.3)])
def test_nets_lie_on_surfaces_and_rays_hit_them(surface: Surface) -> None:
    net = surface.net(np.array([0.1, 0.2, 0.0]), 0.8)
    assert net.ndim == 3
    assert np.abs(surface.height(net)).max() < 1e-12
    eye = np.array([0.1, 0.1, 0.6])
    direction = np.array([[0.6, 0, -0.8], [0, 0.6, -0.8], [0, 0, -1.0]])
    hit = surface.hit(eye, direction)
    if hit is not None:
        places, normals = hit
        assert np.abs(surface.height(places)).max() < 1e-12
        assert np.cross(places - eye, direction) == pytest.approx(np.zeros((3, 3)), abs=1e-12)
        assert surface.height(places + 1e-3 * normals) == pytest.approx(np.full(3, 1e-3))
    assert pickle.loads(pickle.dumps(surface)) == surface


def test_a_height_field_is_told_apart_by_its_heights() -> None:
    other = dataclasses.replace(HILLS, heights=np.array(HILLS.heights) + 1e-9)
    assert other != HILLS
    assert repr(other) != repr(HILLS)
    assert len(repr(HILLS)) < 100
    scenes = [Scene(BEAD, [[0, 0, 1.0]], surfaces=(field,), contact=contact()) for field in (HILLS, other)]
    assert scenes[0].identity != scenes[1].identity


@pytest.mark.parametrize(
    ("build", "error", "message"),
    [
        (lambda: Pipe((0, 0, 0), (0, 0, 0), 1.0), ValueError, "axis of a pipe"),
        (lambda: Pipe((0, 0, 0), (0, 0, 1), -1.0), ValueError, "radius of a pipe is -1.0"),
        (lambda: Pipe((0, 0, 0), (0, 0, 1), True), TypeError, "radius of a pipe is True"),
        (lambda: Pipe((0, 0), (0, 0, 1), 1.0), ValueError, "point of a pipe"),
        (lambda: HeightField([[0.0, 1.0]], 1.0), ValueError, "number of heights along x"),
        (lambda: HeightField([0.0, 1.0], 1.0), ValueError, "heights of a height field"),
        (lambda: HeightField([[0.0, math.nan], [0, 0]], 1.0), ValueError, "heights of a height field"),
        (lambda: HeightField([[0.0, 1.0], [0, 0]], 0.0), ValueError, "spacing of a height field"),
        (lambda: HeightField([[0.0, 1.0], [0, 0]], 1.0, (0, 0, 0)), ValueError, "corner of a height field"),
        (lambda: HeightField([["a", 1.0], [0, 0]], 1.0), TypeError, "heights of a height field"),
        (lambda: waves(0.1, 1.0, 2.0, 0.5), ValueError, "spacing is 0.5"),
        (lambda: PIPE.height(np.zeros((2, 2))), ValueError, "positions"),
        (lambda: scene_of(PIPE, z=-0.6), ValueError, "behind surface 0, Pipe"),
        (lambda: scene_of(HILLS, z=-0.6), ValueError, "behind surface 0, HeightField"),
        (lambda: scene_of((0.0, 0.0, 1.0)), TypeError, "must be Surface"),
    ],
)
def test_what_cannot_be_is_refused(build: Any, error: type[Exception], message: str) -> None:
    with pytest.raises(error, match=message):
        build()


def scene_of(*surfaces: Any, z: float = 0.3) -> Scene:
    return Scene(BEAD, [[0, 0, z]], surfaces=surfaces, contact=contact())
