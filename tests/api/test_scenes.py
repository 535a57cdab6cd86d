"""Every argument of scenes, surfaces, contacts and actuators, given what it could not be."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from springgym.model.bodies import cube
from springgym.model.scene import DriveActuator, Placed, Scene, ThrustActuator, WrenchActuator
from springgym.model.surfaces import (
    Bowl,
    Contact,
    HeightField,
    PaperContact,
    Pipe,
    Plane,
    floor,
    incline,
    waves,
)
from tests.api.values import KINDS, NUMBERS, arguments, arrays, attempt, door

CUBE = cube()
PLACE = CUBE.positions + np.eye(3)[2]

DOORS = [
    door(Plane),
    door(Bowl, centre=(0.0, 0.0, 1.0), radius=1.0),
    door(Pipe, point=(0.0, 0.0, 1.0), axis=(1.0, 0.0, 0.0), radius=1.0),
    door(HeightField, heights=np.eye(3), spacing=0.5, corner=(0.0, 0.0)),
    door(waves, amplitude=0.1, length=1.0, size=2.0, spacing=0.1, level=0.0),
    door(floor),
    door(incline, angle=0.3),
    door(Plane().height, positions=np.ones((4, 3))),
    door(Bowl((0.0, 0.0, 1.0), 1.0).height, positions=np.ones((4, 3))),
    door(Contact),
    door(PaperContact),
    door(WrenchActuator),
    door(ThrustActuator, particles=(0, 3)),
    door(DriveActuator, particle=0, speed=1.0),
    door(
        Scene,
        body=CUBE,
        positions=PLACE,
        velocities=np.zeros((8, 3)),
        pinned=(0, 3),
        gravity=(0.0, 0.0, -1.0),
        wrench=WrenchActuator(),
        thrust=ThrustActuator((1,)),
        drive=DriveActuator(3, 1.0),
        surfaces=(floor(),),
        contact=Contact(),
    ),
    door(
        Placed,
        body=CUBE,
        positions=PLACE,
        velocities=np.zeros((8, 3)),
        pinned=(0, 3),
        wrench=WrenchActuator(),
        thrust=ThrustActuator((1,)),
        drive=DriveActuator(3, 1.0),
        name="cube",
    ),
]

SURFACES = [
    *(
        floor(),
        (floor(), None),
        (floor(), 1),
        [Plane()],
        (Bowl((0, 0, 1), 5.0),),
        (Bowl((0, 0, 1), 5.0), Plane()),
    ),
    *((Plane(), Plane((0, 0, 1e-9), (0, 0, -1))), (Plane(), Plane(normal=(1, 0, -1))), (floor(0.9),)),
    *((floor(),) * 101, (floor(1e30),), (floor(-1e30),), (Plane(normal=(1e-20, 0, 1e20)),)),
]
CONTACTS = [
    *(
        Contact(reach=1e29),
        Contact(reach=1e-30),
        Contact(strength=1e30),
        Contact(strength=1e-30),
        PaperContact(),
    ),
    *(Contact(friction=1e30), Contact(restitution=0, strength=1e30), Contact(0.1, 0.5, 1e-30)),
]
ACTUATORS = [
    *(WrenchActuator, WrenchActuator(), ThrustActuator(()), ThrustActuator((7, 7)), ThrustActuator((8,))),
    *(DriveActuator(0, 1.0), DriveActuator(1, 1.0), DriveActuator(8, 1.0)),
]
PARTICLES = [
    (0, 3),
    (3,),
    (0, 0, 3),
    range(8),
    [-1],
    [8],
    [True] * 8,
    [False] * 8,
    [True] * 7,
    (0.5,),
    [[0]],
    {0, 3},
]


@pytest.mark.parametrize(("number", "argument"), arguments(DOORS))
def test_an_argument_is_refused_by_name_or_right(number: int, argument: str) -> None:
    """Whatever it is: refused, or what is made holds finite numbers, and no warning is given."""
    call, right = DOORS[number]
    values = KINDS + NUMBERS + SURFACES + CONTACTS + ACTUATORS + PARTICLES
    if (
        isinstance(right[argument], (tuple, np.ndarray))
        and np.ndim(right[argument])
        and argument not in ("surfaces", "bodies", "forces")
    ):
        values = values + arrays(np.shape(right[argument]))
    refused = 0
    for value in values:
        names = [argument, *right, "particle", "spring"]
        result = attempt(names, value, lambda value=value: call(**right | {argument: value}))
        refused += result is None
        if result is not None:
            check(result)
    assert refused > len(KINDS) / 2


def check(result: Any) -> None:
    """Assert that what is made holds finite numbers of the types that compiled code is given."""
    if isinstance(result, (Scene, Placed)):
        if isinstance(result, Scene):
            assert result.gravity is None or [type(n) for n in result.gravity] == [float] * 3
            assert isinstance(result.surfaces, tuple)
        assert all(type(i) is int and 0 <= i < 8 for i in result.pinned)
        assert len(set(result.pinned)) == len(result.pinned)
        result = (result.positions, result.velocities)
    elif not isinstance(result, (np.ndarray, np.generic)):
        result = [value for value in vars(result).values() if value is not None]
        while any(isinstance(value, tuple) for value in result):
            result = [n for value in result for n in (value if isinstance(value, tuple) else (value,))]
        assert {type(value) for value in result} <= {int, float, bool}
    result = result if isinstance(result, (list, tuple)) else [result]
    assert all(np.isfinite(value).all() for value in result)


def test_what_starts_is_checked_where_scenes_and_simulators_do() -> None:
    """A pin at rest, a drive no faster than it is, ends of springs apart, particles above surfaces."""
    moving = np.zeros((8, 3))
    moving[3] = (0.0, 2.0, 0.0)
    for drive, message in (
        (None, "pinned particle 3 has a velocity; it must be zero"),
        (DriveActuator(3, 1.0), "particle 3 starts faster than its drive moves it, 1 m/s at most"),
    ):
        with pytest.raises(ValueError, match=message):
            Scene(CUBE, PLACE, moving, pinned=(3,), drive=drive)
    assert Scene(CUBE, PLACE, moving, pinned=(3,), drive=DriveActuator(3, 2.0)).pinned == (3,)
    with pytest.raises(ValueError, match="spring 0 starts with both ends at the same position"):
        Scene(CUBE, np.ones((8, 3)))


@pytest.mark.parametrize("gravity", [9.81, 0])
def test_gravity_that_is_a_number_is_told_to_be_a_vector(gravity: Any) -> None:
    with pytest.raises(ValueError, match=rf"gravity is {gravity}; it must be a vector, such as .* or None"):
        Scene(cube(), gravity=gravity)
