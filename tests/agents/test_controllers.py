"""The classical controllers: their laws, and that they do the task."""

import inspect

import config
import controllers
import evaluate
import gymnasium as gym
import numpy as np
import pytest

from springgym.envs.gyroscope import SpringGyroscope
from springgym.envs.pendulum import SpringPendulum
from springgym.envs.top import SpringTop
from tests.envs.cases import IDS, task_type
from tests.params import slow_but

TOP = SpringTop(observation="frame")


def compact(tilt, azimuth=0.7, across=(0.0, 0.0, 0.0), spin=50.0):
    """The compact observation of SpringTop."""
    axis = [np.sin(tilt) * np.cos(azimuth), np.sin(tilt) * np.sin(azimuth), np.cos(tilt)]
    return np.array([[*axis, *(np.array(across) / 2), (spin - 50) / 20]], np.float32)


def test_top_moment_by_hand():
    """Axis along x: z − n (n·z) = z, n×z = −y. ω⊥ = (0, 1, 2) rad/s, 40 rad/s of spin."""
    moment, about_axis = controllers.top_moment(TOP, compact(np.pi / 2, 0.0, (0, 1, 2), 40.0))
    np.testing.assert_allclose(moment, [[0, -40 - 20, 60 - 40]], atol=1e-5)
    np.testing.assert_allclose(about_axis, [30], rtol=1e-6)


def test_upright_and_steady_needs_nothing():
    for action, act in controllers.CLASSICAL["SpringTop-v0"].items():
        task = SpringTop(observation="frame", action=action)
        np.testing.assert_array_equal(act(task, compact(0.0)), np.zeros((1, 3), np.float32))


def test_actions_are_scaled_and_saturated():
    small = compact(0.05, across=(0.02, 0.0, 0.0), spin=51.0)
    moment, about_axis = controllers.top_moment(TOP, small)
    expected = [*(moment[0, :2] / 15), about_axis[0] / 15]
    np.testing.assert_allclose(controllers.top_torque(TOP, small)[0], expected, rtol=1e-5)
    large = controllers.top_torque(TOP, compact(1.0, across=(-9.0, 9.0, 0.0), spin=10.0))
    np.testing.assert_array_equal(large, [[1, -1, 1]])


def test_impulse_gives_the_moment():
    """Over 20 ms an impulse J at n, 1 m from the tip, is the moment n×J / 0.02 s, across the axis."""
    small = compact(0.05, across=(0.02, -0.01, 0.0))
    axis = small[0, :3].astype(float)
    moment = controllers.top_moment(TOP, small)[0][0]
    impulse = 0.3 * controllers.top_impulse(SpringTop(action="impulse"), small)[0].astype(float)
    across = moment - axis * (axis @ moment)
    np.testing.assert_allclose(np.cross(axis, impulse) / 0.02, across, rtol=1e-5, atol=1e-5)
    assert np.linalg.norm(across) > 1


PENDULUM = SpringPendulum(observation="frame")


def cube(tilt, across=(0.0, 0.0, 0.0)):
    """The compact observation of SpringPendulum, tilted in the plane of x and z."""
    return np.array([[np.sin(tilt), 0.0, np.cos(tilt), *(np.array(across) / 4), 0.0]], np.float32)


@pytest.mark.parametrize(
    ("tilt", "across", "moment"),
    [
        (np.pi / 2, (0.0, 0.0, 0.0), (0.0, 4.25, 0.0)),  # 8.5 J are lacking; it is going to fall about y
        (np.pi / 2, (0.0, 2.0, 0.0), (0.0, 4.25, 0.0)),  # 6 J
        (np.pi / 2, (0.0, -2.0, 0.0), (0.0, -4.25, 0.0)),
        (np.pi / 2, (1.0, 2.0, 0.0), (4.25, 4.25, 0.0)),  # each to its limit
        (np.pi / 2, (0.0, 4.0, 0.0), (0.0, -4.25, 0.0)),  # 0.625 16 J − 8.5 J too much
        (np.pi / 2, (0.0, 0.0, 1.5), (0.0, 4.25, -3.0)),  # it whirls
        (0.1, (0.1, 0.2, 0.0), (-0.8, -30 * np.sin(0.1) - 1.6, 0.0)),  # it is held: n×z is along −y
    ],
)
def test_pendulum_moment_by_hand(tilt, across, moment):
    np.testing.assert_allclose(
        controllers.pendulum_moment(PENDULUM, cube(tilt, across)), [moment], rtol=1e-5, atol=1e-5
    )


def test_a_cube_at_rest_is_pushed_down():
    """A push up the slope would hold the cube where the weight has the same moment: for ever."""
    for tilt in np.linspace(0.65, 3.12, 12):
        moment = controllers.pendulum_moment(PENDULUM, cube(tilt))[0]
        assert moment[1] > 0.1
    hanging = controllers.pendulum_moment(PENDULUM, np.array([[0, 0, -1, 0, 0, 0, 0]], np.float32))
    assert np.abs(hanging).max() == 4.25


