"""True states: they come back whole, through wrappers, and nowhere else."""

from __future__ import annotations

import copy
import pickle
import re
import threading
from collections.abc import Callable
from typing import Any

import gymnasium as gym
import numpy as np
import pytest

import springgym
from springgym.envs.base import SingleEnv, SpringEnv, SpringVectorEnv
from springgym.envs.players import ParallelDuel
from springgym.model.bodies import cube
from springgym.model.scene import Scene
from springgym.simulator import Simulator
from tests.envs.cases import IDS, each_kind, make, make_vec, started
from tests.envs.test_contract import answered, same

LIMIT = 10


def frozen(env: Any) -> Any:
    """All that an environment has in store, copied."""
    return copy.deepcopy(springgym.get_state(env))


def actions(env: Any, count: int) -> np.ndarray:
    return np.random.default_rng(1).uniform(-1, 1, (count, *env.action_space.shape)).astype(np.float32)


def lives(env: Any, steps: np.ndarray) -> list[Any]:
    return [env.step(action) for action in steps]


@each_kind
def test_state_returns_with_the_time_limit(env_id: str) -> None:
    """Of gym.make, also to an environment that has never been reset: it is cut where it was."""
    env = started(env_id, max_episode_steps=LIMIT, seed=0)
    steps = actions(env, LIMIT)
    lives(env, steps[:4])
    state = pickle.loads(pickle.dumps(springgym.get_state(env)))
    follows = lives(env, steps[4:])
    assert [step[3] for step in follows] == [False] * 5 + [True]
    follows.append(env.reset())
    for other in (env, make(env_id, max_episode_steps=LIMIT)):
        springgym.set_state(other, state)
        same([*lives(other, steps[4:]), other.reset()], follows)
        assert other.unwrapped.np_random_seed == 0


@pytest.mark.parametrize("autoreset", ["NextStep", "SameStep"])
@pytest.mark.parametrize("options", [{}, {"randomize": answered(IDS[0])}], ids=["", "randomized"])
def test_state_of_a_batch_returns_through_wrappers(autoreset: str, options: dict[str, Any]) -> None:
    made = [make_vec(IDS[0], 3, "native", autoreset, max_episode_steps=LIMIT, **options) for _ in range(2)]
    envs, fresh = (gym.wrappers.vector.ClipReward(made_, 0.0, 0.5) for made_ in made)
    envs.reset(seed=3)
    steps = actions(envs, 25)
    lives(envs, steps[:LIMIT])
    state = springgym.get_state(envs)
    follows = lives(envs, steps[LIMIT:])
    for other in (envs, fresh):
        springgym.set_state(other, state)
        same(lives(other, steps[LIMIT:]), follows)
        assert other.unwrapped.np_random_seed == (3, 4, 5)


def variants() -> dict[str, Any]:
    """States of environments that are not SpringTop-v0, single, in float64."""
    given: dict[str, Any] = {
        "another task": make("SpringGyroscope-v0"),
        "another action": make(IDS[0], action="impulse"),
        "other dynamics": make(IDS[0], dynamics="rigid"),
        "another body": make(IDS[0], body={"mass": 11.0}),
        "randomised": make(IDS[0], randomize={"actuator": (0.5, 1.0)}),
        "a harder variant": make(IDS[0], hard=True),
        "another reward": make(IDS[0], sparse=True),
        "other steps": make(IDS[0], step=2.5e-4),
        "copies": make_vec(IDS[0], 2, "native", "SameStep"),
        "one copy of a batch": make_vec(IDS[0], 1, "native", "SameStep"),
    }
    for env in given.values():
        env.reset(seed=0)
    return {name: frozen(env) for name, env in given.items()}


def mangled(state: dict[str, Any]) -> dict[str, Any]:
    """Ways to spoil a state."""
    spoilt: dict[str, Any] = {"no mapping": [state], "nothing": {}, "None": None}
    spoilt |= {f"no {key}": {k: v for k, v in state.items() if k != key} for key in state}
    for key in state["episodes"]:
        spoilt[f"no {key} in episodes"] = state | {
            "episodes": {k: v for k, v in state["episodes"].items() if k != key}
        }
        spoilt[f"odd {key}"] = state | {"episodes": state["episodes"] | {key: np.zeros((2, 2), np.float32)}}
    kinds = ({"bit_generator": name} for name in ("seed", "Generator", "PCG65", "MT19937", 3))
    rngs: list[Any] = [None, 3, [], {}, state["rng"] | {"state": {"state": 1}}]
    rngs += [state["rng"] | kind for kind in kinds]
    spoilt |= {f"rng {n}": state | {"rng": rng} for n, rng in enumerate(rngs)}
    spoilt |= {f"seed {seed}": state | {"seed": seed} for seed in (None, "1", -2, 1.5, True)}
    spoilt |= {f"ready {ready}": state | {"ready": ready} for ready in (None, "no", 1, np.zeros(3))}
    return spoilt


