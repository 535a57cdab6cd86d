"""Tasks of one's own over a scene: goals, time, memory, drawn starts, marks, as the package's have them."""

from __future__ import annotations

import math
import pickle
from dataclasses import replace
from typing import Any

import gymnasium as gym
import numpy as np
import pytest
from numpy.random import Generator

import springgym
from springgym.dynamics.measures import MeasuresOfBodies
from springgym.envs.arrows import across, torque_arrow
from springgym.envs.goals import BOUND, GoalTolerance
from springgym.envs.observation import Situation
from springgym.envs.sb3 import make_sb3
from springgym.envs.starts import direction, tilted, uniform
from springgym.envs.task import Start
from springgym.model.bodies import box, cube, gyroscope, rigid_velocities, rotation, stretched_shapes
from springgym.model.scene import Placed, Scene, ThrustActuator, WrenchActuator
from springgym.rendering import Arrow, Camera, Look, Marks, Scenery
from springgym.rendering.look import AMBER, BLUE, GREEN, ORANGE, RED, TEAL
from springgym.scenes import film
from tests.envs.test_contract import driven_off
from tests.envs.test_goals import check_rewards

# --- SpringGyroscope, by public words alone -----------------------------------------------------------

ROTOR = gyroscope()
SHAPE = stretched_shapes(ROTOR, (0, 0, 1), 100.0, ROTOR.parts["centre"])
CENTRE = ROTOR.particle("centre")
REACH = float(np.linalg.norm(ROTOR.positions, axis=1).max())


def measured(m: MeasuresOfBodies, s: Situation) -> dict[str, np.ndarray]:
    away = np.linalg.norm(np.cross(m.axis, s.goal), axis=1)
    spin = np.einsum("nk,nk->n", m.angular_velocity, m.axis)
    across = np.linalg.norm(m.angular_velocity - spin[:, None] * m.axis, axis=1)
    angle = np.arctan2(away, np.einsum("nk,nk->n", m.axis, s.goal))
    return {"angle": angle, "spin": spin, "precession": across}


def gaussian(value: np.ndarray, margin: float, bound: float) -> np.ndarray:
    return 0.1 ** (np.maximum(value - bound, 0) / margin) ** 2


def reward(m: MeasuresOfBodies, s: Situation) -> dict[str, np.ndarray]:
    seen = measured(m, s)
    thrift = 1 - 0.1 * (s.action**2).mean(axis=1)
    aligned = 1 / (1 + 9 * (np.maximum(seen["angle"] - 0.03, 0) / 0.5) ** 2) / 4 * thrift
    calm = gaussian(seen["angle"], 0.15, 0.03) * gaussian(seen["precession"], 0.3, 0.1)
    return {"aligned": aligned, "calm": 3 * aligned * calm}


def pointed(m: MeasuresOfBodies, s: Situation) -> np.ndarray:
    seen = measured(m, s)
    return (seen["angle"] < 0.1) & (seen["precession"] < 0.3)


def observe(m: MeasuresOfBodies, s: Situation) -> np.ndarray:
    spin = measured(m, s)["spin"][:, None]
    return np.hstack([m.axis, m.angular_velocity - spin * m.axis, (spin - 35.0) / 20.0, s.goal])


def start(rng: Generator, spin: float | None = None, angle: float | None = None) -> Start:
    axis = direction(rng)
    sideways = rng.uniform(-math.pi, math.pi)
    drawn_spin, drawn_angle = uniform(rng, (25.0, 0.5), (45.0, 1.5))
    spin = drawn_spin if spin is None else spin
    angle = drawn_angle if angle is None else angle
    turn = tilted(math.atan2(axis[1], axis[0]), math.acos(axis[2]))
    goal = turn @ rotation((0, 0, 1), sideways) @ rotation((0, 1, 0), angle) @ (0.0, 0.0, 1.0)
    positions = SHAPE(spin) @ turn.T
    return Start(positions, rigid_velocities(positions, spin * axis, positions[CENTRE]), goal)


def marks(m: MeasuresOfBodies, s: Situation) -> Marks:
    angle = math.degrees(math.acos(m.axis @ s.goal))
    axle = ROTOR.positions[ROTOR.particle("head"), 2]
    return Marks(
        balls=[(axle * s.goal, 0.16 * axle)],
        arrows=[
            Arrow(1.2 * axle * s.goal, 0.5 * axle * s.goal, GREEN),
            torque_arrow((0, 0, 0), across(s.action, m.axis), 1.1 * REACH),
        ],
        key=((GREEN, "target of the axle's orange end"), (RED, "torque")),
        text=(f"off target {angle:5.1f}°", f"spin {float(m.angular_velocity @ m.axis):5.1f} rad/s"),
    )


