"""Contact: what moves × what it meets × the law, of springs and of rigid bodies.

Bodies and what they meet are those of `tests.collisions.movers`; all but bowls share two kernels. Numbers
that a law depends on are tried in copies.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from typing import Any

import numpy as np
import pytest

from benchmarks.hard_cases import kept_by_nodes
from springgym.dynamics.contact.law import SLOW
from springgym.model.bodies import cube, rotation
from springgym.model.collisions import Pair
from springgym.model.resolution import WRONG, max_impact_speeds, possible_contacts
from springgym.model.scene import Placed, Scene
from springgym.model.surfaces import Contact, Plane, floor, heights
from springgym.simulator import Simulator, UnresolvedContactError
from springgym.theory import rolling
from springgym.theory.contact import rebound, stopping_distance
from tests.collisions.impacts import impacts, rotations
from tests.collisions.movers import (
    CARRIERS,
    FAR_PAIR,
    ON_SURFACES_ONLY,
    REACH,
    STRENGTH,
    SURFACES,
    G,
    World,
    alone,
    automatic,
    body,
    scene,
    world,
)
from tests.collisions.stepped import full
from tests.copies import check_alone, check_calls, check_contacts

SHARE = {"ball": 2 / 5, "capsule": 61 / 130}
"""I/(m r²) of what rolls: of a capsule (L/2 + 8 r/15)/(L + 4 r/3) with L = 3 r."""
HARD = {"strength": STRENGTH, "reach": REACH}
SOFT = {"strength": 1e-3, "reach": 4e-3}
GAP = 0.01
"""By how much of its radius the gap lengthens the arm of what rolls on a rigid block, at most."""


def cells(movers: Iterable[str], partners: Iterable[str], *usual: str) -> Any:
    """Parametrise a test by bodies, partners and dynamics; all but the ``usual`` cells are slow."""
    names = [
        f"{mover}-{on}-{dynamics}"
        for dynamics in ("springs", "rigid")
        for mover in movers
        for on in partners
        if on in SURFACES or mover not in ON_SURFACES_ONLY
    ]
    assert set(usual) <= set(names)
    each = [
        pytest.param(*name.split("-"), id=name, marks=() if name in usual else pytest.mark.slow)
        for name in names
    ]
    return pytest.mark.parametrize(("mover", "on", "dynamics"), each)


# --- Along the normal -------------------------------------------------------------------------------------

E = np.array([1.0, 0.8, 0.5, 0.2, 0.0])
SPEEDS = np.array([0.05, 0.1, 0.5, 2.0, 5.0])


@pytest.mark.parametrize("finer", [1, pytest.param(10, marks=pytest.mark.slow)])
@cells(
    ("ball", "capsule", "disk", "ellipsoid", "cube", "die"),
    ("floor", "block", "mate"),
    "ball-floor-springs",
    "capsule-block-springs",
    "cube-mate-springs",
    "ball-mate-rigid",
    "die-floor-rigid",
)
def test_impacts_keep_their_restitution_or_are_counted(
    mover: str, on: str, dynamics: str, finer: int
) -> None:
    """With default bodies, contacts and steps, whatever the phase of a step: the energy that impacts lose is
    right to `WRONG`, or they are counted as coarse. That is so above the highest speed, and only there."""
    of = body(mover, damping=10.0)
    phases = 8
    plain = alone(scene(of, on, Contact(0.3, 0.5), 0.0203), on)
    step = automatic(plain, dynamics) / finer
    most = max_impact_speeds(possible_contacts(plain, dynamics == "springs"), step).min()
    v, e, late = (each.ravel() for each in np.meshgrid(SPEEDS, E, np.arange(phases) / phases, indexing="ij"))
    w = world(
        of, on, Contact(0.3, 0.5), 0.0203, dynamics=dynamics, copies=len(v), step=step, unresolved="count"
    )
    w.simulator.vary(np.arange(len(v)), restitution=e)
    w.place(np.outer(late * v * step, (0, 0, -1)), np.outer(v, (0, 0, -1)))
    kept = np.zeros(len(v))
    told = np.zeros(len(v), bool)
    taken = 0
    for speed in SPEEDS[::-1]:
        steps = math.ceil((0.021 / speed + LASTS) / step)
        w.simulator.advance(steps - taken, check=False)
        taken = steps
        own = v == speed
        apart = w.velocity()[:, 2] - (w.velocity(1)[:, 2] if on == "mate" else 0.0)
        kept[own] = (apart / v)[own]
        told[own] = (w.simulator.coarse_contacts > 0)[own]
    expected = np.array([rebound(speed, asked, SLOW) for speed, asked in zip(v, e, strict=True)])
    wrong = np.abs(kept**2 - expected**2)
    np.testing.assert_array_equal(told, v > most)
    assert (wrong[~told] <= np.where(e < 1, WRONG * (1 - expected**2), 0.02)[~told]).all()


LASTS = 0.05
"""Longer than any of these impacts [s]."""


@cells(
    ("ball", "ellipsoid", "cube"), ("floor", "ramp", "block", "mate"), "ball-floor-springs", "cube-mate-rigid"
)
def test_what_a_step_cannot_resolve_is_told(mover: str, on: str, dynamics: str) -> None:
    """It is an error, or counted on request; a copy beside it does not mind."""
    down = np.array([[0.0, 0, -60.0], [0.0, 0, -0.5]])

    def thrown(unresolved: str, velocities: np.ndarray) -> World:
        how = Contact(restitution=0.5, **HARD)
        tilt = 0.3 if on == "ramp" else None
        options: dict[str, Any] = {"dynamics": dynamics, "step": 2e-4, "tilt": tilt}
        w = world(body(mover), on, how, 0.1, unresolved=unresolved, **options)
        w.place(velocities=velocities)
        return w

    with pytest.raises(UnresolvedContactError, match=r"'first'.* of copy 0"):
        thrown("raise", down).simulator.advance(50)
    counted = thrown("count", down)
    alone = thrown("raise", down[[1, 1]])
    for each in (counted, alone):
        each.simulator.advance(1500)
    assert counted.simulator.unresolved.tolist() == [True, False]
    np.testing.assert_array_equal(counted.simulator.positions[1], alone.simulator.positions[1])
    assert alone.velocity()[1, 2] > -0.3


def test_particles_that_surfaces_alone_meet_tell_it_too() -> None:
    """The error names the body that hits a surface too fast, and placing it anew clears `unresolved`."""
    bodies = [Placed(cube(), cube().positions + 0.7, np.tile([0, 0, -99.0 * n], (8, 1))) for n in range(2)]
    simulator = Simulator(Scene(bodies=bodies, surfaces=[floor()], collisions=()), step=4e-4)
    with pytest.raises(UnresolvedContactError, match=r"'cube1' and a surface of copy 0 .* at 99.02 m/s"):
        simulator.advance(50)
    simulator.place(simulator.scene.positions, 0.01 * simulator.scene.velocities)
    simulator.advance(2000)
    assert not simulator.unresolved.any()


# --- Friction ---------------------------------------------------------------------------------------------

TILT = 0.3


@cells(
    ("ball", "capsule", "cube"),
    ("floor", "ramp", "block"),
    "ball-ramp-springs",
    "cube-floor-springs",
    "capsule-block-rigid",
    "cube-ramp-rigid",
)
def test_on_a_slope_it_holds_rolls_or_slides(mover: str, on: str, dynamics: str) -> None:
    """Up to the angle of friction what is flat stays, and what is round rolls with g sin a/(1 + I/(m r²)).
    Beyond, both slide with g (sin a − μ cos a)."""
    share = SHARE.get(mover)
    needs = rolling.needed_friction(TILT, share) if share else math.tan(TILT)
    mu = needs * np.array([0.5, 0.97, 1.03, 2.0])
    how = Contact(0.5, 0.5, **HARD)
    of = body(mover, 1e6, 10.0)
    w = world(of, on, how, dynamics=dynamics, step=2e-4, copies=4, tilt=TILT)
    w.simulator.vary(np.arange(4), friction=mu)
    w.place()
    w.simulator.advance(1000)
    before = w.velocity()
    place = w.centre()
    w.simulator.advance(1000)
    v = w.velocity()
    slip = w.velocity()[:, 0] - 0.1 * w.spin()[:, 1]
    slides = G * (math.sin(TILT) - mu * math.cos(TILT))
    sticks = rolling.acceleration(TILT, share) if share else 0.0
    off = GAP if on == "block" and dynamics == "rigid" else 1e-4
    gained = (v - before)[:, 0] / 0.2
    np.testing.assert_allclose(gained, np.where(mu < needs, slides, sticks), rtol=0, atol=off * G)
    # the first pushes, end by end, turn a capsule of springs
    assert np.abs(v[:, 1]).max() < (1e-4 if mover == "capsule" and dynamics == "springs" else 1e-5)
    if share:
        assert (np.abs(slip[2:]) < off * v[2:, 0]).all()
        assert (slip[:2] > 0.01).all()
    else:
        assert np.abs(w.centre() - place)[2:].max() < 1e-12


@cells(
    ("ball", "capsule", "cube"),
    ("floor", "block"),
    "ball-floor-springs",
    "capsule-floor-rigid",
    "cube-block-rigid",
)
def test_what_slides_stops_or_rolls_on(mover: str, on: str, dynamics: str) -> None:
    """What is flat stops after v²/2 μ g, what is round rolls on with v/(1 + I/(m r²))."""
    speed = 1.0
    mu = 0.2
    of = body(mover, 1e6, 10.0)
    options: dict[str, Any] = {"dynamics": dynamics, "step": 2e-4, "tilt": 0.0}
    w = world(of, on, Contact(mu, 0.5, **HARD), velocity=(speed, 0, 0), **options)
    start = w.centre()
    before = w.simulator.measure().balance
    w.simulator.advance(4000)
    after = w.simulator.measure()
    share = SHARE.get(mover, math.inf)
    off = GAP if on == "block" and dynamics == "rigid" and mover in SHARE else 1e-4
    np.testing.assert_allclose(w.velocity(), [(speed / (1 + share), 0, 0)] * 2, atol=off)
    lost = 0.5 * speed**2 / (1 + 1 / share)
    np.testing.assert_allclose(after.friction_loss, lost, rtol=4 * off)
    np.testing.assert_allclose(after.balance, before, rtol=0, atol=1e-6)
    if mover in SHARE:
        np.testing.assert_allclose(0.1 * w.spin()[:, 1], speed / (1 + share), rtol=2 * off)
    else:
        way = (w.centre() - start)[:, 0]
        np.testing.assert_allclose(way, stopping_distance(speed, mu), rtol=1e-4)


@cells(("ball", "capsule"), ("floor", "ramp", "block", "mate"), "ball-mate-springs", "capsule-floor-rigid")
def test_friction_stops_the_slip_of_what_spins_or_takes_its_share(mover: str, on: str, dynamics: str) -> None:
    """The impulse that stops the slip ω r is ω r/(n (1 + m r²/I)/m), n of the bodies turn; or it is μ J."""
    speed = 0.5
    spin = 10.0
    mu = np.array([0.05, 2.0])
    share = SHARE[mover]
    turning = 2 if on == "mate" else 1
    begins: dict[str, Any] = {"velocity": (0, 0, -speed), "omega": (0, spin, 0), "up": 0.0203}
    w = world(body(mover, 1e6), on, Contact(0.5, 1.0, **SOFT), dynamics=dynamics, step=1e-4, **begins)
    w.simulator.vary(np.arange(2), friction=mu)
    w.simulator.advance(1000)
    push = 2 * speed / turning
    stops = 0.1 * spin / (turning * (1 + 1 / share))
    rubs = np.minimum(mu * push, stops)
    assert (rubs < stops).tolist() == [True, False]
    np.testing.assert_allclose(w.velocity()[:, 0], rubs, rtol=0.03)
    np.testing.assert_allclose(spin - w.spin()[:, 1], rubs / (share * 0.1), rtol=0.03)
    np.testing.assert_allclose(w.velocity()[:, 2], push - speed, rtol=0, atol=5e-3)
    if on == "mate":
        np.testing.assert_allclose(w.spin(1)[:, 1], -rubs / (share * 0.1), rtol=0.03)


# --- What is kept -----------------------------------------------------------------------------------------

COPIES = 16


def thrown(mover: str, on: str, dynamics: str, how: Contact, step: float, stiffness: float = 1e5) -> World:
    """Return a body, turned and spinning at random, that flies at a surface or another's side at 1 m/s."""
    of = body(mover, stiffness)
    other = body("cube" if mover == "stone" else mover, stiffness)
    options: dict[str, Any] = {"copies": COPIES, "unresolved": "count", "tilt": 0.3 if on == "ramp" else None}
    w = world(of, on, how, 1.0, dynamics=dynamics, step=step, other=other, **options)
    x, v = impacts(of, other, 1.0, COPIES, np.random.default_rng(3))
    if on != "mate":
        own = slice(len(of.masses))
        x, v = (each[:, own] - each[:, own].mean(axis=1, keepdims=True) for each in (x, v))
        x = np.add(x, (0, 0, (0.75 if on == "bowl" else 0.55) * of.swept)) @ w.axes.T
        v = np.add(v, (0.5, 0, -1.0)) @ w.axes.T
    places, speeds = (
        np.repeat(each[None], COPIES, axis=0)
        for each in (w.simulator.scene.positions, w.simulator.scene.velocities)
    )
    places[:, : x.shape[1]] = x
    speeds[:, : x.shape[1]] = v
    w.simulator.place(places, speeds)
    return w


