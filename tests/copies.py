"""Checks of simulators: copies are as alone, calls of any length are one, contacts change momenta."""

from __future__ import annotations

import copy
import pickle
from collections.abc import Callable, Sequence

import numpy as np

from springgym.simulator import Simulator


def reported(simulator: Simulator, copy: int) -> list[bytes]:
    """Return the bits of all that a simulator reports of a copy."""
    found = [simulator.positions, simulator.velocities, *simulator.measure(), *simulator.pairs()]
    return [np.asarray(array)[copy].tobytes() for array in found]


def all_reported(simulator: Simulator) -> list[list[bytes]]:
    """Return the bits of all that a simulator reports of each copy."""
    return [reported(simulator, n) for n in range(simulator.copies)]


def check_calls(simulator: Simulator, calls: Sequence[int], more: int = 100) -> None:
    """Check that several calls that are read are one call that is not, to the bit, and so are ``more`` steps
    of copied, pickled and restored simulators."""
    others = [copy.copy(simulator), pickle.loads(pickle.dumps(simulator))]
    simulator.advance(sum(calls), read=False)
    for other, parts in zip(others, (calls, calls[::-1]), strict=True):
        for steps in parts:
            other.advance(steps, check=False)
            other.measure()
        assert all_reported(other) == all_reported(simulator)
    state = simulator.state()
    kept = pickle.loads(pickle.dumps(others[1]))
    others[0].advance(more)
    others[0].restore(state)
    for one in (simulator, others[0], kept):
        one.advance(more)
        assert all_reported(one) == all_reported(simulator)


def check_alone(
    make: Callable[[int], Simulator],
    x: np.ndarray,
    v: np.ndarray,
    calls: Sequence[int],
    chosen: Sequence[int],
) -> Simulator:
    """Check that a batch advanced in several calls has the bits of single copies advanced in one call."""
    batch = make(len(x))
    batch.place(x, v)
    for steps in calls:
        batch.advance(steps)
    for n in chosen:
        one = make(1)
        one.place(x[n], v[n])
        one.advance(sum(calls))
        assert reported(one, 0) == reported(batch, n), n
    assert reported(batch, chosen[0]) != reported(batch, chosen[1])
    return batch


def check_contacts(simulator: Simulator, steps: int) -> np.ndarray:
    """Check that each step changes the momentum of the first body by what its contacts give, and by gravity,
    and that asking for them changes no bit; return their impulses (steps, copies, 3) [N·s]."""
    other = copy.copy(simulator)
    scene = simulator.scene
    weight = scene.bodies[0].body.mass * np.array(scene.gravity or (0.0, 0.0, 0.0))
    given = []
    momenta = [simulator.measure(0).momentum]
    for _ in range(steps):
        found = simulator.contacts()
        given.append((found.impulse * (found.first == 0)[..., None]).sum(axis=1))
        for one in (simulator, other):
            one.advance(1, check=False)
        momenta.append(simulator.measure(0).momentum)
    assert all_reported(simulator) == all_reported(other)
    changed = np.diff(momenta, axis=0) - weight * simulator.step
    np.testing.assert_allclose(given, changed, rtol=0, atol=1e-12)
    return np.array(given)