def rebuilt(**options: Any) -> Any:
    scene = Scene(
        ROTOR,
        velocities=rigid_velocities(ROTOR.positions, (0, 0, 35.0), ROTOR.positions[CENTRE]),
        pinned=ROTOR.parts["centre"],
        wrench=WrenchActuator(perpendicular=True),
    )
    head = ROTOR.particle("head")
    shown = film.look(scene, head)
    colors = [ORANGE if n == head else color for n, color in enumerate(np.asarray(shown.ball_colors))]
    return springgym.make_scene_env(
        scene,
        reward,
        actuators={"torque": 20.0},
        success=pointed,
        hold_steps=50,
        observe=observe,
        metrics=measured,
        start=start,
        look=replace(shown, ball_colors=colors),
        camera=Camera.framing((0, 0, 0), 3.0 * REACH),
        scenery=Scenery(floor=-1.3 * REACH),
        marks=marks,
        **options,
    )


def test_one_of_the_package_s_tasks_is_made_again_by_public_words() -> None:
    """SpringGyroscope: same starts, observations, rewards and their terms, metrics, success, pictures."""
    ours = gym.make_vec(
        "SpringGyroscope-v0", 3, "vector_entry_point", observation="features", render_mode="rgb_array"
    )
    theirs = rebuilt(num_envs=3, max_episode_steps=400, render_mode="rgb_array")
    options = {"angle": 0.05}  # the second time, so that the aim is met
    for given in ({}, options):
        seen = ours.reset(seed=1, options=given)[0]
        again = theirs.reset(seed=1, options=given)[0]
        np.testing.assert_allclose(seen, again, atol=1e-6)
        for n in range(60):
            action = 0.3 * np.sin(n + np.arange(9.0)).reshape(3, 3) * (not given)
            seen, earned, *ends, info = ours.step(action)
            again, earned_again, *ends_again, info_again = theirs.step(action)
            np.testing.assert_allclose(again, seen, atol=2e-6)
            np.testing.assert_allclose(earned_again, earned, rtol=1e-9)
            np.testing.assert_array_equal(ends_again, ends)
            for name in info:
                # Of a rotor that only spins, the angular velocity across the axle is a difference of squares.
                np.testing.assert_allclose(info_again[name], info[name], rtol=1e-6, atol=1e-6, err_msg=name)
        assert info["is_success"].all() == bool(given)
    for picture, picture_again in zip(ours.render(), theirs.render(), strict=True):
        assert (picture != picture_again).mean() < 1e-4  # the last digit of a number may be rounded otherwise
    ours.close()
    theirs.close()


# --- Goals, time, memory ------------------------------------------------------------------------------


def begun(rng: Generator, far: float = 1.0) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    return cube().positions, np.zeros((8, 3)), far * np.array([rng.uniform(1, 2), 0.5])


def turned(m: MeasuresOfBodies, s: Situation) -> np.ndarray:
    """The goal doubles each second, and its second number is the time."""
    return np.column_stack([s.goal[:, 0] * 2**0.02, s.time])


def way(m: MeasuresOfBodies, s: Situation) -> np.ndarray:
    return s.goal[:, 0] - m.centre[:, 0]


def nearer(m: MeasuresOfBodies, s: Situation) -> np.ndarray:
    return s.memory[:, 0] - way(m, s)


def kept(m: MeasuresOfBodies, s: Situation) -> np.ndarray:
    """The way that was left, and how often this was called."""
    return np.column_stack([way(m, s), s.memory[:, 1] + 1])


def looked(m: MeasuresOfBodies, s: Situation) -> np.ndarray:
    return np.column_stack([s.time, s.memory, s.goal])


def chase(reward: Any = nearer, **options: Any) -> Any:
    settings: dict[str, Any] = {
        "actuators": {"force": 5.0},
        "start": begun,
        "move": turned,
        "memory": (0.0, -1.0),
        "remember": kept,
        "observe": looked,
    }
    return springgym.make_scene_env(Scene(cube(), gravity=None), reward, **(settings | options))


