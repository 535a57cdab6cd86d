"""A force and a method of one's own: made as the tutorials say, and by nothing else."""

from __future__ import annotations

import copy
import pickle
from dataclasses import replace
from typing import Any, NamedTuple

import gymnasium as gym
import numpy as np
import pytest

from springgym import Placed, Scene, Simulator
from springgym.core.compiler.decorators import compiled, kernel
from springgym.core.language.blocks import block_array
from springgym.core.language.vectors import add_row, dot, row, vector
from springgym.dynamics.forces import accelerate, drift, kick
from springgym.dynamics.methods import METHODS, integrator, register
from springgym.dynamics.methods.record import Integrator
from springgym.model.bodies import Body, cube, rope, top
from springgym.model.own_forces import OfBody, add_own_forces, own_energy
from springgym.model.scene import DriveActuator


class Tether(NamedTuple):
    """A spring of no length from a particle to a fixed point."""

    particle: int
    anchor: np.ndarray
    stiffness: float

    @staticmethod
    @compiled
    def add(x: Any, force: Any, tether: Any) -> None:
        pull = vector(tether.anchor) - row(x, tether.particle)
        add_row(force, tether.particle, tether.stiffness * pull)

    @staticmethod
    @compiled
    def energy(x: Any, tether: Any) -> Any:
        pull = vector(tether.anchor) - row(x, tether.particle)
        return 0.5 * tether.stiffness * dot(pull, pull)


class Wind(NamedTuple):
    """A force that is the same everywhere: F = −∇U with U = −F · x."""

    particle: int
    push: np.ndarray

    @staticmethod
    @compiled
    def add(x: Any, force: Any, wind: Any) -> None:
        add_row(force, wind.particle, vector(wind.push))

    @staticmethod
    @compiled
    def energy(x: Any, wind: Any) -> Any:
        return -1.0 * dot(vector(wind.push), row(x, wind.particle))


BEAD = Body("bead", [[0.0, 0.0, 0.0]], 2.0, [], 1e5, 0.0)
ANCHOR = np.array([0.0, 0.0, 1.0])
CUBE = cube(damping=0.0)
PULLED = (Tether(0, ANCHOR, 50.0), Wind(3, np.array([1.0, 2.0, 3.0])), Tether(5, -ANCHOR, 20.0))


@pytest.mark.parametrize("method", ["verlet", "rk4"])
@pytest.mark.slow
def test_a_bead_on_a_tether_swings_as_an_oscillator(method: str) -> None:
    """z'' = −k/m (z − z₀), z₀ = 1 − m g/k, from rest at 0: z = z₀ (1 − cos ω t)."""
    simulator = Simulator(Scene(BEAD, forces=(Tether(0, ANCHOR, 50.0),)), integrator=method, step=1e-3)
    before = simulator.measure()
    simulator.advance(700)
    rest = 1.0 - 2.0 * 9.81 / 50.0
    omega = np.sqrt(50.0 / 2.0)
    expected = rest * (1 - np.cos(omega * 0.7))
    assert abs(expected) > 0.1
    allowed = {"verlet": omega**3 * 0.7 * 1e-6 / 24 * rest * 2, "rk4": 1e-10}[method]
    assert abs(simulator.positions[0, 0, 2] - expected) < allowed
    after = simulator.measure()
    height = simulator.positions[0, 0, 2]
    speed = simulator.velocities[0, 0, 2]
    np.testing.assert_allclose(after.elastic, 25.0 * (1 - height) ** 2, rtol=1e-12)
    np.testing.assert_allclose(after.kinetic, speed**2, rtol=1e-12)
    assert abs(after.balance - before.balance) < (omega * 1e-3) ** 2 * 25.0


def test_forces_of_several_kinds_act_with_their_energies() -> None:
    """What the measured energy says of the forces is what moves the particles: −dU/dt = F · v."""
    simulator = Simulator(Scene(CUBE, forces=PULLED), step=1e-5)
    simulator.advance(2000)
    first = simulator.measure()
    simulator.advance(2000)
    second = simulator.measure()
    assert abs(second.kinetic - first.kinetic) > 0.01
    assert abs(second.balance - first.balance) < 1e-6 * first.elastic


