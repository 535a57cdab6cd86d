"""Wrong calls: each argument given everything it could not be is refused by name, and nothing is changed."""

from __future__ import annotations

import inspect
import os
from collections.abc import Callable, Iterator
from itertools import cycle, product
from pathlib import Path
from typing import Any

import gymnasium as gym
import numpy as np
import pytest
from gymnasium.envs.registration import load_env_creator

import springgym
from springgym.dynamics.measures import MeasuresOfBodies
from springgym.dynamics.stepping import MOST_STEPS
from springgym.envs import tolerance
from springgym.envs.base import Common, SpringEnv, SpringVectorEnv
from springgym.envs.observation import Situation
from springgym.envs.options import Settings
from springgym.envs.registration import ALL_IDS
from springgym.envs.scene import SceneTask
from springgym.envs.trained import PUBLISHED
from springgym.model.bodies import Body, cube, from_mesh, rope
from springgym.model.scene import Scene, ThrustActuator
from springgym.scenes import load
from springgym.simulator import STRAIN_LIMIT
from tests.envs.cases import IDS, KINDS, QUICK, each_kind, each_with, make, make_vec, started, task_type
from tests.envs.test_contract import answered, driven_off, same
from tests.envs.test_states import frozen
from tests.params import slow_unless
from tools import fuzz

JUNK: tuple[Any, ...] = (
    *(None, True, False, "", "x", "1", b"x", 0, 1, -1, 7, 10**400, 0.5, -0.5, 2.0, 1e-300, 1e300),
    *(float("nan"), float("inf"), float("-inf"), 1j, (), (1,), (1, 2), (2, 1), (0, 1), (1, "x"), (1e-9, 1)),
    *([], [1.0, 2.0, 3.0], {}, {"x": 1}, {0: 1}, {"masses": 1}, {"masses": (1, float("nan"))}, set()),
    *(np.zeros(3), np.array(1.0), np.full((2, 2), np.nan), np.array("x"), np.array(None), int, len),
    *(iter([1]), object()),
)
REFUSED = (TypeError, ValueError, gym.error.Error, NotImplementedError)


def arguments(kind: type[SpringEnv] | type[SpringVectorEnv]) -> list[str]:
    """Names of all the arguments a class takes."""
    found: list[str] = []
    for function in (kind.__init__, Common._make, Settings, kind.task_type):
        found += [
            p.name
            for p in inspect.signature(function).parameters.values()
            if p.kind in (p.KEYWORD_ONLY, p.POSITIONAL_OR_KEYWORD) and p.name != "self"
        ]
    return found


MEANT = {
    "obs": "; did you mean 'observation'?",
    "randomise": "; did you mean 'randomize'?",
    "rendermode": "; did you mean 'render_mode'?",
    "xyz": None,
    "copies": None,
}


@pytest.mark.parametrize(("env_id", "wrong"), list(zip(ALL_IDS, cycle(MEANT), strict=False)))
def test_an_argument_that_no_environment_has_is_named(env_id: str, wrong: str) -> None:
    """By `gymnasium.make` and by both kinds of `gymnasium.make_vec`, with the argument that may be meant."""
    spec = gym.spec(env_id)
    says = MEANT[wrong]
    for call, entry in (
        (lambda: gym.make(env_id, **{wrong: 1}), spec.entry_point),
        (lambda: gym.make_vec(env_id, 2, "sync", **{wrong: 1}), spec.entry_point),
        (lambda: gym.make_vec(env_id, 2, "vector_entry_point", **{wrong: 1}), spec.vector_entry_point),
    ):
        kind = load_env_creator(entry)
        with pytest.raises(TypeError) as refused:
            call()
        listed = f"; choose from: {', '.join(sorted(arguments(kind)))}"
        told = str(refused.value).split(" was raised from")[0]
        if says is None:
            told, _, names = told.partition("; choose from: ")
            told += f"; choose from: {', '.join(sorted(names.split(', ')))}"
        assert told == f"{kind.__name__} has no argument {wrong!r}{listed if says is None else says}"


