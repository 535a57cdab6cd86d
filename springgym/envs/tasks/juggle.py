"""SpringJuggle: keep a ball, or two, bouncing on a paddle to a given height."""

from __future__ import annotations

import math
from functools import cached_property
from typing import TYPE_CHECKING, ClassVar, Literal, Unpack

import gymnasium as gym
import numpy as np

from springgym.checks import flag, whole
from springgym.core.compiler.decorators import compiled, kernel
from springgym.dynamics.measures import Measures
from springgym.envs.arrows import across, torque_arrow
from springgym.envs.base import SpringEnv, SpringVectorEnv
from springgym.envs.observation import Entry, ObservedParticles, Situation
from springgym.envs.options import EnvOptions, Modes, number
from springgym.envs.rewards import angle_of, gaussian, height_above, long_tail, thrift
from springgym.envs.starts import uniform
from springgym.envs.task import Drawn, Factors, ResetOptions, Start, Task, level
from springgym.model.bodies import Body, rolling_ball, top
from springgym.model.scene import GRAVITY, Placed, Scene, WrenchActuator
from springgym.model.surfaces import Contact
from springgym.rendering import Arrow, Camera, Look, Marks, Scenery
from springgym.rendering.look import GREEN, ORANGE, RED
from springgym.scenes import film

PADDLE, BALL = 0, 1
"""Indices of the bodies in the scene; a second ball follows the first."""

CROWN = 6
"""Index of the paddle's particle in the middle of its upper side, after those of the ring."""

FALL = -GRAVITY[2]  # [m/s²]
RADIUS = 0.3  # of the paddle [m]
HEIGHT = 0.25  # of its upper side above its tip [m]
PADDLE_MASS = 1.0  # [kg]
BALL_MASS = 0.03  # [kg]
BALL_RADIUS = 0.05  # [m]
FORCE = 30.0  # beside the force that carries the paddle [N]
TORQUE = 1.5  # [N·m]
FRICTION = 0.3  # between paddle and ball, and between balls
REACH = 0.01  # Δ of the contact [m]
STRENGTH = 1e-3  # c of the contact [N·m²]
STRUCK = 0.9 * REACH  # gap below which a ball is being hit; it rests at 0.985 Δ [m]
WANTED = (0.4, 0.7)  # wanted heights [m]
HARD_WANTED = (0.4, 1.0)  # with hard=True [m]
DROPPED = (0.3, 0.7)  # initial height of the ball [m]
HOME = 0.25  # largest distance of the paddle from home, vertical and horizontal [m]
TIPPED = 0.8  # and its tilt [rad]
COLUMN = 0.12  # distance of the verticals of two balls from home [m]
ASIDE = 0.5  # largest distance of a ball from its vertical [m]
WAY_UNIT = 0.1  # unit of the paddle's distances among the features [m]
SPEED_UNIT = 1.0  # of its speeds [m/s]
BALL_WAY_UNIT = 0.25  # of the ball's distances [m]
BALL_SPEED_UNIT = 2.0  # of its speeds [m/s]
SPIN_UNIT = 10.0  # of its spin [rad/s]
TILT_UNIT = 0.2  # of the axis [1]
TURNING_UNIT = 3.0  # of the paddle's angular velocity [rad/s]


@compiled
def apex_of(height: float, rising: float) -> float:
    """Return the highest position that a ball's lowest point would reach in free flight [m].

    ``height`` is that of its centre [m], ``rising`` its velocity [m/s]; heights are relative to the paddle's
    initial position.
    """
    return height - BALL_RADIUS + rising**2 / (2.0 * FALL)


@compiled
def column_of(balls: int, ball: int) -> float:
    """Return the x of the vertical line on which a ball should bounce [m]."""
    return 0.0 if balls == 1 else COLUMN * (2 * (ball - BALL) - 1)


