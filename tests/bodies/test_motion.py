import numpy as np
import pytest

from springgym.model.bodies import (
    Body,
    box,
    cube,
    gyroscope,
    relative_equilibrium,
    rigid_velocities,
    rope,
    rotation,
    start,
    stretched_shapes,
    top,
)
from springgym.model.bodies.elasticity import spring_force_and_jacobian
from springgym.model.bodies.rotations import axes
from springgym.model.scene import Scene
from springgym.simulator import Simulator
from springgym.theory import oscillation
from springgym.theory.rope import stretched_lengths

G = (0.0, 0.0, -9.81)
UNEQUAL = box((1.0, 0.7, 0.4), (0.2, 0.1, 0.1, 0.15, 0.1, 0.1, 0.15, 0.1))


def strains(body, x):
    apart = x[..., body.springs[:, 1], :] - x[..., body.springs[:, 0], :]
    return np.linalg.norm(apart, axis=-1) / body.lengths - 1


def pair(mass=1.0, stiffness=1000.0):
    return Body("pair", [[0, 0, 0], [1, 0, 0]], [mass, mass], [(0, 1)], stiffness, 0.0)


# --- Orientation and rigid motion -------------------------------------------------------------------


def test_rotation_follows_the_right_hand():
    assert rotation((0, 0, 2), np.pi / 2) @ [1, 0, 0] == pytest.approx([0, 1, 0], abs=1e-15)
    turn = rotation((1, 2, 3), 0.7)
    assert turn @ turn.T == pytest.approx(np.eye(3), abs=1e-15)
    assert np.linalg.det(turn) == pytest.approx(1)


def test_axes_of_a_body():
    turn = rotation((1, 2, 3), 0.7)
    body = top()
    assert axes(body.positions @ turn.T, body.markers) == pytest.approx(turn, abs=1e-14)
    of_line = axes(rope().positions, rope().markers)
    assert of_line[:, 2].tolist() == [0, 0, 1]
    assert of_line.T @ of_line == pytest.approx(np.eye(3), abs=1e-15)
    diagonal = axes(cube().positions, cube().markers)[:, 2]
    assert diagonal == pytest.approx(np.array([1, 1, -1]) / np.sqrt(3))


def test_spinning_is_rigid():
    x = top().positions
    omega = np.array([1.0, -2.0, 3.0])
    about = np.array([0.1, 0.2, 0.3])
    v = rigid_velocities(x, omega, about)
    small = 1e-5
    turned = about + (x - about) @ rotation(omega, small * np.linalg.norm(omega)).T
    assert (turned - x) / small == pytest.approx(v, abs=10 * small * (omega @ omega))


def test_start_of_a_top():
    tilt = 0.4
    azimuth = 1.1
    spin = 20.0
    precession = -0.5
    body = top()
    x, v = start(
        body, tilt=tilt, azimuth=azimuth, spin=spin, precession=precession, pinned=(13,), position=(1, 2, 3)
    )
    axis = np.array([np.sin(tilt) * np.cos(azimuth), np.sin(tilt) * np.sin(azimuth), np.cos(tilt)])
    assert x[13].tolist() == [1, 2, 3]
    assert (x[12] - x[13]) / np.linalg.norm(x[12] - x[13]) == pytest.approx(axis)
    momentum = np.cross(x - x[13], body.masses[:, None] * v).sum(axis=0)
    tensor = body.with_(positions=x, lengths=body.lengths).inertia(x[13])
    omega = np.linalg.solve(tensor, momentum)
    assert omega @ axis == pytest.approx(spin)
    # the crown goes around the vertical at the rate of precession
    bend = spin * np.abs(strains(body, x)).max()  # the crown is off the axis by as little
    assert v[12] == pytest.approx(precession * np.cross([0, 0, 1], x[12] - x[13]), abs=bend)


def test_start_of_a_free_body():
    body = UNEQUAL
    velocity = np.array([1.0, 0.0, 2.0])
    x, v = start(body, omega=(0.0, 4.0, 1.0), position=(0, 0, 5), velocity=velocity)
    assert body.masses @ x / body.mass == pytest.approx([0, 0, 5])
    assert body.masses @ v / body.mass == pytest.approx(velocity)
    assert v - velocity == pytest.approx(np.cross([0, 4, 1], x - [0, 0, 5]), abs=1e-14)


def test_unstretched_start_is_the_shape_itself():
    body = top()
    x, _ = start(body, tilt=0.3, spin=50.0, pinned=(13,), stretched=False)
    assert np.abs(strains(body, x)).max() < 1e-15
    assert np.abs(strains(body, start(body, tilt=0.3, spin=50.0, pinned=(13,)).positions)).max() > 5e-4