def test_an_unknown_argument_of_a_player_or_a_task_of_one_s_own_is_named() -> None:
    pytest.importorskip("pettingzoo")
    from springgym.envs.players import ParallelDuel

    with pytest.raises(TypeError, match=r"ParallelDuel has no argument 'rendr_mode'; did you mean 'render_m"):
        ParallelDuel(rendr_mode="human")  # type: ignore[call-arg]
    for more in ({}, {"num_envs": 2}):
        with pytest.raises(TypeError, match="make_scene_env has no option 'obs'; did you mean 'observe'"):
            springgym.make_scene_env("top", lambda m, s: m.tilt, actuators={}, obs=1, **more)


def lives(env: Any) -> None:
    """A reset and two steps give finite numbers in their spaces."""
    results = [env.reset(seed=0)]
    for _ in range(2):
        action = np.zeros(env.action_space.shape, np.float32)
        results.append(env.step(action))
        assert np.isfinite(results[-1][1]).all()
    for observation, *_, info in results:
        assert env.observation_space.contains(observation)
        assert np.isfinite(info["energy"]).all()


def tried(call: Callable[[], Any], name: str) -> Iterator[Any]:
    """Return what a call gives, unless it is refused by an error that names the argument."""
    try:
        result = call()
    except REFUSED as error:
        if name not in str(error):
            raise AssertionError(f"{name} is not named") from error
    else:
        yield result


FREE_OF_LOSS = {"friction": 0, "restitution": 1}


