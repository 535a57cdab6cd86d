"""Theory beside what was measured: checks by the name a scene file gives them."""

from __future__ import annotations

from collections.abc import Callable, Sequence

from springgym.scene import Scene
from springgym.scenes.checks.basis import NOT_COVERED, Check
from springgym.scenes.checks.contact import (
    axial_spin,
    bounces,
    bowl_period,
    impact,
    pipe_period,
    rest_height,
    resting_tip,
    restitution,
    rubbing,
    slope,
    stopping,
    straight_fall,
)
from springgym.scenes.checks.free import energy, flips, momentum, spun_length, twin
from springgym.scenes.checks.needs import fitting
from springgym.scenes.checks.solids import cable, ring_down, ring_frequency, solid_inertia, spin_gap, wobble
from springgym.scenes.checks.swings import (
    bungee,
    pendulum,
    rope_modes,
    rope_stretch,
    rope_swing,
    small_swings,
)
from springgym.scenes.checks.together import (
    bowl_turning,
    counted,
    cradle,
    draped,
    exchange,
    slab,
    stacked,
    wave,
)
from springgym.scenes.checks.tops import nutation, sleep, steady_precession
from springgym.scenes.recording import Recording

TOGETHER = (bowl_turning, counted, cradle, draped, exchange, slab, stacked, wave)
"""Checks of all bodies that collide."""

CHECKS: dict[str, Callable[[Recording], list[Check]]] = {
    function.__name__: function
    for function in (
        axial_spin,
        bounces,
        bungee,
        cable,
        bowl_period,
        energy,
        flips,
        impact,
        momentum,
        nutation,
        pendulum,
        pipe_period,
        rest_height,
        resting_tip,
        restitution,
        ring_down,
        ring_frequency,
        rope_modes,
        rope_stretch,
        rope_swing,
        rubbing,
        sleep,
        slope,
        small_swings,
        solid_inertia,
        spin_gap,
        spun_length,
        steady_precession,
        stopping,
        straight_fall,
        twin,
        wobble,
        *TOGETHER,
    )
}


def of_all(scene: Scene, names: Sequence[str]) -> list[str]:
    """Which of the checks are of all bodies together: where they collide, none keeps its own energy."""
    together = {function.__name__ for function in TOGETHER}
    if scene.meetings:
        together |= {"energy", "momentum"}
    return [name for name in names if name in together]


def check(recording: Recording) -> list[Check]:
    """All that a scene file asks to check, of several bodies together and then one after another.

    Raises
    ------
    ValueError
        Naming the check that has nothing to say of such a scene.
    """
    fitting(recording.plan)
    found: list[Check] = []
    for name in recording.plan.checks:
        try:
            found += CHECKS[name](recording)
        except (ValueError, ArithmeticError, LookupError) as error:
            raise ValueError(f"check {name!r} does not fit scene {recording.plan.name!r}: {error}") from error
    if recording.plan.parts:
        each = zip(recording.plan.scene.bodies, recording.parts, strict=True)
        found += [
            result._replace(quantity=f"{placed.name}: {result.quantity}")
            for placed, part in each
            for result in check(part)
        ]
    return found


__all__ = ["CHECKS", "NOT_COVERED", "Check", "check", "fitting", "of_all"]
