"""Scenes of several bodies: each is what it would be alone, to the bit, and is named in all that is said."""

from __future__ import annotations

import copy
import pickle
from dataclasses import replace

import numpy as np
import pytest

import springgym
from springgym.dynamics import methods as integrators
from springgym.dynamics import rigid
from springgym.model.bodies import Body, box, cube, gyroscope, rope, start, top
from springgym.model.scene import DriveActuator, Placed, Scene, ThrustActuator, WrenchActuator
from springgym.model.surfaces import Bowl, Contact, PaperContact, floor
from springgym.simulator import Simulator
from tests.params import slow_but

TOP = top()
TIP = TOP.particle("tip")
VARYING = ("masses", "stiffness", "damping", "gravity", "friction", "strength", "restitution")
"""Damping, too: so the cube has idle dampers alone as well, which among surfaces are rounded, see
`tests.test_features`."""


def tops(body: Body) -> Scene:
    """Two tops, turned and spun differently, with actuators."""
    placed = []
    for name, tilt, spin, aside in (("left", 0.3, 20.0, 0.0), ("right", 0.5, -30.0, 3.0)):
        x, v = start(body, tilt=tilt, spin=spin, position=(aside, 0, 0), pinned=(TIP,))
        actuators = {"wrench": WrenchActuator(), "thrust": ThrustActuator((0, 1))}
        placed.append(Placed(body, x, v, pinned=(TIP,), name=name, **actuators))
    return Scene(bodies=tuple(placed), collisions=None)


def zoo() -> Scene:
    """Five bodies of different kinds on a floor: pinned, free, floppy, driven, undamped."""
    x, v = start(TOP, tilt=0.3, spin=20.0, position=(0, 0, 1.0), pinned=(TIP,))
    line = rope(beads=6)
    free = {"cube": cube(damping=0.0), "box": box((1, 0.7, 0.4), mass=2.0), "gyroscope": gyroscope()}
    lifted = {
        name: np.add(body.positions, (3.0 * n, 0.0, 0.05 - body.positions[:, 2].min()))
        for n, (name, body) in enumerate(free.items())
    }
    return Scene(
        bodies=(
            Placed(TOP, x, v, pinned=(TIP,), wrench=WrenchActuator()),
            Placed(free["cube"], lifted["cube"], np.ones((8, 3))),
            Placed(free["box"], lifted["box"], thrust=ThrustActuator((1,), turns=True)),
            Placed(line, np.add(line.positions, (0, 0, 9.0)), pinned=(0,), drive=DriveActuator(0, 2.0)),
            Placed(free["gyroscope"], lifted["gyroscope"], wrench=WrenchActuator(perpendicular=True)),
        ),
        surfaces=(floor(),),
        contact=Contact(friction=0.3, restitution=0.7),
        collisions=None,
    )


def assert_each_as_alone(scene: Scene, steps: tuple[int, ...] = (7, 13), **options) -> Simulator:
    """Each body of a scene does to the bit what it does alone, and is measured so."""
    both = Simulator(scene, **options)
    options = {**options, "step": both.step}
    alone = [Simulator(part, **options) for part in scene.parts]
    values = {"force": (1.0, 2.0, 3.0), "torque": (0.3, 0.2, 0.1), "acceleration": (0.5, 0.0, 0.2)}
    for n, (placed, own) in enumerate(zip(scene.bodies, alone, strict=True)):
        given = {name: np.add(n, values[name]) for name in own._actuators if name in values}
        if placed.thrust:
            given["thrust"] = np.full((len(placed.thrust.particles), 3), 0.1 + n)
        own.actuate(**given)
        both.actuate(**{f"{placed.name}.{name}": value for name, value in given.items()})
    if options.get("varying"):
        masses = 1.1 * scene.masses
        shared = {"friction": 0.2, "restitution": 0.5, "gravity": (0.0, 0.1, -9.0)}
        shared = {name: value for name, value in shared.items() if name in options["varying"]}
        strengths = {"strength": np.arange(1.0, 1 + len(alone))} if "strength" in options["varying"] else {}
        both.vary([0], masses=masses, **strengths, **shared)
        for n, (own, where) in enumerate(zip(alone, scene.slices, strict=True)):
            strength = {name: values[n] for name, values in strengths.items()}
            own.vary([0], masses=masses[where], **strength, **shared)
    for count in steps:
        both.advance(count)
        for own in alone:
            own.advance(count)
    for n, (own, where) in enumerate(zip(alone, scene.slices, strict=True)):
        assert np.abs(own.positions - scene.parts[n].positions).max() > 1e-9
        np.testing.assert_array_equal(both.positions[:, where], own.positions)
        np.testing.assert_array_equal(both.velocities[:, where], own.velocities)
        for name, here, there in zip(own.measure()._fields, both.measure(n), own.measure(), strict=True):
            np.testing.assert_array_equal(here, there, err_msg=name)
    return both


