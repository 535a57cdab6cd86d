"""SpringDuel: knock an opponent's top over or out of the ring, in a bowl."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING, ClassVar, Literal, Unpack

import gymnasium as gym
import numpy as np

from springgym.checks import apart, chosen, hides, shown
from springgym.core.compiler.decorators import compiled, kernel
from springgym.dynamics.measures import Measures
from springgym.envs import observation as observing
from springgym.envs.base import SpringEnv, SpringVectorEnv
from springgym.envs.observation import BOUND, Entry, ObservedParticles, Situation, values
from springgym.envs.options import EnvOptions, Modes, number
from springgym.envs.randomisation import NOMINAL, weight_of
from springgym.envs.rewards import angle_of, gaussian, thrift
from springgym.envs.starts import above_bowl, standing, uniform, varied_top
from springgym.envs.task import Drawn, Factors, ResetOptions, Start, Task, level
from springgym.model.bodies import Body, stretched_shapes, top
from springgym.model.scene import Placed, Scene, ThrustActuator
from springgym.model.surfaces import Bowl, Contact
from springgym.rendering import Arrow, Camera, Look, Marks
from springgym.rendering.look import AMBER, BLUE, GREEN, INK, IVORY, RED, TEAL, together, two_tone
from springgym.theory.contact import rest_height

FIRST, SECOND = 0, 1
"""Indices of the bodies in the scene, and of the players."""

RING = 12  # number of particles of the ring of each top
RADIUS = 0.5  # of each top [m]
HEIGHT = 0.5  # of each top [m]
MASS = 10.0  # of each top [kg]
STIFFNESS = 2e5  # of its springs [N/m]
BOWL = 4.0  # radius of the bowl [m]
RIM = 1.1  # distance of the centre of mass from the middle at which a top is out [m]
FALLEN = 0.7  # tilt [rad]; at 0.79 it lies on its side
STEEPEST = 0.35  # largest tilt at the start; from 0.37 on, tops that lean to each other touch [rad]
APART = 0.65  # initial distance of each top from the middle [m]
LARGEST = 1.6  # largest scale by randomisation, which also moves tops apart
SPINS = (22.0, 30.0)  # [rad/s], of either sign
FORCE = 40.0  # on the crown [N]
GRIP = 0.02  # friction between both
REBOUND = 0.2  # restitution between both
REACH = 0.02  # Δ of all contacts [m]
STRENGTH = 0.08  # c of all contacts [N·m²]
WAY_UNIT = 0.5  # unit of distances among the features [m]
TILT_UNIT = 0.2  # of the axis [1]
SPIN_UNIT = 25.0  # of spins [rad/s]
MOMENTUM_UNIT = 6.0  # of momenta [kg·m²/s]
SEEN = 11  # number of observed values of each top
SHAPED = 2e-3  # largest reward of a step that does not decide the duel

Opponent = Callable[[np.ndarray], np.ndarray]
"""Maps features (n, D) of the second top to its actions (n, 2)."""


@compiled
def distance_of(m: Measures, c: int, body: int) -> float:
    """Return the distance of a top's centre of mass from the middle [m]."""
    return math.hypot(m.centre[c, body, 0], m.centre[c, body, 1])


@kernel
def evaluate(m: Measures, s: Situation, out: np.ndarray) -> None:
    own = int(s.parameters[0])
    other = 1 - own
    for c in range(out.shape[0]):
        tilt = angle_of(m.axis[c, own, 2])
        distance = distance_of(m, c, own)
        others = distance_of(m, c, other)
        lost = tilt > FALLEN or distance > RIM
        down = angle_of(m.axis[c, other, 2]) > FALLEN or others > RIM
        won = down and not lost
        safe = gaussian(tilt, 0.6, 0.1) * gaussian(distance, 0.8, 0.3) * thrift(s.action, c)
        out["reward_won"][c] = 1.0 - SHAPED if won else 0.0
        out["reward_driven"][c] = SHAPED * safe * min(others / RIM, 1.0)
        out["tilt"][c] = tilt
        out["distance"][c] = distance
        out["other_distance"][c] = others
        out["success"][c] = won
        out["terminated"][c] = lost or down