@pytest.mark.parametrize(
    ("env_id", "suffix"),
    [
        *(pytest.param(own, "Env", marks=slow_unless(own in KINDS[1:])) for own in IDS),
        pytest.param(IDS[0], "VectorEnv", marks=pytest.mark.slow),
    ],
)
def test_every_argument_of_every_environment(
    env_id: str, suffix: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The method for a tolerance is chosen in short episodes; `test_tolerance.py` tests how well it is."""
    monkeypatch.setattr(tolerance, "EPISODES", 1)
    monkeypatch.setattr(tolerance, "PERIODS", 2)
    kind = type((make(env_id) if suffix == "Env" else make_vec(env_id, 2, "native", "NextStep")).unwrapped)
    names = arguments(kind)
    assert {"render_mode", "step", "randomize", "observation", "action"} <= set(names)
    if env_id != IDS[0]:  # all else is read by the same lines as the first one's
        own = {"Env": kind.task_type, "VectorEnv": SpringVectorEnv.__init__}[suffix]
        names = [name for name in names if name in inspect.signature(own).parameters]
    made = 0
    for name in names:
        for junk in JUNK:
            if name == "opponent" and callable(junk) and not isinstance(junk, type):
                continue  # a function is asked when it is to act
            if type(junk) in (int, np.ndarray) and np.array_equal(junk, FREE_OF_LOSS.get(name)):
                continue  # another scene, which is compiled: as good as any
            for env in tried(lambda name=name, junk=junk: kind(**{name: junk}), name):
                made += 1
                if made < 15:
                    lives(env)
    assert made >= len(names) - 3  # what is right is taken


@each_kind
def test_every_argument_of_every_body(env_id: str) -> None:
    """``body`` takes those of the body's maker, whichever it is."""
    if "body" not in inspect.signature(task_type(env_id)).parameters:
        pytest.skip("its body is fixed")
    for junk in JUNK:
        for name in ("mass", "stiffness", "damping", "scaled", "sides", "colour", "ring", "beads"):
            if env_id != IDS[0] and name == "damping" and isinstance(junk, (int, float)) and junk == 0:
                continue  # without dampers, which is compiled anew
            for env in tried(lambda name=name, junk=junk: make(env_id, body={name: junk}), "body"):
                for _ in tried(lambda env=env: env.reset(seed=0), "strain"):
                    pass


def options(env_id: str) -> list[str]:
    """Reset options that the docstring names."""
    text = type(make(env_id).unwrapped).__doc__ or ""
    if "reset(options={" not in text:
        return []
    given = text.split("reset(options={")[1].split("}")[0]
    return [part.split('"')[1] for part in given.split(",")]


@each_with("copies", [None, 3], usual=QUICK)
def test_every_option_and_seed_of_a_reset(env_id: str, copies: int | None) -> None:
    """What is refused changes nothing, nor consumes random numbers; what is taken starts soundly."""
    factor = "masses" if env_id in QUICK else "actuator"  # the latter is compiled with nothing new
    ranges = answered(env_id) if env_id in QUICK else {factor: (0.9, 1.1)}
    env = make(env_id, randomize=ranges).unwrapped
    if copies:
        env = make_vec(env_id, copies, "native", "SameStep", randomize=ranges)
    env.reset(seed=3)
    env.step(np.zeros(env.action_space.shape, np.float32))
    known = options(env_id)
    names = [*known, "mood", *(("reset_mask",) if copies else ())]
    right = {name: fuzz.allowed(make(env_id))[name][0] for name in known[:1]}
    calls = [({"options": {name: junk}}, name) for name in names for junk in JUNK]
    calls += [({"options": {"randomize": {factor: junk}}}, factor) for junk in JUNK]
    calls += [({"options": {"randomize": junk}}, "randomize") for junk in JUNK]
    calls += [({"options": junk}, "option") for junk in JUNK]
    calls += [({"seed": junk}, "seed") for junk in JUNK]
    calls += [({"seed": 1, "options": {"mood": 1}}, "mood"), ({"options": {"x": 1} | right}, "x")]
    taken = 0
    before = frozen(env)
    for given, name in calls:
        accepted = False
        for observation, info in tried(lambda given=given: env.reset(**given), name):
            accepted = True
            assert env.observation_space.contains(observation)
            assert np.isfinite(info["energy"]).all()
            assert (np.asarray(info["strain"]) <= STRAIN_LIMIT).all()
        if not accepted:
            same(frozen(env), before, str(given))
        else:
            taken += 1
            before = frozen(env)
    assert taken >= 6


@pytest.mark.parametrize(("env_id", "copies"), [("SpringTop-v0", None), ("SpringTumble-v0", 2)])
def test_every_action(env_id: str, copies: int | None) -> None:
    env = make(env_id).unwrapped if copies is None else make_vec(env_id, copies, "native", "SameStep")
    env.reset(seed=3)
    before = frozen(env)
    shape = env.action_space.shape
    wrong = [np.full(shape, np.nan), np.full(shape, np.inf), np.zeros((*shape, 1)), np.zeros(shape, bool)]
    wrong += [np.full(shape, "0"), np.zeros(shape, complex), np.zeros(shape)[:-1], [[0.0], [0.0, 1.0]]]
    for junk in (*JUNK, *wrong):
        for _ in tried(lambda junk=junk: env.step(junk), "action"):
            assert np.shape(junk) == shape  # three numbers, in a list or tuple
            env.set_state(before)
        same(frozen(env), before, repr(junk))


def test_first_reset_takes_all_copies() -> None:
    envs = make_vec(IDS[0], 3, "native", "Disabled")
    with pytest.raises(ValueError, match="reset_mask leaves out some, and no episode has begun"):
        envs.reset(seed=0, options={"reset_mask": np.array([True, False, True])})
    with pytest.raises(gym.error.ResetNeeded):
        envs.step(envs.action_space.sample())
    envs.reset(seed=0, options={"reset_mask": np.ones(3, bool)})
    envs.reset(options={"reset_mask": np.array([True, False, True])})


@each_kind
def test_nothing_is_stepped_or_drawn_before_a_reset(env_id: str) -> None:
    env = make(env_id, render_mode="rgb_array").unwrapped
    with pytest.raises(gym.error.ResetNeeded, match="step"):
        env.step(env.action_space.sample())
    with pytest.raises(gym.error.ResetNeeded, match="render"):
        env.render()


# --- Files --------------------------------------------------------------------------------------------


def run_folder(path: Path, name: str) -> Path:
    """Make a run folder of a published agent, in which one file is a link to a path."""
    path.with_name("run").mkdir()
    for own in ("config.yaml", "agent.npz"):
        path.with_name("run").joinpath(own).symlink_to(path if own == name else PUBLISHED / IDS[0] / own)
    return path.with_name("run")


READERS: dict[str, Callable[[Path], Any]] = {
    "scene": load,
    "scene of an environment": lambda path: springgym.make_scene_env(path, height, actuators={"force": 1.0}),
    "mesh": from_mesh,
    "configuration": lambda path: springgym.load_agent(run_folder(path, "config.yaml")),
    "agent": lambda path: springgym.load_agent(run_folder(path, "agent.npz")).policy(make(IDS[0])),
    "run folder": springgym.load_agent,
}
"""What reads a file that a user names."""


FILES = ("pipe", "endless device", "huge", "folder")
NAMES = {"long name": "x" * 5000, "null": "x\0"}


@pytest.mark.parametrize(
    ("reader", "what"),
    [*product(READERS, FILES), *product(sorted(READERS.keys() - {"configuration", "agent"}), NAMES)],
)
@pytest.mark.timeout(60)
def test_what_is_no_regular_file_of_a_sane_size_is_not_read(reader: str, what: str, tmp_path: Path) -> None:
    """A pipe would hang, and a device has no end."""
    if reader == "mesh":
        pytest.importorskip("trimesh")
    path = tmp_path / "file.yaml"
    if what == "pipe":
        os.mkfifo(path)
    elif what == "endless device":
        path.symlink_to("/dev/zero")
    elif what == "huge":
        path.touch()
        os.truncate(path, 2 * 10**9)
    elif what == "folder":
        path.mkdir()
    else:
        path = Path(NAMES[what])
    with pytest.raises(OSError if reader == "mesh" else ValueError):
        READERS[reader](path)


# --- Steps --------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("env_id", "arguments", "blamed"),
    [
        ("SpringRope-v0", {"body": {"end_mass": 1e-9}}, "particle 8 of 1e-09 kg"),
        ("SpringTop-v0", {"randomize": {"masses": (1e-9, 1)}}, "particle 0 of 5e-10 kg"),
        ("SpringTop-v0", {"body": {"stiffness": 1e25}}, "springs of .*e.25 N/m"),
        ("SpringPendulum-v0", {"body": {"damping": 1e12}}, "dampers of .*e.12 kg/s"),
        ("SpringDetumble-v0", {"step": 1e-12}, "step is 1e-12 s, 2e.10 per control period of 0.02 s"),
    ],
)
def test_steps_that_would_not_end_are_refused(env_id: str, arguments: dict[str, Any], blamed: str) -> None:
    with pytest.raises(ValueError, match=rf"(?s)(100,000.*{blamed}|{blamed}.*100,000)"):
        make(env_id, **arguments)