STEP = 2e-4
"""[s] Of scenes that share code: dampers act at every step."""


PAIRS = [
    *({"integrator": name, "step": STEP} for name in integrators.METHODS),
    *({"integrator": name, "step": 1e-3, "dynamics": "rigid"} for name in rigid.METHODS),
    {"step": STEP, "copies": 5, "dtype": np.float32},
]


@pytest.mark.parametrize("options", slow_but(PAIRS, PAIRS[0]), ids=str)
def test_two_tops_in_one_scene_are_two_scenes_of_one(options) -> None:
    backward = (
        "dynamics" not in options
        and integrators.integrator(options.get("integrator", "verlet")).negative_substeps
    )
    assert_each_as_alone(tops(TOP.with_(damping=0.0) if backward else TOP), **options)


@pytest.mark.slow
def test_five_kinds_of_bodies_on_a_floor_are_five_scenes_of_one() -> None:
    together = assert_each_as_alone(zoo(), (100, 1000), varying=VARYING)
    assert (together.measure().contact_loss > 0).all()
    assert_each_as_alone(zoo(), (300,), varying=VARYING, copies=20, threads=2)


@pytest.mark.slow
def test_bodies_in_a_bowl_and_of_the_paper_s_contact_are_scenes_of_one() -> None:
    balls = tuple(
        Placed(Body(f"ball {n}", [[0.25 * n, 0, 0.2]], 0.1 + n, [], 1e5, 0.0), name=f"{n}") for n in range(3)
    )
    contact = Contact(strength=0.05, reach=0.02, friction=0.1)
    bowl = (Bowl((0, 0, 1), 1.0),)
    assert_each_as_alone(Scene(bodies=balls, surfaces=bowl, contact=contact, collisions=None), (2000,))
    paper = PaperContact(0.3, 1.0)
    cubes = Scene(bodies=zoo().bodies[1:3], surfaces=(floor(),), contact=paper, collisions=None)
    assert_each_as_alone(cubes, (3000,), integrator="rk4")


def test_measures_of_all_bodies_are_sums_of_those_of_each() -> None:
    left, right = tops(TOP).bodies
    loose = replace(right, pinned=(), name="loose")
    simulator = assert_each_as_alone(Scene(bodies=(left, loose), collisions=None), (300,), step=STEP)
    whole = simulator.measure()
    each = [simulator.measure(placed.name) for placed in simulator.scene.bodies]
    for name in ("kinetic", "gravity", "elastic", "contact", "momentum", "work", "energy", "balance"):
        total = sum(getattr(m, name) for m in each)
        np.testing.assert_allclose(getattr(whole, name), total, rtol=1e-12, atol=1e-9)
    np.testing.assert_array_equal(whole.strain, np.max([m.strain for m in each], axis=0))
    mass = np.array([placed.body.mass for placed in simulator.scene.bodies])
    centre = mass @ [m.centre[0] for m in each] / mass.sum()
    np.testing.assert_allclose(whole.centre[0], centre, rtol=1e-12)
    # Koenig: the spins, and what the centres of mass carry about the common one
    carried = 0.0
    for placed, m, own in zip(simulator.scene.bodies, each, simulator.scene.slices, strict=True):
        about = m.centre[0] if placed.pivot < 0 else simulator.positions[0, own.start + placed.pivot]
        carried += m.angular_momentum[0] + np.cross(about - centre, m.momentum[0])
    np.testing.assert_allclose(whole.angular_momentum[0], carried, rtol=1e-10)
    assert not np.any([whole.axis, whole.side])


