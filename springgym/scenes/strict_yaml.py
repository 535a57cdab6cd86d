"""Strict YAML reader: unknown, repeated, missing or mistyped keys are errors with file, line and key.

`read_yaml` parses a file to a `Tree`; `build` calls a function, or makes a dataclass, with a mapping
of it, checked against the annotations of its parameters.
"""

from __future__ import annotations

import copy
import inspect
import json
import pickle
import re
import types
from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from dataclasses import is_dataclass
from functools import lru_cache
from pathlib import Path
from typing import Any, Literal, NamedTuple, Union, cast, get_args, get_origin, get_type_hints

import yaml

from springgym.checks import HUGE, instance, shown, suggestion, unreadable


class YamlError(ValueError):
    """A file that cannot be used; the message says where and why."""


UNIONS = (Union, types.UnionType)
FORMS: dict[object, tuple[type, ...]] = {
    **{kind: (kind,) for kind in (int, bool, str, type(None))},
    float: (int, float),
}
"""Types of values that an annotation accepts."""
NAMES = {int: "a whole number", float: "a number", bool: "true or false", str: "text", type(None): "null"}


class Tree(NamedTuple):
    """A parsed document; for each path of keys in it (list items by number), the file and line."""

    value: Any
    where: dict[tuple[str, ...], str]

    def at(self, path: tuple[str, ...]) -> Any:
        """Return the value at a path."""
        value = self.value
        for key in path:
            value = value[int(key)] if isinstance(value, list) else value[key]
        return value


LARGEST = 300_000
"""Largest size of a YAML file [bytes]: parsing takes some 10 µs per byte."""

LARGEST_JSON = 100_000_000
"""Largest size of a JSON file [bytes]."""

MOST_REPEATED = 10_000
"""Largest number of values that aliases may add: nested aliases make billions from a few hundred bytes."""


class _Loader(yaml.SafeLoader):
    """YAML 1.1 as PyYAML reads it, except for numbers.

    Exponents without a point make a number, which PyYAML reads as text. `010` and `1:30` are text, which it
    reads as 8 and 90.
    """


_Loader.yaml_implicit_resolvers = {
    first: [(tag, written) for tag, written in resolvers if tag.rpartition(":")[2] not in ("int", "float")]
    for first, resolvers in yaml.SafeLoader.yaml_implicit_resolvers.items()
}
for _kind, _written in {
    "int": r"^[-+]?(0|[1-9][0-9_]*|0b[01_]+|0x[0-9a-fA-F_]+)$",
    "float": r"^[-+]?(([0-9][0-9_]*\.[0-9_]*|\.[0-9][0-9_]*)([eE][-+]?[0-9]+)?|[0-9][0-9_]*[eE][-+]?[0-9]+)$"
    r"|^[-+]?\.(inf|Inf|INF)$|^\.(nan|NaN|NAN)$",
}.items():
    _Loader.add_implicit_resolver(f"tag:yaml.org,2002:{_kind}", re.compile(_written), list("-+.0123456789"))


def read_yaml(path: Path) -> Tree:
    """Parse a file.

    Raises
    ------
    YamlError
        If it cannot be read or is not valid, or a key is given twice.
    """
    if why := unreadable(path, LARGEST):
        raise YamlError(f"{path}: cannot read it: {why}")
    try:
        text = path.read_text(encoding="utf-8")
    except (OSError, UnicodeDecodeError) as error:
        raise YamlError(f"{path}: cannot read it: {getattr(error, 'strerror', error)}") from error
    return parse_yaml(text, str(path))


def read_json(path: Path) -> Any:
    """Parse a JSON file.

    Raises
    ------
    YamlError
        If it cannot be read or is not valid.
    """
    if why := unreadable(path, LARGEST_JSON):
        raise YamlError(f"{path}: cannot read it: {why}")
    try:
        return json.loads(path.read_text(encoding="utf-8"))
    except OSError as error:
        raise YamlError(f"{path}: cannot read it: {error.strerror}") from error
    except ValueError as error:
        raise YamlError(f"{path}: the file is not JSON: {error}") from error
    except RecursionError:
        raise YamlError(f"{path}: the file is nested too deeply") from None


def parse_yaml(text: str, source: str) -> Tree:
    """Parse a text, whose origin in error messages is ``source``. Keys are text: ``0:`` is "0".

    Raises
    ------
    YamlError
        If it is not valid or too long, a key is given twice, or aliases repeat more than `MOST_REPEATED`
        values.
    """
    if len(text) > LARGEST:
        raise YamlError(f"{source}: it has {len(text):,} characters, and at most {LARGEST:,} are read")
    return cast(Tree, pickle.loads(_parsed(text, source)))


