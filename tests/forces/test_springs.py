"""Springs and dampers give a single copy the bits of a copy of a block."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from springgym.core.blocks import block_array, numbers
from springgym.core.compiling import kernel
from springgym.core.lanes import at
from springgym.forces.springs import add_spring_forces, damp, decay
from springgym.terms import Dampers, Springs
from tests.params import slow_but

pytestmark = pytest.mark.own_kernels


@kernel
def pull(x: Any, v: Any, force: Any, direction: Any, springs: Any, dampers: Any, ledger: Any) -> None:
    """Add the forces of springs, with the dampers' in two ways, and let speeds decay there and back."""
    x, v, force, direction = at(x, 0), at(v, 0), at(force, 0), at(direction, 0)
    ledger = at(ledger, 0)
    add_spring_forces(x, None, force, direction, True, springs, dampers, None, 0.0)
    add_spring_forces(x, v, force, direction, False, springs, dampers, ledger, 0.5)
    damp(v, direction, springs, dampers, None, ledger, False, False)
    damp(v, direction, springs, dampers, None, ledger, True, True)


def results(copies: int, dtype: Any, particles: int, springs: int) -> list[np.ndarray]:
    """Return what `pull` changes in the last copy of a random body."""
    rng = np.random.default_rng(particles)
    ends = np.array([rng.choice(particles, 2, replace=False) for _ in range(springs)], np.uint32)
    x, v, force = rng.normal(size=(3, particles, 3))
    masses = rng.uniform(1, 2, particles)
    damping = rng.uniform(1, 9, springs)
    first, second = (np.ascontiguousarray(end) for end in ends.T)
    of = Springs(first, second, rng.uniform(1, 2, springs), rng.uniform(1e2, 1e3, springs))
    half, whole = (decay(damping, 1 / masses[first], 1 / masses[second], time) for time in (0.01, 0.02))
    rows = max(particles, springs)  # as many as workspaces have
    shapes = [(particles, 3), (particles, 3), (rows, 3), (rows, 3), (9,)]
    arrays = [block_array(copies, shape, dtype) for shape in shapes]
    for array, values in zip(arrays, (x, v, force), strict=False):
        numbers(array)[:, :particles] = values[..., None]
    pull(*arrays[:4], of, Dampers(damping, half, whole, True), arrays[4])
    return [numbers(array)[0, ..., -1] for array in arrays[1:]]


@pytest.mark.parametrize("dtype", slow_but([np.float64, np.float32], np.float64))
def test_a_single_copy_has_the_bits_of_one_of_a_block(dtype: Any) -> None:
    single, block = results(1, dtype, 14, 37), results(2, dtype, 14, 37)
    for ours, theirs in zip(single, block, strict=True):
        np.testing.assert_array_equal(ours, theirs)
    _, force, direction, ledger = block
    assert np.isfinite(force).all()
    assert np.ptp(direction) > 0.5
    assert ledger.any()
