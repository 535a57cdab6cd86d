"""SpringFreeTop: keep an unpinned top upright and inside a circle on an almost frictionless floor."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, ClassVar, Literal, Unpack

import gymnasium as gym
import numpy as np

from springgym.checks import chosen, flag
from springgym.core.compiler.decorators import kernel
from springgym.dynamics.measures import Measures
from springgym.envs.arrows import torque_arrow
from springgym.envs.base import SpringEnv, SpringVectorEnv
from springgym.envs.observation import Entry, ObservedParticles, Situation
from springgym.envs.options import BodyOptions, EnvOptions, Modes, made, number
from springgym.envs.randomisation import NOMINAL, weight_of
from springgym.envs.rewards import angle_of, gaussian, put_axis, spinning, thrift, tilt_of
from springgym.envs.starts import above_bowl, standing, uniform, varied_top
from springgym.envs.task import Drawn, Factors, ResetOptions, Start, Task
from springgym.model.bodies import Body, rigid_velocities, stretched_shapes, top
from springgym.model.scene import Scene, ThrustActuator, WrenchActuator
from springgym.model.surfaces import Bowl, Contact, floor, scales
from springgym.rendering import Arrow, Camera, Look, Marks
from springgym.rendering.look import GREEN, RED
from springgym.scenes import film
from springgym.theory.contact import rest_height

WANTED = 8.0  # spin [rad/s]
BAND = 4.5  # largest deviation of the spin [rad/s]
FORCE = 40.0  # on the crown [N]
RING_ACCELERATION = 8.0  # angular acceleration of the ring about the axis [rad/s²]
FALLEN = 0.7  # tilt [rad]
SPIN_UNIT = 4.0  # unit of the features, from `WANTED` [rad/s]
WAY_UNIT = 0.5  # the same for distances [m] and speeds [m/s]
ARENA = 1.0  # largest distance from the middle [m]
INSIDE = 0.15  # radius of the circle to stay in [m]
BOWL = 4.0  # radius of the bowl [m]


@kernel
def evaluate(m: Measures, s: Situation, out: np.ndarray) -> None:
    for c in range(out.shape[0]):
        tilt = tilt_of(m, c)
        distance = math.hypot(m.centre[c, 0], m.centre[c, 1])
        spin, _ = spinning(m, c)
        upright = gaussian(tilt, 0.3, 0.03) * thrift(s.action, c)
        inside = gaussian(distance, 0.4, 0.05)
        out["reward_upright"][c] = 0.15 * upright
        out["reward_inside"][c] = 0.35 * upright * inside
        out["reward_spin"][c] = upright * (0.15 + 0.35 * inside) * gaussian(spin - WANTED, 3.0, 0.25)
        out["tilt"][c] = tilt
        out["distance"][c] = distance
        out["spin"][c] = spin
        out["success"][c] = tilt < 0.1 and distance < INSIDE and abs(spin - WANTED) < 1
        out["terminated"][c] = tilt > FALLEN or distance > ARENA or abs(spin - WANTED) > BAND


@kernel
def observe_features(m: Measures, s: Situation, observation: np.ndarray) -> None:
    for c in range(observation.shape[0]):
        spin = put_axis(m, c, 1.0, observation[c])
        observation[c, 6] = (spin - WANTED) / SPIN_UNIT
        for axis in range(2):
            observation[c, 7 + axis] = m.centre[c, axis] / WAY_UNIT
            observation[c, 9 + axis] = m.centre_velocity[c, axis] / WAY_UNIT


class SpringFreeTop(Task, kernels=(evaluate, observe_features)):
    """Define the MDP of `SpringFreeTopEnv`, which describes it."""

    actions: ClassVar = {"push": 3}
    terms = ("upright", "inside", "spin")
    metrics = ("tilt", "distance", "spin")
    entries = (
        Entry("axis", 3),
        Entry("across", 3),
        Entry("spin", 1, SPIN_UNIT, about=WANTED),
        Entry("centre", 2, WAY_UNIT),
        Entry("centre_velocity", 2, WAY_UNIT),
    )
    finest = 1e-3
    damping_every = 2
    hold_steps = 100

    def __init__(
        self,
        surface: Literal["floor", "bowl"] = "floor",
        friction: float = 0.02,
        hard: bool = False,
        body: BodyOptions = None,
        **modes: Unpack[Modes],
    ) -> None:
        super().__init__(**modes)
        self.surface = chosen("surface", surface, ("floor", "bowl"))
        self.contact = Contact(friction=friction, restitution=0.5)
        self.steepest, self.farthest, self.spins = (
            (0.16, 0.6, (4.0, 7.0)) if flag("hard", hard) else (0.12, 0.4, (5.0, 9.0))
        )
        self.body: Body = made(top, body, height=0.5, mass=10.0, damping=30.0)
        self.checks_starts = body is not None
        self.torque = RING_ACCELERATION * float(self.body.inertia()[2, 2])
        self._tip = self.body.particle("tip")
        self._others = np.delete(np.arange(len(self.body.masses)), self._tip)
        self._shape = stretched_shapes(self.body, (0, 0, 1), WANTED + BAND)
        self._strength, self._reach = scales(self.contact, self.body)
        self.limits = np.array([FORCE, FORCE, self.torque])

    def make_scene(self) -> Scene:
        tip = self._tip
        shape = self._shape(WANTED)
        positions = shape - shape[tip] + np.array([0.0, 0.0, self._height(NOMINAL)])
        return Scene(
            self.body,
            positions,
            rigid_velocities(positions, (0, 0, WANTED), positions[tip]),
            wrench=WrenchActuator(),
            thrust=ThrustActuator(self.body.parts["crown"]),
            surfaces=(Bowl((0.0, 0.0, BOWL), BOWL) if self.surface == "bowl" else floor(),),
            contact=self.contact,
        )

    def _height(self, factors: Factors) -> float:
        """Return the height of the tip above the surface when it carries the weight [m]."""
        return rest_height(weight_of(self.body.mass, factors), self._strength, self._reach)

    def observed_particles(self) -> ObservedParticles:
        outwards = np.hypot(self.body.positions[:, 0], self.body.positions[:, 1])
        return ObservedParticles(tuple(range(len(outwards))), 0.5, WANTED * outwards + 0.5)

    def draw(self, rng: np.random.Generator, options: ResetOptions, factors: Factors) -> Drawn:
        low = (0.02, -math.pi, self.spins[0], 0.0, -math.pi)
        high = (self.steepest, math.pi, self.spins[1], 1.0, math.pi)
        tilt, azimuth, spin, share, bearing = uniform(rng, low, high)
        tilt = number(options, "tilt", tilt, 0.0, FALLEN)
        spin = number(options, "spin", spin, WANTED - BAND, WANTED + BAND)
        distance = number(options, "distance", self.farthest * math.sqrt(share), 0.0, ARENA)
        height = self._height(factors)
        return azimuth, tilt, spin, *varied_top(factors), *self._foot(distance, bearing, height), height

    def starts(self, drawn: np.ndarray) -> Start:
        arms, velocities = standing(self._shape, self._tip, drawn[:, :5])
        positions = drawn[:, None, 5:8] + arms
        ground = height = drawn[:, 8:]
        if self.surface == "bowl":
            across = positions[:, self._others, :2]
            ground = BOWL - np.sqrt((BOWL - height) ** 2 - (across**2).sum(axis=2))
        sunk = (ground - positions[:, self._others, 2]).max(axis=1, keepdims=True)
        positions[:, :, 2] += np.maximum(sunk, 0.0)  # raises tops whose rings would be in the surface
        return Start(positions, velocities)

    def _foot(self, away: float, bearing: float, height: float) -> tuple[float, float, float]:
        """Return the position of a tip that is ``height`` above the surface [m]."""
        if self.surface == "bowl":
            away, height = above_bowl(BOWL, away, height)
        return away * math.cos(bearing), away * math.sin(bearing), height

    def actuate(self, action: np.ndarray) -> dict[str, np.ndarray]:
        push = FORCE * action
        twist = self.torque * action
        push[:, 2] = 0.0
        twist[:, :2] = 0.0
        return {"thrust": push[:, None], "body_torque": twist}

    def look(self) -> Look:
        return film.look(self.scene, self._tip)

    def camera(self) -> Camera:
        return Camera.framing((0, 0, 0.25), 1.7, elevation=0.45)

    def marks(self, m: Measures, s: Situation) -> Marks:
        tilt = angle_of.py_func(m.axis[2])
        spin = float(m.angular_velocity @ m.axis)
        push = (0.5 * s.action[0], 0.5 * s.action[1], 0.0)
        radius = float(np.hypot(self.body.positions[:, 0], self.body.positions[:, 1]).max())
        return Marks(
            rings=[((0.0, 0.0, 0.0), INSIDE)],
            arrows=[
                Arrow(s.x[self.body.particle("crown")], push),
                torque_arrow(s.x[self.body.particle("crown")], s.action[2] * m.axis, 1.1 * radius),
            ],
            key=((GREEN, "stay inside this ring"), (RED, "push and torque")),
            text=(
                f"tilt {math.degrees(tilt):4.1f}°",
                f"spin {spin:4.1f} rad/s",
                f"off centre {math.hypot(m.centre[0], m.centre[1]):4.2f} m",
            ),
        )


class FreeTopOptions(EnvOptions, total=False):
    """`SpringFreeTopEnv` takes these options, see there."""

    action: Literal["push"]
    surface: Literal["floor", "bowl"]
    friction: float
    hard: bool
    body: BodyOptions


class SpringFreeTopEnv(SpringEnv, gym.Env, task=SpringFreeTop):
    """
    ## Description
    A spinning top stands with its bare tip on an almost frictionless floor, spinning too slowly to stay up on
    its own. Keep it upright, at 8 rad/s, in a small circle. It has the particles and springs of SpringTop,
    but is low, wide and not pinned. A push on the crown moves the whole top, so the agent has to push the top
    away first to tilt it back.

    ## Action Space
    Actions are held for a control period of 20 ms.

    | `action` | entries | meaning | at ±1 |
    |---|---|---|---|
    | `"push"` | 0, 1 | force on the crown along the world's x, y | ±40 N |
    | | 2 | torque about the top's axis | ±10 N·m, which accelerates the ring by ±8 rad/s² |

    ## Observation Space
    | `observation` | entries | meaning | scale |
    |---|---|---|---|
    | `"particles"` | 0–41 | positions of ring particles 0–11, crown and tip, from the middle | 0.5 m |
    | | 42–83 | their velocities | 8 rad/s × its distance from the axis + 0.5 m/s |
    | `"features"` | 0–2 | axis n of the top, a unit vector | 1 |
    | | 3–5 | angular velocity across the axis, ω⊥ | 1 rad/s |
    | | 6 | spin ω₃ − 8 rad/s | 4 rad/s |
    | | 7, 8 | centre of mass x, y, from the middle | 0.5 m |
    | | 9, 10 | its velocity x, y | 0.5 m/s |

    ## Rewards
    With the tilt θ of the axis, the horizontal distance e of the centre of mass from the middle and U =
    G(θ; 0.03, 0.3) E, the reward is U (0.3 + 0.7 G(e; 0.05, 0.4)) (0.5 + 0.5 G(ω₃ − 8; 0.25, 3)) ([G, L,
    E](../environments.md#shared-definitions)). Its terms are `reward_upright` = 0.15 U, `reward_inside` =
    0.35 U G(e) and `reward_spin`, the rest.

    ## Starting State
    The top stands on its tip, anywhere within 0.4 m of the middle, with a tilt of U(0.02, 0.12) rad and a
    spin of U(5, 9) rad/s. Below 10 rad/s, an upright top is unstable.
    `reset(options={"tilt": …, "spin": …, "distance": …})` sets them.

    ## Episode End
    Termination: θ > 0.7 rad, e > 1 m, or |ω₃ − 8| > 4.5 rad/s (a faster top would stay up on its own).
    Truncation: 500 steps, 10 s. `info["is_success"]`: θ < 0.1 rad, e < 0.15 m and |ω₃ − 8| < 1 rad/s for the
    last 100 steps.

    ## Information
    `tilt` θ [rad], `distance` e [m], `spin` ω₃ [rad/s].

    ## Arguments
    - `surface="bowl"`: a spherical bowl of 4 m radius instead of a floor.
    - `friction=0.1`: more friction than the default 0.02; above about 0.05, the tip sticks and the top has to
      be balanced differently.
    - `hard=True`: tilt U(0.02, 0.16) rad, spin U(4, 7) rad/s, within 0.6 m.
    - `body`: arguments of `springgym.model.bodies.top`.
    """

    if TYPE_CHECKING:

        def __init__(self, **options: Unpack[FreeTopOptions]) -> None: ...


class SpringFreeTopVectorEnv(SpringVectorEnv, gym.vector.VectorEnv, task=SpringFreeTop):
    """Run a native batch of `SpringFreeTopEnv`."""
