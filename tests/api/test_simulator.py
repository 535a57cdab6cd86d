"""Every argument of `Simulator` and its methods, given what it could not be."""

from __future__ import annotations

import _thread
import copy
import math
import pickle
import re
import signal
import threading
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from springgym import simulator as module
from springgym.core.compiler import decorators
from springgym.core.compiler.decorators import SameTypes, kernel
from springgym.core.language.blocks import aligned_zeros, block_dtype, to_copies
from springgym.dynamics.measures import AT, Measures
from springgym.dynamics.packing import PARAMETERS as VARYING
from springgym.model.bodies import cube, rope, top
from springgym.model.scene import DriveActuator, Placed, Scene, ThrustActuator, WrenchActuator
from springgym.model.surfaces import Contact, floor, loss_factor
from springgym.simulator import PrecisionWarning, SimulationDivergedError, Simulator
from tests.api.values import KINDS, NUMBERS, arguments, arrays, attempt, door
from tests.params import slow_unless

COPIES = 10
CUBE = cube()
SCENE = Scene(
    CUBE,
    CUBE.positions + np.eye(3)[2],
    pinned=(0,),
    wrench=WrenchActuator(),
    thrust=ThrustActuator((1, 5)),
    drive=DriveActuator(0, 1.0),
    surfaces=(floor(),),
    contact=Contact(0.5, 0.5),
)
PLAIN = Scene(top(ring=3), gravity=None)


def everything(**options: Any) -> Simulator:
    """A simulator with everything that methods can set."""
    return Simulator(SCENE, copies=COPIES, varying=VARYING, **options)


def shape_of(name: str) -> tuple[int, ...]:
    """Of the values of one copy."""
    if name in ("friction", "restitution", "strength"):
        return ()
    body = {"masses": (8,), "gravity": (3,), "positions": (8, 3), "velocities": (8, 3), "thrust": (2, 3)}
    springs = {"stiffness": (28,), "damping": (28,), "lengths": (28,)}
    return (body | springs).get(name, (3,))


DRIVES = ("force", "torque", "body_torque", "acceleration", "thrust")

RIGHT = {
    **{name: np.ones(shape_of(name)) for name in VARYING},
    **{name: np.zeros(shape_of(name)) for name in DRIVES},
    "stiffness": np.full(28, 1e5),
    "masses": np.full(8, 0.125),
    "restitution": np.array(0.5),
    "positions": SCENE.positions,
    "velocities": np.zeros((8, 3)),
}

COPY_VALUES: list[Any] = [
    *([-1], [-100000], [COPIES], [5_000_000], [2**63], np.array([2**64 - 1], np.uint64), [0, 0], [0.0]),
    *([True] * COPIES, [False] * COPIES, [True] * 3, np.ones(COPIES, bool), np.ones((COPIES, 1), bool)),
    *([[0]], [], (), range(3), range(30), [3, 1], np.array([7], np.int8), {1}, "1", slice(2), [None]),
    *([True, 1], [0.5], np.arange(COPIES + 1)),
]


def same(first: dict[str, np.ndarray], second: dict[str, np.ndarray]) -> bool:
    return all(np.array_equal(first[name], second[name]) for name in first | second)


def finite(measured: Measures) -> bool:
    return all(np.isfinite(value).all() for value in measured)


# --- Making one --------------------------------------------------------------------------------------

DOORS = [door(Simulator, scene=PLAIN), door(Simulator.paper, scene=PLAIN)]


USUAL = ("step", "copies", "dtype", "integrator", "dynamics", "varying", "scene")


@pytest.mark.parametrize(
    ("number", "argument"),
    [
        pytest.param(*given.values, id=given.id, marks=slow_unless(given.values[1] in USUAL))
        for given in arguments(DOORS)
        if given.values[1] != "options"
    ],
)
def test_an_option_is_refused_by_name_or_right(number: int, argument: str) -> None:
    """Whatever it is: refused, or the simulator stands, and no warning is given."""
    call, right = DOORS[number]
    names = ["verlet", "dopri5", "springs", "rigid", "suzuki", "masses", "float32", "f4", ">f8", "int8"]
    names += [*map(np.dtype, ("f4", "f8", "i4", "c16", "O")), float, int, complex, bool, object]
    many = [("masses",), ("masses", "masses"), {"friction"}, ("no",), (1,)]
    many += [(0.0, 0.0), (1e-6, math.nan), (1e-6, 1e-9)]
    for value in (*KINDS, *NUMBERS, *names, *many, SCENE, CUBE, 1e-9, 1e-5):
        made = attempt([argument, *right], value, lambda value=value: call(**right | {argument: value}))
        if made is not None:
            assert made.step > 0
            assert made.time.shape == (made.copies,)
            assert type(made.copies) is int
            assert type(made.threads) is int
            assert np.isfinite(made.positions[:1]).all()


