"""What docstrings and controllers tell of a task is what the task says: limits, period, units, sizes."""

from __future__ import annotations

import re
from collections.abc import Iterator
from importlib import import_module
from typing import Any, NamedTuple

import gymnasium as gym
import numpy as np
import pytest

from springgym.dynamics import measures
from springgym.envs.episodes import OptionsProbe
from springgym.envs.observation import ABOUT_CENTRE, ABOUT_GOAL, Situation
from springgym.envs.randomisation import NOMINAL
from springgym.envs.registration import ENVIRONMENTS, Row
from springgym.envs.task import Task
from springgym.envs.tasks import free_top, juggle, labyrinth
from springgym.simulator import Simulator
from tests.envs.cases import DUEL, task_type
from tests.params import slow_unless

each_row = pytest.mark.parametrize("row", ENVIRONMENTS, ids=lambda row: row.id)
each_row_but_a_duel = pytest.mark.parametrize(
    "row", [pytest.param(row, id=row.id, marks=slow_unless(row.id != DUEL)) for row in ENVIRONMENTS]
)


def documentation(row: Row) -> str:
    text = getattr(import_module(f"springgym.envs.tasks.{row.module}"), f"{row.name}Env").__doc__
    return str(text).replace("−", "-")


class Line(NamedTuple):
    """A line of a table of a docstring."""

    mode: str
    first: int
    last: int
    told: str
    """the last column"""


def table(text: str, title: str) -> Iterator[Line]:
    """Lines of the table in a section; an empty mode is that of the line above."""
    mode = ""
    for line in text.split(f"## {title}\n")[1].split("\n    ## ")[0].splitlines():
        cells = [cell.strip() for cell in line.strip().strip("|").split("|")]
        if line.strip().startswith("|") and (entries := re.fullmatch(r"(\d+)(?:(?:–|, )(\d+))?", cells[1])):
            mode = cells[0].strip('`"') or mode
            first = int(entries[1])
            yield Line(mode, first, int(entries[2] or first), cells[-1])


def number(text: str) -> float:
    """The first number in a text, π being left out."""
    found = re.search(r"\d+(?:\.\d+)?", text)
    assert found, text
    return float(found[0])


@each_row
def test_limits_of_actions(row: Row) -> None:
    lines = list(table(documentation(row), "Action Space"))
    for action, size in task_type(row.id).actions.items():
        limits = task_type(row.id)(action=action).limits
        assert limits.shape == (size,)
        told = np.full(size, np.nan)
        for line in lines:
            if line.mode == action:
                told[line.first : line.last + 1] = number(line.told)
        if not lines:  # one mode, told in words
            told[:] = number(documentation(row).split("±1 is ±")[1])
        np.testing.assert_allclose(told, limits, rtol=0.03)  # as it is rounded there


def test_what_the_torque_of_the_free_top_does_is_told_too() -> None:
    (row,) = (row for row in ENVIRONMENTS if row.id == "SpringFreeTop-v0")
    assert number(documentation(row).split("accelerates the ring by")[1]) == free_top.RING_ACCELERATION


@each_row_but_a_duel
def test_limits_are_what_actuators_are_given(row: Row) -> None:
    """At ±1, one entry after the other, beside what always acts; an impulse is a force for a period."""
    for action, size in task_type(row.id).actions.items():
        task = task_type(row.id)(action=action)
        driven = task.actuate(np.eye(size))
        idle = task.actuate(np.zeros((size, size)))
        largest = np.zeros(size)
        for name, values in driven.items():
            moved = np.linalg.norm((values - idle[name]).reshape(size, -1, 3), axis=-1).max(axis=1)
            largest = np.maximum(largest, moved * (task.period if impulses(action) else 1.0))
            assert name in Simulator(task.scene)._actuators
        if not driven and task.move:  # it moves what the goal holds
            moved = moved_goals(task, np.eye(size)) - moved_goals(task, np.zeros((size, size)))
            largest = np.abs(moved).max(axis=1) / task.period
        if action in PULLED:  # if its goal says so; the crane also lets go of what it holds
            pulls = [pulled(task, PULLED[action], own) for own in (np.eye(size), np.zeros((size, size)))]
            largest = np.linalg.norm(pulls[0] - pulls[1], axis=1)
            largest += np.abs(moved).max(axis=1) if action == "crane" else 0.0
        np.testing.assert_allclose(largest, task.limits, rtol=1e-12)