@kernel
def evaluate(m: Measures, s: Situation, out: np.ndarray) -> None:
    balls = m.centre.shape[1] - 1
    for c in range(out.shape[0]):
        paddle = m.centre[c, PADDLE]
        n = m.axis[c, PADDLE]
        high = 0.0
        straight = 0.0
        worst = 0.0
        farthest = 0.0
        met = True
        dropped = False
        for k in range(BALL, BALL + balls):
            ball = m.centre[c, k]
            offset = apex_of(ball[2], m.centre_velocity[c, k, 2]) - s.goal[c, 0]
            aside = math.hypot(ball[0] - column_of(balls, k), ball[1])
            above = height_above(s.x[c, CROWN], ball, n)
            high += long_tail(offset, 0.3, 0.03)
            straight += gaussian(offset, 0.15, 0.03) * gaussian(aside, 0.3, 0.05)
            worst = offset if abs(offset) > abs(worst) else worst
            farthest = max(farthest, aside)
            struck = above - BALL_RADIUS < STRUCK
            met = met and (abs(offset) < 0.08 or struck) and aside < 0.1
            dropped = dropped or above < 0.0
        strayed = max(math.hypot(paddle[0], paddle[1]), abs(s.x[c, CROWN, 2]))
        effort = thrift(s.action, c)
        out["reward_high"][c] = 0.5 * effort * high / balls
        out["reward_straight"][c] = 0.5 * effort * straight / balls
        out["height_offset"][c] = worst
        out["lateral_offset"][c] = farthest
        out["tilt"][c] = angle_of(n[2])
        out["success"][c] = met
        out["terminated"][c] = dropped or strayed > HOME or farthest > ASIDE or n[2] < math.cos(TIPPED)


@kernel
def observe_features(m: Measures, s: Situation, observation: np.ndarray) -> None:
    balls = m.centre.shape[1] - 1
    for c in range(observation.shape[0]):
        for axis in range(3):
            observation[c, axis] = m.centre[c, PADDLE, axis] / WAY_UNIT
            observation[c, 3 + axis] = m.centre_velocity[c, PADDLE, axis] / SPEED_UNIT
        for axis in range(2):
            observation[c, 6 + axis] = m.axis[c, PADDLE, axis] / TILT_UNIT
            observation[c, 8 + axis] = m.angular_velocity[c, PADDLE, axis] / TURNING_UNIT
        observation[c, 10] = s.goal[c, 0] / BALL_WAY_UNIT
        for k in range(balls):
            first = 11 + 10 * k
            ball = BALL + k
            apex = apex_of(m.centre[c, ball, 2], m.centre_velocity[c, ball, 2])
            for axis in range(3):
                observation[c, first + axis] = m.centre[c, ball, axis] / BALL_WAY_UNIT
                observation[c, first + 3 + axis] = m.centre_velocity[c, ball, axis] / BALL_SPEED_UNIT
                observation[c, first + 6 + axis] = m.angular_velocity[c, ball, axis] / SPIN_UNIT
            observation[c, first + 9] = (apex - s.goal[c, 0]) / WAY_UNIT


def ball_entries(which: str) -> tuple[Entry, ...]:
    """Return the entries of the observation of a ball, under names that begin with ``which``."""
    return (
        Entry(f"{which}ball", 3, BALL_WAY_UNIT),
        Entry(f"{which}ball_velocity", 3, BALL_SPEED_UNIT),
        Entry(f"{which}spin", 3, SPIN_UNIT),
        Entry(f"{which}height_offset", 1, WAY_UNIT),
    )


