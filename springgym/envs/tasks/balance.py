"""SpringBalance: make a ball follow a moving target on a plate that balances on a stick."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, ClassVar, Literal, Unpack

import gymnasium as gym
import numpy as np

from springgym.checks import flag
from springgym.core.compiler.decorators import compiled, kernel
from springgym.dynamics.measures import Measures
from springgym.envs.arrows import across, torque_arrow
from springgym.envs.base import SpringEnv, SpringVectorEnv
from springgym.envs.observation import Entry, ObservedParticles, Situation
from springgym.envs.options import EnvOptions, Modes, number
from springgym.envs.randomisation import NOMINAL, weight_of
from springgym.envs.rewards import angle_of, gaussian, height_above, long_tail, thrift
from springgym.envs.starts import uniform
from springgym.envs.task import Drawn, Factors, ResetOptions, Start, Task, at_rest, level
from springgym.model.bodies import Body, rolling_ball, top
from springgym.model.bodies.rotations import turned
from springgym.model.scene import Placed, Scene, WrenchActuator
from springgym.model.surfaces import Contact
from springgym.rendering import Camera, Look, Marks, Scenery
from springgym.rendering.look import GREEN, ORANGE, RED
from springgym.scenes import film
from springgym.theory.contact import rest_height

PLATE, BALL = 0, 1
"""Indices of the bodies in the scene."""

CROWN = 6
"""Index of the plate's particle in the middle of its upper side, after those of the ring."""

PERIOD = 0.02  # [s]
RADIUS = 0.5  # of the plate [m]
HEIGHT = 0.25  # of its upper side above the pinned tip [m]
PLATE_MASS = 1.0  # [kg]
BALL_MASS = 0.2  # [kg]
BALL_RADIUS = 0.06  # [m]
TORQUE = 3.0  # [N·m]
WEAK_TORQUE = 1.5  # with hard=True [N·m]
FRICTION = 0.5  # between both
REACH = 5e-3  # Δ of the contact [m]
STRENGTH = 1e-4  # c of the contact [N·m²]
ORBIT = (0.05, 0.2)  # radius of the circle that the place moves on [m]
RATE = (0.4, 1.2)  # its angular velocity [rad/s]
HARD_RATE = (1.2, 2.0)  # with hard=True [rad/s]
FAR = 0.25  # where the ball starts, at most, from the axis [m]
TOUCHING = 0.02  # a ball higher above the plate has left it [m]
HIGH = 0.3  # where an episode ends [m]
TIPPED = 0.7  # tilt of the plate [rad]
WAY_UNIT = 0.2  # unit of distances among the features [m]
SPEED_UNIT = 0.5  # of speeds [m/s]
TILT_UNIT = 0.2  # of the axis [1]
TURNING_UNIT = 1.0  # of the plate's angular velocity [rad/s]


@compiled
def clearance_of(m: Measures, x: np.ndarray, c: int) -> float:
    """Return the height of the ball above the plate's plane [m]."""
    return height_above(x[c, CROWN], m.centre[c, BALL], m.axis[c, PLATE]) - BALL_RADIUS


@kernel
def evaluate(m: Measures, s: Situation, out: np.ndarray) -> None:
    for c in range(out.shape[0]):
        distance = math.hypot(m.centre[c, BALL, 0] - s.goal[c, 0], m.centre[c, BALL, 1] - s.goal[c, 1])
        clearance = clearance_of(m, s.x, c)
        tilt = angle_of(m.axis[c, PLATE, 2])
        on = thrift(s.action, c) if abs(clearance) < TOUCHING else 0.0
        out["reward_near"][c] = 0.5 * on * long_tail(distance, 0.3, 0.02)
        out["reward_placed"][c] = 0.5 * on * gaussian(distance, 0.15, 0.02)
        out["distance"][c] = distance
        out["tilt"][c] = tilt
        out["clearance"][c] = clearance
        out["success"][c] = distance < 0.05 and abs(clearance) < TOUCHING
        out["terminated"][c] = tilt > TIPPED or clearance < -TOUCHING or clearance > HIGH


@kernel
def observe_features(m: Measures, s: Situation, observation: np.ndarray) -> None:
    for c in range(observation.shape[0]):
        for axis in range(2):
            observation[c, axis] = (m.centre[c, BALL, axis] - s.goal[c, axis]) / WAY_UNIT
            observation[c, 2 + axis] = m.centre_velocity[c, BALL, axis] / SPEED_UNIT
            observation[c, 4 + axis] = m.axis[c, PLATE, axis] / TILT_UNIT
            observation[c, 6 + axis] = m.angular_velocity[c, PLATE, axis] / TURNING_UNIT
            observation[c, 8 + axis] = s.goal[c, axis] / WAY_UNIT
            observation[c, 10 + axis] = s.goal[c, 3 + axis] / SPEED_UNIT