@pytest.mark.parametrize("copies", [1, pytest.param(3, marks=pytest.mark.slow)])
def test_states_and_copies_of_a_simulator_go_on_to_the_bit(copies: int) -> None:
    made = [Simulator(tops(TOP), step=STEP, copies=copies) for _ in range(2)]
    simulator = made[0]
    simulator.actuate(**{"left.force": (1.0, 2.0, 3.0)})
    simulator.advance(10)
    state = simulator.state()
    others = [copy.deepcopy(simulator), pickle.loads(pickle.dumps(simulator)), made[1]]
    others[-1].restore(state)
    simulator.advance(10, read=True)
    for other in others:
        other.advance(10, read=True)
        np.testing.assert_array_equal(other.positions, simulator.positions)
        np.testing.assert_array_equal(other.readout.bodies, simulator.readout.bodies)


def test_what_bodies_have_lies_one_body_after_another() -> None:
    scene = zoo()
    x = scene.positions
    for placed, own in zip(scene.bodies, scene.slices, strict=True):
        np.testing.assert_array_equal(x[own], placed.positions)
        np.testing.assert_array_equal(scene.masses[own], placed.body.masses)
    first = 0
    for name in ("stiffness", "damping", "lengths"):
        joined = scene.of_bodies(name)
        assert len(joined) == len(scene.springs)
    for placed, own in zip(scene.bodies, scene.slices, strict=True):
        mine = slice(first, first + len(placed.body.springs))
        np.testing.assert_array_equal(scene.springs[mine] - own.start, placed.body.springs)
        np.testing.assert_array_equal(scene.of_bodies("lengths")[mine], placed.body.lengths)
        first = mine.stop


def test_bodies_without_a_name_of_their_own_are_numbered() -> None:
    apart = [Placed(cube(), cube().positions + 3.0 * n) for n in range(3)]
    other = Placed(TOP, TOP.positions + 9.0)
    names = [placed.name for placed in Scene(bodies=(apart[0], other, *apart[1:])).bodies]
    assert names == ["cube0", "top", "cube1", "cube2"]
    scene = Scene(bodies=(replace(apart[0], name="left"), apart[1]))
    assert [placed.name for placed in scene.bodies] == ["left", "cube"]
    nameless = Placed(Body("", [[0, 0, 5.0]], 1.0, [], 1e5, 0.0))
    scene = Scene(bodies=(*apart, nameless), collisions=None)
    assert [placed.name for placed in scene.bodies] == ["cube0", "cube1", "cube2", "body0"]
    assert [placed.name for placed in scene.with_(gravity=None).bodies] == [
        "cube0",
        "cube1",
        "cube2",
        "body0",
    ]
    assert scene.number("cube1") == 1
    with pytest.raises(ValueError, match="both called 'cube0'"):
        Scene(bodies=(replace(apart[0], name="cube0"), *apart[1:]))


def test_many_bodies_are_told_by_their_kinds() -> None:
    cubes = [Placed(cube(), cube().positions + 3.0 * n, name=f"c{n}") for n in range(20)]
    few = repr(Scene(bodies=tuple(cubes), collisions=None))
    assert "c7: Body('cube'" in few
    assert "×" not in few
    many = repr(Scene(bodies=(*cubes, Placed(TOP, TOP.positions - 9.0, pinned=(TIP,))), collisions=None))
    assert many.startswith("Scene(20 × Body('cube'")
    assert " | 1 × Body('top'" in many
    assert f"pinned {TIP}" in many


