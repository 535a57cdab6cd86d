"""SpringTower: build a tower of blocks with a crane."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import TYPE_CHECKING, ClassVar, Literal, Unpack

import gymnasium as gym
import numpy as np

from springgym.checks import whole
from springgym.core.compiler.decorators import compiled, kernel
from springgym.dynamics.measures import Measures
from springgym.envs.arrows import torque_arrow
from springgym.envs.base import SpringEnv, SpringVectorEnv
from springgym.envs.observation import Entry, ObservedParticles, Situation
from springgym.envs.options import EnvOptions, Modes
from springgym.envs.randomisation import NOMINAL, weight_of
from springgym.envs.rewards import gaussian, long_tail, thrift
from springgym.envs.starts import headed, uniform
from springgym.envs.task import Drawn, Factors, ResetOptions, Start, Task, at_rest
from springgym.model.bodies import Body, box
from springgym.model.scene import GRAVITY, Placed, Scene, ThrustActuator
from springgym.model.surfaces import Contact, floor
from springgym.rendering import Arrow, Camera, Look, Marks
from springgym.rendering.look import BLUE, GREEN, ORANGE, RED, STEEL, TEAL
from springgym.scenes import film
from springgym.theory.contact import rest_height

SIDES = (0.16, 0.16, 0.24)  # of a block [m]
MASS = 1.0  # of a block [kg]
CORNERS = 8
UPPER = (0, 1, 2, 3)  # the corners by which a block hangs
FORCE = 6.0  # of the crane along each axis, besides `CARRIED` [N]
CARRIED = 0.9  # fraction of a block's weight that the crane always carries
LET_GO = 0.5  # the action above which it lets go
FRICTION = 0.6
REACH = 0.015  # Δ of all contacts [m]
STRENGTH = 0.003  # c of all contacts [N·m²]
AROUND = (0.45, 0.7)  # initial distance of the other blocks from the lowest [m]
ARENA = 2.0  # largest distance of a block from the middle, and height [m]
SUNK = 0.05  # depth below its place at which a block has fallen [m]
UPRIGHT = 0.8  # least cosine of the tilt of a block that has not fallen
HELD = 0.25  # reward of a held block relative to that after it was let go
CLOSE = 0.06  # horizontal distance from the block below, for success [m]
CALM = 0.1  # speed, for success [m/s]
WAY_UNIT = 0.3  # unit of the way among the features [m]
SPEED_UNIT = 0.5  # of the speed [m/s]
TILT_UNIT = 0.2  # of the tilt [1]
TURNING_UNIT = 2.0  # of turning [rad/s]
TOWER_UNIT = 0.5  # of the tower's places [m]


@compiled
def height_of(x: np.ndarray, c: int) -> float:
    """Return the height of the blocks: of the lowest, from a lower corner to the upper one [m]."""
    a = x[c, 0]
    b = x[c, 4]
    return math.sqrt((a[0] - b[0]) ** 2 + (a[1] - b[1]) ** 2 + (a[2] - b[2]) ** 2)


@compiled
def off(m: Measures, s: Situation, c: int, k: int, axis: int) -> float:
    """Return the distance of block k from its target on the block below, along an axis [m]."""
    way = m.centre[c, k, axis] - m.centre[c, k - 1, axis]
    return way - height_of(s.x, c) if axis == 2 else way


@compiled
def fell(m: Measures, s: Situation, c: int, k: int) -> bool:
    """Return whether a released block k is lower than its position in the tower, or leans."""
    wanted = (k + 0.5) * height_of(s.x, c)
    return m.centre[c, k, 2] < wanted - SUNK or m.axis[c, k, 2] < UPRIGHT


@kernel
def move(m: Measures, s: Situation, goal: np.ndarray) -> None:
    """Drop the block that the crane holds and take the next, if the action says so."""
    for c in range(goal.shape[0]):
        if goal[c, 0] < m.centre.shape[1] and s.action[c, 3] > LET_GO:
            goal[c, 0] += 1.0


@kernel
def evaluate(m: Measures, s: Situation, out: np.ndarray) -> None:
    blocks = m.centre.shape[1]
    for c in range(out.shape[0]):
        held = int(s.goal[c, 0])
        carried = 0.0
        built = 0.0
        distance = 0.0
        speed = 0.0
        farthest = 0.0
        failed = False
        for k in range(blocks):
            place = m.centre[c, k]
            velocity = m.centre_velocity[c, k]
            speed = max(speed, math.sqrt(velocity[0] ** 2 + velocity[1] ** 2 + velocity[2] ** 2))
            farthest = max(farthest, math.hypot(place[0], place[1]), place[2])
            failed = failed or (k < held and fell(m, s, c, k))
            if 0 < k <= held:
                aside = math.hypot(off(m, s, c, k, 0), off(m, s, c, k, 1))
                away = math.hypot(aside, off(m, s, c, k, 2))
                near = (long_tail(away, 0.5, 0.03) + gaussian(away, 0.3, 0.03)) / 2
                if k == held:
                    carried = HELD * near * 2.0 ** (k - 1)
                else:
                    built += near * 2.0 ** (k - 1)
                    distance = max(distance, aside)
        share = thrift(s.action, c) / (2.0 ** (blocks - 1) - 1.0)
        out["reward_carried"][c] = share * carried
        out["reward_built"][c] = share * built
        out["held_block"][c] = held
        out["distance"][c] = distance
        out["speed"][c] = speed
        out["success"][c] = held == blocks and distance < CLOSE and speed < CALM
        out["terminated"][c] = failed or farthest > ARENA


@kernel
def observe_features(m: Measures, s: Situation, observation: np.ndarray) -> None:
    blocks = m.centre.shape[1]
    for c in range(observation.shape[0]):
        held = min(int(s.goal[c, 0]), blocks - 1)
        for axis in range(3):
            observation[c, axis] = off(m, s, c, held, axis) / WAY_UNIT
            observation[c, 3 + axis] = m.centre_velocity[c, held, axis] / SPEED_UNIT
            observation[c, 8 + axis] = m.angular_velocity[c, held, axis] / TURNING_UNIT
        observation[c, 11] = s.goal[c, 0] / blocks
        for axis in range(2):
            observation[c, 6 + axis] = m.axis[c, held, axis] / TILT_UNIT
            observation[c, 12 + axis] = m.centre[c, 0, axis] / TOWER_UNIT
            observation[c, 14 + axis] = m.axis[c, 0, axis] / TILT_UNIT
        for k in range(1, blocks):
            first = 16 + 5 * (k - 1)
            for axis in range(3):
                observation[c, first + axis] = off(m, s, c, k, axis) / TOWER_UNIT
            for axis in range(2):
                observation[c, first + 3 + axis] = m.axis[c, k, axis] / TILT_UNIT


class SpringTower(Task, kernels=(evaluate, observe_features, move)):
    """Define the MDP of `SpringTowerEnv`, which describes it."""

    actions: ClassVar = {"crane": 4}
    terms = ("carried", "built")
    metrics = ("held_block", "distance", "speed")
    goal_size = 1
    period = 0.04
    finest = 0.04 / 16
    hold_steps = 25
    checks_starts = False
    limits = np.array([FORCE, FORCE, FORCE, 1.0])

    def __init__(self, blocks: int = 4, **modes: Unpack[Modes]) -> None:
        super().__init__(**modes)
        self.blocks = whole("blocks", blocks, 2, 5)
        self.counts_in_goal = ((0, self.blocks),)
        self.block: Body = box(SIDES, MASS, stiffness=4e3, damping=3.0)
        self.entries = (
            Entry("way", 3, WAY_UNIT),
            Entry("velocity", 3, SPEED_UNIT),
            Entry("axis", 2, TILT_UNIT),
            Entry("turning", 3, TURNING_UNIT),
            Entry("held_block", 1, self.blocks),
            Entry("base", 2, TOWER_UNIT),
            Entry("base_axis", 2, TILT_UNIT),
            *(
                entry
                for k in range(1, self.blocks)
                for entry in (Entry(f"off{k}", 3, TOWER_UNIT), Entry(f"axis{k}", 2, TILT_UNIT))
            ),
        )

    def make_scene(self) -> Scene:
        places = [(0.6 * k, 0.0) for k in range(self.blocks)]
        drawn = np.array([self._placed(places, [0.0] * self.blocks, NOMINAL)])
        started = self.starts(drawn).positions.reshape(self.blocks, CORNERS, 3)
        contact = Contact(friction=FRICTION, restitution=0.3, strength=STRENGTH, reach=REACH)
        return Scene(
            bodies=tuple(
                Placed(self.block, own, thrust=ThrustActuator(UPPER), name=f"block{k}")
                for k, own in enumerate(started)
            ),
            surfaces=(floor(),),
            contact=contact,
            collisions=contact,
        )

    def _placed(
        self, places: list[tuple[float, float]], headings: list[float], factors: Factors
    ) -> list[float]:
        """Return the arguments of `starts` for blocks that stand on the floor: the scale, and place and
        heading of each."""
        height = factors["scale"] * SIDES[2] / 2 + rest_height(weight_of(MASS, factors) / 4, STRENGTH, REACH)
        poses = zip(places, headings, strict=True)
        return [factors["scale"], *(n for place, heading in poses for n in (*place, height, heading))]

    def observed_particles(self) -> ObservedParticles:
        return ObservedParticles(tuple(range(CORNERS * self.blocks)), 0.5, 0.5)

    def draw(self, rng: np.random.Generator, options: ResetOptions, factors: Factors) -> Drawn:
        others = self.blocks - 1
        x, y, first, *drawn = uniform(
            rng,
            [-0.1, -0.1, -math.pi] + [-math.pi] * self.blocks + [AROUND[0], -0.2] * others,
            [0.1, 0.1, math.pi] + [math.pi] * self.blocks + [AROUND[1], 0.2] * others,
        )
        headings = drawn[: self.blocks]
        ways = drawn[self.blocks :]
        places = [(x, y)]
        for k in range(others):
            away = max(1.0, factors["scale"]) * ways[2 * k]
            shift = ways[2 * k + 1]
            bearing = first + 2 * math.pi / others * (k + shift)
            places.append((x + away * math.cos(bearing), y + away * math.sin(bearing)))
        return self._placed(places, headings, factors)

    def starts(self, drawn: np.ndarray) -> Start:
        poses = drawn[:, 1:].reshape(len(drawn), self.blocks, 1, 4)
        placed = headed(drawn[:, :1, None, None] * self.block.positions, poses[:, :, 0, 3]) + poses[..., :3]
        return at_rest(placed.reshape(len(drawn), -1, 3), np.ones((len(drawn), 1)))

    def respond(self, m: Measures, s: Situation) -> dict[str, np.ndarray]:
        """Return the crane's force on the block that it holds, a quarter of it on each upper corner."""
        force = FORCE * s.action[:, :3]
        force[:, 2] -= CARRIED * MASS * GRAVITY[2]
        each = np.repeat(force[:, None] / len(UPPER), len(UPPER), axis=1)
        holds = s.goal[:, 0]
        return {f"block{k}.thrust": each * (holds == k)[:, None, None] for k in range(self.blocks)}

    def look(self) -> Look:
        shown = film.look(self.scene)
        colors = np.array(shown.triangle_colors)
        faces = len(self.block.triangles)
        for k, color in enumerate((STEEL, BLUE, TEAL, BLUE, TEAL)[: self.blocks]):
            colors[k * faces : (k + 1) * faces] = color
        return replace(shown, triangle_colors=colors)

    def camera(self) -> Camera:
        return Camera.framing((0.0, 0.0, 0.25), 1.9, elevation=0.45)

    def marks(self, m: Measures, s: Situation) -> Marks:
        held = int(s.goal[0])
        if held == self.blocks:
            return Marks(text=("all blocks released",))
        hook = s.x[CORNERS * held : CORNERS * held + 4]
        corners = s.x[CORNERS * (held - 1) : CORNERS * held] + SIDES[2] * m.axis[held - 1]
        middle = hook.mean(axis=0)
        opening = np.array([0.0, 0.0, s.action[3]])
        block = s.x[CORNERS * held : CORNERS * (held + 1)]
        upper = [(n, (n + 1) % 4) for n in range(4)]
        lower = [(4 + a, 4 + b) for a, b in upper]
        upright = [(n, 4 + n) for n in range(4)]
        return Marks(
            edges=[(block[a], block[b], ORANGE) for a, b in (*upper, *lower, *upright)],
            lines=[
                *((corners[n], corners[(n + 1) % 4]) for n in range(4)),
                (middle, middle + np.array([0.0, 0.0, 2.0])),
            ],
            rings=[(tuple(corners[:4].mean(axis=0)), CLOSE)],
            arrows=[Arrow(middle, 0.3 * s.action[:3]), torque_arrow(middle, opening, 0.1)],
            key=(
                (ORANGE, "held block"),
                (GREEN, "where its top must be"),
                (RED, "crane force (arc: release)"),
            ),
            text=(f"holds block {held} of {self.blocks - 1}",),
        )


