"""Tasks with bodies that collide: places that move, cheats, opponents and two agents."""

from __future__ import annotations

import copy
import pickle
import warnings
from dataclasses import replace
from typing import Any

import gymnasium as gym
import numpy as np
import pytest

import springgym
from springgym.envs import parallel
from springgym.envs.tasks import balance, duel, juggle, shove, stack
from springgym.model.bodies import rotation
from springgym.simulator import Simulator
from tests.envs.cases import make, make_vec, started, task_type
from tests.envs.playing import play
from tests.envs.test_cheats import classical
from tests.envs.test_contract import same
from tests.params import slow_but

with warnings.catch_warnings():
    warnings.simplefilter("ignore", DeprecationWarning)  # of what PettingZoo's tests import themselves
    from pettingzoo.test import parallel_api_test, parallel_seed_test
    from pettingzoo.utils.wrappers import BaseParallelWrapper

COPIES = 8


@pytest.mark.parametrize(
    ("env_id", "honest"),
    slow_but(
        [("Balance", 300), ("Shove", 200), ("Juggle", 300), ("Labyrinth", 540)],
        *(("Shove", 200), ("Labyrinth", 540)),
    ),
)
def test_who_fails_after_success_has_none(env_id: str, honest: int) -> None:
    """Paddle, plate or pusher runs away, while ball or box is where it should be; the board tips over."""
    env_id = f"Spring{env_id}-v0"
    control = classical(env_id)
    steps = 0
    worst = np.ones(task_type(env_id)().action_space.shape)

    def turns(seen: np.ndarray) -> np.ndarray:
        nonlocal steps
        steps += 1
        return control(seen) if steps <= honest else np.tile(worst, (len(seen), 1))

    played = play(env_id, turns, COPIES, observation="features")
    failed = (played.lengths > honest) & (played.lengths < gym.spec(env_id).max_episode_steps)
    assert failed.sum() > COPIES / 2
    assert not played.successes[failed].any()


# --- SpringBalance --------------------------------------------------------------------------------------


def test_the_ball_rolls_down_a_plate_that_is_held() -> None:
    """With 5/7 g sin α, as a solid ball does; nothing is lost.

    It starts at the height where a level plate carries it. On a tilted one that is off by 1e-3 Δ at most, and
    shakes the normal force, not the mean acceleration.
    """
    task = task_type("SpringBalance-v0")()
    angle = 0.1
    seconds = 0.5
    turn = rotation((0, 1, 0), angle)
    plate, ball = task.scene.bodies
    held = replace(plate, positions=plate.positions @ turn.T, pinned=tuple(range(8)))
    lying = replace(ball, positions=ball.positions @ turn.T)
    simulator = Simulator(task.scene.with_(bodies=(held, lying)), copies=2, step=task.finest)
    began = simulator.measure("ball")
    before = simulator.measure()
    simulator.advance(round(seconds / task.finest))
    ended = simulator.measure("ball")
    after = simulator.measure()
    way = np.linalg.norm((ended.centre - began.centre)[0])
    rolled = 0.5 * 5 / 7 * 9.81 * np.sin(angle) * seconds**2
    assert way == pytest.approx(rolled, rel=1e-3)
    down = ended.centre_velocity[0] @ turn[:, 0]
    lever = balance.BALL_RADIUS + 0.5 * (ended.centre[0] @ turn[:, 2] - balance.HEIGHT - balance.BALL_RADIUS)
    assert ended.angular_velocity[0] @ turn[:, 1] * lever == pytest.approx(down, rel=0.05)
    fallen = before.gravity[0] - after.gravity[0]
    assert abs(after.balance[0] - before.balance[0]) < 1e-3 * fallen


def test_the_place_moves_on_its_circle() -> None:
    """By ωT a period, in every copy by its own ω, and alone as in a batch."""
    envs = make_vec("SpringBalance-v0", 3, "native", "Disabled")
    envs.reset(seed=0)
    goal = envs.unwrapped.episodes.goal
    start = goal.copy()
    for _ in range(5):
        envs.step(np.zeros((3, 2), np.float32))
    turn = 5 * 0.02 * start[:, 5]
    place = (start[:, 0] + 1j * start[:, 1]) * np.exp(1j * turn)
    np.testing.assert_allclose(goal[:, 0] + 1j * goal[:, 1], place, atol=1e-12)
    np.testing.assert_allclose(goal[:, 3] + 1j * goal[:, 4], 1j * start[:, 5] * place, atol=1e-12)
    np.testing.assert_array_equal(goal[:, [2, 5]], start[:, [2, 5]])


