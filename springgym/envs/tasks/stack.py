"""SpringStack: push a box with a ball from a shelf onto a block."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import TYPE_CHECKING, ClassVar, Literal, Unpack

import gymnasium as gym
import numpy as np

from springgym.checks import apart
from springgym.core.compiler.decorators import compiled, kernel
from springgym.dynamics.measures import Measures
from springgym.envs.base import SpringEnv, SpringVectorEnv
from springgym.envs.observation import Entry, ObservedParticles, Situation
from springgym.envs.options import Autoreset, EnvOptions, Modes, number
from springgym.envs.randomisation import NOMINAL, weight_of
from springgym.envs.starts import headed, uniform
from springgym.envs.task import Drawn, Factors, ResetOptions, Start, Task, at_rest, level
from springgym.envs.tasks import shove
from springgym.envs.tasks.shove import (
    BOX,
    CORNERS,
    PUSHER,
    Level,
    heading_of,
    nearness,
    rests,
    see_pusher,
    speed_of,
)
from springgym.model.bodies import Body, box, rolling_ball
from springgym.model.scene import Placed, Scene, WrenchActuator
from springgym.model.surfaces import Contact, floor
from springgym.rendering import Arrow, Camera, Look, Marks
from springgym.rendering.look import GREEN, ORANGE, RED, STEEL, TEAL
from springgym.scenes import film
from springgym.theory.contact import rest_height

BLOCK, SHELF = 2, 3
"""Indices of the bodies in the scene; pusher and box are those of SpringShove."""

BLOCKS = CORNERS + 8
"""Index of the first particle of the block; `CORNERS` is that of the box."""

SHELFS = BLOCKS + 8
"""Index of the first particle of the shelf."""

SHELF_SIDES = (1.7, 1.9, 0.15)  # [m]
SMALLEST = 0.7  # least scale of bodies by randomisation: the ball keeps its size
TOP = 0.22  # of the shelf; that of the block lies 5 mm lower [m]
FRICTION = 0.4  # of all contacts
GAPS = (0.08, 0.1)  # between shelf and block [m]
SUNK = 0.1  # height of the middle above the block's, below which box or ball has fallen [m]
HOLD = 12  # steps for which the box must lie on the block
BEST = 0  # column of the memory: the largest nearness so far
HELD = 1  # column of the memory: the number of steps that the box has lain on the block


@compiled
def turned_of(m: Measures, c: int) -> float:
    """Return the angle between box and block, from −π to π [rad]."""
    turned = heading_of(m, c, BOX) - heading_of(m, c, BLOCK)
    return math.atan2(math.sin(turned), math.cos(turned))


@compiled
def distance_of(m: Measures, c: int) -> float:
    """Return the distance of the box from the block, seen from above [m]."""
    box = m.centre[c, BOX]
    block = m.centre[c, BLOCK]
    return math.hypot(box[0] - block[0], box[1] - block[1])


@kernel
def remember(m: Measures, s: Situation, memory: np.ndarray) -> None:
    for c in range(memory.shape[0]):
        distance = distance_of(m, c)
        turned = turned_of(m, c)
        memory[c, BEST] = max(memory[c, BEST], sum(nearness(m, c, 1.0, distance, turned)))
        memory[c, HELD] = memory[c, HELD] + 1.0 if rests(m, c, distance, turned) else 0.0


@kernel
def evaluate(m: Measures, s: Situation, out: np.ndarray) -> None:
    for c in range(out.shape[0]):
        distance = distance_of(m, c)
        turned = turned_of(m, c)
        lowest = min(m.centre[c, BOX, 2], m.centre[c, PUSHER, 2]) - m.centre[c, BLOCK, 2]
        fallen = lowest < SUNK or min(m.axis[c, BOX, 2], m.axis[c, BLOCK, 2]) < 0.7
        met = rests(m, c, distance, turned) and not fallen
        stacked = met and s.memory[c, HELD] + 1.0 >= HOLD
        out["reward_nearer"][c] = 0.2 * max(
            sum(nearness(m, c, 1.0, distance, turned)) - s.memory[c, BEST], 0.0
        )
        out["reward_stacked"][c] = 0.8 if stacked else 0.0
        out["distance"][c], out["heading"][c], out["speed"][c] = distance, turned, speed_of(m, c)
        out["success"][c] = met
        out["terminated"][c] = stacked or fallen  # both end the episode


@kernel
def observe_features(m: Measures, s: Situation, observation: np.ndarray) -> None:
    for c in range(observation.shape[0]):
        heading = heading_of(m, c, BOX)
        turned = turned_of(m, c)
        for axis in range(2):
            observation[c, axis] = (m.centre[c, BOX, axis] - m.centre[c, BLOCK, axis]) / shove.WAY_UNIT
            observation[c, 2 + axis] = m.centre_velocity[c, BOX, axis] / shove.SPEED_UNIT
            observation[c, 13 + axis] = m.centre_velocity[c, PUSHER, axis] / shove.PUSHER_SPEED
            observation[c, 15 + axis] = m.centre[c, PUSHER, axis] / shove.WAY_UNIT
        observation[c, 4] = math.cos(heading)
        observation[c, 5] = math.sin(heading)
        observation[c, 6] = math.cos(turned)
        observation[c, 7] = math.sin(turned)
        observation[c, 8] = m.angular_velocity[c, BOX, 2] / shove.TURNING_UNIT
        see_pusher(m, c, observation, 9)


class SpringStack(Task, kernels=(evaluate, observe_features, remember)):
    """Define the MDP of `SpringStackEnv`, which describes it."""

    actions: ClassVar = {"push": 2}
    terms = ("nearer", "stacked")
    metrics = ("distance", "heading", "speed")
    entries = (
        Entry("way", 2, shove.WAY_UNIT),
        Entry("velocity", 2, shove.SPEED_UNIT),
        Entry("heading", 2),
        Entry("turned", 2),
        Entry("turning", 1, shove.TURNING_UNIT),
        Entry("pusher", 2, shove.NEAR_UNIT),
        Entry("beside", 2, shove.NEAR_UNIT),
        Entry("pusher_velocity", 2, shove.PUSHER_SPEED),
        Entry("pusher_place", 2, shove.WAY_UNIT),
    )
    period = 0.04
    finest = 0.04 / 32
    hold_steps = HOLD
    wins = True
    memory = (0.0, 0.0)
    checks_starts = False
    limits = np.full(2, shove.FORCE)

    def __init__(self, **modes: Unpack[Modes]) -> None:
        super().__init__(**modes)
        self.box: Body = box(shove.SIDES, shove.MASS, stiffness=1.8e4, damping=5.0)
        self.shelf: Body = box(SHELF_SIDES, 8.0, stiffness=1.8e4, damping=5.0)
        self.pusher = rolling_ball(shove.RADIUS, shove.MASS, stiffness=1.8e4, damping=5.0)

    def make_scene(self) -> Scene:
        drawn = self._placed((-0.7, 0.0), 0.0, (-1.1, 0.0), (0.2, 0.0), NOMINAL)
        (started,), *_ = self.starts(np.array([drawn]))
        contact = Contact(friction=FRICTION, restitution=0.3, strength=shove.STRENGTH, reach=shove.REACH)
        return Scene(
            bodies=(
                Placed(self.pusher, started[:CORNERS], wrench=WrenchActuator(), name="pusher"),
                Placed(self.box, started[CORNERS:BLOCKS], name="box"),
                Placed(self.box, started[BLOCKS:SHELFS], name="block"),
                Placed(self.shelf, started[SHELFS:], pinned=tuple(range(8)), name="shelf"),
            ),
            surfaces=(floor(),),
            contact=contact,
            collisions=contact,
        )

    def _placed(
        self, place: Level, heading: float, pusher: Level, block: Level, factors: Factors
    ) -> tuple[float, ...]:
        """Return the arguments of `starts`: the places of pusher, box and block, the height of the shelf, the
        box's heading, and the scale. Pusher and box lie on the shelf, the block on the floor."""
        scale = factors["scale"]
        weight = weight_of(shove.MASS, factors)
        lying = rest_height(weight / 4, shove.STRENGTH, shove.REACH)
        top = scale * TOP
        carried = top + shove.RADIUS + rest_height(weight, shove.STRENGTH, shove.REACH)
        half = scale * shove.SIDES[2] / 2
        return *pusher, carried, *place, top + lying + half, *block, lying + half, top, heading, scale

    def observed_particles(self) -> ObservedParticles:
        upper = (*range(CORNERS, CORNERS + 4), *range(BLOCKS, BLOCKS + 4))
        seen = (0, 1, 3, *upper)  # of the pusher, 3 is opposite to 0
        level = tuple((corner, 2) for corner in upper)
        return ObservedParticles(seen, 0.5, 0.5, skipped=level)

    def draw(self, rng: np.random.Generator, options: ResetOptions, factors: Factors) -> Drawn:
        if (scale := factors["scale"]) < SMALLEST:
            raise ValueError(
                f"randomize allows bodies of scale {apart(scale, SMALLEST)[0]}; it must be at least "
                f"{SMALLEST}, or the ball does not fit"
            )
        low = (-0.9, -0.3, -0.5, 0.35, 2 * math.pi / 3, GAPS[0], -0.3)
        high = (-0.5, 0.3, 0.5, 0.5, 4 * math.pi / 3, GAPS[1], 0.3)
        along, across, heading, separation, bearing, gap, aside = uniform(rng, low, high)
        heading = number(options, "heading", heading, -math.pi, math.pi)
        x = scale * along
        y = scale * across
        separation *= max(1.0, scale)
        pusher = x + separation * math.cos(bearing), y + separation * math.sin(bearing)
        block = gap + scale * shove.SIDES[0] / 2, scale * aside
        return self._placed((x, y), heading, pusher, block, factors)

    def starts(self, drawn: np.ndarray) -> Start:
        pusher, place, block = drawn[:, :9].reshape(-1, 3, 1, 3).swapaxes(0, 1)
        box, shelf = (drawn[:, 11:, None] * body.positions for body in (self.box, self.shelf))
        shelf[:, :, 0] -= shelf[:, :, 0].max(axis=1, keepdims=True)
        shelf[:, :, 2] += drawn[:, 9:10] - shelf[:, :, 2].max(axis=1, keepdims=True)
        moved = place + headed(box, drawn[:, 10])
        return at_rest(np.hstack([pusher + self.pusher.positions, moved, block + box, shelf]))

    def actuate(self, action: np.ndarray) -> dict[str, np.ndarray]:
        return {"pusher.force": shove.FORCE * level(action)}

    def look(self) -> Look:
        shown = film.look(self.scene, colors={"pusher": ORANGE, "block": TEAL})
        colors = np.array(shown.triangle_colors)
        colors[-len(self.shelf.triangles) :] = STEEL
        return replace(shown, triangle_colors=colors)

    def camera(self) -> Camera:
        return Camera.framing((-0.3, 0.0, 0.15), 1.0, azimuth=-1.7, elevation=0.55)

    def framed(self, s: Situation) -> np.ndarray:
        return s.x[:SHELFS]

    def marks(self, m: Measures, s: Situation) -> Marks:
        way = m.centre[BOX] - m.centre[BLOCK]
        corners = s.x[BLOCKS : BLOCKS + 4]
        return Marks(
            lines=[(corners[n], corners[n - 1]) for n in range(4)],
            arrows=[
                Arrow(m.centre[PUSHER] + (0.0, 0.0, 1.2 * shove.RADIUS), np.append(0.3 * s.action, 0.0)),
                Arrow(m.centre[BOX] + 0.14 * m.axis[BOX], 0.15 * m.side[BOX], GREEN),
            ],
            key=((GREEN, "stack this box on the block, aligned"), (RED, "push on the ball")),
            text=(f"off target {100 * math.hypot(way[0], way[1]):3.0f} cm",),
        )


