"""The rigid twin against rigid theory, against its own declared order, and against the springs."""

from __future__ import annotations

import pickle

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from springgym.dynamics import rigid
from springgym.dynamics.stepping import plan_steps
from springgym.model.bodies import Body, box, cube, rigid_velocities, rope, rotation, start, top
from springgym.model.scene import DriveActuator, Scene, ThrustActuator, WrenchActuator
from springgym.model.surfaces import PaperContact, floor
from springgym.simulator import Simulator
from springgym.theory import free_body, pendulum
from springgym.theory import top as heavy_top
from springgym.theory.frames import carry
from tests.params import slow_but

GRAVITY = (0.0, 0.0, -9.81)
WEIGHTLESS = (0.0, 0.0, 0.0)  # the same compiled code as under gravity
TOP = top(damping=0.0)
TIP = TOP.particle("tip")
CROWN = TOP.particle("crown")
UNBALANCED = top(damping=0.0, scaled={0: 2.0})
BRICK = box((1.0, 0.7, 0.4), mass=(0.2, 0.1, 0.1, 0.15, 0.1, 0.1, 0.15, 0.1), damping=0.0)


def twin(scene: Scene, method: str, step: float, **options) -> Simulator:
    return Simulator(scene, dynamics="rigid", integrator=method, step=step, **options)


def final(scene: Scene, method: str, step: float, seconds: float) -> Simulator:
    simulator = twin(scene, method, step)
    simulator.advance(round(seconds / step), check=False)
    return simulator


# --- Mass properties ----------------------------------------------------------------------------------


def test_moments_of_the_paper_s_top_about_its_tip_and_its_axis_is_the_third() -> None:
    shape = rigid.principal_shape(Scene(TOP, pinned=(TIP,)))
    theory = heavy_top.cone_top_inertia(12.0, 0.5, 1.0)
    np.testing.assert_allclose(shape.moments, [theory.i1, theory.i1, theory.i3], rtol=1e-14)
    assert shape.moments[0] == shape.moments[1]  # to the bit: nothing is split off
    np.testing.assert_allclose(np.abs(shape.triad(TOP.markers)[2]), [0, 0, 1], atol=1e-15)


@pytest.mark.parametrize("sides", [(1.0, 0.98, 0.2), (1.0, 0.3, 0.28)])
def test_shape_is_principal_right_handed_and_pairs_the_closest_moments(sides: tuple[float, ...]) -> None:
    body = box(sides, mass=BRICK.masses)
    shape = rigid.principal_shape(Scene(body))
    r = shape.positions
    m = body.masses
    tensor = np.sum(m * (r * r).sum(axis=1)) * np.eye(3) - (m * r.T) @ r
    np.testing.assert_allclose(tensor, np.diag(shape.moments), atol=1e-15)
    np.testing.assert_allclose(m @ r, 0.0, atol=1e-15)
    before = body.positions - body.centre
    assert np.linalg.det(before[:3]) * np.linalg.det(r[:3]) > 0
    apart = np.abs(np.diff(1 / np.append(shape.moments, shape.moments[0])))
    assert apart[0] == apart.min()


@pytest.mark.parametrize("also", [(), ("masses",)], ids=["alone", "and masses"])
@pytest.mark.parametrize(("body", "pinned"), [(BRICK, ()), (TOP, (TIP,))], ids=["brick", "top"])
def test_a_copy_of_another_size_is_another_body(body: Body, pinned: tuple[int, ...], also: tuple) -> None:
    """It moves as a scene of the larger body does; a couple turns it 1/s² as fast, as I is Σ m r²."""
    sizes = np.array([0.5, 1.0, 2.0])
    seconds = 0.5
    options = {"dynamics": "rigid", "integrator": "suzuki", "step": 5e-3}
    scene = Scene(body, pinned=pinned, gravity=WEIGHTLESS, wrench=WrenchActuator())
    simulator = Simulator(scene, copies=3, varying=("lengths", *also), **options)
    given = {name: np.tile(body.masses, (3, 1)) for name in also}
    simulator.vary(None, lengths=sizes[:, None] * body.lengths, **given)
    pivot = body.positions[pinned[0]] if pinned else body.centre
    x = pivot + sizes[:, None, None] * (body.positions - pivot)
    simulator.place(x, np.zeros_like(x))
    ones = []
    for place in x:
        larger = body.with_(positions=place, lengths=None)
        ones.append(Simulator(scene.with_(body=larger, positions=place), **options))
    for each in (simulator, *ones):
        each.actuate(torque=np.array([0.02, 0.05, 0.03]), force=np.zeros(3))
        each.advance(2)
    early = simulator.measure().angular_velocity
    np.testing.assert_allclose(early * sizes[:, None] ** 2, np.tile(early[1], (3, 1)), rtol=1e-3)
    for each in (simulator, *ones):
        each.advance(round(seconds / 5e-3))
    for n, one in enumerate(ones):
        np.testing.assert_allclose(simulator.positions[n], one.positions[0], rtol=0, atol=1e-12)
        np.testing.assert_allclose(simulator.velocities[n], one.velocities[0], rtol=0, atol=1e-12)
    assert simulator.measure().strain.max() < 1e-12
    assert simulator.state().keys() == simulator.state([0]).keys()


