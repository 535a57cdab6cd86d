"""SpringLabyrinth: roll a ball along a path past holes by tilting its board."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from functools import cache
from itertools import product
from typing import TYPE_CHECKING, ClassVar, Literal, Unpack

import gymnasium as gym
import numpy as np

from springgym.checks import flag
from springgym.core.compiler.decorators import compiled, kernel
from springgym.dynamics.measures import Measures
from springgym.envs.base import SpringEnv, SpringVectorEnv
from springgym.envs.observation import Entry, ObservedParticles, Situation
from springgym.envs.options import EnvOptions, Modes
from springgym.envs.randomisation import NOMINAL, weight_of
from springgym.envs.rewards import gaussian, thrift
from springgym.envs.task import Drawn, Factors, ResetOptions, Start, Task, at_rest
from springgym.model.bodies import Body, rolling_ball
from springgym.model.scene import Scene, WrenchActuator
from springgym.model.surfaces import Contact, floor
from springgym.rendering import Arrow, Camera, Look, Marks, Scenery
from springgym.rendering.look import GREEN, INK, RED, Color, together
from springgym.scenes import film
from springgym.theory.contact import rest_height

PERIOD = 0.02  # [s]
HALF = 0.36  # half of a side of the board [m]
RADIUS = 0.025  # of the ball [m]
MASS = 0.15  # of the ball [kg]
HOLE = 0.055  # radius of a hole: a ball falls with its centre above [m]
WIDE_HOLE = 0.06  # with hard=True [m]
REACH = 5e-4  # Δ of the contact [m]
STRENGTH = 2e-7  # c of the contact [N·m²]
TILT = 0.15  # the largest angle of the board [rad]
RATE = 0.4  # how fast it changes [rad/s]
SLOW_RATE = 0.24  # with hard=True [rad/s]
CELLS = 4  # along a side of the board
LEGS = 12  # of the way, from the middle of a cell to that of the next
MIDDLES = (0.5 / CELLS - 0.5) * 2 * HALF + 2 * HALF / CELLS * np.array([*product(range(CELLS), repeat=2)])
"""Centres of the cells (CELLS², 2), before they are shifted [m]."""
SHIFT = 0.015  # largest shift of a cell's centre along x and y [m]
LATEST = 0.6  # largest fraction of the first leg that is left out
HOLES = 18
CLOSE = 0.05  # distance at which a point of the path counts as passed [m]
SEEN = 4  # number of observed points, from the last one passed
NEAR = 4  # number of observed holes, the nearest ones
WAY_UNIT = 0.2  # unit of distances among the features [m]
SPEED_UNIT = 0.3  # of the speed [m/s]
TURNING_UNIT = 12.0  # of the angular velocity [rad/s]
TILT_UNIT = 0.1  # of the tilt [rad]
HOLE_UNIT = 0.1  # of the distance of holes [m]
LEFT_UNIT = 1.0  # of the remaining path length [m]

FIRST_HOLE = 2 * (LEGS + 1)
"""First column of the goal with the holes. The points of the path come before them; the ball starts at the
first."""

LEANING = FIRST_HOLE + 2 * HOLES
"""First column of the goal with the board's angles."""

PASSED = LEANING + 2
"""Column of the goal with the number of completed legs."""

WOOD: Color = (226, 202, 160)
LINE: Color = (160, 124, 78)


@compiled
def angle_after(s: Situation, c: int, axis: int, seconds: float) -> float:
    """Return the board's tilt towards an axis after the action has changed it for some seconds [rad]."""
    angle = s.goal[c, LEANING + axis] + s.parameters[0] * s.action[c, axis] * seconds
    return min(max(angle, -TILT), TILT)


@compiled
def leg(s: Situation, c: int, n: int) -> float:
    """Return the length of leg n of the path [m]."""
    g = s.goal[c]
    return math.hypot(g[2 * n + 2] - g[2 * n], g[2 * n + 3] - g[2 * n + 1])


@compiled
def way_to(m: Measures, s: Situation, c: int, first: int) -> float:
    """Return the distance of the ball from the point at column ``first`` of the goal [m]."""
    return math.hypot(m.centre[c, 0] - s.goal[c, first], m.centre[c, 1] - s.goal[c, first + 1])


@compiled
def way_left(m: Measures, s: Situation, c: int) -> float:
    """Return the length of the path from the ball through all points ahead [m]."""
    done = int(s.goal[c, PASSED])
    left = way_to(m, s, c, 2 * done + 2)
    for n in range(done + 1, LEGS):
        left += leg(s, c, n)
    return left