def kept(simulator: Simulator) -> np.ndarray:
    """Return the energy that steps conserve, with the losses added (copies,) [J]."""
    m = simulator.measure()
    off = kept_by_nodes(simulator) - m.energy if simulator.dynamics == "springs" else 0.0
    return np.asarray(m.balance + off)


@cells(
    ("ball", "capsule", "disk", "ellipsoid", "cube", "stone"),
    ("floor", "ramp", "bowl", "mate"),
    "cube-mate-springs",
    "ball-mate-rigid",
    "capsule-floor-springs",
)
@pytest.mark.parametrize("lossy", [False, True], ids=["elastic", "lossy"])
def test_energy_and_momenta_are_kept(mover: str, on: str, dynamics: str, lossy: bool) -> None:
    """Momenta to rounding, energy to the square of the step; what is round and of springs, whose vibrations
    move its skin, to the share 1/k, too."""
    how = Contact(0.4, 0.6, **SOFT) if lossy else Contact(**SOFT)
    found = []
    for finer in (1, 4):
        rounded = dynamics == "springs" and mover not in ("cube", "stone")
        w = thrown(mover, on, dynamics, how, 4e-4 / finer, 1e6 if rounded and finer > 1 else 1e5)
        simulator = w.simulator
        worst = np.zeros(COPIES)
        first = simulator.measure()
        energy = kept(simulator)
        for _ in range(20):
            simulator.advance(round(0.02 / simulator.step))
            worst = np.maximum(worst, np.abs(kept(simulator) - energy))
        last = simulator.measure()
        found.append((np.median(worst), worst.max()))
        if on == "mate":
            np.testing.assert_allclose(last.momentum, first.momentum, rtol=0, atol=1e-12)
            np.testing.assert_allclose(last.angular_momentum, first.angular_momentum, rtol=0, atol=1e-12)
            assert (simulator.pairs().impulse[:, 0] > 0.1).sum() > COPIES / 2
        assert (last.contact_loss > 1e-3).sum() > (COPIES / 2 if lossy else -1)
        assert (last.friction_loss > 1e-4).sum() > (COPIES / 2 if lossy else -1)
    assert found[0][0] < (0.012 if rounded else 1e-3)
    assert found[0][1] < 0.05
    assert found[1][0] < max(found[0][0] / 5, 1e-8)