def test_goals_time_and_memory_are_of_each_copy() -> None:
    envs = chase(num_envs=2, max_episode_steps=4, autoreset_mode="SameStep")
    env = chase()
    generators = [np.random.default_rng(seed) for seed in (7, 8)]
    first = np.array([rng.uniform(1, 2) for rng in generators])
    seen, _ = envs.reset(seed=7)
    np.testing.assert_allclose(seen, [[0, goal, 0, goal, 0.5] for goal in first], rtol=1e-6)
    single, _ = env.reset(seed=8)
    goal = first
    left = first
    action = np.array([[1.0, 0, 0], [-1.0, 0, 0]])
    for n in range(1, 10):
        seen, earned, _, truncated, infos = envs.step(action)
        in_episode = (n - 1) % 4 + 1
        if in_episode == 1 and n > 1:
            goal = left = np.array([rng.uniform(1, 2) for rng in generators])
        goal = goal * 2**0.02
        reached = 0.5 * action[:, 0] * 5.0 * (0.02 * in_episode) ** 2  # of 1 kg, from rest
        expected = left - (goal - reached)
        np.testing.assert_allclose(earned, expected, atol=1e-3)
        left = goal - reached
        if in_episode < 4:
            rows = np.column_stack([np.full(2, 0.02 * in_episode), left, [in_episode] * 2, goal])
            np.testing.assert_allclose(seen[:, :4], rows, atol=1e-3)
            np.testing.assert_allclose(seen[:, 4], 0.02 * in_episode, atol=1e-6)
        else:
            assert truncated.all()
            np.testing.assert_allclose(np.stack(infos["final_obs"])[:, 2], 4.0)
            np.testing.assert_array_equal(seen[:, [0, 2, 4]], [[0, 0, 0.5]] * 2)  # it has begun anew
        if n < 4:
            single, alone, *_ = env.step(action[1])
            np.testing.assert_array_equal(single, seen[1])
            assert alone == earned[1]


def test_memory_and_time_are_part_of_the_state() -> None:
    env = chase()
    other = chase()
    env.reset(seed=1)
    actions = np.linspace(-1, 1, 18).reshape(6, 3)
    for action in actions[:3]:
        env.step(action)
    state = pickle.loads(pickle.dumps(springgym.get_state(env)))
    springgym.set_state(other, state)
    for action in actions[3:]:
        seen, earned, *_ = env.step(action)
        again, earned_again, *_ = other.step(action)
        np.testing.assert_array_equal(seen, again)
        assert earned == earned_again
    with pytest.raises(ValueError, match=r"state\['memory'\] is an array of float64 of shape \(1, 4\)"):
        springgym.set_state(other, state | {"episodes": state["episodes"] | {"memory": np.zeros((1, 4))}})
    assert pickle.loads(pickle.dumps(env.spec)).kwargs["remember"] is kept


def test_time_begins_at_0_in_episodes_that_are_cut_short() -> None:
    """A training begins the clock of the time limit later in some copies: the task does not know."""
    envs = make_sb3(chase(max_episode_steps=8).spec, num_envs=4, stagger=True)
    np.testing.assert_array_equal(envs.reset()[:, 0], 0.0)
    for n in range(1, 3):
        seen, _, dones, infos = envs.step(np.zeros((4, 3)))
        np.testing.assert_allclose(np.where(dones, 0.02 * n, seen[:, 0]), 0.02 * n, rtol=1e-6)
    np.testing.assert_array_equal(dones, [False, False, False, True])
    assert infos[3]["terminal_observation"][0] == np.float32(0.04)


def test_a_goal_is_observed_with_the_particles_and_set_by_reset_options() -> None:
    env = chase(way, observe=None, move=None, remember=None, memory=())
    assert env.observation_space.shape == (2 * 24 + 2,)
    seen, _ = env.reset(seed=3, options={"far": 0.1})
    again, _ = env.reset(seed=3)
    np.testing.assert_allclose(10 * seen[-2:], again[-2:], rtol=1e-6)
    before = env.unwrapped.np_random.bit_generator.state
    with pytest.raises(ValueError, match="no reset option 'near'; choose from: randomize, far"):
        env.reset(options={"near": 1.0})
    with pytest.raises(ValueError, match="no reset option 3; choose from: randomize, far"):
        env.reset(options={3: 1.0})  # type: ignore[dict-item]
    with pytest.raises(ValueError, match="no reset option 'fare'; did you mean 'far'"):
        env.reset(options={"fare": 1.0})
    assert env.unwrapped.np_random.bit_generator.state == before


# --- Goals told apart ---------------------------------------------------------------------------------

