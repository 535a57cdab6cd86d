"""SpringShove: push a box to a target position and heading with a ball."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import TYPE_CHECKING, ClassVar, Literal, TypeAlias, Unpack

import gymnasium as gym
import numpy as np

from springgym.checks import flag
from springgym.core.compiler.decorators import compiled, kernel
from springgym.dynamics.measures import Measures
from springgym.envs.base import SpringEnv, SpringVectorEnv
from springgym.envs.goals import GoalTolerance
from springgym.envs.observation import Entry, ObservedParticles, Situation
from springgym.envs.options import EnvOptions, Modes, number
from springgym.envs.randomisation import NOMINAL, weight_of
from springgym.envs.rewards import gaussian, long_tail, thrift
from springgym.envs.starts import headed, uniform
from springgym.envs.task import Drawn, Factors, ResetOptions, Start, Task, at_rest, level
from springgym.model.bodies import Body, box, rolling_ball
from springgym.model.scene import Placed, Scene, WrenchActuator
from springgym.model.surfaces import Contact, floor
from springgym.rendering import Arrow, Camera, Look, Marks
from springgym.rendering.look import GREEN, ORANGE, RED
from springgym.scenes import film
from springgym.theory.contact import rest_height

PUSHER, BOX = 0, 1
"""Indices of the bodies in the scene."""

CORNERS = 4
"""Index of the first particle after the pusher's, the first corner of the box."""

SIDES = (0.3, 0.3, 0.2)  # of the box [m]
TARGET = SIDES[0] / 2 * np.array([(1, 1, 0), (-1, 1, 0), (-1, -1, 0), (1, -1, 0)])  # of its lower corners [m]
MASS = 1.0  # of each of both [kg]
RADIUS = 0.1  # of the pusher [m]
FORCE = 12.0  # on the pusher; pushing the box takes 5 N [N]
SLIPPERY = 0.2  # friction between both
REACH = 0.015  # Δ of all contacts [m]
STRENGTH = 0.003  # c of all contacts [N·m²]
CLOSE = 0.08  # distance to its place, for success [m]
ALIGNED = 0.2  # angle to its heading, for success [rad]
SLOW = 0.1  # speed and turning, for success [m/s]
TURNING_ARM = 0.2  # factor by which angular velocity counts as speed [m]
ARENA = 1.8  # where an episode ends [m]
WAY_UNIT = 0.5  # unit of distances among the features [m]
SPEED_UNIT = 0.5  # of speeds [m/s]
NEAR_UNIT = 0.3  # of the distance to the box [m]
TURNING_UNIT = 2.0  # of turning [rad/s]
PUSHER_SPEED = 1.0  # of the pusher's velocity [m/s]

Level: TypeAlias = Sequence[float] | np.ndarray
"""x and y of a place [m]."""


@compiled
def heading_of(m: Measures, c: int, body: int) -> float:
    """Return the angle of a body's first axis from the x axis [rad]."""
    return math.atan2(m.side[c, body, 1], m.side[c, body, 0])


@compiled
def speed_of(m: Measures, c: int) -> float:
    """Return the speed of the box plus `TURNING_ARM` times its angular velocity [m/s]."""
    velocity = m.centre_velocity[c, BOX]
    return math.hypot(velocity[0], velocity[1]) + TURNING_ARM * abs(m.angular_velocity[c, BOX, 2])


@compiled
def nearness(
    m: Measures, c: int, effort: float, distance: float, heading: float
) -> tuple[float, float, float]:
    """Return the reward's terms for the approach of the ball, and for ``distance`` [m] and ``heading`` [rad]
    of the box from its place: at most ``effort`` in all."""
    place = m.centre[c, BOX]
    apart = math.hypot(m.centre[c, PUSHER, 0] - place[0], m.centre[c, PUSHER, 1] - place[1])
    near = effort * (long_tail(distance, 0.3, 0.03) + gaussian(distance, 0.5, 0.03)) / 2
    return (
        0.05 * effort * gaussian(apart, 0.5, 0.3),
        0.475 * near,
        0.475 * near * gaussian(heading, 0.8, 0.05),
    )