@lru_cache(maxsize=64)
def _parsed(text: str, source: str) -> bytes:
    """Parse a text into a pickled `Tree`, of which each caller of `parse_yaml` gets its own copy."""
    where: dict[tuple[str, ...], str] = {}
    most = len(text) + MOST_REPEATED  # each written value takes at least one character

    def value_of(node: yaml.Node, path: tuple[str, ...], here: str) -> object:
        where[path] = here
        if len(where) > most:
            raise YamlError(f"{here}: aliases repeat more than {MOST_REPEATED} values")
        if isinstance(node, yaml.SequenceNode):
            return [value_of(item, (*path, str(n)), _line(source, item)) for n, item in enumerate(node.value)]
        if not isinstance(node, yaml.MappingNode):
            try:
                return loader.construct_object(node)
            except yaml.YAMLError:
                raise
            except Exception as error:  # such as the 99th of a month, or a !!bool that is none
                kind = node.tag.rpartition(":")[2]
                raise YamlError(
                    f"{here}: {shown(node.value)} is not a valid {kind}: {shown(str(error))}"
                ) from error
        entries: dict[str, object] = {}
        for key_node, value_node in node.value:
            here = _line(source, key_node)
            key = key_node.value
            if not isinstance(key, str):
                raise YamlError(f"{here}: a key must be a word")
            if key in entries:
                raise YamlError(f"{here}: duplicate key {shown(key)}")
            entries[key] = value_of(value_node, (*path, key), here)
        return entries

    try:
        loader = _Loader(text)
        try:
            node = loader.get_single_node()
            value = None if node is None else value_of(node, (), f"{source}:1")
            return pickle.dumps(Tree(value, {(): source} | where))
        finally:
            loader.dispose()
    except yaml.YAMLError as error:
        if isinstance(error, yaml.reader.ReaderError):
            line = text.count("\n", 0, error.position) + 1
            problem = f"the character {chr(error.character)!r} is not allowed"
        else:
            mark = getattr(error, "problem_mark", None)
            line = mark.line + 1 if mark else 1
            problem = " ".join(str(getattr(error, "problem", None) or error).split())
        raise YamlError(f"{source}:{line}: not valid YAML: {problem}") from error
    except RecursionError:
        raise YamlError(f"{source}: the file is nested too deeply, or an alias refers to itself") from None


def changed(tree: Tree, changes: Mapping[tuple[str, ...], object], source: str = "a change") -> Tree:
    """Return a document in which the values at some paths are replaced; keys that are missing are added.

    Raises
    ------
    TypeError
        If ``changes`` is not a mapping.
    YamlError
        If a path is not a tuple or is empty, if a key is not a string, or if a path leads through a value
        that is neither a mapping nor a list.
    """
    instance("changes", changes, Mapping)
    value = copy.deepcopy(tree.value)
    where = dict(tree.where)
    for path, given in changes.items():
        inside = value
        new = copy.deepcopy(given)
        paths = list(_paths(new, path)) if isinstance(path, tuple) else []
        if not path or not paths or not all(isinstance(key, str) for each in paths for key in each):
            raise YamlError(
                f"{source}: {shown(path)}: a path must be a tuple of at least one key, and every key must be "
                "a string"
            )
        for n, key in enumerate(path):
            last = n == len(path) - 1
            if isinstance(inside, list) and key.isdecimal() and int(key) < len(inside):
                if last:
                    inside[int(key)] = new
                inside = inside[int(key)]
            elif isinstance(inside, dict):
                if last:
                    inside[key] = new
                elif inside.get(key) is None:
                    inside[key] = {}
                    where[path[: n + 1]] = source
                inside = inside[key]
            else:
                raise YamlError(f"{source}: there is no {'.'.join(path)} in {where[()]}")
        where |= dict.fromkeys(paths, source)
    return Tree(value, where)


def _paths(value: object, path: tuple[str, ...]) -> Iterator[tuple[str, ...]]:
    """Yield the paths of a value and of all in it; items of lists by number, as text."""
    yield path
    if isinstance(value, dict):
        for key, item in value.items():
            yield from _paths(item, (*path, key))
    elif isinstance(value, list):
        for n, item in enumerate(value):
            yield from _paths(item, (*path, str(n)))


def _line(source: str, node: yaml.Node) -> str:
    return f"{source}:{node.start_mark.line + 1}"


