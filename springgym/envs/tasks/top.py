"""SpringTop: bring a spinning top upright and keep it spinning."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import TYPE_CHECKING, ClassVar, Literal, Unpack

import gymnasium as gym
import numpy as np

from springgym.checks import flag
from springgym.core.compiler.decorators import kernel
from springgym.dynamics.measures import Measures
from springgym.envs.arrows import across, torque_arrow
from springgym.envs.base import SpringEnv, SpringVectorEnv
from springgym.envs.observation import Entry, ObservedParticles, Situation
from springgym.envs.options import BodyOptions, EnvOptions, Modes, made, number
from springgym.envs.rewards import angle_of, long_tail, put_axis, spinning, thrift, tilt_of
from springgym.envs.starts import standing, uniform, varied_top
from springgym.envs.task import Drawn, Factors, ResetOptions, Start, Task
from springgym.model.bodies import Body, rigid_velocities, solid_top, stretched_shapes, top
from springgym.model.scene import Scene, ThrustActuator, WrenchActuator
from springgym.rendering import Arrow, Camera, Look, Marks, Scenery
from springgym.rendering.look import GREEN, RED
from springgym.scenes import film

WANTED = 50.0  # spin [rad/s]
TORQUE = 15.0  # largest component [N·m]
WEAK_TORQUE = 10.0  # that of hard=True [N·m]
IMPULSE = 0.3  # largest component a control period [N·s]
ACROSS_UNIT = 2.0  # unit of angular velocities across the axis among the features [rad/s]
SPIN_UNIT = 20.0  # of the spin [rad/s]
FALLEN = 1.2  # tilt [rad]
PAPER_MOMENT = 9.0  # mass times height of the centre of mass of the paper's top, 1 m high [kg·m]
SOLID = {"radius": 0.61, "height": 1.0}  # of a solid top that stands upright from the same spin on [m]
FASTEST = 100.0  # largest initial spin as a reset option [rad/s]


@kernel
def evaluate(m: Measures, s: Situation, out: np.ndarray) -> None:
    spin_counts = s.parameters[0] > 0
    for c in range(out.shape[0]):
        tilt = tilt_of(m, c)
        spin, across = spinning(m, c)
        upright = long_tail(tilt, 0.3, 0.02) / 4 * thrift(s.action, c)
        out["reward_upright"][c] = upright
        out["reward_calm"][c] = upright * long_tail(across, 1.5, 0.1)
        out["reward_spin"][c] = 2 * upright * (long_tail(spin - WANTED, 15.0, 1.0) if spin_counts else 1.0)
        out["tilt"][c] = tilt
        out["spin"][c] = spin
        out["precession"][c] = across
        out["success"][c] = tilt < 0.1 and across < 0.3 and (abs(spin - WANTED) < 3 or not spin_counts)
        out["terminated"][c] = tilt > FALLEN


@kernel
def observe_features(m: Measures, s: Situation, observation: np.ndarray) -> None:
    for c in range(observation.shape[0]):
        spin = put_axis(m, c, ACROSS_UNIT, observation[c])
        observation[c, 6] = (spin - WANTED) / SPIN_UNIT


class SpringTop(Task, kernels=(evaluate, observe_features)):
    """Define the MDP of `SpringTopEnv`, which describes it."""

    actions: ClassVar = {"torque": 3, "impulse": 3}
    terms = ("upright", "calm", "spin")
    metrics = ("tilt", "spin", "precession")
    entries = (Entry("axis", 3), Entry("across", 3, ACROSS_UNIT), Entry("spin", 1, SPIN_UNIT, about=WANTED))

    def __init__(self, hard: bool = False, body: BodyOptions = None, **modes: Unpack[Modes]) -> None:
        super().__init__(**modes)
        self.hard = hard = flag("hard", hard)
        solid = isinstance(body, Mapping) and "material" in body
        self.body: Body = made(solid_top, body, **SOLID) if solid else made(top, body)
        self.checks_starts = body is not None
        self.upper = self.body.particle("heart" if solid else "crown")
        moment = self.body.mass * float(
            self.body.centre[2] - self.body.positions[self.body.particle("tip"), 2]
        )
        heavier = moment / PAPER_MOMENT if solid else 1.0
        self.torque = heavier * (WEAK_TORQUE if hard else TORQUE)
        self.impulse = heavier * IMPULSE / (float(self.body.positions[self.upper, 2]) if solid else 1.0)
        self._across = self.torque * np.array([1.0, 1.0, 0.0])
        self._along = self.torque * np.array([0.0, 0.0, 1.0])
        slowest = (32.0, 40.0) if self.action == "impulse" else (20.0, 30.0)
        self.spins = (slowest[0] if hard else slowest[1], 60.0)
        self._shape = stretched_shapes(self.body, (0, 0, 1), FASTEST, self.body.parts["tip"])
        self.parameters = np.array([self.action != "impulse"], float)
        self.limits = np.full(3, self.impulse if self.action == "impulse" else self.torque)

    def make_scene(self) -> Scene:
        impulse = self.action == "impulse"
        spin = rigid_velocities(
            self.body.positions, (0, 0, self.spins[1]), self.body.positions[self.body.particle("tip")]
        )
        return Scene(
            self.body,
            velocities=spin,
            pinned=self.body.parts["tip"],
            wrench=None if impulse else WrenchActuator(perpendicular=True),
            thrust=ThrustActuator((self.upper,)) if impulse else None,
        )

    def observed_particles(self) -> ObservedParticles:
        ring = self.body.parts["ring"]
        reach = np.linalg.norm(self.body.positions, axis=1)
        outwards = np.hypot(self.body.positions[:, 0], self.body.positions[:, 1])
        return ObservedParticles((*ring, self.upper), reach, WANTED * outwards + 2.0 * reach)

    def draw(self, rng: np.random.Generator, options: ResetOptions, factors: Factors) -> Drawn:
        low = (0.1, -math.pi, self.spins[0])
        high = (0.6, math.pi, self.spins[1])
        tilt, azimuth, spin = uniform(rng, low, high)
        if self.hard:  # slow tops that lean farther cannot be saved
            tilt = low[0] + (tilt - low[0]) * min(0.2 + 0.06 * (spin - 20.0), 1.0)
        tilt = number(options, "tilt", tilt, 0.0, FALLEN)
        azimuth = number(options, "azimuth", azimuth, -math.pi, math.pi)
        return azimuth, tilt, number(options, "spin", spin, -FASTEST, FASTEST), *varied_top(factors)

    def starts(self, drawn: np.ndarray) -> Start:
        return Start(*standing(self._shape, self.body.particle("tip"), drawn))

    def actuate(self, action: np.ndarray) -> dict[str, np.ndarray]:
        if self.action == "impulse":
            return {"thrust": action[:, None] * (self.impulse / self.period)}
        return {"torque": action * self._across, "body_torque": action * self._along}

    def look(self) -> Look:
        return film.look(self.scene, self.upper)

    def camera(self) -> Camera:
        size = float(np.ptp(self.body.positions, axis=0).max())
        return Camera.framing((0, 0, 0.5 * size), 2.2 * size, elevation=0.45)

    def scenery(self) -> Scenery:
        return Scenery(floor=0.0, vertical=((0.0, 0.0, 0.0), 1.2 * float(self.body.positions[:, 2].max())))

    def marks(self, m: Measures, s: Situation) -> Marks:
        tilt = angle_of.py_func(m.axis[2])
        spin = float(m.angular_velocity @ m.axis)
        radius = float(np.hypot(self.body.positions[:, 0], self.body.positions[:, 1]).max())
        if self.action == "impulse":
            acting = Arrow(s.x[self.upper], 0.4 * s.action)
        else:
            torque = across(s.action * (1.0, 1.0, 0.0), m.axis) + s.action[2] * m.axis
            acting = torque_arrow(m.centre, torque, 1.1 * radius)
        return Marks(
            balls=[((0.0, 0.0, float(self.body.positions[:, 2].max())), 0.08 * radius)],
            arrows=[acting],
            text=(f"tilt {math.degrees(tilt):4.1f}°", f"spin {spin:4.1f} rad/s"),
            key=((GREEN, "target axis"), (RED, "impulse" if self.action == "impulse" else "torque")),
        )


class TopOptions(EnvOptions, total=False):
    """`SpringTopEnv` takes these options, see there."""

    action: Literal["torque", "impulse"]
    hard: bool
    body: BodyOptions


class SpringTopEnv(SpringEnv, gym.Env, task=SpringTop):
    """
    ## Description
    A spinning top stands tilted on its pinned tip. Bring it upright and spin it at 50 rad/s. In the top of
    McDonald's paper, 37 stiff springs hold a ring of 12 particles, a crown and a tip together. A push on the
    crown moves the axis perpendicular to the push.

    ## Action Space
    Actions are held for a control period of 20 ms.

    | `action` | entries | meaning | at ±1 |
    |---|---|---|---|
    | `"torque"` | 0, 1 | torque about the world's x, y, minus its component along the top's axis | ±15 N·m |
    | | 2 | torque about the top's axis | ±15 N·m |
    | `"impulse"` | 0–2 | impulse on the crown along x, y, z, spread over the period | ±0.3 N·s |

    The weight exerts a torque of 88 N·m sin(tilt).

    ## Observation Space
    | `observation` | entries | meaning | scale |
    |---|---|---|---|
    | `"particles"` | 0–38 | positions x, y, z of ring particles 0–11 and crown | its distance from the tip |
    | | 39–77 | their velocities | 50 rad/s × its radius + 2 rad/s × its distance |
    | `"features"` | 0–2 | axis n of the top, a unit vector | 1 |
    | | 3–5 | angular velocity across the axis, ω⊥ | 2 rad/s |
    | | 6 | spin ω₃ − 50 rad/s | 20 rad/s |

    ## Rewards
    With the tilt θ of the axis and U = L(θ; 0.02, 0.3) E / 4, the reward is U [1 + L(|ω⊥|; 0.1, 1.5) + 2
    L(ω₃ − 50; 1, 15)] ([G, L, E](../environments.md#shared-definitions)): `reward_upright` + `reward_calm` +
    `reward_spin`. With `action="impulse"`, which cannot change the spin, the last L is 1.

    ## Starting State
    The top spins at U(30, 60) rad/s (with impulses U(40, 60)), tilted by U(0.1, 0.6) rad in a direction U(−π,
    π). The springs start at their steady-rotation equilibrium. Below 39 rad/s, an upright top is unstable.
    `reset(options={"tilt": …, "azimuth": …, "spin": …})` sets them.

    ## Episode End
    Termination: the tilt exceeds 1.2 rad. Truncation: 500 steps, 10 s. `info["is_success"]`: tilt < 0.1, |ω⊥|
    < 0.3 rad/s and |ω₃ − 50| < 3 rad/s (spin not required for `action="impulse"`) for the last 50 steps.

    ## Information
    `tilt` [rad], `spin` ω₃ and `precession` |ω⊥| [rad/s].

    ## Arguments
    - `hard=True`: spin U(20, 60) rad/s (with impulses U(32, 60)) and torques up to 10 N·m. The largest tilt
      is 0.2 + 0.03 (ω/(rad/s) − 20) where this is below 0.6, because slow tops that lean farther cannot be
      saved.
    - `body={"scaled": {0: 1.1}}`: an unbalanced top, with one ring particle 10 % heavier; beyond about 20 %
      it wobbles too much for success.
    - `body={"height": 1.25}`: an elongated top (1 m), whose weight exerts a larger torque at the same spin.
    - `body` with a `material`, as `{"material": "beech"}`: a solid cone with the arguments of
      `springgym.model.bodies.solid_top` (defaults: radius 0.61 m, height 1 m). Actions are scaled with the
      moment of its weight; a particle at two thirds of its height, the `heart`, replaces the crown.
    - `body`: any other arguments of `springgym.model.bodies.top`.
    """

    if TYPE_CHECKING:

        def __init__(self, **options: Unpack[TopOptions]) -> None: ...


class SpringTopVectorEnv(SpringVectorEnv, gym.vector.VectorEnv, task=SpringTop):
    """Run a native batch of `SpringTopEnv`."""