@compiled
def rests(m: Measures, c: int, distance: float, heading: float) -> bool:
    """Return whether a box is at rest within the limits of ``distance`` [m] and ``heading`` [rad]."""
    return distance < CLOSE and abs(heading) < ALIGNED and speed_of(m, c) < SLOW


@compiled
def see_pusher(m: Measures, c: int, observation: np.ndarray, first: int) -> None:
    """Write the ball's position relative to the box, over `NEAR_UNIT`, in world axes and in the box's."""
    heading = heading_of(m, c, BOX)
    cosine = math.cos(heading)
    sine = math.sin(heading)
    dx = m.centre[c, PUSHER, 0] - m.centre[c, BOX, 0]
    dy = m.centre[c, PUSHER, 1] - m.centre[c, BOX, 1]
    observation[c, first] = dx / NEAR_UNIT
    observation[c, first + 1] = dy / NEAR_UNIT
    observation[c, first + 2] = (cosine * dx + sine * dy) / NEAR_UNIT
    observation[c, first + 3] = (cosine * dy - sine * dx) / NEAR_UNIT


@kernel
def evaluate(m: Measures, s: Situation, out: np.ndarray) -> None:
    for c in range(out.shape[0]):
        distance = math.hypot(m.centre[c, BOX, 0], m.centre[c, BOX, 1])
        heading = heading_of(m, c, BOX)
        approach, near, turned = nearness(m, c, thrift(s.action, c), distance, heading)
        out["reward_approach"][c] = approach
        out["reward_near"][c] = near
        out["reward_heading"][c] = turned
        out["distance"][c], out["heading"][c], out["speed"][c] = distance, heading, speed_of(m, c)
        out["success"][c] = rests(m, c, distance, heading)
        gone = max(distance, math.hypot(m.centre[c, PUSHER, 0], m.centre[c, PUSHER, 1])) > ARENA
        out["terminated"][c] = gone or m.axis[c, BOX, 2] < 0.7


@kernel
def observe_features(m: Measures, s: Situation, observation: np.ndarray) -> None:
    for c in range(observation.shape[0]):
        heading = heading_of(m, c, BOX)
        for axis in range(2):
            observation[c, axis] = m.centre[c, BOX, axis] / WAY_UNIT
            observation[c, 2 + axis] = m.centre_velocity[c, BOX, axis] / SPEED_UNIT
            observation[c, 11 + axis] = m.centre_velocity[c, PUSHER, axis] / PUSHER_SPEED
        observation[c, 4] = math.cos(heading)
        observation[c, 5] = math.sin(heading)
        observation[c, 6] = m.angular_velocity[c, BOX, 2] / TURNING_UNIT
        see_pusher(m, c, observation, 7)


@kernel
def achieve(m: Measures, s: Situation, achieved: np.ndarray, desired: np.ndarray) -> None:
    for c in range(achieved.shape[0]):
        heading = heading_of(m, c, BOX)
        achieved[c, 2] = math.cos(heading)
        desired[c, 2] = 1.0
        achieved[c, 3] = math.sin(heading)
        desired[c, 3] = 0.0
        achieved[c, 4] = speed_of(m, c)
        desired[c, 4] = 0.0
        for axis in range(2):
            achieved[c, axis] = m.centre[c, BOX, axis]
            desired[c, axis] = 0.0