@cells(
    ("ball", "capsule", "ellipsoid", "cube"), ("floor", "mate"), "capsule-mate-springs", "cube-floor-rigid"
)
def test_impulses_of_contacts_are_what_changes_momenta(mover: str, on: str, dynamics: str) -> None:
    w = thrown(mover, on, dynamics, Contact(0.4, 0.6, **SOFT), 2e-4)
    while not w.simulator.contacts().there.any():
        w.simulator.advance(20)
    given = check_contacts(w.simulator, 300)
    assert np.abs(given).sum(axis=0).max() > 0.3
    assert np.abs(given).sum(axis=(0, 1)).min() > 0.01


@cells(
    ("ball", "capsule", "disk", "cube", "stone"),
    ("floor", "ramp", "block"),
    "cube-ramp-springs",
    "ball-floor-springs",
    "capsule-block-rigid",
)
def test_what_lies_stays_and_its_contacts_bear_its_weight(mover: str, on: str, dynamics: str) -> None:
    if mover in SHARE and on == "ramp":
        pytest.skip("it rolls, as it should")
    tilt = 0.3 if on == "ramp" else 0.0
    of = body(mover, damping=100.0)
    w = world(of, on, Contact(0.9, 0.2, **HARD), dynamics=dynamics, step=2e-4, tilt=tilt)
    w.simulator.advance(5000)
    place = w.centre()
    w.simulator.advance(2500)
    found = w.simulator.contacts()
    mine = found.there[0] & (found.first[0] == 0)
    assert mine.sum() == CARRIERS.get(mover, 1)
    weight = of.mass * G * np.array([-math.sin(tilt), 0.0, math.cos(tilt)])
    np.testing.assert_allclose((found.force[0][mine] @ w.axes).sum(axis=0), weight, atol=1e-5 * G)
    np.testing.assert_allclose((found.point[0][mine] @ w.axes)[:, 2], found.gap[0][mine] / 2, atol=1e-8)
    np.testing.assert_allclose(found.normal[0][mine] @ w.axes, [(0, 0, 1)] * mine.sum(), atol=1e-6)
    assert np.abs(w.centre() - place).max() < 1e-9
    assert np.abs(w.velocity()).max() < 1e-6