class SpringJuggle(Task, kernels=(evaluate, observe_features)):
    """Define the MDP of `SpringJuggleEnv`, which describes it."""

    actions: ClassVar = {"wrench": 5}
    terms = ("high", "straight")
    metrics = ("height_offset", "lateral_offset", "tilt")
    entries = (
        Entry("paddle", 3, WAY_UNIT),
        Entry("paddle_velocity", 3, SPEED_UNIT),
        Entry("axis", 2, TILT_UNIT),
        Entry("turning", 2, TURNING_UNIT),
        Entry("wanted_height", 1, BALL_WAY_UNIT),
        *ball_entries(""),
    )
    goal_size = 1
    finest = 0.02 / 64
    damping_every = 2
    hold_steps = 100
    checks_starts = False
    limits = np.array([FORCE] * 3 + [TORQUE] * 2)

    def __init__(
        self, restitution: float = 0.95, balls: int = 1, hard: bool = False, **modes: Unpack[Modes]
    ) -> None:
        super().__init__(**modes)
        self.balls = whole("balls", balls, 1, 2)
        self.columns = [column_of.py_func(self.balls, BALL + n) for n in range(self.balls)]
        """x of the vertical on which each ball should bounce [m]"""
        if balls == 2:
            self.entries = (*type(self).entries, *ball_entries("other_"))
        self.contact = Contact(friction=FRICTION, restitution=restitution, strength=STRENGTH, reach=REACH)
        self.wanted = HARD_WANTED if flag("hard", hard) else WANTED
        self.paddle: Body = top(6, RADIUS, HEIGHT, PADDLE_MASS, stiffness=1e5, damping=60.0)
        self.ball = rolling_ball(BALL_RADIUS, BALL_MASS, stiffness=2e3, damping=0.2)

    def make_scene(self) -> Scene:
        balls = [
            Placed(self.ball, self.ball.positions + np.array([column, 0.0, 0.5]), name=name)
            for column, name in zip(self.columns, ("ball", "other"), strict=False)
        ]
        paddle = Placed(self.paddle, self._shape, wrench=WrenchActuator(perpendicular=True), name="paddle")
        return Scene(bodies=(paddle, *balls), collisions=self.contact)

    @cached_property
    def _shape(self) -> np.ndarray:
        """Return the paddle's particles, its crown at the origin [m]."""
        return self.paddle.positions - self.paddle.positions[CROWN]

    def observed_particles(self) -> ObservedParticles:
        count = len(self.paddle.masses)
        size = len(self.ball.masses)
        of_balls = [count + size * k + n for k in range(self.balls) for n in (0, 1, 3)]  # 3 is opposite to 0
        seen = (0, 2, 4, CROWN, *of_balls)
        speeds = np.append(np.ones(count), np.full(size * self.balls, BALL_SPEED_UNIT))
        return ObservedParticles(seen, 0.25, speeds)

    def draw(self, rng: np.random.Generator, options: ResetOptions, factors: Factors) -> Drawn:
        low = (self.wanted[0], DROPPED[0], 0.0, -math.pi, -0.1, -0.1)
        high = (self.wanted[1], DROPPED[1], 0.1, math.pi, 0.1, 0.1)
        wanted, height, aside, bearing, east, north = uniform(rng, low, high)
        wanted = number(options, "wanted_height", wanted, 0.4, 1.0)
        height = number(options, "height", height, 0.1, 1.0)
        aside = number(options, "lateral_offset", aside, 0.0, 0.2)
        dropped = (
            self.columns[0] + aside * math.cos(bearing),
            aside * math.sin(bearing),
            height + BALL_RADIUS,
        )
        states = [*dropped, east, north, 0.0]
        if self.balls == 2:  # the other has just left the paddle, and rises to the wanted height
            speed = math.sqrt(2.0 * FALL * max(wanted - BALL_RADIUS, 0.0))
            states += (self.columns[1], 0.0, 2 * BALL_RADIUS, 0.0, 0.0, speed)
        return wanted, factors["scale"], *states

    def starts(self, drawn: np.ndarray) -> Start:
        paddle = drawn[:, 1:2, None] * self._shape
        balls = drawn[:, 2:].reshape(len(drawn), -1, 2, 1, 3)
        placed = [balls[:, n, 0] + self.ball.positions for n in range(self.balls)]
        thrown = [balls[:, n, 1] + np.zeros_like(self.ball.positions) for n in range(self.balls)]
        return Start(np.hstack([paddle, *placed]), np.hstack([np.zeros_like(paddle), *thrown]), drawn[:, :1])

    def actuate(self, action: np.ndarray) -> dict[str, np.ndarray]:
        driven = self.limits * action
        force = driven[:, :3].copy()
        torque = level(driven[:, 3:])
        force[:, 2] += PADDLE_MASS * FALL
        return {"paddle.force": force, "paddle.torque": torque}

    def look(self) -> Look:
        return film.look(self.scene, colors={placed.name: ORANGE for placed in self.scene.bodies[BALL:]})

    def camera(self) -> Camera:
        return Camera.framing((0, 0, 0.3), 1.5, elevation=0.2)

    def scenery(self) -> Scenery:
        return Scenery(floor=-0.45)

    def marks(self, m: Measures, s: Situation) -> Marks:
        height = s.goal[0] + BALL_RADIUS
        apexes = apex_of.py_func(m.centre[BALL:, 2], m.centre_velocity[BALL:, 2])
        torque = across(np.append(s.action[3:], 0.0), m.axis[PADDLE])
        return Marks(
            rings=[((column, 0.0, height), 0.1) for column in self.columns],
            arrows=[
                Arrow(m.centre[PADDLE], 0.3 * s.action[:3]),
                torque_arrow(m.centre[PADDLE], torque, 1.2 * RADIUS),
            ],
            key=((GREEN, "target height of the bounce"), (RED, "force and torque on the paddle")),
            text=tuple(
                f"apex {100 * abs(high):4.1f} cm too {'high' if high > 0 else 'low'}"
                for high in apexes - s.goal[0]
            ),
        )