@kernel
def move(m: Measures, s: Situation, goal: np.ndarray) -> None:
    """Move the target along its circle: x, y, z, its velocity x, y, and its angular velocity."""
    for c in range(goal.shape[0]):
        turn = goal[c, 5] * PERIOD
        cosine = math.cos(turn)
        sine = math.sin(turn)
        for n in (0, 3):
            x = goal[c, n]
            y = goal[c, n + 1]
            goal[c, n] = cosine * x - sine * y
            goal[c, n + 1] = sine * x + cosine * y


class SpringBalance(Task, kernels=(evaluate, observe_features, move)):
    """Define the MDP of `SpringBalanceEnv`, which describes it."""

    actions: ClassVar = {"torque": 2}
    terms = ("near", "placed")
    metrics = ("distance", "tilt", "clearance")
    entries = (
        Entry("offset", 2, WAY_UNIT),
        Entry("velocity", 2, SPEED_UNIT),
        Entry("axis", 2, TILT_UNIT),
        Entry("turning", 2, TURNING_UNIT),
        Entry("place", 2, WAY_UNIT),
        Entry("place_velocity", 2, SPEED_UNIT),
    )
    goal_size = 6
    period = PERIOD
    finest = PERIOD / 12
    damping_every = 2
    checks_starts = False

    def __init__(self, restitution: float = 0.3, hard: bool = False, **modes: Unpack[Modes]) -> None:
        super().__init__(**modes)
        self.contact = Contact(friction=FRICTION, restitution=restitution, strength=STRENGTH, reach=REACH)
        self.torque, self.rate = (WEAK_TORQUE, HARD_RATE) if flag("hard", hard) else (TORQUE, RATE)
        self.plate: Body = top(6, RADIUS, HEIGHT, PLATE_MASS, stiffness=1.6e4, damping=5.0)
        self.ball = rolling_ball(BALL_RADIUS, BALL_MASS, stiffness=2e3, damping=0.5)
        self.limits = np.full(2, self.torque)

    def make_scene(self) -> Scene:
        tip = self.plate.particle("tip")
        above = self.plate.positions[CROWN] + (0.0, 0.0, BALL_RADIUS + self._height(NOMINAL))
        return Scene(
            bodies=(
                Placed(self.plate, pinned=(tip,), wrench=WrenchActuator(perpendicular=True), name="plate"),
                Placed(self.ball, above + self.ball.positions, name="ball"),
            ),
            collisions=self.contact,
        )

    def _height(self, factors: Factors) -> float:
        """Return the height of the ball's lowest point above the plate that carries it [m]."""
        return rest_height(weight_of(BALL_MASS, factors), STRENGTH, REACH)

    def observed_particles(self) -> ObservedParticles:
        ball = len(self.plate.masses)
        seen = (*range(CROWN + 1), ball, ball + 1, ball + 3)  # the last is opposite to the first
        return ObservedParticles(seen, 0.25, 0.5, about="goal")

    def draw(self, rng: np.random.Generator, options: ResetOptions, factors: Factors) -> Drawn:
        low = (0.0, -math.pi, 0.0, -math.pi, ORBIT[0], -math.pi, self.rate[0], -1.0)
        high = (0.05, math.pi, 1.0, math.pi, ORBIT[1], math.pi, self.rate[1], 1.0)
        tilt, azimuth, share, bearing, radius, phase, rate, sense = uniform(rng, low, high)
        tilt = number(options, "tilt", tilt, 0.0, TIPPED)
        offset = number(options, "offset", FAR * math.sqrt(share), 0.0, 0.4)
        radius = number(options, "radius", radius, 0.0, 0.4)
        rate = number(options, "rate", math.copysign(rate, sense), -3.0, 3.0)
        lean = (-math.sin(azimuth), math.cos(azimuth), 0.0)
        height = factors["scale"] * self.plate.positions[CROWN, 2] + BALL_RADIUS + self._height(factors)
        resting = (offset * math.cos(bearing), offset * math.sin(bearing), height)
        place = (radius * math.cos(phase), radius * math.sin(phase), HEIGHT + BALL_RADIUS)
        goal = (*place, -rate * place[1], rate * place[0], rate)
        return factors["scale"], tilt, *lean, *resting, *goal

    def starts(self, drawn: np.ndarray) -> Start:
        lean = drawn[:, None, 2:5]
        shape = drawn[:, :1, None] * self.plate.positions
        turn = turned(lean[:, 0] / np.sqrt(lean @ lean.swapaxes(1, 2))[:, 0], drawn[:, 1])
        lying = np.hstack([shape, drawn[:, None, 5:8] + self.ball.positions])
        return at_rest(lying @ turn.swapaxes(1, 2), drawn[:, 8:])

    def actuate(self, action: np.ndarray) -> dict[str, np.ndarray]:
        return {"plate.torque": self.torque * level(action)}

    def look(self) -> Look:
        return film.look(self.scene, colors={"ball": ORANGE})

    def camera(self) -> Camera:
        return Camera.framing((0, 0, 0.2), 1.3, elevation=0.6)

    def scenery(self) -> Scenery:
        return Scenery(floor=-0.3)

    def marks(self, m: Measures, s: Situation) -> Marks:
        distance = math.hypot(m.centre[BALL, 0] - s.goal[0], m.centre[BALL, 1] - s.goal[1])
        torque = across(np.append(s.action, 0.0), m.axis[PLATE])
        return Marks(
            balls=[(s.goal[:3], 0.05)],
            lines=[((0.0, 0.0, -0.3), (0.0, 0.0, 0.0))],
            arrows=[torque_arrow(m.centre[PLATE], torque, 0.6 * RADIUS)],
            key=((GREEN, "target of the ball"), (RED, "torque on the plate")),
            text=(f"off target {100 * distance:4.1f} cm",),
        )