class TowerOptions(EnvOptions, total=False):
    """`SpringTowerEnv` takes these options, see there."""

    action: Literal["crane"]
    blocks: int


class SpringTowerEnv(SpringEnv, gym.Env, task=SpringTower):
    """
    ## Description
    Blocks stand around a base block. Stack them on it, one after another, into a tower. A crane pulls at the
    middle of the upper face of one block, releases it once, and picks up the next. Each block is 16 cm wide
    and 24 cm high, has a mass of 1 kg, and consists of 8 corners and 28 springs. Only friction holds the
    tower together. The crane pulls 12 cm above the centre of mass, so a hanging block swings at 7.5 rad/s,
    and only the crane can damp this motion.

    ## Action Space
    Actions are held for a control period of 40 ms.

    | `action` | entries | meaning | at ±1 |
    |---|---|---|---|
    | `"crane"` | 0–2 | force of the crane along x, y, z, in addition to 0.9 of the block's weight | ±6 N |
    | | 3 | above 0.5, the crane releases the block at the end of the period | 1 |

    After the last block, actions have no effect apart from their cost.

    ## Observation Space
    "The block" is the one held, or the last one when all have been released. Its target position is one block
    height above the centre of the block below.

    | `observation` | entries | meaning | scale |
    |---|---|---|---|
    | `"particles"` | 0–95 | positions of the corners of all blocks, from the lowest to the last | 0.5 m |
    | | 96–191 | their velocities | 0.5 m/s |
    | | 192 | the number of the block, 1 to 3; 4 when all have been released | 1 |
    | `"features"` | 0–2 | centre of the block, from its target | 0.3 m |
    | | 3–5 | its velocity | 0.5 m/s |
    | | 6, 7 | its third axis x, y | 0.2 |
    | | 8–10 | its angular velocity | 2 rad/s |
    | | 11 | its number, 1 to 3; 4 when all have been released | 4 |
    | | 12, 13 | centre of the lowest block x, y | 0.5 m |
    | | 14, 15 | its third axis x, y | 0.2 |
    | | 16–18 | centre of block 1, from its target | 0.5 m |
    | | 19, 20 | its third axis x, y | 0.2 |
    | | 21–23 | centre of block 2, from its target | 0.5 m |
    | | 24, 25 | its third axis x, y | 0.2 |
    | | 26–28 | centre of block 3, from its target | 0.5 m |
    | | 29, 30 | its third axis x, y | 0.2 |

    Each further block adds 48 entries to `"particles"` and 5 to `"features"`. A "4" in the table is the
    number of blocks.

    ## Rewards
    With the distance e of a block from its target and N(e) = [L(e; 0.03, 0.5) + G(e; 0.03, 0.3)]/2, the
    reward is E Σ w N(e) ([G, L, E](../environments.md#shared-definitions)), over the blocks that are held or
    released. Of b blocks above the lowest, block k has the weight w = 2^(k−1)/(2^b − 1), and a quarter of
    this while it is held. `reward_carried` is the term of the held block and `reward_built` the sum of the
    others.

    ## Starting State
    Everything is at rest. The base block is within U(−0.1, 0.1) m of the origin along x and y. The others
    stand U(0.45, 0.7) m from it, evenly around it apart from random shifts of up to a fifth of their spacing.
    The direction of the first block and all headings are drawn uniformly.

    ## Episode End
    Termination: a released block is 5 cm lower than its position in the tower, or leans by more than 37°; or
    a block is more than 2 m from the origin, or more than 2 m high. Truncation: 500 steps, 20 s.
    `info["is_success"]`: all blocks have been released, each is less than 0.06 m off the one below
    horizontally, and none moves faster than 0.1 m/s, for the last 25 steps.

    ## Information
    `held_block`, the number of the held block; `distance`, the largest horizontal distance of a tower block
    from the one below [m]; `speed` of the fastest block [m/s]; `pairs_…`.

    ## Arguments
    - `blocks` (4): the number of blocks, from 2 to 5.
    """

    if TYPE_CHECKING:

        def __init__(self, **options: Unpack[TowerOptions]) -> None: ...


class SpringTowerVectorEnv(SpringVectorEnv, gym.vector.VectorEnv, task=SpringTower):
    """Run a native batch of `SpringTowerEnv`."""
