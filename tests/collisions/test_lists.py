"""Lists of what may touch: kept while bodies move a little, and never to be seen in what is found."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import pairwise
from typing import Any
from unittest import mock

import numpy as np
import pytest

from springgym.bodies import ball, cube, rope
from springgym.contact import lists
from springgym.contact.records import FAR, ROWS, WATCHED
from springgym.core.blocks import WIDTH, block_array, numbers, set_copies
from springgym.packing import search_workspace
from springgym.scene import Placed, Scene
from springgym.surfaces import Contact
from tests.collisions.stepped import full
from tests.collisions.test_rows import found

pytestmark = pytest.mark.slow

COPIES, REACH = WIDTH[np.dtype(float)], 0.02
CUBE, ROPE, BALL = cube(), rope(5, radius=0.02), ball(0.1, 0.2)
CENTRED = [body.positions - body.positions.mean(axis=0) for body in (CUBE, CUBE, ROPE, BALL)]
PLACES = np.array([[0, 0, 0], [0, 0, 1.02], [0, -0.6, 0.5], [0.62, 0, 0.2]])
SCENE = Scene(
    bodies=tuple(
        Placed(body, centred + place, name=name)
        for body, centred, place, name in zip(
            (CUBE, CUBE, ROPE, BALL), CENTRED, 2 * PLACES, "abcd", strict=True
        )
    ),
    collisions=Contact(strength=1e-2, reach=REACH),
)


class Blocks:
    """A block of copies, what it is searched in, and what was found in it."""

    def __init__(self, scene: Scene = SCENE) -> None:
        collisions = full(scene, copies=COPIES)._terms.collisions
        assert collisions is not None
        self.scene, self.pairs = scene, collisions.pairs
        self.x, self.v = (block_array(COPIES, (len(scene.positions), 3), float) for _ in range(2))
        self.kept = self.empty()

    def empty(self) -> Any:
        return search_workspace(self.scene, self.pairs, self.x.dtype)

    def search(self, x: np.ndarray, v: np.ndarray, workspace: Any) -> list[Any]:
        """All contacts of each copy."""
        for array, values in ((self.x, x), (self.v, v)):
            set_copies(array, np.arange(COPIES), values)
        contacts = workspace[1]
        rows = found(self.x, self.v, self.pairs, *workspace)
        there = numbers(contacts.gap)[:rows] < 0.5 * FAR
        several = {"particle": 4, "weight": 4, "normal": 1, "gap": 1, "share": 1}
        seen = [numbers(contacts.left_out).copy(), contacts.pair[:rows].copy()]
        seen += [contacts.members[:rows].copy(), there]
        for name, each in several.items():
            values = numbers(getattr(contacts, name))[: each * rows]
            values = values.reshape(rows, values.size // max(rows * COPIES, 1), COPIES)
            seen.append(np.where(there[:, None], values, 0.0))
        return seen

    def compare(self, x: np.ndarray, v: np.ndarray) -> tuple[int, bool]:
        """Return how many contacts there are, and whether lists lasted, of which nothing is to be seen."""
        kept, anew = self.search(x, v, self.kept), self.search(x, v, self.empty())
        for one, other in zip(kept, anew, strict=True):
            assert np.array_equal(one, other)
        return int(anew[3].sum()), not np.array_equal(numbers(self.kept[0].origin)[0], numbers(self.x)[0, 0])


def small_turns(random: np.random.Generator, angle: float) -> np.ndarray:
    """Rotations (copies, bodies, 3, 3) by about that angle [rad]."""
    q, r = np.linalg.qr(np.eye(3) + np.cross(np.eye(3), angle * random.standard_normal((COPIES, 4, 1, 3))))
    return np.asarray(q * np.sign(np.einsum("...ii->...i", r))[..., None, :])


def walk(steps: int, stride: float) -> Iterator[tuple[np.ndarray, np.ndarray]]:
    """Positions and velocities (copies, N, 3) of bodies that wander, turn and are bent beside each other."""
    random = np.random.default_rng(1)
    turns = small_turns(random, 0.2)
    turns[::2, :2] = np.eye(3)  # face on face
    places = np.repeat(PLACES[None], COPIES, axis=0)
    for _ in range(steps):
        bodies = [CENTRED[n] @ np.swapaxes(turns[:, n], 1, 2) + places[:, n, None] for n in range(4)]
        x = np.concatenate(bodies, axis=1)
        yield x + 0.2 * stride * random.standard_normal(x.shape), random.standard_normal(x.shape)
        places = places + stride * random.standard_normal(places.shape)
        turns = turns @ small_turns(random, stride)


@pytest.mark.parametrize(("stride", "lasting"), [(1e-4, 0.8), (1e-3, 0.05), (1e-2, 0.0)])
def test_nothing_is_to_be_seen_of_them(stride: float, lasting: float) -> None:
    blocks = Blocks()
    counts, lasted = zip(*(blocks.compare(x, v) for x, v in walk(60, stride)), strict=True)
    assert min(counts) > 1.25 * COPIES
    assert not lasted[0]
    assert lasting <= np.mean(lasted[1:])


def test_pairs_that_come_from_afar() -> None:
    """Of bodies that fly through each other few pairs are watched: any that touches is, wherever it was."""
    random = np.random.default_rng(2)
    kinds = np.arange(16) % 4
    starts = 3.5 * np.stack(np.unravel_index(np.arange(16), (4, 2, 2)), axis=1)
    bodies = tuple(
        Placed(SCENE.bodies[kind].body, CENTRED[kind] + place, name=f"{n}")
        for n, (kind, place) in enumerate(zip(kinds, starts, strict=True))
    )
    blocks = Blocks(Scene(bodies=bodies, collisions=SCENE.collisions))
    pairs, step = 16 * 15 // 2, 1e-3
    speeds = random.normal(0, 5, (COPIES, 16, 3))
    speeds[:, ::2] *= 0.1
    v = blocks.scene.of_particles(np.moveaxis(speeds, 1, 0)).swapaxes(0, 1)
    watched, seen, counts = [], set(), []
    for n in range(0, 900, 3):
        counts.append(blocks.compare(blocks.scene.positions + n * step * v, v)[0])
        kept, contacts = blocks.kept
        watched.append(tuple(kept.watched[: kept.length[WATCHED]].tolist()))
        seen.update(contacts.pair[: contacts.length[ROWS]].tolist())
    assert sum(counts) > 300
    assert len(set(watched)) > 5  # they were listed anew,
    assert np.mean([one == other for one, other in pairwise(watched)]) > 0.5  # not too often,
    assert max(map(len, watched)) < pairs  # and never are all of them;
    assert not seen <= set(watched[0])  # what touched was not watched at first


@pytest.mark.parametrize("few", ["LISTED", "CANDIDATES"])
def test_where_there_is_no_space_for_more(few: str) -> None:
    """Lists of one pair always have space: those of others are made anew then."""
    with mock.patch.object(lists, few, 0):
        blocks = Blocks()
        lasted = [blocks.compare(x, v)[1] for x, v in walk(10, 1e-4)]
    assert any(lasted) == (few == "CANDIDATES")


@pytest.mark.parametrize("lost", [np.nan, np.inf, 1e200])
def test_what_is_no_number_is_forgotten(lost: float) -> None:
    """Lists of a copy that had no positions, be it of one particle, do not last when it has some."""
    blocks = Blocks()
    for particle in (0, slice(None)):
        for x, v in walk(2, 1e-5):
            gone = x.copy()
            gone[3, particle] = lost
            blocks.kept = blocks.empty()
            blocks.search(gone, v, blocks.kept)
            assert not blocks.compare(x, v)[1]
