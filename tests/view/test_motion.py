"""What the page shows: recordings and episodes as positions over time, with what is drawn beside them."""

import re
from dataclasses import replace

import gymnasium as gym
import numpy as np
import pytest

import springgym  # noqa: F401  (registers)
from springgym.scenes import load
from springgym.scenes.film import TURN_A_FRAME
from springgym.scenes.plan import SPEEDS
from springgym.scenes.recording import record
from springgym.simulator import PAPER_SETTINGS
from springgym.view.motion import of_recording
from tests.params import slow_but

pytest.importorskip("viser")

from springgym.view.episodes import find_agent, played


def recorded(scene, duration, **changes):
    return record(replace(load(scene), duration=duration, **changes))


@pytest.fixture(scope="module")
def top():
    return of_recording(recorded("top", 0.3))


def test_strain_is_that_of_the_simulator(top):
    assert top.strain.shape == (len(top.times), 37)
    measured = recorded("top", 0.3).measures.strain
    np.testing.assert_allclose(np.abs(top.strain).max(axis=1), measured, rtol=1e-9)


def test_pin_holds_the_weight_and_turns_it():
    """A pendulum at its lowest: the pin pulls with M (g + v²/r), straight up."""
    recording = recorded("cube-pendulum", 3.0)
    m = recording.measures
    scene = recording.plan.scene
    arrows = of_recording(recording, twin=False).arrows
    n = int(np.argmin(m.centre[:400, 2]))
    radius = np.linalg.norm(m.centre[n] - recording.positions[n, scene.pinned[0]])
    speed = np.linalg.norm(m.centre_velocity[n])
    expected = 1 + speed**2 / radius / 9.81
    weight, support = (arrows[name].vectors[n] for name in ("weight", "support"))
    assert speed > 0.1
    assert support[2] / -weight[2] == pytest.approx(expected, rel=0.02)


def test_floor_holds_what_lies_on_it():
    recording = recorded("block-holds", 0.5)
    arrows = of_recording(recording, twin=False).arrows
    np.testing.assert_allclose(
        arrows["support"].vectors[-1], -arrows["weight"].vectors[-1], rtol=1e-3, atol=1e-4
    )
    lowest = recording.plan.scene.surfaces[0].height(recording.positions[-1]).min()
    assert recording.plan.scene.surfaces[0].height(arrows["support"].origins[-1]) == pytest.approx(
        lowest, abs=1e-3
    )


def test_what_rolls_is_held_where_it_touches():
    """The floor holds a ball below its centre, a radius away, where no particle is."""
    recording = record(replace(load("ball-skids"), duration=0.2), contacts=True)
    arrows = of_recording(recording, twin=False).arrows
    scene = recording.plan.scene
    radius = np.sqrt(scene.body.rounds[0].matrix[0, 0])
    origins = arrows["support"].origins
    below = recording.measures.centre - np.array([0.0, 0.0, radius])
    np.testing.assert_allclose(origins, below, atol=0.02 * radius)
    assert scene.surfaces[0].height(recording.positions).min() > 0.1 * radius


@pytest.mark.slow
def test_contacts_of_colliding_bodies_are_recorded():
    plan = replace(load("stack"), duration=0.1)
    told = record(plan, contacts=True)
    assert len(told.contacts) == len(told.times)
    assert all(part.contacts == () for part in told.parts)
    assert record(plan).contacts == ()
    block = load("block-holds")
    other = replace(block, duration=0.1, scene=block.scene.with_(contact=block.paper), **PAPER_SETTINGS)
    assert record(other, contacts=True).contacts == ()
    assert of_recording(record(other, contacts=True), twin=False).touches is None


def test_what_is_missing_is_told_of_colliding_bodies_too():
    told = {
        name: of_recording(recorded(name, 0.02), twin=False).note
        for name in ("top", "newtons-cradle", "stack")
    }
    assert told["top"].startswith("pinned, no floor")
    assert told["newtons-cradle"] == "no gravity"
    assert told["stack"] == ""


def test_without_gravity_there_is_no_weight():
    """Nor an arrow of no numbers."""
    arrows = of_recording(recorded("newtons-cradle", 0.02), twin=False).arrows
    assert "weight" not in arrows


def test_in_flight_nothing_holds():
    arrows = of_recording(recorded("cube-drop", 0.2), twin=False).arrows
    assert not arrows["support"].vectors[1:-1].any()
    assert arrows["weight"].vectors.any()


def test_slow_enough_to_see_which_way_it_turns(top):
    fastest = top.speed(30.0)
    assert fastest in SPEEDS
    assert top.fastest * fastest / 30 <= TURN_A_FRAME < top.fastest * 2 * fastest / 30
    assert of_recording(recorded("rope-swing", 0.1)).speed(30.0) == 1.0


