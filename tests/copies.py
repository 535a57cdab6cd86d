"""Whether copies of a batch are as they are alone, to the bit."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from springgym.simulator import Simulator


def reported(simulator: Simulator, copy: int) -> list[bytes]:
    """Return the bits of all that a simulator reports of a copy."""
    found = [simulator.positions, simulator.velocities, *simulator.measure(), *simulator.pairs()]
    return [np.asarray(array)[copy].tobytes() for array in found]


def check_alone(
    make: Callable[[int], Simulator],
    x: np.ndarray,
    v: np.ndarray,
    calls: Sequence[int],
    chosen: Sequence[int],
    alone: int = 1,
    calls_alone: Sequence[int] | None = None,
) -> Simulator:
    """Compare chosen copies of a batch, advanced in several calls, with simulators of ``alone`` copies.

    These are advanced in one call, if none are given.
    """
    batch = make(len(x))
    batch.place(x, v)
    for steps in calls:
        batch.advance(steps)
    for n in chosen:
        one = make(alone)
        one.place(x[n], v[n])
        for steps in calls_alone or [sum(calls)]:
            one.advance(steps)
        assert reported(one, 0) == reported(batch, n), n
    assert reported(batch, chosen[0]) != reported(batch, chosen[1])
    return batch