@kernel
def observe_features(m: Measures, s: Situation, observation: np.ndarray) -> None:
    """Write observations; axes are rotated by 180° for the second player, who sees the same duel."""
    own = int(s.parameters[0])
    sign = 1.0 - 2.0 * own
    for c in range(observation.shape[0]):
        for n in range(2):
            body, k = (own, 0) if n == 0 else (1 - own, SEEN)
            along = m.axis[c, body]
            w = m.angular_velocity[c, body]
            a = sign
            spin = w[0] * along[0] + w[1] * along[1] + w[2] * along[2]
            for axis in range(2):
                place = m.centre[c, body, axis]
                velocity = m.centre_velocity[c, body, axis]
                if n == 1:
                    place -= m.centre[c, own, axis]
                    velocity -= m.centre_velocity[c, own, axis]
                observation[c, k + axis] = a * place / WAY_UNIT
                observation[c, k + 2 + axis] = a * velocity
                observation[c, k + 4 + axis] = a * along[axis] / TILT_UNIT
                observation[c, k + 6 + axis] = a * (w[axis] - spin * along[axis])
                observation[c, k + 9 + axis] = a * m.angular_momentum[c, body, axis] / MOMENTUM_UNIT
            observation[c, k + 8] = spin / SPIN_UNIT


ENTRIES = tuple(
    Entry(f"{whose}{name}", size, unit)
    for whose in ("", "other_")
    for name, size, unit in (
        ("centre", 2, WAY_UNIT),
        ("velocity", 2, 1.0),
        ("axis", 2, TILT_UNIT),
        ("across", 2, 1.0),
        ("spin", 1, SPIN_UNIT),
        ("momentum", 2, MOMENTUM_UNIT),
    )
)
"""Entries of the features; the opponent's centre and velocity are relative to the own top."""


@dataclass(frozen=True)
class Script:
    """Scripted control of a top that attacks the other one and returns to the middle.

    Parameters
    ----------
    attack
        Force towards the other top [N].
    roll
        Force perpendicular to the attack, to the right of a top that spins anticlockwise, so that it rolls
        off the other one [N].
    lead
        Force along the other top's velocity relative to the own top, per speed [kg/s].
    guard
        Force towards the middle, per distance from it [N/m].
    damping
        Force against the own velocity, per speed [kg/s].
    upright
        Force perpendicular to the tilt, at a spin of 25 rad/s and a tilt of 1 rad [N]: the crown moves
        perpendicular to a push, and so back up.
    """

    attack: float = 0.0
    roll: float = 0.0
    lead: float = 0.0
    guard: float = 0.0
    damping: float = 0.0
    upright: float = 0.0

    def __call__(self, observations: np.ndarray) -> np.ndarray:
        seen = values(ENTRIES, observations)
        way = seen["other_centre"]
        spin = seen["spin"]
        near = way / np.sqrt((way * way).sum(axis=1, keepdims=True) + 1e-6)
        force = self.attack * near - self.roll * np.sign(spin) * to_the_left(near)
        force += self.lead * seen["other_velocity"]
        force -= self.guard * seen["centre"] + self.damping * seen["velocity"]
        force += self.upright / SPIN_UNIT * spin * to_the_left(seen["axis"])
        return np.clip(force / FORCE, -1.0, 1.0)


def to_the_left(vectors: np.ndarray) -> np.ndarray:
    """Return z × v of level vectors (n, 2)."""
    return np.stack([-vectors[:, 1], vectors[:, 0]], axis=1)


OPPONENTS: dict[str, Opponent] = {
    "still": Script(),
    "guard": Script(guard=40.0, damping=20.0, upright=125.0),
    "script": Script(attack=20.0, guard=20.0),
    "strong": Script(attack=40.0, roll=20.0, lead=20.0, guard=60.0, damping=16.0, upright=170.0),
}
"""Scripted opponents."""