def situation(task: Task, action: np.ndarray, goal: np.ndarray) -> Situation:
    """The situation of actions (n, A) and goals (n, G) at the start of an episode, all else being zero."""
    x = np.zeros((len(action), *task.scene.positions.shape))
    memory = np.tile(task.memory, (len(action), 1))
    return Situation(x, x, action, goal, np.zeros(len(action)), memory, task.parameters)


def nothing_measured(task: Task, copies: int) -> Any:
    """Measures that are zero, of the one body or of each."""
    bodies = len(task.scene.bodies)
    return measures.view(
        np.zeros((copies, measures.SIZE) if bodies == 1 else (copies, bodies, measures.SIZE))
    )


def moved_goals(task: Task, action: np.ndarray) -> np.ndarray:
    """Goals (n, G) after a period of actions (n, A), from zero."""
    goal = np.zeros((len(action), task.goal_size))
    task.move(nothing_measured(task, len(action)), situation(task, action, goal), goal)
    return goal


PULLED = {"crane": "block1.thrust", "stroke": "cue.thrust"}
"""Actions, and what they drive where all numbers of the goal are 1."""


def pulled(task: Task, actuator: str, action: np.ndarray) -> np.ndarray:
    """Force (n, 3) that an actuator gets for actions (n, A); all others are left alone."""
    goal = np.ones((len(action), task.goal_size))
    forces = task.respond(nothing_measured(task, len(action)), situation(task, action, goal))
    assert all((forces[name] == 0.0).all() for name in forces if name != actuator)
    return forces[actuator].sum(axis=1)


def impulses(action: str) -> bool:
    return action in ("impulse", "impulses", "thrusters")


@each_row
def test_limits_of_the_hard_variant(row: Row) -> None:
    """Such as "…torques up to 10 N·m" of hard=True: what is told is what it does, for every action."""
    bullet = re.search(r"- `hard=True`: (.*?)\n    (?:- |$)", documentation(row), re.S)
    if bullet is None:
        pytest.skip("it has no hard variant")
    told = [float(n) for n in re.findall(r"(\d+(?:\.\d+)?) (?:N|rad/s)", bullet[1])]
    changed = set()
    for action in task_type(row.id).actions:
        usual, hard = (task_type(row.id)(action=action, hard=flag).limits for flag in (False, True))
        changed |= set(np.round(hard[hard != usual], 12).tolist())
    assert changed == set(told)


@each_row
def test_period_limit_and_hold(row: Row) -> None:
    text = documentation(row)
    task = task_type(row.id)
    unit = "steps" if row.max_episode_steps > 1 else "step"
    assert number(text.split("held for a control period of")[1]) == pytest.approx(1e3 * task.period)
    steps, seconds = re.search(rf"Truncation:\s+(\d+)\s+{unit},\s+(\d+)\s+s\.", text).groups()  # type: ignore[union-attr]
    assert int(steps) == row.max_episode_steps
    assert int(seconds) == pytest.approx(row.max_episode_steps * task().action_period)
    held = re.search(r"for\s+the\s+last\s+(\d+)\s+steps", text)
    assert (int(held[1]) if held else 1) == task.hold_steps


@each_row
def test_entries_of_observations(row: Row) -> None:
    """They follow one another, up to the size; the features have the units of `Task.entries`."""
    lines = list(table(documentation(row), "Observation Space"))
    for observation in task_type(row.id).observations:
        own = [line for line in lines if line.mode == observation]
        assert [line.first for line in own] == [0, *(line.last + 1 for line in own[:-1])]
        assert own[-1].last + 1 == task_type(row.id)(observation=observation).observation_size
    told = np.concatenate(
        [np.full(line.last + 1 - line.first, number(line.told)) for line in lines if line.mode == "features"]
    )
    entries = task_type(row.id)().entries
    np.testing.assert_array_equal(told, np.repeat([e.unit for e in entries], [e.size for e in entries]))


