"""Measures of a state: energies, momenta, orientation, strain."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from itertools import accumulate
from typing import Any, NamedTuple

import numpy as np

from springgym.core.compiler.decorators import compiled
from springgym.core.language.bodies import bodies_of, of_body
from springgym.core.language.kinds import Ledger, Nested, Number, Numbers, Rows, Vector
from springgym.core.language.lanes import lane_of, maximum, sqrt
from springgym.core.language.memory import load, store
from springgym.core.language.vectors import (
    ROUND_OFF,
    angular_momentum,
    choose,
    cross,
    dot,
    epsilon,
    inertia,
    mass_centre,
    row,
    solve_symmetric,
    triad,
    vec,
)
from springgym.dynamics.forces import potential_energy
from springgym.dynamics.forces.ledger import LEDGER_ENTRIES, LedgerEntry
from springgym.dynamics.methods.record import Phase
from springgym.dynamics.records import Collisions
from springgym.dynamics.terms import Terms

__all__ = [
    "AT",
    "COLUMNS",
    "FIELDS",
    "Markers",
    "Measures",
    "MeasuresOfBodies",
    "Reading",
    "Readout",
    "plus_stored",
    "read",
    "read_bodies",
    "view",
    "write_copies",
]


class Measures(NamedTuple):
    """Measures of all copies, for a body or for all bodies together; scalars (copies,), vectors (copies, 3).

    For several bodies together, energies, momenta and losses are sums, and the strain is the largest. Angular
    momentum is about the common centre of mass. There is no triad: ``side`` and ``axis`` are zero.
    """

    kinetic: np.ndarray
    """kinetic energy [J]"""
    gravity: np.ndarray
    """potential energy in the gravity field [J], 0 at the origin"""
    elastic: np.ndarray
    """energy of the springs, and of user-defined forces [J]"""
    contact: np.ndarray
    """energy in the barriers of surfaces and of contacts between bodies [J]"""
    strain: np.ndarray
    """largest |L/L₀ − 1| of any spring [1]"""
    centre: np.ndarray
    """centre of mass [m]"""
    centre_velocity: np.ndarray
    """velocity of the centre of mass [m/s]"""
    momentum: np.ndarray
    """momentum [kg·m/s]"""
    angular_momentum: np.ndarray
    """angular momentum about the body's pivot if there is one, else about the centre of mass [kg·m²/s]"""
    angular_velocity: np.ndarray
    """angular velocity ω of a rigid body with the same inertia I and angular momentum, I ω = L [rad/s]

    If a drive moves the pivot, L is that of the motion relative to the pivot. What no particle defines is
    zero: ω of a single particle, and the component of ω along a line on which all particles lie."""
    side: np.ndarray
    """first axis of the body's triad, a unit vector; zero while its markers lie on a line"""
    axis: np.ndarray
    """third axis of the body's triad, a unit vector; zero if the body is a single particle"""
    work: np.ndarray
    """work done by the actuators since the start [J]; without a ledger, this and all losses are 0"""
    damping_loss: np.ndarray
    """energy lost to the springs' dampers since the start [J]"""
    contact_loss: np.ndarray
    """energy lost in inelastic contact since the start [J]"""
    friction_loss: np.ndarray
    """energy lost to friction since the start [J]"""
    energy: np.ndarray
    """kinetic and potential energy [J]"""
    balance: np.ndarray
    """energy, plus losses, minus work: constant except for the integrator's error [J]"""


VECTORS = {"centre", "centre_velocity", "momentum", "angular_momentum", "angular_velocity", "side", "axis"}

FIELDS = {name: 3 if name in VECTORS else 1 for name in Measures._fields}
"""Names and sizes of the measures, in the order they are stored in."""

SIZE = sum(FIELDS.values())
AT: Any = Measures(*list(accumulate(FIELDS.values(), initial=0))[:-1])  # type: ignore[arg-type]
"""The column at which each measure starts in a row."""

COLUMNS = tuple(
    (..., n if size == 1 else slice(n, n + size)) for n, size in zip(AT, FIELDS.values(), strict=True)
)
"""The indices of each measure in rows."""


