import itertools
import os
import time
from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from functools import partial
from typing import Any, Literal

import pytest

from springgym.scenes.strict_yaml import LARGEST, YamlError, build, fit, parse_yaml, read_json, read_yaml


@dataclass
class Thing:
    count: int
    size: float = 1.0
    name: str | None = None
    colour: Literal["red", "blue"] = "red"
    point: tuple[float, float] = (0.0, 0.0)
    place: float | tuple[float, float] = 0.0
    sides: Sequence[float] | Sequence[Sequence[float]] = ()
    factors: Mapping[int, float] | None = None
    flags: dict[str, bool] | None = None
    anything: Any = None

    def __post_init__(self) -> None:
        if self.count < 0:
            raise ValueError(f"count is {self.count}; it must not be negative")


def made(text):
    return build(Thing, parse_yaml(text, "file.yaml"))


def test_values_of_every_kind():
    thing = made(
        """
count: 3
size: 1e5
name: null
colour: blue
point: [1, 2.5]
sides: [1, 2, 3e-4]
factors: {0: 2, 7: 0.5}
flags: {on: true}
anything: [1, {a: b}]
"""
    )
    sides = (1.0, 2.0, 3e-4)
    factors = {0: 2.0, 7: 0.5}
    rest = ({"on": True}, [1, {"a": "b"}])
    assert thing == Thing(3, 1e5, None, "blue", (1.0, 2.5), 0.0, sides, factors, *rest)
    assert made("count: 1\nsides: [[1, 2], [3]]").sides == ((1.0, 2.0), (3.0,))
    assert type(thing.size) is float
    assert type(thing.point[0]) is float


@pytest.mark.parametrize("number", ["1e5", "1E5", "1.e5", "1.0e+5", "+1e5", "100000", ".1e6", "10_0000"])
def test_every_way_to_write_a_number(number):
    assert made(f"count: 1\nsize: {number}").size == 1e5


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("count: 1\nsise: 2", "file.yaml:2: unknown key 'sise'; did you mean 'size'?"),
        ("count: 1\nweight: 2", "file.yaml:2: unknown key 'weight'; choose from: count, size,"),
        ("count: 1\nsize: 2\ncount: 3", "file.yaml:3: duplicate key 'count'"),
        ("size: 2", "file.yaml:1: the file lacks count"),
        ("count: 1.5", "file.yaml:1: count: expected a whole number, got 1.5"),
        ("count: true", "file.yaml:1: count: expected a whole number, got True"),
        ("count: '1'", "file.yaml:1: count: expected a whole number, got '1'"),
        ("count: 1\nsize: big", "file.yaml:2: size: expected a number, got 'big'"),
        ("count: 1\nsize: no", "file.yaml:2: size: expected a number, got False"),
        ("count: 1\nname: 5", "file.yaml:2: name: expected text or null, got 5"),
        ("count: 1\ncolour: green", "file.yaml:2: colour: expected one of red, blue, got 'green'"),
        ("count: 1\npoint: [1, 2, 3]", "file.yaml:2: point: expected a list of 2 values, got [1, 2, 3]"),
        ("count: 1\nsides:\n - 1\n - x", "file.yaml:4: sides.1: expected a number, got 'x'"),
        ("count: 1\nfactors: {a: 1}", "file.yaml:2: factors: expected a whole number as a key, got 'a'"),
        ("count: 1\nflags: {a: 1}", "file.yaml:2: flags.a: expected true or false, got 1"),
        ("count: 1\nflags: [true]", "file.yaml:2: flags: expected a mapping or null, got [True]"),
        ("count: 1\nplace: [1, x]", "file.yaml:2: place.1: expected a number, got 'x'"),
        ("count: 1\nsides: [[1, 2], [x]]", "file.yaml:2: sides.0: expected a number, got [1, 2]"),
        ("count: 1\nplace: [1]", "file.yaml:2: place: expected a number or a list of 2 values, got [1]"),
        ("count: 1\nanything:\n  a: 1\n  a: 2", "file.yaml:4: duplicate key 'a'"),
        ("count: -1", "file.yaml:1: the file: count is -1; it must not be negative"),
        ("[1, 2]", "file.yaml:1: the file must be a mapping of keys to values, not [1, 2]"),
        ("", "file.yaml: the file must be a mapping of keys to values, not None"),
        ("? [a]\n: 1", "file.yaml:1: a key must be a word"),
        ("count: [1", "not valid YAML"),
        ("count: !!python/object:os.system x", "not valid YAML: could not determine a constructor"),
        ("count: 2001-99-99", "file.yaml:1: '2001-99-99' is not a valid timestamp: 'month must be"),
        ("anything: &a [*a]", "an alias refers to itself"),
        ("count: 1\nsize: \x01", "file.yaml:2: not valid YAML: the character '\\x01' is not allowed"),
        ("count: 010", "file.yaml:1: count: expected a whole number, got '010'"),
        ("count: 1:30", "file.yaml:1: count: expected a whole number, got '1:30'"),
        ("count: 1\nsize: 1:30.5", "file.yaml:2: size: expected a number, got '1:30.5'"),
        ("count: 1\nsize: .inf", "file.yaml:2: size: expected a number of size at most 1e+30, got inf"),
        ("count: 1\nsize: .nan", "file.yaml:2: size: expected a number of size at most 1e+30, got nan"),
        (f"count: 1\nsize: {'9' * 400}", "file.yaml:2: size: expected a number of size at most 1e+30"),
        (f"count: {'9' * 5000}", "file.yaml:1: '9999"),
        ("count: !!bool maybe", "file.yaml:1: 'maybe' is not a valid bool"),
        ("count: 1\nfactors: {0: 1, 00: 2}", "file.yaml:2: duplicate key '00'"),
        (f"count: [{'1, ' * 1000}]", "file.yaml:1: count: expected a whole number, got [1, 1, 1"),
        (f"count: 1\n{'x' * 1000}: 1", "file.yaml:2: unknown key 'xxx"),
    ],
)
def test_error_names_file_line_and_key(text, message):
    with pytest.raises(YamlError) as error:
        made(text)
    assert message in str(error.value)
    assert len(str(error.value)) < 400
    assert "\n" not in str(error.value)