class SpringShove(Task, kernels=(evaluate, observe_features, achieve)):
    """Define the MDP of `SpringShoveEnv`, which describes it."""

    actions: ClassVar = {"push": 2}
    terms = ("approach", "near", "heading")
    metrics = ("distance", "heading", "speed")
    entries = (
        Entry("place", 2, WAY_UNIT),
        Entry("velocity", 2, SPEED_UNIT),
        Entry("heading", 2),
        Entry("turning", 1, TURNING_UNIT),
        Entry("pusher", 2, NEAR_UNIT),
        Entry("beside", 2, NEAR_UNIT),
        Entry("pusher_velocity", 2, PUSHER_SPEED),
    )
    period = 0.04
    finest = 0.04 / 32
    damping_every = 2
    hold_steps = 12
    checks_starts = False
    goal_tolerances = (
        GoalTolerance("place", 2, CLOSE),
        GoalTolerance("heading", 2, 2 * math.sin(ALIGNED / 2)),
        GoalTolerance("speed", 1, SLOW),
    )
    limits = np.full(2, FORCE)

    def __init__(self, friction: float = 0.4, hard: bool = False, **modes: Unpack[Modes]) -> None:
        super().__init__(**modes)
        self.contact = Contact(friction=friction, restitution=0.3, strength=STRENGTH, reach=REACH)
        self.turned, self.farthest = (math.pi, 1.2) if flag("hard", hard) else (1.0, 0.8)
        self.box: Body = box(SIDES, MASS, stiffness=1.8e4, damping=5.0)
        self.pusher = rolling_ball(RADIUS, MASS, stiffness=1.8e4, damping=5.0)

    def make_scene(self) -> Scene:
        (started,), *_ = self.starts(np.array([self._placed((-0.5, 0.0), (0.0, 0.0), 0.0, NOMINAL)]))
        return Scene(
            bodies=(
                Placed(self.pusher, started[:CORNERS], wrench=WrenchActuator(), name="pusher"),
                Placed(self.box, started[CORNERS:], name="box"),
            ),
            surfaces=(floor(),),
            contact=self.contact,
            collisions=Contact(friction=SLIPPERY, restitution=0.3, strength=STRENGTH, reach=REACH),
        )

    def _placed(self, pusher: Level, place: Level, heading: float, factors: Factors) -> tuple[float, ...]:
        """Return the arguments of `starts`: the positions of the pusher and of the middle of the box's lower
        side, on the floor, the box's heading, and the scale."""
        weight = weight_of(MASS, factors)
        lying = rest_height(weight / 4, STRENGTH, REACH)
        carried = rest_height(weight, STRENGTH, REACH)
        return *pusher, RADIUS + carried, *place, lying, heading, factors["scale"]

    def observed_particles(self) -> ObservedParticles:
        upper = tuple(range(CORNERS, CORNERS + 4))
        seen = (0, 1, 3, *upper)  # of the pusher, 3 is opposite to 0
        level = tuple((corner, 2) for corner in upper)
        return ObservedParticles(seen, 0.5, 0.5, skipped=level)

    def draw(self, rng: np.random.Generator, options: ResetOptions, factors: Factors) -> Drawn:
        low = (0.3, -math.pi, -self.turned, 0.35, -math.pi)
        high = (self.farthest, math.pi, self.turned, 0.6, math.pi)
        distance, bearing, heading, apart, side = uniform(rng, low, high)
        distance = number(options, "distance", distance, 0.0, 1.2)
        heading = number(options, "heading", heading, -math.pi, math.pi)
        x = distance * math.cos(bearing)
        y = distance * math.sin(bearing)
        apart *= max(1.0, factors["scale"])
        pusher = x + apart * math.cos(side), y + apart * math.sin(side)
        return self._placed(pusher, (x, y), heading, factors)

    def starts(self, drawn: np.ndarray) -> Start:
        pusher, place = drawn[:, :6].reshape(-1, 2, 1, 3).swapaxes(0, 1)
        shape = headed(drawn[:, 7:, None] * self.box.positions, drawn[:, 6])
        shape += place - shape.min(axis=1, keepdims=True) * (0.0, 0.0, 1.0)
        return at_rest(np.hstack([pusher + self.pusher.positions, shape]))

    def actuate(self, action: np.ndarray) -> dict[str, np.ndarray]:
        return {"pusher.force": FORCE * level(action)}

    def look(self) -> Look:
        return film.look(self.scene, colors={"pusher": ORANGE})

    def camera(self) -> Camera:
        return Camera.framing((0, 0, 0.1), 0.9, elevation=0.9)

    def framed(self, s: Situation) -> np.ndarray:
        return np.vstack([s.x, TARGET])

    def marks(self, m: Measures, s: Situation) -> Marks:
        distance = math.hypot(m.centre[BOX, 0], m.centre[BOX, 1])
        heading = math.atan2(m.side[BOX, 1], m.side[BOX, 0])
        top = m.centre[BOX] + 0.1 * m.axis[BOX]
        ahead = 0.15 * m.side[BOX]
        return Marks(
            lines=[(TARGET[n], TARGET[n - 1]) for n in range(4)],
            arrows=[
                Arrow(m.centre[PUSHER] + (0.0, 0.0, 1.2 * RADIUS), np.append(0.3 * s.action, 0.0)),
                Arrow(top, ahead, GREEN),
                Arrow((0.0, 0.0, 0.0), (0.15, 0.0, 0.0), GREEN),
            ],
            key=((GREEN, "target pose of the box"), (RED, "push on the ball")),
            text=(f"off target {100 * distance:3.0f} cm, {math.degrees(heading):4.0f}°",),
        )