@pytest.mark.slow
@pytest.mark.parametrize("on", ["floor", "mate"])
@pytest.mark.parametrize("mover", ["ball", "capsule", "ellipsoid", "cube"])
def test_springs_approach_their_twin_as_they_grow_stiff(mover: str, on: str) -> None:
    """Velocities after an impact approach those of the rigid twin as the springs get stiffer."""
    if on == "mate" and mover in ON_SURFACES_ONLY:
        pytest.skip("it meets surfaces alone")

    def after(stiffness: float, dynamics: str) -> np.ndarray:
        w = thrown(mover, on, dynamics, Contact(0.3, 0.8, **SOFT), 2e-5, stiffness)
        w.simulator.advance(10_000)
        return np.concatenate([w.velocity(), 0.1 * w.spin()], axis=1)

    exact = after(1e7, "rigid")
    off = [np.median(np.abs(after(stiffness, "springs") - exact)) for stiffness in (1e5, 1e6, 1e7)]
    assert off[1] < 0.5 * off[0]
    assert off[2] < 0.5 * off[1]


@pytest.mark.parametrize("name", ["ball", "capsule", "cube"])
def test_what_is_pinned_whole_stays_where_a_ball_hits_it(name: str) -> None:
    """Contacts turn as one what is round, and what a round body meets with rolling resistance."""
    of = body(name)
    hits = body("ball")
    bodies = (
        Placed(of, pinned=tuple(range(len(of.masses))), name="held"),
        Placed(hits, np.add(hits.positions, (0.03, 0.02, 0.4)), np.tile((0, 0, -0.5), (4, 1)), name="hits"),
    )
    pair = Scene(bodies=bodies, gravity=None, contact=Contact(0.5, rolling_resistance=0.01))
    simulator = full(pair, step=1e-4, copies=2)
    simulator.advance(6000)
    assert (simulator.measure("hits").centre_velocity[:, 2] > 0.1).all()
    np.testing.assert_array_equal(simulator.positions[:, pair.slices[0]], 2 * [of.positions])