def test_most_steps_are_taken() -> None:
    env = started("SpringDetumble-v0", step=0.02 / MOST_STEPS, seed=0)
    assert env.unwrapped.episodes.steps == MOST_STEPS
    env.step(np.zeros(3, np.float32))
    with pytest.raises(ValueError, match="at most 100,000"):
        make("SpringDetumble-v0", step=0.02 / (MOST_STEPS + 1))


@pytest.mark.parametrize("factors", [{"stiffness": (1, 20)}, {"masses": (0.05, 1)}])
def test_given_step_is_checked_for_the_hardest_body(factors: dict[str, Any]) -> None:
    """At 4e-4 s the standard top is stable, the stiffest of these is not: it was NaN after one period."""
    make(IDS[0], step=4e-4, randomize={"stiffness": (0.5, 1.0)})
    with pytest.raises(
        ValueError, match=r"step of 0\.0004 s is unstable: verlet on this body with randomize="
    ):
        make(IDS[0], step=4e-4, randomize=factors)


@pytest.mark.parametrize(
    "factors", [{"stiffness": (0.3, 0.3)}, {"masses": (2.0, 3.0)}, {"damping": (0.1, 0.2)}]
)
def test_a_softer_body_takes_the_step_of_the_usual_one(factors: dict[str, Any]) -> None:
    """The simulator is made with the usual body, for which the longer step of a softer one was refused."""
    usual = make(IDS[0]).unwrapped
    softer = make(IDS[0], randomize=factors).unwrapped
    assert softer.episodes.simulator.step == usual.episodes.simulator.step