NAN = float("nan")
TOLERANCES = (GoalTolerance("place", 2, 0.05), GoalTolerance("velocity", 2, 0.2))


def berth(rng: Generator, off: float = 0.08) -> Start:
    """A cube at rest, wanted at rest some way off."""
    return Start(cube().positions, np.zeros((8, 3)), [*rng.uniform(-off, off, 2), 0.0, 0.0])


def berthed(m: MeasuresOfBodies, s: Situation) -> np.ndarray:
    return np.hstack([m.centre[:, :2], m.centre_velocity[:, :2]])


def reached(m: MeasuresOfBodies, s: Situation) -> np.ndarray:
    """The same aim as a judge of success, written out."""
    off = berthed(m, s) - s.goal
    near = np.hypot(off[:, 0], off[:, 1]) < 0.05
    return np.asarray(near & (np.hypot(off[:, 2], off[:, 3]) < 0.2))


def parking(**options: Any) -> Any:
    settings: dict[str, Any] = {"actuators": {"force": (5.0, 5.0, 0.0)}, "start": berth, "hold_steps": 3}
    return springgym.make_scene_env(Scene(cube(), gravity=None), way, **(settings | options))


APART: dict[str, Any] = {"achieved": berthed, "goal_tolerances": TOLERANCES, "goals": True, "sparse": True}


def test_goals_of_ones_own_are_told_apart() -> None:
    """They are rewarded as the same aim written as a judge, and again from the goals alone."""
    apart = parking(num_envs=32, **APART)
    judged = parking(num_envs=32, success=reached, sparse=True)
    seen, usual = check_rewards(apart, judged, 15, 1.0)
    assert seen["observation"].shape == (32, 48)
    np.testing.assert_array_equal(seen["observation"], usual[:, :48])
    np.testing.assert_allclose(seen["desired_goal"], usual[:, 48:], atol=1e-7)
    np.testing.assert_allclose(
        seen["achieved_goal"][:, :2], apart.episodes.particles[0].mean(axis=1)[:, :2], atol=1e-12
    )  # its masses are equal


def test_aims_without_goals_told_apart_judge_success() -> None:
    env = parking(achieved=berthed, goal_tolerances=TOLERANCES)
    env.reset(seed=0, options={"off": 0.0})
    told = [env.step([0, 0])[4]["is_success"] for _ in range(3)]
    assert told == [False, False, True]
    assert not hasattr(env.unwrapped, "compute_reward")


def test_a_copy_that_diverged_reaches_no_goal() -> None:
    envs = parking(num_envs=2, autoreset_mode="NextStep", **APART)
    envs.reset(seed=0, options={"off": 0.0})
    driven_off(envs.episodes.simulator, 0, 1e25)
    seen, earned, terminated, *_ = envs.step(np.zeros((2, 2)))
    assert terminated.tolist() == [True, False]
    assert earned.tolist() == [0.0, 1.0]
    assert (seen["achieved_goal"][0] == BOUND).all()


@pytest.mark.parametrize(
    ("given", "error", "says"),
    [
        ({"achieved": None}, ValueError, "goals is True; give achieved and goal_tolerances, too"),
        ({"sparse": False}, ValueError, "give sparse=True, too"),
        ({"observe": berthed}, ValueError, "goals is True and observe is given; leave observe out"),
        (
            {"goal_tolerances": ()},
            ValueError,
            "achieved is .* and goal_tolerances is .*; give both or neither",
        ),
        (
            {"goals": False, "achieved": None},
            ValueError,
            "achieved is None and goal_tolerances is .*; give both",
        ),
        ({"goals": 1}, TypeError, "goals is 1; it must be True or False"),
        (
            {"goal_tolerances": TOLERANCES[:1]},
            ValueError,
            "goal_tolerances have 2 numbers, and the goal that start gave has 4",
        ),
        ({"start": None}, ValueError, "goal_tolerances have 4 numbers, and the goal that start gave has 0"),
        (
            {"goal_tolerances": 0.1},
            TypeError,
            "goal_tolerances is 0.1; it must be a sequence of GoalTolerance",
        ),
        ({"goal_tolerances": [("place", 4)]}, TypeError, r"goal_tolerances\[0\] is"),
        (
            {"goal_tolerances": [GoalTolerance("place", 4, NAN)]},
            ValueError,
            r"goal_tolerances\[0\]\.within is nan",
        ),
        (
            {"goal_tolerances": [GoalTolerance("place", 4, -1.0)]},
            ValueError,
            r"goal_tolerances\[0\]\.within is -1.0",
        ),
        (
            {"goal_tolerances": [GoalTolerance("place", True, 0.1)]},
            TypeError,
            r"goal_tolerances\[0\]\.size is True",
        ),
        ({"goal_tolerances": [GoalTolerance(3, 4, 0.1)]}, TypeError, r"goal_tolerances\[0\]\.name is 3"),
        ({"success": reached}, ValueError, "pass either achieved or success, not both"),
        ({"achieved": lambda m: 0}, TypeError, r"achieved takes \(m\)"),
        ({"achieved": lambda m, s: m.centre}, ValueError, r"achieved gave .* numbers of shape \(1, 4\)"),
        (
            {"achieved": lambda m, s: NAN * s.goal},
            ValueError,
            "achieved gave .* for environment 0; it must be fin",
        ),
    ],
)
def test_goals_that_cannot_be_told_apart_are_refused(
    given: dict[str, Any], error: type[Exception], says: str
) -> None:
    with pytest.raises(error, match=says):
        parking(**(APART | given))