class ShoveOptions(EnvOptions, total=False):
    """`SpringShoveEnv` takes these options, see there."""

    action: Literal["push"]
    friction: float
    hard: bool


class SpringShoveEnv(SpringEnv, gym.Env, task=SpringShove):
    """
    ## Description
    A ball pushes a box over the floor. Push the box to a target position and heading. The ball can only push:
    it has to go around the box to change its direction, and to push off-centre to turn it. The box has 8
    corners and 28 springs. The ball (radius 10 cm) does not stop by itself. The target lies at the origin and
    points along x.

    ## Action Space
    Actions are held for a control period of 40 ms.

    | `action` | entries | meaning | at ±1 |
    |---|---|---|---|
    | `"push"` | 0, 1 | force on the ball's centre along x, y | ±12 N |

    Pushing the box takes 5 N: 4 N against its friction with the floor, 1 N against its friction with the
    ball.

    ## Observation Space
    | `observation` | entries | meaning | scale |
    |---|---|---|---|
    | `"particles"` | 0–8 | positions of three particles of the ball | 0.5 m |
    | | 9–16 | positions x, y of the box's upper corners 0–3 | 0.5 m |
    | | 17–25 | velocities of the ball's particles | 0.5 m/s |
    | | 26–33 | velocities x, y of the corners | 0.5 m/s |
    | `"features"` | 0, 1 | centre of the box x, y | 0.5 m |
    | | 2, 3 | its velocity x, y | 0.5 m/s |
    | | 4, 5 | cosine and sine of its heading | 1 |
    | | 6 | its angular velocity | 2 rad/s |
    | | 7, 8 | ball x, y, from the centre of the box | 0.3 m |
    | | 9, 10 | the same vector, along the box's own axes | 0.3 m |
    | | 11, 12 | velocity x, y of the ball | 1 m/s |

    ## Rewards
    With the distance e of the box from the target, its heading φ, the distance a between ball and box and N =
    [L(e; 0.03, 0.3) + G(e; 0.03, 0.5)]/2, the reward is E [0.05 G(a; 0.3, 0.5) + 0.95 N (1 +
    G(φ; 0.05, 0.8))/2] ([G, L, E](../environments.md#shared-definitions)). Multiplied out, the terms are
    `reward_approach`, `reward_near` and `reward_heading`.

    ## Starting State
    Both lie on the floor at rest. The box is U(0.3, 0.8) m from the target in a random direction, rotated by
    U(−1, 1) rad. The ball is U(0.35, 0.6) m from the box on a random side.
    `reset(options={"distance": …, "heading": …})` sets them.

    ## Episode End
    Termination: ball or box is more than 1.8 m from the target, or the box tips over. Truncation: 250 steps,
    10 s. `info["is_success"]`: e < 0.08 m, |φ| < 0.2 rad, and the speed of the box, plus 0.2 m times its
    angular speed, is below 0.1 m/s, for the last 12 steps.

    ## Information
    `distance` e [m], `heading` φ [rad], `speed` [m/s], `pairs_…`.

    ## Arguments
    - `friction=0.3`: a smoother floor than the default one (0.4).
    - `hard=True`: a box up to 1.2 m away, with a random heading.
    - `goals=True`, with `sparse=True`: [goal environment](../features.md#goals). The goal is x, y of the box
      [m], cosine and sine of its heading, and its speed [m/s].
    - `randomize`: the factor `scale` does not change the ball.
    """

    if TYPE_CHECKING:

        def __init__(self, **options: Unpack[ShoveOptions]) -> None: ...


class SpringShoveVectorEnv(SpringVectorEnv, gym.vector.VectorEnv, task=SpringShove):
    """Run a native batch of `SpringShoveEnv`."""