@pytest.mark.own_kernels
@pytest.mark.slow
def test_a_batch_a_body_in_company_and_a_pickle_are_the_same() -> None:
    single = Simulator(Scene(CUBE, forces=PULLED))
    batch = Simulator(Scene(CUBE, forces=PULLED), copies=3)
    aside = Placed(CUBE, np.add(CUBE.positions, (0.0, 0.0, 0.0)), forces=PULLED, name="pulled")
    company = Simulator(Scene(bodies=(Placed(CUBE, name="free"), aside), collisions=None))
    again = pickle.loads(pickle.dumps(single))
    for simulator in (single, batch, company, again):
        simulator.advance(200)
    np.testing.assert_array_equal(batch.positions, np.repeat(single.positions, 3, axis=0))
    np.testing.assert_array_equal(company.positions[:, 8:], single.positions)
    np.testing.assert_array_equal(company.measure("pulled").energy, single.measure().energy)
    np.testing.assert_array_equal(again.positions, single.positions)
    assert np.abs(company.positions[:, 8:] - company.positions[:, :8]).max() > 1e-4


class Everything(NamedTuple):
    """Takes arrays of each kind, and does nothing with them."""

    particles: Any
    values: Any

    @staticmethod
    @compiled
    def add(x: Any, force: Any, own: Any) -> None:
        pass

    @staticmethod
    @compiled
    def energy(x: Any, own: Any) -> Any:
        return 0.0


def test_a_scene_keeps_numbers_of_its_own() -> None:
    """Neither the arrays that a force was made of, nor those that a scene shows, move what is simulated."""
    particles = np.array([0, 3])
    anchor = np.asfortranarray([[0.0, 1.0], [2.0, 3.0]])
    scene = Scene(CUBE, forces=(Everything(particles, anchor),))
    simulator = Simulator(scene)
    before = pickle.dumps(scene.forces)
    particles[:] = 7
    anchor[:] = np.inf
    assert pickle.dumps(scene.forces) == before
    for kept in (scene, replace(scene), pickle.loads(pickle.dumps(scene)), copy.deepcopy(scene)):
        for field in kept.forces[0]:
            with pytest.raises(ValueError, match="read-only"):
                field[0] = 1
    (own,) = simulator._terms.own
    for given, taken in zip(scene.forces[0], own.force, strict=True):
        assert not np.shares_memory(given, taken)
        np.testing.assert_array_equal(given, taken)
        assert taken.flags.c_contiguous


@pytest.mark.parametrize("kind", ["u1", "i2", ">i4", "i8", "u8", "f2", "f4", ">f8", "f8", "O"])
def test_numbers_of_any_type_are_the_same_numbers(kind: str) -> None:
    given = np.array([3, 2]).astype(kind)
    (kept,) = Scene(CUBE, forces=(Everything((), given),)).forces
    np.testing.assert_array_equal(kept.values, [3, 2])
    assert kept.values.dtype == (np.int64 if given.dtype.kind in "iu" else np.float64)


@pytest.mark.parametrize(
    ("value", "says"),
    [
        (np.array([1, 2**63], np.uint64), r"values\[1\] is 9223372036854775808"),
        (np.array([2**63 + 2**40], np.uint64), r"values\[0\] is"),
        (np.array([-(2**63)]), r"values\[0\] is -9223372036854775808"),
        (np.array([[0.0, np.nan]]), r"values\[0, 1\] is nan"),
        (2**63, "values is 9223372036854775808"),
    ],
)
def test_numbers_that_would_become_others_are_refused(value: Any, says: str) -> None:
    with pytest.raises(ValueError, match=says):
        Scene(CUBE, forces=(Everything((), value),))


class Bare(NamedTuple):
    particle: int


class Uncompiled(NamedTuple):
    particle: int

    @staticmethod
    def add(x: Any, force: Any, own: Any) -> None: ...

    @staticmethod
    def energy(x: Any, own: Any) -> Any: ...


class Short(NamedTuple):
    """A force whose `add` takes two parameters in place of three."""

    particle: int

    @staticmethod
    @compiled
    def add(x: Any, force: Any) -> None: ...

    energy = Everything.energy