class MeasuresOfBodies:
    """Measures of each body of a scene: ``m["box"].axis`` is the axis of the body that is called "box".

    Bodies are selected by name or index. In a scene of one body, ``m.axis`` is the same.
    """

    __slots__ = ("_each", "_number", "names")
    __iter__ = None

    def __init__(self, each: Measures, names: Sequence[str], number: Callable[[Any], int]) -> None:
        """Wrap measures of bodies, scalars (…, bodies) and vectors (…, bodies, 3).

        For one body they are (…) and (…, 3). ``number`` is `Scene.number`.
        """
        self._each = each
        self._number = number
        self.names = tuple(names)

    def __getitem__(self, body: str | int) -> Measures:
        n = self._number(body)
        if len(self.names) == 1:
            return self._each
        sizes = zip(self._each, FIELDS.values(), strict=True)
        return Measures(*(values[..., n] if size == 1 else values[..., n, :] for values, size in sizes))

    def __getattr__(self, name: str) -> np.ndarray:
        if name not in FIELDS:
            raise AttributeError(f"measures have no {name!r}; there are {', '.join(FIELDS)}")
        if len(self.names) > 1:
            raise AttributeError(
                f"{name!r} needs one body, and there are {len(self.names)}; name one of them, as in "
                f"m[{self.names[0]!r}].{name}. There are {', '.join(map(repr, self.names))}"
            )
        return getattr(self._each, name)


class Readout(NamedTuple):
    """The arrays to which the measures of copies are written."""

    rows: np.ndarray
    """(copies, `SIZE`) measures of all bodies together, see `view`"""
    positions: np.ndarray
    """(copies, N, 3) positions of the particles [m]"""
    velocities: np.ndarray
    """(copies, N, 3) velocities of the particles [m/s]"""
    bodies: np.ndarray
    """(copies, bodies, `SIZE`) measures of each body; for one body, the same numbers as ``rows``"""


class Markers(NamedTuple):
    """The particles that define pivot and triad, for one body or for each."""

    pivot: np.ndarray
    """index of the pinned particle, or −1"""
    triad: np.ndarray
    """(3,) the markers of the body's triad"""


class Reading(NamedTuple):
    """A function that measures copies, and the arrays to which it writes."""

    readout: Readout
    space: np.ndarray
    """(`SIZE`,) workspace for one block; (2, `SIZE`) for several bodies"""
    markers: Markers


def view(values: np.ndarray) -> Measures:
    """Return measures that are views of an array (copies, `SIZE`)."""
    return Measures(*[values[own] for own in COLUMNS])


@compiled
def write(out: Numbers, n: Number, u: Vector) -> None:
    for axis in range(3):
        store(out, n + axis, u[axis])


@compiled
def measure_block(x: Rows, v: Rows, ledger: Ledger, out: Numbers, markers: Markers, terms: Terms) -> None:
    particles = terms.particles
    mass = particles.mass
    kinetic = 0.0 * load(x, (0, 0))
    total = load(mass, 0)
    for i in range(mass.size):
        if i > 0:
            total = total + load(mass, i)
        if particles.free[i]:
            kinetic = kinetic + 0.5 * load(mass, i) * dot(row(v, i), row(v, i))
    gravity, elastic, contact, strain = potential_energy(x, terms)
    contact = plus_stored(contact, terms.body, terms.collisions)
    store(out, AT.kinetic, kinetic)
    store(out, AT.gravity, gravity)
    store(out, AT.elastic, elastic)
    store(out, AT.contact, contact)
    store(out, AT.strain, sqrt(strain))
    energy = kinetic + gravity + elastic + contact
    centre = mass_centre(x, mass)
    about = row(x, markers.pivot) if markers.pivot >= 0 else centre
    momentum = turning = angular_momentum(x, v, mass, about)
    if markers.pivot >= 0:  # of a pivot p that a drive moves: I ω = L − M (c − p) × v_p
        turning = momentum - total * cross(centre - about, row(v, markers.pivot))
    e1, _, e3 = triad(x, markers.triad)
    sideways = row(x, markers.triad[2]) - row(x, markers.triad[0])
    across = cross(e3, sideways)
    share = ROUND_OFF * epsilon(kinetic)
    straight = dot(across, across) <= share * share * dot(sideways, sideways)
    e1 = choose(straight, 0.0 * e1, e1)
    write(out, AT.centre, centre)
    velocity = mass_centre(v, mass)
    write(out, AT.centre_velocity, velocity)
    write(out, AT.momentum, total * velocity)
    write(out, AT.angular_momentum, momentum)
    if mass.size > 1:
        write(out, AT.angular_velocity, solve_symmetric(inertia(x, mass, about), turning))
    else:  # r is only round-off of the centre of mass
        write(out, AT.angular_velocity, vec(0.0 * total, 0.0 * total, 0.0 * total))
    write(out, AT.side, e1)
    write(out, AT.axis, e3)
    balance = energy
    for entry in range(LEDGER_ENTRIES):
        entered = 0.0 * kinetic if ledger is None else load(ledger, entry)
        store(out, AT.work + entry, entered)
        balance = balance - entered if entry == LedgerEntry.WORK else balance + entered
    store(out, AT.energy, energy)
    store(out, AT.balance, balance)