@kernel
def move(m: Measures, s: Situation, goal: np.ndarray) -> None:
    """Tilt the board, and count a point of the path as passed when the ball comes close to it."""
    for c in range(goal.shape[0]):
        for axis in range(2):
            goal[c, LEANING + axis] = angle_after(s, c, axis, PERIOD)
        done = int(goal[c, PASSED])
        if done < LEGS - 1 and way_to(m, s, c, 2 * done + 2) < CLOSE:
            goal[c, PASSED] += 1.0


@kernel
def evaluate(m: Measures, s: Situation, out: np.ndarray) -> None:
    for c in range(out.shape[0]):
        whole = 0.0
        clearance = math.inf
        for n in range(LEGS):
            whole += leg(s, c, n)
        for n in range(HOLES):
            clearance = min(clearance, way_to(m, s, c, FIRST_HOLE + 2 * n) - s.parameters[1])
        left = way_left(m, s, c)
        progress = min(max(1.0 - left / whole, 0.0), 1.0)
        last = s.goal[c, PASSED] == LEGS - 1
        distance = way_to(m, s, c, 2 * LEGS)
        effort = thrift(s.action, c)
        out["reward_progress"][c] = 0.5 * effort * progress
        out["reward_end"][c] = 0.5 * effort * gaussian(distance, 0.2, 0.02) if last else 0.0
        out["remaining_length"][c] = left
        out["clearance"][c] = clearance
        out["tilt"][c] = math.acos(math.cos(s.goal[c, LEANING]) * math.cos(s.goal[c, LEANING + 1]))
        out["success"][c] = last and distance < CLOSE
        out["terminated"][c] = clearance < 0.0 or max(abs(m.centre[c, 0]), abs(m.centre[c, 1])) > HALF


@kernel
def observe_features(m: Measures, s: Situation, observation: np.ndarray) -> None:
    for c in range(observation.shape[0]):
        done = int(s.goal[c, PASSED])
        holes = 8 + 2 * SEEN + 1
        for axis in range(2):
            place = m.centre[c, axis]
            observation[c, axis] = place / WAY_UNIT
            observation[c, 2 + axis] = m.centre_velocity[c, axis] / SPEED_UNIT
            observation[c, 4 + axis] = m.angular_velocity[c, axis] / TURNING_UNIT
            observation[c, 6 + axis] = s.goal[c, LEANING + axis] / TILT_UNIT
            for n in range(SEEN):
                point = 2 * min(done + n, LEGS)
                observation[c, 8 + 2 * n + axis] = (s.goal[c, point + axis] - place) / WAY_UNIT
        observation[c, holes - 1] = way_left(m, s, c) / LEFT_UNIT
        least = -1.0
        for k in range(NEAR):  # the nearest that is farther than the one before
            nearest = math.inf
            first = FIRST_HOLE
            for n in range(HOLES):
                away = way_to(m, s, c, FIRST_HOLE + 2 * n)
                if least < away < nearest:
                    nearest = away
                    first = FIRST_HOLE + 2 * n
            least = nearest
            for axis in range(2):
                way = s.goal[c, first + axis] - m.centre[c, axis]
                observation[c, holes + 2 * k + axis] = way / HOLE_UNIT


@cache
def ways() -> np.ndarray:
    """Return all paths of `LEGS` steps between cells that visit no cell twice, (paths, LEGS + 1, 2)."""

    def longer(way: list[tuple[int, int]]) -> Iterator[list[tuple[int, int]]]:
        if len(way) > LEGS:
            yield way
            return
        x, y = way[-1]
        for cell in ((x + 1, y), (x, y + 1), (x - 1, y), (x, y - 1)):
            if max(cell) < CELLS and min(cell) >= 0 and cell not in way:
                yield from longer([*way, cell])

    return np.array([way for cell in product(range(CELLS), range(CELLS)) for way in longer([cell])])