class StackOptions(EnvOptions, total=False):
    """`SpringStackEnv` takes these options, see there."""

    action: Literal["push"]


class SpringStackEnv(SpringEnv, gym.Env, task=SpringStack):
    """
    ## Description
    A box lies on a shelf, and beyond the shelf's edge a block stands on the floor. Push the box over the edge
    with a ball, so that it comes to lie on the block, parallel to it. The ball can only push, and it must not
    fall off. Box and block have 8 corners and 28 springs each. The ball (radius 10 cm) does not stop by
    itself. The fixed shelf lies at x < 0, 22 cm above the floor and 5 mm above the block.

    ## Action Space
    Actions are held for a control period of 40 ms.

    | `action` | entries | meaning | at ±1 |
    |---|---|---|---|
    | `"push"` | 0, 1 | force on the ball's centre along x, y | ±12 N |

    Pushing the box takes 6.5 N: 4.7 N against its friction with the shelf, 1.8 N against its friction with
    the ball.

    ## Observation Space
    | `observation` | entries | meaning | scale |
    |---|---|---|---|
    | `"particles"` | 0–8 | positions of three particles of the ball | 0.5 m |
    | | 9–24 | positions x, y of the upper corners of box and block | 0.5 m |
    | | 25–33 | velocities of the ball's particles | 0.5 m/s |
    | | 34–49 | velocities x, y of the corners | 0.5 m/s |
    | `"features"` | 0, 1 | centre of the box x, y, from the centre of the block | 0.5 m |
    | | 2, 3 | its velocity x, y | 0.5 m/s |
    | | 4, 5 | cosine and sine of its heading | 1 |
    | | 6, 7 | cosine and sine of the angle between box and block | 1 |
    | | 8 | its angular velocity | 2 rad/s |
    | | 9, 10 | ball x, y, from the centre of the box | 0.3 m |
    | | 11, 12 | the same vector, along the box's own axes | 0.3 m |
    | | 13, 14 | velocity x, y of the ball | 1 m/s |
    | | 15, 16 | ball x, y, from the middle of the shelf's edge | 0.5 m |

    ## Rewards
    Seen from above, e is the distance between the centres of box and block, φ the angle between them, and a
    the distance between ball and box. With N = [L(e; 0.03, 0.3) + G(e; 0.03, 0.5)]/2, P = 0.05 G(a; 0.3, 0.5)
    + 0.95 N (1 + G(φ; 0.05, 0.8))/2 is at most 1 ([G, L](../environments.md#shared-definitions)).
    `reward_nearer` is 0.2 times the amount by which P exceeds its previous maximum; `reward_stacked` is 0.8
    on the step that ends the episode successfully. A successful episode therefore returns at least 0.8, any
    other at most 0.2.

    ## Starting State
    Everything is at rest. The middle of the box is U(0.5, 0.9) m from the edge, and U(−0.3, 0.3) m along the
    edge from the edge's middle. The box is rotated by U(−0.5, 0.5) rad. The ball lies U(0.35, 0.5) m behind
    it, within 60° of the direction away from the edge. The block stands U(0.08, 0.1) m from the shelf and
    U(−0.3, 0.3) m from the edge's middle, parallel to the shelf. `reset(options={"heading": …})` sets the
    rotation of the box.

    ## Episode End
    Termination: success; the centre of box or ball is less than 0.1 m above the centre of the block; or box
    or block tips over. Truncation: 300 steps, 12 s. `info["is_success"]`: e < 0.08 m, |φ| < 0.2 rad, and the
    speed of the box, plus 0.2 m times its angular speed, is below 0.1 m/s, for the last 12 steps. Such a box
    rests on the block alone.

    ## Information
    `distance` e [m], `heading` φ [rad], `speed` [m/s], `pairs_…`.

    ## Arguments
    - `randomize`: the factor `scale` does not change the ball.
    """

    if TYPE_CHECKING:

        def __init__(self, **options: Unpack[StackOptions]) -> None: ...


class SpringStackVectorEnv(SpringVectorEnv, gym.vector.VectorEnv, task=SpringStack):
    """Run a native batch of `SpringStackEnv`."""

    if TYPE_CHECKING:

        def __init__(
            self, num_envs: int = 1, *, autoreset_mode: Autoreset = ..., **options: Unpack[StackOptions]
        ) -> None: ...
