"""SpringRope: swing a load to a target and stop it, by moving the trolley from which it hangs."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any, ClassVar, Literal, Unpack

import gymnasium as gym
import numpy as np

from springgym.checks import flag, shown
from springgym.core.compiler.decorators import kernel
from springgym.dynamics.measures import Measures
from springgym.envs.base import SpringEnv, SpringVectorEnv
from springgym.envs.goals import GoalTolerance
from springgym.envs.observation import Entry, ObservedParticles, Situation
from springgym.envs.options import BodyOptions, EnvOptions, Modes, made, number
from springgym.envs.randomisation import weight_of
from springgym.envs.rewards import gaussian, long_tail, thrift
from springgym.envs.starts import tilted, uniform
from springgym.envs.task import Drawn, Factors, ResetOptions, Start, Task, level
from springgym.model.bodies import rope, solid_rope
from springgym.model.bodies.rotations import cross
from springgym.model.scene import DriveActuator, Scene
from springgym.rendering import Arrow, Camera, Look, Marks, Scenery
from springgym.rendering.look import BLUE, GREEN, INK, RED

ACCELERATION = 3.0  # of the trolley [m/s²]
LOAD_RADIUS = 0.34  # as it is drawn [m]
SPEED = 3.0  # of the trolley [m/s]
LOST = 10.0  # horizontal distance of the load from its target at which an episode ends [m]
CLOSE = 0.1  # distance of the load, for success [m]
SLOW = 0.1  # speed of the load, for success [m/s]
WAY_UNIT = 2.0  # unit of distances among the features [m]
SPEED_UNIT = 2.0  # of speeds [m/s]


@kernel
def evaluate(m: Measures, s: Situation, out: np.ndarray) -> None:
    load = s.x.shape[1] - 1
    for c in range(out.shape[0]):
        distance = math.hypot(s.x[c, load, 0] - s.goal[c, 0], s.x[c, load, 1] - s.goal[c, 1])
        speed = math.hypot(s.v[c, load, 0], s.v[c, load, 1])
        near = (long_tail(distance, 1.0, 0.05) + gaussian(distance, 3.0, 0.05)) / 8 * thrift(s.action, c)
        out["reward_near"][c] = near
        out["reward_still"][c] = 3 * near * gaussian(distance, 0.15, 0.03) * gaussian(speed, 0.15, 0.03)
        out["distance"][c] = distance
        out["speed"][c] = speed
        out["success"][c] = distance < CLOSE and speed < SLOW
        out["terminated"][c] = distance > LOST


@kernel
def observe_features(m: Measures, s: Situation, observation: np.ndarray) -> None:
    load = s.x.shape[1] - 1
    for c in range(observation.shape[0]):
        for axis in range(2):
            observation[c, axis] = (s.goal[c, axis] - s.x[c, load, axis]) / WAY_UNIT
            observation[c, 2 + axis] = s.x[c, 0, axis] - s.x[c, load, axis]
            observation[c, 4 + axis] = s.v[c, load, axis] / SPEED_UNIT
            observation[c, 6 + axis] = s.v[c, 0, axis] / SPEED_UNIT


@kernel
def achieve(m: Measures, s: Situation, achieved: np.ndarray, desired: np.ndarray) -> None:
    load = s.x.shape[1] - 1
    for c in range(achieved.shape[0]):
        for axis in range(2):
            achieved[c, axis] = s.x[c, load, axis]
            desired[c, axis] = s.goal[c, axis]
            achieved[c, 2 + axis] = s.v[c, load, axis]
            desired[c, 2 + axis] = 0.0


class SpringRope(Task, kernels=(evaluate, observe_features, achieve)):
    """Define the MDP of `SpringRopeEnv`, which describes it."""

    actions: ClassVar = {"trolley": 2}
    terms = ("near", "still")
    metrics = ("distance", "speed")
    entries = (
        Entry("to_target", 2, WAY_UNIT),
        Entry("to_trolley", 2),
        Entry("velocity", 2, SPEED_UNIT),
        Entry("trolley_velocity", 2, SPEED_UNIT),
    )
    goal_size = 3
    period = 0.05
    hold_steps = 20
    goal_tolerances = (GoalTolerance("place", 2, CLOSE), GoalTolerance("velocity", 2, SLOW))
    limits = np.full(2, ACCELERATION)

    def __init__(
        self,
        hard: bool = False,
        body: BodyOptions = None,
        material: str | None = None,
        diameter: float | None = None,
        **modes: Unpack[Modes],
    ) -> None:
        super().__init__(**modes)
        self.sway, self.rate, self.farthest = (0.6, 0.8, 6.0) if flag("hard", hard) else (0.25, 0.3, 4.0)
        self.checks_starts = body is not None or material is not None
        usual: dict[str, Any] = {"beads": 9, "length": 4.0, "end_mass": 70.0}
        if material is not None and diameter is not None:
            self.body = made(solid_rope, body, **usual, material=material, diameter=diameter)
        elif material is None and diameter is None:
            self.body = made(rope, body, **usual, damping=30.0)
        else:
            raise ValueError(
                f"material is {shown(material)} and diameter {shown(diameter)}; give both, or neither"
            )

    def make_scene(self) -> Scene:
        return Scene(self.body, pinned=(0,), drive=DriveActuator(0, SPEED))

    def observed_particles(self) -> ObservedParticles:
        moving = tuple(range(len(self.body.masses)))
        return ObservedParticles(moving, 2.0, 2.0, about="goal", skipped=((0, 2),))

    def draw(self, rng: np.random.Generator, options: ResetOptions, factors: Factors) -> Drawn:
        azimuth, turning, bearing, rate, drawn_sway, drawn_distance = uniform(
            rng,
            (-math.pi, -math.pi, -math.pi, -self.rate, 0.0, 1.5),
            (math.pi, math.pi, math.pi, self.rate, self.sway, self.farthest),
        )
        sway = number(options, "sway", drawn_sway, 0.0, 1.0)
        distance = number(options, "distance", drawn_distance, 0.0, 8.0)
        weight = weight_of(1.0, factors), math.cos(sway), factors["stiffness"]
        omega = [rate * share for share in (math.cos(turning), math.sin(turning), 0.0)]
        goal = distance * math.cos(bearing), distance * math.sin(bearing), 0.0
        return azimuth, sway, factors["scale"], *weight, *omega, *goal

    def starts(self, drawn: np.ndarray) -> Start:
        scale, weight, upright, stiffer = (drawn[:, n, None] for n in range(2, 6))
        pull = weight * (self.body.mass - np.cumsum(self.body.masses)[:-1]) * upright
        lengths = scale * self.body.lengths + pull / (stiffer * self.body.stiffness)
        hanging = np.zeros((len(drawn), *self.body.positions.shape))
        hanging[:, 1:, 2] = -np.cumsum(lengths, axis=1)
        positions = hanging @ tilted(drawn[:, 0], drawn[:, 1]).swapaxes(1, 2)
        return Start(positions, cross(drawn[:, None, 6:9], positions), drawn[:, 9:])

    def actuate(self, action: np.ndarray) -> dict[str, np.ndarray]:
        return {"acceleration": ACCELERATION * level(action)}

    def look(self) -> Look:
        count = len(self.body.masses)
        radii = np.full(count, 0.06)
        radii[0] = 0.15
        radii[-1] = LOAD_RADIUS
        return Look(
            bars=self.body.springs,
            bar_radius=0.035,
            bar_colors=INK,
            radii=radii,
            ball_colors=[INK] * (count - 1) + [BLUE],
            springs=self.body.springs,
            trace=count - 1,
            trace_length=60,
        )

    def camera(self) -> Camera:
        length = float(self.body.lengths.sum())
        return Camera.framing((0, 0, -0.62 * length), 2.1 * length)

    def scenery(self) -> Scenery:
        return Scenery(floor=-1.2 * float(self.body.lengths.sum()))

    def marks(self, m: Measures, s: Situation) -> Marks:
        x, y = s.goal[:2].tolist()
        length = float(self.body.lengths.sum())
        trolley = s.x[0]
        side = 1.2 * self.farthest
        distance = math.hypot(s.x[-1, 0] - x, s.x[-1, 1] - y)
        feet = [(i * side, j * side, -1.2 * length) for i in (-1, 1) for j in (-1, 1)]
        crane = [
            ((-side, trolley[1], 0.0), (side, trolley[1], 0.0)),
            *(((end, -side, 0.0), (end, side, 0.0)) for end in (-side, side)),
            *((foot, (foot[0], foot[1], 0.0)) for foot in feet),
        ]
        return Marks(
            rings=[((x, y, -1.2 * length), LOAD_RADIUS)],
            balls=[((x, y, -length), LOAD_RADIUS)],
            lines=[((x, y, -1.2 * length), (x, y, -length - LOAD_RADIUS)), *crane],
            arrows=[Arrow(trolley, 1.2 * np.append(s.action, 0.0))],
            text=(f"off target {distance:4.2f} m",),
            key=((GREEN, "target of the load"), (RED, "acceleration of the trolley")),
        )


class RopeOptions(EnvOptions, total=False):
    """`SpringRopeEnv` takes these options, see there."""

    action: Literal["trolley"]
    hard: bool
    body: BodyOptions
    material: str | None
    diameter: float | None


class SpringRopeEnv(SpringEnv, gym.Env, task=SpringRope):
    """
    ## Description
    A load of 70 kg hangs by a 4 m rope from the trolley of an overhead crane. Move it above the target and
    stop it. As in McDonald's paper, the rope consists of eight springs between beads of 0.1 kg: it stretches,
    bounces and swings.

    ## Action Space
    Actions are held for a control period of 50 ms. The two entries are the trolley's acceleration along x and
    y; ±1 is ±3 m/s². The trolley's speed along each axis is limited to 3 m/s.

    ## Observation Space
    | `observation` | entries | meaning | scale |
    |---|---|---|---|
    | `"particles"` | 0–25 | positions of trolley (x, y), beads and load (x, y, z), from the target | 2 m |
    | | 26–51 | their velocities | 2 m/s |
    | `"features"` | 0–1 | horizontal vector from the load to the target | 2 m |
    | | 2–3 | horizontal vector from the load to the trolley | 1 m |
    | | 4–5 | horizontal velocity of the load | 2 m/s |
    | | 6–7 | velocity of the trolley | 2 m/s |

    ## Rewards
    With the load's horizontal distance e from the target, its horizontal speed s and N = [L(e; 0.05, 1) +
    G(e; 0.05, 3)] E / 8, the reward is N [1 + 3 G(e; 0.03, 0.15) G(s; 0.03, 0.15)] ([G, L,
    E](../environments.md#shared-definitions)): `reward_near` + `reward_still`.

    ## Starting State
    The trolley rests at the origin. The rope is stretched by its load, tilted by U(0, 0.25) rad in a random
    direction, and swings at U(−0.3, 0.3) rad/s about a random horizontal axis. The target is U(1.5, 4) m
    away. `reset(options={"sway": …, "distance": …})` sets this tilt and the distance of the target.

    ## Episode End
    Termination: e exceeds 10 m. Truncation: 200 steps, 10 s. `info["is_success"]`: e < 0.1 m and s < 0.1 m/s
    for the last 20 steps.

    ## Information
    `distance` e [m], `speed` s [m/s].

    ## Arguments
    - `hard=True`: rope tilted by U(0, 0.6) rad and swinging at U(−0.8, 0.8) rad/s, target U(1.5, 6) m away.
    - `material`, `diameter`: a cable instead of the paper's rope, for example `"steel"` and 0.005 [m]. Steel
      hardly stretches; nylon bounces.
    - `body`: arguments of `springgym.model.bodies.rope`, or of `springgym.model.bodies.solid_rope` with a
      material.
    - `goals=True`, with `sparse=True`: [goal environment](../features.md#goals). The goal is x, y of the load
      [m] and of its velocity [m/s].
    """

    if TYPE_CHECKING:

        def __init__(self, **options: Unpack[RopeOptions]) -> None: ...


class SpringRopeVectorEnv(SpringVectorEnv, gym.vector.VectorEnv, task=SpringRope):
    """Run a native batch of `SpringRopeEnv`."""
