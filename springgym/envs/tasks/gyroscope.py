"""SpringGyroscope: point the axis of a spinning rotor."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import TYPE_CHECKING, ClassVar, Literal, Unpack

import gymnasium as gym
import numpy as np

from springgym.checks import flag
from springgym.core.compiler.decorators import kernel
from springgym.dynamics.measures import Measures
from springgym.envs.arrows import across, torque_arrow
from springgym.envs.base import SpringEnv, SpringVectorEnv
from springgym.envs.goals import GoalTolerance
from springgym.envs.observation import Entry, ObservedParticles, Situation
from springgym.envs.options import BodyOptions, EnvOptions, Modes, made, number
from springgym.envs.rewards import angle_between, angle_of, gaussian, long_tail, put_axis, spinning, thrift
from springgym.envs.starts import direction, tilted, uniform
from springgym.envs.task import Drawn, Factors, ResetOptions, Start, Task
from springgym.model.bodies import gyroscope, rigid_velocities, stretched_shapes
from springgym.model.bodies.rotations import cross, turned
from springgym.model.scene import Scene, ThrustActuator, WrenchActuator
from springgym.rendering import Arrow, Camera, Look, Marks, Scenery
from springgym.rendering.look import GREEN, ORANGE, RED
from springgym.scenes import film

TORQUE = 20.0  # [N·m]
IMPULSE = 0.8  # largest component a control period [N·s]: 20 N·m at the arm of the head
CLOSE = 0.1  # angle to the target, for success [rad]
CALM = 0.3  # angular velocity across the axis, for success [rad/s]
USUAL = 35.0  # spin [rad/s]
SPIN = Entry("spin", 1, 20.0, about=USUAL)  # [rad/s]
FASTEST = 100.0  # largest initial spin as a reset option [rad/s]


@kernel
def evaluate(m: Measures, s: Situation, out: np.ndarray) -> None:
    for c in range(out.shape[0]):
        angle = angle_between(m.axis[c], s.goal[c])
        spin, across = spinning(m, c)
        aligned = long_tail(angle, 0.5, 0.03) / 4 * thrift(s.action, c)
        out["reward_aligned"][c] = aligned
        out["reward_calm"][c] = 3 * aligned * gaussian(angle, 0.15, 0.03) * gaussian(across, 0.3, 0.1)
        out["angle"][c] = angle
        out["spin"][c] = spin
        out["precession"][c] = across
        out["success"][c] = angle < CLOSE and across < CALM
        out["terminated"][c] = False


@kernel
def observe_features(m: Measures, s: Situation, observation: np.ndarray) -> None:
    for c in range(observation.shape[0]):
        observation[c, 6] = (put_axis(m, c, 1.0, observation[c]) - s.parameters[0]) / s.parameters[1]
        for axis in range(3):
            observation[c, 7 + axis] = s.goal[c, axis]


@kernel
def achieve(m: Measures, s: Situation, achieved: np.ndarray, desired: np.ndarray) -> None:
    for c in range(achieved.shape[0]):
        put_axis(m, c, 1.0, achieved[c])
        for axis in range(3):
            desired[c, axis] = s.goal[c, axis]
            desired[c, 3 + axis] = 0.0


class SpringGyroscope(Task, kernels=(evaluate, observe_features, achieve)):
    """Define the MDP of `SpringGyroscopeEnv`, which describes it."""

    actions: ClassVar = {"torque": 3, "impulse": 3}
    terms = ("aligned", "calm")
    metrics = ("angle", "spin", "precession")
    entries: tuple[Entry, ...] = (Entry("axis", 3), Entry("across", 3), SPIN, Entry("target", 3))
    goal_size = 3
    goal_tolerances = (GoalTolerance("axis", 3, 2 * math.sin(CLOSE / 2)), GoalTolerance("across", 3, CALM))

    def __init__(self, hard: bool = False, body: BodyOptions = None, **modes: Unpack[Modes]) -> None:
        super().__init__(**modes)
        self.hard = flag("hard", hard)
        spin = Entry("spin", 1, USUAL) if self.hard else SPIN  # of either sign, or relative to `USUAL`
        self.entries = tuple(spin if entry is SPIN else entry for entry in self.entries)
        self.parameters = np.array([spin.about, spin.unit])
        self.body = made(gyroscope, body)
        self.checks_starts = body is not None
        self._shape = stretched_shapes(self.body, (0, 0, 1), FASTEST, self.body.parts["centre"])
        self.limits = np.full(3, IMPULSE if self.action == "impulse" else TORQUE)

    def make_scene(self) -> Scene:
        impulse = self.action == "impulse"
        centre = self.body.parts["centre"]
        return Scene(
            self.body,
            velocities=rigid_velocities(self.body.positions, (0, 0, USUAL), self.body.positions[centre[0]]),
            pinned=centre,
            wrench=None if impulse else WrenchActuator(perpendicular=True),
            thrust=ThrustActuator(self.body.parts["head"]) if impulse else None,
        )

    def observed_particles(self) -> ObservedParticles:
        parts = self.body.parts
        reach = np.linalg.norm(self.body.positions, axis=1)
        outwards = np.hypot(self.body.positions[:, 0], self.body.positions[:, 1])
        return ObservedParticles(
            parts["ring"] + parts["head"] + parts["foot"], reach, USUAL * outwards + 2.0 * reach
        )

    def draw(self, rng: np.random.Generator, options: ResetOptions, factors: Factors) -> Drawn:
        axis = direction(rng)
        sideways = rng.uniform(-math.pi, math.pi)
        drawn_spin, drawn_away = uniform(rng, (25.0, 0.5), (45.0, 1.5))
        sign = rng.choice((-1.0, 1.0)) if self.hard else 1.0
        spin = number(options, "spin", sign * drawn_spin, -FASTEST, FASTEST)
        away = number(options, "angle", drawn_away, 0.0, math.pi)
        pose = math.atan2(axis[1], axis[0]), angle_of.py_func(axis[2]), sideways, away
        softer = math.sqrt(factors["masses"] / factors["stiffness"])
        return *axis, *pose, spin, spin * softer, factors["scale"]

    def starts(self, drawn: np.ndarray) -> Start:
        axis = drawn[:, None, :3]
        azimuth, tilt, sideways, away = drawn[:, 3:7].T
        turn = tilted(azimuth, tilt)
        aside = turn @ turned(np.array([0.0, 0.0, 1.0]), sideways) @ turned(np.array([0.0, 1.0, 0.0]), away)
        positions = drawn[:, 9:, None] * self._shape.at(drawn[:, 8].copy()) @ turn.swapaxes(1, 2)
        centre = positions[:, self.body.parts["centre"]]
        return Start(positions, cross(drawn[:, 7:8, None] * axis, positions - centre), aside[:, :, 2])

    def actuate(self, action: np.ndarray) -> dict[str, np.ndarray]:
        if self.action == "impulse":
            return {"thrust": action[:, None] * (IMPULSE / self.period)}
        return {"torque": TORQUE * action}

    def look(self) -> Look:
        head = self.body.particle("head")
        shown = film.look(self.scene, head)
        colors = np.array(shown.ball_colors)
        colors[head] = ORANGE
        return replace(shown, ball_colors=colors)

    def camera(self) -> Camera:
        return Camera.framing((0, 0, 0), 3.0 * float(np.linalg.norm(self.body.positions, axis=1).max()))

    def scenery(self) -> Scenery:
        return Scenery(floor=-1.3 * float(np.linalg.norm(self.body.positions, axis=1).max()))

    def marks(self, m: Measures, s: Situation) -> Marks:
        centre = s.x[self.body.particle("centre")]
        axle = float(np.linalg.norm(self.body.positions[self.body.particle("head")]))
        reach = float(np.linalg.norm(self.body.positions, axis=1).max())
        if self.action == "impulse":
            acting = Arrow(s.x[self.body.particle("head")], 0.6 * axle * s.action)
        else:
            acting = torque_arrow(centre, across(s.action, m.axis), 1.1 * reach)
        angle = math.degrees(angle_of.py_func(m.axis @ s.goal))
        return Marks(
            balls=[(centre + axle * s.goal, 0.16 * axle)],
            arrows=[Arrow(centre + 1.2 * axle * s.goal, 0.5 * axle * s.goal, GREEN), acting],
            key=(
                (GREEN, "target of the axle's orange end"),
                (RED, "impulse on the axle" if self.action == "impulse" else "torque"),
            ),
            text=(f"off target {angle:5.1f}°", f"spin {float(m.angular_velocity @ m.axis):5.1f} rad/s"),
        )


class GyroscopeOptions(EnvOptions, total=False):
    """`SpringGyroscopeEnv` takes these options, see there."""

    action: Literal["torque", "impulse"]
    hard: bool
    body: BodyOptions


class SpringGyroscopeEnv(SpringEnv, gym.Env, task=SpringGyroscope):
    """
    ## Description
    A rotor spins on an axle that is pinned at its centre of mass. Turn the axle to a given direction and hold
    it there. A push towards the target moves the axle perpendicular to the push. The rotor is a ring of 12
    particles, a centre and two axle ends, held together by 50 springs.

    ## Action Space
    Actions are held for a control period of 20 ms.

    | `action` | entries | meaning | at ±1 |
    |---|---|---|---|
    | `"torque"` | 0–2 | torque about the world's x, y, z, minus its component along the axle | ±20 N·m |
    | `"impulse"` | 0–2 | impulse on the axle's head along x, y, z, spread over the period | ±0.8 N·s |

    ## Observation Space
    | `observation` | entries | meaning | scale |
    |---|---|---|---|
    | `"particles"` | 0–41 | positions x, y, z of ring particles 0–11, head, foot | distance from the centre |
    | | 42–83 | their velocities | 35 rad/s × distance from the axle + 2 rad/s × distance |
    | | 84–86 | target direction, a unit vector | 1 |
    | `"features"` | 0–2 | axle n, a unit vector from foot to head | 1 |
    | | 3–5 | angular velocity across the axle, ω⊥ | 1 rad/s |
    | | 6 | spin ω₃ − 35 rad/s; ω₃ if `hard` | 20 rad/s; 35 rad/s |
    | | 7–9 | target direction | 1 |

    ## Rewards
    With the angle α between axle and target and A = L(α; 0.03, 0.5) E / 4, the reward is A [1 + 3
    G(α; 0.03, 0.15) G(|ω⊥|; 0.1, 0.3)] ([G, L, E](../environments.md#shared-definitions)): `reward_aligned` +
    `reward_calm`.

    ## Starting State
    The axle points in any direction. The rotor spins at U(25, 45) rad/s, its springs at their steady-rotation
    equilibrium. The target is U(0.5, 1.5) rad away. `reset(options={"spin": …, "angle": …})` sets the spin
    and the angle between axle and target.

    ## Episode End
    Termination: only by divergence. Truncation: 400 steps, 8 s. `info["is_success"]`: α < 0.1 rad and |ω⊥| <
    0.3 rad/s for the last 50 steps.

    ## Information
    `angle` α [rad], `spin` ω₃ and `precession` |ω⊥| [rad/s].

    ## Arguments
    - `hard=True`: spin of either sign; with the other sign, the same push moves the axle the other way.
    - `body`: arguments of `springgym.model.bodies.gyroscope`.
    - `goals=True`, with `sparse=True`: [goal environment](../features.md#goals). The goal is the axis and the
      angular velocity across it [rad/s].
    """

    if TYPE_CHECKING:

        def __init__(self, **options: Unpack[GyroscopeOptions]) -> None: ...


class SpringGyroscopeVectorEnv(SpringVectorEnv, gym.vector.VectorEnv, task=SpringGyroscope):
    """Run a native batch of `SpringGyroscopeEnv`."""
