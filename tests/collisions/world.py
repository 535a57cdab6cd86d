"""A step for scenes of colliding bodies that leaves out a part of the method, in as few lines as it takes.

Drift h/2, all impulses, drift h/2: for tests that fail without that part. With none left out it is the
`springgym.simulator.Simulator`'s, but for dampers."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from springgym.contact.friction import rub
from springgym.contact.law import Span
from springgym.contact.records import ENTRIES, GAP, Collisions, Pairs, Problem
from springgym.contact.search import find
from springgym.contact.solver import add_totals, prepare, sweep, taper
from springgym.contact.totals import list_changing
from springgym.core.blocks import aligned_zeros, at, block_array, numbers
from springgym.core.compiling import compiled, kernel
from springgym.core.lanes import block_dtype, load, minimum, sqrt
from springgym.core.vectors import TINY, dot, plus_scaled, row, row_each, set_row, set_row_each
from springgym.forces import accelerate, drift, kick, relax
from springgym.forces.springs import decay
from springgym.packing import Options, pack_pairs, search_workspace
from springgym.scene import Scene
from springgym.stability import automatic_step
from springgym.terms import Dampers, Decay, Particles, Springs, Terms

NOTHING, BLIND, UNTAPERED, SINGLE, PLAIN = range(5)
"""What is left out on purpose: nothing, the history of signs, the force of the share's gradient, the second
sweep, the turn of friction."""


@compiled
def rub_plainly(v: Any, friction: Any, problem: Any) -> None:
    """Friction as of points: opposite impulses that stop the slip of the two, however far they are apart."""
    if friction is not None:
        contacts = problem.contacts
        for k in range(problem.rows):
            n = row(contacts.normal, k)
            slip = 0.0 * n
            for j in range(contacts.members[k]):
                own = row_each(v, load(contacts.particle, 4 * k + j))
                slip = plus_scaled(slip, load(contacts.weight, 4 * k + j), own)
            slip = slip - dot(slip, n) * n
            limit = load(friction, contacts.pair[k]) * load(contacts.impulse, k)
            share = minimum(
                limit / sqrt(dot(slip, slip) + TINY), 1.0 / (load(contacts.inverse_mass, k) + TINY)
            )
            for j in range(contacts.members[k]):
                i = load(contacts.particle, 4 * k + j)
                size = share * load(contacts.gain, 4 * k + j)
                set_row_each(v, i, plus_scaled(row_each(v, i), -1.0 * size, slip))


@compiled
def one_step(
    x: Any,
    v: Any,
    w: Any,
    a: Any,
    direction: Any,
    h: Any,
    terms: Any,
    collisions: Any,
    lists: Any,
    contacts: Any,
    touched: Any,
    lacks: Any,
) -> None:
    drift(x, v, 0.5 * h)
    for i in range(x.shape[0]):
        set_row(w, i, row(v, i))
    accelerate(x, a, direction, terms)
    relax(v, direction, False, False, None, terms)
    kick(v, a, h)
    relax(v, direction, True, False, None, terms)
    span = Span(0.5 * h, 0.5 * h, h)
    inverse_mass, pairs = terms.particles.inverse_mass, collisions.pairs
    seen = Span(0.0, 0.5 * h, h) if lacks == BLIND else span
    rows = find(x, w, seen, pairs, lists, contacts, None, False)
    problem = Problem(span, rows, x, w, inverse_mass, pairs, contacts, collisions.totals)
    prepare(problem, touched)
    for turn in range(1 if lacks == SINGLE else pairs.sweeps):
        sweep(v, turn % 2 == 1, problem)
    if lacks != UNTAPERED:
        taper(v, problem, pairs.shapes.edges)
    if lacks == PLAIN:
        rub_plainly(v, pairs.friction, problem)
    else:
        for turn in range(pairs.sweeps + 1):
            rub(v, turn, problem, pairs.friction)
    list_changing(contacts, collisions.changing)
    add_totals(v, problem, collisions.changing)
    drift(x, v, 0.5 * h)


@kernel
def advance(
    x: Any,
    v: Any,
    w: Any,
    a: Any,
    direction: Any,
    h: Any,
    steps: Any,
    terms: Any,
    collisions: Any,
    lists: Any,
    contacts: Any,
    touched: Any,
    lacks: Any,
) -> None:
    for block in range(x.shape[0]):
        for _ in range(steps):
            own = Collisions(
                at(collisions.pairs, block),
                at(collisions.totals, block),
                at(collisions.totals_before, block),
                at(collisions.changing, block),
            )
            one_step(
                at(x, block), at(v, block), w, a, direction, h, terms, own, lists, contacts, touched, lacks
            )


class World:
    """Copies of a scene without surfaces or actuators, whose bodies collide.

    Unless it is to be ``lean``, it has all kinds of terms, be they zero or empty: all worlds share code.
    """

    def __init__(
        self,
        scene: Scene,
        *,
        step: float | None = None,
        copies: int = 1,
        dtype: Any = float,
        lean: bool = False,
    ) -> None:
        self.scene, self.copies = scene, copies
        self.step = automatic_step(scene, _verlet()) if step is None else step
        count = len(scene.positions)
        self._x, self._v = (block_array(copies, (count, 3), dtype) for _ in range(2))
        self._w, self._a = (block_array(copies, (count, 3), dtype)[0] for _ in range(2))
        self._touched = block_array(copies, (count,), dtype)[0]
        self.place(scene.positions, scene.velocities)
        first, second = scene.springs.T.astype(np.uint32)
        self._direction = block_array(copies, (len(first), 3), dtype)[0]
        inverse, damping = scene.free / scene.masses, scene.of_bodies("damping")
        half = Decay(*decay(damping, inverse[first], inverse[second], self.step / 2))
        self.terms = Terms(
            Particles(scene.masses, inverse, np.array(scene.free)),
            Springs(
                np.ascontiguousarray(first),
                np.ascontiguousarray(second),
                scene.of_bodies("lengths"),
                scene.of_bodies("stiffness"),
            ),
            Dampers(damping, half, half, True) if damping.any() or not lean else None,
            gravity=None if scene.gravity is None and lean else np.array(scene.gravity or (0, 0, 0), float),
        )

        def blocks(*shape: int) -> np.ndarray:
            return block_array(copies, shape, dtype)

        self.pairs = pack_pairs(scene, Options(_verlet(), self.step, 1, frozenset(), blocks))
        if not lean:
            self.pairs = with_all_features(self.pairs, blocks)
        self._found = search_workspace(scene, self.pairs, self._x.dtype)
        totals = block_array(copies, (len(self.pairs.first) * ENTRIES,), dtype)
        numbers(totals)[:, GAP::ENTRIES] = np.inf
        changing = aligned_zeros((len(totals), 1 + len(self.pairs.first)), block_dtype(np.int64, 1))
        self._collisions = Collisions(self.pairs, totals, totals.copy(), changing)

    def place(self, positions: np.ndarray, velocities: np.ndarray) -> None:
        """Positions and velocities (N, 3) of all copies, or (copies, N, 3)."""
        for array, given in ((self._x, positions), (self._v, velocities)):
            lanes = numbers(array)
            rows = np.broadcast_to(given, (self.copies, *given.shape[-2:]))
            for n in range(lanes.shape[0] * lanes.shape[-1]):  # the padding is of the last copy
                lanes[n // lanes.shape[-1], ..., n % lanes.shape[-1]] = rows[min(n, self.copies - 1)]

    def run(self, steps: int, lacks: int) -> None:
        advance(
            self._x,
            self._v,
            self._w,
            self._a,
            self._direction,
            self.step,
            steps,
            self.terms,
            self._collisions,
            *self._found,
            self._touched,
            lacks,
        )

    def _rows(self, array: np.ndarray) -> np.ndarray:
        lanes = np.moveaxis(numbers(array), -1, 1)
        return np.array(lanes.reshape(-1, *lanes.shape[2:])[: self.copies], float)

    @property
    def x(self) -> np.ndarray:
        """(copies, N, 3)"""
        return self._rows(self._x)

    @property
    def v(self) -> np.ndarray:
        return self._rows(self._v)

    @property
    def totals(self) -> np.ndarray:
        """(copies, pairs, ENTRIES)"""
        return self._rows(self._collisions.totals).reshape(self.copies, -1, ENTRIES)

    def momenta(self) -> np.ndarray:
        """Momentum and angular momentum about the origin, (copies, 6)."""
        m = self.scene.masses[:, None]
        return np.concatenate([(m * self.v).sum(1), (m * np.cross(self.x, self.v)).sum(1)], axis=1)

    def energy(self, shadow: bool = True) -> np.ndarray:
        """Of motion, gravity and springs (copies,), far from contact.

        The ``shadow`` is what this step keeps of it: less h²/8 v·K v.
        """
        m, (i, j) = self.scene.masses, self.scene.springs.T
        total = 0.5 * (m * (self.v**2).sum(-1)).sum(-1)
        if self.scene.gravity is not None:
            total -= (m * (self.x @ np.array(self.scene.gravity))).sum(-1)
        along = self.x[:, j] - self.x[:, i]
        lengths = np.linalg.norm(along, axis=-1)
        stretch = lengths - self.scene.of_bodies("lengths")
        rate = ((self.v[:, j] - self.v[:, i]) * along).sum(-1) / np.maximum(lengths, 1e-300)
        k = self.scene.of_bodies("stiffness")
        return total + (0.5 * k * (stretch**2 - (self.step**2 / 4 * rate**2 if shadow else 0.0))).sum(-1)


def with_all_features(pairs: Pairs, blocks: Callable[..., np.ndarray]) -> Pairs:
    """Pairs without None, and with friction and loss of each copy in ``blocks``."""
    shapes, count, bodies = pairs.shapes, len(pairs.first), len(pairs.shapes.radius)
    none = np.zeros(bodies, bool)

    def of_copies(values: np.ndarray | None) -> np.ndarray:
        if values is not None and values.dtype.names:
            return values
        array = blocks(count)
        numbers(array)[:] = np.zeros((count, 1)) if values is None else values[:, None]
        return array

    return pairs._replace(
        friction=of_copies(pairs.friction),
        loss=of_copies(pairs.loss),
        shapes=shapes._replace(
            triangles=np.zeros((0, 3), np.uint32) if shapes.triangles is None else shapes.triangles,
            edges=np.zeros((0, 2), np.uint32) if shapes.edges is None else shapes.edges,
            rods=none if shapes.rods is None else shapes.rods,
            balls=none if shapes.balls is None else shapes.balls,
        ),
    )


def _verlet() -> Any:
    from springgym.integrators.verlet import RECORD

    return RECORD