def test_a_ball_in_the_air_earns_nothing() -> None:
    env = started("SpringBalance-v0", seed=0)
    simulator = env.unwrapped.episodes.simulator
    x = simulator.positions
    v = simulator.velocities
    x[0, 8:, 2] += 0.1
    simulator.place(x, v)
    _, reward, terminated, _, info = env.step(np.zeros(2))
    assert info["clearance"] > 0.02
    assert reward == 0.0
    assert not terminated


@pytest.mark.slow
def test_a_ball_held_in_the_middle_does_not_do_it() -> None:
    """The place moves, and the middle is no part of it."""
    task = task_type("SpringBalance-v0")(observation="features")
    follow = classical("SpringBalance-v0")
    unit = np.repeat([entry.unit for entry in task.entries], [entry.size for entry in task.entries])

    def stay(seen: np.ndarray) -> np.ndarray:
        known = unit * seen
        known[:, :2] += known[:, 8:10]
        known[:, 8:] = 0.0
        return follow((known / unit).astype(np.float32))

    cheat = play("SpringBalance-v0", stay, COPIES, {"radius": 0.2}, observation="features")
    honest = play("SpringBalance-v0", follow, COPIES, {"radius": 0.2}, observation="features")
    assert (cheat.lengths == 500).all()
    assert not cheat.successes.any()
    assert cheat.returns.max() < 0.3 < 0.8 < honest.returns.min()


# --- SpringShove ----------------------------------------------------------------------------------------


def test_a_box_that_is_not_touched_stays() -> None:
    env = started("SpringShove-v0", seed=0)
    before = env.unwrapped.episodes.particles[0][0, shove.CORNERS :].copy()
    for _ in range(50):
        env.step(np.zeros(2))
    after = env.unwrapped.episodes.particles[0][0, shove.CORNERS :]
    np.testing.assert_allclose(after, before, atol=1e-4)


def test_a_ball_that_is_pushed_rolls() -> None:
    """With 5/7 F/m: a third of a second of 2 N, from rest, far from the box."""
    env = started("SpringShove-v0", seed=0, options={"distance": 1.0})
    pusher = env.unwrapped.episodes.simulator.measure("pusher")
    began = np.array(pusher.centre[0])
    away = began[:2] - env.unwrapped.episodes.simulator.measure("box").centre[0, :2]
    action = 2.0 / shove.FORCE * away / np.linalg.norm(away)
    for _ in range(8):
        env.step(action)
    ended = env.unwrapped.episodes.simulator.measure("pusher").centre[0]
    assert np.linalg.norm(ended - began) == pytest.approx(0.5 * 5 / 7 * 2.0 / shove.MASS * 0.32**2, rel=1e-2)


@pytest.mark.parametrize(("force", "goes_on"), [(4.6, False), (5.6, True)])
def test_what_it_takes_to_push_the_box(force: float, goes_on: bool) -> None:
    """The ball presses with N = F/(1 + μ'), as it rubs on the box, and lifts itself there by μ' N; the floor
    takes μ (m g + μ' N): 5.1 N for the friction μ' = 0.2 between both and μ = 0.4 of the floor."""
    env = started("SpringShove-v0", seed=0, options={"distance": 0.5, "heading": 0.0})
    simulator = env.unwrapped.episodes.simulator
    x = simulator.positions
    v = simulator.velocities
    ball = x[0, : shove.CORNERS]
    box = x[0, shove.CORNERS :]
    place = box[:, :2].mean(axis=0) - (0.15 + shove.RADIUS + 0.8 * shove.REACH, 0.0)
    ball[:, :2] += place - ball[:, :2].mean(axis=0)
    v[0, :, 0] += 0.1
    v[0, : shove.CORNERS] += np.cross((0.0, 0.1 / shove.RADIUS, 0.0), ball - ball.mean(axis=0))
    simulator.place(x, v)
    for _ in range(25):
        env.step(np.array([force / shove.FORCE, 0.0]))
    speed = simulator.measure("box").centre_velocity[0, 0]
    assert (speed > 0.15) == goes_on
    assert (speed < 0.05) == (not goes_on)