def check_refused(env: Any, states: dict[str, Any], says: str = "state", copies: Any = None) -> None:
    """``says`` holds {} where the name of the state is told."""
    before = frozen(env)
    for name, state in states.items():
        with pytest.raises((ValueError, TypeError), match=says.replace("{}", re.escape(name))):
            springgym.set_state(env, state, copies)
        same(frozen(env), before, name)


@pytest.mark.parametrize(
    ("state", "says"),
    [
        ({}, "state lacks 'episodes'; it must hold episodes, rng, seed, ready"),
        ({"a": 1, 2: 3}, "state lacks '2'; it must hold episodes, rng"),
        ([1], r"state is \[1\]; it must be Mapping"),
        (None, "state is None; it must be Mapping"),
    ],
)
def test_what_is_no_state_is_told(state: Any, says: str) -> None:
    env = started(IDS[0], seed=5)
    with pytest.raises((TypeError, ValueError), match=says):
        springgym.set_state(env, state)


def test_states_of_others_are_refused_and_change_nothing() -> None:
    env = started(IDS[0], seed=5)
    lives(env, actions(env, 3))
    check_refused(env, variants())


def test_mangled_states_are_refused_and_change_nothing() -> None:
    env = started(IDS[0], seed=5)
    check_refused(env, mangled(frozen(env)))
    envs = make_vec(IDS[0], 3, "native", "SameStep")
    envs.reset(seed=5)
    state = frozen(envs)
    check_refused(
        envs,
        {
            "two rngs": state | {"rng": state["rng"][:2]},
            "one rng mangled": state | {"rng": [*state["rng"][:2], {}]},
            "ends of two": state | {"ended": state["ended"][:2]},
            "ends as numbers": state | {"ended": state["ended"].astype(int)},
            "two seeds": state | {"seed": state["seed"][:2]},
        },
    )
    check_refused(envs, mangled(frozen(env)), copies=[1, 2])


def with_(state: dict[str, Any], **arrays: Any) -> dict[str, Any]:
    """A state with other arrays of the episodes."""
    return state | {"episodes": state["episodes"] | arrays}


def test_an_edited_state_is_what_is_simulated() -> None:
    """Positions, velocities and factors; the others stay."""
    env = started("SpringTumble-v0", randomize={"masses": (0.8, 1.2), "actuator": (0.5, 1.0)}, seed=5)
    steps = actions(env, 4)
    lives(env, steps[:2])
    state = frozen(env)
    inner = state["episodes"]["simulator"]
    inner["x"]["lanes"] += 0.25
    inner["v"]["lanes"][:, :, 2] += 1.0
    before = env.unwrapped.episodes.simulator
    x = before.positions + 0.25
    v = before.velocities + np.eye(3)[2]
    factors = state["episodes"]["factors"]
    factors[:] = [[1.15, 0.75]]
    springgym.set_state(env, state)
    simulator = env.unwrapped.episodes.simulator
    np.testing.assert_array_equal(simulator.positions, x)
    np.testing.assert_array_equal(simulator.velocities, v)
    other = make("SpringTumble-v0", randomize={"masses": (0.8, 1.2), "actuator": (0.5, 1.0)})
    own = other.unwrapped.episodes
    springgym.set_state(other, with_(state, factors=np.ones((1, 2))))
    own.simulator.vary(None, masses=1.15 * own.simulator.scene.of_bodies("masses"))
    own.factors[:] = factors
    own.strength[:] = 0.75
    same(frozen(env), frozen(other))
    first = lives(env, steps[2:])
    again = frozen(env)
    springgym.set_state(env, state)
    same(lives(env, steps[2:]), first)
    same(frozen(env), again)


def test_numbers_that_no_episode_has_are_refused() -> None:
    """Above all those that compiled code takes for indices."""
    env = started("SpringTumble-v0", randomize={"masses": (0.8, 1.2)}, seed=5)
    state = frozen(env)
    goal = state["episodes"]["goal"]
    wrong: dict[str, Any] = {}
    for corner in (4.0, -1.0, 0.5, 1e300, np.nan, np.inf):
        wrong[f"goal {corner}"] = with_(state, goal=np.where(np.arange(4) == 3, corner, goal))
    for factor in (1.3, 0.7, np.nan):
        wrong[f"factor {factor}"] = with_(state, factors=np.full((1, 1), factor))
    wrong["time"] = with_(state, time=np.full(1, np.nan))
    wrong["elapsed"] = with_(state, elapsed=np.zeros(1))
    check_refused(env, wrong, r"state\['(goal|factors|time|elapsed)'\]")