def test_copies_that_diverge_keep_finite_goals_and_memories() -> None:
    envs = chase(num_envs=2, autoreset_mode="NextStep")
    envs.reset(seed=0)
    driven_off(envs.episodes.simulator, 1, 1e25)
    *_, infos = envs.step(np.zeros((2, 3)))
    np.testing.assert_array_equal(infos["diverged"], [False, True])
    state = springgym.get_state(envs)
    assert np.isfinite(state["episodes"]["memory"]).all()
    springgym.set_state(envs, state)
    envs.step(np.zeros((2, 3)))


# --- Actuators by axis, terms, metrics ----------------------------------------------------------------


def test_actuators_by_axis() -> None:
    scene = Scene(cube(), gravity=None, thrust=ThrustActuator((1, 6)))
    env = springgym.make_scene_env(
        scene, lambda m, s: 0.0 * s.time, actuators={"torque": (3.0, 0.0, 1.0), "thrust": (0, 0, 2.0)}
    )
    task = env.unwrapped.episodes.task
    np.testing.assert_array_equal(task.limits, [3.0, 1.0, 2.0, 2.0])
    assert env.action_space.shape == (4,)
    given = task.actuate(np.array([[0.5, -1.0, 1.0, -0.5]]))
    np.testing.assert_array_equal(given["torque"], [[1.5, 0.0, -1.0]])
    np.testing.assert_array_equal(given["thrust"], [[[0, 0, 2.0], [0, 0, -1.0]]])


def test_terms_of_the_reward_sum_to_it() -> None:
    env = springgym.make_scene_env(
        Scene(cube(), gravity=None),
        lambda m, s: {"a": m.centre[:, 0], "b": 2.0 + s.action[:, 0]},
        actuators={"force": 1.0},
        metrics=lambda m, s: {"speed": np.linalg.norm(m.centre_velocity, axis=1)},
    )
    _, info = env.reset(seed=0)
    assert info["reward_a"] == info["reward_b"] == info["speed"] == 0.0
    _, earned, *_, info = env.step([1.0, 0, 0])
    assert earned == info["reward_a"] + info["reward_b"]
    assert info["reward_b"] == 3.0
    assert info["speed"] == pytest.approx(0.02, rel=1e-6)


# --- How it is drawn ----------------------------------------------------------------------------------


def test_colors_by_name() -> None:
    scene = Scene(bodies=(Placed(cube()), Placed(box(), box().positions + 3.0)), collisions=None)
    plain = film.look(scene)
    shown = film.look(scene, colors={"box": TEAL})
    count = len(cube().triangles)
    before = np.asarray(plain.triangle_colors)
    after = np.asarray(shown.triangle_colors)
    np.testing.assert_array_equal(after[:count], before[:count])
    blue = (before[count:] == BLUE).all(axis=1)
    assert blue.any()
    np.testing.assert_array_equal(after[count:][blue], [TEAL] * blue.sum())
    np.testing.assert_array_equal(after[count:][~blue], before[count:][~blue])
    one = film.look(Scene(cube()), colors={"cube": AMBER})
    assert not (np.asarray(one.triangle_colors) == BLUE).all(axis=1).any()
    for colors, error, says in (
        ({"ball": TEAL}, ValueError, "body is 'ball'; it must be one of 'cube', 'box'"),
        ({"box": (1, 2)}, ValueError, r"colors\['box'\]"),
        ({"box": (1, 2, 256)}, ValueError, r"colors\['box'\]"),
        ({"box": (0.5, 0, 0)}, TypeError, r"colors\['box'\]"),
        ({1: TEAL}, TypeError, "a name in colors is 1"),
        ([TEAL], TypeError, "colors is"),
    ):
        with pytest.raises(error, match=says):
            film.look(scene, colors=colors)  # type: ignore[arg-type]


