"""SpringDetumble: stop a tumbling body in free fall."""

from __future__ import annotations

from typing import TYPE_CHECKING, ClassVar, Literal, Unpack

import gymnasium as gym
import numpy as np

from springgym.checks import chosen, flag
from springgym.core.compiler.decorators import kernel
from springgym.dynamics.measures import Measures
from springgym.envs.arrows import torque_arrow
from springgym.envs.base import SpringEnv, SpringVectorEnv
from springgym.envs.observation import Entry, ObservedParticles, Situation, along
from springgym.envs.options import BodyOptions, EnvOptions, Modes, made, number
from springgym.envs.rewards import gaussian, thrift
from springgym.envs.starts import any_rotation, direction, principal_axes
from springgym.envs.task import Drawn, Factors, ResetOptions, Start, Task
from springgym.model.bodies import Body, box, rigid_velocities
from springgym.model.bodies.rotations import axes, cross
from springgym.model.scene import Scene, ThrustActuator, WrenchActuator
from springgym.rendering import Arrow, Camera, Look, Marks, Scenery
from springgym.rendering.look import RED, TEAL, in_faces

TORQUE = 0.35  # [N·m]
IMPULSE = 0.012  # of a thruster in a control period [N·s]
TURNING_UNIT = 4.0  # unit of angular velocities among the features [rad/s]
SIDES = (1.0, 0.7, 0.4)  # [m]
MASSES = (0.2, 0.1, 0.1, 0.15, 0.1, 0.1, 0.15, 0.1)  # [kg]
THRUSTERS = ((1, (0, 0, 1)), (2, (0, 0, 1)), (4, (0, 1, 0)), (6, (0, 1, 0)))
"""Corners with a thruster, and its direction along the sides of the box; torques are strong in all
directions."""
FASTEST = 12.0  # largest initial angular velocity as a reset option [rad/s]


@kernel
def evaluate(m: Measures, s: Situation, out: np.ndarray) -> None:
    for c in range(out.shape[0]):
        speed = 0.0
        for axis in range(3):
            speed += m.angular_velocity[c, axis] ** 2
        speed **= 0.5
        slow = gaussian(speed, 2.0, 0.05) / 4 * thrift(s.action, c)
        out["reward_slow"][c] = slow
        out["reward_still"][c] = 3 * slow * gaussian(speed, 0.2, 0.05)
        out["angular_speed"][c] = speed
        out["success"][c] = speed < 0.15
        out["terminated"][c] = False


@kernel
def observe_features(m: Measures, s: Situation, observation: np.ndarray) -> None:
    for c in range(observation.shape[0]):
        for axis in range(3):
            turning = along(m.angular_velocity[c], m.side[c], m.axis[c], axis)
            observation[c, axis] = turning / TURNING_UNIT
            observation[c, 3 + axis] = along(m.angular_momentum[c], m.side[c], m.axis[c], axis)


class SpringDetumble(Task, kernels=(evaluate, observe_features)):
    """Define the MDP of `SpringDetumbleEnv`, which describes it."""

    actions: ClassVar = {"torque": 3, "thrusters": len(THRUSTERS)}
    terms = ("slow", "still")
    metrics = ("angular_speed",)
    entries = (Entry("angular_velocity", 3, TURNING_UNIT), Entry("angular_momentum", 3))

    def __init__(
        self,
        start: Literal["tumbling", "flat"] = "tumbling",
        momentum: bool = True,
        body: BodyOptions = None,
        **modes: Unpack[Modes],
    ) -> None:
        super().__init__(**modes)
        self.momentum = flag("momentum", momentum)
        self.flat = chosen("start", start, ("tumbling", "flat")) == "flat"
        self.body: Body = made(box, body, sides=SIDES, mass=MASSES, stiffness=1e5, damping=20.0)
        self.checks_starts = body is not None
        self._shape = self.body.positions - self.body.centre
        self._principal = principal_axes(self.body)
        along = np.array([direction for _, direction in THRUSTERS], float)
        self._thrust = along @ axes(self.body.positions, self.body.markers)
        """directions of the thrusters in the body's triad, (thrusters, 3)"""
        self.limits = np.full(len(THRUSTERS), IMPULSE) if self.action == "thrusters" else np.full(3, TORQUE)

    def make_scene(self) -> Scene:
        thrusters = self.action == "thrusters"
        corners = tuple(corner for corner, _ in THRUSTERS)
        return Scene(
            self.body.with_(positions=self._shape),
            velocities=rigid_velocities(self._shape, 6.0 * self._principal[:, 0], (0.0, 0.0, 0.0)),
            gravity=None,
            wrench=None if thrusters else WrenchActuator(),
            thrust=ThrustActuator(corners, turns=True) if thrusters else None,
        )

    def observed_particles(self) -> ObservedParticles:
        reach = np.linalg.norm(self._shape, axis=1)
        return ObservedParticles(
            tuple(range(8)),
            reach,
            4.0 * reach,
            about="centre",
            appended={"angular_momentum": 0.3} if self.momentum else {},
            turned=True,
        )

    def draw(self, rng: np.random.Generator, options: ResetOptions, factors: Factors) -> Drawn:
        anyhow = direction(rng)
        near = 0.1 * rng.normal(size=3)
        speed = rng.uniform(2.0, 6.0)
        upset = rng.uniform() < 0.5
        turn = any_rotation(rng)
        if self.flat:
            axis = self._principal[:, 2] + near
        else:
            axis = self._principal[:, 1] + near if upset else anyhow
        speed = number(options, "angular_speed", speed, 0.0, FASTEST)
        omega = turn @ (speed / np.linalg.norm(axis) * axis)
        return *turn.ravel().tolist(), *omega.tolist(), factors["scale"]

    def starts(self, drawn: np.ndarray) -> Start:
        turn = drawn[:, :9].reshape(-1, 3, 3)
        omega = drawn[:, None, 9:12]
        positions = drawn[:, 12:, None] * self._shape @ turn.swapaxes(1, 2)
        return Start(positions, cross(omega, positions))

    def actuate(self, action: np.ndarray) -> dict[str, np.ndarray]:
        if self.action == "thrusters":
            return {"thrust": action[:, :, None] * (IMPULSE / self.period * self._thrust)}
        return {"body_torque": TORQUE * action}

    def look(self) -> Look:
        return in_faces(self.body.triangles, self.body.springs, trace=0, trace_length=60)

    def camera(self) -> Camera:
        return Camera.framing((0, 0, 0), 1.6 * float(np.linalg.norm(SIDES)))

    def scenery(self) -> Scenery:
        size = float(np.linalg.norm(SIDES))
        return Scenery(floor=-0.75 * size)

    def marks(self, m: Measures, s: Situation) -> Marks:
        size = float(np.linalg.norm(SIDES))
        triad = np.array([m.side, np.cross(m.axis, m.side), m.axis])
        if self.action == "thrusters":
            pushes = 0.4 * s.action[:, None] * (self._thrust @ triad)
            acting = [Arrow(s.x[corner], push) for (corner, _), push in zip(THRUSTERS, pushes, strict=True)]
        else:
            acting = [torque_arrow(m.centre, s.action @ triad, 0.55 * size)]
        return Marks(
            arrows=[Arrow(m.centre, 0.2 * size * m.angular_velocity, TEAL), *acting],
            text=(f"{float(np.linalg.norm(m.angular_velocity)):4.2f} rad/s",),
            key=((TEAL, "angular velocity: stop it"), (RED, self.action)),
        )


