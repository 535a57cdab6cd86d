"""Starts do not depend on what a linear algebra library leaves open; each that is asked for is made."""

from __future__ import annotations

import inspect
from collections.abc import Callable
from itertools import product
from typing import Any

import gymnasium as gym
import numpy as np
import pytest

import springgym
from springgym.envs.randomisation import NOMINAL, RANDOMIZABLE
from springgym.envs.starts import (
    any_rotation,
    direction,
    principal_axes,
    spawn_seeds,
    standing,
    tilted,
    uniform,
)
from springgym.envs.tasks.duel import SPINS, STEEPEST, SpringDuel
from springgym.model.bodies import box, cube, rotation, stretched_shapes, top
from springgym.model.scene import Scene, squared_lengths
from springgym.simulator import STRAIN_LIMIT
from tests.envs.cases import DUEL, IDS, KINDS, make, task_type
from tests.params import slow_unless
from tools import fuzz


@pytest.mark.parametrize(
    ("seed", "copies", "error", "says"),
    [
        (True, 2, TypeError, "seed is True; it must be a whole number, at least 0"),
        (None, 2, TypeError, "seed is None"),
        ("1", 2, TypeError, "seed is '1'"),
        (1.0, 2, TypeError, "seed is 1.0"),
        (-1, 2, ValueError, "seed is -1"),
        (1, -2, ValueError, "copies is -2; it must be a whole number from 0 to"),
        (1, 2.0, TypeError, "copies is 2.0"),
        (1, "2", TypeError, "copies is '2'"),
    ],
)
def test_no_seeds_of_what_is_no_number(seed: Any, copies: Any, error: type[Exception], says: str) -> None:
    with pytest.raises(error, match=says):
        spawn_seeds(seed, copies)


def test_a_seed_may_be_long() -> None:
    assert len({*spawn_seeds(0, 3), *spawn_seeds(2**128, 3), *spawn_seeds(np.uint64(7), 3)}) == 9  # type: ignore[arg-type]


EVEN = {"sides": (1.0, 1.0, 0.5), "mass": 2.0}
CUBIC = {"sides": (1.0, 1.0, 1.0), "mass": 2.0}
VARIANTS = [
    *(pytest.param(env_id, {}, marks=slow_unless(env_id in KINDS)) for env_id in IDS),
    ("SpringDetumble-v0", {"start": "flat"}),
    *(("SpringDetumble-v0", {"start": start, "body": body}) for start in ("tumbling", "flat")
      for body in (EVEN, CUBIC)),
]  # fmt: skip


def another_library(seed: int) -> dict[str, Callable[..., Any]]:
    """Decompositions that are as right as NumPy's: other signs, other axes where values are equal, and other
    rounding."""
    rng = np.random.default_rng(seed)
    eigh = np.linalg.eigh
    svd = np.linalg.svd
    qr = np.linalg.qr

    def turned(columns: np.ndarray, values: np.ndarray) -> np.ndarray:
        out = columns.copy()
        scale = max(np.abs(values).max(initial=0.0), 1e-300)
        done = np.zeros(columns.shape[1], bool)
        values = np.concatenate([values, np.zeros(columns.shape[1] - len(values))])
        for n in range(columns.shape[1]):
            alike = ~done & (np.abs(values - values[n]) < 1e-12 * scale)
            size = int(alike.sum())
            out[:, alike] = columns[:, alike] @ qr(rng.normal(size=(size, size)))[0]
            done |= alike
        return out

    def other_eigh(matrix: np.ndarray, *args: Any, **kwargs: Any) -> Any:
        values, vectors = eigh(matrix, *args, **kwargs)
        return values * (1 + 1e-15), turned(vectors, values)

    def other_svd(matrix: np.ndarray, *args: Any, compute_uv: bool = True, **kwargs: Any) -> Any:
        if not compute_uv:
            return svd(matrix, *args, compute_uv=False, **kwargs)
        u, values, rows = svd(matrix, *args, **kwargs)
        return u, values, turned(rows.T, values).T  # callers here use the rows alone

    def other_qr(matrix: np.ndarray, *args: Any, **kwargs: Any) -> Any:
        q, r = qr(matrix, *args, **kwargs)
        signs = rng.choice([-1.0, 1.0], q.shape[-1])
        return q * signs, signs[:, None] * r

    return {"eigh": other_eigh, "svd": other_svd, "qr": other_qr}


