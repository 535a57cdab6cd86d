"""The problems that methods are measured on: a scene, how long, and what rigid theory says."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from springgym import theory
from springgym.dynamics.methods import METHODS, integrator
from springgym.model.bodies import box, cube, from_points, rope, rotation, start, top
from springgym.model.scene import GRAVITY, Scene
from springgym.model.surfaces import Contact, floor
from springgym.theory.frames import carry
from springgym.theory.top import TopState


class Problem(NamedTuple):
    """A problem to hold methods against."""

    what: str
    scene: Callable[[float], Scene]
    """of the stiffness [N/m]"""
    stiffness: float
    seconds: float
    rigid: Callable[[float], np.ndarray] | None = None
    """positions (N, 3) [m] at a time by rigid theory"""
    period: float | None = None
    """where the motion is chaotic, the control period [s] over which methods are compared"""

    def methods(self) -> list[str]:
        """Return the methods that make sense in it."""
        scene = self.scene(self.stiffness)
        return [name for name in METHODS if _makes_sense(name, scene)]


def _makes_sense(name: str, scene: Scene) -> bool:
    method = integrator(name)
    if scene.surfaces:
        return method.meets_surfaces
    return not (method.negative_substeps and scene.body.damping.any())


# --- Tops ---------------------------------------------------------------------------------------------

TOP = theory.top.cone_top_inertia(12.0, 0.5, 1.0)
CUSPS = TopState(theta=0.4, omega3=40.0)
LOOPS = TopState(theta=0.4, omega3=40.0, phi_dot=-2.0)
STEADY = TopState(theta=0.4, omega3=40.0, phi_dot=theory.top.steady_precession(TOP, 0.4, 40.0)[0])


def _top_scene(state: TopState, damping: float) -> Callable[[float], Scene]:
    def scene(stiffness: float) -> Scene:
        body = top(stiffness=stiffness, damping=damping)
        tip = body.particle("tip")
        began = start(
            body,
            tilt=state.theta,
            azimuth=-math.pi / 2,  # Euler's angles z, x, z, as in the theory
            roll=math.pi / 2,
            spin=state.omega3,
            precession=state.phi_dot,
            pinned=(tip,),
            gravity=GRAVITY,
        )
        return Scene(body, *began, pinned=(tip,))

    return scene


def _top_theory(state: TopState) -> Callable[[float], np.ndarray]:
    def positions(t: float) -> np.ndarray:
        motion = theory.top.motion(TOP, state, np.array([t]))
        return carry(motion.attitude[0], motion.omega_world[0], top().positions)[0]

    return positions


# --- Cube, box, rope, irregular body ------------------------------------------------------------------


def _swing(stiffness: float) -> Scene:
    body = cube(stiffness=stiffness, damping=0.0)
    return Scene(body, *start(body, tilt=math.pi - 2.0, pinned=(0,), gravity=GRAVITY), pinned=(0,))


def _swing_theory(t: float) -> np.ndarray:
    at = theory.pendulum.cube_on_vertex(1.0, 1.0)
    theta, _ = theory.pendulum.motion(at.i1, at.mgl, 2.0, 0.0, np.array([t]))
    return start(cube(), tilt=math.pi - theta[0], pinned=(0,), stretched=False).positions


SIDES = (1.0, 0.7, 0.4)
TUMBLING = (0.2, 6.0, 0.2)


def _free(stiffness: float) -> Scene:
    body = box(SIDES, stiffness=stiffness, damping=0.0)
    return Scene(body, *start(body, omega=TUMBLING), gravity=(0.0, 0.0, 0.0))


def _free_theory(t: float) -> np.ndarray:
    motion = theory.free_body.motion(theory.free_body.corner_box_inertia(1.0, SIDES), TUMBLING, np.array([t]))
    return box(SIDES).positions @ motion.attitude[0].T


def _rope(damping: float) -> Callable[[float], Scene]:
    def scene(stiffness: float) -> Scene:
        body = rope(stiffness=stiffness, damping=damping)
        began = start(body, rotation=(0.0, 0.5, 0.0), pinned=(0,))
        return Scene(body, *began, pinned=(0,))

    return scene


def _bounce(stiffness: float) -> Scene:
    body = cube(stiffness=stiffness, damping=0.0)
    began = start(body, rotation=(0.3, 0.5, 0.2), position=(0.0, 0.0, 1.0), velocity=(0.0, 0.0, -1.0))
    return Scene(body, *began, surfaces=(floor(),), contact=Contact(strength=0.05, reach=0.02))


SLIDING = 1.5
FRICTION = 0.3


def _slide(stiffness: float) -> Scene:
    body = cube(stiffness=stiffness, damping=30.0)
    height = 0.5 + theory.contact.rest_height(9.81 / 4, 0.05, 0.02)
    began = start(body, position=(0.0, 0.0, height), velocity=(SLIDING, 0.0, 0.0))
    contact = Contact(friction=FRICTION, strength=0.05, reach=0.02)
    return Scene(body, *began, surfaces=(floor(),), contact=contact)


def _slide_theory(t: float) -> np.ndarray:
    t = min(t, SLIDING / (FRICTION * 9.81))
    height = 0.5 + theory.contact.rest_height(9.81 / 4, 0.05, 0.02)
    return cube().positions + np.array([SLIDING * t - FRICTION * 9.81 * t**2 / 2, 0.0, height])


def _tumble(stiffness: float) -> Scene:
    corners = [(0.26, 0.0, -0.09), (-0.14, 0.24, -0.08), (-0.12, -0.23, -0.10), (0.03, 0.02, 0.27)]
    body = from_points(corners, [1.2, 1.0, 1.1, 1.3], 2.4, stiffness, 30.0)
    place = body.positions @ rotation((1, 2, 3), 1.0).T + (0.0, 0.0, 0.7)
    spin = np.cross((2.0, -3.0, 1.0), place - body.masses @ place / body.mass)
    contact = Contact(friction=0.6, restitution=0.5, strength=0.05, reach=0.02)
    return Scene(body, place, spin + np.array([0.5, 0.3, 0.0]), surfaces=(floor(),), contact=contact)


PROBLEMS = {
    "cube-swing": Problem("cube on a vertex, swinging from 2 rad", _swing, 1e5, 1.0, _swing_theory),
    "cusp-top": Problem("top released at rest", _top_scene(CUSPS, 0.0), 1e6, 1.0, _top_theory(CUSPS)),
    "loop-top": Problem(
        "top started against its precession", _top_scene(LOOPS, 0.0), 1e6, 1.0, _top_theory(LOOPS)
    ),
    "steady-top": Problem("top in steady precession", _top_scene(STEADY, 0.0), 1e6, 1.0, _top_theory(STEADY)),
    "damped-top": Problem(
        "top released at rest, dampers of 100 kg/s", _top_scene(CUSPS, 100.0), 1e6, 1.0, _top_theory(CUSPS)
    ),
    "free-body": Problem("box that flips about its middle axis", _free, 1e5, 1.0, _free_theory),
    "rope": Problem("70 kg on a rope let go at 0.5 rad, dampers of 100 kg/s", _rope(100.0), 1e5, 1.0),
    "stiff-chain": Problem("the same rope, a thousand times as stiff, undamped", _rope(0.0), 1e8, 0.25),
    "bounce": Problem("a tilted cube that bounces without loss", _bounce, 1e5, 0.6),
    "sliding-stop": Problem("cube that slides to a stop", _slide, 1e5, 0.6, _slide_theory),
    "tumble": Problem("irregular body that falls and tumbles", _tumble, 1e5, 3.0, period=0.02),
}
"""All problems by name."""
