"""Random impacts of two bodies: any orientation, spins, and lines that pass at any distance."""

from __future__ import annotations

import numpy as np

from springgym.model.bodies import Body
from springgym.model.scene import Placed, Scene
from springgym.model.surfaces import Contact


def rotations(rng: np.random.Generator, count: int) -> np.ndarray:
    """Uniform rotations (count, 3, 3)."""
    q, r = np.linalg.qr(rng.normal(size=(count, 3, 3)))
    q = q * np.sign(np.einsum("nii->ni", r))[:, None, :]
    return q * np.linalg.det(q)[:, None, None]


def pair_scene(first: Body, second: Body, contact: Contact | None = None) -> Scene:
    """Two bodies without gravity, far apart."""
    away = second.positions + np.array([2 * (first.size + second.size), 0.0, 0.0])
    return Scene(
        bodies=(Placed(first, name="first"), Placed(second, positions=away, name="second")),
        gravity=None,
        collisions=Contact() if contact is None else contact,
    )


def impacts(
    first: Body, second: Body, speed: float, copies: int, rng: np.random.Generator
) -> tuple[np.ndarray, np.ndarray]:
    """Positions and velocities (copies, N, 3) of bodies on their way to each other at a relative speed."""
    radii = [
        max(np.linalg.norm(body.positions - body.centre, axis=1).max(), body.swept / 2)
        for body in (first, second)
    ]
    way, side = (rng.normal(size=(copies, 3)) for _ in range(2))
    way /= np.linalg.norm(way, axis=1)[:, None]
    side -= (side * way).sum(1)[:, None] * way
    side /= np.linalg.norm(side, axis=1)[:, None]
    apart = 1.03 * sum(radii) * way
    offset = 0.5 * max(radii) * rng.random((copies, 1)) * side
    x = []
    v = []
    for n, body in enumerate((first, second)):
        turned = np.einsum("nij,kj->nki", rotations(rng, copies), body.positions - body.centre)
        spin = speed / max(radii) * rng.uniform(-1, 1, size=(copies, 3))
        half = 0.5 if n else -0.5
        x.append(turned + (half * apart + n * offset)[:, None])
        v.append(np.cross(spin[:, None], turned) - (half * speed * way)[:, None])
    return np.concatenate(x, axis=1), np.concatenate(v, axis=1)