def beside(middles: np.ndarray, way: np.ndarray, points: np.ndarray) -> np.ndarray:
    """Return the holes (k, HOLES, 2) of boards [m]: the points between cells that are nearest to the path.

    Places are half-way between two neighbours that the path does not join, or between four. For cells shifted
    by up to `SHIFT`, they are at least 6 cm from the path.

    Parameters
    ----------
    middles : (k, CELLS², 2)
        Of the cells [m].
    way : (k, LEGS + 1, 2)
        The cells of the way.
    points : (k, LEGS + 1, 2)
        Their centres [m].
    """
    boards = np.arange(len(way))[:, None]
    corners, counts, number = _between()
    halves = way[:, 1:] + way[:, :-1]
    found = np.hstack([middles, np.zeros((len(way), 1, 2))])[:, corners].sum(axis=2) / counts
    legs = np.diff(points, axis=1)[:, None]
    arms = found[:, :, None] - points[:, None, :-1]
    (u, v), (x, y) = ((of[..., 0], of[..., 1]) for of in (legs, arms))
    share = np.clip((x * u + y * v) / (u * u + v * v), 0.0, 1.0)
    away = (np.square(x - share * u) + np.square(y - share * v)).min(axis=2)
    away[boards, number[halves[:, :, 0], halves[:, :, 1]]] = math.inf
    return found[boards, np.argsort(away, kind="stable")[:, :HOLES]]


