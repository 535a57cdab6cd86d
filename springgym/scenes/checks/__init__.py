"""Theory beside what was measured: checks by the name a scene file gives them."""

from __future__ import annotations

from collections.abc import Callable

from springgym.scenes.checks.basis import Check
from springgym.scenes.checks.contact import (
    bounces,
    dish_period,
    rest_height,
    restitution,
    slope,
    stopping,
    straight_fall,
)
from springgym.scenes.checks.free import energy, flips, momentum, spun_length, twin
from springgym.scenes.checks.swings import (
    bungee,
    pendulum,
    rope_modes,
    rope_stretch,
    rope_swing,
    small_swings,
)
from springgym.scenes.checks.tops import nutation, sleep, steady_precession
from springgym.scenes.recording import Recording

CHECKS: dict[str, Callable[[Recording], list[Check]]] = {
    check.__name__: check
    for check in (
        bounces,
        bungee,
        dish_period,
        energy,
        flips,
        momentum,
        nutation,
        pendulum,
        rest_height,
        restitution,
        rope_modes,
        rope_stretch,
        rope_swing,
        sleep,
        slope,
        small_swings,
        spun_length,
        steady_precession,
        stopping,
        straight_fall,
        twin,
    )
}

__all__ = ["CHECKS", "Check"]