def test_names_of_agents_that_there_are_not_are_refused() -> None:
    env = ParallelDuel()
    env.reset(seed=0)
    state = frozen(env)
    check_refused(env, {f"{given}": state | {"agents": given} for given in (["third"], "first", None, [0])})


# --- Calls that break off -----------------------------------------------------------------------------

STEPS = ["driven_by", "actuate", "advance", "_advance", "_evaluate", "_finish", "observe", "info_arrays"]
RESETS = ["place", "_read", "_reset_rows", "_evaluate", "observe", "info_arrays"]
PLACES = [*((True, where) for where in STEPS), *((False, where) for where in RESETS)]


def broken_off(patch: pytest.MonkeyPatch, env: Any, where: str, call: Callable[[], Any]) -> None:
    """Ctrl-C in a call, served when something in it has returned."""
    own = env.unwrapped
    owners: list[Any] = [own, own.episodes, Simulator, own.episodes.simulator]
    owner = next(owner for owner in owners if hasattr(owner, where))
    function = getattr(owner, where)

    def interrupting(*arguments: Any, **options: Any) -> None:
        function(*arguments, **options)
        raise KeyboardInterrupt

    with patch.context() as during:
        during.setattr(owner, where, interrupting)
        with pytest.raises(KeyboardInterrupt):
            call()


@pytest.mark.parametrize(
    ("step", "where", "copies"), [(*place, (3, None)[n % 2]) for n, place in enumerate(PLACES)]
)
def test_after_a_call_that_broke_off_a_reset_is_asked_for(
    monkeypatch: pytest.MonkeyPatch, copies: int | None, step: bool, where: str
) -> None:
    """Wherever it did. Then all is as in an environment in which nothing of the kind has happened."""
    made = make if copies is None else lambda name, **how: make_vec(name, copies, "native", "SameStep", **how)
    env, fresh = (made(IDS[0], render_mode="rgb_array") for _ in range(2))
    steps = actions(env, 4)
    env.reset(seed=3)
    lives(env, steps[:2])
    broken_off(monkeypatch, env, where, lambda: env.step(steps[2]) if step else env.reset())
    assert not springgym.get_state(env)["ready"]
    before = frozen(env)
    for call in (lambda: env.step(steps[3]), env.render):
        with pytest.raises(gym.error.ResetNeeded, match="the last step or reset broke off"):
            call()
    if copies:
        with pytest.raises(ValueError, match="reset_mask leaves out some, and the last step"):
            env.reset(options={"reset_mask": np.array([True, False, True])})
    same(frozen(env), before)
    same([env.reset(seed=5), *lives(env, steps)], [fresh.reset(seed=5), *lives(fresh, steps)])


def test_a_reward_that_raises_leaves_no_step_half_counted() -> None:
    wrong: list[str] = []

    def reward(m: Any, s: Any) -> Any:
        if wrong:
            raise RuntimeError(wrong.pop())
        return m.centre[:, 2]

    def make_own() -> Any:
        scene = Scene(cube(), gravity=None)
        return springgym.make_scene_env(scene, reward, actuators={"torque": 1.0}, max_episode_steps=LIMIT)

    env = make_own()
    fresh = make_own()
    steps = actions(env, LIMIT)
    for own in (env, fresh):
        own.reset(seed=0)
    good = springgym.get_state(env)
    wrong.append("no reward today")
    with pytest.raises(RuntimeError, match="no reward today"):
        env.step(steps[0])
    with pytest.raises(gym.error.ResetNeeded, match="the last step or reset broke off in the middle"):
        env.step(steps[0])
    springgym.set_state(env, good)  # what goes back to before the step takes it anew
    follows = lives(env, steps)
    same(follows, lives(fresh, steps))
    assert follows[-1][3]


# --- Threads ------------------------------------------------------------------------------------------


