"""The kinds of dynamics: particles with springs between them, and the same particles as rigid bodies."""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping
from typing import Any, NamedTuple

import numpy as np

from springgym.checks import apart
from springgym.dynamics import methods as integrators
from springgym.dynamics import packing, rigid, stability
from springgym.dynamics.methods.record import Integrator, refusal
from springgym.dynamics.packing import Packed
from springgym.model.scene import Scene

UNEVEN = 1e-9
"""Relative difference from which lengths of springs are not those of a rigid body in another size."""


class StepSettings(NamedTuple):
    """The method of a simulator, its step, and the largest step that is stable."""

    method: Integrator
    step: float
    """[s]"""
    largest_step: float
    """stability limit of the scene as it was made [s]"""


class Dynamics(NamedTuple):
    """A kind of dynamics: its methods and their steps, and its treatment of starts and parameters."""

    rigid: bool
    """whether each body is packed as a rigid one, too"""
    default: Callable[[Scene], str]
    """returns the name of the default integrator"""
    integrator: Callable[[str], Integrator]
    refusal: Callable[[Integrator, Scene, Collection[str]], str | None]
    """returns the reason why a method does not suit a scene with varying parameters, or None if it does"""
    advance_kernel: Callable[[str, Callable[..., None], bool, bool, bool], Callable[..., None]]
    largest_step: Callable[[Scene, Integrator], float]
    automatic_step: Callable[..., float]
    settled: Callable[[Packed, np.ndarray, np.ndarray], np.ndarray] | None
    """returns the positions (k, N, 3) of particles that are placed in copies (k,); None if they do not
    change"""
    follow: Callable[[Packed, np.ndarray, Mapping[str, np.ndarray], StepSettings], Any]
    """checks parameters for copies (k,), and returns the values that `packing.derive` sets with them"""


def _stable(
    packed: Packed, index: np.ndarray, given: Mapping[str, np.ndarray], settings: StepSettings
) -> None:
    """Raise ValueError for parameters of a body that make the step of a copy unstable.

    With stiffness at most a times and masses at least 1/b times those of the scene, K ≤ a K₀ and
    M ≥ M₀/b, so that ω² ≤ a b ω₀²; likewise for dampers. Only if that bound does not suffice, the limit is
    computed.
    """
    names = ("masses", "stiffness", "damping")
    if not given.keys() & set(names) or settings.largest_step == np.inf:
        return
    body = packed.scene.body
    now = {name: given.get(name, packing.values(packed, name, index)) for name in names}
    lighter = (body.masses / now["masses"]).max(axis=1)
    faster = np.sqrt(lighter * (now["stiffness"] / body.stiffness).max(axis=1, initial=0.0))
    if np.isfinite(settings.method.real_limit):
        damped = now["damping"] > body.damping
        with np.errstate(divide="ignore"):
            more = np.divide(now["damping"], body.damping, out=np.ones(damped.shape), where=damped)
        faster = np.maximum(faster, lighter * more.max(axis=1, initial=0.0))
    for n in np.flatnonzero(settings.step * faster > stability.REFUSED * settings.largest_step):
        own = body.with_(**{name: values[n] for name, values in now.items()})
        limit = stability.largest_step(packed.scene.with_(body=own), settings.method)
        if stability.is_unstable(settings.step, limit):
            step, most = apart(settings.step, stability.REFUSED * limit)
            raise ValueError(
                f"these {', '.join(given)} make the step of {step} s unstable in copy {index[n]}: "
                f"{settings.method.name} allows at most {most} s there"
            )


def _shapes(
    packed: Packed, index: np.ndarray, given: Mapping[str, np.ndarray], settings: StepSettings
) -> list[dict[str, np.ndarray]]:
    """Return the values of rigid bodies of the given masses and lengths of springs.

    Raises
    ------
    ValueError
        If one has no inertia, or the lengths of one are not those of its body times one factor.
    """
    if given.keys().isdisjoint({"masses", "lengths"}):
        return []
    masses, lengths = (given.get(name, packing.values(packed, name, index)) for name in ("masses", "lengths"))
    factors = lengths / packed.scene.body.lengths
    uneven = np.ptp(factors, axis=1) > UNEVEN * factors[:, 0] if factors.size else np.zeros(len(index), bool)
    if uneven.any():
        raise ValueError(
            f"lengths of body {packed.scene.body.name!r} in copy {index[np.argmax(uneven)]} are not those of "
            "the body times one factor; a rigid body can only be larger or smaller as a whole"
        )
    scales = packing.sizes(packed, lengths)
    return [rigid.shape_values(packed.scene, *own) for own in zip(masses, scales, strict=True)]


def _settled(packed: Packed, x: np.ndarray, index: np.ndarray) -> np.ndarray:
    """Return the positions (k, N, 3) of particles of copies (k,) moved onto their rigid shapes [m]."""
    masses, lengths = (packing.values(packed, name, index) for name in ("masses", "lengths"))
    return rigid.settled(packed.scene, x, masses, packing.sizes(packed, lengths), index)


DYNAMICS = {
    "springs": Dynamics(
        rigid=False,
        default=lambda scene: "verlet",
        integrator=integrators.integrator,
        refusal=refusal,
        advance_kernel=integrators.advance_kernel,
        largest_step=stability.largest_step,
        automatic_step=stability.automatic_step,
        settled=None,
        follow=_stable,
    ),
    "rigid": Dynamics(
        rigid=True,
        default=rigid.default,
        integrator=rigid.integrator,
        refusal=rigid.refusal,
        advance_kernel=rigid.advance_kernel,
        largest_step=rigid.largest_step,
        automatic_step=rigid.automatic_step,
        settled=_settled,
        follow=_shapes,
    ),
}
"""Kinds of dynamics by name."""
