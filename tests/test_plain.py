"""Compiled functions run by plain Python give what they give compiled: `springgym.core.plain`.

NUMBA_DISABLE_JIT=1 python -m tests.test_plain FILE CASES    # write what Python computes
"""

from __future__ import annotations

import ast
import inspect
import os
import subprocess
import sys
from collections.abc import Callable
from fractions import Fraction
from functools import cache
from pathlib import Path
from types import ModuleType
from typing import Any

import gymnasium as gym
import numpy as np
import pytest

import springgym  # noqa: F401  its environments
from springgym.bodies import cube, top
from springgym.core import lanes, plain, vec
from springgym.core.blocks import block_array
from springgym.core.compiling import INTERPRETED
from springgym.scene import Placed, Scene
from springgym.simulator import Simulator
from springgym.surfaces import Contact, floor
from tests.api.test_own import PULLED


def advanced(scene: Scene, steps: int, **options: Any) -> np.ndarray:
    """Return positions and velocities after some steps, and the measures then."""
    simulator = Simulator(scene, **options)
    simulator.advance(steps)
    measured = [np.ravel(value) for value in simulator.measure()]
    return np.concatenate([simulator.positions.ravel(), simulator.velocities.ravel(), *measured])


def an_environment() -> np.ndarray:
    env = gym.make("SpringTop-v0")
    seen = [env.reset(seed=0)[0]]
    observation, reward, *_ = env.step(np.full(env.action_space.shape, 0.3, np.float32))
    return np.concatenate([*seen, observation, [reward]])


def a_falling_cube() -> np.ndarray:
    """Return the state of a cube that reached the floor turned and slipping."""
    body = cube()
    x = body.positions - body.positions.min(axis=0) + [0.0, 0.0, 0.002]
    v = np.cross([1.0, 2.0, 0.0], x) + np.array([3.0, 0.0, -2.0])
    return advanced(Scene(body, x, v, surfaces=(floor(),), contact=Contact(0.4, 0.5)), 20)


def colliding_tops() -> np.ndarray:
    """Return the state of two tops that flew at each other, and met."""
    body = top()
    apart = np.ptp(body.positions[:, 0]) + 0.03
    placed = (
        Placed(body, body.positions + np.array([x, 0.0, 0.0]), [[v, 0.0, 0.0]] * len(body.masses), name=name)
        for name, x, v in (("left", 0.0, 20.0), ("right", apart, -20.0))
    )
    simulator = Simulator(Scene(bodies=tuple(placed), collisions="all"), unresolved="count")
    simulator.advance(8)
    assert simulator.pairs().impulse[0, 0] > 1.0
    return np.concatenate([simulator.positions.ravel(), simulator.velocities.ravel()])


def a_rigid_body() -> np.ndarray:
    body = top()
    v = np.cross([0.0, 1.0, 20.0], body.positions)
    return advanced(Scene(body, velocities=v, pinned=body.parts["tip"]), 5, dynamics="rigid")


def a_batch_with_own_forces() -> np.ndarray:
    return advanced(Scene(cube(), forces=PULLED), 2, copies=3, dtype=np.float32)


CASES: dict[str, Callable[[], np.ndarray]] = {
    case.__name__: case
    for case in (an_environment, a_falling_cube, colliding_tops, a_rigid_body, a_batch_with_own_forces)
}


SLOW = ("colliding_tops",)
LEFT = (*SLOW, "a_batch_with_own_forces")
"""What slow runs compute alone."""


@pytest.fixture(scope="module")
def found_by_python(tmp_path_factory: pytest.TempPathFactory) -> Callable[..., Any]:
    """Return a function that gives the results of cases from a process in which nothing is compiled."""
    folder, root = tmp_path_factory.mktemp("plain"), Path(__file__).parents[1]

    @cache
    def found(*cases: str) -> Any:
        file = folder / f"{cases[0]}.npz"
        command = [sys.executable, "-m", "tests.test_plain", str(file), *cases]
        env = {**os.environ, "NUMBA_DISABLE_JIT": "1"}
        subprocess.run(command, env=env, cwd=root, check=True, timeout=120)
        return np.load(file)

    return found


@pytest.mark.parametrize(
    "case",
    [pytest.param(name, marks=[pytest.mark.slow] * (name in LEFT)) for name in CASES],
)
def test_python_computes_what_is_compiled(case: str, found_by_python: Callable[..., Any]) -> None:
    """To the bit in double precision; in single precision, to its rounding."""
    asked = SLOW if case in SLOW else [name for name in CASES if name not in SLOW]
    interpreted, compiled = found_by_python(*asked)[case], CASES[case]()
    if case == "a_batch_with_own_forces":
        np.testing.assert_allclose(interpreted, compiled, rtol=1e-6, atol=1e-6)
    else:
        np.testing.assert_array_equal(interpreted, compiled)


