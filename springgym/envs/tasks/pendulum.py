"""SpringPendulum: swing a cube up about one of its corners."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, ClassVar, Literal, Unpack

import gymnasium as gym
import numpy as np

from springgym.checks import chosen
from springgym.core.compiler.decorators import kernel
from springgym.dynamics.measures import Measures
from springgym.envs.arrows import across, torque_arrow
from springgym.envs.base import SpringEnv, SpringVectorEnv
from springgym.envs.observation import Entry, ObservedParticles, Situation
from springgym.envs.options import BodyOptions, EnvOptions, Modes, made, number
from springgym.envs.rewards import angle_of, gaussian, put_axis, spinning, thrift, tilt_of
from springgym.envs.starts import uniform
from springgym.envs.task import Drawn, Factors, ResetOptions, Start, Task, at_rest
from springgym.model.bodies import cube, start
from springgym.model.bodies.rotations import axes, turned
from springgym.model.scene import Scene, ThrustActuator, WrenchActuator
from springgym.rendering import Arrow, Camera, Look, Marks, Scenery
from springgym.rendering.look import GREEN, RED, in_faces

TORQUE = 4.25  # [N·m], half of the weight's largest moment
IMPULSE = 0.1  # largest component a control period [N·s]: 4.3 N·m at the arm of the far corner
TURNING_UNIT = 4.0  # unit of angular velocities among the features [rad/s]
FAR = 6  # the corner opposite to the pin
TOO_FAST = 8.0  # angular velocity that ends an episode [rad/s]


@kernel
def evaluate(m: Measures, s: Situation, out: np.ndarray) -> None:
    for c in range(out.shape[0]):
        tilt = tilt_of(m, c)
        spin, across = spinning(m, c)
        speed = math.hypot(spin, across)
        raised = ((1 + m.axis[c, 2]) / 2) ** 2 / 4 * thrift(s.action, c)
        out["reward_raised"][c] = raised
        out["reward_held"][c] = 3 * raised * gaussian(tilt, 0.2, 0.05) * gaussian(speed, 0.8, 0.2)
        out["tilt"][c] = tilt
        out["angular_speed"][c] = speed
        out["spin"][c] = spin
        out["success"][c] = tilt < 0.15 and speed < 0.5
        out["terminated"][c] = speed > TOO_FAST


@kernel
def observe_features(m: Measures, s: Situation, observation: np.ndarray) -> None:
    for c in range(observation.shape[0]):
        spin = put_axis(m, c, TURNING_UNIT, observation[c])
        observation[c, 6] = spin / TURNING_UNIT


class SpringPendulum(Task, kernels=(evaluate, observe_features)):
    """Define the MDP of `SpringPendulumEnv`, which describes it."""

    actions: ClassVar = {"torque": 3, "impulse": 3}
    terms = ("raised", "held")
    metrics = ("tilt", "angular_speed", "spin")
    entries = (Entry("axis", 3), Entry("across", 3, TURNING_UNIT), Entry("spin", 1, TURNING_UNIT))
    period = 0.04
    hold_steps = 25

    def __init__(
        self, start: Literal["hanging", "mixed"] = "hanging", body: BodyOptions = None, **modes: Unpack[Modes]
    ) -> None:
        super().__init__(**modes)
        self.starts_anywhere = chosen("start", start, ("hanging", "mixed")) == "mixed"
        self.body = made(cube, body)
        self.checks_starts = body is not None
        self._shape = self.body.positions - self.body.positions[0]
        self.limits = np.full(3, IMPULSE if self.action == "impulse" else TORQUE)

    def make_scene(self) -> Scene:
        hanging = start(self.body, tilt=math.pi, omega=(TOO_FAST, 0.0, 0.0), pinned=(0,))
        impulse = self.action == "impulse"
        return Scene(
            self.body,
            *hanging,
            pinned=(0,),
            wrench=None if impulse else WrenchActuator(perpendicular=True),
            thrust=ThrustActuator((FAR,)) if impulse else None,
        )

    def observed_particles(self) -> ObservedParticles:
        reach = np.linalg.norm(self._shape, axis=1)
        return ObservedParticles(tuple(range(1, 8)), reach, 4.0 * reach)

    def draw(self, rng: np.random.Generator, options: ResetOptions, factors: Factors) -> Drawn:
        anywhere, near, azimuth, roll = uniform(
            rng, (0.0, 0.0, -math.pi, -math.pi), (math.pi, 0.3, math.pi, math.pi)
        )
        tilt = math.pi - near
        if rng.uniform() < 0.5 and self.starts_anywhere:
            tilt = anywhere
        return azimuth, number(options, "tilt", tilt, 0.0, math.pi), roll, factors["scale"]

    def starts(self, drawn: np.ndarray) -> Start:
        upright = np.array([0.0, 0.0, 1.0])
        sideways = np.array([0.0, 1.0, 0.0])
        azimuth, tilt, roll = drawn[:, :3].T
        turn = turned(upright, azimuth) @ turned(sideways, tilt) @ turned(upright, roll)
        turn = turn @ axes(self.body.positions, self.body.markers).T
        return at_rest(drawn[:, 3:, None] * (self._shape @ turn.swapaxes(1, 2)))

    def actuate(self, action: np.ndarray) -> dict[str, np.ndarray]:
        if self.action == "impulse":
            return {"thrust": action[:, None] * (IMPULSE / self.period)}
        return {"torque": TORQUE * action}

    def look(self) -> Look:
        return in_faces(self.body.triangles, self.body.springs, trace=FAR)

    def camera(self) -> Camera:
        return Camera.framing((0, 0, 0), 4.4 * float(self.body.lengths.max()) / math.sqrt(3))

    def scenery(self) -> Scenery:
        length = float(self.body.lengths.max())
        return Scenery(floor=-1.25 * length, vertical=((0.0, 0.0, 0.0), 1.25 * length))

    def marks(self, m: Measures, s: Situation) -> Marks:
        tilt = math.degrees(angle_of.py_func(m.axis[2]))
        speed = float(np.linalg.norm(m.angular_velocity))
        top = (0.0, 0.0, float(self.body.lengths.max()))
        if self.action == "impulse":
            acting = Arrow(s.x[FAR], 0.4 * s.action)
        else:
            acting = torque_arrow(m.centre, across(s.action, m.axis), 0.45 * top[2])
        return Marks(
            balls=[(top, 0.04)],
            arrows=[acting],
            text=(f"tilt {tilt:5.1f}°", f"{speed:4.1f} rad/s"),
            key=((GREEN, "target of the far corner"), (RED, self.action)),
        )


class PendulumOptions(EnvOptions, total=False):
    """`SpringPendulumEnv` takes these options, see there."""

    action: Literal["torque", "impulse"]
    start: Literal["hanging", "mixed"]
    body: BodyOptions


class SpringPendulumEnv(SpringEnv, gym.Env, task=SpringPendulum):
    """
    ## Description
    A cube hangs from one of its corners. Swing it up and hold it upside down, with half the torque that would
    lift it. A spring joins every pair of its 8 particles, as in McDonald's paper.

    ## Action Space
    Actions are held for a control period of 40 ms, in the axes of the world.

    | `action` | entries | meaning | at ±1 |
    |---|---|---|---|
    | `"torque"` | 0–2 | torque about x, y, z, minus its component along the diagonal | ±4.25 N·m |
    | `"impulse"` | 0–2 | impulse on the far corner along x, y, z, spread over the period | ±0.1 N·s |

    The diagonal runs through the pin and the far corner. Neither mode can spin the cube about this diagonal.
    The weight exerts a torque of at most 8.5 N·m.

    ## Observation Space
    | `observation` | entries | meaning | scale |
    |---|---|---|---|
    | `"particles"` | 0–20 | positions x, y, z of corners 1–7 | distance from the pin |
    | | 21–41 | their velocities | 4 rad/s × distance from the pin |
    | `"features"` | 0–2 | diagonal n from the pin, a unit vector | 1 |
    | | 3–5 | angular velocity across it, ω⊥ | 4 rad/s |
    | | 6 | angular velocity along it, ω₃ | 4 rad/s |

    ## Rewards
    With the tilt θ of n from the upright and R = ((1 + n_z)/2)² E / 4, the reward is R [1 + 3 G(θ; 0.05, 0.2)
    G(|ω|; 0.2, 0.8)] ([G, L, E](../environments.md#shared-definitions)): `reward_raised` + `reward_held`.

    ## Starting State
    The cube is at rest, U(0, 0.3) rad from hanging, and rotated at random about the vertical and the
    diagonal. `reset(options={"tilt": …})` sets the tilt from the upright.

    ## Episode End
    Termination: |ω| exceeds 8 rad/s, so spinning the cube up does not help. Truncation: 250 steps,
    10 s. `info["is_success"]`: θ < 0.15 rad and |ω| < 0.5 rad/s for the last 25 steps.

    ## Information
    `tilt` θ [rad], `angular_speed` |ω| and `spin` ω₃ [rad/s].

    ## Arguments
    - `start="mixed"`: half of the episodes start at any tilt U(0, π), the others near hanging; this is easier
      to learn.
    - `body`: arguments of `springgym.model.bodies.cube`.
    """

    if TYPE_CHECKING:

        def __init__(self, **options: Unpack[PendulumOptions]) -> None: ...


class SpringPendulumVectorEnv(SpringVectorEnv, gym.vector.VectorEnv, task=SpringPendulum):
    """Run a native batch of `SpringPendulumEnv`."""