def starts(env_id: str, options: dict[str, Any]) -> np.ndarray:
    env = make(env_id, **options)
    seen = []
    for seed in range(6):
        env.reset(seed=seed)
        positions, velocities = env.unwrapped.episodes.particles
        seen.append(
            np.concatenate([positions[0], velocities[0], env.unwrapped.episodes.goal[:1].T * np.ones(3)])
        )
    return np.array(seen)


@pytest.mark.parametrize(("env_id", "options"), VARIANTS, ids=str)
def test_starts_under_another_library(
    env_id: str, options: dict[str, Any], monkeypatch: pytest.MonkeyPatch
) -> None:
    expected = starts(env_id, options)
    assert np.ptp(expected, axis=0).max() > 0.1
    for seed in range(3):
        with monkeypatch.context() as patch:
            for name, function in another_library(seed).items():
                patch.setattr(np.linalg, name, function)
            np.testing.assert_allclose(starts(env_id, options), expected, rtol=0, atol=1e-9)


def test_another_library_is_another() -> None:
    """The twin: what used to start the box depends on the library."""
    matrix = np.random.default_rng(0).normal(size=(3, 3))
    other = another_library(0)
    assert any(
        np.abs(another_library(s)["qr"](matrix)[0] - np.linalg.qr(matrix)[0]).max() > 0.1 for s in range(3)
    )
    inertia = np.diag([1.0, 1.0, 2.0])
    _, axes = other["eigh"](inertia)
    np.testing.assert_allclose(axes @ np.diag([1.0, 1.0, 2.0]) @ axes.T, inertia, atol=1e-12)
    assert np.abs(np.abs(axes) - np.eye(3)).max() > 0.01


UNEVEN = box(mass=(0.2, 0.1, 0.1, 0.15, 0.1, 0.1, 0.15, 0.1))


@pytest.mark.parametrize("body", [UNEVEN, box((1, 2, 3)), cube(), top(), top(scaled={3: 1.4})], ids=str)
def test_principal_axes(body: Any) -> None:
    axes = principal_axes(body)
    moments, _ = body.principal()
    np.testing.assert_allclose(axes.T @ body.inertia() @ axes, np.diag(moments), atol=1e-9 * moments[2])
    assert np.linalg.det(axes) == pytest.approx(1.0)


def test_every_direction_and_orientation_is_alike() -> None:
    """Each entry of a rotation that is any one has mean 0 and mean square 1/3, and so has that of a
    direction: of 4000, within 5 standard deviations, 1/√(3·4000) and √(4/45/4000), the variance of the square
    being 4/45."""
    rng = np.random.default_rng(0)
    turns = np.array([any_rotation(rng) for _ in range(4000)])
    np.testing.assert_allclose(turns @ turns.transpose(0, 2, 1), np.tile(np.eye(3), (4000, 1, 1)), atol=1e-12)
    np.testing.assert_allclose(np.linalg.det(turns), 1.0)
    for drawn in (turns, np.array([direction(rng) for _ in range(4000)])):
        assert np.abs(drawn.mean(axis=0)).max() < 5 / np.sqrt(3 * 4000)
        assert np.abs((drawn**2).mean(axis=0) - 1 / 3).max() < 5 * np.sqrt(4 / 45 / 4000)


def test_numbers_are_drawn_as_numpy_does() -> None:
    low = (-1.0, 0.3, 25.0)
    high = (np.pi, 0.3, 45.0)
    ours = np.random.default_rng(5)
    theirs = np.random.default_rng(5)
    for _ in range(1000):
        assert uniform(ours, low, high) == theirs.uniform(low, high).tolist()


