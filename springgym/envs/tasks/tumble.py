"""SpringTumble: roll an irregular body to a target and onto a given face."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, ClassVar, Literal, Unpack

import gymnasium as gym
import numpy as np

from springgym.checks import flag, whole
from springgym.core.compiler.decorators import compiled, kernel
from springgym.dynamics.measures import Measures
from springgym.envs.arrows import torque_arrow
from springgym.envs.base import SpringEnv, SpringVectorEnv
from springgym.envs.goals import GoalTolerance
from springgym.envs.observation import Entry, ObservedParticles, Situation
from springgym.envs.options import EnvOptions, Modes, number
from springgym.envs.rewards import angle_of, gaussian, long_tail, thrift
from springgym.envs.starts import any_rotation, uniform
from springgym.envs.task import Drawn, Factors, ResetOptions, Start, Task
from springgym.model.bodies import Body, from_points
from springgym.model.bodies.rotations import cross
from springgym.model.scene import Scene, ThrustActuator, WrenchActuator
from springgym.model.surfaces import Contact, floor
from springgym.rendering import Arrow, Camera, Look, Marks
from springgym.rendering.look import AMBER, BLUE, GREEN, IVORY, ORANGE, RED

CORNERS = ((0.26, 0.0, -0.09), (-0.14, 0.24, -0.08), (-0.12, -0.23, -0.10), (0.03, 0.02, 0.27))  # [m]
MASSES = (1.2, 1.0, 1.1, 1.3)  # [kg]
CENTRE_MASS = 2.4  # [kg]
DAMPING = 150.0  # [kg/s]: a sixth to half of what is critical, so that no corner rings for long
REACH = 0.012  # Δ of the floor [m]: the fastest corners fly through it in five steps
FORCE = 35.0  # half of the weight [N]
WEAK_FORCE = 28.0  # with hard=True [N]
TORQUE = 9.0  # [N·m]
WEAK_TORQUE = 7.5  # with hard=True [N·m]
CLOSE = 0.1  # distance to the target, for success [m]
FLAT = 0.97  # cosine of the angle between face and straight down, for success
SLOW = 0.15  # speed of a particle, for success [m/s]
TURNING_UNIT = 4.0  # unit of angular velocities among the features [rad/s]
ARENA = 4.0  # where an episode ends [m]
FACES = ((1, 2, 3), (0, 3, 2), (0, 1, 3), (0, 2, 1))
"""The face opposite to each corner; its corners in the order that points the normal outwards."""

COLORS = (BLUE, ORANGE, IVORY, AMBER)


@compiled
def facing(x: np.ndarray, c: int, corner: int) -> tuple[float, float, float]:
    """Return the outward unit normal of the face opposite to a corner."""
    i, j, k = FACES[corner]
    ax = x[c, j, 0] - x[c, i, 0]
    ay = x[c, j, 1] - x[c, i, 1]
    az = x[c, j, 2] - x[c, i, 2]
    bx = x[c, k, 0] - x[c, i, 0]
    by = x[c, k, 1] - x[c, i, 1]
    bz = x[c, k, 2] - x[c, i, 2]
    nx = ay * bz - az * by
    ny = az * bx - ax * bz
    nz = ax * by - ay * bx
    size = math.sqrt(nx * nx + ny * ny + nz * nz)
    return nx / size, ny / size, nz / size


def _normals() -> tuple[tuple[float, ...], ...]:
    """Return outward unit normals of the faces in the axes of the body: the third points from the centre to
    corner 0, and the first is perpendicular to it, towards corner 1."""
    corners = np.array(CORNERS)
    arms = corners - corners.mean(axis=0)
    third = arms[0] / np.linalg.norm(arms[0])
    first = arms[1] - (arms[1] @ third) * third
    first /= np.linalg.norm(first)
    axes = np.stack([first, np.cross(third, first), third])
    return tuple(tuple((axes @ facing.py_func(corners[None], 0, corner)).tolist()) for corner in range(4))


NORMALS = _normals()


@compiled
def fastest(v: np.ndarray, c: int) -> float:
    """Return the largest speed of a particle [m/s]."""
    largest = 0.0
    for i in range(v.shape[1]):
        largest = max(largest, v[c, i, 0] ** 2 + v[c, i, 1] ** 2 + v[c, i, 2] ** 2)
    return math.sqrt(largest)


@kernel
def evaluate(m: Measures, s: Situation, out: np.ndarray) -> None:
    for c in range(out.shape[0]):
        dx = m.centre[c, 0] - s.goal[c, 0]
        dy = m.centre[c, 1] - s.goal[c, 1]
        distance = math.hypot(dx, dy)
        speed = fastest(s.v, c)
        down = -facing(s.x, c, int(s.goal[c, 3]))[2]
        effort = thrift(s.action, c)
        near = (long_tail(distance, 0.5, 0.05) + gaussian(distance, 1.2, 0.05)) / 4 * (1 + down) * effort
        placed = 0.6 * near * gaussian(distance, 0.3, 0.05) * gaussian(1 - down, 0.3, 0.02)
        out["reward_near"][c] = 0.4 * near
        out["reward_placed"][c] = 0.3 * placed
        out["reward_still"][c] = 0.7 * placed * gaussian(speed, 1.0, 0.1)
        out["distance"][c] = distance
        out["angle"][c] = angle_of(down)
        out["speed"][c] = speed
        out["success"][c] = distance < CLOSE and down > FLAT and speed < SLOW
        out["terminated"][c] = max(abs(m.centre[c, 0]), abs(m.centre[c, 1])) > ARENA


@kernel
def observe_features(m: Measures, s: Situation, observation: np.ndarray) -> None:
    for c in range(observation.shape[0]):
        normal = facing(s.x, c, int(s.goal[c, 3]))
        for axis in range(3):
            observation[c, axis] = m.centre[c, axis] - s.goal[c, axis]
            observation[c, 3 + axis] = m.centre_velocity[c, axis]
            observation[c, 6 + axis] = normal[axis]
            observation[c, 9 + axis] = m.angular_velocity[c, axis] / TURNING_UNIT
            observation[c, 12 + axis] = m.side[c, axis]
            observation[c, 15 + axis] = m.axis[c, axis]


@kernel
def achieve(m: Measures, s: Situation, achieved: np.ndarray, desired: np.ndarray) -> None:
    for c in range(achieved.shape[0]):
        e1 = m.side[c]
        e3 = m.axis[c]
        corner = int(s.goal[c, 3])
        for axis in range(2):
            achieved[c, axis] = m.centre[c, axis]
            desired[c, axis] = s.goal[c, axis]
        achieved[c, 2] = -e1[2]
        achieved[c, 3] = -(e3[0] * e1[1] - e3[1] * e1[0])
        achieved[c, 4] = -e3[2]
        for axis in range(3):
            desired[c, 2 + axis] = NORMALS[corner][axis]
        achieved[c, 5] = fastest(s.v, c)
        desired[c, 5] = 0.0


class SpringTumble(Task, kernels=(evaluate, observe_features, achieve)):
    """Define the MDP of `SpringTumbleEnv`, which describes it."""

    actions: ClassVar = {"wrench": 6, "impulses": 3 * len(CORNERS)}
    terms = ("near", "placed", "still")
    metrics = ("distance", "angle", "speed")
    entries = (
        Entry("offset", 3),
        Entry("velocity", 3),
        Entry("normal", 3),
        Entry("angular_velocity", 3, TURNING_UNIT),
        Entry("side", 3),
        Entry("axis", 3),
    )
    goal_size = 4
    counts_in_goal = ((3, len(CORNERS) - 1),)
    finest = 0.02 / 30
    hold_steps = 25
    checks_starts = False
    goal_tolerances = (
        GoalTolerance("place", 2, CLOSE),
        GoalTolerance("down", 3, math.sqrt(2 - 2 * FLAT)),
        GoalTolerance("speed", 1, SLOW),
    )

    def __init__(self, friction: float = 0.6, hard: bool = False, **modes: Unpack[Modes]) -> None:
        super().__init__(**modes)
        self.contact = Contact(friction=friction, restitution=0.3, reach=REACH)
        self.force, self.torque = (WEAK_FORCE, WEAK_TORQUE) if flag("hard", hard) else (FORCE, TORQUE)
        self.farthest = 2.0 if hard else 1.2
        self.body: Body = from_points(CORNERS, MASSES, CENTRE_MASS, stiffness=1e5, damping=DAMPING)
        self._shape = self.body.positions - self.body.centre
        if self.action == "impulses":
            self.limits = np.full(3 * len(CORNERS), self.force / len(CORNERS) * self.period)
        else:
            self.limits = np.repeat([self.force, self.torque], 3)

    def make_scene(self) -> Scene:
        return Scene(
            self.body,
            self._shape + np.array([0.0, 0.0, 0.7]),
            wrench=WrenchActuator() if self.action == "wrench" else None,
            thrust=ThrustActuator(tuple(range(len(CORNERS)))) if self.action == "impulses" else None,
            surfaces=(floor(),),
            contact=self.contact,
        )

    def observed_particles(self) -> ObservedParticles:
        return ObservedParticles(tuple(range(len(self.body.masses))), 0.5, 2.0, about="goal", pointed=3)

    def draw(self, rng: np.random.Generator, options: ResetOptions, factors: Factors) -> Drawn:
        motion = *any_rotation(rng).ravel().tolist(), *rng.uniform(-4.0, 4.0, 3).tolist()
        height, distance, bearing = uniform(rng, (0.5, 0.5, -math.pi), (0.9, self.farthest, math.pi))
        height = number(options, "height", max(1.0, factors["scale"]) * height, 0.4, 5.0)
        distance = number(options, "distance", distance, 0.0, 3.0)
        corner = int(rng.integers(4))
        if "corner" in options:
            corner = whole("reset option 'corner'", options.pop("corner"), 0, len(CORNERS) - 1)
        goal = (distance * math.cos(bearing), distance * math.sin(bearing), 0.0, corner)
        return *motion, factors["scale"], 0.0, 0.0, height, *goal

    def starts(self, drawn: np.ndarray) -> Start:
        turn = drawn[:, :9].reshape(-1, 3, 3)
        omega = drawn[:, None, 9:12]
        scale = drawn[:, 12:13, None]
        arm = scale * self._shape @ turn.swapaxes(1, 2)
        return Start(arm + drawn[:, None, 13:16], cross(omega, arm), drawn[:, 16:])

    def actuate(self, action: np.ndarray) -> dict[str, np.ndarray]:
        if self.action == "impulses":
            return {"thrust": self.force / len(CORNERS) * action.reshape(-1, len(CORNERS), 3)}
        return {"force": self.force * action[:, :3], "torque": self.torque * action[:, 3:]}

    def look(self) -> Look:
        return Look(
            triangles=FACES,
            triangle_colors=COLORS,
            springs=self.body.springs,
            trace=len(MASSES),
            trace_length=60,
        )

    def camera(self) -> Camera:
        return Camera.framing((0, 0, 0.15), 1.0, elevation=0.6)

    def framed(self, s: Situation) -> np.ndarray:
        return np.vstack([s.x, (*s.goal[:2], 0.0)])

    def marks(self, m: Measures, s: Situation) -> Marks:
        corner = int(s.goal[3])
        distance = math.hypot(m.centre[0] - s.goal[0], m.centre[1] - s.goal[1])
        place = (float(s.goal[0]), float(s.goal[1]), 0.0)
        if self.action == "impulses":
            arrows = [Arrow(s.x[n], 0.2 * push) for n, push in enumerate(s.action.reshape(-1, 3))]
        else:
            arrows = [Arrow(m.centre, 0.4 * s.action[:3]), torque_arrow(m.centre, s.action[3:], 0.3)]
        return Marks(
            rings=[(place, 0.1), (place, 0.3)],
            balls=[(s.x[corner], 0.05)],
            arrows=arrows,
            text=(f"off target {distance:4.2f} m",),
            key=(
                (GREEN, "target, and the corner that must point up"),
                (RED, "force and torque" if self.action == "wrench" else "impulses"),
            ),
        )


class TumbleOptions(EnvOptions, total=False):
    """`SpringTumbleEnv` takes these options, see there."""

    action: Literal["wrench", "impulses"]
    friction: float
    hard: bool


class SpringTumbleEnv(SpringEnv, gym.Env, task=SpringTumble):
    """
    ## Description
    An irregular tetrahedron drops to the floor. Roll it to a target and onto a randomly chosen face. The
    force is half the weight and less than static friction, so the agent has to tip the body over its edges. A
    spring joins every pair of the four corners and the centre.

    ## Action Space
    Actions are held for a control period of 20 ms, in the axes of the world.

    | `action` | entries | meaning | at ±1 |
    |---|---|---|---|
    | `"wrench"` | 0–2 | force, shared by all particles in proportion to mass | ±35 N |
    | | 3–5 | torque about the centre of mass | ±9 N·m |
    | `"impulses"` | 0–11 | impulses on corners 0–3 along x, y, z, spread over the period | ±0.175 N·s |

    The weight is 69 N.

    ## Observation Space
    | `observation` | entries | meaning | scale |
    |---|---|---|---|
    | `"particles"` | 0–14 | positions x, y, z of corners 0–3 and centre, from the target | 0.5 m |
    | | 15–29 | their velocities | 2 m/s |
    | | 30–32 | unit vector from the centre of mass to the corner that must point up | 1 |
    | `"features"` | 0–2 | centre of mass, from the target | 1 m |
    | | 3–5 | its velocity | 1 m/s |
    | | 6–8 | outward normal of the face that must lie down | 1 |
    | | 9–11 | angular velocity | 4 rad/s |
    | | 12–14 | first axis of the body, across the third towards corner 1 | 1 |
    | | 15–17 | third axis of the body, from the centre particle to corner 0 | 1 |

    ## Rewards
    With the horizontal distance e of the centre of mass from the target, C the cosine between the face's
    normal and straight down, the largest speed s of a particle and N = [L(e; 0.05, 0.5) + G(e; 0.05, 1.2)]/2
    · (1 + C)/2 · E, the reward is N [0.4 + 0.6 G(e; 0.05, 0.3) G(1 − C; 0.02, 0.3) (0.3 + 0.7 G(s; 0.1, 1))]
    ([G, L, E](../environments.md#shared-definitions)). Its terms are `reward_near`, `reward_placed` and
    `reward_still`, the products with 0.4, 0.3 and 0.7.

    ## Starting State
    The body has a random orientation and rotates at U(−4, 4) rad/s about each axis. Its centre of mass is at
    rest, U(0.5, 0.9) m above the origin. The target is U(0.5, 1.2) m away. One of the four corners, chosen at
    random, must point up, so that the opposite face lies down.
    `reset(options={"height": …, "distance": …, "corner": …})` sets them.

    ## Episode End
    Termination: the centre of mass is beyond ±4 m in x or y. Truncation: 250 steps, 5 s.
    `info["is_success"]`: e < 0.1 m, C > 0.97 and s < 0.15 m/s for the last 25 steps.

    ## Information
    `distance` e [m], `angle` between the face's normal and straight down [rad], `speed` s [m/s].

    ## Arguments
    - `friction=0.3`: a floor half as rough as the usual one (0.6), on which the body slides.
    - `hard=True`: forces up to 28 N, torques up to 7.5 N·m and impulses up to 0.14 N·s, the target U(0.5, 2)
      m away.
    - `goals=True`, with `sparse=True`: [goal environment](../features.md#goals). The goal is x, y of the
      centre of mass [m], the direction that points down, in the body's axes (the third and the first are
      those of `"features"`), and the speed s [m/s].
    """

    if TYPE_CHECKING:

        def __init__(self, **options: Unpack[TumbleOptions]) -> None: ...


class SpringTumbleVectorEnv(SpringVectorEnv, gym.vector.VectorEnv, task=SpringTumble):
    """Run a native batch of `SpringTumbleEnv`."""