@pytest.mark.parametrize("action", slow_but(["torque", "impulse"], "torque"))
def test_erects_the_top(action):
    kwargs = {"action": action}
    classical, zero = (
        evaluate.evaluate(name, "SpringTop-v0", kwargs, episodes=16) for name in ("classical", "zero")
    )
    assert classical.success_rate == 1.0
    assert zero.success_rate == 0.0
    assert classical.return_per_step > 0.75 > 0.2 > zero.return_per_step


HARD = [
    (env_id, action)
    for env_id in IDS
    if "hard" in inspect.signature(task_type(env_id)).parameters
    for action in task_type(env_id).actions
]


def seen_by(task, usual, seen):
    """Return an observation of the usual task in the units of ``task``: the hard gyroscope has others."""
    if not isinstance(task, SpringGyroscope):
        return seen
    (zero, unit), (own_zero, own_unit) = usual.parameters, task.parameters
    own = np.array(seen)
    own[6] = (zero + unit * seen[6] - own_zero) / own_unit
    return own


@pytest.mark.parametrize(
    ("env_id", "action"), slow_but(HARD, ("SpringTop-v0", "torque"), ("SpringTumble-v0", "wrench"))
)
def test_weaker_actuators_are_asked_for_the_same(env_id, action):
    """Where nothing saturates, what the actuators do is the same with ``hard=True``."""
    tasks, controller = [], []
    for hard in (False, True):
        kwargs = {"action": action, "hard": hard}
        env = gym.make(env_id, observation="frame", **kwargs)
        tasks.append(env.unwrapped.episodes.task)
        controller.append(controllers.make_controller("classical", env_id, kwargs, env.action_space))
    compared = 0
    env = gym.make(env_id, observation="frame", action=action)
    seen, _ = env.reset(seed=0)
    ended = False
    while not ended:
        actions = [
            act(seen_by(task, tasks[0], seen)[None]) for act, task in zip(controller, tasks, strict=True)
        ]
        if max(np.abs(action).max() for action in actions) < 0.7:  # the weaker is at 2/3 of the other
            done = [task.actuate(action.astype(float)) for task, action in zip(tasks, actions, strict=True)]
            for name, value in done[0].items():
                np.testing.assert_allclose(done[1][name], value, rtol=1e-5, atol=1e-6)
            compared += int(np.abs(actions[0]).max() > 1e-3)
        seen, _, terminated, truncated, _ = env.step(actions[0][0])
        ended = terminated or truncated
    assert compared > 20


def test_corner_impulses_add_up():
    """Σ f_i = F and Σ r_i×f_i = τ of the wrench that the same controller asks for."""
    env = gym.make("SpringTumble-v0", action="impulses", observation="frame")
    task = env.unwrapped.episodes.task
    for seed in range(20):
        seen = 0.05 * env.reset(seed=seed)[0]
        seen[6:9] = (0.05, 0.02, -1.0)  # the face is nearly down
        seen[12:] *= 20
        wanted = controllers.tumble_wrench(task_type("SpringTumble-v0")(), seen[None]) * np.repeat(
            [35.0, 9.0], 3
        )
        forces = task.actuate(controllers.tumble_impulses(task, seen[None]).astype(float))["thrust"][0]
        m, (x, _) = env.unwrapped.episodes.measures, env.unwrapped.episodes.particles
        arms = x[0, :4] - m.centre[0]
        np.testing.assert_allclose(forces.sum(axis=0), wanted[0, :3], atol=1e-4)
        np.testing.assert_allclose(np.cross(arms, forces).sum(axis=0), wanted[0, 3:], atol=1e-4)
        assert np.abs(wanted).max() > 0.5


def test_zero_and_random():
    space = gym.spaces.Box(np.array([-1, 2], np.float32), np.array([1, 3], np.float32))
    observations = np.ones((500, 4), np.float32)
    zero = controllers.make_controller("zero", "Any-v0", {}, space)(observations)
    np.testing.assert_array_equal(zero, np.zeros((500, 2), np.float32))
    policy = controllers.make_controller("random", "Any-v0", {}, space)
    first, second = policy(observations), policy(observations)
    for actions in (first, second):
        assert actions.dtype == np.float32
        assert all(space.contains(action) for action in actions)
    np.testing.assert_allclose(first.mean(axis=0), [0, 2.5], atol=0.1)
    assert not np.array_equal(first, second)
    again = controllers.make_controller("random", "Any-v0", {}, space)(observations)
    np.testing.assert_array_equal(again, first)


def test_unknown_controller():
    space = gym.spaces.Box(-1, 1, (3,))
    with pytest.raises(config.ConfigError, match=r"SpringTop-v0 with action='force'; there is one"):
        controllers.make_controller("classical", "SpringTop-v0", {"action": "force"}, space)


def test_only_classical_control_asks_for_the_frame():
    assert controllers.controller_env_kwargs("classical", "SpringTop-v0", {}) == {"observation": "frame"}
    assert controllers.controller_env_kwargs("classical", "Another-v0", {"size": 2}) == {"size": 2}
    assert controllers.controller_env_kwargs("zero", "SpringTop-v0", {"goals": True}) == {}