@pytest.mark.parametrize("copies", [None, 3])
def test_another_thread_is_told_and_does_not_wait(copies: int | None) -> None:
    made = make if copies is None else lambda name: make_vec(name, copies, "native", "SameStep")
    env = made(IDS[0]).unwrapped
    alone = made(IDS[0]).unwrapped
    steps = actions(env, 3)
    for own in (env, alone):
        own.reset(seed=0)
    function = env.episodes._judge
    inside = threading.Event()
    go_on = threading.Event()

    def waiting(*arguments: Any, **named: Any) -> None:
        inside.set()
        assert go_on.wait(60)
        function(*arguments, **named)

    env.episodes._judge = waiting
    thread = threading.Thread(target=env.step, args=(steps[0],))
    thread.start()
    try:
        assert inside.wait(60)
        for name in ("reset", "step", "render", "get_state", "set_state"):
            told = f"two threads use one {type(env).__name__} at once: {name} was called"
            with pytest.raises(RuntimeError, match=told):
                getattr(env, name)()
    finally:
        go_on.set()
        thread.join()
    del env.episodes._judge
    alone.step(steps[0])
    same(lives(env, steps[1:]), lives(alone, steps[1:]))


def test_every_environment_is_guarded() -> None:
    for kind in (SingleEnv, SpringEnv, SpringVectorEnv, ParallelDuel):
        for name in {"reset", "step", "render", "get_state", "set_state"} & vars(kind).keys():
            assert hasattr(getattr(kind, name), "__wrapped__"), (kind, name)


def test_other_environments_have_no_such_state() -> None:
    for env in (gym.make("CartPole-v1"), make_vec(IDS[0], 2, "sync", "SameStep"), None):
        with pytest.raises(TypeError, match="must be an environment, or a native batch, of springgym"):
            springgym.get_state(env)
        with pytest.raises(TypeError, match="of springgym"):
            springgym.set_state(env, {})


# --- Copies of a batch --------------------------------------------------------------------------------


def followed(env: Any, steps: np.ndarray) -> list[Any]:
    """What a single environment sees and earns, reset where its episode ends, as batches do it."""
    found = []
    ended = False
    for action in steps:
        if ended:
            found.append((env.reset()[0], 0.0, False, False))
        else:
            found.append(env.step(action)[:4])
        ended = found[-1][2] or found[-1][3]
    return found


def check_continued(envs: Any, copies: Any, steps: np.ndarray, expected: list[Any]) -> None:
    """Step a batch, some copies as a single environment was and the others otherwise; these are its twins."""
    own = np.arange(envs.num_envs)[copies]
    for n, step in enumerate(expected):
        taken = np.random.default_rng(n).uniform(-1, 1, envs.action_space.shape)
        taken[own] = steps[n]
        for part, wanted in zip(envs.step(taken)[:4], step, strict=True):
            same(part[own], np.stack([wanted] * len(own)).astype(part.dtype), f"step {n}")


FACTORS = answered(IDS[0])


@pytest.mark.parametrize(
    ("env_id", "options"),
    [
        (IDS[0], {}),
        pytest.param(IDS[0], {"randomize": FACTORS}, marks=pytest.mark.slow),
        pytest.param("SpringGyroscope-v0", {"sparse": True}, marks=pytest.mark.slow),  # with a goal
        ("SpringTumble-v0", {}),  # which hits the floor, with a particle for a goal
        pytest.param("SpringTumble-v0", {"randomize": {"masses": (0.9, 1.1)}}, marks=pytest.mark.slow),
        pytest.param("SpringBalance-v0", {"randomize": {"masses": (0.9, 1.1)}}, marks=pytest.mark.slow),
        pytest.param(IDS[0], {"dynamics": "rigid"}, marks=pytest.mark.slow),
    ],
)
def test_copies_continue_a_single_environment(env_id: str, options: dict[str, Any]) -> None:
    """To the bit, over two ends of its episodes; what the other copies do is not touched."""
    single = started(env_id, max_episode_steps=30, **options, seed=11)
    steps = actions(single, 80)
    followed(single, steps[:9])
    state = pickle.loads(pickle.dumps(springgym.get_state(single)))
    expected = followed(single, steps[9:])
    assert sum(step[2] or step[3] for step in expected) >= 2
    envs, other = (make_vec(env_id, 20, "native", "NextStep", max_episode_steps=30, **options) for _ in "12")
    for batch in (envs, other):
        batch.reset(seed=0)
        batch.step(actions(batch, 1)[0])
    copies = np.array([17, 0, 3, 15, 16])
    springgym.set_state(envs, state, copies)
    left = np.setdiff1d(np.arange(20), copies)
    same(springgym.get_state(envs, left), springgym.get_state(other, left))
    assert envs.unwrapped.np_random_seed[17] == 11
    assert len({id(rng) for rng in envs.unwrapped.np_random}) == 20
    check_continued(envs, copies, steps[9:], expected)
    fresh = make_vec(env_id, 2, "native", "NextStep", max_episode_steps=30, **options)
    springgym.set_state(fresh, state, [0, 1])  # of which no episode has begun
    check_continued(fresh, [0, 1], steps[9:], expected)