@pytest.mark.parametrize(
    ("make", "error", "says"),
    [
        (lambda: Scene(CUBE, forces=3), TypeError, "forces is 3; it must be a tuple of forces"),
        (lambda: Scene(CUBE, forces=PULLED[0]), TypeError, "it must be a tuple of forces"),
        (lambda: Scene(CUBE, forces=(3,)), TypeError, r"forces\[0\] is 3; it must be a named tuple"),
        (lambda: Scene(CUBE, forces=(Bare(1),)), TypeError, r"no compiled function add\(x, force, own\)"),
        (lambda: Scene(CUBE, forces=(Uncompiled(1),)), TypeError, r"springgym\.core\.compiled$"),
        (lambda: Scene(CUBE, forces=(Short(1),)), TypeError, r"add\(x, force\); it must be add\(x, f"),
        (lambda: Scene(CUBE, forces=(Tether(0, ANCHOR, "k"),)), TypeError, r"forces\[0\].stiffness is 'k'"),
        (lambda: Scene(CUBE, forces=(Tether(0, ANCHOR, np.nan),)), ValueError, "stiffness"),
        (lambda: Scene(CUBE, forces=(Tether(0, np.full(3, np.inf), 1.0),)), ValueError, "anchor"),
        (lambda: Scene(CUBE, forces=(Tether(0, np.array(["x"]), 1.0),)), TypeError, "anchor"),
        (lambda: Scene(CUBE, forces=(PULLED[0],) * 99), ValueError, "forces has 99 entries"),
        (lambda: Scene(CUBE, forces=(Tether(8, ANCHOR, 1.0),)), ValueError, r"forces\[0\].particle is 8"),
        (lambda: Scene(CUBE, forces=(Tether(-1, ANCHOR, 1.0),)), ValueError, r"particle is -1"),
        (lambda: Scene(CUBE, forces=(Tether(0.0, ANCHOR, 1.0),)), TypeError, r"particle is 0.0"),
        (
            lambda: Scene(rope(), pinned=(0,), drive=DriveActuator(0, 1.0), forces=PULLED),
            ValueError,
            "forces and a drive",
        ),
        (lambda: Simulator(Scene(top(), forces=PULLED), integrator="tr_bdf2"), ValueError, "tr_bdf2"),
        (lambda: Simulator(Scene(top(), forces=PULLED), dynamics="rigid"), ValueError, "forces"),
    ],
)
def test_what_is_no_force_is_refused(make: Any, error: type[Exception], says: str) -> None:
    with pytest.raises(error, match=says):
        make()


@kernel
def ask(x: Any, force: Any, own: Any) -> None:
    add_own_forces(x, force, own, 0)
    own_energy(x, own, 0)


def returns(x: Any, force: Any, own: Any) -> Any:
    return row(x, own.particle)


def adds_a_number(x: Any, force: Any, own: Any) -> None:
    add_row(force, own.particle, 3.0)


def asks_what_differs(x: Any, force: Any, own: Any) -> None:
    if row(x, own.particle)[2] < 0.0:
        add_row(force, own.particle, row(x, own.particle))


def returns_nothing(x: Any, own: Any) -> None:
    pass


def returns_a_vector(x: Any, own: Any) -> Any:
    return row(x, own.particle)


def asks_for_what_is_not(x: Any, own: Any) -> Any:
    return own.partikel


@pytest.mark.parametrize(
    ("function", "wrong", "says"),
    [
        ("add", returns, r"returns a vector; it must return nothing: it adds to force$"),
        ("add", adds_a_number, r"does not compile: .*getitem\(float64, .*test_own\.py, line \d+\)$"),
        ("add", asks_what_differs, r"does not compile: .*differs between copies; use select .*line \d+\)$"),
        ("energy", returns_nothing, r"returns nothing; it must return a number, the energy \[J\]$"),
        ("energy", returns_a_vector, r"returns a vector; it must return a number, the energy \[J\]$"),
        ("energy", asks_for_what_is_not, r"does not compile: .*partikel.*test_own\.py, line \d+\)$"),
    ],
)
def test_a_wrong_function_is_named(function: str, wrong: Any, says: str) -> None:
    """In a line, and not in all that Numba tried."""
    functions = {"add": Everything.add, "energy": Everything.energy} | {function: compiled(wrong)}
    kind: Any = type("Pushed", (NamedTuple("Pushed", [("particle", int)]),), functions)
    x = block_array(1, (8, 3), float)[0]
    with pytest.raises(TypeError, match=rf"^{function} of the force Pushed {says}"):
        ask(x, x, (OfBody(0, kind(3)),))


# --- A method -------------------------------------------------------------------------------------------


@compiled
def drift_kick_drift(x: Any, v: Any, ledger: Any, workspace: Any, h: Any, steps: Any, terms: Any) -> None:
    a = workspace[0]
    for _ in range(steps):
        drift(x, v, 0.5 * h)
        accelerate(x, a, None, terms)
        kick(v, a, h)
        drift(x, v, 0.5 * h)