class JuggleOptions(EnvOptions, total=False):
    """`SpringJuggleEnv` takes these options, see there."""

    action: Literal["wrench"]
    restitution: float
    balls: int
    hard: bool


class SpringJuggleEnv(SpringEnv, gym.Env, task=SpringJuggle):
    """
    ## Description
    A paddle hangs in the air and a ball falls onto it. Keep the ball bouncing straight up to a given height.
    Each bounce loses energy, and an off-centre bounce sends the ball sideways. The paddle is a ring of 6
    particles and a crown, flat above, and a tip below, held together by 19 springs. If the paddle hits the
    ball (radius 5 cm) obliquely, friction (0.3) spins the ball, and the spin sends it sideways at the next
    hit.

    ## Action Space
    Actions are held for a control period of 20 ms, in the axes of the world.

    | `action` | entries | meaning | at ±1 |
    |---|---|---|---|
    | `"wrench"` | 0–2 | force on the paddle along x, y, z, plus one that carries its weight | ±30 N |
    | | 3, 4 | torque on it about x, y, minus its component along the paddle's axis | ±1.5 N·m |

    ## Observation Space
    Home is the paddle's starting position.

    | `observation` | entries | meaning | scale |
    |---|---|---|---|
    | `"particles"` | 0–20 | ring particles 0, 2, 4, crown, and three of the ball, from home | 0.25 m |
    | | 21–32 | velocities of the paddle's particles | 1 m/s |
    | | 33–41 | velocities of the ball's particles | 2 m/s |
    | | 42 | target height | 1 m |
    | `"features"` | 0–2 | the paddle's centre of mass, from the home position of its upper side | 0.1 m |
    | | 3–5 | its velocity | 1 m/s |
    | | 6, 7 | axis of the paddle x, y | 0.2 |
    | | 8, 9 | its angular velocity x, y | 3 rad/s |
    | | 10 | target height | 0.25 m |
    | | 11–13 | ball, from the paddle's home | 0.25 m |
    | | 14–16 | its velocity | 2 m/s |
    | | 17–19 | its angular velocity | 10 rad/s |
    | | 20 | height of its flight, minus the target height | 0.1 m |

    With `balls=2`, the entries of the second ball follow those of the first.

    ## Rewards
    The height of a flight is z + v_z²/2g, which the ball's lowest point would reach above the home position
    of the paddle's upper side. With the difference e between this height and the target height, and the
    ball's distance r from the vertical through home, the reward is E [L(e; 0.03, 0.3) + G(e; 0.03, 0.15) G(r;
    0.05, 0.3)]/2 ([G, L, E](../environments.md#shared-definitions)). `reward_high` is the half with L,
    `reward_straight` the other. With two balls the reward is the mean.

    ## Starting State
    The paddle rests at home, level. The ball is U(0.3, 0.7) m above it, up to 0.1 m off-centre, with U(−0.1,
    0.1) m/s along x and y. The target height is U(0.4, 0.7) m.
    `reset(options={"wanted_height": …, "height": …, "lateral_offset": …})` sets them.

    ## Episode End
    Termination: the ball is below the paddle's plane or 0.5 m off the vertical through home, or the paddle is
    0.25 m away from home vertically or horizontally, or tilted by 0.8 rad. Truncation: 500 steps, 10 s.
    `info["is_success"]`: r < 0.1 m and, except during hits, |e| < 0.08 m for the last 100 steps.

    ## Information
    `height_offset` e [m], `lateral_offset` r [m], `tilt` of the paddle [rad], `pairs_…`.

    ## Arguments
    - `restitution=0.85`: a ball that loses more energy in each bounce than the default one (0.95).
    - `balls=2`: two balls in turn, each on a vertical 0.12 m left or right of home. The second one starts on
      its way up to the target height. `height_offset` and `lateral_offset` are the larger of the two
      balls' values.
    - `hard=True`: target heights of U(0.4, 1) m.
    - `randomize`: the factor `scale` does not change the ball.
    """

    if TYPE_CHECKING:

        def __init__(self, **options: Unpack[JuggleOptions]) -> None: ...


class SpringJuggleVectorEnv(SpringVectorEnv, gym.vector.VectorEnv, task=SpringJuggle):
    """Run a native batch of `SpringJuggleEnv`."""