@pytest.mark.parametrize(
    ("env_id", "first"), slow_but([("SpringShove-v0", 7), ("SpringStack-v0", 9)], ("SpringShove-v0", 7))
)
def test_pushing_straight_on_does_not_pay(env_id: str, first: int) -> None:
    """Against the box, whichever way it goes, or at the block, whichever way the box is turned: it earns less
    than a fifth of the honest way."""

    def lean(seen: np.ndarray) -> np.ndarray:
        way = -seen[:, first : first + 2]
        return way / np.linalg.norm(way, axis=1, keepdims=True)

    cheat = play(env_id, lean, COPIES, observation="features")
    honest = play(env_id, classical(env_id), COPIES, observation="features")
    assert not cheat.successes.any()
    assert cheat.returns.mean() < 0.2 * honest.returns.mean()


def test_the_right_place_with_the_wrong_heading_is_no_success() -> None:
    env = started("SpringShove-v0", seed=0, options={"distance": 0.0, "heading": 0.5})
    for _ in range(20):
        _, reward, *_, info = env.step(np.zeros(2))
    assert not info["is_success"]
    right = started("SpringShove-v0", seed=0, options={"distance": 0.0, "heading": 0.0})
    for _ in range(20):
        _, more, *_, info = right.step(np.zeros(2))
    assert info["is_success"]
    assert more > reward + 0.1


# --- SpringStack ----------------------------------------------------------------------------------------


def on_the_block(env: gym.Env, aside: float) -> None:
    """Set the box on the block, its middle so far from that of the block along the shelf [m]."""
    simulator = env.unwrapped.episodes.simulator
    x = simulator.positions
    v = simulator.velocities
    box = slice(shove.CORNERS, stack.BLOCKS)
    block = slice(stack.BLOCKS, stack.SHELFS)
    x[0, box] = x[0, block] + (0.0, aside, shove.SIDES[2] + 0.0149)
    simulator.place(x, v)


@pytest.mark.parametrize(("aside", "success"), [(0.0, True), (0.07, True), (0.1, False)])
def test_a_box_on_the_block_is_stacked(aside: float, success: bool) -> None:
    """The block carries it alone: nothing touches the shelf but the ball. That ends the episode, and pays."""
    env = started("SpringStack-v0", seed=0)
    rewards = []
    terminated = False
    on_the_block(env, aside)
    while not terminated and len(rewards) < 20:
        _, reward, terminated, _, info = env.step(np.zeros(2))
        rewards.append(reward)
    assert terminated == info["is_success"] == success
    assert 0.0 < sum(rewards[:-1]) < 0.2
    if success:
        assert (len(rewards), rewards[-1]) == (stack.HOLD, 0.8)
        simulator = env.unwrapped.episodes.simulator
        pairs = [{meeting.first, meeting.second} for meeting in simulator.scene.meetings]
        touching = simulator.pairs().touching[0]
        assert touching[pairs.index({shove.BOX, stack.BLOCK})]
        assert not touching[pairs.index({shove.BOX, stack.SHELF})]


def test_bodies_too_small_for_the_ball_are_refused() -> None:
    env = make("SpringStack-v0", randomize={"scale": (0.6, 0.6)})
    with pytest.raises(ValueError, match=r"allows bodies of scale 0\.6; it must be at least 0\.7"):
        env.reset(seed=0)


def test_a_box_off_the_shelf_ends_the_episode() -> None:
    """Pushed straight on, with all there is, from where the block is far aside."""
    env = started("SpringStack-v0", seed=0, options={"heading": 0.0})
    simulator = env.unwrapped.episodes.simulator
    x = simulator.positions
    v = simulator.velocities
    ball, box, block, _ = np.split(x[0], [shove.CORNERS, stack.BLOCKS, stack.SHELFS])
    block[:, 1] += 0.6 - block[:, 1].mean()
    box[:, :2] += (-0.3, -0.3) - box[:, :2].mean(axis=0)
    ball[:, :2] += (-0.6, -0.3) - ball[:, :2].mean(axis=0)
    simulator.place(x, v)
    for _ in range(100):
        *_, terminated, _, info = env.step(np.array([0.9, 0.0]))
        if terminated:
            break
    assert terminated
    assert not info["diverged"]
    assert not info["is_success"]


# --- SpringJuggle ---------------------------------------------------------------------------------------


def lie_on_the_paddle(env: gym.Env, height: float) -> None:
    """Put the paddle up, and the ball on it to rest."""
    simulator = env.unwrapped.episodes.simulator
    x = simulator.positions
    paddle, ball = np.split(x[0], [8])
    paddle[:, 2] += height
    ball += (0.0, 0.0, height + juggle.BALL_RADIUS + 0.985 * juggle.REACH) - ball.mean(axis=0)
    simulator.place(x, np.zeros_like(x))


