"""Rows of contacts: as many as the copy of a block that has most, wherever the others touch."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from springgym.bodies import ball, top
from springgym.contact.law import Span
from springgym.contact.search import SPARE, find
from springgym.core.blocks import WIDTH, at, block_array, numbers, set_copies
from springgym.core.compiling import kernel
from springgym.packing import search_workspace
from springgym.scene import Placed, Scene
from springgym.surfaces import Contact
from tests.collisions.stepped import full


@kernel
def found(x: Any, v: Any, pairs: Any, lists: Any, contacts: Any) -> int:
    return find(at(x, 0), at(v, 0), Span(0.0, 5e-4, 1e-3), pairs, lists, contacts)


COPIES, RADIUS, REACH = WIDTH[np.dtype(float)], 0.06, 5e-3
PLATE = top(12, 0.5, 0.25, 1.0, 1.6e4)
CROWN = PLATE.positions[PLATE.particle("crown")]


def contacts(places: np.ndarray) -> tuple[int, Any]:
    """The rows of contacts of copies (COPIES, 3) of where a ball is above a plate."""
    bodies = (Placed(PLATE, name="plate"), Placed(ball(RADIUS, 0.2), CROWN[None] + [0, 0, 1.0], name="ball"))
    scene = Scene(bodies=bodies, collisions=Contact(strength=1.25e-3, reach=REACH))
    collisions = full(scene, copies=COPIES, step=1e-3)._terms.collisions
    assert collisions is not None
    x, v = (block_array(COPIES, (len(scene.positions), 3), float) for _ in range(2))
    positions = np.repeat(scene.positions[None], COPIES, axis=0)
    positions[:, -1] = places
    set_copies(x, np.arange(COPIES), positions)
    lists, found_contacts = search_workspace(scene, collisions.pairs, x.dtype)
    return found(x, v, collisions.pairs, lists, found_contacts), found_contacts


@pytest.mark.slow
def test_a_row_for_all_who_touch_elsewhere() -> None:
    """Balls on different triangles of a plate share a row; each copy's is that of its own triangle."""
    angles = 2 * np.pi * np.arange(COPIES) / COPIES + 0.1
    places = CROWN + 0.25 * np.stack([np.cos(angles), np.sin(angles), 0 * angles], axis=1)
    places[:, 2] += RADIUS + 2e-3
    places[3, 2] += 0.1  # one is aloft
    rows, listed_contacts = contacts(places)
    assert rows == 1
    shares, particles = numbers(listed_contacts.share)[0], numbers(listed_contacts.particle)[:4]
    assert (shares > 0).tolist() == [n != 3 for n in range(COPIES)]
    assert len({tuple(sorted(corners)) for corners in particles[1:, shares > 0].T}) >= 5 * COPIES // 8
    np.testing.assert_allclose(numbers(listed_contacts.gap)[0][shares > 0], 2e-3, rtol=1e-9)


def test_a_ball_that_comes_to_an_edge_is_outside() -> None:
    """As far as contacts are looked for, the plate's upper side is found at least as soon as its lower one.

    The ball is behind that, and would be as deep inside as it is far outside were it found alone.
    """
    middle = 0.5 * (PLATE.positions[PLATE.triangles[0]].sum(axis=0) - CROWN)  # of an edge of the rim
    farthest = SPARE * REACH + RADIUS
    heights = farthest * (1 + np.linspace(-3e-6, 3e-6, COPIES))
    places = middle + 1e-6 * (CROWN - middle) + np.stack([0 * heights, 0 * heights, heights], axis=1)
    rows, listed_contacts = contacts(places)
    assert rows == 1
    listed = numbers(listed_contacts.share)[0] > 0
    assert listed[: COPIES // 2].all()
    assert not listed[-1]
    np.testing.assert_allclose(numbers(listed_contacts.gap)[0][listed], heights[listed] - RADIUS, rtol=1e-6)