def test_what_it_was_made_with_is_read_only() -> None:
    simulator = Simulator(PLAIN, copies=2)
    for name in ("scene", "step", "copies", "threads", "dtype", "time", "readout", "largest_step"):
        with pytest.raises(AttributeError, match=f"{name} of a simulator cannot change"):
            setattr(simulator, name, 3)
        getattr(simulator, name)


# --- Methods -----------------------------------------------------------------------------------------


def methods(simulator: Simulator) -> list[tuple[str, Callable[[str, Any], Any], list[Any]]]:
    """Each argument of each method: how to give it, and what to give."""
    x = SCENE.positions
    v = np.zeros((8, 3))
    found: list[tuple[str, Callable[[str, Any], Any], list[Any]]] = [
        ("steps", lambda name, value: simulator.advance(min_or_same(value), check=False), []),
        ("check", lambda name, value: simulator.advance(0, check=value), []),
        ("read", lambda name, value: simulator.advance(0, check=False, read=value), []),
        ("copies", lambda name, value: simulator.read(value), COPY_VALUES),
        ("copies", lambda name, value: simulator.place(x, v, value), COPY_VALUES),
        ("copies", lambda name, value: simulator.vary(value, friction=0.5), COPY_VALUES),
        ("positions", lambda name, value: simulator.place(value, v), []),
        ("velocities", lambda name, value: simulator.place(x, value), []),
        ("state", lambda name, value: simulator.restore(value), []),
    ]
    found += [(name, lambda name, value: simulator.vary(None, **{name: value}), []) for name in VARYING]
    found += [(name, lambda name, value: simulator.actuate(**{name: value}), []) for name in DRIVES]
    return found


def min_or_same(steps: Any) -> Any:
    """Numbers of steps that end."""
    return min(steps, 100) if type(steps) is int and steps <= 2**53 else steps


def test_an_argument_is_refused_by_name_and_changes_nothing_or_is_right() -> None:
    simulator = everything()
    simulator.advance(3)
    began = simulator.state()
    for name, call, more in methods(simulator):
        values = [*KINDS, *NUMBERS, *more]
        if name in RIGHT:
            values += [np.ones(shape) for shape in (0, 1, 3, COPIES, (COPIES, 3), (1, 3))]
            for shape in {shape_of(name), (COPIES, *shape_of(name))} - {()}:
                values += arrays(shape)
        for value in values:
            names = [name, "copy", "particle", "spring"]
            try:
                done = attempt(names, value, lambda name=name, call=call, value=value: (call(name, value),))
            except SimulationDivergedError:
                done = True
            if done is None:
                assert same(began, simulator.state()), (name, value)
            elif name not in ("state", "steps"):
                assert finite(simulator.measure()), (name, value)
            simulator.restore(began)


def test_steps_are_what_the_clock_counts() -> None:
    """Whatever type the first call had, later ones take their own."""
    for first in (0, 1, np.int8(5), np.uint64(2)):
        simulator = everything()
        other = everything()
        simulator.advance(first)
        simulator.advance(1000, check=False)
        other.advance(int(first))
        other.advance(1000, check=False)
        assert simulator.time == pytest.approx(other.time, rel=1e-13)
        assert same(simulator.state() | {"time": np.zeros(1)}, other.state() | {"time": np.zeros(1)})
    for wrong in (True, 2.7, -5, None, "3", np.array([3]), math.nan):
        simulator = everything()
        with pytest.raises((TypeError, ValueError), match="steps is"):
            simulator.advance(wrong)
        assert (simulator.time == 0).all()
        simulator.advance(1, check=False, read=False)
        assert finite(simulator.measure())
        assert simulator.measure().kinetic.all()


# --- Interrupted calls -------------------------------------------------------------------------------

MANY = 40
"""Copies, of several blocks."""