class SpringDuel(Task, kernels=(evaluate, observe_features)):
    """Define the MDP of `SpringDuelEnv`, which describes it."""

    actions: ClassVar = {"push": 2}
    terms = ("won", "driven")
    metrics = ("tilt", "distance", "other_distance")
    entries = ENTRIES
    finest = 1e-3
    damping_every = 2
    hold_steps = 1
    wins = True
    checks_starts = False
    parameters = np.array([float(FIRST)])
    others = np.array([float(SECOND)])
    """the value of `parameters` with which the functions see the game as the second player"""
    limits = np.full(2, FORCE)

    def __init__(
        self,
        opponent: Literal["still", "guard", "script", "strong"] | Opponent = "script",
        **modes: Unpack[Modes],
    ) -> None:
        super().__init__(**modes)
        if not callable(opponent) or isinstance(opponent, type):
            if not isinstance(opponent, str):
                raise TypeError(f"opponent is {shown(opponent)}; it must be a name or a function")
            opponent = OPPONENTS[chosen("opponent", opponent, OPPONENTS)]
        self.opponent: Opponent = opponent
        self.body: Body = top(RING, RADIUS, HEIGHT, MASS, STIFFNESS, damping=30.0)
        self._shape = stretched_shapes(self.body, (0, 0, 1), SPINS[1])
        self._tip = self.body.particle("tip")

    def make_scene(self) -> Scene:
        contact = Contact(friction=0.02, restitution=0.5, strength=STRENGTH, reach=REACH)
        poses = [self._pose(bearing, 0.0, 0.0, SPINS[0], NOMINAL) for bearing in (math.pi, 0.0)]
        bodies = []
        states = self.starts(np.reshape(poses, (1, -1)))[:2]
        for name, x, v in zip(("first", "second"), *(of.reshape(2, -1, 3) for of in states), strict=True):
            thrust = ThrustActuator(self.body.parts["crown"])
            bodies.append(Placed(self.body, x, v, thrust=thrust, name=name))
        return Scene(
            bodies=tuple(bodies),
            surfaces=(Bowl((0.0, 0.0, BOWL), BOWL),),
            contact=contact,
            collisions=Contact(friction=GRIP, restitution=REBOUND, strength=STRENGTH, reach=REACH),
        )

    def _pose(
        self, bearing: float, tilt: float, azimuth: float, spin: float, factors: Factors
    ) -> tuple[float, ...]:
        """Return azimuth, tilt, spin, `varied_top`, and the place of the tip in the bowl."""
        height = rest_height(weight_of(MASS, factors), STRENGTH, REACH)
        away, height = above_bowl(BOWL, factors["scale"] * APART, height)
        foot = away * math.cos(bearing), away * math.sin(bearing), height
        return azimuth, tilt, spin, *varied_top(factors), *foot

    def observed_particles(self) -> ObservedParticles:
        outwards = np.hypot(self.body.positions[:, 0], self.body.positions[:, 1])
        return ObservedParticles(tuple(range(2 * len(outwards))), 0.7, np.tile(SPINS[1] * outwards + 1.0, 2))

    def draw(self, rng: np.random.Generator, options: ResetOptions, factors: Factors) -> Drawn:
        if (found := factors["scale"]) > LARGEST:
            raise ValueError(
                f"randomize allows tops of scale {apart(found, LARGEST)[0]}; it must be at most {LARGEST}, "
                "or two tops do not fit into the ring"
            )
        bearing = rng.uniform(-math.pi, math.pi)
        low = (0.0, -math.pi, SPINS[0], -1.0)
        high = (0.08, math.pi, SPINS[1], 1.0)
        drawn: list[float] = []
        for n, whose in enumerate(("", "other_")):
            tilt, azimuth, spin, sense = uniform(rng, low, high)
            tilt = number(options, f"{whose}tilt", tilt, 0.0, STEEPEST)
            spin = number(options, f"{whose}spin", math.copysign(spin, sense), -SPINS[1], SPINS[1])
            drawn += self._pose(bearing + n * math.pi, tilt, azimuth, spin, factors)
        return drawn

    def starts(self, drawn: np.ndarray) -> Start:
        poses = drawn.reshape(2 * len(drawn), -1)
        arms, v = standing(self._shape, self._tip, poses[:, :5])
        x = poses[:, None, 5:] + arms
        return Start(x.reshape(len(drawn), -1, 3), v.reshape(len(drawn), -1, 3))

    def actuate(self, action: np.ndarray) -> dict[str, np.ndarray]:
        return {"first.thrust": FORCE * level(action)[:, None]}

    def seen_by_second(self, m: Measures, s: Situation) -> np.ndarray:
        """Return the second player's features (n, D)."""
        seen = np.empty((len(s.x), sum(entry.size for entry in ENTRIES)), np.float32)
        observe_features(m, s._replace(parameters=self.others), seen)
        return np.clip(np.nan_to_num(seen), -BOUND, BOUND)

    def particles_of_second(self, rows: np.ndarray, s: Situation) -> np.ndarray:
        """Return the second player's observations of particles (n, D)."""
        half = np.array([-1.0, -1.0, 1.0])
        count = len(self.body.masses)
        turned = s._replace(x=half * np.roll(s.x, count, axis=1), v=half * np.roll(s.v, count, axis=1))
        seen = np.empty((len(rows), self.observation_size), np.float32)
        lost = ~np.isfinite(rows).all(axis=1)
        observing.observe_particles(rows, turned, observing.columns(self.particles), lost, seen)
        return seen

    def respond(self, m: Measures, s: Situation) -> dict[str, np.ndarray]:
        seen = self.seen_by_second(m, s)
        given = self.opponent(seen)
        try:
            action = np.array(math.nan) if hides(given) else np.asarray(given, np.float64)
        except (TypeError, ValueError):
            action = np.array(math.nan)
        if action.shape != (len(seen), 2) or not np.isfinite(action).all():
            raise ValueError(
                f"the opponent gave {shown(given)}; it must give finite actions of shape {(len(seen), 2)}"
            )
        push = -FORCE * np.clip(action, -1.0, 1.0)  # in axes turned by half a turn
        return {"second.thrust": level(push)[:, None]}

    def look(self) -> Look:
        count = len(self.body.masses)
        radii = np.zeros(count)
        radii[[self.body.particle("crown"), self._tip]] = 0.02
        looks = [
            Look(
                triangles=self.body.triangles,
                triangle_colors=np.tile(two_tone(RING, colors=colors, odd=odd), (2, 1)),
                springs=self.body.springs,
                radii=radii,
            )
            for colors, odd in (((BLUE, IVORY), TEAL), ((AMBER, IVORY), INK))
        ]
        return together(looks, [count, count])

    def camera(self) -> Camera:
        return Camera.framing((0, 0, 0.25), 3.0, elevation=0.6)

    def marks(self, m: Measures, s: Situation) -> Marks:
        crown = s.x[self.body.particle("crown")]
        rim = (0.0, 0.0, BOWL - math.sqrt(BOWL**2 - RIM**2))
        away = np.hypot(m.centre[:, 0], m.centre[:, 1])
        return Marks(
            rings=[(rim, RIM)],
            arrows=[Arrow(crown, (0.5 * s.action[0], 0.5 * s.action[1], 0.0))],
            key=(
                (BLUE, "agent's top"),
                (RED, "its push"),
                (AMBER, "opponent's top"),
                (GREEN, "ring: leaving it or falling loses"),
            ),
            text=(f"agent {away[0]:4.2f} m, opponent {away[1]:4.2f} m from the centre",),
        )