def test_one_body_is_the_short_form() -> None:
    placed = Placed(TOP, pinned=(TIP,), wrench=WrenchActuator())
    short = Scene(TOP, pinned=(TIP,), wrench=WrenchActuator())
    long = Scene(bodies=(placed,))
    assert repr(short) == repr(long)
    assert long.body is TOP
    assert short.parts == (short,)
    assert long.with_(pinned=()).bodies[0].pinned == ()
    assert replace(long, pinned=()).bodies[0].pinned == ()
    assert replace(long, gravity=None).pinned == (TIP,)
    moved = replace(long, positions=TOP.positions + 1.0)
    np.testing.assert_array_equal(moved.positions, TOP.positions + 1.0)
    assert moved.pinned == (TIP,)
    simulator = Simulator(long)
    simulator.advance(3, read=True)
    assert np.shares_memory(simulator.readout.rows, simulator.readout.bodies)


MOVED = Placed(TOP, TOP.positions + 5.0, pinned=(TIP,))


@pytest.mark.parametrize(
    ("make", "error", "says"),
    [
        (
            lambda: Scene(bodies=(Placed(TOP, name="a"), Placed(TOP, name="a"))),
            ValueError,
            r"both called 'a'",
        ),
        (lambda: Scene(bodies=(Placed(TOP), Placed(cube(), name="a.b"))), ValueError, "without a dot"),
        (lambda: Scene(cube(), bodies=(Placed(TOP),)), ValueError, "body is given as well as bodies"),
        (lambda: Scene(TOP, bodies=(MOVED,)), ValueError, "body is given as well as bodies; .* with_"),
        (lambda: Scene(TOP, pinned=(1,), bodies=(MOVED,)), ValueError, "body is given as well as bodies"),
        (lambda: Scene(bodies=(Placed(TOP),), pinned=(1,)), ValueError, "pinned is given as well as bodies"),
        (lambda: Scene(), TypeError, "body is None"),
        (lambda: Scene(bodies=5), TypeError, "bodies is 5"),
        (lambda: Scene(bodies=(TOP,)), TypeError, r"bodies\[0\] is Body"),
        (lambda: Placed(TOP, name=3), TypeError, "name is 3"),
        (lambda: tops(TOP).number("middle"), ValueError, "'left', 'right'"),
        (lambda: tops(TOP).number(None), ValueError, "body is None"),
        (lambda: tops(TOP).number(2), ValueError, "body is 2"),
        (lambda: tops(TOP).number(True), TypeError, "body is True"),
        (lambda: tops(TOP).of_bodies("weights"), ValueError, "name is 'weights'"),
        (lambda: tops(TOP).of_bodies("name"), ValueError, "name is 'name'"),
        (lambda: tops(TOP).of_bodies(3), TypeError, "name is 3"),
        (lambda: Simulator(tops(TOP)).actuate(force=(1, 2, 3)), ValueError, "no actuator for 'force'"),
        (lambda: Simulator(tops(TOP)).measure("middle"), ValueError, "body is 'middle'"),
        (lambda: Simulator(tops(TOP)).place(TOP.positions, TOP.positions), ValueError, "positions"),
        (lambda: zoo().with_(surfaces=(floor(0.6),)), ValueError, "of 'cube' starts"),
        (
            lambda: tops(TOP).check_start(tops(TOP).positions, np.ones((28, 3))),
            ValueError,
            "body 'left': pinned particle 13",
        ),
        (
            lambda: Simulator(Scene(bodies=(Placed(TOP), Placed(rope())), collisions=None), dynamics="rigid"),
            ValueError,
            "body 'rope' is meant to change shape",
        ),
    ],
)
def test_what_cannot_be_names_the_body(make, error, says: str) -> None:
    with pytest.raises(error, match=says):
        make()


@pytest.mark.parametrize(
    ("actuators", "says"),
    [
        (
            {"torque": 1.0},
            r"actuators has 'torque'; of several bodies, write the body, a dot .* '\w+\.force'",
        ),
        ({"torque.": 1.0}, "the body that actuators"),
        ({"dog.force": 1.0}, "'left', 'right'"),
        ({"left.spin": 1.0}, "'spin'"),
        ({"left.acceleration": 1.0}, "no such actuator"),
    ],
)
def test_an_actuator_of_no_body_is_refused(actuators, says: str) -> None:
    with pytest.raises(ValueError, match=says):
        springgym.make_scene_env(tops(TOP), lambda m, s: m.energy, actuators=actuators)