def interrupted(simulator: Simulator, steps: int, calls: int) -> None:
    """Take steps, Ctrl-C being served when so many compiled calls of this thread have returned, and the
    simulator's other thread, if it has one, is in its first."""
    kernel = simulator._advance
    left = iter(range(calls))
    begun = threading.Event()
    if simulator.threads == 1:
        begun.set()

    def interrupting(*arguments: Any) -> None:
        main = threading.current_thread() is threading.main_thread()
        if not main:
            begun.set()
        kernel(*arguments)
        if main and next(left, None) is None:
            assert begun.wait(60)
            raise KeyboardInterrupt

    simulator._advance = interrupting  # type: ignore[assignment]
    with pytest.raises(KeyboardInterrupt):
        simulator.advance(steps)
    simulator._advance = kernel


@pytest.mark.parametrize("threads", [1, 2])
@pytest.mark.parametrize(("at_once", "calls"), [(module.AT_ONCE, 0), (100 * 28, 4), (250 * 28, 1)])
def test_the_clock_says_how_far_an_interrupted_call_got(
    monkeypatch: pytest.MonkeyPatch, threads: int, at_once: int, calls: int
) -> None:
    """Copy by copy, and all that the copies hold is as if they had been asked for that many steps."""
    monkeypatch.setattr(module, "AT_ONCE", at_once)
    many = {"copies": MANY, "varying": VARYING}
    simulator = Simulator(SCENE, threads=threads, **many)  # type: ignore[arg-type]
    interrupted(simulator, 1000, calls)
    taken = np.rint(simulator.time / simulator.step).astype(int)
    assert 0 < taken.max() <= 1000
    assert (taken.min() < 1000) == (calls > 0)
    for steps in np.unique(taken).tolist():
        fresh = Simulator(SCENE, **many)  # type: ignore[arg-type]
        fresh.advance(steps)
        of = taken == steps
        assert np.array_equal(simulator.positions[of], fresh.positions[of])
        assert np.array_equal(simulator.velocities[of], fresh.velocities[of])
        assert simulator.time[of] == pytest.approx(fresh.time[of], rel=1e-13)


def test_rows_of_other_lengths_than_three_are_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    """Kernels would take them for rows of three, and write behind them."""
    pairs = aligned_zeros((4, 2), block_dtype(np.float64, 1))
    monkeypatch.setattr(module.packing, "workspaces", lambda *_: [(pairs,)])
    with pytest.raises(ValueError, match=r"term\.0\.0 has rows of 2 numbers; they must have 3"):
        Simulator(Scene(cube()))