def test_a_rigid_body_is_larger_as_a_whole_or_not_at_all() -> None:
    simulator = Simulator(Scene(BRICK), dynamics="rigid", copies=2, varying=("lengths",))
    before = pickle.dumps(simulator.state())
    with pytest.raises(ValueError, match=r"lengths of body 'box' in copy 1 are not .* times one factor"):
        simulator.vary([1], lengths=BRICK.lengths * np.linspace(1, 1.1, len(BRICK.lengths)))
    assert pickle.dumps(simulator.state()) == before


# --- Theory -------------------------------------------------------------------------------------------


def top_in_theory(t: float) -> tuple[np.ndarray, np.ndarray]:
    """A fast top released at rest: cusps."""
    theory = heavy_top.cone_top_inertia(12.0, 0.5, 1.0)
    motion = heavy_top.motion(theory, heavy_top.TopState(theta=0.4, omega3=40.0), np.array([t]))
    return carry(motion.attitude[0], motion.omega_world[0], TOP.positions)


def cube_in_theory(t: float) -> tuple[np.ndarray, np.ndarray]:
    """The cube on a vertex, swinging from 2.5 rad."""
    body = cube(damping=0.0)
    at = pendulum.cube_on_vertex(1.0, 1.0)
    theta, rate = pendulum.motion(at.i1, at.mgl, 2.5, 0.0, np.array([t]))
    down = start(body, tilt=np.pi, pinned=(0,), stretched=False).positions
    x = down @ rotation((0, 1, 0), -theta[0]).T
    return x, rigid_velocities(x, (0, -rate[0], 0), WEIGHTLESS)


def brick_in_theory(t: float) -> tuple[np.ndarray, np.ndarray]:
    """A box thrown with spin close to its middle axis: it flips."""
    moments, axes = BRICK.principal()
    motion = free_body.motion(moments, [0.1, 5.0, 0.2], np.array([t]), axes)
    x, v = carry(motion.attitude[0] @ axes.T, motion.omega_world[0], BRICK.positions - BRICK.centre)
    thrown = np.array([1.0, 2.0, 3.0])
    return x + t * thrown, v + thrown


PROBLEMS = {
    "top": (TOP, (TIP,), GRAVITY, top_in_theory),
    "cube": (cube(damping=0.0), (0,), GRAVITY, cube_in_theory),
    "brick": (BRICK, (), WEIGHTLESS, brick_in_theory),
}


@pytest.mark.parametrize(
    ("problem", "method", "step"),
    [
        ("top", "verlet", 2e-5),
        ("top", "kahan_li", 0.02),
        *((problem, "suzuki", 5e-3) for problem in PROBLEMS),
    ],
)
def test_error_against_theory_stays_below_1e_8_for_10_seconds(problem: str, method: str, step: float) -> None:
    body, pinned, gravity, theory = PROBLEMS[problem]
    x, v = theory(0.0)
    v[list(pinned)] = 0.0
    simulator = final(Scene(body, x, v, pinned, gravity), method, step, 10.0)
    x, v = theory(10.0)
    moved = np.abs(x - theory(0.0)[0]).max()
    assert moved > 0.1
    np.testing.assert_allclose(simulator.positions[0], x, atol=1e-8)
    np.testing.assert_allclose(simulator.velocities[0], v, atol=1e-8 * 50)