class DuelOptions(EnvOptions, total=False):
    """`SpringDuelEnv` takes these options, see there."""

    action: Literal["push"]
    opponent: Literal["still", "guard", "script", "strong"] | Opponent


class SpringDuelEnv(SpringEnv, gym.Env, task=SpringDuel):
    """
    ## Description
    Two spinning tops stand in a bowl, within a ring. Knock the opponent's top over or out of the ring, and
    keep your own up and inside. The agent pushes its own top at the crown, and the opponent does the same.
    Each top (14 particles, 37 springs) spins fast enough to stay up on its own. When the rims of the tops
    collide, the tops exchange spin.

    ## Action Space
    Actions are held for a control period of 20 ms.

    | `action` | entries | meaning | at ±1 |
    |---|---|---|---|
    | `"push"` | 0, 1 | force on the crown of the own top along x, y | ±40 N |

    No action drives the spin.

    ## Observation Space
    | `observation` | entries | meaning | scale |
    |---|---|---|---|
    | `"particles"` | 0–83 | positions of ring particles 0–11, crown and tip, own top first | 0.7 m |
    | | 84–167 | their velocities | 30 rad/s × its distance from the axis + 1 m/s |
    | `"features"` | 0, 1 | centre of mass x, y of the own top, from the middle | 0.5 m |
    | | 2, 3 | its velocity x, y | 1 m/s |
    | | 4, 5 | its axis x, y | 0.2 |
    | | 6, 7 | its angular velocity across the axis, x, y | 1 rad/s |
    | | 8 | its spin | 25 rad/s |
    | | 9, 10 | its angular momentum x, y | 6 kg·m²/s |
    | | 11, 12 | centre of mass x, y of the opponent's top, from the own top's | 0.5 m |
    | | 13, 14 | its velocity x, y, relative to the own top | 1 m/s |
    | | 15, 16 | its axis x, y | 0.2 |
    | | 17, 18 | its angular velocity across the axis, x, y | 1 rad/s |
    | | 19 | its spin | 25 rad/s |
    | | 20, 21 | its angular momentum x, y | 6 kg·m²/s |

    ## Rewards
    With the tilt θ of the own top, its distance a from the middle and the opponent's distance b ≤ 1.1 m,
    every step earns 0.002 G(θ; 0.1, 0.6) G(a; 0.3, 0.8) E b/1.1 m ([G, L,
    E](../environments.md#shared-definitions)), and the winning step earns an additional 0.998. Waiting
    therefore pays less than winning. The terms are `reward_driven` and `reward_won`.

    ## Starting State
    The tops stand 0.65 m from the middle on opposite sides, in a random direction. They are tilted by U(0,
    0.08) rad and spin at U(22, 30) rad/s, each of either sign. Below 10 rad/s, a top does not stay up on its
    own. `reset(options={"tilt": …, "spin": …, "other_tilt": …, "other_spin": …})` sets them.

    ## Episode End
    Termination: a top is down, because it is tilted by more than 0.7 rad, or its centre of mass is more than
    1.1 m from the middle. If both go down in the same step, both lose. Truncation: 500 steps, 10 s.
    `info["is_success"]`: the opponent's top is down, and the own top is not.

    ## Information
    `tilt` θ [rad], `distance` a [m], `other_distance` b [m], `pairs_…`.

    ## Arguments
    - `opponent="still"`: does nothing, while the default `"script"` attacks with 20 N and returns to the
      middle with 20 N/m.
    - `opponent="guard"`: returns to the middle, and keeps itself upright.
    - `opponent="strong"`: attacks at full force, on the side on which its top rolls off the other one, keeps
      itself upright and stays near the middle, like the classical controller.
    - `opponent` can also be a function of observations as `"features"` (n, 22) that returns actions (n, 2).
      Its axes are rotated by 180°, so that both players see the same duel. Agents trained with
      `observation="features"` are such functions, see `springgym.envs.agent`.

    `springgym.envs.parallel("SpringDuel-v0")`, or `pettingzoo.make("parallel", "SpringDuel-v0")` where
    `pettingzoo` has a registry, is the same duel for two agents, as a PettingZoo `ParallelEnv`. Import
    `pettingzoo` before `springgym`, or call `springgym.register()` afterwards.
    """

    if TYPE_CHECKING:

        def __init__(self, **options: Unpack[DuelOptions]) -> None: ...


class SpringDuelVectorEnv(SpringVectorEnv, gym.vector.VectorEnv, task=SpringDuel):
    """Run a native batch of `SpringDuelEnv`."""
