"""Boxes of cells with springs along edges and face diagonals, which converge to an elastic solid."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from itertools import product

import numpy as np

from springgym.model.bodies.network import Network


def lattice(sides: Sequence[float], counts: Sequence[int]) -> tuple[Network, np.ndarray]:
    """Return a box of cells with springs along edges and face diagonals, and the stiffnesses (S,).

    On large scales, springs of cells of sides a, b, c and volume V act as a solid with C_xxyy V = 2 k_xy a²
    b²/(a² + b²) and C_xxxx V = k_x a² + 2 k_xy a⁴/(a² + b²) + 2 k_xz a⁴/(a² + c²). They are isotropic, with a
    Poisson's ratio of ¼ and μ = 2E/5, if C_xxyy = μ = C_xxxx/3. Each cell adds its share to the springs at
    its rim: a quarter of an edge, half of a diagonal. Masses are products of weights along each side,
    Simpson's for two cells, that have the box's moments.

    Raises
    ------
    ValueError
        If an edge would need a negative stiffness, with cells far from cubes, or a side has one cell.
    """
    if min(counts) < 2:
        raise ValueError(f"a lattice has at least two cells along each side, not {min(counts)}")
    cell = np.array(sides, float) / counts
    volume = float(np.prod(cell))
    shear = 0.4
    edge = shear * volume / cell**2 * (4 - cell**2 * (1 / cell**2).sum())
    if (edge <= 0).any():
        raise ValueError(
            f"cells of {' × '.join(f'{side:.3g}' for side in cell)} are too far from cubes for a lattice; "
            "use a different number of cells"
        )
    positions = grid(sides, counts)
    index = np.arange(len(positions)).reshape(np.array(counts) + 1)
    springs = []
    stiffness = []
    for step in product((-1, 0, 1), repeat=3):
        moved = [axis for axis in range(3) if step[axis]]
        if step <= (0, 0, 0) or len(moved) > 2:
            continue
        if len(moved) == 1:
            full = edge[moved[0]]
        else:
            squares = cell[moved] ** 2
            full = shear * volume * squares.sum() / (2 * squares.prod())
        first = index[tuple(slice(max(0, -s), n + 1 - max(0, s)) for s, n in zip(step, counts, strict=True))]
        second = index[tuple(slice(max(0, s), n + 1 - max(0, -s)) for s, n in zip(step, counts, strict=True))]
        share = np.ones(first.shape)  # for each existing cell around it
        for axis in set(range(3)) - set(moved):
            rim = [slice(None)] * 3
            rim[axis] = [0, -1]  # type: ignore[call-overload]
            share[tuple(rim)] /= 2
        springs.append(np.column_stack([first.ravel(), second.ravel()]))
        stiffness.append((full * share).ravel())
    weights = [_weights(n) for n in counts]
    masses = float(np.prod(sides)) * np.einsum("i,j,k->ijk", *weights).ravel()
    return Network(positions, masses, np.vstack(springs)), np.concatenate(stiffness)


def _weights(cells: int) -> np.ndarray:
    """Return fractions of a rod's mass at its cells' ends, (cells + 1,), exact up to the second moment."""
    weights = np.ones(cells + 1)
    weights[[0, -1]] = 0.5
    moved = cells / (12 * (cells - 1))
    weights[[0, -1]] -= moved
    weights[1] += moved
    weights[-2] += moved
    return weights / cells


def grid(sides: Iterable[float], counts: Iterable[int]) -> np.ndarray:
    """Return the corners of the cells of a box about the origin, (prod(counts + 1), 3)."""
    ticks = [np.linspace(-side / 2, side / 2, n + 1) for side, n in zip(sides, counts, strict=True)]
    return np.stack(np.meshgrid(*ticks, indexing="ij"), axis=-1).reshape(-1, 3)