@cache
def _between() -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return the cells (places, 4) around each place half-way between two or four cells, `CELLS`² for none,
    how many they are (places, 1), and the numbers of the places by twice their row and column.
    """
    corners: list[list[int]] = []
    number = np.zeros((2 * CELLS, 2 * CELLS), int)
    for (i, j), (a, b) in product(product(range(CELLS), repeat=2), ((1, 0), (0, 1), (1, 1))):
        if i + a < CELLS and j + b < CELLS:
            number[2 * i + a, 2 * j + b] = len(corners)
            own = [CELLS * p + q for p in range(i, i + a + 1) for q in range(j, j + b + 1)]
            corners.append(own + [CELLS**2] * (4 - len(own)))
    return np.array(corners), np.sum(np.array(corners) < CELLS**2, axis=1, keepdims=True), number


def board_axes(angles: np.ndarray) -> np.ndarray:
    """Return the rotation (3, 3) of a board that leans towards x and y by angles (2,) [rad]."""
    a, b = np.cos(angles)
    p, q = np.sin(angles)
    return np.array([[a, 0.0, p], [-p * q, b, a * q], [-p * b, -q, a * b]])


class SpringLabyrinth(Task, kernels=(evaluate, observe_features, move)):
    """Define the MDP of `SpringLabyrinthEnv`, which describes it."""

    actions: ClassVar = {"tilt": 2}
    terms = ("progress", "end")
    metrics = ("remaining_length", "clearance", "tilt")
    entries = (
        Entry("place", 2, WAY_UNIT),
        Entry("velocity", 2, SPEED_UNIT),
        Entry("turning", 2, TURNING_UNIT),
        Entry("tilt", 2, TILT_UNIT),
        Entry("way", 2 * SEEN, WAY_UNIT),
        Entry("remaining_length", 1, LEFT_UNIT),
        Entry("holes", 2 * NEAR, HOLE_UNIT),
    )
    goal_size = PASSED + 1
    counts_in_goal = ((PASSED, LEGS - 1),)
    hold_steps = 25
    checks_starts = False

    def __init__(self, hard: bool = False, **modes: Unpack[Modes]) -> None:
        super().__init__(**modes)
        self.rate, self.hole = (SLOW_RATE, WIDE_HOLE) if flag("hard", hard) else (RATE, HOLE)
        self.ball: Body = rolling_ball(RADIUS, MASS, stiffness=3e4, damping=3.0)
        self.parameters = np.array([self.rate, self.hole])
        self.limits = np.full(2, self.rate)

    def make_scene(self) -> Scene:
        return Scene(
            self.ball,
            np.add(self.ball.positions, (0.0, 0.0, self._height(NOMINAL))),
            wrench=WrenchActuator(),
            surfaces=(floor(),),
            contact=Contact(friction=0.5, restitution=0.3, strength=STRENGTH, reach=REACH),
        )

    def _height(self, factors: Factors) -> float:
        """Return the height of the centre of a ball that lies on a level board [m]."""
        return factors["scale"] * RADIUS + rest_height(weight_of(MASS, factors), STRENGTH, REACH)

    def observed_particles(self) -> ObservedParticles:
        return ObservedParticles(tuple(range(len(self.ball.masses))), WAY_UNIT, SPEED_UNIT)

    def draw(self, rng: np.random.Generator, options: ResetOptions, factors: Factors) -> Drawn:
        way = rng.integers(len(ways()))
        return *rng.random(1 + 2 * CELLS**2).tolist(), way, self._height(factors), factors["scale"]

    def starts(self, drawn: np.ndarray) -> Start:
        way = ways()[drawn[:, -3].astype(int)]
        boards = np.arange(len(drawn))[:, None]
        middles = MIDDLES + (-SHIFT + 2 * SHIFT * drawn[:, 1:-3].reshape(-1, CELLS**2, 2))
        points = middles[boards, CELLS * way[:, :, 0] + way[:, :, 1]]
        holes = beside(middles, way, points)
        points[:, 0] += LATEST * drawn[:, :1] * (points[:, 1] - points[:, 0])
        goal = np.zeros((len(drawn), self.goal_size))
        goal[:, :LEANING] = np.hstack([points, holes]).reshape(len(drawn), -1)
        place = np.hstack([points[:, 0], drawn[:, -2:-1]])[:, None]
        return at_rest(drawn[:, -1:, None] * self.ball.positions + place, goal)

    def respond(self, m: Measures, s: Situation) -> dict[str, np.ndarray]:
        """Return the weight along the board, which leans as in the middle of the period.

        The scene's gravity acts across the board. The weight is the potential energy over the height.
        """
        angles = s.goal[:, LEANING : LEANING + 2] + 0.5 * PERIOD * self.rate * s.action
        (a, b), (p, q) = (f(np.clip(angles, -TILT, TILT)).T for f in (np.cos, np.sin))
        weight = np.nan_to_num(m.gravity / np.maximum(m.centre[:, 2], 0.5 * RADIUS))
        return {"force": weight[:, None] * np.stack([p * b, q, 1.0 - a * b], axis=1)}

    def look(self) -> Look:
        board = _board(np.zeros(self.goal_size), self.hole)
        return together([film.look(self.scene), _board_look()], [len(self.ball.masses), len(board)])

    def points(self, s: Situation) -> np.ndarray:
        """Return the points of ball and board in the frame of the room, where the board is tilted."""
        turn = board_axes(s.goal[LEANING : LEANING + 2])
        return np.asarray(np.vstack([s.x, _board(s.goal, self.hole)]) @ turn.T)

    def camera(self) -> Camera:
        return Camera.framing((0.02, 0, -0.03), 1.12, elevation=0.85)

    def scenery(self) -> Scenery:
        return Scenery(floor=-0.15)

    def marks(self, m: Measures, s: Situation) -> Marks:
        turn = board_axes(s.goal[LEANING : LEANING + 2])
        end = turn @ np.append(s.goal[2 * LEGS : 2 * LEGS + 2], RADIUS)
        done = int(s.goal[PASSED])
        return Marks(
            balls=[(end, RADIUS)],
            lines=[((0.0, 0.0, -0.15), (0.0, 0.0, -THICK))],
            arrows=[Arrow(HANDLE, np.append(0.12 * s.action, 0.0))],
            key=((GREEN, "target: end of the line"), (RED, "board tilt command")),
            text=(f"{done} of {LEGS} segments",),
        )


# --- The board, as it is drawn --------------------------------------------------------------------------

THICK = 0.02  # of the board [m]
LIFT = 5e-4  # of drawings on it [m]
BROAD = 0.004  # half-width of the line [m]
CORNERS = 24  # of a hole
HANDLE = (0.47, 0.0, 0.0)  # position of the arrow of the action, beside the board [m]


def _board(goal: np.ndarray, hole: float) -> np.ndarray:
    """Return the points of the board, of the line along the path, and of holes of radius ``hole`` [m]."""
    slab = np.array(list(product((-HALF, HALF), (-HALF, HALF), (-THICK, 0.0))))
    way = goal[:FIRST_HOLE].reshape(-1, 2)
    along = np.diff(way, axis=0)
    along = along / np.maximum(np.linalg.norm(along, axis=1, keepdims=True), 1e-9)
    left = BROAD * np.column_stack([-along[:, 1], along[:, 0]])
    ahead = BROAD * along
    line = np.stack(
        [way[:-1] - ahead - left, way[1:] + ahead - left, way[1:] + ahead + left, way[:-1] - ahead + left],
        axis=1,
    ).reshape(-1, 2)
    angle = 2 * np.pi * np.arange(CORNERS) / CORNERS
    rim = hole * np.column_stack([np.cos(angle), np.sin(angle)])
    holes = goal[FIRST_HOLE:LEANING].reshape(-1, 1, 2) + rim
    flat = np.vstack([line, holes.reshape(-1, 2)])
    return np.vstack([slab, np.column_stack([flat, np.full(len(flat), LIFT)])])


def _board_look() -> Look:
    """Return the `Look` of what `_board` returns."""
    faces: list[Sequence[int]] = [
        (0, 2, 6, 4),
        (1, 5, 7, 3),
        (0, 4, 5, 1),
        (2, 3, 7, 6),
        (0, 1, 3, 2),
        (4, 6, 7, 5),
    ]
    faces += [range(8 + 4 * n, 12 + 4 * n) for n in range(LEGS)]
    first = 8 + 4 * LEGS
    faces += [range(first + n, first + n + CORNERS) for n in range(0, HOLES * CORNERS, CORNERS)]
    colors = [WOOD] * 6 + [LINE] * LEGS + [INK] * HOLES
    fans = [[(face[0], face[n], face[n + 1]) for n in range(1, len(face) - 1)] for face in faces]
    return Look(
        triangles=np.concatenate(fans), triangle_colors=np.repeat(colors, [len(fan) for fan in fans], axis=0)
    )


class LabyrinthOptions(EnvOptions, total=False):
    """`SpringLabyrinthEnv` takes these options, see there."""

    action: Literal["tilt"]
    hard: bool


class SpringLabyrinthEnv(SpringEnv, gym.Env, task=SpringLabyrinth):
    """
    ## Description
    Tilt a board to roll a ball through a maze of holes, as in the game. Bring the ball to the end of a path,
    past the holes beside it. Every episode has a different board: one of 3776 paths over 4 × 4 cells, shifted
    at random, and 18 holes. The ball has a radius of 2.5 cm. The world's axes are those of the board, so
    tilting the board rotates the weight. Inertial forces of the rotating board, at most 0.06 m/s² along it,
    are neglected.

    ## Action Space
    Actions are held for a control period of 20 ms.

    | `action` | entries | meaning | at ±1 |
    |---|---|---|---|
    | `"tilt"` | 0, 1 | angular velocity at which the board tilts towards x, y | ±0.4 rad/s |

    Each angle stays within ±0.15 rad.

    ## Observation Space
    | `observation` | entries | meaning | scale |
    |---|---|---|---|
    | `"particles"` | 0–11 | positions of the ball's particles | 0.2 m |
    | | 12–23 | their velocities | 0.3 m/s |
    | | 24–49 | points x, y of the path, from first to last | 1 m |
    | | 50–85 | centres x, y of the holes | 1 m |
    | | 86, 87 | tilt of the board towards x, y | 1 rad |
    | | 88 | number of completed segments | 1 |
    | `"features"` | 0, 1 | position x, y of the ball | 0.2 m |
    | | 2, 3 | its velocity x, y | 0.3 m/s |
    | | 4, 5 | its angular velocity x, y | 12 rad/s |
    | | 6, 7 | tilt of the board towards x, y | 0.1 rad |
    | | 8–15 | points x, y of the path, from the ball: the last one passed and the next three | 0.2 m |
    | | 16 | remaining length of the path | 1 m |
    | | 17–24 | centres x, y of the four nearest holes, from the ball | 0.1 m |

    ## Rewards
    The path has 13 points; the ball starts at the first, and passes the next when it is less than 5 cm from
    it. The remaining length is the distance to the next point plus all later segments; the progress p is the
    share of the path that is completed. With the distance e of the ball from the end, and K = 1 on the last
    segment, else 0, the reward is E [p + K G(e; 0.02, 0.2)]/2 ([G, L,
    E](../environments.md#shared-definitions)). `reward_progress` is the half with p, `reward_end` that
    with G.

    ## Starting State
    The ball rests at the first point of the path, and the board is level. The path takes twelve steps between
    neighbouring cells of 18 cm and visits no cell twice; all such paths are equally likely. The centre of
    each cell is shifted by U(−1.5, 1.5) cm along x and y, and the first segment is shortened by a share U(0,
    0.6). The holes, of radius 5.5 cm, lie half-way between the centres of two or four cells, as near to the
    path as such points can be.

    ## Episode End
    Termination: the ball falls, because its centre is above a hole, or more than 0.36 m from the centre of
    the board along x or y. Truncation: 600 steps, 12 s. `info["is_success"]`: the ball has passed all points,
    and e < 0.05 m, for the last 25 steps.

    ## Information
    `remaining_length` of the path [m], `clearance` between the ball's centre and the nearest hole's rim [m],
    `tilt` of the board [rad].

    ## Arguments
    - `hard=True`: a board that tilts at up to 0.24 rad/s, and holes of 6 cm.
    - `randomize`: the factor `scale` multiplies the radius of the ball, and `actuator` the force along the
      board.
    """

    if TYPE_CHECKING:

        def __init__(self, **options: Unpack[LabyrinthOptions]) -> None: ...


class SpringLabyrinthVectorEnv(SpringVectorEnv, gym.vector.VectorEnv, task=SpringLabyrinth):
    """Run a native batch of `SpringLabyrinthEnv`."""