def looked_up(task: Task, m: Any, x: np.ndarray, v: np.ndarray, goal: np.ndarray) -> dict[str, np.ndarray]:
    """Return what entries must be, from measures; those that no measure is."""
    turning = m.angular_velocity
    spin = np.sum(turning * m.axis, axis=1, keepdims=True)
    triad = np.stack([m.side, np.cross(m.axis, m.side), m.axis], axis=1)
    load = x[:, -1]
    known = {
        "axis": m.axis,
        "side": m.side,
        "spin": spin,
        "across": turning - spin * m.axis,
        "target": goal,
        "centre": m.centre[:, :2],
        "centre_velocity": m.centre_velocity[:, :2],
        "angular_velocity": turning,
        "velocity": m.centre_velocity,
    }
    if "to_target" in {entry.name for entry in task.entries}:
        known |= {"to_target": goal[:, :2] - load[:, :2], "to_trolley": x[:, 0, :2] - load[:, :2]}
        known |= {"velocity": v[:, -1, :2], "trolley_velocity": v[:, 0, :2]}
    if "angular_momentum" in {entry.name for entry in task.entries}:
        known |= {
            "angular_velocity": np.einsum("nij,nj->ni", triad, turning),
            "angular_momentum": np.einsum("nij,nj->ni", triad, m.angular_momentum),
        }
    if "offset" in {entry.name for entry in task.entries}:
        known["offset"] = m.centre - goal[:, :3]
    if "holes" in {entry.name for entry in task.entries}:
        known |= on_the_board(m.centre[:, :2], goal)
        known |= {"velocity": m.centre_velocity[:, :2], "turning": turning[:, :2]}
    return known


def on_the_board(place: np.ndarray, goal: np.ndarray) -> dict[str, np.ndarray]:
    """The same of a ball at places (n, 2) of a board."""
    points, holes, tilt, done = np.split(goal, np.cumsum([2 * labyrinth.LEGS + 2, 2 * labyrinth.HOLES, 2]), 1)
    points, holes = (values.reshape(len(place), -1, 2) - place[:, None] for values in (points, holes))
    ahead = np.minimum(done.astype(int) + np.arange(labyrinth.SEEN), labyrinth.LEGS)
    nearest = np.argsort(np.linalg.norm(holes, axis=2), axis=1)[:, : labyrinth.NEAR]
    found = {"place": place, "tilt": tilt}
    for name, values, which in (("way", points, ahead), ("holes", holes, nearest)):
        found[name] = np.take_along_axis(values, which[:, :, None], 1).reshape(len(place), -1)
    legs = np.linalg.norm(np.diff(points, axis=1), axis=2)
    rest = [own[int(n) + 1 :].sum() for own, n in zip(legs, done[:, 0], strict=True)]
    found["remaining_length"] = (
        np.linalg.norm(found["way"][:, 2:4], axis=1, keepdims=True) + np.array(rest)[:, None]
    )
    return found


def of_the_tower(m: Any, x: np.ndarray, goal: np.ndarray) -> dict[str, np.ndarray]:
    """The same of blocks that a crane sets on one another."""
    rows = np.arange(len(goal))
    blocks = m.centre.shape[1]
    held = np.minimum(goal[:, 0].astype(int), blocks - 1)
    height = np.linalg.norm(x[:, 0] - x[:, 4], axis=1)
    off = np.diff(m.centre, axis=1) - height[:, None, None] * [0.0, 0.0, 1.0]
    known = {"way": off[rows, held - 1], "velocity": m.centre_velocity[rows, held], "held_block": goal}
    known |= {"axis": m.axis[rows, held, :2], "turning": m.angular_velocity[rows, held]}
    known |= {"base": m.centre[:, 0, :2], "base_axis": m.axis[:, 0, :2]}
    for k in range(1, blocks):
        known |= {f"off{k}": off[:, k - 1], f"axis{k}": m.axis[:, k, :2]}
    return known


