"""Pictures of tasks: every action is seen, and the key says what is true."""

from __future__ import annotations

from typing import Any

import gymnasium as gym
import numpy as np
import pytest

from springgym.dynamics.measures import SIZE, view
from springgym.envs.arrows import ARC
from springgym.envs.observation import Situation
from springgym.envs.scene import SceneTask
from springgym.model.bodies import cube
from springgym.model.scene import DriveActuator, Placed, Scene, ThrustActuator
from springgym.rendering import Marks
from springgym.rendering.look import GREEN, RED
from tests.envs.cases import DUEL, IDS, each_kind, make, make_vec, task_type
from tests.params import slow_unless

each_action = pytest.mark.parametrize(
    ("env_id", "action"),
    [
        pytest.param(env_id, action, marks=slow_unless(env_id != DUEL))
        for env_id in IDS
        for action in task_type(env_id).actions
    ],
)


def acted(env: gym.Env, action: np.ndarray):
    """The marks after a step from one start."""
    env.reset(seed=1)
    env.step(action.astype(np.float32))
    episodes = env.unwrapped.episodes
    return episodes.task.marks(*episodes.seen_of(0))


def red(marks):
    return [np.append(a.origin, a.vector) for a in marks.arrows if a.color == RED and np.any(a.vector)]


@each_action
def test_every_entry_of_the_action_is_seen(env_id: str, action: str) -> None:
    """Red arrows tell how much of it acts, and which way; none is there where nothing acts."""
    env = make(env_id, action=action)
    size = env.action_space.shape[0]
    assert not red(acted(env, np.zeros(size)))
    for n in range(size):
        full, half, back = (red(acted(env, share * np.eye(size)[n])) for share in (1.0, 0.5, -1.0))
        assert len(full) == len(half) == len(back) == 1
        one = full[0][3:]
        less = half[0][3:]
        other = back[0][3:]
        assert np.linalg.norm(less) == pytest.approx(0.5 * np.linalg.norm(one), rel=0.1)
        assert one @ other < -0.9 * np.linalg.norm(one) * np.linalg.norm(other)


@each_action
def test_the_key_says_what_is_there(env_id: str, action: str) -> None:
    """Every colour of the key is in the picture, and every arrow and target has its colour in the key."""
    env = make(env_id, action=action)
    task = env.unwrapped.episodes.task
    marks = acted(env, np.ones(env.action_space.shape))
    key = [color for color, _ in marks.key]
    assert len(set(key)) == len(key)
    marked = {arrow.color for arrow in marks.arrows}
    marked |= {GREEN} if (*marks.rings, *marks.balls) else set()
    look = task.look()
    drawn = {tuple(color) for color in np.concatenate([look.triangle_colors, look.ball_colors]).tolist()}
    lined = {color for *_, color in marks.edges}
    assert marked <= set(key) <= marked | lined | drawn
    assert lined <= set(key) | drawn
    assert RED in key
    assert not {GREEN, RED} & drawn  # bodies are neither targets nor actions


@pytest.mark.parametrize(("env_id", "action"), [("SpringTop-v0", "torque"), ("SpringShove-v0", "push")])
def test_pictures_show_the_action(env_id: str, action: str) -> None:
    env = make(env_id, action=action, render_mode="rgb_array")
    shown = []
    for share in (0.0, 1.0, -1.0):  # one of both may act into the body, where it is pale
        env.reset(seed=1)
        env.step(np.full(env.action_space.shape, share, np.float32))
        r, g, b = env.render().astype(int).transpose(2, 0, 1)
        shown.append(((r > 120) & (r > 2.5 * g) & (r > 2.5 * b)).sum())
    assert 50 < shown[0] < 250  # in the key
    assert max(shown) > shown[0] + 100


