"""The steps of all environments and scenes, and the refusals of others, are those recorded in steps.json.

Other default steps are other results: all baselines and pages then need new ones. To record them,
run ``python -m tests.test_steps``.
"""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any
from unittest import mock

import gymnasium as gym
import pytest

from springgym import Scene, Simulator, simulator
from springgym.envs.registration import ALL_IDS
from springgym.model.bodies import cube, rope, top
from springgym.scenes import load, names
from springgym.scenes.recording import record
from tests.envs.cases import IDS, task_type

pytestmark = pytest.mark.own_kernels

TABLE = Path(__file__).with_name("steps.json")


OPTIONS: dict[str, dict[str, Any]] = {
    "default": {},
    "rigid": {"dynamics": "rigid"},
    "randomized": {"randomize": {"masses": (0.5, 2.0), "stiffness": (0.5, 2.0), "damping": (0.5, 2.0)}},
    "randomized, rigid": {"dynamics": "rigid", "randomize": {"scale": (0.5, 2.0), "masses": (0.5, 2.0)}},
    "rk4": {"integrator": "rk4"},
    "no cycles": {"damping_every": 1},
    "short cycles": {"damping_every": 6},
    "odd cycles": {"damping_every": 3},
    "cycles of rigid bodies": {"dynamics": "rigid", "damping_every": 2},
    "200 steps": {"step": 200},
    "201 steps": {"step": 201},
    "201 steps in cycles": {"step": 201, "damping_every": 2},
    "part of a step": {"step": 200.5},
    "one step": {"step": 1, "randomize": {"masses": (0.5, 2.0)}},
    "one step, rigid": {"step": 1, "dynamics": "rigid"},
    "one step, dopri5": {"step": 1, "integrator": "dopri5"},
    "too many steps": {"step": 1e9},
    "too light": {"randomize": {"masses": (1e-12, 1.0)}},
}
"""Arguments of environments; ``step`` is the number of steps in a control period."""

TOP = Scene(top(), pinned=(0,))

SIMULATORS: dict[str, Callable[[], Simulator]] = {
    "cube": lambda: Simulator(Scene(cube())),
    "weak cube": lambda: Simulator(Scene(cube(stiffness=1.0)), integrator="rk4"),
    "rope with dampers": lambda: Simulator(Scene(rope(damping=1000.0), pinned=(0,))),
    "rigid cube": lambda: Simulator(Scene(cube()), dynamics="rigid"),
    "long step": lambda: Simulator(TOP, step=1.0),
    "long step of dopri5": lambda: Simulator(TOP, step=1.0, integrator="dopri5"),
    "long step of a rigid body": lambda: Simulator(TOP, step=1.0, dynamics="rigid"),
    "cycles": lambda: Simulator(TOP, damping_every=4),
    "odd cycles": lambda: Simulator(TOP, damping_every=3),
    "cycles of rk4": lambda: Simulator(TOP, integrator="rk4", damping_every=2),
    "cycles of a rigid body": lambda: Simulator(TOP, dynamics="rigid", damping_every=2),
    "cycles of a floppy body": lambda: Simulator(Scene(rope(damping=1.0)), damping_every=2),
    "dampers back in time": lambda: Simulator(TOP, integrator="pefrl"),
}


class Chosen(Exception):
    """What a simulator is packed for: method, step and cycle."""


def _packed(scene: Scene, rigid: bool, options: Any) -> Any:
    raise Chosen(options.method.name, options.step, options.every)


def chosen(make: Callable[[], object]) -> list[Any] | str:
    """Method, step [s] and cycle of the first simulator that a function makes, or the text of its refusal."""
    with mock.patch.object(simulator, "pack", _packed):
        try:
            make()
        except Chosen as found:
            return list(found.args)
        except ValueError as refusal:
            return str(refusal)
    raise AssertionError("the function makes no simulator")


def of_environment(env_id: str, options: dict[str, Any]) -> list[Any] | str:
    given = dict(options)
    if "step" in given:
        given["step"] = task_type(env_id).period / given["step"]
    return chosen(lambda: gym.make(env_id, disable_env_checker=True, **given))


def of_scene(name: str, dynamics: str) -> list[Any] | str:
    """The default step, be there another in the file."""
    return chosen(lambda: record(replace(load(name), step=None), dynamics=dynamics))


def cases() -> dict[str, Callable[[], list[Any] | str]]:
    """What chooses steps, by name."""
    found: dict[str, Callable[[], list[Any] | str]] = {}
    for env_id in ALL_IDS:
        for name, options in OPTIONS.items() if env_id in IDS else [("default", {})]:
            found[f"{env_id}, {name}"] = partial(of_environment, env_id, options)
    for name in names():
        for dynamics in ("springs", "rigid"):
            found[f"{name}, {dynamics}"] = partial(of_scene, name, dynamics)
    return found | {f"simulator: {name}": partial(chosen, make) for name, make in SIMULATORS.items()}


@pytest.mark.parametrize(
    "options",
    [
        {"step": 1.0},
        {"step": 1.0, "integrator": "dopri5"},
        {"step": 1.0, "dynamics": "rigid"},
        {"integrator": "euler"},
        {"integrator": "pefrl"},
        {"dynamics": "soft"},
        {"damping_every": 3},
        {"damping_every": 12},
        {"damping_every": 2, "integrator": "rk4"},
        {"damping_every": 2, "dynamics": "rigid"},
    ],
    ids=str,
)
def test_environments_refuse_in_the_words_of_a_simulator(options: dict[str, Any]) -> None:
    said = chosen(lambda: Simulator(task_type("SpringTop-v0")().scene, **options))
    assert isinstance(said, str)
    assert said == chosen(lambda: gym.make("SpringTop-v0", **options))


@pytest.mark.parametrize("group", [*ALL_IDS, "simulator", "scenes"])
def test_steps_are_the_recorded_ones(group: str) -> None:
    """Steps to rounding of the eigenvalues; methods, cycles and texts exactly."""
    table = json.loads(TABLE.read_text(encoding="utf-8"))
    mine = {
        name: case
        for name, case in cases().items()
        if name.startswith(group) or (group == "scenes" and not name.startswith(("Spring", "simulator")))
    }
    assert mine.keys() <= table.keys()
    for name, case in mine.items():
        found = case()
        if isinstance(found, list):
            assert found == [table[name][0], pytest.approx(table[name][1], rel=1e-9), table[name][2]], name
        else:
            assert found == table[name], name


def test_the_table_holds_no_others() -> None:
    assert cases().keys() == json.loads(TABLE.read_text(encoding="utf-8")).keys()


if __name__ == "__main__":
    rows = (f"{json.dumps(name)}: {json.dumps(case(), ensure_ascii=False)}" for name, case in cases().items())
    TABLE.write_text("{\n" + ",\n".join(rows) + "\n}\n", encoding="utf-8")