@pytest.mark.parametrize("height", [0.0, 0.2])
def test_a_ball_that_is_carried_is_not_juggled(height: float) -> None:
    """It lies on the paddle for two seconds, as high up as the paddle may go: little is earned."""
    env = started("SpringJuggle-v0", observation="features", seed=0, options={"wanted_height": 0.4})
    lie_on_the_paddle(env, height)
    seen, *_ = env.step(np.zeros(5))
    for _ in range(120):
        axis = seen[6:8]
        turning = seen[8:10]
        paddle = 0.1 * seen[:3]
        velocity = seen[3:6]
        lift = np.array([0.0, 0.0, height - juggle.HEIGHT / 4]) - paddle
        torque = (0.2 * np.array([axis[1], -axis[0]]) * 14.0 - 1.4 * 3.0 * turning) / juggle.TORQUE
        push = (400.0 * lift - 40.0 * velocity + [0.0, 0.0, 0.29]) / juggle.FORCE
        seen, reward, terminated, _, info = env.step(np.clip(np.concatenate([push, torque]), -1, 1))
        assert not terminated
        assert not info["is_success"]
        assert reward < 0.35
    assert abs(info["height_offset"] - (height - 0.4)) < 0.02  # it is still there


def test_info_tells_how_near_the_ball_came() -> None:
    """A number from the start on: the reach of the contact where nothing came nearer."""
    env = gym.make("SpringJuggle-v0")
    _, info = env.reset(seed=0, options={"height": 0.3, "lateral_offset": 0.0})
    assert info["pairs_min_gap"] == juggle.REACH
    assert (info["pairs_touching"], info["pairs_impulse"], info["pairs_late_contacts"]) == (0.0, 0.0, 0.0)
    for _ in range(20):  # 0.4 s: it has fallen, and was thrown up again
        info = env.step(np.zeros(5, np.float32))[4]
    assert 0.2 * juggle.REACH < info["pairs_min_gap"] < 0.8 * juggle.REACH
    weight = juggle.BALL_MASS * juggle.FALL
    assert weight * 0.4 < info["pairs_impulse"] < weight * 1.0


def test_the_height_of_a_flight_is_kept_in_the_air() -> None:
    """And it is where the ball turns round."""
    env = started("SpringJuggle-v0", seed=0, options={"height": 0.5, "wanted_height": 0.5})
    for _ in range(10):
        *_, info = env.step(np.zeros(5))
        assert abs(info["height_offset"]) < 1e-6


# --- SpringDuel -----------------------------------------------------------------------------------------


def test_a_push_drives_ones_own_top() -> None:
    """Equal seeds begin alike, and without a push one top moves as the other does, rotated by half a turn."""
    env, twin = (make("SpringDuel-v0", opponent="still") for _ in range(2))
    np.testing.assert_array_equal(env.reset(seed=1)[0], twin.reset(seed=1)[0])
    task = env.unwrapped.episodes.task
    measure = env.unwrapped.episodes.simulator.measure

    def speeds() -> np.ndarray:
        return np.array([measure(name).centre_velocity[0, 0] for name in ("first", "second")])

    before = speeds()
    seen, reward, terminated, _, info = env.step(np.array([1.0, 0.0], np.float32))
    assert env.observation_space.contains(seen)
    assert 0 <= reward <= 1
    assert not terminated
    assert not info["diverged"]
    own, other = speeds() - before
    pushed = task.limits[0] * task.period / task.scene.bodies[0].body.mass
    assert own + other == pytest.approx(pushed, rel=0.1)


def test_both_players_see_the_same_duel() -> None:
    """Turned by half a turn, with the players exchanged, the duel is the same: so is what the first sees."""
    env = started("SpringDuel-v0", observation="features", opponent="still", seed=3)
    episodes = env.unwrapped.episodes
    task = episodes.task
    x, v = episodes.particles
    seen = task.seen_by_second(*episodes.seen[:2])
    half = np.array([-1.0, -1.0, 1.0])
    count = x.shape[1] // 2
    episodes.simulator.place(half * np.roll(x, count, axis=1), half * np.roll(v, count, axis=1))
    episodes.simulator.read()
    np.testing.assert_allclose(episodes.observe()[0], seen[0], atol=1e-6)


