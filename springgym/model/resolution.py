"""Impacts that steps resolve: the frequency of a contact, the default step, and the fastest impact.

At its edge the barrier of a contact (`springgym.dynamics.contact.law`) is a spring of 2 c/Δ³. With W the
inverse of the effective mass it has the frequency ω_c = √(2 c W/Δ³), so that a slow impact lasts π/ω_c
whatever its speed. An impact of speed v reaches a smaller gap and a harder barrier, with a frequency of about

    Ω(v) = ω_c + v²/(Δ² ω_c).

Steps h follow it with an error of the second order: in the worst phase of the step, the energy that an impact
loses, 1 − e² of its energy, is wrong by a share of about `COARSENESS` × (Ω h)². A body of springs that the
contact strains also returns vibrations: a share of about `STRAINED` × v/(Δ ω) + `STIFF` × (ω_c/ω)⁴, with ω of
its slowest one. These shares add up to `WRONG` at the fastest impact that keeps its restitution. What loses
nothing keeps its energy at any step.
"""

from __future__ import annotations

import math
from functools import lru_cache
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from springgym.model.bodies import Body
from springgym.model.scene import Scene
from springgym.model.surfaces import Contact, scales
from springgym.model.surfaces.contact import DEFAULT_REACH, slowest_vibration, strength_of_impact

WRONG = 0.04
"""Largest error of the energy that an impact loses, as a share of it: e is right to 0.03 at 0.5 and above, to
0.08 at 0.2, and an impact with e = 0 returns at most 0.2 of its speed too much."""

COARSENESS = 0.55
"""Error by steps as a share of the loss, over (Ω h)². It was measured with particles in the worst phase of a
step, at e from 0 to 0.8, that come as near as a tenth of Δ."""

STRAINED = 0.4
"""Error by vibrations as a share of the loss, over v/(Δ ω). It was measured with cubes on floors, slabs,
cubes and balls, whose worst is 0.39 (a cube on a ball)."""

STIFF = 5.5
"""Error by vibrations as a share of the loss, over (ω_c/ω)⁴, at any speed. It was measured with cubes that
meet face on face, and is less on floors."""

TURN = 0.2
"""Largest ω_c h of a default step [rad]: it leaves half of `WRONG` to fast impacts."""

QUICK = 0.2
"""Largest motion of a contact without loss in a step, in Δ, that is resolved accurately."""

DEEP = 0.05
"""Least gap of an impact in Δ that steps can resolve: nearer than 0.02 Δ a contact counts as missed."""

GROSS = 0.2
"""Error of the loss by steps from which a `PrecisionWarning` appears: 0.5 is then up to 0.63."""


class PossibleContacts(NamedTuple):
    """The contacts that a scene allows: of pairs of bodies, and then of each body with all surfaces."""

    strength: np.ndarray
    """c [N·m²]"""
    reach: np.ndarray
    """Δ [m]"""
    frequency: np.ndarray
    """(2, pairs) ω_c [rad/s]: the lowest, of an impact through the centres of mass, where W = Σ 1/M, and the
    highest, by the `mobility` of both bodies; 0 where nothing moves"""
    vibration: np.ndarray
    """ω [rad/s] of the slowest vibration of a body that the contact strains; infinite if there is none"""
    lossy: np.ndarray
    """whether the restitution is less than 1"""
    among: int
    """the number of pairs of bodies"""


# --- The frequency of contacts ----------------------------------------------------------------------------


@lru_cache(maxsize=1024)
def mobility(body: Body) -> float:
    """Return the largest inverse of the effective mass [1/kg] with which a body meets something.

    A plane of normal n pushes all points of a body that lie on it. With the arms r from the centre of mass,
    they move by the matrix 1/M + (rᵢ × n) · I⁻¹ (rⱼ × n), whose largest eigenvalue counts. It is computed for
    the planes of the body's faces, and of a cube about it. Particles of floppy bodies move one by one.
    """
    if body.floppy or len(body.masses) < 2:
        return 1 / float(body.masses.min())
    inverse = np.linalg.pinv(body.inertia(), hermitian=True)
    normals = np.array([(x, y, z) for x in (-1, 0, 1) for y in (-1, 0, 1) for z in (-1, 0, 1)], float)
    if len(body.triangles):
        first, second, third = np.moveaxis(body.positions[body.triangles], 1, 0)
        normals = np.unique(np.round([*normals, *np.cross(second - first, third - first)], 12), axis=0)
    most = 0.0
    for normal in normals[normals.any(axis=1)]:
        n = normal / np.linalg.norm(normal)
        points = body.positions - body.centre
        if body.rounds:
            centres = np.array([feature.centre - body.centre for feature in body.rounds])
            pulls = np.array([feature.matrix @ n for feature in body.rounds])
            points = centres + pulls / np.sqrt(pulls @ n)[:, None]
        heights = points @ n
        arms = np.cross(points[heights > heights.max() - DEFAULT_REACH * body.swept], n)
        most = max(most, float(np.linalg.eigvalsh(1 / body.mass + arms @ inverse @ arms.T)[-1]))
    return most


