"""The rules of `springgym.checks`, each with what it lets through and what it refuses."""

from __future__ import annotations

import itertools
import math
import re
from decimal import Decimal
from fractions import Fraction

import numpy as np
import pytest

from springgym.checks import (
    HUGE,
    TINY,
    apart,
    array,
    chosen,
    counted,
    flag,
    indices,
    instance,
    number,
    printable,
    shown,
    similar,
    suggestion,
    whole,
    whole_array,
)
from springgym.dynamics.stability import REFUSED, steps_in
from springgym.envs.randomisation import varying
from springgym.envs.tasks import duel
from springgym.model.bodies import cube
from springgym.model.scene import Scene
from springgym.model.surfaces import NEAREST, Contact, Plane, floor
from springgym.simulator import Simulator

NO_NUMBERS = (None, "1", b"1", True, np.True_, 1j, [1.0], (), {}, object(), np.array([1.0]), np.array(True))
NOT_WHOLE = (*NO_NUMBERS, 1.0, math.nan, np.float64(2), Fraction(4, 2), Decimal(2))


@pytest.mark.parametrize("value", [2, 2.0, np.int8(2), np.float32(2), np.array(2), Fraction(2)])
def test_a_number(value):
    given = number("x", value)
    assert type(given) is float
    assert given == 2


@pytest.mark.parametrize("value", NO_NUMBERS)
def test_no_number(value):
    with pytest.raises(TypeError, match=r"x is .*; it must be a number from -1e"):
        number("x", value)


@pytest.mark.parametrize("value", [math.nan, math.inf, -2e30, 10**400, -1, 0, 1e-31])
def test_a_number_out_of_bounds(value):
    with pytest.raises(ValueError, match=r"x is .*; it must be a positive number, from 1e-30 to 1e\+30"):
        number("x", value, low=TINY)


@pytest.mark.parametrize("value", [3, np.int8(3), np.uint64(3), np.array(3)])
def test_a_whole_number(value):
    given = whole("n", value, 1, 3)
    assert type(given) is int
    assert given == 3


@pytest.mark.parametrize("value", NOT_WHOLE)
def test_no_whole_number(value):
    with pytest.raises(TypeError, match=r"n is .*; it must be a whole number, at least 1"):
        whole("n", value, 1)


@pytest.mark.parametrize("value", [0, -1, 4, 10**400])
def test_a_whole_number_out_of_bounds(value):
    with pytest.raises(ValueError, match=r"n is .*; it must be a whole number from 1 to 3"):
        whole("n", value, 1, 3)


def test_a_whole_number_of_too_many_digits_to_show():
    with pytest.raises(ValueError, match="n is a int; it must be"):
        whole("n", 10**5000, 1, 3)


def test_a_flag():
    assert flag("on", np.True_) is True
    for value in (1, 0, None, "no", 1.0, np.array(True)):
        with pytest.raises(TypeError, match=r"on is .*; it must be True or False"):
            flag("on", value)


def test_a_choice():
    assert chosen("by", "area", ("volume", "area")) == "area"
    with pytest.raises(ValueError, match="by is 'mass'; it must be one of 'volume', 'area'"):
        chosen("by", "mass", ("volume", "area"))
    for value in (None, 1, [], {}):
        with pytest.raises(TypeError, match="it must be one of 'volume', 'area'"):
            chosen("by", value, ("volume", "area"))


def test_an_instance():
    assert instance("x", 1, int, str) == 1
    with pytest.raises(TypeError, match="x is None; it must be int or str"):
        instance("x", None, int, str)


def test_an_array():
    given = np.ones((4, 3))
    assert array("x", given, (4, 3)) is given
    assert array("x", [1, 2, 3], (3,), ()).dtype == np.float64
    assert array("x", 2, (3,), ()).shape == ()
    assert array("x", [], (0,)).shape == (0,)


@pytest.mark.parametrize(
    "value", [[1, 2], [[1, 2, 3]], 1.0, np.ones((3, 1)), [[1, 2], [3]], (), np.ones((2, 3)), np.ones((3, 0))]
)
def test_an_array_of_another_shape(value):
    with pytest.raises(ValueError, match=r"x is .*be an array of shape \(3,\) or \(n, 4\) or \(n, m, 4\)"):
        array("x", value, (3,), (None, 4), (None, None, 4))


@pytest.mark.parametrize(
    "value",
    [
        *("abc", None, {1, 2, 3}, {}, object(), iter("abc")),
        *(["a", "b", "c"], [None, 1, 2], [1, 2, True], [True] * 3, np.ones(3, bool), [1j, 0, 0]),
        np.array(["2020-01-01"] * 3, "datetime64[D]"),
    ],
)
def test_no_array_of_numbers(value):
    with pytest.raises(TypeError, match=r"x(\[\d\])? is .*; it must"):
        array("x", value, (3,))


@pytest.mark.parametrize(
    ("value", "where"),
    [([0, math.nan], "[1]"), ([-math.inf, 0], "[0]"), ([0, 10**400], "[1]"), ([0, 2 * HUGE], "[1]")],
)
def test_an_array_with_a_number_out_of_bounds(value, where):
    with pytest.raises(
        ValueError, match=r"x\[\d\] is .*; it must be a number from -1e\+30 to 1e\+30"
    ) as error:
        array("x", value, (2,))
    assert f"x{where} is" in str(error.value)


