"""Distances of ellipsoids agree with known ones, and with what SciPy's minimum says of others."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from scipy.optimize import minimize

from springgym.bodies.round import EDGE
from springgym.core.ellipsoids import ELLIPSOID, POINT, SEGMENT, TRIANGLE, gaps

COUNT = 400
SHAPES = {
    "any": (0.3, 0.7, 1.0),
    "ball": (1.0, 1.0, 1.0),
    "coin": (EDGE, 1.0, 1.0),
    "needle": (EDGE, EDGE, 1.0),
    "blade": (EDGE, 0.1, 1.0),
}


def drawn(rng: np.random.Generator, semi: Any) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return ellipsoids (n, 5, 3), unit vectors (n, 3), and where each is farthest along its own (n, 3)."""
    axes = np.linalg.qr(rng.normal(size=(COUNT, 3, 3)))[0]
    lengths = rng.permuted(np.tile(semi, (COUNT, 1)), axis=1)
    centre = 0.1 * rng.normal(size=(COUNT, 1, 3))
    n = rng.normal(size=(COUNT, 3))
    n /= np.linalg.norm(n, axis=1, keepdims=True)
    return (
        np.concatenate([centre, axes, lengths[:, None]], axis=1),
        n,
        support(centre[:, 0], axes, lengths, n),
    )


def support(centre: np.ndarray, axes: np.ndarray, semi: np.ndarray, n: np.ndarray) -> np.ndarray:
    """Return the points (n, 3) of ellipsoids that are farthest along n (n, 3)."""
    along = semi * np.einsum("kij,kj->ki", axes, n)
    along /= np.linalg.norm(along, axis=1, keepdims=True)
    return centre + np.einsum("kij,ki->kj", axes, semi * along)


