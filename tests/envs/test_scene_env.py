"""Environments over a user's own scene."""

from __future__ import annotations

import pickle
from itertools import pairwise
from typing import Any

import gymnasium as gym
import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env

import springgym
from springgym.dynamics.measures import Measures, MeasuresOfBodies
from springgym.envs.observation import Situation
from springgym.envs.sb3 import make_sb3
from springgym.model.bodies import box, cube
from springgym.model.scene import Placed, Scene, ThrustActuator
from springgym.rendering import Marks

UP = np.array([0, 0, 0, 0, 0, 1, 0, 0, 1], np.float32)
"""The action by which both thrusters of `make` push upwards."""


def lifted(m: MeasuresOfBodies, s: Situation) -> np.ndarray:
    return m.centre[:, 2]


def kicked(rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
    positions = cube().positions
    return positions, rng.normal(size=3) + np.zeros_like(positions)


def make(**options: Any) -> Any:
    scene = Scene(cube(), gravity=None, thrust=ThrustActuator((1, 6)))
    settings = {"reward": lifted, "actuators": {"torque": 2.0, "thrust": 1.0}, "start": kicked}
    return springgym.make_scene_env(scene, **(settings | options))


def test_checker() -> None:
    env = make(render_mode="rgb_array")
    check_env(env.unwrapped, skip_render_check=True)  # which wants a registered id
    env.reset(seed=0)
    assert env.render().std() > 0


def test_reward_and_end_are_the_users() -> None:
    env = make(terminated=lambda m, s: m.centre[:, 2] > 0.5, max_episode_steps=50)
    env.reset(seed=0)
    start = env.unwrapped.episodes.measures.momentum[0, 2]
    step = 0
    terminated = False
    truncated = False
    while not (terminated or truncated):
        _, reward, terminated, truncated, info = env.step(UP)
        step += 1
    assert terminated
    assert reward == info["reward_own"] == env.unwrapped.episodes.measures.centre[0, 2]
    # Both thrusters push the cube of 1 kg up with 1 N: it gains 2 m/s² over step × 20 ms.
    gained = env.unwrapped.episodes.measures.momentum[0, 2] - start
    assert gained == pytest.approx(2.0 * step * 0.02, rel=1e-9)


def test_a_sparse_reward_needs_an_aim() -> None:
    """Without one it would always be 0."""
    for made in (make, lambda **options: make(num_envs=2, **options), lambda **o: gym.make(make().spec, **o)):
        with pytest.raises(ValueError, match="sparse is True, and there is no aim to meet; give success"):
            made(sparse=True, terminated=lambda m, s: m.strain > 0.1)


def test_scaled_scene_starts_unstrained() -> None:
    """The start is scaled with the springs, about the centre of mass, which moves as it did."""
    env = make(randomize={"scale": (0.5, 2.0)})
    starts = []
    for scale in (1.0, 1.5):
        _, info = env.reset(seed=3, options={"randomize": {"scale": scale}})
        assert info["strain"] < 1e-12
        starts.append((*(values[0].copy() for values in env.unwrapped.episodes.particles),))
    (x, v), (scaled_x, scaled_v) = starts
    centre = x.mean(axis=0)  # its masses are equal
    np.testing.assert_allclose(scaled_x - centre, 1.5 * (x - centre), atol=1e-12)
    np.testing.assert_allclose(scaled_v, v, atol=1e-12)  # it flies without turning


def seen(m: MeasuresOfBodies, s: Situation) -> np.ndarray:
    return np.concatenate([m.centre, m.axis, 100 * m.angular_velocity], axis=1)


@pytest.mark.parametrize(
    ("marks", "says"),
    [
        ({"balls": [((0.0, 0.0), 0.1)]}, r"Marks\.balls\[0\]: centre is .*shape \(3,\)"),
        ({"arrows": [((0, 0, 0), (1, 0, 0))]}, r"Marks\.arrows\[0\] is .*; it must be Arrow"),
        ({"lines": [((0, 0, 0), (0, 0, np.nan))]}, r"Marks\.lines\[0\]: end\[2\] is nan"),
        ({"edges": [((0, 0, 0), (0, 0, 1), (0, 0, 300))]}, r"Marks\.edges\[0\]: color\[2\] is 300"),
        ({"rings": [(1.0, 0.1)]}, r"Marks\.rings\[0\]: centre is 1\.0"),
    ],
)
def test_marks_are_in_space(marks: dict[str, Any], says: str) -> None:
    env = make(render_mode="rgb_array", marks=lambda m, s: Marks(**marks))
    env.reset(seed=0)
    with pytest.raises((TypeError, ValueError), match=says):
        env.render()


def test_marks_of_a_lost_state_are_left_out(monkeypatch: pytest.MonkeyPatch) -> None:
    """A function of the user is not asked where bodies are that are nowhere."""
    env = make(render_mode="rgb_array", marks=lambda m, s: Marks(balls=[(s.x[0], 0.1)]))
    env.reset(seed=0)
    episodes = env.unwrapped.episodes
    m, s = episodes.seen_of(0)
    assert len(episodes.marks(0).balls) == 1
    for lost in (np.nan, np.inf, 1e40):
        monkeypatch.setattr(
            episodes, "seen_of", lambda copy, lost=lost: (m, s._replace(x=lost * np.ones_like(s.x)))
        )
        assert episodes.marks(0).balls == ()
        assert episodes.marks(0).text[0] == "step 0"


def test_values_hidden_by_a_mask_are_refused() -> None:
    """NumPy would use what the mask hides: of actions, and of what functions give."""
    env = make()
    env.reset(seed=0)
    hidden = np.ma.masked_array(np.zeros(env.action_space.shape), mask=True)
    for action in (hidden, list(hidden)):
        with pytest.raises(ValueError, match=r"action is .*; it must be an array without hidden values"):
            env.step(action)
    env.step(np.ma.masked_array(np.zeros(env.action_space.shape)))
    with pytest.raises(TypeError, match="observe gave"):
        make(observe=lambda m, s: np.ma.masked_array(seen(m, s), mask=True))


def test_observation_of_ones_own() -> None:
    """It is what the function gives, clipped to ±10."""
    env = make(observe=seen)
    envs = make(observe=seen, num_envs=2)
    assert env.observation_space.shape == (9,)
    assert envs.observation_space.shape == (2, 9)
    first, _ = env.reset(seed=1)
    batch, _ = envs.reset(seed=[0, 1])
    action = np.linspace(-1, 1, 9, dtype=np.float32)
    for _ in range(30):
        np.testing.assert_array_equal(batch[1], first)
        m = env.unwrapped.episodes.measures
        expected = np.clip(seen(m, env.unwrapped.episodes.seen[1])[0], -10, 10)
        np.testing.assert_allclose(first, expected, rtol=1e-6, atol=1e-7)
        first, *_ = env.step(action)
        batch, *_ = envs.step(np.tile(action, (2, 1)))
    assert np.abs(first).max() == 10
    check_env(make(observe=seen).unwrapped, skip_render_check=True)


def test_success_of_ones_own() -> None:
    """It is met for ``hold_steps`` steps in a row."""
    env = make(success=lambda m, s: m.centre[:, 2] > 0.02, hold_steps=3)
    env.reset(seed=0)
    met = []
    reported = []
    for _ in range(30):
        *_, info = env.step(UP)
        met.append(env.unwrapped.episodes.measures.centre[0, 2] > 0.02)
        reported.append(info["is_success"])
    first = met.index(True)
    assert 0 < first < 20
    assert all(met[first:])
    assert reported == [n >= first + 2 for n in range(30)]


@pytest.mark.parametrize("aim", [False, True])
def test_without_an_aim_there_is_no_success(aim: bool) -> None:
    options = {"success": lambda m, s: m.centre[:, 2] > 0.02} if aim else {}
    for env in (make(**options), make(num_envs=2, **options)):
        _, begun = env.reset(seed=0)
        *_, info = env.step(env.action_space.sample())
        assert ("is_success" in info, "is_success" in begun) == (aim, aim)
        assert "diverged" in info


@pytest.mark.parametrize("wins", [False, True])
@pytest.mark.parametrize("copies", [None, 2])
def test_an_end_is_lost_unless_it_is_said_to_win(copies: int | None, wins: bool) -> None:
    def above(m: MeasuresOfBodies, s: Situation) -> np.ndarray:
        return m.centre[:, 2] > 0.2

    def anywhere(m: MeasuresOfBodies, s: Situation) -> np.ndarray:
        return np.ones(len(s.x), bool)

    env = make(terminated=above, success=anywhere, hold_steps=3, wins=wins, num_envs=copies, sparse=True)
    env.reset(seed=0 if copies is None else [0] * copies)
    action = UP if copies is None else np.tile(UP, (copies, 1))
    for n in range(30):
        _, reward, ended, _, info = env.step(action)
        if np.all(ended):
            break
        assert np.all(reward == 1.0)
        assert np.all(info["is_success"] == (n >= 2))
    assert np.all(ended)
    assert n > 3
    assert np.all(info["is_success"] == wins)
    assert np.all(reward == wins)
    with pytest.raises(TypeError, match="wins is 1; it must be True or False"):
        make(wins=1)


def pinned_height(m: MeasuresOfBodies, s: Situation) -> np.ndarray:
    return s.x[:, 1, 2].copy()


@pytest.mark.parametrize("scene", ["cube-pendulum", Scene(cube(), gravity=None)], ids=["name", "scene"])
def test_spec_makes_it_again(scene: Any) -> None:
    """After pickling, too; single and as a batch; and for Stable-Baselines3."""
    made = springgym.make_scene_env(
        scene, pinned_height, actuators={"torque": 1.0}, max_episode_steps=7, dtype=np.float64
    )
    batch: Any = springgym.make_scene_env(
        scene, pinned_height, actuators={"torque": 1.0}, max_episode_steps=7, num_envs=2
    )
    spec = pickle.loads(pickle.dumps(made.spec))
    assert spec.max_episode_steps == 7
    again = gym.make(spec)
    many = gym.make_vec(pickle.loads(pickle.dumps(batch.spec)))
    assert many.num_envs == 2
    action = np.ones((2, 3), np.float32)
    first = [env.reset(seed=3)[0] for env in (made, again)]
    np.testing.assert_array_equal(*first)
    start, _ = many.reset(seed=3)
    np.testing.assert_array_equal(start[0], first[0])
    for _ in range(7):
        results = [env.step(action[0]) for env in (made, again)]
        seen, reward, _, truncated, _ = many.step(action)
        np.testing.assert_array_equal(results[0][0], results[1][0])
        np.testing.assert_array_equal(results[0][0], seen[0])
        assert results[0][1:4] == results[1][1:4] == (reward[0], False, truncated[0])
    assert truncated.all()
    with pytest.raises(TypeError, match="not JSON serializable"):
        made.spec.to_json()
    training = make_sb3(made.spec, num_envs=2, seed=3)
    np.testing.assert_array_equal(training.reset(), start)


def test_no_time_limit() -> None:
    env = make(max_episode_steps=None)
    env.reset(seed=0)
    assert not any(env.step(np.zeros(9, np.float32))[3] for _ in range(600))
    with pytest.raises(ValueError, match="max_episode_steps is 0; it must be a whole number, at least 1"):
        make(max_episode_steps=0)
    with pytest.raises(ValueError, match="max_episode_steps is 0"):
        make(max_episode_steps=0, num_envs=2)


@pytest.mark.slow
def test_camera_keeps_the_body_in_view() -> None:
    """However far it falls or flies; until it would be lost, the picture's background stays."""
    scene = Scene(cube(), velocities=np.tile([2.0, 0.0, 0.0], (8, 1)))
    env: Any = springgym.make_scene_env(
        scene, lifted, actuators={"force": 1.0}, render_mode="rgb_array", period=0.05
    )
    env.reset(seed=0)
    cameras = []
    for _ in range(30):
        env.step(np.zeros(3, np.float32))
        env.render()
        canvas = env.unwrapped._canvases[0]
        pixels, _ = canvas.camera.project(env.unwrapped.episodes.particles[0][0], canvas.size)
        assert (pixels >= 0).all()
        assert (pixels <= canvas.size).all()
        cameras.append(canvas.camera)
    assert np.abs(env.unwrapped.episodes.measures.centre[0]).max() > 10
    moves = sum(a != b for a, b in pairwise(cameras))
    assert 3 < moves < 25
    env.reset(seed=0)
    env.render()
    assert env.unwrapped._canvases[0].camera == env.unwrapped.episodes.task.camera()


# --- Several bodies ------------------------------------------------------------------------------------


def two(**options: Any) -> Any:
    """A cube that turns, and a box beside it that is pushed; they pass through each other."""
    turning = np.cross((0.0, 0.0, 2.0), cube().positions - cube().centre)
    aside = box().positions + np.array([3.0, 0.0, 0.0])
    scene = Scene(bodies=(Placed(cube(), None, turning), Placed(box(), aside)), gravity=None, collisions=None)
    settings: dict[str, Any] = {"reward": lambda m, s: m["box"].centre[:, 0], "damping_every": 1}
    return springgym.make_scene_env(scene, **(settings | {"actuators": {"box.force": 2.0}} | options))


@pytest.mark.parametrize("copies", [None, 2])
def test_functions_get_the_measures_of_each_body_by_name(copies: int | None) -> None:
    def observe(m: MeasuresOfBodies, s: Situation) -> np.ndarray:
        assert m.names == ("cube", "box")
        for body, own in (("cube", slice(8)), ("box", slice(8, 16))):
            np.testing.assert_allclose(m[body].centre_velocity, mean(s.v[:, own], body), atol=1e-12)
        for name, by_name, by_number in zip(Measures._fields, m["box"], m[1], strict=True):
            np.testing.assert_array_equal(by_name, by_number, err_msg=name)
        np.testing.assert_allclose(np.linalg.norm(m["cube"].axis, axis=1), 1.0)
        return np.column_stack([m["cube"].angular_velocity, m["box"].momentum])

    def mean(values: np.ndarray, body: str) -> np.ndarray:
        masses = {"cube": cube(), "box": box()}[body].masses
        return np.einsum("i,nik->nk", masses, values) / masses.sum()

    env = two(observe=observe, num_envs=copies)
    env.reset(seed=0)
    push = np.ones(3 if copies is None else (copies, 3), np.float32)
    for n in range(1, 6):
        seen, reward, *_ = env.step(push)
        seen = np.atleast_2d(seen)[0]
        np.testing.assert_allclose(seen[:3], [0, 0, 2], atol=1e-5)
        np.testing.assert_allclose(seen[3:], np.full(3, 2.0 * 0.02 * n), rtol=1e-6)
        assert np.atleast_1d(reward)[0] > 3.0


@pytest.mark.parametrize(
    ("ask", "error", "says"),
    [
        (
            lambda m: m.axis,
            AttributeError,
            r"name one of them, as in m\['cube'\].axis. There are 'cube', 'box'",
        ),
        (lambda m: m.axes, AttributeError, "measures have no 'axes'; there are kinetic, gravity"),
        (lambda m: m["bix"], ValueError, "body is 'bix'; it must be one of 'cube', 'box'"),
        (lambda m: m[2], ValueError, "body is 2"),
        (lambda m: m[-1], ValueError, "body is -1"),
        (lambda m: m[True], TypeError, "body is True"),
        (lambda m: m[0.0], TypeError, "body is 0.0"),
        (lambda m: m[:, 0], TypeError, "body is "),
        (lambda m: list(m), TypeError, "not iterable"),
    ],
)
def test_what_is_asked_of_no_body_is_told(ask: Any, error: type[Exception], says: str) -> None:
    with pytest.raises(error, match=says):
        two(reward=lambda m, s: ask(m))


def test_one_body_has_a_name_too() -> None:
    env = make(reward=lambda m, s: m["cube"].centre[:, 2] + m[0].centre[:, 2] - m.centre[:, 2])
    env.reset(seed=0)
    reward = env.step(np.ones(9, np.float32))[1]
    assert reward == env.unwrapped.episodes.measures.centre[0, 2] != 0
