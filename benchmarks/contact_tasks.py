"""MuJoCo beside the tasks with contact: what a user would take instead of springgym's bodies of springs.

Each task is played in MuJoCo with rigid bodies. Their masses, centres and inertias are those of
springgym's particles. They have the same start and end of episodes, and the same forces, because the task
itself draws the starts, gives the forces of a control period, and judges where MuJoCo has moved its particles
to. Only MuJoCo's steps are timed, so what it takes to observe, reward and reset is not counted against it.

MuJoCo takes its own defaults: steps of 2 ms, Euler's method, pyramidal friction. Of its solvers, the fastest
counts. Shapes are those that MuJoCo tests fastest. A contact acts within the same distance as springgym's,
with the same friction and restitution:

    k = `STIFFNESS`,   b = 2 ζ √k,   ζ = −ln e/√(π² + ln² e)

are its stiffness and damping for a unit of mass. The period of this spring takes 22 steps of 2 ms.

Two things are simpler than in the task. Plates and paddles, which are hexagons, are disks. MuJoCo has no
bowl, so a tendon as long as its radius keeps the tip of each top of the duel within it, without friction.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from copy import deepcopy
from itertools import combinations
from typing import Any, SupportsFloat

import numpy as np
from gymnasium.vector import AutoresetMode

from benchmarks.conditions import progress
from benchmarks.errors import batch
from benchmarks.peers import has
from benchmarks.steady import RandomPlay, fractions, native, single
from benchmarks.timing import Case, Row, rates, row_over
from springgym.model.bodies import Body
from springgym.model.bodies.body import inertia
from springgym.model.bodies.distances import largest_distances
from springgym.model.bodies.rotations import axes
from springgym.model.scene import Placed, Scene
from springgym.model.surfaces import Bowl, Contact

TASKS = tuple(
    f"Spring{name}-v0" for name in ("Balance", "Shove", "Stack", "Juggle", "Labyrinth", "Tower", "Duel")
)

SOLVERS = ("Newton", "CG", "PGS")
"""MuJoCo's solvers; the first is its default."""

STIFFNESS = 2e4
"""Stiffness of a contact for a unit of mass [1/s²]: ω h = 0.28 at MuJoCo's default step."""

FINER = 32
"""Steps of MuJoCo's reference for one of its default steps."""

COPIES = 16
"""Copies that MuJoCo plays in turn."""

THIN = 5e-3
"""Half of the thickness of a disk [m]."""

UNTOUCHED = 'contype="0" conaffinity="0"'
"""Only pairs that are named touch."""

UNUSED = (5e-3, 1e-4, 1e-4)
"""MuJoCo's default friction about and along axes, which contacts of three dimensions do not have."""

JOINTS = {False: "<freejoint/>", True: '<joint type="ball"/>'}
"""The joint of a body, by whether it has a pin."""

LIKE = 2.0
"""A solver counts if its median error is at most this times that of the default one."""


# --- Model --------------------------------------------------------------------------------------------


def text(*values: SupportsFloat) -> str:
    """Return numbers as in XML."""
    return " ".join(repr(float(value)) for value in values)


def centre_of(body: Body) -> np.ndarray:
    """Return the centre of mass of a body at rest (3,) [m]."""
    return np.asarray(body.masses @ body.positions / body.masses.sum())


def anchor_of(placed: Placed) -> np.ndarray:
    """Return the point of a body at rest (3,) about which its joint turns it [m]: its pin, or else its centre
    of mass."""
    return placed.body.positions[placed.pinned[0]] if placed.pinned else centre_of(placed.body)


def bowl_of(scene: Scene) -> Bowl | None:
    """Return the bowl of a scene; None if it has none."""
    return next((surface for surface in scene.surfaces if isinstance(surface, Bowl)), None)


