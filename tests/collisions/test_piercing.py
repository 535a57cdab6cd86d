"""Nothing pierces untold: fast throws, judged by geometry alone, and what the simulator says of them."""

from __future__ import annotations

import gymnasium as gym
import numpy as np
import pytest

from springgym.dynamics.contact.overlap import find_overlaps, outlines
from springgym.model.bodies import ball
from springgym.model.scene import Placed, Scene
from springgym.model.surfaces import Contact
from springgym.simulator import SimulationDivergedError, Simulator, UnresolvedContactError
from tests.collisions.stepped import full
from tests.collisions.throws import THROWS, in_each_other, thrown, watched
from tests.copies import check_alone

BALL = ball(0.1)


def two_balls(speed: float, copies: int = 1, **options: object) -> Simulator:
    """Two balls that approach each other along x, with v h = 1e-3 s × speed, and Δ = 1 cm."""
    left = Placed(BALL, np.array([[-0.3, 0, 0]]), np.array([[speed / 2, 0, 0]]), name="left")
    right = Placed(BALL, np.array([[0.3, 0, 0]]), np.array([[-speed / 2, 0, 0]]), name="right")
    contact = Contact(friction=0.5, strength=0.05, reach=0.01)
    scene = Scene(bodies=(left, right), gravity=None, collisions=contact)
    return full(scene, step=1e-3, copies=copies, **options)


@pytest.mark.slow
@pytest.mark.parametrize("name", THROWS)
def test_throws(name: str) -> None:
    """In no step are bodies in each other before the simulator says that it cannot resolve their contact."""
    seen = watched(THROWS[name])
    assert seen.told.sum() > 40
    assert not seen.untold.any()
    assert not (seen.left & ~seen.told).any()


@pytest.mark.slow
def test_throws_of_rigid_bodies() -> None:
    """The same of rigid bodies."""
    for name in ("cubes, 30 m/s", "needle on plate, 100 m/s"):
        seen = watched(THROWS[name], dynamics="rigid", step=2e-4)
        assert seen.told.any()
        assert not seen.untold.any()


def test_geometry_of_throws() -> None:
    """The judge of throws knows bodies that touch from those that overlap, and what is all inside."""
    scene, x, _ = thrown(THROWS["cubes, 30 m/s"], 4)
    first, second = scene.slices
    x[:] = scene.positions
    side = np.ptp(x[0, first, 0])
    middle = x[0, first].mean(axis=0) - x[0, second].mean(axis=0)
    x[0, second] += middle + np.array([side + 1e-9, 0.01, 0.02])
    x[1, second] += middle + np.array([side - 1e-9, 0.01, 0.02])
    x[2, second] = (x[2, second] - x[2, second].mean(axis=0)) / 2 + x[2, first].mean(axis=0)
    assert in_each_other(scene, x).tolist() == [False, True, True, False]


def test_too_fast_is_an_error() -> None:
    """It names the bodies, the copy, the speed and the largest one that the step resolves."""
    simulator = two_balls(30.0)
    told = (
        r"'left' and 'right' of copy 0 .* t = 0\.1 s at 30 m/s.* up to 10 m/s"
        r".* 0\.28 N·m².* at most 6\.6e-05 s"
    )
    with pytest.raises(SimulationDivergedError, match=told):
        simulator.advance(100)
    with pytest.raises(UnresolvedContactError):  # it stays told
        simulator.advance(1)
    simulator.place(simulator.scene.positions, 0.1 * simulator.scene.velocities)
    simulator.advance(300)
    assert not simulator.unresolved.any()
    assert simulator.pairs().fastest == pytest.approx(3.0)


def test_counted_in_place_of_an_error() -> None:
    """Who asks for it is told by numbers alone, as is whoever neither checks nor reads; and can forget."""
    simulator = two_balls(30.0, unresolved="count")
    simulator.advance(100)
    assert simulator.unresolved.tolist() == [True]
    state = simulator.state()
    simulator.pairs(forget=True)
    assert simulator.unresolved.tolist() == [False]
    simulator.advance(1)
    assert simulator.unresolved.tolist() == [False]
    simulator.restore(state)
    assert simulator.unresolved.tolist() == [True]
    unchecked = two_balls(30.0)
    unchecked.advance(100, check=False)
    assert unchecked.unresolved.tolist() == [True]