@pytest.mark.slow
@pytest.mark.parametrize("dynamics", ["springs", "rigid"])
def test_a_body_turns_about_its_pin_when_it_is_hit(dynamics: str) -> None:
    """Angular momentum about the pin is kept, and so is energy."""
    of = cube(damping=0.0)
    hits = Placed(
        of, np.add(of.positions, (1.1, 0.3, 0.2)), np.repeat([[-1.0, 0, 0]], 8, axis=0), name="stone"
    )
    bodies = (Placed(of, pinned=(0,), name="door"), hits)
    pair = Scene(bodies=bodies, gravity=None, contact=Contact(strength=0.01, reach=0.01), collisions="all")
    simulator = full(pair, dynamics=dynamics, step=2e-4, copies=2)
    masses = np.tile(of.masses, 2)

    def about_pin() -> np.ndarray:
        arms = simulator.positions - of.positions[0]
        return np.einsum("n,cnx->cx", masses, np.cross(arms, simulator.velocities))

    before = about_pin()
    energy = kept(simulator)
    simulator.advance(3000)
    assert np.linalg.norm(simulator.measure("door").angular_velocity, axis=1).min() > 0.2
    np.testing.assert_allclose(about_pin(), before, atol=1e-12)
    np.testing.assert_allclose(kept(simulator), energy, rtol=1e-3)
    np.testing.assert_array_equal(simulator.positions[:, 0], of.positions[[0, 0]])


