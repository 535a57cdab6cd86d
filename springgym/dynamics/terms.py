"""The terms of a simulation: records of the particles and of everything that acts on them.

A scene has some of the terms and None for the others. A function that applies a term takes it as an argument
and tests whether it is None. Such tests, and the code that they guard, are removed when a kernel is compiled,
so that it has no code for forces that a scene does not use.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from springgym.core.language.kinds import Numbers
from springgym.dynamics.records import Collisions, Rounds, Surfaces
from springgym.model.own_forces import OfBody


class Particles(NamedTuple):
    """Point masses, each array of shape (particles,)."""

    mass: Numbers
    """the mass [kg]"""
    inverse_mass: Numbers
    """the inverse mass [1/kg]; 0 if pinned"""
    free: np.ndarray
    """whether the particle moves freely, i.e. is not pinned"""


class Springs(NamedTuple):
    """Springs between particles ``first`` and ``second``, each array of shape (springs,)."""

    first: np.ndarray
    second: np.ndarray
    length: np.ndarray
    """the rest length L₀ [m]"""
    stiffness: np.ndarray
    """the stiffness k [N/m]"""


class Dampers(NamedTuple):
    """Damping of the springs, in their order, each array of shape (springs,)."""

    coefficient: np.ndarray
    """the damping coefficient c [kg/s]"""
    half: Decay
    """decay in half a step"""
    whole: Decay
    """decay in a step, or in a cycle of steps"""
    paired: bool
    """whether a step has two sweeps of half its time, there and back; or one, in alternating direction"""


class Decay(NamedTuple):
    """The exact decay by a damper in some time, per relative speed of its ends."""

    impulse: np.ndarray
    """impulse on the first end [kg], opposite on the second"""
    first: np.ndarray
    """gain of the first end's velocity [1]"""
    second: np.ndarray
    """loss of the second end's velocity [1]"""
    loss: np.ndarray
    """energy lost, per relative speed² [kg]"""


class Wrench(NamedTuple):
    """A force and a torque on the whole body, applied to its particles.

    Particle i receives m_i (a + β × r_i): a from the force, shared out by mass, and β from I β = τ with
    the inertia of the present shape, so that force and moment are exact. r_i is from the pivot if the body is
    pinned there (the pin takes the net force), else from the centre of mass. Where there is no moment of
    inertia, about a line of particles or on a single one, a torque has no effect.
    """

    force: np.ndarray
    """(3,) force in world coordinates [N]"""
    torque: np.ndarray
    """(3,) torque in world coordinates [N·m]; if ``axial`` is 0, without its part along the body's third
    axis"""
    body_torque: np.ndarray
    """(3,) torque in components along the body's axes [N·m]"""
    markers: np.ndarray
    """(3,) the three particles that define the body's axes, see `triad`"""
    pivot: int
    """index of the pinned particle, or −1 for the centre of mass"""
    axial: float
    """1 keeps, 0 removes the part of the world torque along the body's third axis"""


class Thrust(NamedTuple):
    """Forces on named particles."""

    particle: np.ndarray
    """(thrusters,) index of the particle on which each acts"""
    force: np.ndarray
    """(thrusters, 3) force of each thruster [N], in the world or, if ``turns``, in the body's `triad`"""
    markers: np.ndarray
    turns: bool


class Drive(NamedTuple):
    """A pinned particle that is moved: a trolley."""

    particle: int
    """index of the driven particle; −1 if no particle of this body is driven"""
    acceleration: np.ndarray
    """(3,) acceleration [m/s²]"""
    speed: float
    """largest speed of each component [m/s]"""


class Cycle(NamedTuple):
    """The progress of copies in two cycles."""

    every: int
    """the number of steps of a cycle, even"""
    second: int
    """the number of steps after which dampers act in the second of two cycles"""
    marks: np.ndarray
    """(1,) the number of steps since the first of two cycles began; at the end of a call 0 or ``every``"""


class LastNode(NamedTuple):
    """Data of the last node that dampers need where contact acts: see `springgym.dynamics.methods.node`."""

    half_change: np.ndarray
    """(N, 3) half of the change of velocity by contact in the last step [m/s]: the prediction for the next"""
    sweep: np.ndarray
    """(1,) 0 if the next sweep of dampers comes before the actuators, 1 if after them"""


class PaperLaw(NamedTuple):
    """Constants of McDonald's law of contact, see `springgym.dynamics.forces.paper_contact`."""

    damping: float
    """the damping coefficient c_N [kg/s]"""
    step: float
    """the step τ [s]"""


class Terms(NamedTuple):
    """The particles and what acts on them; None for what a scene does not have."""

    particles: Particles
    springs: Springs | None = None
    dampers: Dampers | None = None
    gravity: np.ndarray | None = None
    """(3,) acceleration of gravity [m/s²]"""
    wrench: Wrench | None = None
    thrust: Thrust | None = None
    drive: Drive | None = None
    surfaces: Surfaces | None = None
    friction: np.ndarray | None = None
    """(1,) coefficient of friction μ of the scene's contact [1]; where contacts are solved together,
    `Pairs.friction` is used instead"""
    loss: np.ndarray | None = None
    """(1,) loss factor β of the scene's contact [1]; where contacts are solved together, `Pairs.loss` is
    used instead"""
    paper_law: PaperLaw | None = None
    """constants of McDonald's law of contact, if the scene uses it"""
    last: LastNode | None = None
    """data of the last node, if there are dampers, and surfaces or bodies that collide"""
    cycle: Cycle | None = None
    """progress in cycles of steps; None if all forces act at each step"""
    collisions: Collisions | None = None
    """bodies that collide"""
    rounds: Rounds | None = None
    """spheres, ellipsoids and disks with which bodies touch surfaces"""
    own: tuple[OfBody, ...] | None = None
    """user-defined forces of all bodies"""
    body: int = 0
    """index of the body, as in ``own``"""