def test_marks_are_marks() -> None:
    env = chase(marks=lambda m, s: "here", render_mode="rgb_array")
    env.reset(seed=0)
    with pytest.raises(TypeError, match="what marks gave is 'here'; it must be Marks"):
        env.render()


# --- What is refused ----------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("given", "error", "says"),
    [
        ({"observe": lambda m, x, v: x}, TypeError, r"observe takes \(m, x, v\); .* as observe\(m, s\)"),
        ({"metrics": lambda m: {}}, TypeError, r"metrics takes \(m\); it must be called as metrics\(m, s\)"),
        ({"start": lambda: begun}, TypeError, r"start takes \(\); it must be called as start\(rng\)"),
        ({"start": lambda rng: 3}, TypeError, "start gave 3; it must give positions and velocities"),
        ({"start": lambda rng: (*begun(rng)[:2], NAN)}, ValueError, "the goal that start gave is nan"),
        ({"start": lambda rng: (*begun(rng)[:2], (1, NAN))}, ValueError, r"the goal that start gave\[1\]"),
        ({"start": lambda rng: (*begun(rng)[:2], "up")}, TypeError, "the goal that start gave"),
        ({"start": None}, ValueError, "move is given, but there is no goal"),
        ({"memory": ()}, ValueError, "memory is .*; give both or neither"),
        ({"remember": None}, ValueError, "remember is None; give both or neither"),
        ({"memory": (NAN, 0)}, ValueError, r"memory\[0\]"),
        *(
            ({"metrics": lambda m, s, own=own: {own: s.time}}, ValueError, f"'{own}', but info has an entry")
            for own in ("energy", "coarse_contacts", "error_bound")
        ),
        ({"metrics": lambda m, s: {3: s.time}}, TypeError, "an entry named 3"),
        ({"metrics": lambda m, s: {"a": m.centre}}, ValueError, "metrics, 'a', gave"),
        (
            {"metrics": lambda m, s: {"a": NAN * s.time}},
            ValueError,
            "metrics, 'a', gave nan for environment 0",
        ),
        ({"actuators": {"force": (1.0, 2.0)}}, ValueError, r"actuators\['force'\]"),
        ({"actuators": {"force": (1.0, -2.0, 0)}}, ValueError, r"actuators\['force'\]"),
        ({"actuators": {"force": (0, 0, 0)}}, ValueError, "at least one axis must differ from 0"),
        ({"look": Look(radii=np.ones(9))}, ValueError, "look draws 9 particles; the scene has 8"),
    ],
)
def test_what_a_task_cannot_be_is_told(given: dict[str, Any], error: type[Exception], says: str) -> None:
    with pytest.raises(error, match=says):
        chase(**given)


@pytest.mark.parametrize(
    ("given", "says"),
    [
        ({"move": lambda m, s: s.goal[:, 0]}, r"move gave .*; it must give numbers of shape \(1, 2\)"),
        ({"move": lambda m, s: NAN * s.goal}, "move gave .* for environment 0; it must be finite"),
        ({"remember": lambda m, s: s.memory[0]}, r"remember gave .*; it must give numbers of shape \(1, 2\)"),
        ({"remember": lambda m, s: s.memory / 0}, "remember gave .* for environment 0; it must be finite"),
        ({"metrics": lambda m, s: {f"at {s.time[0]}": s.time}}, "the names must not change"),
    ],
)
@pytest.mark.filterwarnings("ignore:divide by zero", "ignore:invalid value")
def test_what_a_function_cannot_give_is_told(given: dict[str, Any], says: str) -> None:
    def play() -> None:
        env = chase(**given)
        env.reset(seed=0)
        env.step([0, 0, 0])

    with pytest.raises(ValueError, match=says):
        play()


def test_a_goal_of_another_length_is_refused_and_changes_nothing() -> None:
    sizes = iter([2, 2, 3])
    env = chase(start=lambda rng: (*begun(rng)[:2], np.ones(next(sizes))), move=None)
    env.reset(seed=0)
    with pytest.raises(ValueError, match="the goal that start gave"):
        env.reset()
    env.step([0, 0, 0])