@each_kind
def test_first_pictures_hold_all_that_counts_and_little_else(env_id: str) -> None:
    """The second one is equal, to the pixel: the trace begins with the first."""
    batch = make_vec(env_id, 1, "native", "Disabled", render_mode="rgb_array")
    for env in (make(env_id, render_mode="rgb_array").unwrapped, batch):
        for seed in range(5):
            env.reset(seed=seed)
            np.testing.assert_array_equal(env.render(), env.render())
            canvas = env._canvases[0]
            pixels, _ = canvas.camera.project(
                env.episodes.task.framed(env.episodes.seen_of(0)[1]), (640, 640)
            )
            assert ((pixels > 12) & (pixels < 628)).all()
            assert np.ptp(pixels, axis=0).max() > 220


def test_pictures_say_which_step_it_is_and_whether_it_succeeds() -> None:
    env = make("SpringTop-v0")
    episodes = env.unwrapped.episodes
    _, info = env.reset(seed=1, options={"tilt": 0.0, "spin": 50.0})
    for step in range(episodes.task.hold_steps + 10):
        head, *others = episodes.marks(0).text
        assert head == f"step {step}"
        assert ("success" in others) == info["is_success"]
        *_, info = env.step(np.zeros(env.action_space.shape, np.float32))
    assert info["is_success"]


@pytest.mark.slow
def test_duel_tells_the_tops_apart() -> None:
    """The colours that the key gives them are those of their own faces."""
    env = make("SpringDuel-v0")
    task = env.unwrapped.episodes.task
    key = {line: color for color, line in acted(env, np.ones(2)).key}
    faces = np.split(np.asarray(task.look().triangle_colors), 2)
    own, other = ({tuple(color) for color in half.tolist()} for half in faces)
    assert key["agent's top"] in own - other
    assert key["opponent's top"] in other - own


def test_juggle_says_how_high_this_flight_goes() -> None:
    env = make("SpringJuggle-v0")
    for height, word in ((0.3, "low"), (0.7, "high")):
        env.reset(seed=1, options={"wanted_height": 0.5, "height": height, "lateral_offset": 0.0})
        task = env.unwrapped.episodes.task
        seen = env.unwrapped.episodes.seen_of(0)
        (line,) = task.marks(*seen).text
        assert line.startswith("apex 20.")
        assert line.endswith(f"cm too {word}")


def test_billiards_shows_where_to_aim() -> None:
    """A ball at the target touches the other one on its line to the pocket; there is none once that moves."""
    env = make("SpringBilliards-v0")
    env.reset(seed=1)
    episodes = env.unwrapped.episodes
    m, s = episodes.seen_of(0)
    marks = episodes.task.marks(m, s)
    cue, ball = m.centre
    pocket = np.array([*s.goal, m.centre[1, 2]])
    ((aim, radius),) = marks.balls
    assert np.linalg.norm(aim - ball) == pytest.approx(2 * radius)
    assert (aim - ball) @ (pocket - ball) == pytest.approx(-2 * radius * np.linalg.norm(pocket - ball))
    np.testing.assert_allclose([edge[:2] for edge in marks.edges], [(ball, pocket), (cue, aim)])
    assert marks.text == (f"{100 * np.linalg.norm(pocket - ball):.0f} cm from the pocket",)
    env.step(((aim - cue)[:2] / np.linalg.norm(aim - cue)).astype(np.float32))
    assert not episodes.task.marks(*episodes.seen_of(0)).balls


def test_a_ball_that_rolls_away_does_not_make_all_tiny() -> None:
    env = make("SpringBilliards-v0", render_mode="rgb_array")
    env.reset(seed=3)
    env.step(np.array([0.9, -0.9], np.float32))
    env.render()
    episodes = env.unwrapped.episodes
    assert np.abs(episodes.seen_of(0)[0].centre).max() > 3.0
    camera = env.unwrapped._canvases[0].camera
    assert camera.pixels_per_radian(640) / camera.distance * 0.06 > 8