def test_aliases_repeat_a_few_values_and_no_more():
    """Nine aliases a level are ten times as many values: here 9⁸, in 300 bytes."""
    assert made("count: &n 3\nsize: *n\nsides: &s [*n, *n]\nanything: [*s, *s]").anything == [[3, 3], [3, 3]]
    levels = ["count: 1\nanything:\n  a: &a [1, 1, 1, 1, 1, 1, 1, 1, 1]"]
    for before, name in itertools.pairwise("abcdefgh"):
        levels.append(f"  {name}: &{name} [{', '.join([f'*{before}'] * 9)}]")
    began = time.perf_counter()
    with pytest.raises(YamlError, match=r"file\.yaml:\d+: aliases repeat more than 10000 values"):
        made("\n".join(levels))
    assert time.perf_counter() - began < 5


@pytest.mark.parametrize("text", ["[", "a: [0, 1]\n", "- {a: b}\n", "x", "? ", "&a [*a, "])
def test_a_file_costs_seconds_at_most(text, tmp_path):
    """Whatever is in it: a longer one is refused at once, and none of the allowed size takes long."""
    path = tmp_path / "file.yaml"
    for size, most in ((LARGEST + 1, 0.5), (100_000, 5.0)):
        whole = (text * size)[:size]
        path.write_text(whole)
        for parse in (partial(read_yaml, path), partial(parse_yaml, whole, "file.yaml")):
            began = time.process_time()
            with suppress(YamlError):
                parse()
            assert time.process_time() - began < most
    with pytest.raises(
        YamlError, match=r"file\.yaml: cannot read it: it has 300,001 bytes, and at most 300,000"
    ):
        path.write_text(" " * (LARGEST + 1)) and read_yaml(path)
    with pytest.raises(
        YamlError, match=r"file\.yaml: it has 300,001 characters, and at most 300,000 are read"
    ):
        parse_yaml(" " * (LARGEST + 1), "file.yaml")


def deep(path):
    path.write_text("[" * 100_000)


UNREADABLE = {
    "a folder": (lambda path: path.mkdir(), "it is a folder"),
    "nothing": (lambda path: None, "No such file"),
    "nested": (deep, "nested too deeply"),
    "no text": (lambda path: path.write_bytes(b"\xff\xfe\xfa"), ""),
    "half": (lambda path: path.write_text("[1, {"), "not"),
}
if hasattr(os, "mkfifo"):
    UNREADABLE["a pipe"] = (os.mkfifo, "it is not a regular file")


@pytest.mark.parametrize("what", UNREADABLE)
@pytest.mark.parametrize("read", [read_yaml, read_json])
def test_what_cannot_be_read_is_told(read, what, tmp_path):
    path = tmp_path / "file"
    make, says = UNREADABLE[what]
    make(path)
    with pytest.raises(YamlError, match=rf"{path}: .*{says}|{path}:1: .*{says}"):
        read(path)


def test_a_key_given_twice_in_another_writing_is_an_error():
    with pytest.raises(YamlError, match=r"file\.yaml:2: duplicate key '00'"):
        fit(dict[int, float], parse_yaml("a: {0: 1,\n 00: 2}", "file.yaml"), ("a",))


@pytest.mark.parametrize("error", [TypeError("a"), ZeroDivisionError("b"), MemoryError("c"), MemoryError()])
def test_what_is_built_may_fail_in_other_ways(error):
    def broken(count: int) -> None:
        raise error

    with pytest.raises(YamlError, match=rf"file\.yaml:1: the file: {str(error) or 'not enough memory'}"):
        build(broken, parse_yaml("count: 1", "file.yaml"))


def test_errors_of_reading_name_the_file(tmp_path):
    with pytest.raises(YamlError, match=r"nothing\.yaml: cannot read it: No such file"):
        read_yaml(tmp_path / "nothing.yaml")
    (tmp_path / "binary.yaml").write_bytes(b"\xff\xfe\xfa")
    with pytest.raises(YamlError, match=r"binary\.yaml: cannot read it"):
        read_yaml(tmp_path / "binary.yaml")


def test_nested_mapping_skipped_keys_and_given_arguments():
    tree = parse_yaml("outer:\n  kind: thing\n  size: 2\n  count: 4", "file.yaml")
    assert build(Thing, tree, ("outer",), skip=("kind",)) == Thing(4, 2.0)
    with pytest.raises(YamlError, match=r"file\.yaml:2: unknown key 'kind'"):
        build(Thing, tree, ("outer",))
    with pytest.raises(YamlError, match=r"file\.yaml:4: unknown key 'count'"):
        build(Thing, tree, ("outer",), skip=("kind",), count=1)


def test_who_reads_a_text_again_gets_what_it_says():
    for _ in range(2):
        tree = parse_yaml("a: {b: [1, 2]}", "file.yaml")
        assert tree.value == {"a": {"b": [1, 2]}}
        tree.value["a"]["b"].append(3)
        tree.where.clear()
    assert parse_yaml("a: {b: [1, 2]}", "other.yaml").where["a", "b"] == "other.yaml:1"


def test_functions_are_called():
    def area(width: float, height: float = 2.0) -> float:
        return width * height

    assert build(area, parse_yaml("width: 3", "file.yaml")) == 6.0
