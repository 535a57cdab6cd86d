"""What every environment owes, over the registry."""

from __future__ import annotations

import copy
import pickle
from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env
from gymnasium.vector import AutoresetMode
from stable_baselines3.common.env_checker import check_env as check_env_sb3

from springgym.core.language.blocks import to_copies
from springgym.dynamics import measures
from springgym.envs.episodes import Episodes
from springgym.envs.observation import Situation
from springgym.envs.randomisation import OF_SPRINGS, RANDOMIZABLE, stretched
from springgym.envs.tasks import billiards
from springgym.model.scene import Scene
from springgym.model.surfaces import scales
from springgym.simulator import Simulator
from tests.envs.cases import (
    CASES,
    COLLIDING,
    FLOPPY,
    IDS,
    KINDS,
    QUICK,
    TWINLESS,
    case_of_each_kind,
    each_case,
    each_id,
    each_kind,
    each_task,
    each_with,
    first_case,
    make,
    make_vec,
    started,
    task_type,
)
from tests.params import slow_unless

MODES = [mode.value for mode in AutoresetMode]


@pytest.mark.usefixtures("small_pictures")
@first_case
def test_checkers(env_id: str, options: dict[str, Any]) -> None:
    """Gymnasium's and SB3's checkers find nothing; pytest turns warnings into errors."""
    check_env(make(env_id, render_mode="rgb_array", **options).unwrapped)
    check_env_sb3(make(env_id, **options))


def sliding(episodes: Episodes) -> None:
    """Let all blocks slide alike: those that the crane does not hold stand still, to the bit."""
    x, v = episodes.particles
    episodes.simulator.place(x, v + np.array([0.7, 0.7, 0.0]))


def before_the_pocket(episodes: Episodes) -> None:
    """Lay the second ball where it falls into the pocket, and the first one beside it."""
    x, v = (values.copy() for values in episodes.particles)
    x[:, billiards.OBJECT, :2] = episodes.goal[:, :2]
    x[:, billiards.CUE, :2] = episodes.goal[:, :2] + (0.3, 0.0)
    episodes.simulator.place(x, v)


RARE = {"SpringTower-v0": sliding, "SpringBilliards-v0": before_the_pocket}
"""What brings about that which actions at random do not reach in 150 steps."""


def stays_in_bounds(env_id: str, options: dict[str, Any], steps: int) -> None:
    """Of 16 copies, half with random actions; bang-bang holds a sign for five periods on average."""
    envs = make_vec(env_id, 16, "native", "SameStep", **options)
    rng = np.random.default_rng(0)
    observation, _ = envs.reset(seed=0)
    low = observation.min(axis=0)
    high = observation.max(axis=0)
    terms = task_type(env_id).terms
    action = np.ones(envs.action_space.shape, np.float32)
    for n in range(steps):
        if n == steps - 1 and env_id in RARE:
            RARE[env_id](envs.unwrapped.episodes)
        action[:8] = rng.uniform(-1, 1, action[:8].shape)
        action[8:] = np.where(rng.uniform(size=action[8:].shape) < 0.2, -action[8:], action[8:])
        observation, reward, terminated, truncated, info = envs.step(action)
        assert envs.observation_space.contains(observation)
        assert np.isfinite(reward).all()
        assert ((reward >= 0) & (reward <= 1)).all()
        last = info.get("final_info", info)
        total = sum(
            np.where(terminated | truncated, last[f"reward_{name}"], info[f"reward_{name}"]) for name in terms
        )
        np.testing.assert_allclose(total, reward, rtol=0, atol=1e-12)
        assert not info["diverged"].any()
        low = np.minimum(low, observation.min(axis=0))
        high = np.maximum(high, observation.max(axis=0))
    assert (low < high).all(), f"constant entries: {np.flatnonzero(low == high)}"


@case_of_each_kind
def test_values_stay_in_bounds(env_id: str, options: dict[str, Any]) -> None:
    stays_in_bounds(env_id, options, 151)