def test_an_array_of_whole_numbers():
    assert whole_array("i", [[0, 1], [2, 3]], (None, 2)).tolist() == [[0, 1], [2, 3]]
    assert whole_array("i", [], (None,)).dtype == np.int64
    for value in ([0.5, 1], [1.0], [True, 1], ["a"], [None]):
        with pytest.raises(TypeError):
            whole_array("i", value, (None,))
    for value in ([-1], [5], np.array([2**64 - 1], np.uint64), [10**400]):
        with pytest.raises(ValueError, match=r"i\[0\] is .*; it must be a whole number from 0 to 4"):
            whole_array("i", value, (None,), high=4)


def test_indices():
    assert indices("copies", [2, 0], 3).tolist() == [2, 0]
    assert indices("copies", np.array([2, 2], np.uint8), 3).tolist() == [2, 2]
    assert indices("copies", [False, True, True], 3).tolist() == [1, 2]
    assert indices("copies", np.zeros(3, bool), 3).tolist() == []
    assert indices("copies", range(3), 3).tolist() == [0, 1, 2]
    assert indices("copies", [], 3).tolist() == []
    for value in ([-1], [3], [True] * 2, [[0]], 0, np.int64(0)):
        with pytest.raises(ValueError, match="copies"):
            indices("copies", value, 3)
    for value in ([0.0], ["0"], None, "0", [True, 1], {0}):
        with pytest.raises(TypeError, match="copies"):
            indices("copies", value, 3)
    with pytest.raises(ValueError, match="copies names 2 twice"):
        indices("copies", [2, 0, 2], 3, once=True)


def test_what_is_shown_is_short_and_never_fails():
    class Rude:
        def __repr__(self):
            raise RuntimeError

    assert shown(Rude()) == "a Rude"
    assert shown(10**5000) == "a int"
    assert shown(np.float64(2)) == "2.0"
    assert len(shown(np.zeros((100, 100)))) <= 80


def test_numbers_apart():
    assert apart(0.5, 2.0) == ("0.5", "2")
    assert apart(1.0, 1.0) == ("1", "1")
    assert apart(1.6 * (1 + 1e-9), 1.6) == ("1.600000002", "1.6")
    assert apart(0.1 + 0.2, 0.3) == ("0.30000000000000004", "0.29999999999999999")
    assert len(set(apart(math.nan, 0.5))) == 2


BODY = cube()
LIMIT = REFUSED * Simulator(Scene(BODY)).largest_step


def low(gap):
    lowest = BODY.positions[:, 2].min()
    return Scene(
        BODY, BODY.positions - [0, 0, lowest - gap], surfaces=(floor(),), contact=Contact(reach=0.01)
    )


def facing(reach):
    planes = Plane((0, 0, -0.2)), Plane((0, 0, 0.2), (0, 0, -1))
    return Scene(BODY, surfaces=planes, contact=Contact(reach=reach))


def bouncy(restitution):
    x = np.add(BODY.positions, (0, 0, 2))
    scene = Scene(BODY, x, surfaces=(floor(),), contact=Contact(restitution=0.5))
    return varying({"restitution": (1.0, restitution / 0.5)}, scene)


BARELY_WRONG = {
    "step": lambda: Simulator(Scene(BODY), step=LIMIT * (1 + 1e-9)),
    "period": lambda: steps_in(0.02, float(np.float32(0.0005))),
    "start": lambda: low(NEAREST * 0.01 * (1 - 1e-8)),
    "planes": lambda: facing(0.1 * (1 + 1e-9)),
    "range": lambda: number("x", 0.3, low=0.1 + 0.2),
    "array": lambda: array("x", [0.3], (1,), high=0.3 - 1e-12),
    "restitution": lambda: bouncy(1 + 1e-9),
    "duel": lambda: duel.SpringDuel().draw(None, {}, {"scale": duel.LARGEST * (1 + 1e-9)}),
}
"""What is refused for a number that is its bound, but for a digit far behind."""


@pytest.mark.parametrize("what", BARELY_WRONG)
def test_a_number_and_its_bound_never_look_the_same(what):
    with pytest.raises(ValueError, match=r"\d") as refusal:
        BARELY_WRONG[what]()
    message = str(refusal.value)
    numbers = re.findall(r"(?<![\w.])\d+(?:\.\d+)?(?:e[-+]\d+)?", message)
    near = [
        (one, other)
        for one, other in itertools.combinations(numbers, 2)
        if float(other) and abs(float(one) / float(other) - 1) < 1e-5
    ]
    assert near, message
    assert all(one != other for one, other in near), message


@pytest.mark.parametrize(
    ("text", "shows"),
    [
        ("a top, ω = 5 rad/s, 70\u00a0kg, 日本", "a top, ω = 5 rad/s, 70\u00a0kg, 日本"),
        ("\x1b[31m", r"\x1b[31m"),
        ("a\x07\r\n\tb\x9b\x7f", r"a\x07\r\n\tb\x9b\x7f"),
        ("\u202egnp\u2066.exe", r"\u202egnp\u2066.exe"),
        ("\udc80", r"\udc80"),
    ],
)
def test_what_is_printed_holds_nothing_that_a_terminal_obeys(text, shows):
    assert printable(text) == shows


def test_things_are_counted_in_words():
    assert [counted(n, "step") for n in (0, 1, 2, 12345)] == ["0 steps", "1 step", "2 steps", "12,345 steps"]
    assert [counted(n, "body", "bodies") for n in (1, 2)] == ["1 body", "2 bodies"]


def test_a_similar_name_is_suggested_or_all_are():
    names = ["verlet", "symplectic_euler", "rk4"]
    assert suggestion("verlt", names) == "; did you mean 'verlet'?"
    assert suggestion("euler", names) == "; did you mean 'symplectic_euler'?"
    assert similar("hop", names) == ""
    assert suggestion("hop", names) == "; choose from: verlet, symplectic_euler, rk4"
    assert similar(None, names) == ""
