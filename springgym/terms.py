"""The terms of a simulation: records of the particles and of all that acts on them.

A scene has some of the terms and None for the others. A function that acts for a term takes it as an
argument and asks whether it is None. Such tests are removed, with what they guard, when a kernel is compiled:
forces that a scene does not use are left out of its code.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from springgym.contact.records import Collisions, Resistance, Rounds, Surfaces
from springgym.core.kinds import Numbers
from springgym.own_forces import OfBody


class Particles(NamedTuple):
    """Point masses, each array of shape (particles,)."""

    mass: Numbers
    """[kg]"""
    inverse_mass: Numbers
    """[1/kg], 0 if pinned"""
    free: np.ndarray
    """whether the particle moves freely, i.e. is not pinned"""


class Springs(NamedTuple):
    """Springs between particles ``first`` and ``second``, each array of shape (springs,)."""

    first: np.ndarray
    second: np.ndarray
    length: np.ndarray
    """L₀ [m]"""
    stiffness: np.ndarray
    """k [N/m]"""


class Dampers(NamedTuple):
    """Damping of the springs, in their order, each array of shape (springs,)."""

    coefficient: np.ndarray
    """c [kg/s]"""
    half: Decay
    """of half a step"""
    whole: Decay
    """of a step, or of a cycle of them"""
    paired: bool
    """whether a step takes two sweeps of half its time, there and back; or one, in alternating direction"""


class Decay(NamedTuple):
    """The exact decay that a damper makes in some time, per relative speed of its ends."""

    impulse: np.ndarray
    """impulse on the first end [kg], opposite on the second"""
    first: np.ndarray
    """what the first end's velocity gains [1]"""
    second: np.ndarray
    """what the second end's velocity loses [1]"""
    loss: np.ndarray
    """energy lost, per relative speed² [kg]"""


class Wrench(NamedTuple):
    """A force and a torque on the whole body, applied to its particles.

    Particle i receives m_i (a + β × r_i): a from the force, shared out by mass, and β from I β = τ with
    the inertia of the present shape, so that force and moment are exactly as asked. r_i counts from the
    pivot if the body is pinned there (the pin takes the net force), else from the centre of mass. Where
    there is no moment of inertia, a torque does nothing: about a line of particles, or on a single one.
    """

    force: np.ndarray
    """(3,) [N], world"""
    torque: np.ndarray
    """(3,) [N·m], world; if ``axial`` is 0, without its part along the body's third axis"""
    body_torque: np.ndarray
    """(3,) [N·m] about the body's axes"""
    markers: np.ndarray
    """(3,) the particles of the body's `triad`"""
    pivot: int
    """the pinned particle, or −1 for the centre of mass"""
    axial: float
    """1 keeps, 0 removes the part of the world torque along the body's third axis"""


class Thrust(NamedTuple):
    """Forces on named particles."""

    particle: np.ndarray
    """(thrusters,)"""
    force: np.ndarray
    """(thrusters, 3) [N], in the world or, if ``turns``, in the body's `triad`"""
    markers: np.ndarray
    turns: bool


class Drive(NamedTuple):
    """A pinned particle that is moved: a trolley."""

    particle: int
    """−1 if no particle of this body is driven"""
    acceleration: np.ndarray
    """(3,) [m/s²]"""
    speed: float
    """largest speed of each component [m/s]"""


class Cycle(NamedTuple):
    """Record how far copies are in two cycles."""

    every: int
    """steps of a cycle, even"""
    second: int
    """the steps after which dampers act in the second of two cycles"""
    marks: np.ndarray
    """(1,) the steps taken since the first of two cycles began; at the end of a call 0 or ``every``"""


class LastNode(NamedTuple):
    """What dampers know of the last node, where contact acts: see `springgym.integrators.node`."""

    given: np.ndarray
    """(N, 3) half of the change of velocity by contact at the last node [m/s], expected again at the next"""
    sweep: np.ndarray
    """(1,) 0 if the next sweep of dampers comes before the actuators, 1 if after them"""


class PaperLaw(NamedTuple):
    """Constants of the paper's law of contact."""

    damping: float
    """c_N [kg/s]"""
    step: float
    """τ [s]"""


class Terms(NamedTuple):
    """The particles and what acts on them; None for what a scene does not have."""

    particles: Particles
    springs: Springs | None = None
    dampers: Dampers | None = None
    gravity: np.ndarray | None = None
    """(3,) [m/s²]"""
    wrench: Wrench | None = None
    thrust: Thrust | None = None
    drive: Drive | None = None
    surfaces: Surfaces | None = None
    friction: np.ndarray | None = None
    """μ of the surfaces [1], (1,)"""
    resistance: Resistance | None = None
    """what resists the turning of round features on surfaces"""
    loss: np.ndarray | None = None
    """β of the surfaces [1], (1,)"""
    paper_law: PaperLaw | None = None
    """contact as the paper has it"""
    last: LastNode | None = None
    """what is kept of the last node, where there are dampers, and surfaces or bodies that collide"""
    cycle: Cycle | None = None
    """what acts once in several steps; None if all acts at each"""
    collisions: Collisions | None = None
    """bodies that collide"""
    rounds: Rounds | None = None
    """round features, by which a body that has some meets surfaces"""
    own: tuple[OfBody, ...] | None = None
    """forces that a user wrote, of all bodies"""
    body: int = 0
    """number of the body, of those that ``own`` names"""
