"""Misspelt arguments are answered with a suggestion; changed fields are blamed, not those that are kept."""

from __future__ import annotations

import copy
import inspect
import pickle
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from springgym import Placed, Scene, Simulator, rendering, scenes
from springgym.checks import refusing_unknown
from springgym.envs.observation import Entry
from springgym.model import bodies, surfaces
from springgym.model.bodies import Body, cube, top
from springgym.model.collisions import Pair
from springgym.model.materials import Grain, Material
from springgym.model.scene import DriveActuator, ThrustActuator, WrenchActuator
from springgym.scenes.checks.basis import Check, within
from springgym.scenes.film import save_film
from springgym.scenes.plan import View
from springgym.scenes.recording import record

RESULTS = ("InitialState", "SURFACES", "Surface", "names")
"""Public names of what users do not call with arguments."""

PUBLIC = [
    getattr(module, name)
    for module in (bodies, surfaces, rendering, scenes)
    for name in module.__all__
    if name not in RESULTS
]
PUBLIC += [Scene, Placed, Simulator, WrenchActuator, ThrustActuator, DriveActuator, Pair, Grain, Material]
PUBLIC += [View, Entry, Check, within, record, save_film]


def misspelt(name: str) -> str:
    return name[:-2] + name[-1] if len(name) > 3 else f"{name}s"


@pytest.mark.parametrize("called", PUBLIC, ids=lambda called: called.__name__)
def test_a_misspelt_argument_is_answered_with_a_suggestion(called: Any) -> None:
    name = next(reversed(inspect.signature(called).parameters))
    with pytest.raises(TypeError) as error:
        called(**{misspelt(name): 1})
    said = str(error.value)
    assert said.startswith(f"{called.__name__} has no argument {misspelt(name)!r}; did you mean '"), said
    assert error.value.__suppress_context__


@pytest.mark.parametrize(
    ("change", "says"),
    [
        (lambda: cube().with_(position=1), "Body has no argument 'position'; did you mean 'positions'?"),
        (lambda: replace(cube(), position=1), "Body has no argument 'position'; did you mean 'positions'?"),
        (lambda: Scene(cube()).with_(gravty=1), "Scene has no argument 'gravty'; did you mean 'gravity'?"),
        (
            lambda: Simulator.paper(Scene(cube()), stp=1),
            "Simulator has no argument 'stp'; did you mean 'step'?",
        ),
    ],
)
def test_a_misspelt_change_is_answered_with_a_suggestion(change: Any, says: str) -> None:
    with pytest.raises(TypeError) as error:
        change()
    assert str(error.value) == says


def test_other_errors_and_signatures_stay() -> None:
    """Errors inside of a function are its own, and what documents and copies it sees no difference."""
    with pytest.raises(TypeError, match="side is 'x'"):
        cube(side="x")  # type: ignore[arg-type]
    with pytest.raises(TypeError, match="positional argument"):
        cube(1.0, 1.0, 1.0, 1.0, 1.0)  # type: ignore[call-arg]
    assert list(inspect.signature(cube).parameters) == ["side", "mass", "stiffness", "damping"]
    assert next(iter(inspect.signature(Body).parameters)) == "name"
    assert cube.__doc__
    assert inspect.unwrap(cube) is not cube
    assert pickle.loads(pickle.dumps(cube)) is cube
    assert copy.deepcopy(cube()).name == "cube"


def test_a_class_without_init_of_its_own_keeps_its_parent_s() -> None:
    class Parent:
        def __init__(self, side: float = 1.0) -> None:
            self.side = side

    @refusing_unknown
    class Child(Parent):
        pass

    assert Child(side=2.0).side == 2.0
    with pytest.raises(TypeError, match="Child has no argument 'sid'; did you mean 'side'"):
        Child(sid=2.0)  # type: ignore[call-arg]
    with pytest.raises(TypeError, match="unexpected keyword"):
        Parent(sid=2.0)  # type: ignore[call-arg]


CUBE = cube()


@pytest.mark.parametrize(
    ("change", "says"),
    [
        (lambda: CUBE.with_(positions=np.zeros((3, 3))), "positions is .*, of 3 rows; it must have 8"),
        (lambda: CUBE.with_(springs=CUBE.springs[:5]), "springs is .*, of 5 rows; it must have 28"),
        (lambda: CUBE.with_(springs=[(0, 1)], stiffness=1.0), "unless you change damping, lengths, too"),
        (lambda: CUBE.with_(positions=5), "positions is 5, of shape"),
        (lambda: Scene(CUBE).with_(body=top()), "body is .*, of 14 particles; it must have 8"),
        (lambda: Scene(CUBE).with_(body=top(), positions=None), "unless you change velocities, too"),
    ],
)
def test_the_changed_field_is_blamed(change: Any, says: str) -> None:
    with pytest.raises(ValueError, match=says):
        change()


def test_a_body_is_exchanged_with_its_start() -> None:
    scene = Scene(CUBE).with_(body=top(), positions=None, velocities=None)
    assert len(scene.positions) == 14
    assert len(CUBE.with_(springs=CUBE.springs[:-1], stiffness=1e5, damping=0, lengths=None).springs) == 27
