"""Bodies that touch: balls, restitution, friction that holds and slides, stacks."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from springgym.dynamics.records import PairTotal
from springgym.model.bodies import Body, box, rope
from springgym.model.scene import Placed, Scene
from springgym.model.surfaces import Contact
from tests.collisions.stepped import Stepped

BALL = Body("ball", [[0.0, 0.0, 0.0]], 1.0, [], 1.0, 0.0, radius=0.1)
REACH = 2e-3
HARD = {"strength": 0.5 * 1e5 * REACH**3, "reach": REACH}


def put(body: Body, place: Any, name: str, velocity: Any = (0.0, 0.0, 0.0), **more: Any) -> Placed:
    moved = body.positions + np.asarray(place, float)
    return Placed(body, moved, np.broadcast_to(np.asarray(velocity, float), moved.shape), name=name, **more)


def balls(*places: Any, contact: Contact, velocity: Any = (1.0, 0.0, 0.0)) -> Scene:
    """Balls at rest but the first."""
    rest = (0.0, 0.0, 0.0)
    return Scene(
        bodies=tuple(put(BALL, p, f"{n}", rest if n else velocity) for n, p in enumerate(places)),
        gravity=None,
        collisions=contact,
    )


@pytest.mark.parametrize(("speed", "step"), [(0.5, 1e-3), (5.0, 1e-4), (5.0, 3e-4)])
def test_head_on(speed: float, step: float) -> None:
    """Equal balls exchange their velocities, exactly: energy and momentum leave no other choice."""
    world = Stepped(
        balls((0, 0, 0), (0.25, 0, 0), contact=Contact(**HARD), velocity=(speed, 0, 0)), step=step
    )
    world.run(int(0.4 / speed / step))
    assert np.abs(world.v[0] - [(0, 0, 0), (speed, 0, 0)]).max() < 1e-11 * speed


def test_oblique() -> None:
    """Balls that meet b off the line part at a right angle, sin φ = b/(2r + Δ) or so; order 2."""
    offset = 0.05
    errors = []
    for step in (4e-4, 2e-4, 1e-4):
        scene = balls((0, 0, 0), (0.25, offset, 0), contact=Contact(**HARD))
        world = Stepped(scene, step=step)
        momenta = world.momenta()
        world.run(int(0.4 / step))
        assert np.abs(world.momenta() - momenta).max() < 1e-13
        first, second = world.v[0]
        errors.append(abs(first @ second))
        direction = second[1] / np.linalg.norm(second)
        assert -direction == pytest.approx(offset / 0.2, abs=0.01) or direction == pytest.approx(
            0.25, abs=0.01
        )
    assert errors[2] < errors[0] / 8
    assert errors[2] < 1e-5


def test_cradle() -> None:
    """0 0 0 0 1: with gaps, impacts come one after another."""
    places = [(0.2015 * n, 0, 0) for n in range(5)]
    world = Stepped(balls(*places, contact=Contact(strength=HARD["strength"], reach=5e-4)), step=5e-5)
    world.run(5000)
    assert np.abs(world.v[0, :, 0] - [0, 0, 0, 0, 1]).max() < 1e-10


@pytest.mark.slow
def test_ball_and_rods() -> None:
    """A rope of rods that falls over a box, beside a ball on it: both stay, and nothing is inside."""
    cord = rope(9, 1.6, 0.05, 0.05, 1e4, 5.0).with_(radius=0.02)
    along = np.stack([np.linspace(-0.8, 0.8, 9), np.full(9, 0.2), np.full(9, 0.53)], axis=1)
    table = put(box((1.0, 1.0, 1.0)), (0, 0, 0), "table", pinned=tuple(range(8)))
    scene = Scene(
        bodies=(table, Placed(cord, along, name="cord"), put(BALL, (0.0, -0.2, 0.63), "ball")),
        collisions=Contact(friction=0.8, restitution=0.3, strength=0.02, reach=0.01),
    )
    world = Stepped(scene)
    world.run(int(1.5 / world.step))
    x = world.x[0]
    assert world.totals[0, :, [PairTotal.TOUCHING]].sum() >= 2
    assert not world.totals[0, :, [PairTotal.MISSES, PairTotal.OVERFLOW]].any()
    assert max(x[8, 2], x[16, 2]) < 0.4  # the ends hang down
    assert x[10:15, 2].min() > 0.52  # a radius over the table
    assert x[17, 2] == pytest.approx(0.6, abs=0.011)
