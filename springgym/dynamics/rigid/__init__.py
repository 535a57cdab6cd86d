"""The rigid twin: the same scene, with its particles moving as one rigid body.

Methods are compositions of one symmetric second-order step, see `springgym.dynamics.rigid.motion`; a new one
needs a record and stages in `METHODS`."""

from __future__ import annotations

import math
from collections.abc import Callable, Collection
from typing import NamedTuple

import numpy as np

from springgym.checks import instance, suggestion
from springgym.core.language.blocks import set_copies
from springgym.dynamics.methods.record import Integrator
from springgym.dynamics.rigid import motion
from springgym.dynamics.rigid.shape import (
    Shape,
    check_rigid,
    highest_rate,
    principal_shape,
    settled,
    swing_rate,
    turns,
)
from springgym.dynamics.rigid.solid import Rigid
from springgym.model.scene import Scene

__all__ = [
    "METHODS",
    "Method",
    "Rigid",
    "Shape",
    "advance_kernel",
    "default",
    "integrator",
    "largest_step",
    "principal_shape",
    "set_shapes",
    "settled",
    "shape_values",
    "terms",
    "usual_step",
]

TURN = 0.2
"""Largest rotation of a body in an automatic step [rad], at the initial rates."""

LONGEST = 5e-3
"""Longest automatic step [s]: actuators, and other starts, may spin a body up."""

LONGEST_TOUCHING = 1e-3
"""Longest automatic step with surfaces, or with bodies that collide [s]."""

CLOSER = 0.1
"""Motion of the fastest particle in an automatic step, at the initial speeds, in Δ of bodies that collide."""


class Method(NamedTuple):
    """A method, and the lengths of its second-order steps as fractions of a step."""

    record: Integrator
    stages: tuple[float, ...]


def _method(name: str, order: int, limit: float, half: tuple[float, ...], citation: str) -> Method:
    """Return the method of stages ``half``, a middle one that makes the sum 1, and ``half`` reversed."""
    stages = (*half, 1 - 2 * sum(half), *half[::-1])
    record = Integrator(
        name=name,
        order=order,
        evaluations=len(stages),
        imaginary_limit=limit,
        real_limit=math.inf,
        symplectic=True,
        negative_substeps=min(stages) < 0,
        workspace=0,
        citation=citation,
        meets_bodies=min(stages) > 0,
        meets_surfaces=min(stages) > 0,
    )
    return Method(record, stages)


METHODS = {
    method.record.name: method
    for method in (
        _method("verlet", 2, 2.0, (), "Strang 1968, doi:10.1137/0705041; Fassò 2003"),
        _method(
            "suzuki",
            4,
            2.7209,
            (1 / (4 - 4 ** (1 / 3)),) * 2,
            "Suzuki 1990, doi:10.1016/0375-9601(90)90962-N",
        ),
        _method(
            "kahan_li",
            6,
            2.5326,
            (0.39216144400731413928, 0.33259913678935943860, -0.70624617255763935981, 0.08221359629355080023),
            "Kahan & Li 1997, doi:10.1090/S0025-5718-97-00873-9, s9odr6a",
        ),
    )
}
"""The methods of the rigid twin by name."""


def default(scene: Scene) -> str:
    """Return the method for a scene that names none: that of fourth order, unless contact rules it out."""
    return "verlet" if instance("scene", scene, Scene).can_touch else "suzuki"


def integrator(name: str) -> Integrator:
    """Return the record of a method.

    Raises
    ------
    TypeError
        If the name is not a string.
    ValueError
        If there is no method of that name for rigid bodies.
    """
    if instance("name", name, str) not in METHODS:
        raise ValueError(f"unknown integrator {name!r} for rigid dynamics{suggestion(name, METHODS)}")
    return METHODS[name].record


def advance_kernel(
    name: str, read: Callable[..., None], surfaces: bool = False, together: bool = False, cycles: bool = False
) -> Callable[..., None]:
    """Return the compiled function that advances blocks of copies of rigid bodies; all methods share it."""
    return motion.advance_kernel(read, together)


def largest_step(scene: Scene, method: Integrator) -> float:
    """Return the stability limit of a method [s], by the fastest swing about the pin; infinite without one.

    Raises
    ------
    ValueError
        If the scene has no rigid twin.
    """
    check_rigid(scene, method)
    rate = swing_rate(scene)
    return method.imaginary_limit / rate if rate > 0 else math.inf


def usual_step(scene: Scene, method: Integrator) -> float:
    """Return the default step [s], which may be too long for impacts, see `springgym.model.resolution`.

    It follows from `TURN`, `LONGEST`, `LONGEST_TOUCHING` and `CLOSER`.

    Raises
    ------
    ValueError
        If the scene has no rigid twin.
    """
    check_rigid(scene, method)
    rate = highest_rate(scene)
    longest = LONGEST_TOUCHING if scene.can_touch else LONGEST
    fastest = float(np.linalg.norm(scene.velocities, axis=1).max())
    if scene.meetings and fastest > 0:
        longest = min(longest, CLOSER * float(scene.meetings.reach.min()) / fastest)
    return min(longest, TURN / rate) if rate > 0 else longest


def terms(
    scene: Scene, method: Integrator, varying: Collection[str], parameter: Callable[[np.ndarray], np.ndarray]
) -> tuple[Rigid, np.ndarray | None]:
    """Return the rigid body of a scene and its asymmetry, 1/I₂ − 1/I₁ (1,), in the form of kernels.

    Parameters
    ----------
    scene, method
        The scene, and the method that moves it.
    varying
        Names of parameters that differ from copy to copy.
    parameter
        Makes an array that depends on masses and size: of one value, or of blocks of copies.
    """
    values = shape_values(scene, None)
    rigid = Rigid(
        shape=parameter(values["shape"]),
        moments=parameter(values["moments"]),
        triad=parameter(values["triad"]),
        markers=np.array(scene.body.markers, np.uint32),
        pivot=scene.pivot,
        moves=bool(scene.free.any()),
        turns=turns(scene),
        stages=np.array(METHODS[method.name].stages),
    )
    symmetric = "masses" not in varying and values["asymmetry"] == 0
    return rigid, None if symmetric else parameter(values["asymmetry"])


def set_shapes(
    twin: tuple[Rigid, np.ndarray | None], copies: np.ndarray, shapes: list[dict[str, np.ndarray]]
) -> None:
    """Set the `shape_values` of some copies (k,)."""
    rigid, asymmetry = twin
    arrays = {**rigid._asdict(), "asymmetry": asymmetry}
    for copy, values in zip(copies, shapes, strict=True):
        for name, value in values.items():
            if (
                array := arrays[name]
            ) is not None and array.dtype.names:  # a symmetric body is so in any size
                set_copies(array, copy[None], value)


def shape_values(scene: Scene, masses: np.ndarray | None, scale: float = 1.0) -> dict[str, np.ndarray]:
    """Return the values of a rigid body that depend on its masses (N,) [kg], by default those of the scene,
    and on its size, ``scale`` times that of the scene's body.

    Raises
    ------
    ValueError
        If a moment of inertia is zero to rounding.
    """
    shape = principal_shape(scene, masses).scaled(scale)
    return {
        "shape": shape.positions,
        "moments": shape.moments,
        "triad": shape.triad(scene.body.markers),
        "asymmetry": 1 / shape.moments[1:2] - 1 / shape.moments[0:1],
    }