def test_a_free_symmetric_body_is_exact_for_every_step() -> None:
    """Steps of 0.7 s turn it by 30 rad: nothing is left of the step but round-off of the angle."""
    moments, axes = TOP.principal()
    omega = np.array([12.0, -5.0, 40.0])
    times = np.array([0.0, 7.0])
    r = TOP.positions - TOP.centre
    motion = free_body.motion(moments, omega, times, axes)
    (first, v), (last, _) = (carry(motion.attitude[n] @ axes.T, motion.omega_world[n], r) for n in range(2))
    simulator = final(Scene(TOP, first, v, gravity=WEIGHTLESS), "verlet", 0.7, 7.0)
    assert np.abs(last - first).max() > 0.1
    np.testing.assert_allclose(simulator.positions[0], last, atol=1e-11)


# --- Order, with everything that acts -----------------------------------------------------------------

FORCE = np.array([5.0, -3.0, 4.0])
TORQUE = np.array([6.0, 9.0, 7.0])
BODY_TORQUE = np.array([2.0, 1.0, 3.0])
THRUST = np.array([[4.0, 2.0, -1.0], [-3.0, 1.0, 2.0]])


def driven(pinned: bool, turns: bool = True, perpendicular: bool = True) -> Scene:
    """An asymmetric top under gravity, a wrench and thrusts."""
    held = (TIP,) if pinned else ()
    began = start(UNBALANCED, tilt=0.5, spin=15.0, omega=(1, -2, 0.5), pinned=held, stretched=False)
    return Scene(
        UNBALANCED,
        *began,
        pinned=held,
        wrench=WrenchActuator(perpendicular),
        thrust=ThrustActuator((CROWN, 3), turns),
    )


def drive(simulator: Simulator) -> None:
    copies = simulator.copies
    simulator.actuate(
        force=np.tile(FORCE, (copies, 1)),
        torque=np.tile(TORQUE, (copies, 1)),
        body_torque=np.tile(BODY_TORQUE, (copies, 1)),
        thrust=np.tile(THRUST, (copies, 1, 1)),
    )


def driven_reference(scene: Scene, seconds: float) -> np.ndarray:
    """Positions by Newton's and Euler's equations in the world frame, DOP853 at 1e-13."""
    body = scene.body
    held = bool(scene.pinned)
    shape = scene.positions - (scene.positions[TIP] if held else body.masses @ scene.positions / body.mass)
    m = body.masses
    g = np.asarray(scene.gravity)
    centre = m @ shape / body.mass
    tensor = np.sum(m * (shape * shape).sum(axis=1)) * np.eye(3) - (m * shape.T) @ shape
    i, j, k = body.markers
    e3 = (shape[j] - shape[i]) / np.linalg.norm(shape[j] - shape[i])
    e1 = shape[k] - shape[i] - (shape[k] - shape[i]) @ e3 * e3
    e1 /= np.linalg.norm(e1)
    axes = np.column_stack([e1, np.cross(e3, e1), e3])

    def slope(_: float, y: np.ndarray) -> np.ndarray:
        turn = y[:9].reshape(3, 3)
        spin = y[9:12]
        momentum = y[15:18]
        third = turn @ axes[:, 2]
        torque = TORQUE - scene.wrench.perpendicular * (TORQUE @ third) * third
        torque = torque + turn @ axes @ BODY_TORQUE
        forces = THRUST @ (turn @ axes).T if scene.thrust.turns else THRUST
        torque = torque + np.cross(shape[list(scene.thrust.particles)] @ turn.T, forces).sum(axis=0)
        force = FORCE + body.mass * g
        if held:
            torque = torque + np.cross(turn @ centre, force)
        force = force + forces.sum(axis=0)
        w = turn @ np.linalg.solve(tensor, turn.T @ spin)
        rates = np.cross(w, turn.T).T
        velocity = WEIGHTLESS if held else momentum / body.mass
        return np.concatenate([rates.ravel(), torque, velocity, force])

    spin = m @ np.cross(shape, scene.velocities - (0 if held else m @ scene.velocities / body.mass))
    first = np.concatenate([np.eye(3).ravel(), spin, scene.positions[0] - shape[0], m @ scene.velocities])
    solution = solve_ivp(slope, (0.0, seconds), first, method="DOP853", rtol=1e-13, atol=1e-13).y[:, -1]
    return solution[12:15] + shape @ solution[:9].reshape(3, 3).T


@pytest.mark.parametrize(
    ("pinned", "turns", "perpendicular"),
    slow_but(
        [(True, True, False), (False, False, True), (True, False, True), (False, True, True)],
        (True, True, False),
        (False, False, True),
    ),
)
def test_gravity_wrench_and_thrust_are_those_of_newton_and_euler(
    pinned: bool, turns: bool, perpendicular: bool
) -> None:
    scene = driven(pinned, turns, perpendicular)
    simulator = twin(scene, "kahan_li", 2.5e-3)
    drive(simulator)
    simulator.advance(200, check=False)
    reference = driven_reference(scene, 0.5)
    assert np.abs(reference - scene.positions).max() > 0.3
    np.testing.assert_allclose(simulator.positions[0], reference, atol=1e-10)


