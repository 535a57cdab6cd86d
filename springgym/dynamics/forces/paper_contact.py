"""The paper's contact (section 6), for comparison: a sampled force, and a clamp.

Equation 8, F = max(c/h² − c/Δ², 0), on particles within Δ of a surface; less c_N v_N while F acts, but
never pulling; friction μ F against the tangential velocity (equation 9, whose printed sign is along it),
at most m |v_t|/2τ; after each step, a particle nearer than Δ/10 is moved to Δ/10, with normal velocity 0.

The clamp creates energy: up to U(Δ/10) = 8.1 c/Δ each time. Friction never holds completely: on a slope of
angle α a particle creeps at about 2 τ g sin α.
"""

from __future__ import annotations

from typing import NamedTuple

from springgym.core.compiler.decorators import compiled
from springgym.core.language.kinds import Ledger, Number, Numbers, Rows
from springgym.core.language.lanes import maximum, minimum, select, sqrt
from springgym.core.language.memory import load
from springgym.core.language.vectors import GUARD, add_row, dot, row, set_row
from springgym.dynamics.contact.surfaces import count, normal_at
from springgym.dynamics.forces.ledger import LedgerEntry, record
from springgym.dynamics.records import Facing, Surfaces
from springgym.dynamics.terms import PaperLaw, Particles

CLAMP = 0.1
"""Least height of particles, in units of Δ."""


class Sampled(NamedTuple):
    """The state at which forces are sampled, and the array that receives them."""

    x: Rows
    """(N, 3) positions [m]"""
    v: Rows
    """(N, 3) velocities [m/s]"""
    force: Rows
    """(N, 3) forces [N], to which those of surfaces are added"""
    ledger: Ledger
    weight: Number
    """factor [s] of the lost power in the ledger"""


@compiled
def add_paper_forces(
    at: Sampled, particles: Particles, surfaces: Surfaces | None, friction: Numbers, law: PaperLaw | None
) -> None:
    """Add the forces of surfaces on particles [N]; the power that they dissipate goes to the ledger."""
    if law is not None and surfaces is not None:
        for i in range(particles.mass.size):
            if particles.free[i]:
                for k in range(count(surfaces.kinds)):
                    above = normal_at(k, row(at.x, i), surfaces)
                    add_paper_force(i, above, at, particles, surfaces, friction, law)


@compiled
def add_paper_force(
    i: int,
    above: Facing,
    at: Sampled,
    particles: Particles,
    surfaces: Surfaces,
    friction: Numbers,
    law: PaperLaw,
) -> None:
    """Add the force [N] of a surface on particle ``i``; ``above`` is what `normal_at` returns for it."""
    n, square, h = above
    c = load(surfaces.strength, 0)
    velocity = row(at.v, i)
    push = maximum(c / (h * h) - c / (surfaces.reach * surfaces.reach), 0.0)
    push = select(h < surfaces.reach, push, 0.0)
    rate = dot(n, velocity)
    total = select(push > 0.0, maximum(push - law.damping * rate, 0.0), 0.0)
    add_row(at.force, i, total * n)
    record(at.ledger, LedgerEntry.CONTACT, at.weight * (push - total) * rate)
    if friction is not None:
        slip = velocity - rate / square * n
        speed = sqrt(dot(slip, slip) + GUARD)
        rub = minimum(load(friction, 0) * push, load(particles.mass, i) * speed / (2.0 * law.step))
        add_row(at.force, i, -rub / speed * slip)
        record(at.ledger, LedgerEntry.FRICTION, at.weight * rub * speed)


@compiled
def clamp(x: Rows, v: Rows, particles: Particles, surfaces: Surfaces | None, law: PaperLaw) -> None:
    """Move particles too near to a surface back to the least height, and stop them along its normal."""
    if law is not None and surfaces is not None:
        for i in range(particles.mass.size):
            if particles.free[i]:
                for k in range(count(surfaces.kinds)):
                    n, square, h = normal_at(k, row(x, i), surfaces)
                    missing = CLAMP * surfaces.reach - h
                    too_low = missing > 0.0
                    set_row(x, i, row(x, i) + select(too_low, missing, 0.0) / square * n)
                    set_row(v, i, row(v, i) - select(too_low, dot(n, row(v, i)), 0.0) / square * n)