def test_factors_that_tear_the_body_are_refused() -> None:
    """Turning fast with so much mass on such springs, it has no shape to start in."""
    env = make(IDS[0], randomize={"masses": (1, 1000), "stiffness": (0.01, 1)})
    with pytest.raises(ValueError, match=r"start with a strain of .*masses × 1000.*it must be at most 0\.5"):
        env.reset(seed=0, options={"randomize": {"masses": 1000, "stiffness": 0.01}})


# --- Scenes of one's own ------------------------------------------------------------------------------


def height(m: MeasuresOfBodies, s: Situation) -> np.ndarray:
    return m.centre[:, 2]


RIGHT: dict[str, Any] = {"scene": Scene(cube(), gravity=None), "reward": height, "actuators": {"torque": 2.0}}


FUNCTIONS = ("reward", "terminated", "success", "observe", "metrics", "start", "move", "remember", "marks")


def test_every_argument_of_a_scene_environment() -> None:
    names = [*inspect.signature(SceneTask.__init__).parameters][1:]
    names += ["num_envs", "max_episode_steps"]
    made = 0
    for name in names:
        for junk in JUNK:
            given = RIGHT | {name: junk}
            called = name
            if name == "scene" and isinstance(junk, str):
                called = "scene"
            if (junk is int or junk is len) and name in FUNCTIONS:
                continue  # functions, but which give something else: below
            for env in tried(lambda given=given: springgym.make_scene_env(**given), called):
                made += 1
                lives(env)
    assert made >= 10


ANSWERS: tuple[Any, ...] = (
    None, "x", 1.0, np.zeros(3), np.zeros((2, 2)), np.array([None, 1.0]), [1.0, "x"], np.full(2, np.nan),
    np.array([1.0, np.inf]), [[1.0], [1.0, 2.0]], np.array([1j, 1]), (), {}, np.full((2, 3), np.nan),
)  # fmt: skip


BESIDE: dict[str, dict[str, Any]] = {
    "move": {"start": lambda rng: (cube().positions, np.zeros((8, 3)), (0.0, 1.0))},
    "remember": {"memory": (0.0, 1.0)},
}
"""What a function needs beside itself."""


@pytest.mark.parametrize("name", [name for name in FUNCTIONS if name != "marks"])
def test_every_answer_of_a_users_function(name: str) -> None:
    for answer in ANSWERS:
        given = RIGHT | BESIDE.get(name, {}) | {name: lambda *_, answer=answer: answer, "num_envs": 2}
        accepted = 0
        for env in tried(lambda given=given: springgym.make_scene_env(**given), name):
            for _ in tried(lambda env=env: (env.reset(seed=0), env.step(np.zeros((2, 3)))), name):
                accepted += 1
        right = [(2, 2)] if name in ("observe", "move", "remember") else []
        assert accepted == (np.shape(np.array(answer, object)) in right)


def test_functions_cannot_write_to_what_they_see() -> None:
    def meddling(m: MeasuresOfBodies, s: Situation) -> np.ndarray:
        for array in (*m[0], *s):
            with pytest.raises(ValueError, match="read-only"):
                array[:] = 0
        return np.zeros(len(s.x))

    for env in (springgym.make_scene_env(**RIGHT | {"reward": meddling, "num_envs": n}) for n in (None, 2)):
        env.reset(seed=0)
        env.step(env.action_space.sample())