@pytest.mark.parametrize("method", rigid.METHODS)
def test_fitted_order_is_the_declared_one_for_motion_and_energy_balance(method: str) -> None:
    order = rigid.METHODS[method].record.order
    scene = driven(pinned=True)
    seconds = 0.4
    exact = driven_reference(scene, seconds)
    steps = np.array([16, 24, 32]) * (8 if order == 2 else 1)
    errors = []
    for count in steps:
        simulator = twin(scene, method, seconds / count)
        drive(simulator)
        before = simulator.measure().balance[0]
        simulator.advance(int(count), check=False)
        imbalance = abs(simulator.measure().balance[0] - before)
        errors.append((np.abs(simulator.positions[0] - exact).max(), imbalance))
        assert abs(simulator.measure().work[0]) > 10
    slopes = -np.polyfit(np.log(steps), np.log(errors), 1)[0]
    np.testing.assert_allclose(slopes, order, atol=0.1)


# --- Invariants ---------------------------------------------------------------------------------------


def test_free_body_keeps_angular_momentum_and_shape_to_round_off_and_energy_without_trend() -> None:
    scene = Scene(BRICK, *start(BRICK, omega=(0.3, 6.0, 0.4), stretched=False), gravity=WEIGHTLESS)
    simulator = twin(scene, "verlet", 0.02)
    first = simulator.measure()
    energies = []
    for _ in range(100):
        simulator.advance(1000, check=False)
        energies.append(simulator.measure().kinetic[0])
    last = simulator.measure()
    scale = np.linalg.norm(first.angular_momentum)
    np.testing.assert_allclose(last.angular_momentum, first.angular_momentum, atol=1e-10 * scale)
    assert last.strain[0] < 1e-14
    drift = np.abs(np.array(energies) / first.kinetic - 1)
    assert 1e-9 < drift.max() < 2e-3  # (ω h)²/8 of it moves to and fro
    assert abs(np.mean(energies[:50]) - np.mean(energies[50:])) < 0.2 * np.ptp(energies)


def test_pinned_body_keeps_vertical_angular_momentum_to_round_off() -> None:
    scene = Scene(TOP, *start(TOP, tilt=0.5, spin=20.0, pinned=(TIP,), stretched=False), pinned=(TIP,))
    simulator = twin(scene, "verlet", 1e-3)
    first = simulator.measure().angular_momentum[0]
    simulator.advance(20000, check=False)
    last = simulator.measure().angular_momentum[0]
    assert np.linalg.norm(last - first) > 1.0
    np.testing.assert_allclose(last[2], first[2], rtol=1e-11)
    np.testing.assert_array_equal(simulator.positions[0, TIP], scene.positions[TIP])
    np.testing.assert_array_equal(simulator.velocities[0, TIP], 0.0)


def test_placing_takes_over_momenta_centre_and_triad_of_a_deformed_body_and_leaves_the_others_alone() -> None:
    simulator = twin(driven(pinned=False), "suzuki", 1e-3, copies=11)
    simulator.advance(7, check=False)
    before = simulator.positions, simulator.velocities
    rng = np.random.default_rng(1)
    x = UNBALANCED.positions + 1e-3 * rng.standard_normal(UNBALANCED.positions.shape)
    v = rng.standard_normal(x.shape)
    simulator.place(x, v, copies=np.array([9, 2]))
    m = UNBALANCED.masses
    measures = simulator.measure()
    centre = m @ x / m.sum()
    for copy in (2, 9):
        np.testing.assert_allclose(measures.momentum[copy], m @ v, rtol=1e-13)
        np.testing.assert_allclose(measures.centre[copy], centre, rtol=1e-13)
        np.testing.assert_allclose(measures.angular_momentum[copy], m @ np.cross(x - centre, v), rtol=1e-12)
        assert measures.strain[copy] < 1e-14
        axis = x[CROWN] - x[TIP]
        np.testing.assert_allclose(measures.axis[copy], axis / np.linalg.norm(axis), rtol=1e-13)
    others = np.setdiff1d(np.arange(11), [2, 9])
    np.testing.assert_array_equal(simulator.positions[others], before[0][others])
    np.testing.assert_array_equal(simulator.velocities[others], before[1][others])


