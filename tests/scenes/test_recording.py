from dataclasses import replace

import numpy as np
import pytest

from springgym.model.bodies import rope
from springgym.model.scene import Scene
from springgym.scenes import load
from springgym.scenes.recording import record, rigid_twin
from springgym.simulator import SimulationDivergedError, Simulator

PLAN = replace(load("cube-pendulum"), duration=0.1)


def test_states_are_those_of_the_simulator():
    recording = record(replace(PLAN, step=5e-4))
    simulator = Simulator(PLAN.scene, step=5e-4, damping_every=1)
    assert recording.times == pytest.approx(np.arange(11) * 0.01)
    assert recording.positions[0].tolist() == PLAN.scene.positions.tolist()
    simulator.advance(20)
    assert recording.positions[1].tolist() == simulator.positions[0].tolist()
    assert recording.velocities[1].tolist() == simulator.velocities[0].tolist()
    assert recording.measures.kinetic[1] == simulator.measure().kinetic[0]


def test_an_automatic_step_is_a_part_of_the_interval():
    recording = record(PLAN)
    share = PLAN.interval / recording.step
    assert share == pytest.approx(round(share), rel=1e-12)
    assert Simulator(PLAN.scene).step * 0.5 < recording.step <= Simulator(PLAN.scene).step
    assert recording.times == pytest.approx(np.arange(11) * 0.01)


def test_the_interval_is_a_whole_number_of_given_steps():
    recording = record(replace(PLAN, step=7e-4))
    assert recording.step == 7e-4
    assert np.diff(recording.times) == pytest.approx(14 * 7e-4)
    assert len(recording.times) == 1 + round(0.1 / (14 * 7e-4))


@pytest.mark.parametrize(("interval", "parts"), [(1.0, 1), (0.06, 2), (0.03, 3)])
def test_a_whole_number_of_intervals_is_fitted_into_the_duration(interval, parts):
    recording = record(replace(PLAN, interval=interval, duration=0.1))
    assert recording.times == pytest.approx(np.linspace(0.0, 0.1, parts + 1))


@pytest.mark.parametrize("states", [0, 1])
def test_interrupted_at_once_is_an_interrupt(states):
    def interrupted(items):
        yield from range(states)
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        record(PLAN, progress=interrupted)


def test_divergence_is_an_error():
    plan = load("top")
    fast = plan.scene.with_(velocities=60 * plan.scene.velocities)
    with pytest.raises(SimulationDivergedError, match=r"diverged before t = 0\.005 s"):
        record(replace(plan, scene=fast, duration=0.1))


def test_a_bungee_cord_may_double_its_length():
    assert record(replace(load("bungee"), duration=4.0)).measures.strain.max() > 1.5


def test_rigid_twin_keeps_its_shape_and_the_times():
    recording = record(PLAN)
    twin = rigid_twin(recording)
    assert twin.times == pytest.approx(recording.times)
    assert twin.measures.strain.max() < 1e-12
    assert twin.positions == pytest.approx(recording.positions, abs=1e-4)
    assert rigid_twin(record(replace(load("rope-swing"), duration=0.1))) is None
    assert rigid_twin(record(replace(load("irregular-fall"), duration=0.6))).step == 4e-5  # of the scene


def test_what_would_not_end_is_refused():
    """An end of 1e-15 kg asks for steps of 1e-16 s; the error says what is to blame."""
    body = rope(end_mass=1e-15, damping=10.0)
    plan = replace(load("rope-swing"), scene=Scene(body, pinned=(0,)), step=None)
    with pytest.raises(
        ValueError, match=r"a step of .* makes .* steps in an interval .*masses from 1e-15 kg"
    ):
        record(plan)


def test_what_would_not_fit_into_memory_is_refused():
    with pytest.raises(ValueError, match=r"1e\+06 s at intervals of 1e-05 s are 1e\+11 states of"):
        record(replace(PLAN, duration=1e6, interval=1e-5))
