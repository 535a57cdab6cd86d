"""Recordings of the scenes, made once."""

from functools import cache

from springgym.scenes import load
from springgym.scenes.recording import record
from tests.params import slow_but

OFTEN = {
    *("top", "top-waves", "elongated-top", "unbalanced-top", "steady-top", "fast-top", "gyroscope"),
    *("sleeping-top", "waking-top", "cube-pendulum", "cube-pendulum-high", "irregular-pendulum"),
    *("rope-swing", "bungee", "sliding-block", "block-holds", "block-slides"),
    *("cube-drop", "irregular-fall", "top-with-friction"),
    *("balls-head-on", "balls-oblique", "newtons-cradle"),
    *("ringing-rubber-top", "steel-rope", "nylon-rope"),
}
"""Scenes that take three compiled variants in all, and no more than a second; slow runs take the others."""


@cache
def recorded(name):
    return record(load(name))


def marked(names):
    """Names as parameters of a test, the slow ones marked."""
    return slow_but(names, *(name for name in names if name in OFTEN))
