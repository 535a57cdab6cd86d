"""Every argument of every public function and class of `springgym.model.bodies`, given what it could not
be."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import Any

import numpy as np
import pytest

from springgym.model.bodies import (
    Body,
    InitialState,
    Round,
    box,
    capsule,
    cube,
    disk,
    ellipsoid,
    ellipsoid_of,
    from_mesh,
    from_points,
    gyroscope,
    relative_equilibrium,
    rigid_velocities,
    rim,
    rolling_ball,
    rope,
    rotation,
    softened,
    solid_box,
    solid_hull,
    solid_rope,
    solid_top,
    sphere,
    start,
    stretched_shapes,
    top,
    union,
    vibrations,
)
from springgym.model.bodies.precession import heavy_top, precession_gap, wobble_growth
from springgym.model.materials import MATERIALS, Grain, Material
from springgym.theory.top import HeavyTop
from tests.api.values import KINDS, NUMBERS, Door, arrays, attempt, door
from tests.params import slow_unless

CUBE = cube()
TOP = top(ring=5)
LARGE = top(ring=300)
TETRAHEDRON = [(0, 0, 0), (1, 0, 0), (0, 1, 0), (0, 0, 1)]

DOORS: list[Door] = [
    door(
        Body,
        name="tetrahedron",
        positions=TETRAHEDRON,
        masses=np.ones(4),
        springs=[(0, 1), (0, 2), (0, 3), (1, 2), (1, 3), (2, 3)],
        stiffness=np.ones(6),
        damping=np.ones(6),
        lengths=np.ones(6),
        rounds=(sphere(1.0),),
        markers=(0, 1, 2),
        parts={"tip": (3,)},
        triangles=[(0, 1, 2)],
    ),
    door(box, mass=np.ones(8)),
    door(cube),
    door(top, ring=5, scaled={0: 2.0}),
    door(gyroscope, ring=5),
    door(rope),
    door(from_points, points=TETRAHEDRON, mass=np.ones(4), centre_mass=1.0),
    door(union, bodies=(CUBE, box().with_(positions=box().positions + np.eye(3)[0]))),
    door(start, body=TOP, tilt=0.0, pinned=TOP.parts["tip"], gravity=(0.0, 0.0, -1.0)),
    door(rotation, axis=(0.0, 0.0, 1.0), angle=1.0),
    door(rigid_velocities, positions=np.ones((4, 3)), omega=(0.0, 0.0, 1.0), about=(0.0, 0.0, 0.0)),
    door(relative_equilibrium, body=TOP, omega=(0, 0, 1.0), pinned=(6,), gravity=(0.0, 0.0, -1.0)),
    door(stretched_shapes, body=TOP, axis=(0.0, 0.0, 1.0), fastest=10.0, pinned=(6,)),
    door(stretched_shapes(TOP, (0, 0, 1), 10.0, (6,)), spin=1.0),
    door(CUBE.inertia, about=(0.0, 0.0, 0.0)),
    door(CUBE.principal, about=(0.0, 0.0, 0.0)),
    door(CUBE.floppy_modes, pinned=(0,)),
    door(TOP.particle, name="tip"),
    door(Material, name="clay", young=1e9, poisson=0.3, density=2e3, loss=0.1, sources={"loss": "a book"}),
    door(Material, name="fir", young=12.9e9, poisson=0.35, density=7e2, grain=MATERIALS["oak"].grain),
    door(Grain, **vars(MATERIALS["oak"].grain)),
    door(MATERIALS["oak"].softened, factor=2.0),
    door(solid_top, radius=0.03, height=0.04, material="steel", ring=5),
    door(solid_box, sides=(0.03, 0.02, 0.02), material="oak"),
    door(solid_hull, points=TETRAHEDRON, material="steel"),
    door(solid_rope, material="nylon", diameter=0.01),
    door(softened, body=TOP, factor=2.0),
    door(Round, matrix=np.eye(3), centre=(0.0, 0.0, 0.1), particles=(0, 1, 2, 3)),
    door(sphere, radius=0.1, centre=(0.0, 0.0, 0.1), particles=(0, 1, 2, 3)),
    door(ellipsoid_of, semi_axes=(0.1, 0.2, 0.3), centre=(0.0, 0.0, 0.1), particles=(0, 1, 2, 3)),
    door(rim, radius=0.1, axis=(0.0, 0.0, 1.0), centre=(0.0, 0.0, 0.1), particles=(0, 1, 2, 3)),
    door(rolling_ball, radius=0.1, mass=1.0, moment=0.4, stiffness=1e5, damping=1.0),
    door(
        ellipsoid,
        semi_axes=(0.1, 0.2, 0.3),
        mass=1.0,
        inertia=(0.01, 0.01, 0.01),
        centre_of_mass=(0.0, 0.0, 0.0),
        stiffness=1e5,
        damping=1.0,
    ),
    door(disk, radius=0.1, mass=1.0, thickness=0.01, stiffness=1e5, damping=1.0),
    door(capsule, radius=0.1, length=0.3, mass=1.0, stiffness=1e5, damping=1.0),
    door(vibrations, body=TOP),
    door(heavy_top, body=TOP, pinned=(6,), gravity=(0.0, 0.0, -1.0)),
    door(precession_gap, body=TOP, pinned=(6,), gravity=(0.0, 0.0, -1.0), tilt=0.3, spin=40.0),
    door(wobble_growth, body=TOP, spin=20.0),
]


USUAL = ("Body", "cube", "top", "start", "Material", "Round")
"""What every run gives wrong arguments to."""


def wrong_for(right: Any) -> list[Any]:
    """Return what an argument could be given in place of what is right."""
    held = [CUBE, [CUBE], [CUBE, CUBE], (CUBE, LARGE), {0: 0.0}, {0: np.nan}, {99: 1.0}, {0.5: 1.0}]
    held += [{"tip": 3}, {"tip": ()}, {"tip": (9,)}, {"tip": (-1,)}, {3: (3,)}, {"tip": (0.5,)}]
    held += [(0, 1), (0, 0), (-1,), (99,), (0.5,), (True,), [True] * 4, [False] * 8]
    held += [(0, 1, 2), (0, 0, 1), (3, 2, 1)]
    if isinstance(right, (tuple, list, np.ndarray)) and not isinstance(right[0], (Body, Round)):
        held += arrays(np.shape(right))
    return KINDS + NUMBERS + held


@pytest.mark.parametrize(
    ("call", "right"),
    [
        pytest.param(call, right, id=name, marks=slow_unless(name in USUAL))
        for call, right in DOORS
        for name in [getattr(call, "__name__", type(call).__name__)]
    ],
)
def test_an_argument_is_refused_by_name_or_right(call: Callable[..., Any], right: dict[str, Any]) -> None:
    """Whatever it is: refused, or the result holds finite numbers, and no warning is given."""
    for argument in right:
        refused = 0
        for value in wrong_for(right[argument]):
            given = right | {argument: value}
            result = attempt([argument, *right], value, partial(call, **given), KeyError)
            refused += result is None
            for held in finite_numbers(result):
                assert np.isfinite(held).all(), (argument, value)
        assert refused > len(KINDS) / 2, argument


def finite_numbers(result: Any) -> list[Any]:
    if isinstance(result, Body):
        assert min(result.masses.min(), result.stiffness.min(initial=1), result.lengths.min(initial=1)) > 0
        assert all(0 <= i < len(result.masses) and type(i) is int for i in result.markers)
        held = ("positions", "masses", "stiffness", "damping", "lengths", "mass")
        return [getattr(result, name) for name in held]
    if isinstance(result, Round):
        return [result.matrix, result.centre, result.extent]
    if isinstance(result, (Material, Grain, HeavyTop)):
        return [value for value in vars(result).values() if isinstance(value, float)]
    if isinstance(result, (InitialState, tuple)):
        return list(result)
    return [] if result is None else [getattr(result, "coefficients", result)]


@pytest.mark.parametrize("argument", ["path", "mass", "by", "scale", "stiffness", "damping"])
def test_an_argument_of_a_mesh(argument: str, tmp_path: Any) -> None:
    file = tmp_path / "tetrahedron.obj"
    corners = "".join(f"v {x} {y} {z}\n" for x, y, z in TETRAHEDRON)
    file.write_text(corners + "f 1 3 2\nf 1 2 4\nf 1 4 3\nf 2 3 4\n")
    right = {"path": file, "mass": 1.0, "by": "volume", "scale": 1.0, "stiffness": 1.0, "damping": 1.0}
    for value in (*KINDS, *NUMBERS, tmp_path, "colour"):
        names = [argument, *right]
        result = attempt(names, value, lambda value=value: from_mesh(**right | {argument: value}), OSError)
        assert result is None or np.isfinite(result.positions).all()