TASKS = "tests/envs/test_colliding_tasks.py::test_"
FEW_STEPS = [
    "tests/collisions/test_rows.py::test_a_ball_that_comes_to_an_edge_is_outside",
    "tests/forces/test_resistance.py::test_ball_rolls_and_spins_ever_slower",
    *(f"{TASKS}{name}" for name in ("a_push_drives_ones_own_top", "both_players_see_the_same_duel")),
    *(f"{TASKS}{name}" for name in ("what_an_opponent_gives_is_checked", "weak_actuators_are_those_of_both")),
    *(f"{TASKS}{name}" for name in ("the_second_agent_sees_its_particles_first", "refusals_of_two_agents")),
    f"{TASKS}pettingzoo_s_registry_makes_it",
    "tests/envs/test_task_data.py::test_limits_are_what_actuators_are_given[SpringDuel-v0]",
    "tests/integrators/test_cycles.py::test_a_task_of_colliding_bodies_says_its_cycle",
    "tests/integrators/test_cycles.py::test_a_task_among_surfaces_says_its_cycle",
    "tests/integrators/test_cycles.py::test_where_there_is_contact_cycles_are_asked_for[bodies]",
    "tests/integrators/test_cycles.py::test_calls_cut_anywhere_give_the_same_bits[near the floor]",
]
"""Slow tests that need kernels of their own, but so few steps that Python takes less time than compiling
does: of the duel, of resistance to turning, and of dampers that act in cycles where there is contact."""


def test_few_steps_by_plain_python() -> None:
    command = [sys.executable, "-m", "pytest", "-n", "0", "-q", "-m", "slow", *FEW_STEPS]
    env, root = {**os.environ, "NUMBA_DISABLE_JIT": "1"}, Path(__file__).parents[1]
    done = subprocess.run(command, env=env, cwd=root, capture_output=True, text=True, timeout=300)
    assert done.returncode == 0, done.stdout
    assert f"{len(FEW_STEPS) + 1} passed" in done.stdout  # one of them has two cases


def test_a_product_and_a_sum_are_rounded_once() -> None:
    random = np.random.default_rng(0)
    for a, b, c in random.normal(size=(200, 3)):
        for near in (c, -a * b, -a * b * (1 + 2.0**-50)):
            exact = float(Fraction(a) * Fraction(b) + Fraction(near))
            assert plain.multiply_add(a, b, near) == exact
    assert plain.multiply_add(2.0, 3.0, -6.0) == 0.0
    assert np.signbit(plain.multiply_add(-0.0, 3.0, -0.0))
    assert plain.multiply_add(np.inf, 1.0, 2.0) == np.inf
    with np.errstate(all="ignore"):
        assert plain.multiply_add(1e300, 1e300, 1.0) == np.inf
        assert np.isnan(plain.multiply_add(np.inf, 0.0, 1.0))


def intrinsics(module: ModuleType) -> dict[str, list[str]]:
    """Names of the intrinsics of a module, and what they take besides the context."""
    tree = ast.parse(inspect.getsource(module))
    return {
        node.name: [argument.arg for argument in node.args.args[1:]]
        for node in tree.body
        if isinstance(node, ast.FunctionDef)
        and any(isinstance(one, ast.Name) and one.id == "intrinsic" for one in node.decorator_list)
    }


def test_every_intrinsic_has_a_stand_in() -> None:
    found = intrinsics(lanes) | intrinsics(vec)
    assert len(found) > 10
    for name, takes in found.items():
        assert list(inspect.signature(getattr(plain, name)).parameters) == takes, name


BLOCKS = block_array(20, (4, 3), float)[0]
LANES = plain.load(BLOCKS, (0, 0))


@pytest.mark.parametrize(
    "act",
    [
        lambda: plain.load(BLOCKS, (4, 0)),
        lambda: plain.load(BLOCKS, (-1, 0)),
        lambda: plain.store(BLOCKS, (0, 3), 1.0),
        lambda: plain.load_each(BLOCKS, (LANES + 4.0, 0)),
        lambda: plain.store_each(BLOCKS, (LANES - 1.0, 0), 1.0),
        lambda: plain.at(BLOCKS, -1),
        lambda: plain.at(BLOCKS, 4),
    ],
)
def test_python_checks_indices(act: Callable[[], Any]) -> None:
    with pytest.raises(IndexError, match=r"index .* on axis \d of length \d"):
        act()


def test_lanes_of_two_kinds_do_not_mix() -> None:
    other = plain.load(block_array(20, (4, 3), np.float32)[0], (0, 0))
    for act in (lambda: LANES + other, lambda: plain.select(LANES > 0.0, LANES, other)):
        with pytest.raises(TypeError, match="of different precision or width"):
            act()


if __name__ == "__main__":
    if not INTERPRETED:
        sys.exit("set NUMBA_DISABLE_JIT=1")
    np.savez(sys.argv[1], **{name: CASES[name]() for name in sys.argv[2:]})