class DetumbleOptions(EnvOptions, total=False):
    """`SpringDetumbleEnv` takes these options, see there."""

    action: Literal["torque", "thrusters"]
    start: Literal["tumbling", "flat"]
    momentum: bool
    body: BodyOptions


class SpringDetumbleEnv(SpringEnv, gym.Env, task=SpringDetumble):
    """
    ## Description
    An uneven box tumbles in free fall, often about the axis of its middle moment of inertia, which makes it
    flip repeatedly. Stop it. A spring joins every pair of its eight particles, whose masses differ.

    ## Action Space
    Actions are held for a control period of 20 ms, in axes that rotate with the body.

    | `action` | entries | meaning | at ±1 |
    |---|---|---|---|
    | `"torque"` | 0–2 | torque about the body's axes | ±0.35 N·m |
    | `"thrusters"` | 0–3 | impulses at corners 1, 2 (along z), 4, 6 (along y) | ±0.012 N·s |

    ## Observation Space
    | `observation` | entries | meaning | scale |
    |---|---|---|---|
    | `"particles"` | 0–23 | positions of the corners, from the centre of mass | distance from it |
    | | 24–47 | their velocities, relative to the centre of mass | 4 rad/s × distance |
    | | 48–50 | angular momentum in the body's axes | 0.3 kg·m²/s |
    | `"features"` | 0–2 | angular velocity in the body's axes | 4 rad/s |
    | | 3–5 | angular momentum in the body's axes | 1 kg·m²/s |

    Angular momentum is a product of positions and velocities, which small networks learn poorly.

    ## Rewards
    With S = G(|ω|; 0.05, 2) E / 4, the reward is S [1 + 3 G(|ω|; 0.05, 0.2)] ([G, L,
    E](../environments.md#shared-definitions)): `reward_slow` + `reward_still`.

    ## Starting State
    The box has a random orientation and rotates at |ω| = U(2, 6) rad/s: in half of the episodes about a
    random axis, in the others within about 0.1 rad of the middle principal axis.
    `reset(options={"angular_speed": …})` sets |ω|.

    ## Episode End
    Termination: only by divergence. Truncation: 400 steps, 8 s. `info["is_success"]`: |ω| < 0.15 rad/s for
    the last 50 steps. The fastest flat spin takes 6.4 s of full torque to stop.

    ## Information
    `angular_speed` |ω| [rad/s].

    ## Arguments
    - `start="flat"`: rotation within about 0.1 rad of the axis of the largest moment, the flat spin that
      dissipation leaves.
    - `momentum=False`: the particles' observation without the angular momentum.
    - `body`: arguments of `springgym.model.bodies.box`.
    """

    if TYPE_CHECKING:

        def __init__(self, **options: Unpack[DetumbleOptions]) -> None: ...


class SpringDetumbleVectorEnv(SpringVectorEnv, gym.vector.VectorEnv, task=SpringDetumble):
    """Run a native batch of `SpringDetumbleEnv`."""
