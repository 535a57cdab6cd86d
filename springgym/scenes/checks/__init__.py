"""Checks that compare measurements with theory, by their names in scene files."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from springgym.checks import instance, shown, suggestion
from springgym.model.scene import Scene
from springgym.scenes.checks import billiards, contact, free, rolling, solids, swings, together, tops  # noqa: F401  (they fill CHECKS)
from springgym.scenes.checks.basis import CHECKS, NEEDS, TOGETHER, Check
from springgym.scenes.plan import Plan
from springgym.scenes.recording import Recording


def of_all(scene: Scene, names: Sequence[str]) -> list[str]:
    """Return the checks that concern all bodies together: bodies that collide exchange energy."""
    instance("scene", scene, Scene)
    for name in instance("names", names, tuple, list):
        instance("a name in names", name, str)
    of_them = TOGETHER | {"energy", "momentum"} if scene.meetings else TOGETHER
    return [name for name in names if name in of_them]


def fitting(plan: Plan) -> None:
    """Raise ValueError for checks that do not exist, or do not suit the scene.

    Raises
    ------
    ValueError
        If there is no such check, or it does not suit the scene; the message says why.
    """
    for part in instance("plan", plan, Plan).parts:
        fitting(part)
    for name in plan.checks:
        if name not in CHECKS:
            raise ValueError(f"plan has an unknown check {shown(name)}{suggestion(name, CHECKS)}")
        try:
            for need in NEEDS[name]:
                need(plan)
        except ValueError as error:
            raise ValueError(f"check {name!r} does not fit scene {plan.name!r}: {error}") from error


def check(recording: Recording) -> list[Check]:
    """Make the checks of a scene file: first those of all bodies together, then those of each body.

    Raises
    ------
    ValueError, TypeError
        If a check does not suit the scene, or one returns no list of `Check`; the message names it.
    """
    fitting(instance("recording", recording, Recording).plan)
    found: list[Check] = []
    for name in recording.plan.checks:
        try:
            results = CHECKS[name](recording)
        except (ValueError, ArithmeticError, LookupError) as error:
            raise ValueError(f"check {name!r} does not fit scene {recording.plan.name!r}: {error}") from error
        if not isinstance(results, list) or not all(isinstance(result, Check) for result in results):
            raise TypeError(f"check {name!r} gave {shown(results)}; it must give a list of Check")
        found += results
    if recording.plan.parts:
        each = zip(recording.plan.scene.bodies, recording.parts, strict=True)
        found += [
            replace(result, quantity=f"{placed.name}: {result.quantity}")
            for placed, part in each
            for result in check(part)
        ]
    return found


__all__ = ["Check", "check", "fitting", "of_all"]
