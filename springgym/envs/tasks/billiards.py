"""SpringBilliards: pocket one ball by striking another, in an episode of one step."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import TYPE_CHECKING, ClassVar, Literal, Unpack

import gymnasium as gym
import numpy as np

from springgym.core.compiler.decorators import compiled, kernel
from springgym.dynamics.measures import Measures
from springgym.envs.base import SpringEnv, SpringVectorEnv
from springgym.envs.observation import Entry, Situation
from springgym.envs.options import Autoreset, EnvOptions, Modes, number
from springgym.envs.randomisation import NOMINAL, weight_of
from springgym.envs.rewards import gaussian, thrift
from springgym.envs.starts import uniform
from springgym.envs.task import Drawn, Factors, ResetOptions, Start, Task, at_rest
from springgym.model.bodies import Body, ball
from springgym.model.scene import Placed, Scene, ThrustActuator
from springgym.model.surfaces import Contact, floor
from springgym.rendering import Arrow, Camera, Look, Marks, Scenery
from springgym.rendering.look import GREEN, INK, ORANGE, RED
from springgym.scenes import film
from springgym.theory.contact import rest_height

CUE, OBJECT = 0, 1
"""Indices of the bodies in the scene."""

PERIOD = 0.02  # control period [s]
PERIODS = 100  # number of periods in an episode
RADIUS = 0.03  # of a ball [m]
MASS = 0.17  # of a ball [kg]
FORCE = 20.0  # of a stroke along each axis, for a period: it gives a ball 2.3 m/s [N]
FRICTION = 0.05
RESTITUTION = 0.95
REACH = 4e-3  # Δ of all contacts [m]
STRENGTH = 8e-5  # c of all contacts [N·m²]
POCKET = 0.06  # largest distance of the centres at which a ball falls in [m]
APART = (0.5, 0.8)  # from ball to ball [m]
WAY = (0.4, 0.7)  # from the second one to the pocket [m]
CUT = 0.7  # the largest angle between the two ways [rad]
ARENA = 7.0  # radius of the drawn table, larger than the range of any stroke [m]
SOFT = 200.0  # stiffness of the net in the pocket, per mass [1/s²]
SLOWING = 25.0  # damping of the net, per mass [1/s]
FRAMED = 1.5  # part of the table that pictures show, along x and y [m]
FELT = (146, 182, 196)  # colour of the table
CUSHION = (104, 144, 162)  # colour of its cushions
WOOD = (158, 116, 80)  # colour of its frame
WHITE = (240, 240, 235)  # colour of the first ball
WAY_UNIT = 0.5  # of the observation [m]


@compiled
def way_left(m: Measures, s: Situation, c: int) -> float:
    """Return the distance of the second ball from the pocket [m]."""
    return math.hypot(m.centre[c, OBJECT, 0] - s.goal[c, 0], m.centre[c, OBJECT, 1] - s.goal[c, 1])


@kernel
def remember(m: Measures, s: Situation, memory: np.ndarray) -> None:
    for c in range(memory.shape[0]):
        memory[c, 0] = min(memory[c, 0], way_left(m, s, c))


@kernel
def evaluate(m: Measures, s: Situation, out: np.ndarray) -> None:
    for c in range(out.shape[0]):
        nearest = min(s.memory[c, 0], way_left(m, s, c))
        potted = nearest < POCKET
        effort = thrift(s.action, c)
        out["reward_near"][c] = 0.0 if potted else 0.2 * effort * gaussian(nearest, 0.5, POCKET)
        out["reward_potted"][c] = effort if potted else 0.0
        out["min_distance"][c] = nearest
        out["success"][c] = potted
        out["terminated"][c] = True  # the episode ends


@kernel
def observe_features(m: Measures, s: Situation, observation: np.ndarray) -> None:
    for c in range(observation.shape[0]):
        for axis in range(2):
            place = m.centre[c, OBJECT, axis]
            observation[c, axis] = (place - m.centre[c, CUE, axis]) / WAY_UNIT
            observation[c, 2 + axis] = (s.goal[c, axis] - place) / WAY_UNIT


class SpringBilliards(Task, kernels=(evaluate, observe_features, remember)):
    """Define the MDP of `SpringBilliardsEnv`, which describes it."""

    observations = ("features",)
    actions: ClassVar = {"stroke": 2}
    terms = ("near", "potted")
    metrics = ("min_distance",)
    entries = (Entry("to_ball", 2, WAY_UNIT), Entry("to_pocket", 2, WAY_UNIT))
    goal_size = 2
    memory = (math.inf,)  # the least distance of the second ball from the pocket so far [m]
    period = PERIOD
    periods = PERIODS
    hold_steps = 1
    wins = True
    finest = PERIOD / 40
    checks_starts = False
    limits = np.full(2, FORCE)

    def __init__(self, **modes: Unpack[Modes]) -> None:
        super().__init__(**modes)
        self.ball: Body = ball(RADIUS, MASS)

    def make_scene(self) -> Scene:
        cue, other = np.reshape(self._placed((-0.6, 0.0), (0.0, 0.0), NOMINAL), (2, 1, 3))
        contact = Contact(friction=FRICTION, restitution=RESTITUTION, strength=STRENGTH, reach=REACH)
        return Scene(
            bodies=(
                Placed(self.ball, cue, thrust=ThrustActuator((0,)), name="cue"),
                Placed(self.ball, other, thrust=ThrustActuator((0,)), name="ball"),
            ),
            surfaces=(floor(),),
            contact=contact,
            collisions=contact,
        )

    def _placed(
        self, cue: tuple[float, float], other: tuple[float, float], factors: Factors
    ) -> tuple[float, ...]:
        """Return the positions of two balls that lie on the table [m], one after the other."""
        height = RADIUS + rest_height(weight_of(MASS, factors), STRENGTH, REACH)
        return *cue, height, *other, height

    def draw(self, rng: np.random.Generator, options: ResetOptions, factors: Factors) -> Drawn:
        low = (-0.2, -0.2, -math.pi, APART[0], WAY[0], -CUT)
        high = (0.2, 0.2, math.pi, APART[1], WAY[1], CUT)
        x, y, bearing, apart, way, cut = uniform(rng, low, high)
        cut = number(options, "cut", cut, -CUT, CUT)
        cue = (x - apart * math.cos(bearing), y - apart * math.sin(bearing))
        pocket = (x + way * math.cos(bearing + cut), y + way * math.sin(bearing + cut))
        return *self._placed(cue, (x, y), factors), *pocket

    def starts(self, drawn: np.ndarray) -> Start:
        return at_rest(drawn[:, :6].reshape(-1, 2, 3), drawn[:, 6:])

    def respond(self, m: Measures, s: Situation) -> dict[str, np.ndarray]:
        """Return the stroke, in the first control period, and the force of the net on a ball in the
        pocket."""
        cue = np.zeros((len(s.action), 1, 3))
        net = np.zeros((len(s.action), 1, 3))
        cue[:, 0, :2] = FORCE * s.action * (s.time == 0.0)[:, None]
        way = s.goal[:, :2] - m.centre[:, OBJECT, :2]
        pull = MASS * (SOFT * way - SLOWING * m.centre_velocity[:, OBJECT, :2])
        net[:, 0, :2] = np.where(s.memory < POCKET, pull, 0.0)
        return {"cue.thrust": cue, "ball.thrust": net}

    def look(self) -> Look:
        colors = np.array([WHITE, ORANGE])
        return replace(film.look(self.scene), radii=np.full(2, RADIUS), ball_colors=colors)

    def camera(self) -> Camera:
        return Camera.framing((0.0, 0.0, 0.0), 0.8, elevation=0.65)

    def framed(self, s: Situation) -> np.ndarray:
        balls = np.clip(s.x, -FRAMED, FRAMED)  # lest a ball that rolls away makes all of them tiny
        return np.vstack([balls, (*s.goal[:2], 0.0)])

    def scenery(self) -> Scenery:
        inside = ARENA + RADIUS
        disks = [(inside + 0.15, WOOD), (inside + 0.05, CUSHION), (inside, FELT)]
        for metres in range(int(ARENA) - 1, 0, -1):  # marks of distance, as the table has no cushions
            disks += [(metres + 0.004, CUSHION), (metres - 0.004, FELT)]
        return replace(super().scenery(), disks=[((0.0, 0.0, 0.0), *disk) for disk in disks])

    def marks(self, m: Measures, s: Situation) -> Marks:
        cue, ball = m.centre
        pocket = np.array([*s.goal[:2], ball[2]])
        stroke = np.append(0.3 * s.action, 0.0)
        behind = stroke * (1.0 + 1.5 * RADIUS / max(float(np.linalg.norm(stroke)), 1e-9))
        away = math.dist(pocket, ball)
        impact = ball + 2.0 * RADIUS / max(away, 1e-9) * (ball - pocket)  # the first ball must be here
        aiming = not m.centre_velocity[OBJECT].any() and m.centre_velocity[CUE] @ (impact - cue) >= 0.0
        return Marks(
            disks=[((*s.goal[:2], 0.0), POCKET, INK)],
            rings=[((*s.goal[:2], 0.0), POCKET)],
            balls=[(impact, RADIUS)] if aiming else [],
            edges=[(ball, pocket, ORANGE), *([(cue, impact, WHITE)] if aiming else [])],
            arrows=[Arrow(cue - behind, stroke)],  # it ends at the ball, as a cue does
            key=((ORANGE, "way to the pocket"), (GREEN, "aim of the white ball"), (RED, "stroke")),
            text=("potted" if s.memory[0] < POCKET else f"{100 * away:.0f} cm from the pocket",),
        )


class BilliardsOptions(EnvOptions, total=False):
    """`SpringBilliardsEnv` takes these options, see there."""

    action: Literal["stroke"]


class SpringBilliardsEnv(SpringEnv, gym.Env, task=SpringBilliards):
    """
    ## Description
    Strike a ball once so that it sends a second ball into a pocket. The table has no cushions, and friction
    slows both balls by 0.49 m/s². Each ball is a single particle with a radius of 3 cm and a mass of 170 g.
    It slides without rotating. A ball in the pocket stays there.

    An episode is one decision: the agent observes the balls and the pocket, and strikes. The second ball
    leaves along the line between the centres, which multiplies an angular error of the stroke by d/2R: 12
    times for balls of radius R at a distance d = 0.7 m. To hit the pocket, ±6 cm at 0.6 m, the stroke must be
    precise to 0.01 rad, and more precise for a cut. Fewer than 1 % of random strokes succeed.

    ## Action Space
    The force is held for a control period of 20 ms. Then the balls slide.

    | `action` | entries | meaning | at ±1 |
    |---|---|---|---|
    | `"stroke"` | 0, 1 | force on the first ball along x, y; at 1 it reaches 2.3 m/s | ±20 N |

    ## Observation Space
    | `observation` | entries | meaning | scale |
    |---|---|---|---|
    | `"features"` | 0, 1 | second ball x, y, from the first | 0.5 m |
    | | 2, 3 | the pocket x, y, from the second ball | 0.5 m |

    ## Rewards
    With the least distance e of the second ball from the pocket, the reward is E if the ball is in the
    pocket, and 0.2 E G(e; 0.06, 0.5) otherwise ([G, L, E](../environments.md#shared-definitions)). Its terms
    are `reward_potted` and `reward_near`.

    ## Starting State
    Both balls rest. The second one is within U(−0.2, 0.2) m of the origin along x and y, and U(0.5, 0.8) m
    from the first, in a random direction. The pocket is U(0.4, 0.7) m beyond the second ball, in a direction
    that differs from the first one by the cut angle U(−0.7, 0.7) rad. `reset(options={"cut": …})` sets this
    angle.

    ## Episode End
    Termination: every step, after 100 control periods. Truncation: 1 step, 2 s. `info["is_success"]`: the
    ball is in the pocket. It falls in if its centre is less than 0.06 m from the pocket's centre at the end
    of a control period. The render mode `"rgb_array_list"` returns one picture per period.

    ## Information
    `min_distance` e [m], `pairs_…`.

    ## Arguments
    - `randomize`: the balls keep their radius, so the factor `scale` changes nothing.
    """

    if TYPE_CHECKING:

        def __init__(self, **options: Unpack[BilliardsOptions]) -> None: ...


class SpringBilliardsVectorEnv(SpringVectorEnv, gym.vector.VectorEnv, task=SpringBilliards):
    """Run a native batch of `SpringBilliardsEnv`."""

    if TYPE_CHECKING:

        def __init__(
            self, num_envs: int = 1, *, autoreset_mode: Autoreset = ..., **options: Unpack[BilliardsOptions]
        ) -> None: ...