@pytest.mark.parametrize("observation", ["particles", "features"])
@pytest.mark.slow
def test_the_opponent_is_asked_for_all_copies_at_once(observation: str) -> None:
    """A function of one's own in place of a name is the same duel, to the bit."""
    asked = []

    def own(seen: np.ndarray) -> np.ndarray:
        asked.append(seen.shape)
        return duel.OPPONENTS["strong"](seen)

    pair = [
        make_vec("SpringDuel-v0", 3, "native", "SameStep", opponent=opponent, observation=observation)
        for opponent in (own, "strong")
    ]
    for envs in pair:
        envs.reset(seed=0)
    for _ in range(30):
        action = np.ones((3, 2), np.float32)
        first, second = (envs.step(action) for envs in pair)
        np.testing.assert_array_equal(first[0], second[0])
    assert set(asked) == {(3, 22)}


def test_opponents_are_checked_and_so_is_what_they_give() -> None:
    with pytest.raises(
        ValueError, match="opponent is 'weak'; it must be one of 'still', 'guard', 'script', "
    ):
        make("SpringDuel-v0", opponent="weak")
    with pytest.raises(TypeError, match="opponent is 3; it must be a name or a function"):
        make("SpringDuel-v0", opponent=3)
    for given in (np.zeros(2), np.full((1, 2), np.nan)):
        env = started("SpringDuel-v0", opponent=lambda seen, given=given: given, seed=0)
        with pytest.raises(ValueError, match=r"the opponent gave .* finite actions of shape \(1, 2\)"):
            env.step(np.zeros(2))


@pytest.mark.slow
def test_waiting_does_not_win() -> None:
    """An idle agent wins no duel; a guarding agent earns less in every duel that it does not win."""
    idle, guard = (
        play("SpringDuel-v0", duel.OPPONENTS[of], 50, observation="features") for of in ("still", "guard")
    )
    assert not idle.successes.any()
    assert guard.returns[~guard.successes].max() < 0.6 * guard.returns[guard.successes].min()


# --- Two agents -----------------------------------------------------------------------------------------


@pytest.mark.parametrize("observation", ["particles", "features"])
@pytest.mark.slow
def test_pettingzoo(observation: str) -> None:
    parallel_api_test(parallel("SpringDuel-v0", observation=observation), num_cycles=200)
    parallel_seed_test(lambda: parallel("SpringDuel-v0", observation=observation), num_cycles=100)


@pytest.mark.parametrize("observation", ["particles", "features"])
@pytest.mark.slow
def test_two_agents_are_an_agent_and_its_opponent(observation: str) -> None:
    """To the bit, for the first; and what the second sees is what an opponent is asked with."""
    asked = []

    def script(seen: np.ndarray) -> np.ndarray:
        asked.append(seen.copy())
        return duel.OPPONENTS["strong"](seen)

    single = make("SpringDuel-v0", opponent=script, observation=observation)
    both = parallel("SpringDuel-v0", observation=observation)
    one, _ = single.reset(seed=4)
    two, _ = both.reset(seed=4)
    for n in range(500):
        np.testing.assert_array_equal(one, two["first"])
        one, reward, terminated, truncated, info = single.step(np.array([0.5, -0.5]))
        if observation == "features":
            np.testing.assert_array_equal(asked[n][0], two["second"])
        second = duel.OPPONENTS["strong"](asked[n])[0]
        two, rewards, ended, _, infos = both.step({"first": np.array([0.5, -0.5]), "second": second})
        assert rewards["first"] == reward
        assert infos["first"]["distance"] == info["distance"] == infos["second"]["other_distance"]
        if terminated or truncated:
            break
    assert terminated
    assert ended == {"first": True, "second": True}
    assert both.agents == []
    assert sum(infos[name]["is_success"] for name in ("first", "second")) == 1
    assert max(rewards.values()) > 0.9


def test_the_second_agent_sees_its_particles_first() -> None:
    both = parallel("SpringDuel-v0")
    seen, _ = both.reset(seed=0)
    turned = seen["first"].reshape(2, 2, -1, 3)[:, ::-1] * np.array([-1, -1, 1])
    np.testing.assert_allclose(seen["second"].reshape(2, 2, -1, 3), turned, atol=1e-6)


def test_weak_actuators_are_those_of_both() -> None:
    """A quarter of the strength is a quarter of the push, of either agent, and of an opponent."""

    def pushes(env: Any) -> list[np.ndarray]:
        env.reset(seed=0)
        whole = env.unwrapped.episodes
        driven = whole.driven_by(whole.strength * [[1.0, 0.5]])
        return [driven[f"{name}.thrust"] for name in ("first", "second")]

    def half(seen: np.ndarray) -> np.ndarray:
        return np.full((len(seen), 2), -0.5)

    for make_it, options in ((parallel, {}), (make, {"opponent": half})):
        weak, strong = (
            make_it("SpringDuel-v0", randomize={"actuator": (factor, factor)}, **options)
            for factor in (0.25, 1.0)
        )
        for env in (weak, strong) if make_it is parallel else ():
            env._answered[:] = -0.5
        for less, more in zip(pushes(weak), pushes(strong), strict=True):
            assert np.abs(more).max() >= 20.0
            np.testing.assert_array_equal(less, 0.25 * more)