def test_copies_of_a_thread_that_has_not_begun_are_left_where_they_are(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Where all helpers are busy, Ctrl-C comes before one takes the other half of the copies, which it then
    no longer does."""
    simulator, fresh = (Simulator(SCENE, threads=n, copies=MANY, varying=VARYING) for n in (2, 1))
    go_on = threading.Event()
    with ThreadPoolExecutor(1) as pool:
        monkeypatch.setattr(module, "_pool", lambda *_: pool)
        busy = pool.submit(go_on.wait, 60)
        kernel = simulator._advance

        def interrupting(*arguments: Any) -> None:
            kernel(*arguments)
            raise KeyboardInterrupt

        simulator._advance = interrupting  # type: ignore[assignment]
        with pytest.raises(KeyboardInterrupt):
            simulator.advance(1000)
        go_on.set()
        assert busy.result()
    taken = np.rint(simulator.time / simulator.step).astype(int)
    assert sorted(set(taken.tolist())) == [0, 1000]
    assert np.array_equal(simulator.positions[taken == 0], fresh.positions[taken == 0])
    simulator._advance = kernel
    fresh.advance(1000)
    assert np.array_equal(simulator.positions[taken == 1000], fresh.positions[taken == 1000])


def test_many_compiled_calls_are_one_to_the_bit(monkeypatch: pytest.MonkeyPatch) -> None:
    whole = Simulator(SCENE, copies=MANY, varying=VARYING)
    whole.advance(1000, read=True)
    monkeypatch.setattr(module, "AT_ONCE", 100 * 28)
    for threads in (1, 2):
        parts = Simulator(SCENE, copies=MANY, varying=VARYING, threads=threads)
        parts.advance(1000, read=True)
        assert parts.time == pytest.approx(whole.time, rel=1e-13)
        assert same(parts.state() | {"time": np.zeros(1)}, whole.state() | {"time": np.zeros(1)})
        assert np.array_equal(parts.readout.rows, whole.readout.rows)


def test_steps_that_would_never_end_are_interrupted() -> None:
    simulator = everything()
    simulator.advance(1)
    began = signal.signal(signal.SIGINT, signal.default_int_handler)
    try:
        threading.Timer(0.2, _thread.interrupt_main).start()
        with pytest.raises(KeyboardInterrupt):
            simulator.advance(10**12, check=False)
    finally:
        signal.signal(signal.SIGINT, began)
    assert simulator.step < simulator.time[0] < 1e9 * simulator.step


# --- Threads -----------------------------------------------------------------------------------------


def test_another_thread_is_told_and_does_not_wait() -> None:
    """By every method, while one thread is in one; then all is as if it had not asked."""
    simulator = everything()
    alone = everything()
    for own in (simulator, alone):
        own.advance(2)
    kernel = simulator._advance
    inside = threading.Event()
    go_on = threading.Event()

    def waiting(*arguments: Any) -> None:
        inside.set()
        assert go_on.wait(60)
        kernel(*arguments)

    simulator._advance = waiting  # type: ignore[assignment]
    thread = threading.Thread(target=simulator.advance, args=(10,))
    thread.start()
    try:
        assert inside.wait(60)
        public = [name for name in vars(Simulator) if not name.startswith("_")]
        for name in public:
            if name not in (
                "paper",
                "width",
                "identity",
                "max_impact_speed",
            ):  # which read nothing that changes
                with pytest.raises(RuntimeError, match=f"two threads use one Simulator at once: {name} was"):
                    getattr(simulator, name)()
        with pytest.raises(RuntimeError, match="two threads"):
            copy.deepcopy(simulator)
    finally:
        go_on.set()
        thread.join()
    simulator._advance = kernel
    alone.advance(10)
    assert same(simulator.state(), alone.state())
    assert same(copy.deepcopy(simulator).state(), alone.state())


@pytest.fixture(scope="module")
def simulator() -> Simulator:
    return everything()


def actuated(simulator: Simulator, name: str) -> np.ndarray:
    """Return what an actuator of the copies is set to, (copies, …)."""
    lanes = simulator._actuators[name][1]
    rows = lanes.transpose(0, 2, 1).reshape(-1, lanes.shape[1])[: simulator.copies]
    return rows.reshape(simulator.copies, *shape_of(name))


def values_of(simulator: Simulator, name: str) -> np.ndarray:
    """Return what the copies hold, (COPIES, …), in the body's order."""
    if name in ("positions", "velocities"):
        return getattr(simulator, name)
    if name not in VARYING:
        return actuated(simulator, name)
    (packed,) = simulator._packed
    rows = to_copies(VARYING[name].stored(packed.terms), COPIES)
    if shape_of(name) == (28,):
        rows[:, packed.order] = rows.copy()
    return rows if shape_of(name) else rows[:, 0]


def test_copies_are_read_where_they_are_placed() -> None:
    one = everything()
    other = everything()
    x = one.scene.positions + np.arange(3.0)[:, None, None]
    before = one.readout.rows.copy()
    one.place(x, one.scene.velocities, [4, 0, 7])
    np.testing.assert_array_equal(one.readout.rows, before)
    one.read([4, 0, 7])
    other.place(x, one.scene.velocities, np.array([4, 0, 7]), read=True)
    assert np.any(one.readout.rows[[0, 4, 7]] != before[[0, 4, 7]], axis=1).all()
    for mine, its in zip(one.readout, other.readout, strict=True):
        np.testing.assert_array_equal(mine, its)
    with pytest.raises(TypeError, match="read is 1; it must be True or False"):
        one.place(x, one.scene.velocities, [4, 0, 7], read=1)


NAMED = [*VARYING, "positions"]


@settings(max_examples=150)
@given(
    name=st.sampled_from(NAMED),
    chosen=st.lists(st.integers(0, COPIES - 1), unique=True),
    form=st.sampled_from(["list", "tuple", "int64", "uint8", "mask", "list of bools", "all"]),
    rows=st.booleans(),
    scale=st.floats(0.5, 1.0),
)
def test_rows_go_to_the_copies_named_and_to_no_others(
    simulator: Simulator, name: str, chosen: list[int], form: str, rows: bool, scale: float
) -> None:
    """By indices in any order or a mask, with a row for each of these copies or one for all."""
    mask = np.isin(np.arange(COPIES), chosen)
    if form in ("mask", "list of bools"):
        chosen = sorted(chosen)
    elif form == "all":
        chosen = list(range(COPIES))
    forms = {
        "list": chosen,
        "tuple": tuple(chosen),
        "mask": mask,
        "list of bools": mask.tolist(),
        "all": None,
    }
    copies = (forms | {kind: np.array(chosen, kind) for kind in ("int64", "uint8")})[form]
    each = np.linspace(scale, 1.0, len(chosen)).reshape(-1, *[1] * len(shape_of(name)))
    value = RIGHT[name] * each if rows else RIGHT[name] * scale
    if name == "positions":  # above the floor
        value = value + np.eye(3)[2]
    expected = values_of(simulator, name)
    meant = loss_factor(value) if name == "restitution" else value
    expected[chosen] = meant
    if name == "positions":
        simulator.place(value, np.zeros((8, 3)), copies)
    else:
        simulator.vary(copies, **{name: value})
    assert np.array_equal(values_of(simulator, name), expected)


@pytest.mark.parametrize("copies", [1, COPIES])
@pytest.mark.parametrize("name", DRIVES)
def test_actuators_take_a_row_for_each_copy_or_one_for_all(name: str, copies: int) -> None:
    simulator = Simulator(SCENE, copies=copies)
    shape = shape_of(name)
    rng = np.random.default_rng(1)
    for value in (rng.normal(size=(copies, *shape)), rng.normal(size=shape), np.ones(shape).tolist()):
        simulator.actuate(**{name: value})
        held = actuated(simulator, name)
        assert np.array_equal(held, np.broadcast_to(value, held.shape))
    again = copy.deepcopy(pickle.loads(pickle.dumps(simulator)))
    for each in (simulator, again):  # copies have their own
        each.actuate(**{name: np.full(shape, 2.0)})
        assert (actuated(each, name) == 2.0).all()
    assert same(simulator.state(), again.state())
    for wrong in ((1, *shape), (copies + 1, *shape), (16, *shape), (*shape, 1), (2,), ()):
        if wrong not in ((copies, *shape), shape):
            with pytest.raises(ValueError, match=rf"{name} is .*; it must be an array of shape \({copies}, "):
                simulator.actuate(**{name: np.ones(wrong)})
    with pytest.raises(ValueError, match="the scene has no actuator for 'push'; it has force, torque"):
        simulator.actuate(push=np.ones(3))


def test_state_holds_all_that_changes() -> None:
    """What actuators do and what was varied goes on after `restore` as it would have."""
    first = everything()
    first.vary([2, 3], masses=np.full(8, 0.2), stiffness=np.full(28, 9e4), friction=0.1, restitution=0.7)
    first.vary([5], gravity=(0, 0, -3), strength=0.1, lengths=CUBE.lengths)
    first.actuate(force=np.ones(3), thrust=np.ones((COPIES, 2, 3)), acceleration=(0.5, 0, 0))
    first.advance(50, check=False)
    state = first.state()
    first.advance(50, check=False)
    second = everything()
    second.advance(7, check=False)
    second.actuate(torque=np.ones(3))
    for simulator in (first, second):
        simulator.restore(state)
        assert same(simulator.state(), state)
        simulator.advance(50, check=False)
    assert same(first.state(), second.state())
    assert not same(first.state(), state)


HEAVIER = CUBE.with_(masses=0.2)

OTHERS: list[tuple[dict[str, Any], str]] = [
    ({"copies": 3}, "copies is 3, here it is 10"),
    ({"copies": 16}, "copies is 16"),
    ({"dtype": np.float32}, "dtype is 'float32', here it is 'float64'"),
    ({"ledger": False}, "ledger is False, here it is True"),
    ({"varying": ("masses",)}, r"varying is \['masses'\]"),
    ({"step": 1e-4}, "step is 0.0001"),
    ({"scene": SCENE.with_(gravity=(0, 0, -1.62))}, r"gravity is \[0.0, 0.0, -1.62\], here .*-9.81"),
    ({"scene": SCENE.with_(contact=Contact(0.4, 0.5))}, "friction of the contact is 0.4, here it is 0.5"),
    ({"scene": SCENE.with_(surfaces=(floor(-1.0),))}, r"surface 0 is 'Plane\(point=\(0.0, 0.0, -1.0\)"),
    ({"scene": SCENE.with_(surfaces=(floor(), floor(-1.0)))}, "number of surfaces is 2, here it is 1"),
    ({"scene": SCENE.with_(body=HEAVIER)}, "masses is '#"),
    ({"scene": SCENE.with_(body=CUBE.with_(stiffness=CUBE.stiffness * 0.9))}, "stiffness is '#"),
    ({"scene": SCENE.with_(thrust=ThrustActuator((1, 4)))}, "thrust is "),
]


each_other = pytest.mark.parametrize(
    ("options", "differs"), OTHERS, ids=[differs.split(" is")[0] for _, differs in OTHERS]
)


def other(options: dict[str, Any]) -> Simulator:
    made = {"scene": SCENE, "copies": COPIES, "varying": tuple(VARYING), "step": everything().step}
    return Simulator(**(made | options))


@each_other
def test_only_one_of_the_same_scene_is_taken_over(options: dict[str, Any], differs: str) -> None:
    """By steps of one's own; else it is said what differs, and nothing is changed."""
    own = everything()
    its = other(options)
    before = own.state()
    if "step" in options:
        own.take_over(its)
        return
    with pytest.raises(ValueError, match=f"other does not match: its {differs}.*made like this"):
        own.take_over(its)
    assert same(own.state(), before)


def test_nonsense_in_a_state_is_refused_by_name_and_that_of_a_diverged_copy_returns() -> None:
    simulator = everything()
    simulator.advance(2, check=False)
    good = simulator.state()
    finite = set(good) - {"of", "x", "v", "ledger", "terms.last.half_change", "terms.surfaces.totals"}
    assert {"time", "terms.particles.mass", "terms.wrench.force", "terms.last.sweep"} < finite
    for name in good.keys() - {"of"}:
        array = good[name]
        lost = array.copy()
        (lost if name == "time" else lost["lanes"])[..., 4] = np.nan
        other = array.astype(np.float32) if name == "time" else array["lanes"]
        for wrong in (
            array[:0],
            array[None],
            other,
            None,
            array.tolist(),
            *([lost] if name in finite else []),
        ):
            for copies in (None, range(COPIES)):
                with pytest.raises(
                    (ValueError, TypeError), match=rf"state\['{re.escape(name)}'\]|holds 0 cop"
                ):
                    simulator.restore(good | {name: wrong}, copies)
                assert same(simulator.state(), good)
    simulator._x["lanes"][..., 4] = np.nan
    lost = simulator.state()
    simulator.restore(good)
    simulator.restore(lost)
    assert not np.isfinite(simulator.positions[4]).all()
    assert np.array_equal(simulator.state()["x"]["lanes"], lost["x"]["lanes"], equal_nan=True)


@pytest.mark.parametrize(
    ("name", "value", "says"),
    [
        ("terms.particles.mass", 0.0, "must be a positive number"),
        ("terms.particles.mass", 1e-9, "make the step of .* s unstable in copy"),
        ("terms.springs.stiffness", 1e12, "make the step of .* s unstable in copy"),
        ("terms.dampers.coefficient", -1.0, "must be a number from 0"),
        ("terms.loss", 1.5, "must be a number from 0 to 1"),
        ("terms.last.sweep", 0.5, "holds other numbers than 0 and 1"),
        ("time", np.inf, "holds a number that is not finite"),
    ],
)
def test_numbers_that_a_state_cannot_hold_are_refused(name: str, value: float, says: str) -> None:
    simulator = everything()
    simulator.advance(2, check=False)
    good = simulator.state()
    wrong = good[name].copy()
    (wrong if name == "time" else wrong["lanes"])[...] = value
    with pytest.raises(ValueError, match=says):
        simulator.restore(good | {name: wrong})
    assert same(simulator.state(), good)


def test_a_simulation_continues_from_edited_positions_and_velocities() -> None:
    """As from where it was placed: nothing else remembers them."""
    scene = PLAIN
    edited = Simulator(scene, copies=3)
    placed = Simulator(scene, copies=3)
    edited.advance(10)
    state = edited.state()
    x = edited.positions + 0.5
    v = edited.velocities + np.arange(3)[:, None, None]
    state["x"]["lanes"][0, ..., :3] = np.moveaxis(x, 0, -1)
    state["v"]["lanes"][0, ..., :3] = np.moveaxis(v, 0, -1)
    edited.restore(state)
    placed.place(x, v)
    np.testing.assert_array_equal(edited.positions, x)
    for simulator in (edited, placed):
        simulator.advance(20, check=False)
    np.testing.assert_array_equal(edited.positions, placed.positions)
    np.testing.assert_array_equal(edited.velocities, placed.velocities)


BALLS = Scene(
    bodies=(Placed(CUBE, CUBE.positions + np.eye(3)[2]), Placed(CUBE, CUBE.positions + 3.0)),
    surfaces=(floor(),),
    contact=Contact(0.5, 0.5),
)
EDITED: dict[str, tuple[Callable[[], Simulator], tuple[str, ...]]] = {
    "surfaces": (everything, tuple(VARYING)),
    "single precision": (lambda: everything(dtype=np.float32), tuple(VARYING)),
    "rigid": (
        lambda: Simulator(SCENE.with_(drive=None), dynamics="rigid", copies=3, varying=("masses", "lengths")),
        ("masses", "lengths"),
    ),
    "bodies that collide": (lambda: Simulator(BALLS, copies=3, varying=tuple(VARYING)), tuple(VARYING)),
}
FACTOR = {"masses": 1.1, "stiffness": 0.9, "damping": 0.7, "lengths": 0.99, "gravity": 0.5, "strength": 0.8}


def all_arrays(simulator: Simulator) -> dict[str, np.ndarray]:
    """Also those that follow from others."""
    found = {
        **dict(module._blocks_in("terms", simulator._terms)),
        **dict(module._blocks_in("twin", simulator._twin)),
    }
    return {name: to_copies(array, simulator.copies) for name, array in found.items() if array.size}


@pytest.mark.parametrize("scene", EDITED)
def test_what_follows_from_edited_parameters_is_as_if_they_had_been_varied(scene: str) -> None:
    """All arrays, to the bit: none is in a state besides what it follows from."""
    make, names = EDITED[scene]
    for name in names:
        varied, edited, other = make(), make(), make()
        of = varied.scene
        if name in ("friction", "restitution"):
            value: Any = 0.25
        elif name == "strength":
            value = np.full(len(of.bodies), 0.05) if len(of.bodies) > 1 else 0.05
        else:
            value = FACTOR[name] * (np.array(of.gravity) if name == "gravity" else of.of_bodies(name))
        copies = [0, 2]
        nominal = all_arrays(edited)
        varied.vary(copies, **{name: value})
        changed = {
            key: array for key, array in varied.state().items() if key in dict(varied._varied.values())
        }
        expected = all_arrays(varied)
        assert any(not np.array_equal(expected[key], nominal[key]) for key in expected)
        edited.restore(edited.state() | changed)
        assert same(all_arrays(edited), expected), name
        other.restore(varied.state(copies), [2, 0])
        assert same(all_arrays(other), expected), name
        edited.restore(make().state())
        assert same(all_arrays(edited), nominal), name


def test_the_energy_between_bodies_that_touch_follows_from_a_state() -> None:
    """It is that of their pair, half of it each."""
    scene = Scene(bodies=(Placed(CUBE), Placed(CUBE, CUBE.positions + 1.1 * np.eye(3)[0])), gravity=None)
    first = Simulator(scene, copies=2)
    first.place(scene.positions, np.where(np.arange(16)[:, None] < 8, np.eye(3)[0], 0.0))
    while not first.pairs().energy.all() and first.time[0] < 1:
        first.advance(first.damping_every)
    second = Simulator(scene, copies=2)
    second.restore(first.state())
    stored = all_arrays(first)["terms.collisions.stored"]
    assert (stored > 0).all()
    np.testing.assert_array_equal(all_arrays(second)["terms.collisions.stored"], stored)


@each_other
def test_a_state_of_another_simulator_is_refused_and_changes_nothing(
    options: dict[str, Any], differs: str
) -> None:
    own = everything()
    own.advance(2, check=False)
    before = own.state()
    with pytest.raises(ValueError, match=f"the state does not match: its {differs}"):
        own.restore(other(options).state())
    assert same(own.state(), before)


def test_a_mangled_state_is_refused_and_changes_nothing() -> None:
    own = everything()
    own.advance(2, check=False)
    before = own.state()
    for wrong in (None, {}, before["of"] | {"step": np.zeros(3)}, before["of"] | {"more": 1}):
        with pytest.raises(ValueError, match="the state does not"):
            own.restore(before | {"of": wrong})
    with pytest.raises(ValueError, match="state lacks 'time'; it must hold of, x, v, time,"):
        own.restore({name: array for name, array in before.items() if name != "time"})
    assert same(own.state(), before)


def test_parameters_that_make_the_step_unstable_are_refused() -> None:
    """Whole bodies by a bound, single springs and particles by the limit of their copy."""
    simulator = Simulator(PLAIN, copies=3, varying=("stiffness", "masses", "damping"))
    body = PLAIN.body
    room = simulator.largest_step / simulator.step
    for name, factor in (("stiffness", 1.01 * room**2), ("masses", 1 / (1.01 * room**2))):
        with pytest.raises(ValueError, match=f"these {name} make the step of .* s unstable in copy 1"):
            simulator.vary([0, 1], **{name: getattr(body, name) * np.array([[1.0], [factor]])})
        simulator.vary([0, 1], **{name: getattr(body, name) * np.array([[1.0], [0.98 * factor]]) ** 0.5})
        simulator.vary(None, **{name: getattr(body, name)})
    one = body.stiffness.copy()
    one[0] *= 3.0  # by the bound too much, but not for the whole body
    simulator.vary([2], stiffness=one)
    one[0] *= 1e3
    with pytest.raises(ValueError, match="unstable in copy 2"):
        simulator.vary([2], stiffness=one)
    simulator.vary([2], stiffness=body.stiffness * 1.5)
    with pytest.raises(ValueError, match="unstable in copy 2"):  # with the stiffness it has by now
        simulator.vary([2], masses=body.masses / (room**2 / 1.4))


def test_masses_and_damping_are_varied_in_any_order() -> None:
    """How dampers act follows from both, whichever was given last."""
    masses = CUBE.masses * np.linspace(0.8, 1.2, 8)
    damping = CUBE.damping * np.linspace(0.1, 2, 28)
    states = []
    for calls in (
        [{"masses": masses, "damping": damping}],
        [{"masses": masses}, {"damping": damping}],
        [{"damping": damping}, {"masses": masses}],
    ):
        simulator = everything()
        for values in calls:
            simulator.vary([1, 4], **values)
        states.append(all_arrays(simulator))
    assert same(states[0], states[1])
    assert same(states[0], states[2])


def test_compiled_code_is_not_given_other_types(monkeypatch: pytest.MonkeyPatch) -> None:
    """Where Numba checks indices, the types of every call are compared with those of the first."""

    @kernel
    def twice(n: Any) -> Any:
        return 2 * n

    monkeypatch.setattr(decorators, "CHECKED", True)
    same_types = SameTypes(twice)
    assert same_types(3) == same_types(4) - 2
    with pytest.raises(TypeError, match=r"twice was compiled for .*int64.* and is called with .*float64"):
        same_types(3.0)


# --- What is told -------------------------------------------------------------------------------------


def test_float32_far_from_the_origin_is_told_of_once() -> None:
    """At 1 km float32 rounds positions to 6e-5 m: the simulator warns once. The test compiles nothing."""
    near = CUBE.positions + 50.0
    far = CUBE.positions + 1000.0
    scene = Scene(CUBE, near)
    Simulator(scene.with_(positions=far))
    made = Simulator(scene, dtype=np.float32)
    apart = r"1e\+03 m away .* in float32 are 6\.1e-05 m apart, .* within 83\.9 m, or use float64"
    with pytest.warns(PrecisionWarning, match=apart):
        Simulator(scene.with_(positions=far), dtype=np.float32)
    with pytest.warns(PrecisionWarning, match="use float64") as warned:
        made.place(far, 0 * far)
    assert warned[0].filename == __file__
    made.place(far, 0 * far)  # not twice
    flown = Simulator(scene, dtype=np.float32)
    flown.readout.positions[:] = far
    with pytest.warns(PrecisionWarning, match="away from the origin"):
        flown._check()


def test_strain_that_holds_no_shape_is_told_of_once_unless_it_is_meant() -> None:
    scene = Scene(CUBE)

    def read(strain: float, **options: Any) -> Simulator:
        simulator = Simulator(scene, **options)
        simulator.readout.rows[:, AT.strain] = strain
        return simulator

    read(0.29)._check()
    strained = read(0.46)
    with pytest.warns(PrecisionWarning, match=r"copy 0 .* by 0\.46 of its length .*set strain_limit"):
        strained._check()
    strained._check()
    read(0.46, strain_limit=0.5)._check()
    read(1.5, strain_limit=2.0)._check()
    for limit, strain in ((None, 0.51), (0.3, 0.31)):
        with pytest.raises(SimulationDivergedError, match=f"strain {strain}, strain_limit {limit or 0.5}"):
            read(strain, strain_limit=limit)._check()
    cord = Simulator(Scene(rope(), gravity=None))
    cord.readout.rows[:, AT.strain] = 0.46  # a rope has no shape to lose
    cord._check()


def test_shadow_energy_is_refused_where_it_is_not_known() -> None:
    for options in ({"integrator": "rk4"}, {"dynamics": "rigid"}):
        with pytest.raises(ValueError, match=r"known only for verlet with springs; this is (rk4|suzuki) on"):
            Simulator(PLAIN, **options).shadow_energy()
