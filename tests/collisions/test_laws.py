"""The barrier along a normal: the root, its energy, and its symmetry in time."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from springgym.core.compiler.decorators import kernel
from springgym.core.language.blocks import aligned_zeros, block_dtype
from springgym.core.language.lanes import minimum
from springgym.core.language.memory import load, store
from springgym.dynamics.contact.law import SLOW, solve_gap
from springgym.dynamics.records import Times

COUNT = 4096
REACH = 0.0173
STEP = 5.5e-4
SPAN = Times(STEP / 2, STEP / 2, STEP)


@kernel
def met(gaps: Any, span: Any, c: Any, reach: Any, beta: Any, change: Any, lossy: Any) -> None:
    start, free, guesses = gaps
    for n in range(start.size):
        first = load(start, n)
        ahead = load(free, n)
        guess = load(guesses, n)
        strength = load(c, n)
        on = minimum(first, ahead) < reach
        found, _ = solve_gap((first, ahead, guess), span, strength, reach, 0.0 * first, on)
        store(change, (n, 0), found)
        found, elastic = solve_gap((first, ahead, guess), span, strength, reach, load(beta, n), on)
        store(lossy, (n, 0), found)
        store(lossy, (n, 1), elastic)


def laws(
    start: np.ndarray, free: np.ndarray, c: np.ndarray, beta: np.ndarray, guess: np.ndarray | float = 0.0
) -> tuple[np.ndarray, ...]:
    """Changes of speed without and with loss, and the latter's push before its loss, each (COUNT,)."""

    def lanes(values: Any, *shape: int) -> np.ndarray:
        array = aligned_zeros((COUNT, *shape), block_dtype(float, 1))
        array["lanes"][..., 0] = values
        return array

    change = lanes(0.0, 3)
    lossy = lanes(0.0, 3)
    met((lanes(start), lanes(free), lanes(guess)), SPAN, lanes(c), REACH, lanes(beta), change, lossy)
    return change["lanes"][:, 0, 0], lossy["lanes"][:, 0, 0], lossy["lanes"][:, 1, 0]


def barrier(h: np.ndarray, c: np.ndarray) -> np.ndarray:
    return np.asarray(np.where(h < REACH, c * (REACH - h) ** 2 / (h * REACH**2), 0.0))


def kept(rate: np.ndarray, beta: np.ndarray) -> np.ndarray:
    return np.asarray(1 - beta * rate / np.sqrt(rate**2 + SLOW**2))


def random_impacts(seed: int) -> tuple[np.ndarray, ...]:
    """Heights at the start and as they would be at the end, strengths, losses; of all kinds of steps."""
    rng = np.random.default_rng(seed)
    start = REACH * rng.uniform(0.05, 1.5, COUNT)
    free = start + 0.4 * REACH * rng.normal(size=COUNT)
    free = np.where((start >= REACH) & (free >= REACH), REACH * rng.uniform(-0.5, 1, COUNT), free)
    return start, free, 10 ** rng.uniform(-1, 1.5, COUNT), rng.uniform(0, 1, COUNT)


@pytest.mark.parametrize("spread", [0.0, 1e-6, 1.0])
def test_the_root(spread: float) -> None:
    """The change is that of the discrete gradient between both heights, with loss, too, from any guess."""
    start, free, c, beta = random_impacts(0)
    guess = spread * REACH * np.random.default_rng(3).uniform(0, 1.2, COUNT)
    change, lossy, elastic = laws(start, free, c, beta, guess)
    for found, d in ((change, 0.0 * beta), (lossy, beta)):
        end = free + SPAN.out * found
        assert (end > 0).all()
        way = end - start
        inside = (start < REACH) & (end < REACH)
        far = np.abs(way) > 1e-4 * REACH
        gradient = np.where(far, (barrier(start, c) - barrier(end, c)) / np.where(far, way, 1.0), 0.0)
        gradient = np.where(inside, c / (start * end) - c / REACH**2, gradient)
        wanted = SPAN.whole * gradient * kept(way / SPAN.whole, d)
        sure = far | inside
        assert sure.mean() > 0.99
        # of the heights, whose equation is this steep
        steep = 1 + SPAN.out * gradient * d / SLOW
        steep += SPAN.out * SPAN.whole * c / (start * end**2) * (1 + d)
        assert np.abs(SPAN.out * (found - wanted) / steep)[sure].max() < 1e-10 * REACH
    keep = kept(way / SPAN.whole, beta)  # of the lossy one
    assert (keep >= 0).all()
    assert (elastic >= 0).all()
    assert lossy == pytest.approx(elastic * keep, rel=1e-6, abs=1e-9)


def test_energy_is_kept() -> None:
    """Per mass, the work of the impulse is what the barrier gives, in each step."""
    start, free, c, beta = random_impacts(1)
    change, _, _ = laws(start, free, c, beta)
    end = free + 0.5 * STEP * change
    work = change * (end - start) / STEP
    given = barrier(start, c) - barrier(end, c)
    assert np.abs(work - given).max() < 1e-10 * np.abs(given).max()
    assert (np.abs(change) > 1e-3).mean() > 0.5


def test_symmetric_in_time() -> None:
    """What ends a step leads back to its start, whichever of both is out of reach."""
    start, free, c, beta = random_impacts(2)
    change, _, _ = laws(start, free, c, beta)
    end = free + 0.5 * STEP * change
    back, _, _ = laws(end, start - 0.5 * STEP * change, c, beta)
    assert ((start < REACH) & (end > REACH)).any()
    assert ((start > REACH) & (end < REACH)).any()
    assert np.abs(back - change).max() < 1e-8 * np.abs(change).max()