@pytest.mark.parametrize(("body", "pin"), [(cube(), 0), (UNEQUAL, 3), (rope(), 0), (top(), 13), (top(), 12)])
def test_hanging_puts_the_centre_below_the_pin(body, pin):
    x, _ = start(body, pinned=(pin,), position=(0, 0, 5), hanging=True, stretched=False)
    centre = body.masses @ x / body.mass
    assert centre[:2] == pytest.approx([0, 0], abs=1e-12)
    assert centre[2] == pytest.approx(5 - np.linalg.norm(body.centre - body.positions[pin]))
    turned, _ = start(
        body, pinned=(pin,), position=(0, 0, 5), hanging=True, rotation=(0, 0.3, 0), stretched=False
    )
    assert turned - [0, 0, 5] == pytest.approx((x - [0, 0, 5]) @ rotation((0, 1, 0), 0.3).T, abs=1e-12)
    with pytest.raises(ValueError, match="it cannot hang"):
        start(body, hanging=True)


def test_body_pinned_at_its_centre_cannot_hang():
    three = Body(
        "three", np.array([[0, 0, 0], [1, 0, 0], [-1, 0, 0]]), 1.0, [(0, 1), (0, 2)], 1e3, 0.0, floppy=True
    )
    for body in (three, Body("one", np.zeros((1, 3)), 1.0, np.zeros((0, 2), int), 1e3, 0.0)):
        with pytest.raises(ValueError, match="its hanging orientation is undefined"):
            start(body, pinned=(0,), hanging=True)


def test_rope_to_the_side_carries_the_weight_along_itself():
    body = rope()
    x, _ = start(body, pinned=(0,), hanging=True, rotation=(0, np.pi / 3, 0), gravity=G)
    theory = stretched_lengths(body.masses[1:], body.lengths, body.stiffness, gravity=9.81 / 2)
    assert np.linalg.norm(np.diff(x, axis=0), axis=1) == pytest.approx(theory, rel=1e-12)


def test_stretched_shapes_are_the_relative_equilibria():
    body = top()
    shapes = stretched_shapes(body, (0, 0, 1), 100.0, (13,))
    for spin in (0.0, 37.0, 80.0, 100.0):
        exact = relative_equilibrium(body, (0.0, 0.0, spin), (13,))
        # five points leave the fifth power of m ω²/k, here below 1e-2
        assert shapes(spin) == pytest.approx(exact, abs=1e-10)
    assert np.abs(shapes(100.0) - body.positions).max() > 1e-3


def test_stretched_shapes_are_found_once_for_bodies_of_the_same_numbers():
    first, same = (stretched_shapes(top(), (0, 0, 1), 100.0, (13,)) for _ in range(2))
    assert same.coefficients is first.coefficients
    assert not first.coefficients.flags.writeable
    softer = top().with_(stiffness=0.9 * top().stiffness)
    for given in (
        (softer, (0, 0, 1), 100.0, (13,)),
        (top(), (1, 0, 0), 100.0, (13,)),
        (top(), (0, 0, 1), 90.0, (13,)),
        (top(), (0, 0, 1), 100.0),
    ):
        assert not np.array_equal(stretched_shapes(*given).coefficients, first.coefficients)


def test_pins_hold():
    with pytest.raises(ValueError, match=r"body 'cube' is pinned at \[0, 4\] and cannot turn"):
        start(cube(), pinned=(0, 4), omega=(1.0, 0.0, 0.0))
    with pytest.raises(ValueError, match="the pins would move"):
        start(cube(), pinned=(0,), velocity=(1.0, 0.0, 0.0))
    hinged = start(cube(), tilt=0.3, pinned=(0, 6), spin=5.0)
    assert np.abs(hinged.velocities).max() > 1
    assert not hinged.velocities[[0, 6]].any()


# --- Relative equilibrium ---------------------------------------------------------------------------


def test_length_of_a_spun_pair():
    for omega in (5.0, 20.0, 30.0):
        x = relative_equilibrium(pair(), (0.0, 0.0, omega))
        theory = oscillation.spun_pair_length(1.0, 1000.0, 1.0, omega)
        assert np.linalg.norm(x[1] - x[0]) == pytest.approx(theory, rel=1e-12)
        assert x.mean(axis=0) == pytest.approx([0.5, 0, 0])
    with pytest.raises(ValueError, match="body 'pair' has no steady shape"):
        relative_equilibrium(pair(), (0.0, 0.0, 50.0))


