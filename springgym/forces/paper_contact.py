"""Contact as the paper has it (section 6), to compare with: a force that is sampled, and a clamp.

Equation 8, F = max(c/h² − c/Δ², 0), on particles within Δ of a surface; less c_N v_N while F acts, but
never pulling; friction μ F against the tangential velocity (equation 9, whose printed sign is along it),
at most m |v_t|/2τ; and after each step, what is nearer than Δ/10 is put there, its normal velocity 0.

The clamp creates energy: up to U(Δ/10) = 8.1 c/Δ each time. The friction never holds: on a slope of
angle α it lets a particle creep at about 2 τ g sin α.
"""

from __future__ import annotations

from typing import NamedTuple

from springgym.contact.records import Facing, Surfaces
from springgym.contact.surfaces import count, normal_at
from springgym.core.compiling import compiled
from springgym.core.kinds import Ledger, Number, Numbers, Rows
from springgym.core.lanes import load, maximum, minimum, select, sqrt
from springgym.core.vectors import TINY, add_row, dot, row, set_row
from springgym.forces.ledger import CONTACT, FRICTION, record
from springgym.terms import PaperLaw, Particles

CLAMP = 0.1
"""Particles are kept above this share of Δ."""


class Sampled(NamedTuple):
    """Where and when forces are sampled, and what receives them."""

    x: Rows
    """(N, 3) positions [m]"""
    v: Rows
    """(N, 3) velocities [m/s]"""
    force: Rows
    """(N, 3) forces [N], to which some are added"""
    ledger: Ledger
    weight: Number
    """[s], by which the power that is lost is multiplied in the ledger"""


@compiled
def add_paper_forces(
    at: Sampled, particles: Particles, surfaces: Surfaces | None, friction: Numbers, law: PaperLaw | None
) -> None:
    """Add the forces of surfaces on particles; the power that they lose goes to the ledger."""
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
    c, velocity = load(surfaces.strength, 0), row(at.v, i)
    push = maximum(c / (h * h) - c / (surfaces.reach * surfaces.reach), 0.0)
    push = select(h < surfaces.reach, push, 0.0)
    rate = dot(n, velocity)
    total = select(push > 0.0, maximum(push - law.damping * rate, 0.0), 0.0)
    add_row(at.force, i, total * n)
    record(at.ledger, CONTACT, at.weight * (push - total) * rate)
    if friction is not None:
        slip = velocity - rate / square * n
        speed = sqrt(dot(slip, slip) + TINY)
        rub = minimum(load(friction, 0) * push, load(particles.mass, i) * speed / (2.0 * law.step))
        add_row(at.force, i, -rub / speed * slip)
        record(at.ledger, FRICTION, at.weight * rub * speed)


@compiled
def clamp(x: Rows, v: Rows, particles: Particles, surfaces: Surfaces | None, law: PaperLaw) -> None:
    """Put particles that are too near a surface back to the least height, and stop them along its normal."""
    if law is not None and surfaces is not None:
        for i in range(particles.mass.size):
            if particles.free[i]:
                for k in range(count(surfaces.kinds)):
                    n, square, h = normal_at(k, row(x, i), surfaces)
                    missing = CLAMP * surfaces.reach - h
                    too_low = missing > 0.0
                    set_row(x, i, row(x, i) + select(too_low, missing, 0.0) / square * n)
                    set_row(v, i, row(v, i) - select(too_low, dot(n, row(v, i)), 0.0) / square * n)