@pytest.mark.parametrize("autoreset", ["NextStep", "SameStep"])
def test_copies_continue_copies_of_another_batch(autoreset: str) -> None:
    """Through wrappers, in another order, or one in all; where they have ended, too."""
    options = {"max_episode_steps": LIMIT, "randomize": FACTORS}
    of, into, alike = (make_vec(IDS[0], n, "native", autoreset, **options) for n in (18, 35, 3))
    of.reset(seed=0)
    wrapped = gym.wrappers.vector.ClipReward(into, 0.0, 0.5)
    steps = np.random.default_rng(0).uniform(-1, 1, (2 * LIMIT, 18, 3))
    for taken in steps[:LIMIT]:
        of.step(taken)
    state = springgym.get_state(of, [17, 2, 16])
    one = springgym.get_state(of, np.arange(18) == 2)
    wrapped.reset(seed=9)
    springgym.set_state(wrapped, state, [1, 34, 0])
    springgym.set_state(wrapped, one, range(2, 34))
    springgym.set_state(alike, state)  # which is that of a batch of three
    for taken in steps[LIMIT:]:
        expected = of.step(taken)
        which = np.array([16, 17, *[2] * 33])
        for own, found in ((which, into.step(taken[which])), ([17, 2, 16], alike.step(taken[[17, 2, 16]]))):
            for theirs, got in zip(expected[:4], found[:4], strict=True):
                same(got, theirs[own])


def test_copies_that_no_state_can_be_set_into_are_refused() -> None:
    single = make(IDS[0])
    envs = make_vec(IDS[0], 4, "native", "NextStep")
    for env in (single, envs):
        env.reset(seed=0)
    state = springgym.get_state(single)
    two = springgym.get_state(envs, [0, 1])
    before = frozen(envs)
    wrong: list[tuple[Any, Any, type[Exception], str]] = [
        (state, [], ValueError, "copies is .*must name a copy"),
        (state, np.zeros(4, bool), ValueError, "must name a copy"),
        (state, [4], ValueError, r"copies\[0\] is 4; it must be a whole number from 0 to 3"),
        (two, [0, 1, 2], ValueError, "the state holds 2 copies, but copies names 3; it must hold 3 copies"),
        (two, [3], ValueError, "the state holds 2 copies, but copies names 1"),
        (before, [3], ValueError, "the state holds 4 copies"),
        (two | {"rng": two["rng"][:1]}, [0, 1], ValueError, r"state\['rng'\] has 1 entries; it must have 2"),
        (two | {"ended": np.ones(3, bool)}, [0, 1], ValueError, r"state\['ended'\] is an array of bool"),
        (two | {"seed": [1, -2]}, [0, 1], ValueError, r"state\['seed'\] is -2; it must be"),
        (state, None, ValueError, "the state is that of a single environment; name copies"),
        ({}, [0], ValueError, "state lacks 'ended'"),
        (None, [0], TypeError, "state is None"),
        (state | {"episodes": 3}, [0], TypeError, r"state\['episodes'\] is 3; it must be Mapping"),
    ]
    for given, copies, kind, says in wrong:
        with pytest.raises(kind, match=says):
            springgym.set_state(envs, given, copies)
        same(frozen(envs), before, f"{copies}")
    others = variants()
    springgym.set_state(envs, others.pop("one copy of a batch"), [2])  # which is none of others
    check_refused(envs, others, r"state.* does not match: its|the state holds 2 copies", [2])


def test_copies_of_a_batch_in_which_no_episode_has_begun() -> None:
    single = make(IDS[0])
    envs = make_vec(IDS[0], 4, "native", "NextStep")
    with pytest.raises(ValueError, match="its episode must have begun"):
        springgym.set_state(envs, springgym.get_state(single), range(4))
    single.reset(seed=0)
    state = springgym.get_state(single)
    with pytest.raises(ValueError, match="copies leaves out some, and no episode has begun"):
        springgym.set_state(envs, state, [0, 1])
    with pytest.raises(gym.error.ResetNeeded):
        envs.step(actions(envs, 1)[0])
    springgym.set_state(envs, state, range(4))
    envs.step(actions(envs, 1)[0])


def test_only_a_native_batch_has_copies_to_choose_from() -> None:
    env = started(IDS[0], seed=0)
    state = springgym.get_state(env)
    says = r"copies is \[0\]; leave it out: only a native batch"
    with pytest.raises(TypeError, match=says):
        springgym.set_state(env, state, [0])
    with pytest.raises(TypeError, match=says):
        springgym.get_state(env, [0])