@pytest.mark.slow
@pytest.mark.parametrize("mover", ["ball", "capsule", "cube", "stone"])
def test_nothing_gets_through_a_corner_of_planes(mover: str) -> None:
    """Bodies at 20 m/s and 100 rad/s are too fast for the steps: they are counted, and gain little energy."""
    of = body(mover)
    rng = np.random.default_rng(1)
    planes = (Plane(), Plane((-1, 0, 0), (1, 0, 0)), Plane((0, -1, 0), (0, 1, 0)))
    above = Placed(of, np.add(of.positions, (0, 0, 0.8)), name="first")
    bodies = (above, *FAR_PAIR)
    apart = (Pair(1, 2, Contact(**HARD)),)
    corner = Scene(bodies=bodies, surfaces=planes, contact=Contact(**SOFT), collisions=apart)
    w = World(full(corner, dynamics="rigid", step=1e-3, copies=16, unresolved="count"), np.eye(3))
    w.place(velocities=rng.normal(size=(16, 3)) * 12, spins=rng.normal(size=(16, 3)) * 60)
    energy = w.simulator.measure(0).kinetic
    least = 1.0
    for _ in range(250):
        w.simulator.advance(4, check=False)
        gaps = [
            heights(of, x, plane).min()
            for plane in planes
            for x in w.simulator.positions[:, : len(of.masses)]
        ]
        least = min(least, *gaps)
    assert 0 < least < SOFT["reach"] / 2
    assert w.simulator.unresolved.sum() > 8
    assert (w.simulator.measure(0).kinetic < 1.1 * (energy + G * 1.5)).all()


def test_rigid_cubes_that_fall_on_each_other_gain_no_energy() -> None:
    """Their edges cross above a floor, so that impulses and flights follow from each other in turns.

    Gradients of edges that act in each of these turns, not once, take a fifth of the energy.
    """
    of = cube(damping=0.0)
    copies = 64
    turns = rotations(np.random.default_rng(0), 2 * copies).reshape(2, copies, 3, 3)
    lower = of.positions @ turns[0]
    upper = of.positions @ turns[1] + (0.3, 0.2, 0.0)
    lower[..., 2] += 0.05 - lower[..., 2].min(axis=1, keepdims=True)
    above = lower[..., 2].max(axis=1, keepdims=True) + 0.05
    upper[..., 2] += above - upper[..., 2].min(axis=1, keepdims=True)
    v = np.repeat([(0.0, 0, 0), (0, 0, -3.0)], 8, axis=0)
    bodies = (Placed(of, lower[0], name="lower"), Placed(of, upper[0], name="upper"))
    pair = Scene(bodies=bodies, surfaces=(floor(),), contact=Contact(0.0, 1.0), collisions="all")
    simulator = full(pair, dynamics="rigid", step=1e-3, copies=copies, unresolved="count")
    simulator.place(np.concatenate([lower, upper], axis=1), np.repeat(v[None], copies, axis=0))
    start = simulator.measure().balance
    simulator.advance(1000)
    assert (simulator.pairs().impulse[:, 0] > 1.0).all()
    assert np.abs(simulator.measure().balance / start - 1).max() < 0.02