def geom_xml(placed: Placed, scene: Scene, origin: np.ndarray) -> str:
    """Return the shape of a body in MuJoCo's XML; the frame has its origin at a point (3,) of the body at
    rest [m]."""
    body = placed.body
    middle = centre_of(placed.body)
    if body.rounds:
        (ball,) = body.rounds
        middle = ball.centre
        shape = f'type="sphere" size="{text(ball.extent)}"'
    elif body.name == "box":
        shape = f'type="box" size="{text(*np.ptp(body.positions, axis=0) / 2)}"'
    elif bowl_of(scene) is not None:  # a top, which may meet another with its rim or its cone
        middle = origin
        shape = 'type="mesh" mesh="top"'
    else:
        ring = body.positions[list(body.parts["ring"])]
        middle = ring.mean(axis=0) - (0.0, 0.0, THIN)
        shape = f'type="cylinder" size="{text(np.linalg.norm(ring[0] - ring.mean(axis=0)), THIN)}"'
    return f'<geom name="{placed.name}" {shape} pos="{text(*(middle - origin))}" {UNTOUCHED}/>'


def solref_of(contact: Contact) -> str:
    """Return −k, −b of a contact."""
    loss = -math.log(contact.restitution)
    share = loss / math.hypot(math.pi, loss)
    return text(-STIFFNESS, -2 * share * math.sqrt(STIFFNESS))


def pair_xml(one: str, other: str, contact: Contact) -> str:
    """Return two shapes that touch, in MuJoCo's XML."""
    friction = text(contact.friction, contact.friction, *UNUSED)
    return (
        f'<pair geom1="{one}" geom2="{other}" condim="3" friction="{friction}" '
        f'solref="{solref_of(contact)}" margin="{text(contact.reach or 0.0)}"/>'
    )


def body_xml(placed: Placed, scene: Scene) -> str:
    """Return a body that moves, in MuJoCo's XML, with the mass and inertia of its particles."""
    body = placed.body
    origin = anchor_of(placed)
    centre = centre_of(body)
    about = inertia(body.positions - centre, body.masses)[[0, 1, 2, 0, 0, 1], [0, 1, 2, 1, 2, 2]]
    site = f'<site name="{placed.name}" pos="{text(*(body.positions[-1] - origin))}"/>'
    return (
        f'<body name="{placed.name}">{JOINTS[bool(placed.pinned)]}{geom_xml(placed, scene, origin)}{site}'
        f'<inertial pos="{text(*(centre - origin))}" mass="{text(body.masses.sum())}" '
        f'fullinertia="{text(*about)}"/></body>'
    )


def model_xml(scene: Scene) -> str:
    """Return the rigid equivalent of a scene as MuJoCo's XML.

    Touching shapes are named in pairs, each with the friction and restitution of the scene.
    """
    world = pairs = assets = tendons = ""
    contact = scene.contact
    collisions = scene.collisions
    assert isinstance(contact, Contact)
    moving = [placed for placed in scene.bodies if not is_fixed(placed)]
    for placed in scene.bodies:
        if is_fixed(placed):
            world += geom_xml(placed, scene, (placed.body.positions - placed.positions).mean(axis=0))
        else:
            world += body_xml(placed, scene)
    if (bowl := bowl_of(scene)) is not None:
        top = moving[0]
        vertices = top.body.positions - anchor_of(top)
        assets = f'<asset><mesh name="top" vertex="{text(*vertices.ravel())}"/></asset>'
        world += f'<site name="bowl" pos="{text(*bowl.centre)}"/>'
        reach = text(contact.reach or 0.0)
        rebound = solref_of(contact)
        tendons = "".join(
            f'<spatial limited="true" range="0 {text(bowl.radius)}" margin="{reach}" '
            f'solreflimit="{rebound}"><site site="bowl"/><site site="{placed.name}"/></spatial>'
            for placed in moving
        )
    elif scene.surfaces:
        world += f'<geom name="floor" type="plane" size="5 5 1" {UNTOUCHED}/>'
        pairs = "".join(pair_xml("floor", placed.name, contact) for placed in moving)
    for one, other in combinations(scene.bodies, 2):
        assert isinstance(collisions, Contact)
        pairs += pair_xml(one.name, other.name, collisions)
    return (
        f'<mujoco><compiler inertiafromgeom="false"/><option '
        f'gravity="{text(*(scene.gravity or (0, 0, 0)))}"/>{assets}<worldbody>{world}</worldbody>'
        f"<contact>{pairs}</contact><tendon>{tendons}</tendon></mujoco>"
    )