def test_hanging_rope():
    body = rope(beads=6, stiffness=1e4)
    x = relative_equilibrium(body, (0.0, 0.0, 0.0), (0,), G)
    theory = stretched_lengths(body.masses[1:], body.lengths, body.stiffness)
    assert -np.diff(x[:, 2]) == pytest.approx(theory, rel=1e-12)
    assert x[:, :2] == pytest.approx(0.0, abs=1e-12)
    with pytest.raises(ValueError, match="it is floppy and does not hang along gravity"):
        relative_equilibrium(body, (0.0, 0.0, 0.0), (0,), (9.81, 0.0, 0.0))


@pytest.mark.parametrize(
    ("body", "omega", "pinned", "gravity"),
    [
        (top(), (0, 0, 50), (13,), None),
        (top(scaled={0: 2.0}), (3, 1, 50), (13,), (2.0, 0.0, -9.0)),
        (cube(), (1, 2, 10), (), G),
        (cube(), (1, 2, 10), (0,), (3.0, 2.0, 9.0)),
        (gyroscope(), (0, 0, 40), (14,), G),
        (UNEQUAL, (1, 5, 0.2), (), None),
        (UNEQUAL, (0, 0, 5), (0, 4), (9.0, 0.0, 0.0)),
    ],
)
def test_every_particle_moves_as_in_a_rigid_body(body, omega, pinned, gravity):
    """F + m g − m a is zero with a = ω×(ω×r) + α×r + a₀, of whatever α, and a₀ where nothing is pinned."""
    x = relative_equilibrium(body, omega, pinned, gravity)
    free = np.setdiff1d(np.arange(len(x)), pinned)
    centre = x[pinned[0]] if pinned else body.masses @ x / body.mass
    r = (x - centre)[free]
    wanted = spring_force_and_jacobian(body, x)[0][free] / body.masses[free, None]
    wanted = wanted - np.cross(omega, np.cross(omega, r)) + (0 if gravity is None or not pinned else gravity)
    rotations = np.cross(np.eye(3), r[:, None]).transpose(0, 2, 1).reshape(-1, 3)
    left = wanted.ravel() - rotations @ np.linalg.lstsq(rotations, wanted.ravel())[0]
    assert np.abs(strains(body, x)).max() > 1e-6
    # springs' forces are rounded at eps k L, some of them in a sum
    assert np.abs(left).max() < 1e-14 * (body.stiffness * body.lengths).max() / body.masses.min() * 10
    assert x[list(pinned)] == pytest.approx(body.positions[list(pinned)], abs=0)


def breathing(body, x, v, pinned, gravity, step, duration):
    """Range of the strain of each spring over a time, (S,)."""
    scene = Scene(body, x, v, pinned=pinned, gravity=gravity)
    simulator = Simulator(scene, step=step)
    history = []
    for _ in range(round(duration / (5 * step))):
        simulator.advance(5)
        history.append(strains(body, simulator.positions[0]))
    return np.ptp(history, axis=0)


@pytest.mark.parametrize(
    ("body", "omega", "pinned"),
    [
        (top(damping=0.0), (0.0, 0.0, 50.0), (13,)),
        (cube(damping=0.0), (5.0, 10.0, 15.0), ()),
        (gyroscope(damping=0.0), (0.0, 0.0, 40.0), (12,)),
        (UNEQUAL.with_(damping=0.0), 8.0 * UNEQUAL.principal()[1][:, 2], ()),
    ],
    ids=["top", "cube", "gyroscope", "box"],
)
def test_relative_equilibrium_does_not_breathe(body, omega, pinned):
    """Verlet holds a circle with speed and pull wrong by (ω h)²/6: strain stays to that share of itself.

    Stretched, the axis is principal to the order of the strain; so the wobble changes it by its square.
    """
    step = 1e-4
    ranges = []
    for x in (relative_equilibrium(body, omega, pinned), body.positions):
        v = rigid_velocities(x, omega, x[pinned[0]] if pinned else body.masses @ x / body.mass)
        ranges.append(breathing(body, x, v, pinned, None, step, 0.05).max())
    strain = np.abs(strains(body, relative_equilibrium(body, omega, pinned))).max()
    assert ranges[1] > strain  # the unstretched start swings to twice the strain and back
    assert ranges[0] < np.dot(omega, omega) * step**2 * strain + strain**2


def test_tilted_top_breathes_less_than_the_papers_start():
    """The stress turns with the spin, so some breathing is left; the weight and the spin it carries."""
    body = top(damping=0.0)
    pinned = (13,)
    spread = []
    for stretched in (True, False):
        x, v = start(body, tilt=0.35, spin=40.0, pinned=pinned, gravity=G, stretched=stretched)
        spread.append(breathing(body, x, v, pinned, G, 1e-4, 0.03).max())
    assert spread[1] > 5e-4
    assert spread[0] < spread[1] / 20