def test_between_two_times(top):
    assert top.at(-1.0) == (0, 0.0)
    assert top.at(1e9) == (len(top.times) - 2, 1.0)
    n, share = top.at(0.25 * top.times[3] + 0.75 * top.times[4])
    assert (n, share) == (3, pytest.approx(0.75))


def test_energies_that_hardly_move_are_shown_as_changes(top):
    assert "energy moved [J]" in top.graphs
    swing = of_recording(recorded("rope-swing", 1.0)).graphs
    assert "energy [J]" in swing
    assert "tilt [°]" not in swing  # a rope has no axis
    curves = swing["energy [J]"]
    assert np.ptp(curves["sum"].values) < 1e-3 * np.ptp(curves["kinetic"].values)


@pytest.mark.parametrize("env_id", slow_but(["SpringFreeTop-v0", "SpringJuggle-v0"], "SpringFreeTop-v0"))
def test_the_states_between_are_those_under_the_action(env_id):
    """Not under the one before."""
    motion = played(find_agent("random", env_id), 3)
    env = gym.make(env_id).unwrapped
    env.action_space.seed(0)
    env.reset(seed=3)
    task = env.episodes.task
    simulator = env.episodes.simulator
    steps = env.episodes.steps
    parts = round(task.period / motion.times[1])
    for period in range(3):
        action = env.action_space.sample()
        before = simulator.state()
        simulator.actuate(**task.actuate(action[None].astype(float)))
        simulator.advance(round(steps / parts), read=True)
        now = simulator.readout.positions[0]
        np.testing.assert_allclose(motion.positions[period * parts + 1], now, rtol=0, atol=1e-12)
        simulator.restore(before)
        simulator.read()
        env.step(action)


@pytest.mark.parametrize("env_id", slow_but(["SpringJuggle-v0", "SpringDuel-v0"], "SpringJuggle-v0"))
def test_episodes_of_several_bodies_are_shown(env_id):
    motion = played(find_agent("noop", env_id), 3)
    assert np.isfinite(motion.positions).all()
    assert any(marks.text for marks in motion.marks)


@pytest.mark.slow
def test_contacts_of_an_episode_hold_what_lies_on_them():
    """A box and a ball on the floor: together, their contacts push them up by their weight."""
    motion = played(find_agent("noop", "SpringShove-v0"), 3)
    assert motion.touches is not None
    points, vectors, mutual = motion.touches
    assert len(points) == len(motion.times)
    assert not mutual.any()  # they lie apart
    late = len(points) // 2
    pushes = vectors[late:].sum(axis=1).mean(axis=0)
    weight = 0.36 * motion.extent  # as long as touches draw the weight of both
    np.testing.assert_allclose(pushes, (0.0, 0.0, weight), rtol=1e-3, atol=1e-3 * weight)
    there = np.isfinite(points[late:]).all(axis=2)
    assert there.any(axis=1).all()
    np.testing.assert_allclose(points[late:][there][:, 2], 0.0, atol=1e-2)


def test_what_touches_nothing_has_no_contacts():
    assert played(find_agent("noop", "SpringTop-v0"), 3).touches is None


def test_an_episode_is_the_environment_s_own():
    """The states between come from playing each control period again; its end must stay as it was."""
    motion = played(find_agent("random", "SpringRope-v0"), 3)
    env = gym.make("SpringRope-v0")
    env.action_space.seed(0)
    env.reset(seed=3)
    positions = [env.unwrapped.episodes.particles[0][0].copy()]
    over = False
    while not over:
        *_, terminated, truncated, _ = env.step(env.action_space.sample())
        over = terminated or truncated
        positions.append(env.unwrapped.episodes.particles[0][0].copy())
    parts = (len(motion.times) - 1) // (len(positions) - 1)
    assert parts > 1
    np.testing.assert_array_equal(motion.positions[::parts], positions)
    ways = np.linalg.norm(np.diff(motion.positions, axis=0), axis=2).max(axis=1)
    np.testing.assert_array_less(ways, 3 * np.median(ways))  # no leaps between
    assert motion.times[-1] == pytest.approx((len(positions) - 1) * env.unwrapped.episodes.task.period)
    assert np.diff(motion.times).min() > 0


def test_unknown_agent(tmp_path):
    with pytest.raises(ValueError, match="neither a run folder"):
        find_agent(str(tmp_path), "SpringTop-v0")
    with pytest.raises(ValueError, match="not a springgym environment"):
        played(find_agent("noop", "CartPole-v1"), 0)


def test_an_episode_says_what_it_is_once():
    """With its steps counted in words, and no strain of minus nothing."""
    agent = find_agent("noop", "SpringBilliards-v0")
    motion = played(agent._replace(name=agent.env_id), 3)
    assert motion.title == "SpringBilliards-v0"
    assert re.match(r"1 step of 2 s · return -?[\d.]+ \(-?[\d.]+ per step\) · no success · ", motion.summary)
    assert "-0.0e" not in motion.summary
