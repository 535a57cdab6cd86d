"""Fast throws of two bodies, and whether bodies are in each other, decided by geometry alone."""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np

from benchmarks.hard_cases import kept_by_nodes
from springgym.model.bodies import Body, box, cube
from springgym.model.scene import Placed, Scene
from springgym.model.surfaces import Contact
from springgym.simulator import STRAIN_LIMIT, Simulator
from tests.collisions.impacts import rotations

PLATE = box((1.0, 1.0, 0.01), 4.0, 1e5, 0.0)
NEEDLE = box((0.01, 0.01, 0.6), 0.5, 1e5, 0.0)
CUBE = cube(0.3, 1.0, 1e5, 0.0)

THIN = 0.0024
"""Reach [m] of what meets a plate."""


class Throw(NamedTuple):
    """Two bodies, the first thrown at the second."""

    first: Body
    second: Body
    speed: float
    """[m/s]"""


THROWS = {
    "cube on plate, 10 m/s": Throw(CUBE, PLATE, 10.0),
    "cubes, 30 m/s": Throw(CUBE, CUBE, 30.0),
    "cube on plate, 100 m/s": Throw(CUBE, PLATE, 100.0),
    "needle on plate, 100 m/s": Throw(NEEDLE, PLATE, 100.0),
}


class Seen(NamedTuple):
    """What became of throws, each (copies,)."""

    shown: np.ndarray
    """whether bodies were in each other at any reading"""
    left: np.ndarray
    """at the last one"""
    untold: np.ndarray
    """at any, before it was told"""
    told: np.ndarray
    """whether it was told that a step could not resolve something, or that a copy diverged"""
    gained: np.ndarray
    """the most energy at any reading until it was told, as a share of that at the start"""


def thrown(throw: Throw, copies: int, seed: int = 0) -> tuple[Scene, np.ndarray, np.ndarray]:
    """Return a scene, and positions and velocities (copies, N, 3) of the first body on its way to the second.

    It is turned at random, spins, flies aslant and aims off the middle. A plate is hit from above.
    """
    first, second, speed = throw
    rng = np.random.default_rng(seed)
    flat = second is PLATE
    away = second.positions + np.array([3.0, 0.0, 0.0])
    scene = Scene(
        bodies=(Placed(first, name="first"), Placed(second, positions=away, name="second")),
        gravity=None,
        collisions=Contact(reach=THIN if flat else None),
    )
    way = rng.normal(size=(copies, 3))
    if flat:
        way[:, 2] = np.abs(way[:, 2]) + 0.5 * np.linalg.norm(way, axis=1)
    way /= np.linalg.norm(way, axis=1)[:, None]
    arms = [
        np.einsum("nij,kj->nki", turns, body.positions - body.centre)
        for body, turns in (
            (first, rotations(rng, copies)),
            (second, np.broadcast_to(np.eye(3), (copies, 3, 3)) if flat else rotations(rng, copies)),
        )
    ]
    radii = [float(np.linalg.norm(arm[0], axis=-1).max()) for arm in arms]
    far = (0.05 + radii[0]) / way[:, 2:] if flat else 0.05 + sum(radii)
    aim = 0.3 * rng.uniform(-1, 1, size=(copies, 3)) * np.ptp(second.positions, axis=0)
    spin = 0.2 * speed / radii[0] * rng.uniform(-1, 1, size=(copies, 1, 3))
    x = np.concatenate([arms[0] + (aim + far * way)[:, None], arms[1]], axis=1)
    v = np.concatenate([np.cross(spin, arms[0]) - speed * way[:, None], np.zeros_like(arms[1])], axis=1)
    return scene, x, v


def watched(throw: Throw, copies: int = 64, **options: Any) -> Seen:
    """Simulate throws until all is over, and look at every step whether the bodies are in each other."""
    scene, x, v = thrown(throw, copies)
    simulator = Simulator(scene, copies=copies, unresolved="count", **options)
    simulator.place(x, v)
    assert not in_each_other(scene, x).any()
    springs = simulator.dynamics == "springs"
    start = kept_by_nodes(simulator) if springs else simulator.measure().energy
    shown, untold, told = np.zeros((3, copies), bool)
    gained = np.zeros(copies)
    for _ in range(math.ceil(1.5 / throw.speed / simulator.step)):
        simulator.advance(1, check=False, read=True)
        m = simulator.measure()
        now = in_each_other(scene, simulator.positions)
        told |= simulator.unresolved | ~(m.strain <= STRAIN_LIMIT)
        shown |= now
        untold |= now & ~told
        energy = kept_by_nodes(simulator) if springs else m.energy
        gained = np.where(told, gained, np.maximum(gained, energy / start - 1))
    return Seen(shown, now, untold, told, gained)


def in_each_other(scene: Scene, x: np.ndarray) -> np.ndarray:
    """Whether (copies,) the two bodies intersect at positions (copies, N, 3).

    Two closed surfaces do if an edge of one goes through a face of the other, or a corner is inside: by the
    signs of volumes of tetrahedra (Möller and Trumbore, J. Graphics Tools 2 (1997) 21), and by parity of the
    faces above a corner.
    """
    found = np.zeros(len(x), bool)
    bodies = [placed.body for placed in scene.bodies]
    places = [x[:, own] for own in scene.slices]
    for own, other in ((0, 1), (1, 0)):
        faces = places[other][:, bodies[other].triangles]
        lines = places[own][:, _lines(bodies[own].triangles)]
        found |= _crossed(lines, faces).any(axis=1)
        corner = places[own][:, bodies[own].triangles[0, :1]]
        ray = np.stack([corner, corner + np.array([3.1, 4.7, 50.3])], axis=2)
        found |= _crossed(ray, faces)[:, 0] % 2 == 1
    return found


def _lines(triangles: np.ndarray) -> np.ndarray:
    sides = np.concatenate([triangles[:, [0, 1]], triangles[:, [1, 2]], triangles[:, [2, 0]]])
    return np.unique(np.sort(sides, axis=1), axis=0)


def _crossed(lines: np.ndarray, faces: np.ndarray) -> np.ndarray:
    """How many faces (k, T, 3, 3) each of the lines (k, S, 2, 3) goes through, (k, S)."""
    start = lines[:, :, None, 0]
    way = (lines[:, :, 1] - lines[:, :, 0])[:, :, None]
    a = faces[:, None, :, 0]
    u = faces[:, None, :, 1] - a
    w = faces[:, None, :, 2] - a
    p = np.cross(way, w)
    volume = (u * p).sum(-1)
    skew = np.abs(volume) > 1e-300
    inverse = 1.0 / np.where(skew, volume, 1.0)
    r = start - a
    s = (r * p).sum(-1) * inverse
    q = np.cross(r, u)
    t = (way * q).sum(-1) * inverse
    along = (w * q).sum(-1) * inverse
    through = skew & (s > 0) & (t > 0) & (s + t < 1) & (along > 0) & (along < 1)
    return np.asarray(through.sum(axis=2))