@pytest.mark.slow
def test_states_of_two_agents_return() -> None:
    """Through PettingZoo's wrappers, to an environment that has never begun, with the generator."""
    env, other = (BaseParallelWrapper(parallel("SpringDuel-v0")) for _ in range(2))
    with pytest.raises(gym.error.ResetNeeded, match=r"env\.state\(\)"):
        env.state()
    seen, _ = env.reset(seed=2)
    np.testing.assert_array_equal(env.state(), seen["first"])
    assert env.state_space.contains(env.state())
    rng = np.random.default_rng(0)
    actions = [dict(zip(("first", "second"), rng.uniform(-1, 1, (2, 2)), strict=True)) for _ in range(20)]

    def lives(env: Any) -> Any:
        steps = [env.step(action) for action in actions]
        return [steps, env.unwrapped.np_random.integers(2, 5), env.reset(), env.agents]

    env.step(actions[0])
    state = pickle.loads(pickle.dumps(springgym.get_state(env)))
    follows = lives(env)
    for one in (env, other):
        springgym.set_state(one, state)
        assert one.unwrapped.np_random_seed == 2
        same(lives(one), follows)
    other.unwrapped.agents = []
    springgym.set_state(env, springgym.get_state(other))
    assert env.step(actions[0]) == ({}, {}, {}, {}, {})
    for wrong in (state | {"agents": ["third"]}, state | {"episodes": {}}, {}):
        with pytest.raises(ValueError, match="state"):
            springgym.set_state(env, wrong)
    assert env.agents == []


def test_pettingzoo_s_registry_makes_it() -> None:
    """Whichever was imported first, after `register`."""
    pettingzoo = pytest.importorskip("pettingzoo", "1.27")
    springgym.register()
    env = pettingzoo.make("parallel", "SpringDuel-v0", max_cycles=7, observation="features")
    assert type(env) is type(parallel("SpringDuel-v0"))
    assert (env.episodes.max_episode_steps, env.observation_space("first").shape) == (7, (22,))
    assert pettingzoo.make("parallel", "SpringDuel").episodes.max_episode_steps == 500


@pytest.mark.parametrize("kind", ["action_space", "observation_space"])
def test_each_player_draws_from_spaces_of_its_own(kind: str) -> None:
    """What seeds one space leaves the others, the state's and those of other environments alone."""
    both, again = (parallel("SpringDuel-v0") for _ in range(2))
    first, second = (getattr(both, kind)(agent) for agent in both.possible_agents)
    others = [second, both.state_space, getattr(again, kind)("first")]
    for n, space in enumerate(others):
        space.seed(n)
    expected = [copy.deepcopy(space).sample() for space in others]
    first.seed(0)
    first.sample()
    for space, sample in zip(others, expected, strict=True):
        np.testing.assert_array_equal(space.sample(), sample)
    assert first == second
    assert first is getattr(both, kind)("first")


def test_refusals_of_two_agents() -> None:
    with pytest.raises(ValueError, match=r"'SpringTop-v0'; it must be .* of several agents: Spring"):
        parallel("SpringTop-v0")
    with pytest.raises(TypeError, match=r"no argument 'spars'; choose from: (?!.*(opponent|sparse))"):
        parallel("SpringDuel-v0", spars=True)
    both = parallel("SpringDuel-v0", tolerance=0.1)
    both.reset(seed=0)
    with pytest.raises(ValueError, match="actions has no action for 'second'"):
        both.step({"first": np.zeros(2)})
    with pytest.raises(TypeError, match=r"actions is \[.*; it must be a mapping"):
        both.step([np.zeros(2), np.zeros(2)])
    before = both.np_random.bit_generator.state
    for options in ([], ["spin"], 3):
        with pytest.raises(TypeError, match=r"options is .*; it must be a mapping"):
            both.reset(seed=1, options=options)
    with pytest.raises(TypeError, match="np_random is 3"):
        both.np_random = 3
    assert (both.np_random.bit_generator.state, both.chosen.error < 0.1) == (before, True)