class BalanceOptions(EnvOptions, total=False):
    """`SpringBalanceEnv` takes these options, see there."""

    action: Literal["torque"]
    restitution: float
    hard: bool


class SpringBalanceEnv(SpringEnv, gym.Env, task=SpringBalance):
    """
    ## Description
    A plate balances on a stick, as a juggler's does, and a ball lies on it. Make the ball follow a target
    that moves on a circle; plate and ball are both unstable. The plate is a ring of 6 particles and a crown,
    flat above, with a pinned tip below, held together by 19 springs. The ball (radius 6 cm) rolls, skids
    where friction (0.5) cannot hold it, and bounces.

    ## Action Space
    Actions are held for a control period of 20 ms, in the axes of the world.

    | `action` | entries | meaning | at ±1 |
    |---|---|---|---|
    | `"torque"` | 0, 1 | torque on the plate about x, y, minus its component along the axis | ±3 N·m |

    ## Observation Space
    | `observation` | entries | meaning | scale |
    |---|---|---|---|
    | `"particles"` | 0–29 | ring particles 0–5, crown, and three of the ball, from the target | 0.25 m |
    | | 30–59 | their velocities | 0.5 m/s |
    | | 60, 61 | velocity x, y of the target | 1 m/s |
    | | 62 | angular velocity of the target on its circle | 1 rad/s |
    | `"features"` | 0, 1 | ball x, y, from the target | 0.2 m |
    | | 2, 3 | its velocity x, y | 0.5 m/s |
    | | 4, 5 | axis of the plate x, y | 0.2 |
    | | 6, 7 | its angular velocity x, y | 1 rad/s |
    | | 8, 9 | target x, y, from the tip | 0.2 m |
    | | 10, 11 | its velocity x, y | 0.5 m/s |

    ## Rewards
    With the horizontal distance e of the ball from the target, the reward is E [L(e; 0.02, 0.3) +
    G(e; 0.02, 0.15)]/2 ([G, L, E](../environments.md#shared-definitions)) while the ball is on the plate, and
    0 while it is more than 2 cm above it. `reward_near` is the half with L, `reward_placed` that with G.

    ## Starting State
    The ball lies at rest within 0.25 m of the axis of the plate, which is tilted by U(0, 0.05) rad. The
    target starts anywhere on a circle of radius U(0.05, 0.2) m, and moves in either direction at U(0.4, 1.2)
    rad/s. `reset(options={"tilt": …, "offset": …, "radius": …, "rate": …})` sets them.

    ## Episode End
    Termination: the ball is 2 cm below the plate's plane or 0.3 m above it, or the plate is tilted by 0.7
    rad. Truncation: 500 steps, 10 s. `info["is_success"]`: e < 0.05 m, with the ball on the plate, for the
    last 50 steps.

    ## Information
    `distance` e [m], `tilt` of the plate [rad], `clearance` between ball and plate's plane [m], `pairs_…`.

    ## Arguments
    - `restitution=0.8`: a ball that bounces more than the default one (0.3).
    - `hard=True`: torques up to 1.5 N·m, and a target that moves at U(1.2, 2) rad/s.
    - `randomize`: the factor `scale` does not change the ball.
    """

    if TYPE_CHECKING:

        def __init__(self, **options: Unpack[BalanceOptions]) -> None: ...


class SpringBalanceVectorEnv(SpringVectorEnv, gym.vector.VectorEnv, task=SpringBalance):
    """Run a native batch of `SpringBalanceEnv`."""