def of_several(task: Task, m: Any, x: np.ndarray, goal: np.ndarray) -> dict[str, np.ndarray]:
    """The same where there are several bodies."""
    level, fast, axis, turning = (
        values[..., :2] for values in (m.centre, m.centre_velocity, m.axis, m.angular_velocity)
    )
    names = {entry.name for entry in task.entries}
    if "held_block" in names:
        return of_the_tower(m, x, goal)
    if "to_pocket" in names:
        return {"to_ball": level[:, 1] - level[:, 0], "to_pocket": goal - level[:, 1]}
    if "place_velocity" in names:
        known = {"offset": level[:, 1] - goal[:, :2], "velocity": fast[:, 1], "axis": axis[:, 0]}
        return known | {"turning": turning[:, 0], "place": goal[:, :2], "place_velocity": goal[:, 3:5]}
    if "paddle" in names:
        known = {"paddle": m.centre[:, 0], "paddle_velocity": m.centre_velocity[:, 0]}
        known |= {"axis": axis[:, 0], "turning": turning[:, 0], "wanted_height": goal}
        known |= {"ball": m.centre[:, 1], "ball_velocity": m.centre_velocity[:, 1]}
        height = m.centre[:, 1, 2] - juggle.BALL_RADIUS + m.centre_velocity[:, 1, 2] ** 2 / (2 * 9.81)
        return known | {"height_offset": np.clip(height[:, None] - goal, -1.0, 1.0)}
    if "beside" in names:
        heading = m.side[:, 1, :2]
        away = level[:, 0] - level[:, 1]
        heading = heading / np.linalg.norm(heading, axis=1, keepdims=True)
        across = np.column_stack([-heading[:, 1], heading[:, 0]])
        beside = np.column_stack([(heading * away).sum(axis=1), (across * away).sum(axis=1)])
        known = {"place": level[:, 1], "velocity": fast[:, 1], "heading": heading, "pusher": away}
        known |= {"beside": beside, "pusher_velocity": fast[:, 0]}
        if "way" in names:
            of_block = m.side[:, 2, :2] / np.linalg.norm(m.side[:, 2, :2], axis=1, keepdims=True)
            cosine = (heading * of_block).sum(axis=1)
            sine = of_block[:, 0] * heading[:, 1] - of_block[:, 1] * heading[:, 0]
            known |= {"way": level[:, 1] - level[:, 2], "turned": np.column_stack([cosine, sine])}
            known["pusher_place"] = level[:, 0]
        return known | {"turning": m.angular_velocity[:, 1, 2:]}
    spin = np.sum(m.angular_velocity * m.axis, axis=-1, keepdims=True)
    across = turning - spin * axis
    known = {"centre": level[:, 0], "velocity": fast[:, 0], "other_centre": level[:, 1] - level[:, 0]}
    known |= {"other_velocity": fast[:, 1] - fast[:, 0]}
    for n, whose in enumerate(("", "other_")):
        known |= {f"{whose}axis": axis[:, n], f"{whose}across": across[:, n], f"{whose}spin": spin[:, n]}
        known[f"{whose}momentum"] = m.angular_momentum[:, n, :2]
    return known


@each_row_but_a_duel
def test_entries_are_what_is_observed(row: Row) -> None:
    """`Task.seen` gives back, in SI units, what the kernel has scaled."""
    envs = gym.make_vec(row.id, num_envs=3, vectorization_mode="vector_entry_point", observation="features")
    envs.reset(seed=0)
    rng = np.random.default_rng(0)
    for _ in range(4):  # after an even number, an episode of one step has begun
        observation, *_ = envs.step(rng.uniform(-1, 1, envs.action_space.shape).astype(np.float32))
    episodes = envs.unwrapped.episodes
    task = episodes.task
    x, v = episodes.particles
    m = episodes._whole.measures
    several = len(task.scene.bodies) > 1
    known = of_several(task, m, x, episodes.goal) if several else looked_up(task, m, x, v, episodes.goal)
    compared = 0
    for name, value in task.seen(observation).items():
        if name in known:
            np.testing.assert_allclose(value, known[name], rtol=2e-6, atol=2e-6 * max(1.0, abs(value).max()))
            compared += value.shape[1]
    assert compared >= task.observation_size - 3  # a normal of a face is no measure


@each_row
def test_outcomes_have_names(row: Row) -> None:
    task = task_type(row.id)()
    assert task.outcome == (*(f"reward_{n}" for n in task.terms), *task.metrics, "success", "terminated")
    assert len(set(task.outcome)) == len(task.outcome)


@each_row
def test_errors_are_numerical(row: Row) -> None:
    """Of steps: in ``info`` and among reset options, a distance or an offset has another name."""
    task = task_type(row.id)()
    options = OptionsProbe()
    task.draw_starts([np.random.default_rng(0)], [options], [NOMINAL])
    assert not [name for name in (*task.reported, *options.names) if "error" in name]


@pytest.mark.parametrize("env_id", ["SpringTop-v0", "SpringTumble-v0", "SpringShove-v0"])
def test_particles_are_observed_where_they_are(env_id: str) -> None:
    """An observation holds positions and velocities, or those relative to a centre of mass or a goal."""
    env = gym.make(env_id)
    seen, _ = env.reset(seed=0)
    episodes = env.unwrapped.episodes
    columns = episodes._columns
    x, v = episodes.particles
    x = x[0]
    v = v[0]
    m = episodes.simulator.scene.masses
    if columns.about == ABOUT_CENTRE:
        x = x - m @ x / m.sum()
        v = v - m @ v / m.sum()
    elif columns.about == ABOUT_GOAL:
        x = x - episodes.goal[0, :3]
    particle, axis = columns.entries.T
    expected = [x[particle, axis] * columns.per_metre, v[particle, axis] * columns.per_speed]
    np.testing.assert_allclose(seen[: 2 * len(particle)], np.concatenate(expected), rtol=1e-6, atol=1e-6)