# --- Against the springs ------------------------------------------------------------------------------


def gap(
    body: Body, stiffness: float, pinned: tuple[int, ...], gravity: tuple[float, ...], how: dict
) -> float:
    """Largest distance of a particle from its place in the twin within half a second [m]."""
    stiff = body.with_(stiffness=np.full(len(body.springs), stiffness))
    began = start(stiff, pinned=pinned, gravity=gravity, **how)
    scene = Scene(stiff, *began, pinned=pinned, gravity=gravity)
    rate = 2 * np.pi * np.sqrt(stiffness)
    h = 0.05 / np.ceil(0.05 * rate / (1.0 if body.mass > 5 else 0.4))
    springs = Simulator(scene, step=h)
    solid = twin(scene, "kahan_li", 0.005)
    apart = 0.0
    for _ in range(10):
        springs.advance(round(0.05 / h), check=False)
        solid.advance(10, check=False)
        distance = np.linalg.norm(springs.positions - solid.positions, axis=-1).max()
        apart = max(apart, float(distance))
    return apart


@pytest.mark.parametrize(
    ("body", "pinned", "gravity", "how"),
    [
        pytest.param(TOP, (TIP,), GRAVITY, {"tilt": 0.4, "spin": 40.0}, id="top", marks=pytest.mark.slow),
        pytest.param(cube(damping=0.0), (0,), GRAVITY, {"tilt": 2.0}, id="cube", marks=pytest.mark.slow),
        pytest.param(BRICK, (), WEIGHTLESS, {"omega": (1.0, 4.0, 0.5)}, id="brick"),
    ],
)
def test_springs_approach_their_twin_as_one_over_stiffness(body, pinned, gravity, how) -> None:
    stiffness = np.array([1e5, 1e6, 1e7, 1e8])
    gaps = [gap(body, k, pinned, gravity, how) for k in stiffness]
    slope = np.polyfit(np.log(stiffness), np.log(gaps), 1)[0]
    assert gaps[0] > 1e-6
    assert slope == pytest.approx(-1.0, abs=0.02)


@pytest.mark.parametrize("turns", [True, False])
@pytest.mark.parametrize("pinned", [True, False])
def test_actuators_change_momenta_as_they_do_on_springs(pinned: bool, turns: bool) -> None:
    scene = driven(pinned, turns)
    both = Simulator(scene, step=1e-6), twin(scene, "verlet", 1e-6)
    changes = []
    for simulator in both:
        drive(simulator)
        first = simulator.measure()
        simulator.advance(20, check=False)
        last = simulator.measure()
        spin = last.angular_momentum - first.angular_momentum
        push = np.zeros(3) if pinned else last.momentum - first.momentum
        changes.append(np.concatenate([spin[0], np.ravel(push), last.work]))
    np.testing.assert_allclose(changes[0][:6], changes[1][:6], rtol=1e-6, atol=1e-9)
    # Springs released unstretched let go at ω² r: over t = 2e-5 s, ½ ω² r t² F of work, 60 m/s² · t² · 15 N.
    assert changes[0][6] == pytest.approx(changes[1][6], abs=4e-7)


@pytest.mark.own_kernels
@pytest.mark.slow
def test_every_copy_has_the_bits_of_a_single_one_for_all_threads() -> None:
    single, batch, threaded = (
        twin(driven(pinned=True), "suzuki", 2e-3, copies=n, threads=k) for n, k in ((1, 1), (19, 1), (19, 2))
    )
    for simulator in (single, batch, threaded):
        drive(simulator)
        simulator.advance(50, check=False)
    for copies in (batch, threaded):
        for name in ("positions", "velocities"):
            expected = np.repeat(getattr(single, name), 19, axis=0)
            np.testing.assert_array_equal(getattr(copies, name), expected)
        np.testing.assert_array_equal(copies.measure().work, np.repeat(single.measure().work, 19))


@pytest.mark.slow
def test_copies_with_masses_of_their_own_move_as_bodies_of_those_masses() -> None:
    masses = UNBALANCED.masses * np.linspace(1.0, 2.0, 14)
    scene = driven(pinned=True)
    batch = twin(scene, "suzuki", 2e-3, copies=3, varying=("masses",))
    batch.vary(np.array([1]), masses=masses)
    batch.place(scene.positions, scene.velocities)
    drive(batch)
    batch.advance(50, check=False)
    for copy, body in ((0, UNBALANCED), (1, UNBALANCED.with_(masses=masses))):
        single = twin(scene.with_(body=body), "suzuki", 2e-3)
        drive(single)
        single.advance(50, check=False)
        np.testing.assert_allclose(batch.positions[copy], single.positions[0], rtol=1e-12, atol=1e-13)


