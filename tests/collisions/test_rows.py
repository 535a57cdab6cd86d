"""Rows of contacts: as many as the copy of a block that has most, wherever the others touch."""

from __future__ import annotations

from typing import Any

import numpy as np

from springgym.blocks import at, block_array, numbers, set_all
from springgym.bodies import ball, top
from springgym.compiling import kernel
from springgym.forces.pairs.search import find
from springgym.forces.pairs.terms import Span
from springgym.packing import pack_room
from springgym.scene import Placed, Scene
from springgym.simulator import Simulator
from springgym.surfaces import Contact


@kernel
def found(x: Any, v: Any, pairs: Any, room: Any) -> int:
    return find(at(x, 0), at(v, 0), Span(0.0, 5e-4, 1e-3), pairs, room, None)


def test_a_row_for_all_who_touch_elsewhere() -> None:
    """Balls on different triangles of a plate share a row; each copy's is that of its own triangle."""
    plate, copies = top(12, 0.5, 0.25, 1.0, 1.6e4), 16
    contact = Contact(strength=1.25e-3, reach=5e-3)
    crown = plate.positions[plate.particle("crown")]
    bodies = (Placed(plate, name="plate"), Placed(ball(0.06, 0.2), crown[None] + [0, 0, 1.0], name="ball"))
    scene = Scene(bodies=bodies, collisions=contact)
    meets = Simulator(scene, copies=copies, step=1e-3)._terms.meets
    assert meets is not None
    places = np.repeat(scene.positions[None], copies, axis=0)
    angles = 2 * np.pi * np.arange(copies) / copies + 0.1
    places[:, -1] = crown + 0.25 * np.stack([np.cos(angles), np.sin(angles), 0 * angles], axis=1)
    places[:, -1, 2] += 0.06 + 2e-3
    places[3, -1, 2] += 0.1  # one is aloft
    x, v = (block_array(copies, (len(scene.positions), 3), float) for _ in range(2))
    set_all(x, places)
    room = pack_room(scene, meets.pairs, x.dtype)
    assert found(x, v, meets.pairs, room) == 1
    shares, particles = numbers(room.share)[0], numbers(room.particle)[:4]
    assert (shares > 0).tolist() == [n != 3 for n in range(copies)]
    assert len({tuple(sorted(corners)) for corners in particles[1:, shares > 0].T}) >= 10
    np.testing.assert_allclose(numbers(room.distance)[0][shares > 0], 2e-3, rtol=1e-9)