@pytest.mark.parametrize("env_id", IDS)
def test_starts_found_at_once_are_those_of_each(env_id: str) -> None:
    """To the bit: what a copy of a batch starts with does not depend on how many others start with it."""
    task = task_type(env_id)()
    rng = np.random.default_rng(1)
    factors = [dict(zip(RANDOMIZABLE, rng.uniform(0.8, 1.2, 8), strict=True)) for _ in range(13)]

    def starts(seeds: range) -> Any:
        generators = [np.random.default_rng(seed) for seed in seeds]
        return task.draw_starts(generators, [{} for _ in seeds], factors[seeds.start : seeds.stop])

    every = starts(range(13))
    for n in range(13):
        for one, many in zip(starts(range(n, n + 1)), every, strict=True):
            assert np.array_equal(one, many[n : n + 1])


@pytest.mark.parametrize("count", [300, pytest.param(4_000, marks=pytest.mark.slow)])
@pytest.mark.parametrize("env_id", IDS)
def test_starts_that_are_not_checked_are_possible(env_id: str, count: int) -> None:
    taken = inspect.signature(task_type(env_id)).parameters
    unchecked = 0
    for arguments in ({}, *fuzz.varied(env_id)):
        task = task_type(env_id)(**{name: value for name, value in arguments.items() if name in taken})
        if not task.checks_starts:
            generators = [np.random.default_rng((7, n)) for n in range(count)]
            begun = task.draw_starts(generators, [{} for _ in generators], [NOMINAL] * count)
            task.scene.check_start(begun.positions, begun.velocities)
            stretch = np.sqrt(squared_lengths(task.scene.springs, begun.positions)) / task.scene.lengths
            assert np.abs(stretch - 1).max(initial=0.0) < 0.2 * STRAIN_LIMIT
            unchecked += 1
    assert unchecked


def test_all_other_starts_are_checked(monkeypatch: pytest.MonkeyPatch) -> None:
    usual = make("SpringTop-v0")
    options = {"tilt": 0.1}
    varied = make("SpringTop-v0", randomize={"masses": (0.9, 1.2)})
    other = make("SpringTop-v0", body={"height": 1.0})
    own = springgym.make_scene_env("top", lambda m, s: m.strain, actuators={"torque": 1.0})
    for env, given in ((usual, {}), (usual, options), (varied, {}), (other, {}), (own, {})):
        called: list[Any] = []
        monkeypatch.setattr(Scene, "check_start", lambda *start, called=called: called.append(start))
        env.reset(seed=0, options=given)
        assert bool(called) == (env is not usual or bool(given))


@pytest.mark.parametrize("scale", [0.8, 1.0, 1.2])
def test_the_steepest_tops_of_a_duel_do_not_touch(scale: float) -> None:
    """Both lean to the middle: no draw of bearings brings them nearer."""
    task = task_type("SpringDuel-v0")()
    assert isinstance(task, SpringDuel)
    factors = {"masses": 1.0, "stiffness": 1.0, "gravity": 1.0, "scale": scale}

    def start(tilt: float) -> None:
        poses = [task._pose(turn, tilt, turn + np.pi, SPINS[1], factors) for turn in (0.7, 0.7 + np.pi)]
        begun = task.starts(np.reshape(poses, (1, -1)))
        task.scene.check_start(begun.positions[0], begun.velocities[0])

    start(STEEPEST)
    with pytest.raises(ValueError, match="deep in each other"):
        start(STEEPEST + 0.03)


@pytest.mark.parametrize("env_id", ["SpringDetumble-v0", "SpringTumble-v0"])
def test_orientations_of_starts_point_everywhere(env_id: str) -> None:
    """Of 60 starts, the mean of each of the triad's components is within 5/√(3·60) of 0."""
    env = make(env_id)
    triads = []
    for seed in range(60):
        env.reset(seed=seed)
        m = env.unwrapped.episodes.measures
        triads.append(np.concatenate([m.side[0], m.axis[0]]))
    assert np.abs(np.mean(triads, axis=0)).max() < 5 / np.sqrt(3 * 60)
    assert (np.ptp(triads, axis=0) > 1.5).all()


