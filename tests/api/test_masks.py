"""Arrays that hide values by a mask are refused wherever arrays can be given: NumPy would use these."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from springgym import Scene, Simulator
from springgym.checks import array, flag, hides, indices, number, readings, whole, whole_array
from springgym.model.bodies import cube
from tests.api.test_bodies import DOORS as BODIES
from tests.api.test_scenes import DOORS as SCENES


def holds_numbers(value: Any) -> bool:
    if not isinstance(value, (list, tuple, np.ndarray)) or not len(value):
        return False
    given = np.asarray(value)
    return given.dtype.kind in "iuf" and given.size > 0


ARRAYS = [
    pytest.param(call, right, name, id=f"{call.__name__}-{name}")
    for call, right in (*BODIES, *SCENES)
    for name, value in right.items()
    if holds_numbers(value)
]


@pytest.mark.parametrize(("call", "right", "name"), ARRAYS)
def test_an_argument_with_hidden_values_is_refused(call: Any, right: dict[str, Any], name: str) -> None:
    value = np.asarray(right[name])
    some = np.zeros(value.shape, bool)
    some.flat[0] = True
    for hidden in (np.ma.MaskedArray(value, some), np.ma.masked_all_like(value)):
        with pytest.raises(ValueError, match=rf"{name}.* is .*; it must be an array without hidden values"):
            call(**{**right, name: hidden})


def test_many_arguments_are_arrays() -> None:
    assert len(ARRAYS) > 40


def test_a_simulator_refuses_hidden_values_and_changes_nothing() -> None:
    made = Simulator(Scene(cube()), copies=2)
    x = made.positions.copy()
    v = made.velocities.copy()
    hidden = np.ma.masked_all_like(x)
    for given in ((hidden, v), (x, hidden)):
        with pytest.raises(ValueError, match="it must be an array without hidden values"):
            made.place(*given)
    with pytest.raises(ValueError, match=r"copies is .*hidden values"):
        made.place(x[:1], v[:1], copies=np.ma.MaskedArray([0], [True]))
    np.testing.assert_array_equal(made.positions, x)
    np.testing.assert_array_equal(made.velocities, v)


def test_a_mask_that_hides_nothing_is_no_mask() -> None:
    plain = np.ma.MaskedArray([1.0, 2.0, 3.0], [False, False, False])
    assert array("x", plain, (3,)).tolist() == [1.0, 2.0, 3.0]
    assert not hides([plain, [plain]])


@pytest.mark.parametrize(
    "check",
    [
        lambda given: array("x", given, (2,), (2, 2)),
        lambda given: readings("x", given, (2,), (2, 2)),
        lambda given: whole_array("x", given, (2,), (2, 2)),
        lambda given: indices("x", given, 5),
    ],
)
@pytest.mark.parametrize(
    "hidden",
    [
        np.ma.MaskedArray([1, 2], [False, True]),
        [np.ma.MaskedArray([1, 2], [False, True]), [1, 2]],
        [1, np.ma.masked],
        (np.ma.masked, np.ma.masked),
        np.ma.masked,
    ],
)
def test_each_check_of_arrays_refuses_hidden_values(check: Any, hidden: Any) -> None:
    with pytest.raises(ValueError, match=r"x is .*; it must be an array without hidden values"):
        check(hidden)


@pytest.mark.parametrize("check", [number, whole, flag])
def test_each_check_of_a_number_refuses_a_hidden_one(check: Any) -> None:
    for hidden in (np.ma.masked, np.ma.MaskedArray(1, True)):
        with pytest.raises(TypeError, match="x is "):
            check("x", hidden)