def is_fixed(placed: Placed) -> bool:
    """Return whether all particles of a body are pinned."""
    return len(placed.pinned) == len(placed.body.masses)


# --- Play ---------------------------------------------------------------------------------------------


class MuJoCoPlay:
    """Copies of a task whose bodies MuJoCo moves, in steady play by random actions.

    `begin` lets the task judge the last control period, begins episodes anew and sets the forces of the next
    period; `run` takes this period.
    """

    def __init__(self, env_id: str, copies: int = COPIES, **options: Any) -> None:
        import mujoco

        self.mujoco = mujoco
        self.kind = mujoco.mjtState.mjSTATE_INTEGRATION
        self.envs = batch(env_id, copies, autoreset_mode=AutoresetMode.SAME_STEP, **options)
        self.envs.reset(seed=0)
        self.at = self.envs.unwrapped.episodes
        self.scene: Scene = self.at.task.scene
        self.at.steps = 0  # MuJoCo takes the steps
        self.at.elapsed[:] = fractions(self.at.max_episode_steps, copies)
        self.model = mujoco.MjModel.from_xml_string(model_xml(self.scene))
        self.data = [mujoco.MjData(self.model) for _ in range(copies)]
        self.steps = round(self.at.task.period / self.model.opt.timestep)
        self.rng = np.random.default_rng(0)
        self.actions = np.zeros(self.envs.action_space.shape, np.float32)
        self.bodies = [
            (placed, own, self.model.body(placed.name).id)
            for placed, own in zip(self.scene.bodies, self.scene.slices, strict=True)
            if not is_fixed(placed)
        ]
        self.place(np.arange(copies))
        self.act()
        for _ in range(self.at.max_episode_steps):
            self.run()
            self.begin()

    def use(self, solver: str) -> None:
        """Solve contacts by one of the `SOLVERS` from now on."""
        self.model.opt.solver = getattr(self.mujoco.mjtSolver, f"mjSOL_{solver.upper()}")

    def run(self) -> None:
        """Take a control period of every copy."""
        for data in self.data:
            self.mujoco.mj_step(self.model, data, self.steps)

    def rehearse(self) -> None:
        """Take a control period, and return to its start.

        MuJoCo then finds its data in the cache, as it would if it played alone.
        """
        for data in self.data:
            state = self.state(data)
            self.mujoco.mj_step(self.model, data, self.steps)
            self.mujoco.mj_setState(self.model, data, state, self.kind)

    def state(self, data: Any) -> np.ndarray:
        """Return the state of a copy from which its next steps follow."""
        state = np.zeros(self.mujoco.mj_stateSize(self.model, self.kind))
        self.mujoco.mj_getState(self.model, data, state, self.kind)
        return state

    def begin(self) -> None:
        """Judge the last control period, and set the forces of the next one."""
        states = [self.particles(data) for data in self.data]
        positions, velocities = np.array(states).swapaxes(0, 1)
        self.at.simulator.place(positions, velocities, check=False)
        *_, terminated, truncated, _ = self.envs.step(self.actions)
        self.place(np.flatnonzero(terminated | truncated))
        self.act()

    def act(self) -> None:
        """Draw actions, and give MuJoCo the forces that the task makes of them, until the end of a period."""
        self.actions = np.asarray(self.rng.uniform(-1, 1, self.actions.shape), np.float32)
        self.at.action[:] = self.actions
        driven = self.at.driven_by(self.at.action)
        positions = self.at.simulator.positions
        for copy, data in enumerate(self.data):
            for placed, own, number in self.bodies:
                data.xfrc_applied[number] = self._wrench(driven, copy, placed, positions[copy, own])

    def _wrench(
        self, driven: Mapping[str, np.ndarray], copy: int, placed: Placed, x: np.ndarray
    ) -> np.ndarray:
        """Return force [N] and torque about the centre of mass [N·m], (6,), on a body with particles x."""
        prefix = f"{placed.name}." if len(self.scene.bodies) > 1 else ""
        force = np.zeros(3)
        torque = np.zeros(3)
        if f"{prefix}force" in driven:
            force += driven[f"{prefix}force"][copy]
        if f"{prefix}torque" in driven:
            given = driven[f"{prefix}torque"][copy]
            assert placed.wrench is not None
            along = axes(x, placed.body.markers)[:, 2] * placed.wrench.perpendicular
            torque += given - along * (along @ given)
        if f"{prefix}thrust" in driven:
            assert placed.thrust is not None
            thrust = driven[f"{prefix}thrust"][copy]
            arms = x[list(placed.thrust.particles)] - placed.body.masses @ x / placed.body.masses.sum()
            force += thrust.sum(axis=0)
            torque += np.cross(arms, thrust).sum(axis=0)
        return np.append(force, torque)

    def place(self, copies: np.ndarray) -> None:
        """Put bodies where the particles of the simulator are, in some copies (k,)."""
        positions = self.at.simulator.positions
        velocities = self.at.simulator.velocities
        for copy in copies:
            data = self.data[copy]
            self.mujoco.mj_resetData(self.model, data)
            for placed, own, number in self.bodies:
                x = positions[copy, own]
                v = velocities[copy, own]
                place, quaternion, velocity, turning = self._pose(placed, x, v)
                joint = self.model.body_jntadr[number]
                q = self.model.jnt_qposadr[joint]
                w = self.model.jnt_dofadr[joint]
                if not placed.pinned:
                    data.qpos[q : q + 3] = place
                    data.qvel[w : w + 3] = velocity
                    q = q + 3
                    w = w + 3
                data.qpos[q : q + 4] = quaternion
                data.qvel[w : w + 3] = turning

    def _pose(self, placed: Placed, x: np.ndarray, v: np.ndarray) -> tuple[np.ndarray, ...]:
        """Return centre of mass, quaternion, velocity, and angular velocity along its own axes, of a body.

        The rotation is that which brings its particles at rest nearest to the particles x, weighted by mass;
        the angular velocity is I⁻¹ L.
        """
        body = placed.body
        masses = placed.body.masses[:, None]
        rest, centre, speed = centre_of(body), *(((masses * of).sum(axis=0) / masses.sum()) for of in (x, v))
        left, _, right = np.linalg.svd((masses * (body.positions - rest)).T @ (x - centre))
        proper = np.diag([1.0, 1.0, np.sign(np.linalg.det(right.T @ left.T))])
        turn = right.T @ proper @ left.T
        momentum = (masses * np.cross(x - centre, v - speed)).sum(axis=0)
        omega = np.linalg.solve(inertia(x - centre, body.masses), momentum)
        quaternion = np.zeros(4)
        self.mujoco.mju_mat2Quat(quaternion, turn.ravel())
        return centre, quaternion, speed, turn.T @ omega

    def particles(self, data: Any) -> np.ndarray:
        """Return positions [m] and velocities [m/s] of the particles in a copy, (2, N, 3)."""
        for update in (self.mujoco.mj_kinematics, self.mujoco.mj_comPos, self.mujoco.mj_comVel):
            update(self.model, data)
        x = self.scene.positions.copy()
        v = np.zeros(self.scene.positions.shape)
        moving = np.zeros(6)
        for placed, own, number in self.bodies:
            turn = data.xmat[number].reshape(3, 3)
            arms = (placed.body.positions - anchor_of(placed)) @ turn.T
            self.mujoco.mj_objectVelocity(self.model, data, self.mujoco.mjtObj.mjOBJ_XBODY, number, moving, 0)
            x[own] = data.xpos[number] + arms
            v[own] = moving[3:] + np.cross(moving[:3], arms)
        return np.array([x, v])

    def errors(self, periods: int, finer: int = FINER) -> np.ndarray:
        """Return the errors of control periods: the largest distance of a particle from where finer steps of
        MuJoCo take it, over the size of its body."""
        fine = deepcopy(self.model)
        fine.opt.timestep /= finer
        other = self.mujoco.MjData(fine)
        found = []
        for n in range(periods):
            one = self.data[n % len(self.data)]
            self.mujoco.mj_setState(fine, other, self.state(one), self.kind)
            self.run()
            self.mujoco.mj_step(fine, other, self.steps * finer)
            end, there = (self.particles(data)[0][None] for data in (one, other))
            found.append(float(largest_distances(end, there, self.scene.sizes).max()))
            self.begin()
        return np.array(found)