@pytest.mark.parametrize("dynamics", ["springs", "rigid"])
@pytest.mark.parametrize(("speed", "aside", "off"), [(5.0, 0.0, 1e-9), (9.0, 0.0, 1e-9), (9.0, 0.05, 1e-5)])
def test_what_is_resolved_is_no_error(speed: float, aside: float, off: float, dynamics: str) -> None:
    """At .5 and .9 Δ in a step, balls separate with all their energy and are never shown in each other.

    Balls of one particle each are smooth, so that they do it in oblique impacts, too.
    """
    simulator = two_balls(speed, dynamics=dynamics)
    apart = np.array([[0, aside, 0], [0, 0, 0]])
    simulator.place(simulator.scene.positions + apart, simulator.scene.velocities)
    least = np.inf
    for _ in range(200):
        simulator.advance(1)
        x = simulator.positions[0]
        least = min(least, float(np.linalg.norm(x[0] - x[1])) - 0.2)
    assert least > 0
    assert np.linalg.norm(np.diff(simulator.velocities[0], axis=0)) == pytest.approx(speed, rel=off)
    assert (simulator.velocities[0, 1, 1] < -1.0) == (aside > 0.0)


def test_none_is_too_fast_to_be_found() -> None:
    """What flies through all of another in a step is found, at any speed and from any distance."""
    for speed in (100.0, 1e4, 1e6, 1e8, 1e12, 1e25):
        simulator = two_balls(speed)
        with pytest.raises(UnresolvedContactError, match="left"):
            simulator.advance(1 + int(0.6 / speed / simulator.step))


def test_one_copy_does_not_concern_others() -> None:
    """A copy that is too fast leaves the motion of the other copies bit-identical."""
    scene = two_balls(5.0).scene
    v = np.array([1.0, 100.0, 0.9])[:, None, None] * scene.velocities
    x = np.broadcast_to(scene.positions, v.shape)
    balls = check_alone(lambda copies: two_balls(5.0, copies, unresolved="count"), x, v, [100], (0, 2))
    assert balls.unresolved.tolist() == [False, True, False]


def test_option_is_checked() -> None:
    """`unresolved` takes "raise" and "count", and refuses everything else."""
    for wrong in ("ignore", True, None, 1):
        with pytest.raises((TypeError, ValueError), match="unresolved"):
            two_balls(1.0, unresolved=wrong)


def test_what_is_shown_is_looked_at() -> None:
    """Of bodies anywhere, near, across and within each other, the simulator knows what the judge knows."""
    for name in ("cubes, 30 m/s", "needle on plate, 100 m/s"):
        scene, x, _ = thrown(THROWS[name], 300)
        first, second = scene.slices
        rng = np.random.default_rng(1)
        x[:, first] += 0.7 * (x[:, second].mean(axis=1) - x[:, first].mean(axis=1))[:, None]
        x[:, first] += 0.3 * rng.normal(size=(300, 1, 3)) * np.ptp(x[:, first], axis=1)[:, None]
        x[:100, first] += 0.9 * (x[:100, second].mean(axis=1) - x[:100, first].mean(axis=1))[:, None]
        x[:50, first] = 0.2 * (x[:50, first] - x[:50, first].mean(axis=1)[:, None])
        x[:50, first] += x[:50, second].mean(axis=1)[:, None]
        pair = np.array([0, 1])
        of = outlines(scene.shapes, scene.offsets)
        found = np.zeros((300, 1), bool)
        whether = find_overlaps(x, pair[:1], pair[1:], of, np.zeros((3, 2, 3)), found)
        expected = in_each_other(scene, x)
        assert whether
        assert 50 < expected.sum() < 290
        assert (found[:, 0] == expected).all()


def test_episode_ends() -> None:
    """In a batch, the copy in which bodies are too fast ends as a failure, without a word to the others."""
    env = gym.make_vec("SpringShove-v0", num_envs=3)
    env.reset(seed=0)
    simulator = env.unwrapped.episodes.simulator  # type: ignore[attr-defined]
    x = simulator.positions
    v = simulator.velocities
    first, second = simulator.scene.slices[:2]
    way = x[1, second].mean(axis=0) - x[1, first].mean(axis=0)
    v[1, first] = 200.0 * way / np.linalg.norm(way)
    simulator.place(x, v)
    action = np.zeros_like(env.action_space.sample())
    for _ in range(5):
        _, reward, terminated, truncated, info = env.step(action)
        if terminated.any():
            break
    assert terminated.tolist() == info["diverged"].tolist() == [False, True, False]
    assert not truncated.any()
    assert reward[1] == 0
    assert info["coarse_contacts"][1] > 0 == info["coarse_contacts"][0]
    assert (info["pairs_late_contacts"] >= 0).all()
    env.close()