def across(rng: np.random.Generator, n: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return unit vectors across n and across each other."""
    u = np.cross(n, rng.normal(size=n.shape))
    u /= np.linalg.norm(u, axis=1, keepdims=True)
    return u, np.cross(n, u)


def check(
    kind: int, ellipsoids: np.ndarray, others: np.ndarray, n: np.ndarray, gap: np.ndarray
) -> np.ndarray:
    """Compare normals and distances with what they are; return what else is told."""
    normal, told = gaps(kind, ellipsoids, others)
    np.testing.assert_allclose(told[:, 0], gap, rtol=0, atol=1e-13)
    np.testing.assert_allclose(normal, n, rtol=0, atol=3e-8)
    return told[:, 1:]


@pytest.mark.parametrize("shape", SHAPES)
def test_known_distances(shape: str) -> None:
    """Place others at a distance from the point that is farthest along n, on their own side of its plane."""
    rng = np.random.default_rng(1)
    of, n, place = drawn(rng, SHAPES[shape])
    gap = 10 ** rng.uniform(-6, -1, COUNT)
    q = place + gap[:, None] * n
    u, w = across(rng, n)
    check(POINT, of, q[:, None], n, gap)
    share, length = rng.uniform(0.1, 0.9, COUNT), rng.uniform(0.1, 3.0, COUNT)
    start = q - (share * length)[:, None] * u
    told = check(SEGMENT, of, np.stack([start, start + length[:, None] * u], axis=1), n, gap)
    np.testing.assert_allclose(told[:, 0], share, atol=1e-9)
    away = u + rng.uniform(0.0, 2.0, COUNT)[:, None] * n  # with its end nearest
    assert not check(SEGMENT, of, np.stack([q, q + away], axis=1), n, gap)[:, 0].any()
    corner = q - 0.3 * u - 0.2 * w
    told = check(TRIANGLE, of, np.stack([corner, corner + w, corner + u], axis=1), n, gap)
    np.testing.assert_allclose(told, np.tile([0.2, 0.3], (COUNT, 1)), atol=1e-12)
    slant = w + rng.uniform(0.05, 1.0, COUNT)[:, None] * n
    sides = [q - 0.4 * u, q - 0.1 * u + slant, q + 0.6 * u], [q, q + slant, q + u + 0.01 * n]
    for corners in sides:
        faces = np.stack(corners, axis=1)
        normals = np.cross(faces[:, 1] - faces[:, 0], faces[:, 2] - faces[:, 0])
        turn = (normals * (of[:, 0] - faces[:, 0])).sum(axis=1) < 0
        faces[turn] = faces[turn][:, [0, 2, 1]]
        check(TRIANGLE, of, faces, n, gap)
    for other in SHAPES:
        met, _, _ = drawn(rng, rng.uniform(0.1, 5.0) * np.array(SHAPES[other]))
        nearest = support(np.zeros((COUNT, 3)), met[:, 1:4], met[:, 4], -n)
        met[:, 0] = q - nearest
        check(ELLIPSOID, of, met, n, gap)


def test_overlaps_are_negative() -> None:
    rng = np.random.default_rng(2)
    of, n, place = drawn(rng, SHAPES["any"])
    depth = rng.uniform(1e-4, 0.02, COUNT)
    q = place - depth[:, None] * n
    u, w = across(rng, n)
    check(POINT, of, q[:, None], n, -depth)
    check(SEGMENT, of, np.stack([q - u, q + u], axis=1), n, -depth)
    check(TRIANGLE, of, np.stack([q - u - w, q + 2 * w, q + 2 * u], axis=1), n, -depth)
    met, _, _ = drawn(rng, SHAPES["any"])
    met[:, 0] = q - support(np.zeros((COUNT, 3)), met[:, 1:4], met[:, 4], -n)
    check(ELLIPSOID, of, met, n, -depth)
    through = np.stack([of[:, 0] - 3 * n, of[:, 0] + 3 * n], axis=1)
    assert (gaps(SEGMENT, of, through)[1][:, 0] < 0).all()
    cut = np.stack(
        [of[:, 0] + 0.01 * n - 9 * u - 9 * w, of[:, 0] + 0.01 * n + 18 * w, of[:, 0] + 18 * u], axis=1
    )
    assert (gaps(TRIANGLE, of, cut)[1][:, 0] < 0).all()


@pytest.mark.parametrize("other", ["coin", "needle"])
def test_distances_of_places_at_random(other: str) -> None:
    """Gaps are the least distances of two points that SciPy finds, from several starts."""
    rng = np.random.default_rng(3)
    first, _, _ = drawn(rng, SHAPES["any"])
    second, _, _ = drawn(rng, SHAPES[other])
    second[:, 0] += 2.0 * rng.normal(size=(COUNT, 3))
    _, told = gaps(ELLIPSOID, first, second)
    apart = np.flatnonzero(told[:, 0] > 0.05)[:20]
    assert len(apart) == 20

    def points(of: np.ndarray, ball: np.ndarray) -> np.ndarray:
        return np.asarray(of[0] + (of[4] * ball) @ of[1:4])

    for k in apart:
        one, met = first[k], second[k]

        def square(balls: np.ndarray, one: np.ndarray = one, met: np.ndarray = met) -> float:
            return float(((points(one, balls[:3]) - points(met, balls[3:])) ** 2).sum())

        inside = [
            {"type": "ineq", "fun": lambda balls, s=s: 1 - balls[s] @ balls[s]}
            for s in (slice(3), slice(3, 6))
        ]
        found = min(
            minimize(square, rng.normal(size=6) / 3, constraints=inside, method="SLSQP", tol=1e-14).fun
            for _ in range(4)
        )
        assert told[k, 0] == pytest.approx(np.sqrt(found), rel=1e-5)


def test_needles_that_pass_each_other_are_apart() -> None:
    """Two needles side by side, whose middles are far apart: a separation by the middles alone is none."""
    axes = np.array([[1.0, 0, 0], [0, 1, 0], [0, 0, 1]])
    one = np.concatenate([[[0, 0, 0]], axes, [[1.0, 0.01, 0.01]]])
    for shift in (0.0, 0.5, 1.5):
        met = np.concatenate([[[shift, 0.03, 0.0]], axes, [[1.0, 0.01, 0.01]]])
        gap = gaps(ELLIPSOID, one[None], met[None])[1][0, 0]
        half = np.linalg.norm([shift / 2, 0.015]) if shift == 0 else None
        apart = 2 * gaps(POINT, one[None], (met[:1] / 2)[None])[1][0, 0]  # by symmetry, at most
        assert 0 < gap <= apart + 1e-15
        if half is not None:
            assert gap == pytest.approx(0.01, abs=1e-12)