def build(
    make: Callable[..., Any],
    tree: Tree,
    path: tuple[str, ...] = (),
    /,
    skip: Collection[str] = (),
    **given: object,
) -> Any:
    """Call ``make`` with the mapping at ``path`` of a document as keyword arguments, besides ``given``.

    Parameters
    ----------
    make
        A dataclass or function, whose parameters are annotated.
    tree, path
        The document, and the keys that lead to the mapping.
    skip
        Keys of the mapping that are handled elsewhere.
    given
        Arguments that do not come from the document.

    Raises
    ------
    YamlError
        For an unknown, missing or mistyped key, or if ``make`` refuses its arguments, cannot read a file that
        they name, or lacks memory.
    """
    entries = tree.at(path)
    place = tree.where[path]
    name = ".".join(path) or "the file"
    if not isinstance(entries, dict):
        raise YamlError(f"{place}: {name} must be a mapping of keys to values, not {shown(entries)}")
    parameters = {key: value for key, value in inspect.signature(make).parameters.items() if key not in given}
    for key in entries:
        if key not in parameters and key not in skip:
            known = [*skip, *parameters]
            raise YamlError(f"{tree.where[*path, key]}: unknown key {shown(key)}{suggestion(key, known)}")
    missing = [
        key for key, value in parameters.items() if key not in entries and value.default is value.empty
    ]
    if missing:
        raise YamlError(f"{place}: {name} lacks {', '.join(missing)}")
    hints = get_type_hints(make)
    values = {key: fit(hints[key], tree, (*path, key)) for key in entries if key not in skip}
    try:
        return make(**given, **values)
    except YamlError:
        raise
    except (ValueError, TypeError, ArithmeticError, OSError, MemoryError) as error:
        raise YamlError(f"{place}: {name}: {str(error) or 'not enough memory'}") from error


def fit(kind: object, tree: Tree, path: tuple[str, ...]) -> Any:
    """Return the value at a path, if it is of a kind: a type annotation.

    Raises
    ------
    YamlError
        If it is not.
    """
    value = tree.at(path)
    failed = None
    for one in get_args(kind) if get_origin(kind) in UNIONS else (kind,):
        if _has_form(one, value):
            try:
                return _made(one, tree, path, value)
            except YamlError as error:  # a more specific message than that it fits none
                failed = failed or error
    raise failed or YamlError(
        f"{tree.where[path]}: {'.'.join(path)}: expected {_described(kind)}, got {shown(value)}"
    )


def _made(kind: Any, tree: Tree, path: tuple[str, ...], value: Any) -> Any:
    """Return a value of the form of a kind that is no union, after checking its contents."""
    origin = get_origin(kind)
    arguments = get_args(kind)
    if kind is float:
        return _number(tree, path, value)
    if isinstance(kind, type) and is_dataclass(kind):
        return build(kind, tree, path)
    if origin in (dict, Mapping):
        found: dict[str | int, object] = {}
        for name in value:
            key = _key(arguments[0], name, tree, path)
            if key in found:
                raise YamlError(f"{tree.where[*path, name]}: duplicate key {name!r}")
            found[key] = fit(arguments[1], tree, (*path, name))
        return found
    if origin in (list, tuple, Sequence):
        kinds = arguments if _is_of_length(kind) else [arguments[0]] * len(value)
        items = [fit(each, tree, (*path, str(n))) for n, each in enumerate(kinds)]
        return items if origin is list else tuple(items)
    return value


def _has_form(kind: object, value: object) -> bool:
    """Return whether a value has the type of a kind that is no union, whatever lists and mappings hold."""
    origin = get_origin(kind)
    arguments = get_args(kind)
    if kind in FORMS:
        return type(value) in FORMS[kind]
    if origin is Literal:
        return value in arguments
    if origin in (list, tuple, Sequence):
        return isinstance(value, list) and not (_is_of_length(kind) and len(value) != len(arguments))
    return kind in (Any, object) or isinstance(value, dict)


def _is_of_length(kind: object) -> bool:
    """Return whether a kind is a tuple of fixed length, such as ``tuple[float, float]``."""
    return get_origin(kind) is tuple and get_args(kind)[-1] is not ...


def _number(tree: Tree, path: tuple[str, ...], value: float) -> float:
    if -HUGE <= value <= HUGE:
        return float(value)
    place = f"{tree.where[path]}: {'.'.join(path)}"
    raise YamlError(f"{place}: expected a number of size at most {HUGE:g}, got {shown(value)}")


def _key(kind: object, key: str, tree: Tree, path: tuple[str, ...]) -> str | int:
    if kind is str:
        return key
    if kind is int and re.fullmatch(r"[0-9]{1,18}", key):
        return int(key)
    place = f"{tree.where[*path, key]}: {'.'.join(path)}"
    raise YamlError(f"{place}: expected {_described(kind)} as a key, got {shown(key)}")


def _described(kind: object) -> str:
    origin = get_origin(kind)
    arguments = get_args(kind)
    if kind in NAMES:
        return NAMES[kind]
    if origin is Literal:
        return f"one of {', '.join(map(str, arguments))}"
    if origin in UNIONS:
        return " or ".join(map(_described, arguments))
    if _is_of_length(kind):
        return f"a list of {len(arguments)} values"
    return "a list" if origin in (list, tuple, Sequence) else "a mapping"
