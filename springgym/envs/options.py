"""Keyword arguments of environments: types, checks and error messages."""

from __future__ import annotations

import inspect
from collections.abc import Callable, Mapping, Sequence
from enum import Enum
from os import PathLike
from typing import Any, Literal, NamedTuple, TypedDict

import numpy as np
from gymnasium.vector import AutoresetMode
from numpy.typing import DTypeLike

from springgym import checks
from springgym.model.bodies import Body

Observation = Literal["particles", "features"]
Autoreset = AutoresetMode | Literal["NextStep", "SameStep", "Disabled"]


BodyOptions = Mapping[str, Any] | None
"""Arguments of the function that makes a body, instead of a task's own; None for the usual body."""


class Modes(TypedDict, total=False):
    """The observation and action modes of an environment, among those of its task."""

    observation: str
    action: str


class Settings(NamedTuple):
    """Settings of simulation, rewards and time limit of episodes, see `springgym.envs.base.SpringEnv`."""

    integrator: str | None = None
    step: float | None = None
    damping_every: int | None = None
    dynamics: str = "springs"
    dtype: DTypeLike = "float64"
    threads: int = 1
    randomize: Mapping[str, Sequence[float]] | None = None
    sparse: bool = False
    goals: bool = False
    max_episode_steps: int | None = None
    error: bool = False


class SimulationOptions(TypedDict, total=False):
    """Every environment takes these options, see `springgym.envs.base.SpringEnv`."""

    integrator: str | None
    step: float | None
    damping_every: int | None
    dynamics: Literal["springs", "rigid"]
    dtype: DTypeLike
    threads: int
    randomize: Mapping[str, Sequence[float]] | None
    error: bool
    tolerance: float | None


class RewardedOptions(SimulationOptions, total=False):
    """Every environment of one agent takes these options, too."""

    render_mode: Literal["human", "rgb_array", "rgb_array_list"] | None
    sparse: bool


class EnvOptions(RewardedOptions, total=False):
    """Registered environments of one agent take these options, too."""

    max_episode_steps: int | None
    goals: bool
    observation: Observation


def mapping(name: str, value: object) -> Mapping[str, Any]:
    """Return a mapping from names, after checking that it is one."""
    if not isinstance(value, Mapping):
        raise TypeError(f"{name} is {checks.shown(value)}; it must be a mapping such as a dict")
    return value


def number(options: dict[str, Any], name: str, otherwise: float, low: float, high: float) -> float:
    """Return a number from ``low`` to ``high``, removed from reset options; ``otherwise`` without one."""
    if name not in options:
        return otherwise
    return checks.number(f"reset option {name!r}", options.pop(name), low, high)


def arguments(maker: Callable[..., Any], given: Mapping[str, Any]) -> dict[str, Any]:
    """Return all arguments of a call by name, defaults included, as plain data; functions become names."""
    bound = inspect.signature(maker).bind(**given)
    bound.apply_defaults()
    return {name: plain(value, names=True) for name, value in bound.arguments.items()}


def plain(value: object, names: bool = False) -> Any:
    """Return an argument as data that JSON can hold.

    Other objects are left as they are or, with ``names``, replaced by the name of the function or type.
    """
    if isinstance(value, Mapping):
        return {str(key): plain(item, names) for key, item in value.items()}
    if isinstance(value, (list, tuple)):
        return [plain(item, names) for item in value]
    if isinstance(value, np.dtype) or (isinstance(value, type) and issubclass(value, (np.generic, float))):
        return np.dtype(value).name
    if isinstance(value, (np.ndarray, np.generic)):
        return value.tolist()
    if isinstance(value, PathLike):
        return str(value)
    if isinstance(value, Enum):
        return plain(value.value, names)
    if names and value is not None and not isinstance(value, (bool, int, float, str)):
        return getattr(value, "__qualname__", type(value).__qualname__)
    return value


def made(maker: Callable[..., Body], body: BodyOptions, **usual: object) -> Body:
    """Make a body with its default arguments, of which the user's ``body`` replaces some.

    Keys that are numbers may be strings, as in JSON.

    Raises
    ------
    TypeError, ValueError
        If the function has no such argument, or refuses its value; the message names it.
    """
    given = {} if body is None else dict(mapping("body", body))
    known = inspect.signature(maker).parameters
    for name, value in given.items():
        if name not in known:
            raise ValueError(f"body has no {name!r}; {maker.__name__} takes {', '.join(known)}")
        if isinstance(value, Mapping):
            numbers = (int(key) if isinstance(key, str) and key.isdecimal() else key for key in value)
            given[name] = dict(zip(numbers, value.values(), strict=True))
    try:
        return maker(**(usual | given))
    except (TypeError, ValueError) as error:
        raise type(error)(f"body: {error}") from error