def test_function_that_fails_in_a_reset_changes_nothing() -> None:
    calls = []

    def start(rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
        calls.append(rng.uniform())
        if len(calls) > 4:  # one to learn how long the goal is, two of a reset, and the first copy's
            raise ZeroDivisionError("mine")
        return cube().positions, np.zeros((8, 3))

    envs: Any = springgym.make_scene_env(**RIGHT | {"start": start, "num_envs": 2})
    envs.reset(seed=0)
    before = frozen(envs)
    with pytest.raises(ZeroDivisionError, match="mine"):
        envs.reset()  # the second copy's
    same(frozen(envs), before)


def test_messages_speak_of_environments() -> None:
    """Which one of a batch cannot start, and how many there can be at most."""
    calls = []

    def start(rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
        calls.append(rng.uniform())
        moves = np.zeros((8, 3))
        moves[0] = float(len(calls) == 3)  # one to learn how long the goal is, and the first environment's
        return cube().positions, moves

    pinned = Scene(cube(), gravity=None, pinned=(0,))
    envs: Any = springgym.make_scene_env(**RIGHT | {"scene": pinned, "start": start, "num_envs": 2})
    with pytest.raises(ValueError, match="pinned particle 0 of environment 1 has a velocity"):
        envs.reset(seed=0)
    with pytest.raises(ValueError, match="num_envs is 1000000000; it must be a whole number from 1 to "):
        make_vec(IDS[0], 10**9, "native", "Disabled")


def dot(count: int) -> Body:
    """Particles one above the other."""
    positions = np.zeros((count, 3))
    positions[:, 2] = 0.3 * np.arange(count)
    springs = np.array([(n, n + 1) for n in range(count - 1)], int).reshape(-1, 2)
    return Body("dot", positions, np.ones(count), springs, 1e4, 1.0, floppy=count > 2)


@pytest.mark.parametrize("count", [1, 2, 3])
def test_scenes_without_size_or_breadth(count: int) -> None:
    env = springgym.make_scene_env(
        Scene(dot(count)), height, actuators={"force": 20.0}, render_mode="rgb_array"
    )
    observation, info = env.reset(seed=0)
    env.action_space.seed(0)
    for _ in range(20):
        assert env.observation_space.contains(observation)
        assert all(np.isfinite(value) for value in info.values())
        observation, _, terminated, _, info = env.step(env.action_space.sample())
        assert not terminated
    picture = env.render()
    assert picture.std() > 0


def test_rope_of_the_paper_as_a_scene() -> None:
    """A scene that is pinned, floppy and straight, too."""
    env = springgym.make_scene_env(Scene(rope(), pinned=(0,)), height, actuators={"force": 20.0})
    lives(env)


def test_diverged_copies_do_not_reach_the_reward_check() -> None:
    """Where a copy has diverged, what functions make of it is left aside, without a warning."""
    scene = Scene(cube(), gravity=None, thrust=ThrustActuator((0,)))

    def corner(x: np.ndarray) -> np.ndarray:  # what is far overflows, and is subtracted from itself: NaN
        far = (x[:, 0] * 1e150) ** 2
        return x[:, 0] + (far - far)

    envs: Any = springgym.make_scene_env(
        scene,
        lambda m, s: 1.0 + 0.0 * corner(s.x)[:, 0],
        actuators={"thrust": 1.0},
        observe=lambda m, s: corner(s.x),
        num_envs=2,
        autoreset_mode="Disabled",
    )
    envs.reset(seed=0)
    driven_off(envs.episodes.simulator, 1, 1e25)
    observation, reward, terminated, _, info = envs.step(np.zeros((2, 3)))
    assert terminated.tolist() == [False, True]
    assert reward.tolist() == [1.0, 0.0]
    assert np.isfinite(observation).all()
    assert info["diverged"].tolist() == [False, True]


def test_every_factor_is_answered() -> None:
    """The ranges of the other tests are of all factors that a scene answers to."""
    assert all({"masses", "actuator", "scale"} <= set(answered(env_id)) for env_id in IDS)
