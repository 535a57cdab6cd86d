"""Recordings of the scenes, made once."""

from functools import cache

import pytest

from springgym.scenes import load
from springgym.scenes.recording import record

OFTEN = {
    *("top", "top-waves", "elongated-top", "unbalanced-top", "steady-top", "fast-top", "gyroscope"),
    *("sleeping-top", "waking-top", "cube-pendulum", "cube-pendulum-high", "irregular-pendulum"),
    *("rope-hanging", "rope-swing", "bungee", "sliding-block", "block-holds", "block-slides"),
    *("cube-drop", "irregular-fall", "top-with-friction"),
    *("balls-head-on", "balls-oblique", "newtons-cradle"),
    *("beech-top", "rubber-top", "ringing-rubber-top", "steel-rope", "nylon-rope"),
}
"""Scenes that take three compiled variants in all; the others are for long runs."""

SELDOM = {"beech-top", "rubber-top", "rope-hanging"}
"""Those of them that take seconds."""


@cache
def recorded(name):
    return record(load(name))


def marked(names):
    """Names as parameters of a test, the slow ones marked."""
    marks = {name: pytest.mark.seldom if name in SELDOM else () for name in OFTEN}
    return [pytest.param(name, marks=marks.get(name, pytest.mark.slow)) for name in names]