# --- Bits -------------------------------------------------------------------------------------------------


def crowd(dynamics: str, copies: int) -> Simulator:
    """A ball, a stone, a capsule and a cube fall onto each other and a floor."""
    bodies = []
    for n, mover in enumerate(("cube", "capsule", "stone", "ball")):
        of = body(mover, damping=5.0)
        x = of.positions @ rotation((1, 2, 0.5), 0.7) + (0.05 * n, 0.03 * n, 0.3 + 0.5 * n)
        bodies.append(Placed(of, x, np.tile((0.3, 0.1, -2.0), (len(x), 1)), name=mover))
    how = Contact(0.4, 0.6, **SOFT)
    of = Scene(bodies=tuple(bodies), surfaces=(floor(),), contact=how, collisions="all")
    options: dict[str, Any] = {"step": 5e-4, "threads": min(copies, 2), "unresolved": "count"}
    return full(of, dynamics=dynamics, copies=copies, **options)


@pytest.mark.parametrize("dynamics", ["springs", "rigid"])
def test_copies_are_single_ones_and_calls_of_any_length_are_one(dynamics: str) -> None:
    """On threads, too; states and pickles hold what contacts start from, and what is placed starts afresh."""
    whole = crowd(dynamics, 11)
    x, v = (np.repeat(each[None], 11, axis=0) for each in (whole.scene.positions, whole.scene.velocities))
    v = v * np.linspace(0.5, 1.5, 11)[:, None, None]
    batch = check_alone(lambda copies: crowd(dynamics, copies), x, v, [500, 700], (0, 4, 10))
    assert (batch.pairs().impulse > 0).sum() > 11
    whole.place(x, v)
    check_calls(whole, [1, 2, 57, 3, 37, 700])
    while not (touches := whole.contacts().there.any(axis=1)).any():
        whole.advance(3)
    n = int(np.argmax(touches))
    again = crowd(dynamics, 1)
    state = whole.positions[n], whole.velocities[n]
    whole.place(*state, [n])
    again.place(*state)
    for each in (whole, again):
        each.advance(300)
    np.testing.assert_array_equal(whole.positions[n], again.positions[0])


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore:a contact of copy:springgym.simulator.PrecisionWarning")  # in both alike
@pytest.mark.parametrize("dynamics", ["springs", "rigid"])
@pytest.mark.parametrize("mover", ["ball", "capsule", "disk", "cube"])
def test_scenes_without_collisions_compute_the_same(mover: str, dynamics: str) -> None:
    """Up to rounding of the sums of what meets no others, though they have kernels of their own."""
    begins = {"velocity": (0.5, 0, -1.0), "omega": (3, 4, 5), "rotation": (0.3, 0.2, 0.1)}
    among = scene(body(mover, damping=5.0), "floor", Contact(0.4, 0.6, **SOFT), 0.1, 0.0, **begins)
    own = among.slices[0]
    placed = {"surfaces": among.surfaces, "contact": among.contact}
    alone = Scene(among.bodies[0].body, among.positions[own], among.velocities[own], **placed)
    one, other = (Simulator(each, dynamics=dynamics, step=2e-4, copies=2) for each in (alone, among))
    for simulator in (one, other):
        simulator.advance(2500)
    assert one.measure().contact_loss.min() > 0.1
    np.testing.assert_allclose(one.positions, other.positions[:, own], rtol=0, atol=1e-13)