@compiled
def plus_stored(energy: Number, body: int, collisions: Collisions | None) -> Number:
    """Add half of the energy [J] in the barriers between a body and others, if they collide."""
    if collisions is not None:
        energy = energy + load(collisions.stored, body)
    return energy


@compiled
def read(block: int, phase: Phase, reading: Reading, terms: Terms) -> None:
    """Write measures, positions and velocities of the copies of a block to their rows, for one body."""
    x, v, ledger = phase
    readout, space, markers = reading
    measure_block(x, v, ledger, space, markers, terms)
    write_copies(block, 0, 0, x, v, readout, space)


@compiled
def read_bodies(block: int, phase: Phase, reading: Reading, terms: Nested) -> None:
    """Write measures, positions and velocities of a block as `read` does, for several bodies."""
    x, v, ledger = phase
    readout, space, markers = reading
    whole = space[0]
    own = space[1]
    for body in range(bodies_of(x)):
        xb = of_body(x, body)
        vb = of_body(v, body)
        measure_block(xb, vb, of_body(ledger, body), own, of_body(markers, body), of_body(terms, body))
        write_copies(block, body, x.start[body], xb, vb, readout, own)
        for n in range(SIZE):
            value = load(own, n)
            if body > 0:
                before = load(whole, n)
                value = maximum(before, value) if n == AT.strain else before + value
            store(whole, n, value)
    mass = terms.particles.mass.values
    centre = mass_centre(x.values, mass)
    momentum = angular_momentum(x.values, v.values, mass, centre)
    write(whole, AT.centre, centre)
    write(whole, AT.centre_velocity, mass_centre(v.values, mass))
    write(whole, AT.angular_momentum, momentum)
    write(whole, AT.angular_velocity, solve_symmetric(inertia(x.values, mass, centre), momentum))
    write(whole, AT.side, 0.0 * centre)
    write(whole, AT.axis, 0.0 * centre)
    width = len(space[0, 0]["lanes"])
    for copy in range(block * width, min((block + 1) * width, readout.rows.shape[0])):
        for n in range(SIZE):
            readout.rows[copy, n] = space[0, n]["lanes"][copy - block * width]


@compiled
def write_copies(
    block: Number, body: int, first: Number, x: Rows, v: Rows, readout: Readout, space: Numbers
) -> None:
    """Write the measures in ``space`` and a body's particles, from ``first``, to the rows of the copies."""
    width = len(space[0]["lanes"])
    start = block * width
    for lane in range(min(width, readout.bodies.shape[0] - start)):
        copy = start + lane
        for n in range(SIZE):
            readout.bodies[copy, body, n] = lane_of(load(space, n), lane)
        for i in range(x.shape[0]):
            for axis in range(3):
                readout.positions[copy, first + i, axis] = lane_of(load(x, (i, axis)), lane)
                readout.velocities[copy, first + i, axis] = lane_of(load(v, (i, axis)), lane)