@pytest.mark.slow
@each_case
def test_values_stay_in_bounds_for_long(env_id: str, options: dict[str, Any]) -> None:
    stays_in_bounds(env_id, options, 2000 // task_type(env_id).periods)


def leaves(value: Any) -> list[np.ndarray]:
    if isinstance(value, dict):
        return [leaf for item in value.values() for leaf in leaves(item)]
    if isinstance(value, (tuple, list)):
        return [leaf for item in value for leaf in leaves(item)]
    return [value] if isinstance(value, np.ndarray) else []


@pytest.mark.parametrize(("env_id", "autoreset"), [*zip(KINDS, MODES, strict=True)])
def test_results_share_no_memory(env_id: str, autoreset: str) -> None:
    envs = make_vec(env_id, 3, "native", autoreset)
    results = [leaves(envs.reset(seed=0))]
    results += [leaves(envs.step(0.1 * envs.action_space.sample())) for _ in range(3)]  # so that none ends
    arrays = [leaf for result in results for leaf in result]
    for n, first in enumerate(arrays):
        assert not any(np.shares_memory(first, second) for second in arrays[n + 1 :])


def same(first: Any, second: Any, path: str = "") -> None:
    """Assert that two results are equal to the bit, dictionaries key by key."""
    if isinstance(first, dict):
        assert first.keys() == second.keys(), path
        for key in first:
            same(first[key], second[key], f"{path}/{key}")
        return
    if isinstance(first, (list, tuple)):
        assert len(first) == len(second), path
        for n, (a, b) in enumerate(zip(first, second, strict=True)):
            same(a, b, f"{path}/{n}")
        return
    first = np.asarray(first)
    second = np.asarray(second)
    assert first.shape == second.shape, path
    if first.dtype == object and first.ndim:
        for a, b in zip(first, second, strict=True):
            assert (a is None) == (b is None), path
            if a is not None:
                same(a, b, path)
        return
    assert first.dtype == second.dtype, path
    if first.tobytes() != second.tobytes():  # as 0.0 and -0.0; this way takes a tenth of the time
        np.testing.assert_array_equal(first, second, err_msg=path)


def compare_with_sync(env_id: str, autoreset: str, steps: int, copies: int, **options: Any) -> int:
    """Step a native batch and Gymnasium's loop alike; return how many episodes ended."""
    pair = [
        make_vec(env_id, copies, mode, autoreset, max_episode_steps=23, **options)
        for mode in ("native", "sync")
    ]
    assert pair[0].observation_space == pair[1].observation_space
    rng = np.random.default_rng(1)
    for a, b in zip(*(envs.reset(seed=5) for envs in pair), strict=True):
        same(a, b)
    ended = 0
    for _ in range(steps):
        action = np.sign(rng.uniform(-1, 1, pair[0].action_space.shape)).astype(np.float32)
        results = [envs.step(action) for envs in pair]
        for name, a, b in zip(("obs", "reward", "term", "trunc", "info"), *results, strict=True):
            same(a, b, name)
        done = results[0][2] | results[0][3]
        ended += int(done.sum())
        if autoreset == "Disabled" and done.any():
            for a, b in zip(*(envs.reset(options={"reset_mask": done.copy()}) for envs in pair), strict=True):
                if isinstance(a, dict):
                    a = {k: v[done] for k, v in a.items() if isinstance(v, np.ndarray)}
                    b = {k: v[done] for k, v in b.items() if isinstance(v, np.ndarray)}
                same(a, b)
    return ended


def steps_alike(env_id: str, options: dict[str, Any], steps: int) -> None:
    """With each of the modes in a third of `CASES`."""
    autoreset = MODES[CASES.index((env_id, options)) % len(MODES)]
    assert compare_with_sync(env_id, autoreset, steps, 3, **options) > 0


@case_of_each_kind
def test_native_equals_sync(env_id: str, options: dict[str, Any]) -> None:
    """Observations, rewards, ends and infos are those of as many single environments, to the bit."""
    steps_alike(env_id, options, 60)


@pytest.mark.slow
@each_case
def test_native_equals_sync_for_long(env_id: str, options: dict[str, Any]) -> None:
    steps_alike(env_id, options, 1000)


@pytest.mark.own_kernels
def test_native_equals_sync_where_each_has_a_kernel_of_its_own() -> None:
    """As users compile them: single environments in blocks of one copy, by the terms that they need."""
    assert compare_with_sync(IDS[0], "SameStep", 60, 3) > 0


@pytest.mark.parametrize(
    ("env_id", "dtype"),
    [(env_id, "float64") for env_id in KINDS]
    + [pytest.param("SpringTop-v0", "float32", marks=pytest.mark.slow)],
)
def test_copies_do_not_depend_on_each_other(env_id: str, dtype: str) -> None:
    """Copy 0 of 1, 2 and 40 copies, on two threads, lives the same life."""
    lives = []
    for copies in (1, 2, 40):
        envs = make_vec(env_id, copies, "native", "SameStep", threads=2, dtype=dtype)
        envs.reset(seed=3)
        rng = np.random.default_rng(0)
        first = rng.uniform(-1, 1, (30, *envs.single_action_space.shape))
        life = [envs.step(np.repeat(action[None], copies, 0)) for action in first]
        lives.append([(step[0][0], step[1][0]) for step in life])
    for life in lives[1:]:
        for (a, reward), (b, other) in zip(lives[0], life, strict=True):
            np.testing.assert_array_equal(a, b)
            assert reward == other


@each_with("copies", [None, 3])
def test_state_returns(env_id: str, copies: int | None) -> None:
    """get_state/set_state, pickle and deepcopy in mid-episode: what follows is the same, to the bit."""
    env = make(env_id).unwrapped if copies is None else make_vec(env_id, copies, "native", "SameStep")
    env.reset(seed=0)
    rng = np.random.default_rng(0)
    actions = rng.uniform(-1, 1, (30, *env.action_space.shape)).astype(np.float32)
    for action in actions[:10]:
        env.step(action)
    twins = [pickle.loads(pickle.dumps(env)), copy.deepcopy(env)]
    state = env.get_state()
    follows = [env.step(action) for action in actions[10:]]
    env.set_state(state)
    for twin in (env, *twins):
        for action, expected in zip(actions[10:], follows, strict=True):
            for a, b in zip(twin.step(action), expected, strict=True):
                same(a, b)


@each_kind
def test_wrong_arguments(env_id: str) -> None:
    period = task_type(env_id).period
    springs = task_type(env_id)().scene.springs
    for given, says in (
        ({"observation": "pixels"}, "observation is 'pixels'; it must be one of 'particles'"),
        ({"randomize": {"smell": (0, 1)}}, "cannot randomize 'smell'"),
        ({"randomize": {"masses": (2, 1)}}, "low ≤ high"),
        *([({"step": period}, "unstable")] if len(springs) else []),
        ({"step": period / 100.5}, "whole number of steps"),
        ({"integrator": "euler"}, "unknown integrator 'euler'"),
    ):
        with pytest.raises(ValueError, match=says):
            make(env_id, **given)
    env = make(env_id)
    with pytest.raises(
        ValueError, match=r"no reset option 'mood'; choose from: randomize(, \w+)*$"
    ) as refused:
        env.reset(options={"mood": 1})
    for known in str(refused.value).split(": ")[1].split(", "):
        with pytest.raises(ValueError, match=f"no reset option '{known}_'; did you mean '{known}'\\?"):
            env.reset(options={f"{known}_": 1})
    envs = make_vec(env_id, 2, "native", "NextStep")
    with pytest.raises(ValueError, match="3 seeds"):
        envs.reset(seed=[1, 2, 3])
    with pytest.raises(ValueError, match="reset_mask"):
        envs.reset(options={"reset_mask": np.ones(3, bool)})


def test_no_rigid_twin() -> None:
    """Rigid dynamics refuses bodies that are meant to change shape; all other tasks have a twin."""
    assert FLOPPY == ["SpringRope-v0"]
    with pytest.raises(ValueError, match="is meant to change shape: it has no rigid twin"):
        make(FLOPPY[0], dynamics="rigid")
    with pytest.raises(ValueError, match="dynamics is 'jelly'; it must be one of 'springs', 'rigid'"):
        make(IDS[0], dynamics="jelly")


@pytest.mark.slow
@pytest.mark.parametrize("env_id", COLLIDING)
def test_rigid_bodies_of_tasks_collide(env_id: str) -> None:
    """What the ledger misses in a second of random actions is small beside the energy that moves."""
    env = started(env_id, dynamics="rigid", seed=0)
    env.action_space.seed(0)
    for _ in range(20):
        observation, _, terminated, _, info = env.step(env.action_space.sample())
        assert env.observation_space.contains(observation)
        assert abs(info["energy_drift"]) < 1.5  # SpringDuel has 200 J; others 1e-4
        if terminated:
            break


@pytest.mark.slow
@pytest.mark.parametrize("env_id", ["SpringLabyrinth-v0", "SpringShove-v0"])
def test_rigid_balls_roll_in_batches_as_alone_and_as_those_of_springs(env_id: str) -> None:
    """To what sweeps leave over; and to what springs give way by, over a second without actions."""
    envs = make_vec(env_id, 3, "native", "NextStep", dynamics="rigid")
    alone = make(env_id, dynamics="rigid")
    springs = make(env_id)
    envs.reset(seed=[5, 6, 7])
    for env in (alone, springs):
        env.reset(seed=6)
    action = np.zeros(alone.action_space.shape)
    for _ in range(20):
        seen, *_ = envs.step(np.stack([action] * 3))
        one, *_ = alone.step(action)
        other, *_ = springs.step(action)
    np.testing.assert_allclose(seen[1], one, atol=1e-5)
    np.testing.assert_allclose(one, other, atol=5e-3)


def with_contact(scene: Scene, **changes: float) -> Scene:
    return scene.with_(contact=replace(scene.contact, **changes))


def with_contacts(scene: Scene, name: str, factor: float) -> Scene:
    """Return a scene with a number of its contact times a factor; bodies that collide by it follow."""
    scaled = with_contact(scene, **{name: getattr(scene.contact, name) * factor})
    return scaled.with_(collisions=scaled.contact) if scene.collisions == scene.contact else scaled


def with_own_floor(scene: Scene) -> Scene:
    """Return a scene whose surfaces stay as hard as they are, whatever the body weighs."""
    if not scene.surfaces or scene.contact.strength is not None:
        return scene
    strength, reach = scales(scene.contact, scene.body)
    return with_contact(scene, strength=strength, reach=reach)


def with_bodies(scene: Scene, name: str, factor: float, but: str = "") -> Scene:
    """Return a scene with a number of all particles or springs times a factor, but in bodies of one name."""
    bodies = [
        placed
        if placed.body.name == but
        else replace(placed, body=placed.body.with_(**{name: getattr(placed.body, name) * factor}))
        for placed in scene.bodies
    ]
    return scene.with_(bodies=tuple(bodies))


def follows(episodes: Episodes, own: Sequence[Simulator], push: np.ndarray, action: np.ndarray) -> bool:
    """Step all copies by one action (A,), and return whether each moved as its own simulator, to the bit.

    ``push`` (copies, 1) multiplies what actuators do.
    """
    task = episodes.task
    same = []

    def drive(n: int, simulator: Simulator) -> None:
        simulator.read()
        rows, x, v, bodies = simulator.readout
        seen = (values[n : n + 1] for values in (episodes.goal, episodes.time, episodes.memory))
        m = measures.view(bodies if len(simulator.scene.bodies) > 1 else rows)
        others = task.respond(m, Situation(x, v, action[None], *seen, task.parameters))
        weak = {name: push[n] * values for name, values in others.items()}
        simulator.actuate(**task.actuate(push[n] * action[None]), **weak)

    def go_on() -> None:
        for n, simulator in enumerate(own):
            simulator.advance(episodes.steps, check=False)
            same.append((episodes.particles[0][n] == simulator.positions[0]).all())
            drive(n, simulator)

    for n, simulator in enumerate(own):
        drive(n, simulator)
    episodes.each_period = go_on
    episodes.step(np.tile(action, (len(own), 1)))
    return len(same) == task.periods * len(own) and all(same)


SCALED: dict[str, Callable[[Scene, float], Scene]] = {
    "masses": lambda scene, f: with_bodies(scene, "masses", f),
    "stiffness": lambda scene, f: with_bodies(scene, "stiffness", f),
    "damping": lambda scene, f: with_bodies(scene, "damping", f),
    "scale": lambda scene, f: with_bodies(scene, "lengths", f, but="rolling ball" if scene.meetings else ""),
    "gravity": lambda scene, f: scene.with_(gravity=tuple(np.array(scene.gravity) * f)),
    "friction": lambda scene, f: with_contacts(scene, "friction", f),
    "restitution": lambda scene, f: with_contacts(scene, "restitution", f),
    "actuator": lambda scene, f: scene,
}
"""What a factor means."""


def answered(env_id: str) -> dict[str, tuple[float, float]]:
    """Ranges of all the factors that something in the scene answers to."""
    scene = task_type(env_id)().scene
    absent = {"gravity": scene.gravity is None}
    absent |= dict.fromkeys(("friction", "restitution"), not scene.surfaces)
    ranges = {name: (0.9, 1.2) for name in RANDOMIZABLE if not absent.get(name)}
    if "restitution" in ranges:
        ranges["restitution"] = (0.9, min(1.2, 1.0 / max(scene.contact.restitution, 0.5)))
    return ranges


@pytest.mark.parametrize("env_id", QUICK)
def test_randomisation(env_id: str) -> None:
    """Factors are drawn per copy and episode from its seed, reported, and settable."""
    ranges = answered(env_id)
    envs = make_vec(env_id, 2, "native", "SameStep", randomize=ranges)
    _, info = envs.reset(seed=2)
    _, later = envs.reset()
    _, again = envs.reset(seed=2)
    same(info, again)
    assert {name for name in info["randomization"] if name[0] != "_"} == set(ranges)
    for name, (low, high) in ranges.items():
        drawn = np.concatenate([info["randomization"][name], later["randomization"][name]])
        assert ((low <= drawn) & (drawn <= high)).all()
        assert len(set(drawn)) == 4
    _, info = envs.reset(seed=2, options={"randomize": {"masses": 1.05}})
    assert (info["randomization"]["masses"] == 1.05).all()
    np.testing.assert_array_equal(info["randomization"]["scale"], again["randomization"]["scale"])
    with pytest.raises(ValueError, match=r"'masses', is 3\.0; it must be a number from 0\.9 to 1\.2"):
        envs.reset(options={"randomize": {"masses": 3.0}})
    with pytest.raises(ValueError, match="cannot set the factor of 'masses'"):
        make(env_id).reset(options={"randomize": {"masses": 1.0}})


@pytest.mark.parametrize("env_id", [pytest.param(own, marks=slow_unless(own == IDS[0])) for own in KINDS])
def test_randomised_native_equals_sync(env_id: str) -> None:
    assert compare_with_sync(env_id, "SameStep", 60, 2, randomize=answered(env_id)) > 0


@pytest.mark.parametrize("env_id", [pytest.param(own, marks=slow_unless(own in QUICK)) for own in IDS])
def test_randomised_copy_is_another_scene(env_id: str) -> None:
    """A copy with one factor off 1 moves, to the bit, as the scene with that parameter; one with all at 1,
    as if nothing could vary."""
    ranges = answered(env_id)
    factors = {name: min(1.1, high) for name, (_, high) in ranges.items()}
    if any(placed.body.rounds for placed in task_type(env_id)().scene.bodies):
        # what rolls does not slide, but for so little; shares of the mass keep their bits
        factors |= {"friction": 0.02, "masses": 0.5}
        ranges |= {name: (0.02, 1.2) for name in ("friction", "masses") if name in ranges}
    envs = make_vec(env_id, 2, "native", "Disabled", randomize=ranges)
    episodes = envs.unwrapped.episodes
    task = episodes.task
    pace: Any = {name: getattr(episodes.simulator, name) for name in ("step", "damping_every")}
    actions = np.random.default_rng(0).uniform(-1, 1, (40, *envs.single_action_space.shape))
    for name in ranges:
        ones = dict.fromkeys(ranges, 1.0)
        factor = factors[name]
        seen, _ = envs.reset(seed=[4, 4], options={"randomize": ones})
        if task.periods > 1:  # hardly one stroke at random reaches the second ball
            actions = seen[:1, :2].astype(float) / np.linalg.norm(seen[0, :2])
        given = {"randomize": ones | {name: factor}, "reset_mask": np.array([False, True])}
        _, info = envs.reset(seed=[None, 4], options=given)
        assert info["randomization"][name][1] == factor
        scene = with_own_floor(task.scene)
        scenes = (scene, SCALED[name](scene, factor))
        own = [Simulator(scene, **pace) for scene in scenes]
        for n, simulator in enumerate(own):
            simulator.place(*(values[n] for values in episodes.particles))
        push = np.array([[1.0], [factor if name == "actuator" else 1.0]])
        for action in actions:
            assert follows(episodes, own, push, action), name
        differs = bool((episodes.particles[0][0] != episodes.particles[0][1]).any())
        springless = name in (*OF_SPRINGS, "scale") and not len(scene.springs)
        assert differs != springless, f"{name} changes {'something' if springless else 'nothing'}"


@each_id
def test_ranges_nothing_answers_to_are_refused(env_id: str) -> None:
    for name in set(RANDOMIZABLE) - set(answered(env_id)):
        with pytest.raises(ValueError, match=f"{name}.*(no surfaces|no gravity)"):
            make(env_id, randomize={name: (0.9, 1.2)})
    if env_id not in TWINLESS:
        for name in OF_SPRINGS:
            with pytest.raises(ValueError, match=f"'{name}': a rigid body has no springs"):
                make(env_id, randomize={name: (0.9, 1.2)}, dynamics="rigid")


@pytest.mark.parametrize(
    "env_id",
    [
        pytest.param(own, marks=slow_unless(own in QUICK))
        for own in IDS
        if own not in FLOPPY and len(task_type(own)().scene.springs)
    ],
)
def test_rigid_bodies_are_scaled_with_their_inertia(env_id: str) -> None:
    """A copy starts, and stays, in the shape of its body times the factor, and I is Σ m r²."""
    factor = 1.2
    options = {"dynamics": "rigid", "randomize": {"scale": (0.9, factor)}}
    envs = make_vec(env_id, 2, "native", "Disabled", **options)
    envs.reset(seed=4, options={"randomize": {"scale": factor}})
    simulator = envs.unwrapped.episodes.simulator
    scene = simulator.scene
    sizes = stretched(scene, factor)
    masses = np.split(scene.masses, scene.offsets[1:-1])
    free = np.isin(scene.springs, scene.pins).all(axis=1)

    def lengths() -> np.ndarray:
        ends = simulator.positions[:, scene.springs]
        return np.linalg.norm(ends[:, :, 1] - ends[:, :, 0], axis=2)

    for _ in range(5):
        expected = np.where(free, lengths()[0], sizes * scene.of_bodies("lengths"))
        np.testing.assert_allclose(lengths(), np.tile(expected, (2, 1)), rtol=1e-9)
        envs.step(np.zeros(envs.action_space.shape))
    for n, packed in enumerate(simulator._packed):
        twin = packed.twin[0]
        if twin.turns and len(packed.scene.body.springs):
            r = to_copies(twin.shape, 2)[0].reshape(-1, 3)
            about = np.sum(masses[n] * (r * r).sum(axis=1)) * np.eye(3) - (masses[n] * r.T) @ r
            moments = to_copies(twin.moments, 2)[0].ravel()
            np.testing.assert_allclose(about, np.diag(moments), rtol=1e-9, atol=1e-9 * moments.max())


def driven_off(simulator: Simulator, copy: int, speed: float) -> None:
    """Let a particle go so fast that its spring breaks or, without springs, the first ball at the second.

    What no spring holds, and nothing is in the way of, can go as fast as it likes.
    """
    scene = simulator.scene
    x = simulator.positions
    v = simulator.velocities
    sprung = np.intersect1d(scene.springs, np.flatnonzero(scene.free))
    if len(sprung):
        v[copy, sprung[0]] = speed
    else:
        way = x[copy, 1] - x[copy, 0]
        v[copy, 0] = speed * way / np.linalg.norm(way)
    simulator.place(x, v)


@each_task
def test_divergence_is_an_end(env_id: str) -> None:
    """A copy driven out of what the model means ends with finite values; its neighbours go on."""
    envs = make_vec(env_id, 3, "native", "Disabled")
    calm = make_vec(env_id, 3, "native", "Disabled")
    envs.reset(seed=0)
    calm.reset(seed=0)
    driven_off(envs.unwrapped.episodes.simulator, 1, 1e25)
    action = envs.action_space.sample()
    observation, reward, terminated, _, info = envs.step(action)
    expected = calm.step(action)
    assert info["diverged"].tolist() == [False, True, False]
    assert terminated[1]
    assert reward[1] == 0
    assert np.isfinite(observation).all()
    np.testing.assert_array_equal(observation[[0, 2]], expected[0][[0, 2]])


@each_with("speed", [1e25, 1e4, 1e25])
def test_what_has_diverged_is_drawn_all_the_same(env_id: str, speed: float) -> None:
    """As far as there is anything to be seen, and without a warning."""
    env = started(env_id, render_mode="rgb_array", seed=0)
    empty = env.render()
    driven_off(env.unwrapped.episodes.simulator, 0, speed)
    *_, info = env.step(env.action_space.sample())
    assert info["diverged"]
    assert env.render().shape == empty.shape