LEAPFROG = Integrator(
    name="leapfrog",
    order=2,
    evaluations=1,
    imaginary_limit=2.0,
    real_limit=0.0,
    symplectic=True,
    negative_substeps=False,
    workspace=1,
    citation="Hairer, Lubich & Wanner, Geometric Numerical Integration, sec. I.1.4",
)


@pytest.mark.slow
def test_a_method_of_one_s_own_is_of_the_order_it_says() -> None:
    register(LEAPFROG, drift_kick_drift)
    assert integrator("leapfrog") is LEAPFROG
    scene = Scene(CUBE, 1.01 * CUBE.positions, gravity=None)
    exact = Simulator(scene, integrator="blanes_moan", step=1e-5)
    exact.advance(500)
    errors = []
    for halvings in (0, 1):
        simulator = Simulator(scene, integrator="leapfrog", step=2.5e-5 / 2**halvings)
        simulator.advance(200 * 2**halvings)
        errors.append(np.abs(simulator.positions - exact.positions).max())
    assert errors[0] > 1e-7
    np.testing.assert_allclose(errors[0] / errors[1], 4.0, rtol=0.05)
    with pytest.raises(ValueError, match="leapfrog on this body allows at most"):
        Simulator(scene, integrator="leapfrog", step=1e-2)


def test_a_method_without_dampers_says_so() -> None:
    """And not that it wants steps of no length; asked of the scene that would be simulated."""
    register(LEAPFROG, drift_kick_drift)
    for make in (
        lambda: Simulator(Scene(cube()), integrator="leapfrog"),
        lambda: Simulator(Scene(CUBE), integrator="leapfrog", varying=("damping",)),
        lambda: gym.make("SpringTop-v0", integrator="leapfrog"),
    ):
        with pytest.raises(ValueError, match="leapfrog cannot handle dampers"):
            make()
    with pytest.raises(ValueError, match="pefrl takes substeps back in time"):
        gym.make("SpringTop-v0", integrator="pefrl")


@pytest.mark.parametrize(
    ("wrong", "error", "says"),
    [
        ({"name": ""}, ValueError, "name is ''; it must be one word"),
        ({"name": "leap frog"}, ValueError, "name is 'leap frog'; it must be one word"),
        ({"name": None}, TypeError, "name is None; it must be str"),
        ({"order": 0}, ValueError, "order is 0; it must be a whole number, at least 1"),
        ({"order": 2.0}, TypeError, "order is 2.0; it must be a whole number"),
        ({"evaluations": -1}, ValueError, "evaluations is -1; it must be a whole number, at least 1"),
        (
            {"imaginary_limit": np.nan},
            ValueError,
            "imaginary_limit is nan; it must be a number from 0 to inf",
        ),
        ({"real_limit": np.nan}, ValueError, "real_limit is nan; it must be a number from 0 to inf"),
        ({"real_limit": -1.0}, ValueError, "real_limit is -1.0; it must be a number from 0 to inf"),
        ({"imaginary_limit": "2"}, TypeError, "imaginary_limit is '2'; it must be a number"),
        ({"workspace": -1}, ValueError, "workspace is -1; it must be a whole number, at least 0"),
        ({"symplectic": 1}, TypeError, "symplectic is 1; it must be True or False"),
        ({"meets_surfaces": "no"}, TypeError, "meets_surfaces is 'no'; it must be True or False"),
        ({"citation": 3}, TypeError, "citation is 3; it must be str"),
    ],
)
def test_facts_that_cannot_be_are_refused(wrong: Any, error: type[Exception], says: str) -> None:
    with pytest.raises(error, match=says):
        replace(LEAPFROG, **wrong)


def test_what_is_no_method_is_refused() -> None:
    with pytest.raises(TypeError, match="record is 'verlet'"):
        register("verlet", drift_kick_drift)  # type: ignore[arg-type]
    with pytest.raises(TypeError, match="decorated with"):
        register(LEAPFROG, lambda *arguments: None)
    with pytest.raises(
        TypeError, match=r"integrate takes \(x, force, tether\); it must take \(x, v, ledger, "
    ):
        register(LEAPFROG, Tether.add)
    with pytest.raises(ValueError, match="a built-in integrator"):
        register(integrator(METHODS[0]), drift_kick_drift)
    with pytest.raises(ValueError, match="unknown integrator 'hop'; choose from: verlet, symplectic_euler"):
        Simulator(Scene(CUBE), integrator="hop")