def test_state_survives_restoring_and_pickling() -> None:
    simulator = twin(driven(pinned=True), "suzuki", 2e-3)
    drive(simulator)
    simulator.advance(10, check=False)
    state = simulator.state()
    copy = pickle.loads(pickle.dumps(simulator))
    simulator.advance(10, check=False)
    expected = simulator.positions
    simulator.restore(state)
    for again in (simulator, copy):
        again.advance(10, check=False)
        np.testing.assert_array_equal(again.positions, expected)


# --- Steps and refusals -------------------------------------------------------------------------------


def test_automatic_step_follows_the_start() -> None:
    still = Scene(TOP, pinned=(TIP,))
    spun = Scene(TOP, *start(TOP, spin=100.0, pinned=(TIP,), stretched=False), pinned=(TIP,))
    assert plan_steps(still, dynamics="rigid").step == rigid.LONGEST
    assert plan_steps(spun, dynamics="rigid").step == pytest.approx(rigid.TURN / 100.0)
    assert plan_steps(Scene(BRICK, gravity=None), dynamics="rigid").step == rigid.LONGEST


def test_a_step_beyond_the_limit_of_the_swing_is_refused_and_one_below_it_is_stable() -> None:
    hanging = Scene(TOP, *start(TOP, tilt=np.pi - 1e-3, pinned=(TIP,), stretched=False), pinned=(TIP,))
    for method in rigid.METHODS:
        limit = rigid.largest_step(hanging, rigid.integrator(method))
        with pytest.raises(ValueError, match="unstable"):
            twin(hanging, method, 1.01 * limit)
        simulator = twin(hanging, method, 0.99 * limit)
        simulator.advance(1000, check=False)
        assert simulator.measure().axis[0, 2] < -0.9


ABOVE = Scene(cube(), np.add(cube().positions, (0, 0, 1)), surfaces=(floor(),))
LINE = Body("dumbbell", np.array([(0, 0, 0), (1, 0, 0)]), 1.0, [(0, 1)], 1e5, 0.0)


@pytest.mark.parametrize(
    ("scene", "options", "reason"),
    [
        (Scene(rope(), pinned=(0,)), {}, "no rigid twin"),
        (Scene(LINE), {}, "one line"),
        (Scene(BRICK.with_(markers=(0, 1, 0))), {}, "markers"),
        (Scene(BRICK, pinned=(0, 1)), {}, "pin one particle"),
        (Scene(BRICK, pinned=(0,), drive=DriveActuator(0, 1.0)), {}, "cannot have a drive"),
        (Scene(BRICK), {"integrator": "rk4"}, "'rk4' for rigid dynamics"),
        (ABOVE, {"integrator": "suzuki"}, "back in time"),
        (ABOVE.with_(contact=PaperContact()), {}, "the paper's contact"),
        (Scene(BRICK), {"dynamics": "stiff"}, "dynamics is 'stiff'; it must be one of 'springs', 'rigid'"),
    ],
)
def test_what_has_no_rigid_twin_is_refused_with_the_reason(scene: Scene, options: dict, reason: str) -> None:
    with pytest.raises(ValueError, match=reason):
        Simulator(scene, **{"dynamics": "rigid", **options})


def on_a_line(simulator: Simulator) -> None:
    line = np.arange(8)[:, None] * np.array([1.0, 1e-12, 0.0])
    simulator.place(line[None], np.zeros((1, 8, 3)), [1])


def two_masses(simulator: Simulator) -> None:
    simulator.vary([1], masses=np.where(np.arange(8) < 2, 1.0, 1e-17))


@pytest.mark.parametrize(
    ("change", "reason"), [(on_a_line, "on one line in copy 1"), (two_masses, "no moment of inertia")]
)
@pytest.mark.slow
def test_what_leaves_no_orientation_or_no_moment_changes_nothing(change, reason: str) -> None:
    """Rounding decides: the particles are not quite on one line, and every mass is positive."""
    simulator = Simulator(Scene(cube(), gravity=None), copies=3, dynamics="rigid", varying=("masses",))
    before = pickle.dumps(simulator.state())
    with pytest.raises(ValueError, match=reason):
        change(simulator)
    assert pickle.dumps(simulator.state()) == before
