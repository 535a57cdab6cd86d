"""Records of an integrator's properties, of the state that it advances, and of its tolerance."""

from __future__ import annotations

import math
from collections.abc import Collection
from dataclasses import dataclass, fields
from enum import IntEnum
from typing import NamedTuple

import numpy as np
from numpy.typing import DTypeLike

from springgym import checks
from springgym.core.language.blocks import aligned_zeros
from springgym.core.language.kinds import Ledger, Nested, Rows
from springgym.core.language.ragged import stacked
from springgym.dynamics.methods.envelope import envelope
from springgym.model.scene import Scene
from springgym.model.surfaces import PaperContact

__all__ = ["Control", "Integrator", "Phase", "StepCount", "no_node", "refusal", "workspace"]


@dataclass(frozen=True)
class Integrator:
    """Properties of a time-stepping method, for checks, tests and documentation."""

    name: str
    order: int
    evaluations: int
    """force evaluations per step; for an iterative method, with one iteration per stage"""
    imaginary_limit: float
    """largest stable ω h of an undamped oscillator"""
    real_limit: float
    """largest stable decay rate × h; infinite if dampers are split off exactly or solved implicitly, 0 if
    the method does not allow dampers"""
    symplectic: bool
    negative_substeps: bool
    """whether it takes steps back in time within a step, which rules out dissipation"""
    workspace: int
    """number of its work arrays (particles or springs, 3)"""
    citation: str
    implicit: bool = False
    """whether it solves linear systems in the Jacobian of springs and dampers; actuators are split off, to
    order 2"""
    adaptive: bool = False
    """whether it chooses its own steps, up to h, from an estimate of its error"""
    iterative: bool = False
    """whether it uses Newton's method"""
    meets_bodies: bool = False
    """whether its steps have nodes (`springgym.dynamics.methods.node`) where bodies may collide"""
    meets_surfaces: bool = False
    """whether its steps have nodes (`springgym.dynamics.methods.node`) where there are surfaces"""
    cycles: bool = False
    """whether dampers and wrench can act once in several steps, see `springgym.dynamics.forces.cycle`"""

    def __post_init__(self) -> None:
        for own in fields(self):
            name = own.name
            value = getattr(self, own.name)
            if own.type == "str":
                checks.instance(name, value, str)
            elif own.type == "bool":
                checks.flag(name, value)
            elif own.type == "float":  # a stability limit
                checks.number(name, value, 0.0, math.inf)
            else:
                checks.whole(name, value, 0 if name == "workspace" else 1)
        if self.name.split() != [self.name]:
            raise ValueError(f"name is {checks.shown(self.name)}; it must be one word")

    @property
    def splits_dampers(self) -> bool:
        """Return whether each damper decays exactly, one after the other."""
        return math.isinf(self.real_limit) and not self.implicit

    @property
    def controlled(self) -> bool:
        """Return whether the method has a tolerance, and takes a `Control` instead of h."""
        return self.adaptive or self.iterative


class StepCount(IntEnum):
    """What a method that controls its error counts."""

    STEPS = 0
    """steps taken"""
    REJECTIONS = 1
    """steps rejected"""
    ITERATIONS = 2
    """Newton iterations"""


STEP_COUNTS = len(StepCount)


class Phase(NamedTuple):
    """The state of copies: positions, velocities, and the ledger of their energy.

    For several bodies, each field is a `Ragged`.
    """

    x: Rows
    """positions [m]"""
    v: Rows
    """velocities [m/s]"""
    ledger: Ledger
    """see `springgym.dynamics.forces.ledger`; None if it is not kept"""


class Control(NamedTuple):
    """The tolerance and the bounds of steps, which a method that controls its error takes instead of h.

    An adaptive method keeps the error of each step, a root mean square over the particles, below
    ``absolute`` + ``relative`` × longest spring in position [m] and below ``absolute`` + ``relative`` × speed
    in velocity [m/s]. Newton's method stops when a correction moves no particle by more than ``absolute`` +
    ``relative`` × longest spring. The remaining error is of the order of its square.
    """

    step: float
    """h [s]"""
    relative: float
    absolute: float
    counts: np.ndarray
    """(`STEP_COUNTS`,) the numbers of a `StepCount`"""


def workspace(method: Integrator, scene: Scene, dtype: DTypeLike) -> Nested:
    """Return the workspace of a method, with elements of ``dtype``: arrays and, if it is implicit, the matrix
    of each body."""
    bodies = [placed.body for placed in scene.bodies]
    rows = max(max(len(body.masses), len(body.springs)) for body in bodies)
    arrays = aligned_zeros((method.workspace, rows, 3), dtype)
    if not method.implicit:
        return arrays
    return arrays, stacked([envelope(len(body.masses), body.springs, dtype) for body in bodies], blocks=False)


def no_node(method: Integrator) -> str:
    """Return the error message for bodies that collide under a method whose step has no node."""
    return (
        f"bodies collide at the node of a step, where all impulses act at once, and {method.name} has no "
        "node of that kind; use verlet, or say collisions=None to let bodies pass through each other"
    )


def refusal(method: Integrator, scene: Scene, varying: Collection[str] = ()) -> str | None:
    """Return the reason why a method does not suit a scene; None if it does.

    ``varying`` names parameters that differ from copy to copy; damping may be one of them.
    """
    if "damping" in varying or any(placed.body.damping.any() for placed in scene.bodies):
        if method.negative_substeps:
            return (
                f"{method.name} takes substeps back in time, in which dampers would add energy; "
                "use a body with damping 0, or verlet"
            )
        if method.real_limit == 0:
            return (
                f"{method.name} cannot handle dampers, because its real_limit is 0; use a body with "
                "damping 0, or verlet"
            )
    if method.implicit and any(placed.forces for placed in scene.bodies):
        return (
            f"{method.name} solves with the stiffness of springs, and does not know that of forces of one's "
            "own; use verlet or rk4"
        )
    if scene.meetings and not method.meets_bodies:
        return no_node(method)
    rolls = scene.surfaces and any(placed.body.rounds for placed in scene.bodies)
    both = [placed.name for placed in scene.bodies if placed.body.rounds and len(placed.body.triangles)]
    if rolls and scene.meetings and both:
        return (
            f"body {both[0]!r} has faces and round features in a scene where bodies collide and there are "
            "surfaces, which cannot be together yet; say collisions=None, or give it a scene of its own"
        )
    if rolls and isinstance(scene.contact, PaperContact):
        return "the paper's contact knows particles alone, and no round features; use Contact"
    if scene.surfaces and isinstance(scene.contact, PaperContact):
        if method.name != "rk4":
            return (
                f"the paper's contact is a force and a clamp after each step of rk4; {method.name} has no "
                "place for them. Use rk4, or Contact instead of PaperContact"
            )
    elif scene.surfaces and not method.meets_surfaces:
        return (
            f"contact acts at the nodes of verlet's steps, which {method.name} does not have; use verlet, "
            "or rk4 with PaperContact"
        )
    return None
