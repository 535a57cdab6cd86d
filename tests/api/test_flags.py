"""Flags do what their docstrings claim."""

from __future__ import annotations

import inspect
from collections.abc import Callable
from contextlib import nullcontext
from importlib import import_module
from typing import Any

import numpy as np
import pytest

from springgym.dynamics.measures import Measures
from springgym.model.bodies import Body, cube, start, top
from springgym.model.scene import Scene, ThrustActuator, WrenchActuator
from springgym.simulator import SimulationDivergedError, Simulator

MODULES = (
    "springgym.model.bodies.body",
    "springgym.model.bodies.motion",
    "springgym.model.scene",
    "springgym.simulator",
)
TOP = top(ring=3)
CUBE = cube()
LEANING = start(TOP, tilt=0.5, azimuth=0.3, position=(0.0, 0.0, 1.0), stretched=False)


def flags() -> dict[str, Any]:
    """Return what has each flag: public classes, methods and functions by "name.flag"."""
    found: dict[str, Any] = {}
    for module in MODULES:
        for name, own in vars(import_module(module)).items():
            if getattr(own, "__module__", None) != module or name.startswith("_"):
                continue
            calls = {name: own} if inspect.isfunction(own) or "__init__" in vars(own) else {}
            if inspect.isclass(own):
                calls |= {n: f for n, f in vars(own).items() if inspect.isfunction(f) and n[0] != "_"}
            for place, call in calls.items():
                parameters = inspect.signature(call).parameters.values()
                found |= {f"{place}.{p.name}": call for p in parameters if p.annotation in (bool, "bool")}
    return found


def driven(scene: dict[str, Any], **acts: Any) -> Measures:
    """Return measures of a leaning top after a push at its actuators."""
    simulator = Simulator(Scene(TOP, *LEANING, gravity=None, **scene))
    simulator.actuate(**acts)
    simulator.advance(20)
    return simulator.measure()


def perpendicular(given: bool) -> None:
    told = driven({"wrench": WrenchActuator(perpendicular=given)}, torque=(0.2, 0.1, 1.0))
    along = float(told.angular_momentum[0] @ told.axis[0])
    across = np.linalg.norm(told.angular_momentum[0] - along * told.axis[0])
    assert across > 1e-3
    assert (abs(along) < 1e-3 * across) == given


def turns(given: bool) -> None:
    told = driven({"thrust": ThrustActuator((0,), turns=given)}, thrust=[(0.0, 0.0, 0.1)])
    pushed = told.momentum[0] / np.linalg.norm(told.momentum[0])
    np.testing.assert_allclose(pushed, told.axis[0] if given else (0.0, 0.0, 1.0), atol=0.01)


def floppy(given: bool) -> None:
    chain = ("chain", np.diag([0.0, 1.0, 2.0]), 1.0, [(0, 1), (1, 2)], 1e3, 0.0)
    if given:
        assert Body(*chain, floppy=True).floppy_modes() == 1
    else:
        with pytest.raises(ValueError, match="1 zero-energy mode"):
            Body(*chain, floppy=False)


def hanging(given: bool) -> None:
    (tip,) = TOP.parts["tip"]
    x, _ = start(TOP, pinned=(tip,), hanging=given)
    assert (TOP.masses @ x[:, 2] < x[tip, 2] * TOP.mass) == given


def stretched(given: bool) -> None:
    x, _ = start(TOP, spin=20.0, stretched=given)
    lengths = np.linalg.norm(np.diff(x[TOP.springs], axis=1)[:, 0], axis=1)
    assert (np.abs(lengths / TOP.lengths - 1).max() > 1e-6) == given


def ledger(given: bool) -> None:
    simulator = Simulator(Scene(CUBE, 1.01 * CUBE.positions, gravity=None), ledger=given)
    simulator.advance(100)
    assert (simulator.measure().damping_loss[0] > 0) == given


def place_check(given: bool) -> None:
    simulator = Simulator(Scene(CUBE))
    nowhere = np.zeros((8, 3))
    with pytest.raises(ValueError, match="it has no direction") if given else nullcontext():
        simulator.place(nowhere, nowhere, check=given)
    assert simulator.positions.any() == given


def place_read(given: bool) -> None:
    simulator = Simulator(Scene(CUBE))
    simulator.place(CUBE.positions + 1.0, np.zeros((8, 3)), read=given)
    assert np.array_equal(simulator.readout.positions[0], CUBE.positions + 1.0) == given


def advance_read(given: bool) -> None:
    simulator = Simulator(Scene(CUBE))
    simulator.advance(1, check=False, read=given)
    assert simulator.readout.positions.any() == given


def check(given: bool) -> None:
    simulator = Simulator(Scene(CUBE, gravity=None))
    simulator.place(2.0 * CUBE.positions, np.zeros((8, 3)))
    if given:
        with pytest.raises(SimulationDivergedError):
            simulator.advance(0, check=True)
    else:
        simulator.advance(0, check=False)


def state_parameters(given: bool) -> None:
    simulator = Simulator(Scene(CUBE), varying=("masses",))
    assert ("terms.particles.mass" in simulator.state(parameters=given)) == given


TRIED: dict[str, tuple[str, Callable[[bool], None]]] = {
    "WrenchActuator.perpendicular": (
        "If ``perpendicular``, only the component of the world torque perpendicular to the body's axis acts",
        perpendicular,
    ),
    "ThrustActuator.turns": ("along the world's axes or, if ``turns``, along the body's triad", turns),
    "Body.floppy": ("Whether the springs may leave the body free to change shape", floppy),
    "start.hanging": ("Whether the body hangs from its first pin", hanging),
    "start.stretched": ("Whether to start in the shape of a steady motion under the weight", stretched),
    "Simulator.ledger": ("Whether to record work and losses", ledger),
    "place.check": ("Whether to call `Scene.check_start`", place_check),
    "place.read": ("Whether to `read` them afterwards", place_read),
    "advance.read": ("Whether to `read` the copies afterwards", advance_read),
    "state.parameters": ("Whether the state holds the parameters that vary", state_parameters),
    "advance.check": ("Whether to check that no copy has diverged", check),
}
"""The claim in the docstring of what has each flag, and a trial of this claim."""

COLLIDING = {"pairs.forget"}
"""What `tests.collisions` tries, where a kernel of bodies that collide is compiled anyway."""


def test_every_flag_is_tried() -> None:
    assert flags().keys() == {*TRIED, *COLLIDING}


@pytest.mark.parametrize("given", [False, True])
@pytest.mark.parametrize("name", TRIED)
def test_a_flag_does_what_its_docstring_claims(name: str, given: bool) -> None:
    claim, trial = TRIED[name]
    assert claim in " ".join(flags()[name].__doc__.split())
    trial(given)