SAME_STARTS = {"sparse", "momentum", "randomize"}
"""Arguments that change no start."""


def check_corners(env_id: str, **arguments: Any) -> None:
    """All options at a bound at once: one alone may fit where two together lean a ring into a bowl."""
    env = gym.make(env_id, **arguments)
    bounds = fuzz.allowed(env)
    corners = [dict(zip(bounds, values, strict=True)) for values in product(*bounds.values())]
    assert len(corners) == 2 ** len(bounds)
    for n, corner in enumerate(corners):
        options = {name: int(value) if name == "corner" else value for name, value in corner.items()}
        observation, _ = env.reset(seed=n, options=options)
        assert env.observation_space.contains(observation)


@pytest.mark.parametrize("env_id", [pytest.param(own, marks=slow_unless(own != DUEL)) for own in IDS])
def test_every_corner_of_the_reset_options_can_be_started_from(env_id: str) -> None:
    check_corners(env_id)


@pytest.mark.slow
@pytest.mark.parametrize("env_id", IDS)
def test_every_corner_of_every_variant_can_be_started_from(env_id: str) -> None:
    for arguments in fuzz.varied(env_id):
        if SAME_STARTS.isdisjoint(arguments):
            check_corners(env_id, **arguments)


def test_tilted_is_the_product_of_two_rotations_to_the_bit() -> None:
    for azimuth, tilt in np.random.default_rng(0).uniform(-7, 7, (50, 2)):
        expected = rotation((0, 0, 1), azimuth) @ rotation((0, 1, 0), tilt)
        np.testing.assert_array_equal(tilted(azimuth, tilt), expected)


def test_tops_stand_on_their_tips_as_the_equations_say() -> None:
    """Tops in shapes of their own are scaled, turned about their tips, and have the velocities ω × r."""
    body = top()
    rng = np.random.default_rng(0)
    shape = stretched_shapes(body, (0, 0, 1), 100.0)
    tip = body.particle("tip")
    poses = rng.uniform((-3.0, 0.0, -50.0), (3.0, 0.6, 50.0), (5, 3))
    factors = [
        dict.fromkeys(RANDOMIZABLE, 1.0) | {"scale": 1 + 0.1 * k, "masses": 1.2, "stiffness": 1 + 0.2 * k}
        for k in range(5)
    ]
    varied = [(own["scale"], own["masses"] / own["stiffness"]) for own in factors]
    positions, velocities = standing(shape, tip, np.hstack([poses, varied]))
    for k, (azimuth, tilt, spin) in enumerate(poses):
        turn = rotation((0, 0, 1), azimuth) @ rotation((0, 1, 0), tilt)
        upright = factors[k]["scale"] * shape(spin * np.sqrt(1.2 / factors[k]["stiffness"]))
        arms = (upright - upright[tip]) @ turn.T
        size = np.abs(arms).max()
        assert (
            np.abs(positions[k] - arms).max() < 8 * np.finfo(float).eps * size
        )  # three products, and a turn
        turning = np.cross(spin * turn[:, 2], arms)
        assert np.abs(velocities[k] - turning).max() < 32 * np.finfo(float).eps * abs(spin) * size
    assert not positions[:, tip].any()


@pytest.mark.parametrize(("env_id", "scale"), [("SpringStack-v0", 0.3), ("SpringDuel-v0", 2.0)])
def test_sizes_that_do_not_fit_are_refused(env_id: str, scale: float) -> None:
    env = make(env_id, randomize={"scale": (scale, scale)})
    with pytest.raises(ValueError, match=f"randomize allows .* of scale {scale:g}; it must be"):
        env.reset(seed=0)
