"""A copy takes the same path, to the bit, alone, among others, and on any number of threads."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from springgym.core.language.blocks import by_copies
from springgym.dynamics.methods import METHODS, integrator
from tests.integrators.problems import simulator, tetrahedron

pytestmark = [pytest.mark.own_kernels, pytest.mark.slow]

COPIES = 11
STEPS = 200


def batch(name: str, copies: Any, threads: int = 1, spoilt: int | None = None, **options: Any) -> tuple:
    """Positions, velocities, losses and counts of copies that start and are turned each in its own way."""
    step = 0.06 if integrator(name).iterative else 0.01
    made = simulator(tetrahedron(name, 1.0), name, step, copies=len(copies), threads=threads, **options)
    scale = 1 + 0.2 * np.asarray(copies)[:, None, None]
    velocities = made.velocities * scale
    positions = made.positions
    made.place(positions, velocities)
    if spoilt is not None:  # which no call would
        by_copies(made._x)[spoilt // made.width, spoilt % made.width, 2] = np.nan
    made.actuate(torque=np.multiply.outer(0.1 * np.asarray(copies), [1.0, 2.0, -1.0]))
    made.advance(STEPS, check=False)
    measures = made.measure()
    counts = made.counts() if made.integrator.controlled else np.zeros((len(copies), 3))
    energies = np.stack([measures.work, measures.damping_loss], axis=1)
    return made.positions, made.velocities, energies, counts


@pytest.mark.parametrize("name", METHODS)
def test_batch_equals_single(name: str) -> None:
    """Also if one of its copies diverges. Every run tests verlet so, `tests/envs/test_contract.py`."""
    options: dict[str, Any] = {"tolerance": (1e-10, 1e-10)} if integrator(name).controlled else {}
    together = batch(name, range(COPIES), **options)
    threaded = batch(name, range(COPIES), threads=2, **options)
    for ours, theirs in zip(together, threaded, strict=True):
        np.testing.assert_array_equal(ours, theirs)
    for copy in (0, 7, 10):
        alone = batch(name, [copy], **options)
        for ours, theirs in zip(alone, together, strict=True):
            np.testing.assert_array_equal(ours[0], theirs[copy])
    positions, _, energies, counts = together
    assert np.ptp(positions, axis=0).max() > 0.1
    assert np.ptp(energies[:, 0]) > 0.1
    if integrator(name).controlled:
        assert np.ptp(counts, axis=0).max() > 5  # the copies did not march in step
    spoilt = batch(name, range(COPIES), spoilt=3, **options)
    others = np.arange(COPIES) != 3
    assert np.isnan(spoilt[0][3]).any()
    for ours, theirs in zip(together, spoilt, strict=True):
        np.testing.assert_array_equal(ours[others], theirs[others])