# --- Section ------------------------------------------------------------------------------------------


def contact_tasks(rounds: int) -> list[Row]:
    """Environment steps a second of tasks with contact, one core each, beside rigid bodies in MuJoCo.

    All are in steady play by random actions. springgym's are whole environment steps, of 1024 copies and of
    one; MuJoCo's are its steps of 2 ms alone. Ratios are of what ran side by side in a round. The errors
    beside MuJoCo's speeds, median and ``largest``, are those of a control period from steps 32 times as fine;
    no error of springgym is stated here: the section `errors` has it.
    """
    return compared(TASKS, rounds) if has("mujoco") else []


def compared(
    tasks: tuple[str, ...],
    rounds: int,
    copies: int = 1024,
    periods: int = 160,
    seconds: float = 0.1,
    **options: Any,
) -> list[Row]:
    """Return the rows of some tasks; the error of MuJoCo is over so many control periods."""
    cases = [
        case for name in progress(tasks, "warming up") for case in cases_of(name, copies, periods, **options)
    ]
    found = rates(cases, rounds, seconds)
    rows = [
        row_over(case.what, own, "env steps/s", case.facts) for case, own in zip(cases, found, strict=True)
    ]
    for name in tasks:
        speeds = {
            case.what["program"]: own
            for case, own in zip(cases, found, strict=True)
            if case.what["environment"] == name
        }
        best = max(
            (own for own in speeds if own.startswith("MuJoCo")), key=lambda own: np.median(speeds[own])
        )
        for program in ("springgym", "springgym, single"):
            ratio = [one / other for one, other in zip(speeds[program], speeds[best], strict=True)]
            what = {"environment": name, "program": f"{program} / {best}"}
            rows.append(row_over(what, ratio, "times", {}))
    return rows


def cases_of(env_id: str, copies: int, periods: int, **options: Any) -> Iterator[Case]:
    """Yield the measurements of a task: springgym's, and MuJoCo's by the solvers that err like its own."""

    def own(program: str, play: RandomPlay, copies: int) -> Case:
        what = {"environment": env_id, "program": program, "copies": copies}
        return Case(what, play.run, play.shape[0] * copies, play.begin)

    yield own("springgym", native(env_id, copies, **options), copies)
    play = MuJoCoPlay(env_id, **options)
    usual = math.inf
    for solver in SOLVERS:

        def begin(solver: str = solver) -> None:
            play.use(solver)
            play.begin()
            play.rehearse()

        begin()
        errors = play.errors(periods)
        median = float(np.median(errors))
        if solver == SOLVERS[0]:
            usual = median
        if median <= LIKE * usual:
            step = 1e3 * play.model.opt.timestep
            facts = {"step_ms": step, "error": median, "largest": float(errors.max())}
            what = {"environment": env_id, "program": f"MuJoCo {solver}", "copies": 1}
            yield Case(what, play.run, len(play.data), begin, facts)
    yield own("springgym, single", single(env_id, **options), 1)