def test_tower_outlines_the_block_that_it_holds() -> None:
    env = make("SpringTower-v0")
    episodes = env.unwrapped.episodes
    env.reset(seed=1)
    for held in (1, 2):
        m, s = episodes.seen_of(0)
        lines = episodes.task.marks(m, s).edges
        lengths = [np.linalg.norm(line[1] - line[0]) for line in lines]
        np.testing.assert_allclose(sorted(lengths), [0.16] * 8 + [0.24] * 4, rtol=0.02)
        ends = np.unique(np.array([line[:2] for line in lines]).reshape(-1, 3), axis=0)
        np.testing.assert_array_equal(ends, np.unique(s.x[8 * held : 8 * held + 8], axis=0))
        env.step(np.array([0, 0, 0, 1], np.float32))


def test_tasks_of_scenes_show_what_their_actions_drive() -> None:
    """Of two bodies, the first turned by a quarter about x, each at its own place."""
    side = np.ptp(cube().positions, axis=0)[0]
    first = Placed(cube(), name="first", thrust=ThrustActuator((1, 6), turns=True))
    second = Placed(cube(), cube().positions + 3.0, pinned=(2,), name="second", drive=DriveActuator(2, 1.0))
    actuators = {
        "first.force": (0.0, 4.0, 8.0),
        "first.body_torque": 2.0,
        "first.thrust": 3.0,
        "second.torque": 1.0,
        "second.acceleration": (5.0, 0.0, 0.0),
    }
    scene = Scene(bodies=(first, second), gravity=None, collisions=None)
    task = SceneTask(scene, lambda m, s: s.time, actuators)
    m = view(np.zeros((2, SIZE)))
    m.centre[1] = 7.0
    m.side[:] = (1, 0, 0)
    m.axis[:] = ((0, -1, 0), (0, 0, 1))
    action = np.array([0.5, -1, 0, 0, 1, 0, 1, 0, 1, 0, 0, 0, 0, 0.2, 0.5])
    empty = np.zeros(0)
    s = Situation(scene.positions, 0 * scene.positions, action, empty, empty, empty, empty)
    marks = task.marks(m, s)
    reach = 0.5 * side
    wanted = [
        (m.centre[0], (0, 0.25, -1), 0),  # 4 N is half of the most
        (m.centre[0], (0, -ARC, 0), reach),
        (scene.positions[1], (0, 0, 1), 0),
        (scene.positions[6], (1, 0, 0), 0),
        (m.centre[1], (0, 0, 0.2 * ARC), reach),
        (scene.positions[8 + 2], (0.5, 0, 0), 0),
    ]
    assert len(marks.arrows) == len(wanted)
    for arrow, (origin, vector, radius) in zip(marks.arrows, wanted, strict=True):
        np.testing.assert_allclose(arrow.origin, origin)
        np.testing.assert_allclose(arrow.vector, reach * np.array(vector), atol=1e-12)
        assert (arrow.color, arrow.radius) == (RED, radius)
    assert marks.key == ((RED, ", ".join(actuators)),)
    own = SceneTask(scene, lambda m, s: s.time, actuators, marks=lambda m, s: Marks(text=("own",)))
    assert own.marks(m, s).text == ("own",)
    assert not own.marks(m, s).arrows


@pytest.mark.usefixtures("small_pictures")
def test_a_film_forgets_what_another_state_undid() -> None:
    """It begins anew with a picture of the state; the same actions then give the same film."""
    env: Any = make("SpringPendulum-v0", render_mode="rgb_array_list").unwrapped
    env.reset(seed=0)
    state = env.get_state()
    films = []
    for _ in range(2):
        for _ in range(3):
            env.step(np.full(env.action_space.shape, 0.5))
        films.append(env.render())
        env.set_state(state)
    assert [len(film) for film in films] == [4, 4]
    np.testing.assert_array_equal(*films)
    env.step(np.zeros(env.action_space.shape))
    env.reset(seed=0)
    env.set_state(state)
    assert len(env.render()) == 1