def possible_contacts(scene: Scene, strains: bool) -> PossibleContacts:
    """Return the contacts that a scene allows; ``strains`` says whether bodies are of springs."""
    met = scene.meetings
    bodies = [placed.body for placed in scene.bodies]
    kinds = np.array(scene.kinds)
    moves = np.array([placed.free.any() for placed in scene.bodies])
    first = dict(reversed(list(zip(scene.kinds, bodies, strict=True))))
    each = [first[kind] for kind in range(len(first))]
    inverse = np.array([[1 / body.mass for body in each], [mobility(body) for body in each]])[:, kinds]
    inverse = np.where(moves, inverse, 0.0)
    vibration = np.full(len(bodies), np.inf)
    if strains:
        rings = [
            np.inf if body.rounds and not len(body.triangles) else slowest_vibration(body) for body in each
        ]
        vibration = np.where(moves, np.array(rings)[kinds], np.inf)
    strength = met.strength
    reach = met.reach
    lossy = met.of_contacts("restitution") < 1
    total = inverse[:, met.first] + inverse[:, met.second]
    slowest = np.minimum(vibration[met.first], vibration[met.second])
    if scene.surfaces and isinstance(scene.contact, Contact):
        below = np.array([scales(scene.contact, body) for body in each])[kinds]
        strength = np.append(strength, below[:, 0])
        reach = np.append(reach, below[:, 1])
        lossy = np.append(lossy, np.full(len(bodies), scene.contact.restitution < 1))
        total = np.append(total, inverse, axis=1)
        slowest = np.append(slowest, vibration)
    frequency = np.sqrt(2 * strength * total / reach**3)
    return PossibleContacts(strength, reach, frequency, slowest, lossy, len(met))


# --- Speeds and steps -------------------------------------------------------------------------------------


def at_speed(of: PossibleContacts, speed: ArrayLike) -> np.ndarray:
    """Return the frequency Ω [rad/s] of impacts at speeds [m/s]: that of the lowest or of the highest ω_c."""
    square = (speed / of.reach) ** 2
    with np.errstate(divide="ignore", invalid="ignore"):
        low, high = (np.where(own > 0, own + square / own, 0.0) for own in of.frequency)
    return np.maximum(low, high)


def error_by_steps(of: PossibleContacts, speed: ArrayLike, step: float) -> np.ndarray:
    """Return the error of the energy that impacts lose, as a share of it, by steps [s] at speeds [m/s]."""
    return COARSENESS * (at_speed(of, speed) * step) ** 2


def max_impact_speeds(of: PossibleContacts, step: float) -> np.ndarray:
    """Return the highest speeds [m/s] of impacts that keep their restitution in steps [s]; 0 if none does.

    In lossy contacts, the error of the loss is `WRONG` there. Others move by at most `QUICK` Δ in a step, and
    strain bodies for as long as their slowest vibration lasts: v ≤ Δ ω/3.
    """
    with np.errstate(divide="ignore", invalid="ignore"):
        elastic = of.reach * np.minimum(of.vibration / 3, np.divide(QUICK, step))
        room = np.maximum(np.divide(math.sqrt(WRONG / COARSENESS), step) - of.frequency, 0.0)
        by_steps = of.reach * np.sqrt(np.where(of.frequency > 0, room * of.frequency, np.inf).min(axis=0))
    left = np.maximum(WRONG - STIFF * (of.frequency[1] / of.vibration) ** 4, 0.0)
    strained = np.isfinite(of.vibration)
    by_vibrations = np.where(strained, left / STRAINED * of.reach * of.vibration, np.inf)
    low = np.zeros(len(of.reach))
    high = np.minimum(by_steps, by_vibrations)
    for _ in range(50 if strained.any() else 0):  # each error alone is at most what is left at ``high``
        middle = np.where(strained, (low + high) / 2, 0.0)
        over = error_by_steps(of, middle, step) + STRAINED * middle / (of.reach * of.vibration) > left
        low = np.where(strained & ~over, middle, low)
        high = np.where(strained & over, middle, high)
    return np.where(of.lossy, high, elastic)


def max_impact_speed(scene: Scene) -> float:
    """Return the highest impact speed [m/s] at which bodies of springs keep their restitution, in fine steps.

    Faster impacts leave energy in vibrations, or get it back from them, so that the energy they lose is wrong
    by more than `WRONG`. The softest body decides. It is infinite if contact strains no body. Steps limit the
    speed, too, see `springgym.simulator.Simulator.max_impact_speed`.
    """
    return float(max_impact_speeds(possible_contacts(scene, True), 0.0).min(initial=math.inf))


def remedy(of: PossibleContacts, pair: int, speed: float) -> tuple[float, float | None]:
    """Return the step [s] that resolves an impact of a pair at a speed [m/s], whatever vibrations do.

    A contact so soft that the gap falls below `DEEP` Δ also needs a strength [N·m²], else None, at which it
    stays a tenth of Δ: (v/(Δ ω_c))² = (1 − x)²/x of the least gap x Δ. The step is then for that strength.
    """
    reach = of.reach[pair]
    frequency = of.frequency[:, pair]
    ratio = (speed / reach / frequency[0]) ** 2
    strength = None
    if ratio > (1 - DEEP) ** 2 / DEEP:
        harder = ratio / 8.1
        frequency = math.sqrt(harder) * frequency
        strength = float(harder * of.strength[pair])
    if not of.lossy[pair]:
        return float(QUICK * reach / speed), strength
    return float(
        math.sqrt(WRONG / COARSENESS) / (frequency + (speed / reach) ** 2 / frequency).max()
    ), strength


def longest_step(scene: Scene) -> float:
    """Return the longest default step [s] by the contacts of a scene, ω_c h ≤ `TURN`; infinite without any.

    Soft springs may make the contact of two bodies softer than `strength_of_impact`. Impacts then go deeper,
    and need the step of that strength. A surface that takes no energy needs no such step.
    """
    of = possible_contacts(scene, strains=False)
    fastest = np.where(of.lossy, of.frequency[1], 0.0)
    met = of.reach[: of.among]
    hard = np.sqrt(2 * strength_of_impact(1.0, met) / met**3)
    fastest[: of.among] = np.maximum(of.frequency[1, : of.among], hard)
    highest = float(fastest.max(initial=0.0))
    return TURN / highest if highest > 0 else math.inf
