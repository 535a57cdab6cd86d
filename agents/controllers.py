"""Baselines without learning: ``noop``, ``random`` and a classical controller by environment.

A classical controller reads the features (``observation="features"``) and nothing else.
It maps a task and a batch ``(n, d)`` to actions ``(n, a)`` in [-1, 1]. The task tells it the meaning of the
numbers, the strength of the actuators and the control period: `Task.seen`, `Task.limits`, `Task.period`.
"""

from __future__ import annotations

import inspect
from collections.abc import Callable, Mapping
from functools import cache, partial
from importlib import import_module
from typing import Any

import numpy as np
from config import ConfigError
from gymnasium import spaces
from runs import HELD_OUT_SEED

from springgym.envs.agent import Policy
from springgym.envs.registration import find
from springgym.envs.task import Task
from springgym.envs.tasks import billiards, detumble, duel, free_top, juggle, labyrinth, top, tower, tumble
from springgym.model.bodies.rotations import axes
from springgym.model.scene import GRAVITY

UNTRAINED = ("noop", "random", "classical")
"""Names of the agents of `make_controller` that need no training."""
UP = np.array([0.0, 0.0, 1.0])
G = -GRAVITY[2]

Controller = Callable[[Any, np.ndarray], np.ndarray]
"""A function from a task and features (n, d) to actions (n, a)."""


def top_moment(task: Task, observations: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the moment (n, 3) in N·m that erects the pinned top, and the moment (n,) about its axis.

    With the axis n, the angular velocity ω⊥ across it and the spin ω₃:
    60 (z − n (n·z)) turns the angular momentum L ≈ I₃ω₃ n towards the vertical,
    40 n×z carries part of the weight, −20 ω⊥ damps the nutation; 3 (ω_wanted − ω₃) keeps the spin.
    """
    seen = task.seen(observations)
    axis = seen["axis"]
    spin = seen["spin"][:, 0]
    upright = UP - axis * axis[:, 2:]
    moment = 60.0 * upright + 40.0 * np.cross(axis, UP) - 20.0 * seen["across"]
    return moment, 3.0 * (top.WANTED - spin)


def top_torque(task: Task, observations: np.ndarray) -> np.ndarray:
    """Control SpringTop with world torques x, y and an axis torque."""
    moment, about_axis = top_moment(task, observations)
    return _saturated(np.column_stack([moment[:, :2], about_axis]), task.limits)


def top_impulse(task: Task, observations: np.ndarray) -> np.ndarray:
    """Control SpringTop with an impulse on its crown.

    An impulse J on the crown, 1 m from the tip along n, acts over a control period T as the moment
    n×J / T; J = T (τ×n) gives τ.
    """
    moment, _ = top_moment(task, observations)
    return _saturated(task.period * np.cross(moment, task.seen(observations)["axis"]), task.limits)


def gyroscope_moment(task: Task, observations: np.ndarray) -> np.ndarray:
    """Return the moment (n, 3) in N·m that turns the axis n of a gyroscope towards d.

    60 sign(ω₃) (d − n (n·d)), cut at 20 N·m, turns the angular momentum I₃ω₃ n towards ±d;
    −10 ω⊥ damps the nutation.
    """
    seen = task.seen(observations)
    axis = seen["axis"]
    wanted = seen["target"]
    towards = wanted - axis * _dot(axis, wanted)
    return np.clip(60.0 * np.sign(seen["spin"]) * towards, -20.0, 20.0) - 10.0 * seen["across"]


def gyroscope_torque(task: Task, observations: np.ndarray) -> np.ndarray:
    """Control SpringGyroscope with world torques."""
    return _saturated(gyroscope_moment(task, observations), task.limits)


def gyroscope_impulse(task: Task, observations: np.ndarray) -> np.ndarray:
    """Control SpringGyroscope with an impulse on the head, 0.5 m from the pin."""
    moment = gyroscope_moment(task, observations)
    axis = task.seen(observations)["axis"]
    return _saturated(task.period * np.cross(moment, axis) / 0.5, task.limits)


def pendulum_moment(task: Task, observations: np.ndarray) -> np.ndarray:
    """Return the moment (n, 3) in N·m that pumps energy into the cube and then holds it upside down.

    Far from the top, the energy ½ I₁ω² + Mgl n·z is brought to Mgl, with I₁ = 1.25 kg·m² and Mgl = 8.5 N·m
    (Åström & Furuta 2000, doi:10.1016/S0005-1098(99)00140-5). A moment τ does the work τ·ω, and x and y of it
    are limited one by one, so each goes to its limit along ω, or against it if there is too much energy. This
    ω is that of 0.08 s later, in a free fall: a cube at rest is pushed down, not held up on its slope.
    The momentum about the vertical is to vanish, too (Shiriaev et al. 2004,
    doi:10.1016/j.automatica.2003.07.009), by −2 (ω·z) z. Within 0.6 rad of the top 30 n×z − 8 ω⊥, of which
    the weight takes 8.5.
    """
    seen = task.seen(observations)
    axis = seen["axis"]
    across = seen["across"]
    lift = 8.5
    inertia = 1.25
    strongest = 4.25
    erecting = np.cross(axis, np.where(axis[:, 2:] < -0.9999, [1.0, 0.0, 0.0], UP))
    soon = across - 0.08 * lift / inertia * erecting
    short = lift * (1.0 - axis[:, 2:]) - 0.5 * inertia * _dot(across, across)
    pump = strongest * np.clip(2.0 * short, -1.0, 1.0) * np.clip(10.0 * soon, -1.0, 1.0)
    pump[:, 2] = -2.0 * across[:, 2]
    hold = 30.0 * np.cross(axis, UP) - 8.0 * across
    return np.where(axis[:, 2:] > np.cos(0.6), hold, pump)


def pendulum_torque(task: Task, observations: np.ndarray) -> np.ndarray:
    """Control SpringPendulum with world torques."""
    return _saturated(pendulum_moment(task, observations), task.limits)


def pendulum_impulse(task: Task, observations: np.ndarray) -> np.ndarray:
    """Control SpringPendulum with an impulse on the far corner, √3 m from the pin."""
    moment = pendulum_moment(task, observations)
    axis = task.seen(observations)["axis"]
    return _saturated(task.period * np.cross(moment, axis) / np.sqrt(3.0), task.limits)


def detumble_torque(task: Task, observations: np.ndarray) -> np.ndarray:
    """Control SpringDetumble with torques −10 H, H the angular momentum in the body's axes."""
    return _saturated(-10.0 * task.seen(observations)["angular_momentum"], task.limits)


def detumble_thrusters(task: Task, observations: np.ndarray) -> np.ndarray:
    """Control SpringDetumble with thrusters, each against the speed at which its place moves along it.

    An impulse −J takes the energy J u away, so the body slows down as long as any thruster moves. Full
    thrust from u = 0.1 m/s on.
    """
    speed = task.seen(observations)["angular_velocity"] @ _thruster_arms().T
    return _saturated(-speed, 0.1)


@cache
def _thruster_arms() -> np.ndarray:
    """Return r × d of each thruster at r along d, in the body's axes: (thrusters, 3) [m]."""
    body = detumble.SpringDetumble().body
    triad = axes(body.positions, body.markers)
    corners = [corner for corner, _ in detumble.THRUSTERS]
    along = np.array([direction for _, direction in detumble.THRUSTERS], float)
    return np.cross(body.positions[corners] - body.centre, along) @ triad


def regulator(
    drift: np.ndarray, control: np.ndarray, weights: np.ndarray, effort: float, period: float
) -> np.ndarray:
    """Return the gain K (m, n) of the linear-quadratic regulator u = −K x held over control periods.

    For x' = drift x + control u it minimises Σ xᵀ diag(weights) x + effort uᵀu, by iterating the
    Riccati equation (Åström & Wittenmark, Computer-Controlled Systems, 1997, section 11.2).
    """
    n, m = control.shape
    both = np.block([[drift, control], [np.zeros((m, n + m))]]) * period
    power = np.eye(n + m)
    exponential = np.eye(n + m)
    for k in range(1, 20):
        power = power @ both / k
        exponential += power
    a = exponential[:n, :n]
    b = exponential[:n, n:]
    cost = np.diag(weights)
    for _ in range(3000):
        gain = np.linalg.solve(effort * np.eye(m) + b.T @ cost @ b, b.T @ cost @ a)
        cost = np.diag(weights) + a.T @ cost @ (a - b @ gain)
    return gain


@cache
def _rope_gain(period: float) -> np.ndarray:
    """Find the gain for x = load − target, trolley − load and both velocities, along one axis."""
    pull = G / 4.05  # g over the length of the rope
    drift = np.array([[0, 0, 1, 0], [0, 0, -1, 1], [0, pull, 0, 0], [0, 0, 0, 0]], float)
    return regulator(drift, np.array([[0.0], [0], [0], [1]]), np.array([1.0, 0.1, 0.1, 0.1]), 0.1, period)


def rope_trolley(task: Task, observations: np.ndarray) -> np.ndarray:
    """Control SpringRope with a linear-quadratic regulator along x and y."""
    seen = task.seen(observations)
    x = np.stack([-seen["to_target"], seen["to_trolley"], seen["velocity"], seen["trolley_velocity"]], axis=1)
    return _saturated(-np.einsum("k,nka->na", _rope_gain(task.period)[0], x), task.limits)


FREE_TOP = (10.0, 0.375, 0.125, 1.094)
"""Of the free top: mass [kg], height of the centre of mass above the tip, and of the crown above that [m],
and moment of inertia across the axis [kg·m²]."""


@cache
def _free_top_gain(period: float) -> np.ndarray:
    """Find the gain for x = n_x, n_y, ω_x, ω_y, and position and velocity of the centre, near the upright.

    The floor carries the weight at the tip, l below the centre of mass, and the crown is h − l above it:
    I₁ω⊥' = Mgl n×z + (h − l) z×F − I₃ω₃ n',  n' = ω×n,  M X'' = F.
    """
    mass, low, high, moment = FREE_TOP
    whirl = 1.25 * free_top.WANTED / moment
    fall = mass * G * low / moment
    drift = np.zeros((8, 8))
    control = np.zeros((8, 2))
    drift[0, 3] = 1.0
    drift[1, 2] = -1.0
    drift[2, [1, 3]] = -fall, -whirl
    drift[3, [0, 2]] = fall, whirl
    drift[4, 6] = drift[5, 7] = 1.0
    control[2, 1] = -high / moment
    control[3, 0] = high / moment
    control[6, 0] = control[7, 1] = 1 / mass
    return regulator(drift, control, np.array([10.0, 10, 1, 1, 20, 20, 1, 1]), 1e-4, period)


def free_top_push(task: free_top.SpringFreeTop, observations: np.ndarray) -> np.ndarray:
    """Control SpringFreeTop with a linear-quadratic regulator; the ring speeds up by 4/s (ω_wanted − ω₃).

    The regulator, for a floor without friction, acts about a push that friction would hold: μMg towards the
    middle from 0.1 m on, falling to 0 at 0.05 m, with the lean F h/(Mgl) for which the weight balances it.
    The way that the regulator sees is at most 0.1 m.
    """
    seen = task.seen(observations)
    mass, low, high, _ = FREE_TOP
    centre = seen["centre"]
    friction = task.contact.friction
    away = np.linalg.norm(centre, axis=1, keepdims=True)
    inwards = -centre / np.maximum(away, 1e-9)
    steady = friction * np.clip(away / 0.05 - 1.0, 0.0, 1.0) * inwards  # over Mg
    leaning = seen["axis"][:, :2] + (low + high) / low * steady
    moving = [leaning, seen["across"][:, :2], -np.minimum(away, 0.1) * inwards, seen["centre_velocity"]]
    push = mass * G * steady - np.hstack(moving) @ _free_top_gain(task.period).T
    speeding = 4.0 * (free_top.WANTED - seen["spin"])
    return np.hstack([_saturated(push, task.limits[:2]), _saturated(speeding, free_top.RING_ACCELERATION)])


def tumble_push(task: Task, observations: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the force [N] and torque [N·m], (n, 3) each, that turn the face down and the body to the target.

    It is half lifted while on the way.
    """
    seen = task.seen(observations)
    offset = seen["offset"].copy()
    normal = seen["normal"]
    offset[:, 2] = 0.0
    error = np.linalg.norm(offset, axis=1, keepdims=True)
    axis = np.cross(normal, -UP)
    behind = (normal[:, 2:] > 0) & (np.linalg.norm(axis, axis=1, keepdims=True) < 0.3)
    axis = np.where(behind, np.cross(normal, [1.0, 0.0, 0.0]), axis)
    sine = np.linalg.norm(axis, axis=1, keepdims=True)
    angle = np.arctan2(sine, -normal[:, 2:])
    torque = 30.0 * angle * axis / np.maximum(sine, 1e-9) - 3.0 * seen["angular_velocity"]
    force = -60.0 * offset - 30.0 * seen["velocity"]
    force[:, 2] = 0.0
    way = np.clip((error - 0.05) / 0.05, 0.0, 1.0)
    force += way * 20.0 * -offset / np.maximum(error, 1e-9) + way * 35.0 * UP
    return force, torque


def tumble_wrench(task: tumble.SpringTumble, observations: np.ndarray) -> np.ndarray:
    """Control SpringTumble with a force and a torque."""
    return _saturated(np.column_stack(tumble_push(task, observations)), task.limits)


def tumble_impulses(task: tumble.SpringTumble, observations: np.ndarray) -> np.ndarray:
    """Control SpringTumble with impulses on its corners, the smallest f_i of Σ f_i = F and Σ r_i×f_i = τ.

    F and τ go up to those of the task's wrench, each component of f_i to a quarter of that force; what one
    corner cannot give is asked of the others.
    """
    force = task.force
    push, twist = (
        np.clip(values, -limit, limit)
        for values, limit in zip(tumble_push(task, observations), (force, task.torque), strict=True)
    )
    seen = task.seen(observations)
    first = seen["side"]
    third = seen["axis"]
    triad = np.stack([first, np.cross(third, first), third], axis=1)
    arms = _corner_arms() @ triad
    moments = np.cross(arms[:, :, None], np.eye(3)).swapaxes(2, 3)  # of the unit forces, (n, corners, 3, 3)
    shares = np.concatenate([np.broadcast_to(np.eye(3), moments.shape), moments], axis=2)
    shares = shares.swapaxes(1, 2).reshape(len(arms), 6, -1)
    inverse = np.linalg.pinv(shares)
    wanted = np.column_stack([push, twist])[:, :, None]
    forces = inverse @ wanted
    for _ in range(4):
        forces = np.clip(forces, -force / 4, force / 4)
        forces += inverse @ (wanted - shares @ forces)
    return _saturated(forces[:, :, 0], force / 4)


@cache
def _corner_arms() -> np.ndarray:
    """Return corners of the tumbling body from its centre of mass, in its axes: (corners, 3) [m]."""
    body = tumble.SpringTumble().body
    return (body.positions[:4] - body.centre) @ axes(body.positions, body.markers)


def balance_torque(task: Task, observations: np.ndarray) -> np.ndarray:
    """Control SpringBalance with torques to the tilt that accelerates the ball as it should.

    On a slope the ball rolls with 5/7 g n; of the place, −ω²r is wanted, of its error −9 e − 5 e'. The torque
    is I₁ (60 n×n* − 12 ω⊥), I₁ = 0.11 kg·m², and carries the plate, Mgl n×z, and the ball, m g r×z.
    """
    seen = task.seen(observations)
    place = seen["place"]
    away = np.zeros((len(observations), 1))
    rate = _dot(seen["place_velocity"], seen["place_velocity"]) / np.maximum(_dot(place, place), 1e-6)
    falling = seen["velocity"] - seen["place_velocity"]
    rolling = -rate * place - 9.0 * seen["offset"] - 5.0 * falling
    wanted = np.clip(rolling / (5.0 / 7.0 * G), -0.25, 0.25)
    error = np.hstack([seen["axis"] - wanted, away])
    carried = np.hstack([1.84 * seen["axis"] + 0.2 * G * (place + seen["offset"]), away])
    torque = np.cross(carried + 0.11 * 60.0 * error, UP)[:, :2] - 0.11 * 12.0 * seen["turning"]
    return _saturated(torque, task.limits)


def _pushed(
    seen: Mapping[str, np.ndarray],
    lacking: np.ndarray,
    along: np.ndarray,
    turned: np.ndarray,
    done: np.ndarray,
    taken: float,
) -> np.ndarray:
    """Return the force (n, 2) in N on a ball that brings a box on and turns it back, by pushing at its faces.

    The ball goes around the box to the face from which it is to be pushed, and to a place on it 0.25 m a
    radian off the middle. Its force is 11 kg/s times what its velocity lacks, and what the box takes.

    Parameters
    ----------
    seen
        What is observed: ``beside``, ``heading`` and ``pusher_velocity`` are needed.
    lacking : (n, 2)
        Way to where the box belongs, in its own axes [m].
    along : (n,)
        The axis, 0 or 1, along which it is to be pushed.
    turned : (n,)
        By how much it is turned too far [rad].
    done : (n,)
        Whether the ball is to stop.
    taken
        Force that it takes to push the box [N].
    """
    rows = np.arange(len(along))
    at = seen["beside"]
    across = 1 - along
    turn = _axes(seen)
    velocity = np.einsum("nij,nj->ni", turn, seen["pusher_velocity"])
    side = -np.sign(lacking[rows, along])
    beside = np.clip(-0.25 * turned * side * np.where(along == 0, 1, -1), -0.1, 0.1)
    face = np.where(along == 0, np.where(side > 0, 0.0, np.pi), side * np.pi / 2)
    bearing = np.arctan2(at[:, 1], at[:, 0])
    around = (face - bearing + np.pi) % (2 * np.pi) - np.pi
    ahead = bearing + np.clip(around, -0.6, 0.6)
    way = 0.4 * np.stack([np.cos(ahead), np.sin(ahead)], axis=1) - at
    wanted = 0.9 * way / np.maximum(np.linalg.norm(way, axis=1, keepdims=True), 0.1)
    gap = side * at[rows, along] - 0.27
    off = beside - at[rows, across]
    aligned = np.exp(-((off / 0.04) ** 2))
    speed = np.clip(2.0 * (np.abs(lacking[rows, along]) - 0.02), 0.08, 0.4)
    closing = np.zeros_like(at)
    closing[rows, along] = side * (-speed * aligned + 3.0 * (0.03 - gap) * (1 - aligned))
    closing[rows, across] = np.clip(5.0 * off, -0.5, 0.5)
    near = np.abs(around) < 0.75
    wanted[near] = closing[near]
    wanted[done] = 0.0
    force = 11.0 * (wanted - velocity)
    pushing = near & (gap < 0.03) & ~done
    force[rows, along] -= side * taken * pushing * aligned
    return np.einsum("nji,nj->ni", turn, force)


def _axes(seen: Mapping[str, np.ndarray]) -> np.ndarray:
    """Return the first two axes (n, 2, 2) of a box that is turned by its ``heading``, in rows."""
    cosine, sine = seen["heading"].T
    return np.stack([np.stack([cosine, sine], axis=1), np.stack([-sine, cosine], axis=1)], axis=1)


def shove_push(task: Task, observations: np.ndarray) -> np.ndarray:
    """Control SpringShove: push the box along its axes, one after the other, beside its middle to turn it.

    From the present face as long as that serves.
    """
    seen = task.seen(observations)
    rows = np.arange(len(observations))
    heading = np.arctan2(seen["heading"][:, 1], seen["heading"][:, 0])
    lacking = -np.einsum("nij,nj->ni", _axes(seen), seen["place"])
    at = seen["beside"]
    here = np.abs(at).argmax(axis=1)
    serves = (np.abs(lacking[rows, here]) > 0.02) & (at[rows, here] * lacking[rows, here] < 0)
    along = np.where(serves, here, np.abs(lacking).argmax(axis=1))
    done = (np.abs(lacking).max(axis=1) < 0.03) & (np.abs(heading) < 0.12)
    return _saturated(_pushed(seen, lacking, along, heading, done, 5.0), task.limits)


def stack_push(task: Task, observations: np.ndarray) -> np.ndarray:
    """Control SpringStack: bring the box before the block, then over the edge, steering it by its heading.

    Sideways while it is 0.35 m and more from the block, and 0.18 m and more aside, or 0.06 m if the ball is
    at that face already. On the way it is to be turned to where the block is, up to 0.4 rad; within 0.2 m of
    it, as the block is.
    """
    seen = task.seen(observations)
    turned = np.arctan2(seen["turned"][:, 1], seen["turned"][:, 0])
    ahead, aside = -seen["way"].T
    lacking = np.einsum("nij,nj->ni", _axes(seen), -seen["way"])
    here = np.abs(seen["beside"]).argmax(axis=1)
    sideways = (ahead > 0.35) & (np.abs(lacking[:, 1]) > np.where(here == 1, 0.06, 0.18))
    steered = np.clip(aside / np.maximum(ahead - 0.1, 0.05), -0.4, 0.4)
    turned -= np.where(sideways, 0.0, steered * np.clip(10.0 * ahead - 1.0, 0.0, 1.0))
    done = (np.hypot(ahead, aside) < 0.02) | (lacking[:, 0] < 0.01) & (ahead < 0.2)
    return _saturated(_pushed(seen, lacking, np.where(sideways, 1, 0), turned, done, 6.5), task.limits)


def labyrinth_tilt(task: labyrinth.SpringLabyrinth, observations: np.ndarray) -> np.ndarray:
    """Control SpringLabyrinth: roll along the leg, slowly around corners, and lean the board for that.

    Along a leg the ball is to have u = 0.3 m/s, or less, so that 0.25 m/s² slow it down to the corner, which
    it takes at 0.05 m/s, or at u where the way goes straight on. Its distance from the line is made up for at
    a gain of 5/s, and so is what its velocity lacks, by 5/7 g times the tilt; what the tilt lacks, at 20/s. A
    board that turns slowly cannot follow that: there the gain is less, u goes with it, and the slowing down
    with its square.
    """
    gain = min(5.0, task.rate / 0.06)
    fast = 0.06 * gain
    brake = 0.01 * gain**2
    seen = task.seen(observations)
    points = seen["way"].reshape(len(observations), -1, 2)
    legs = np.diff(points[:, :3], axis=1)
    lengths = np.linalg.norm(legs, axis=2, keepdims=True)
    along, after = (legs / np.maximum(lengths, 1e-9)).swapaxes(0, 1)
    last = lengths[:, 1] < 1e-6
    ahead = _dot(points[:, 1], along)
    corner = np.where(last, 0.0, 0.05 + (fast - 0.05) * np.maximum(_dot(along, after), 0.0) ** 4)
    speed = np.minimum(fast, np.sqrt(corner**2 + 2.0 * brake * np.abs(ahead)))
    speed = np.sign(ahead) * np.where(last, np.minimum(speed, 2.5 * np.abs(ahead)), speed)
    aside = np.clip(gain * (points[:, 1] - ahead * along), -0.25, 0.25)
    lacking = gain * (speed * along + aside - seen["velocity"])
    tilt = np.clip(lacking / (5.0 / 7.0 * G), -labyrinth.TILT, labyrinth.TILT)
    return _saturated(20.0 * (tilt - seen["tilt"]), task.limits)


def juggle_wrench(task: juggle.SpringJuggle, observations: np.ndarray) -> np.ndarray:
    """Control SpringJuggle: hit the next ball at the height of home, with the speed and tilt to send it on.

    It is to be up for T = 2√(2h/g), and to come down on its vertical: it leaves with gT/2 upwards and −r/T
    sideways. Friction stops the slip across the normal n, P (v − ρ ω×n), which takes 2/7 of it from the
    velocity of a solid ball of radius ρ. So the axis is to be along u = v' − v + 2/7 P (v − ρ ω×n), found in
    four rounds, and the paddle to move at v·n + s, with the speed s = 1.07 |u|/(1 + e) at which they meet: e
    is the restitution, and the paddle yields like a mass of 1/0.07 balls. It comes on a straight line within
    the last 0.15 s, by 400 (way) + 40 (speed) in force and torque. Of two balls, one is to come half of T
    after the other: half of what it comes too early or late is added to T.
    """
    seen = task.seen(observations)
    rows = np.arange(len(observations))
    names = ("", "other_")[: task.balls]
    ball = np.stack([seen[f"{name}ball"] for name in names])
    velocity = np.stack([seen[f"{name}ball_velocity"] for name in names])
    spin = np.stack([seen[f"{name}spin"] for name in names])
    height = np.maximum(ball[..., 2] - juggle.BALL_RADIUS - 0.003, 0.0)
    left = (velocity[..., 2] + np.sqrt(velocity[..., 2] ** 2 + 2.0 * G * height)) / G
    first = left.argmin(axis=0)
    last = left.max(axis=0)
    here = (left.argmin(axis=0), rows)
    column = np.array(task.columns)[first, None] * [1.0, 0.0]
    ball = ball[here]
    velocity = velocity[here]
    spin = spin[here]
    left = left[here]
    error = np.stack([seen[f"{name}height_offset"][:, 0] for name in names])[here]
    up = np.sqrt(8.0 / G * np.maximum(seen["wanted_height"][:, 0] - 0.3 * error, 0.05))
    if task.balls == 2:
        up += np.clip(0.5 * (last - left - up / 2.0), -0.15 * up, 0.15 * up)
    place = ball + left[:, None] * velocity
    place[:, 2] = 0.0
    leaving = np.column_stack([(column - place[:, :2]) / up[:, None], G * up / 2.0])
    change = leaving - velocity
    change[:, 2] += G * left
    struck = leaving - change
    push = change
    for _ in range(4):
        size = np.linalg.norm(push, axis=1)
        normal = push / size[:, None]
        slip = struck - juggle.BALL_RADIUS * np.cross(spin, normal)
        push = change + 2.0 / 7.0 * (slip - _dot(slip, normal) * normal)
    meeting = 1.07 * size / (1.0 + task.contact.restitution)
    speed = (_dot(struck, normal) + meeting[:, None]) * normal
    axis = np.hstack([seen["axis"], np.sqrt(np.maximum(1.0 - _dot(seen["axis"], seen["axis"]), 0.0))])
    aside = np.column_stack([column, -_dot(column, normal[:, :2]) / normal[:, 2:]])
    way = place - aside - speed * np.minimum(left, 0.15)[:, None] - seen["paddle"] - juggle.HEIGHT / 4 * axis
    soon = (left < 0.15)[:, None]
    force = juggle.PADDLE_MASS * (400.0 * way + 40.0 * (soon * speed - seen["paddle_velocity"]))
    torque = 0.034 * (400.0 * np.cross(axis, normal)[:, :2] - 40.0 * seen["turning"])
    return _saturated(np.hstack([force, torque]), task.limits)


@cache
def _tower_gain(period: float) -> np.ndarray:
    """Return the gain along an axis of x = way, velocity, tilt n and its rate, of a block hanging by its top.

    A force F there is l above the centre of mass: M X'' = F, I n'' = l (F − Mg n).
    """
    width, _, height = tower.SIDES
    arm = height / 2
    moment = tower.MASS * (width**2 + height**2) / 4
    drift = np.zeros((4, 4))
    control = np.zeros((4, 1))
    drift[0, 1] = drift[2, 3] = 1.0
    drift[3, 2] = -arm * tower.MASS * G / moment
    control[1, 0] = 1 / tower.MASS
    control[3, 0] = arm / moment
    return regulator(drift, control, np.array([20.0, 1.0, 5.0, 1.0]), 0.03, period)


def tower_crane(task: tower.SpringTower, observations: np.ndarray) -> np.ndarray:
    """SpringTower: lift the block, bring it above its place without letting it swing, lower it, let go.

    A linear-quadratic regulator brings it there along x and y, as if it were 0.45 m away at most, and not
    before it is 4 cm above its place. It stays 8 cm above until it is within 3 cm and slower than 0.1 m/s.
    It is let go less than 8 cm above if it is to fall within 2.8 cm, upright and slowly turning.
    """
    seen = task.seen(observations)
    way = seen["way"]
    velocity = seen["velocity"]
    turning = seen["turning"]
    aside = np.linalg.norm(way[:, :2], axis=1)
    drift = np.linalg.norm(velocity[:, :2], axis=1)
    above = (aside < 0.03) & (drift < 0.1)
    near = way[:, :2] * np.minimum(1.0, 0.45 / np.maximum(aside, 1e-9))[:, None]
    near[~above & (way[:, 2] < 0.04)] = 0.0
    rate = np.stack([turning[:, 1], -turning[:, 0]], axis=1)
    state = np.stack([near, velocity[:, :2], seen["axis"], rate], axis=1)
    force = np.zeros((len(way), 4))
    force[:, :2] = -np.einsum("k,nka->na", _tower_gain(task.period)[0], state)
    rise = np.clip(np.where(above, 0.0, 0.08) - way[:, 2], -0.1, 0.6)
    force[:, 2] = tower.MASS * (10.0 * rise - 6.0 * velocity[:, 2] + (1 - tower.CARRIED) * G)
    fall = task.period + np.sqrt(2.0 * np.maximum(way[:, 2] - tower.REACH, 0.0) / G)
    landing = np.linalg.norm(way[:, :2] + fall[:, None] * velocity[:, :2], axis=1)
    calm = (np.linalg.norm(seen["axis"], axis=1) < 0.15) & (np.linalg.norm(turning, axis=1) < 1.5)
    there = (landing < 0.028) & (drift < 0.3) & (np.abs(way[:, 2] - 0.035) < 0.045) & calm
    force[:, 3] = np.where(there, 1.0, -1.0)
    return _saturated(force, task.limits)


def billiards_stroke(task: Task, observations: np.ndarray) -> np.ndarray:
    """SpringBilliards: aim at where the first ball is to be when both meet, as hard as the ways need.

    That is behind the second ball, seen from the pocket, by two radii and what contact keeps between them.
    The second ball is to arrive at 0.6 m/s. Along the line between both it gets (1 + e)/2 of the first one's
    velocity, and friction takes 2 μ g d of a squared velocity on a way d.
    """
    seen = task.seen(observations)
    way = seen["to_pocket"]
    slowing = billiards.FRICTION * G
    farther = np.linalg.norm(way, axis=1, keepdims=True)
    onward = way / np.maximum(farther, 1e-9)
    aim = seen["to_ball"] - (2.0 * billiards.RADIUS + 0.25 * billiards.REACH) * onward
    away = np.linalg.norm(aim, axis=1, keepdims=True)
    aim /= np.maximum(away, 1e-9)
    leaving = np.sqrt(0.6**2 + 2.0 * slowing * farther)
    meeting = leaving / ((1.0 + billiards.RESTITUTION) / 2.0 * np.maximum(_dot(aim, onward), 0.2))
    speed = np.sqrt(meeting**2 + 2.0 * slowing * away)
    force = billiards.MASS * (speed / task.period + slowing) * aim
    return _saturated(force, task.limits)


def duel_push(task: Task, observations: np.ndarray) -> np.ndarray:
    """Control SpringDuel: the strongest of its scripts, see `springgym.envs.tasks.duel.Script`."""
    return duel.OPPONENTS["strong"](observations).astype(np.float32)


def _dot(u: np.ndarray, w: np.ndarray) -> np.ndarray:
    """Return scalar products (n, 1) of rows (n, 3)."""
    return np.sum(u * w, axis=1, keepdims=True)


def _saturated(values: np.ndarray, limit: float | np.ndarray) -> np.ndarray:
    """Return physical values (n, a) cut at ``limit``, one or (a,), and scaled to actions."""
    return np.clip(values / limit, -1.0, 1.0).astype(np.float32)


#: Environment id -> ``action`` keyword -> controller; the first is that of the default action.
CLASSICAL: dict[str, dict[str, Controller]] = {
    "SpringTop-v0": {"torque": top_torque, "impulse": top_impulse},
    "SpringGyroscope-v0": {"torque": gyroscope_torque, "impulse": gyroscope_impulse},
    "SpringPendulum-v0": {"torque": pendulum_torque, "impulse": pendulum_impulse},
    "SpringDetumble-v0": {"torque": detumble_torque, "thrusters": detumble_thrusters},
    "SpringRope-v0": {"trolley": rope_trolley},
    "SpringTumble-v0": {"wrench": tumble_wrench, "impulses": tumble_impulses},
    "SpringFreeTop-v0": {"push": free_top_push},
    "SpringBalance-v0": {"torque": balance_torque},
    "SpringShove-v0": {"push": shove_push},
    "SpringStack-v0": {"push": stack_push},
    "SpringJuggle-v0": {"wrench": juggle_wrench},
    "SpringLabyrinth-v0": {"tilt": labyrinth_tilt},
    "SpringTower-v0": {"crane": tower_crane},
    "SpringBilliards-v0": {"stroke": billiards_stroke},
    "SpringDuel-v0": {"push": duel_push},
}


def controllers_of(env_id: str) -> dict[str, Controller]:
    """Return classical controllers of an environment or a variant, by action; none if there are none."""
    found = find(env_id)
    return CLASSICAL.get(env_id if found is None else found[0].id, {})


def task_of(env_id: str, env_kwargs: Mapping[str, Any]) -> Task | None:
    """Make the task of an environment, with those of the arguments that are the task's own.

    None if the environment is not one of springgym's.
    """
    found = find(env_id)
    if found is None:
        return None
    row, arguments = found
    task_type = getattr(import_module(f"springgym.envs.tasks.{row.module}"), row.name)
    own = inspect.signature(task_type).parameters
    return task_type(**{name: value for name, value in (arguments | dict(env_kwargs)).items() if name in own})


def make_controller(
    name: str, env_id: str, env_kwargs: Mapping[str, Any], action_space: spaces.Space[Any]
) -> Policy:
    """Make a baseline.

    Parameters
    ----------
    name
        ``"noop"``, ``"random"``, ``"classical"``, or a function by its module, ``"module:function"``: from
        observations (n, …) it makes actions (n, …).
    env_id, env_kwargs
        The environment and its keyword arguments, of which ``action`` chooses the controller.
    action_space
        Of one copy.

    Raises
    ------
    ConfigError
        If there is no such controller.
    """
    if ":" in name:
        return own_controller(name, action_space)
    if not isinstance(action_space, spaces.Box):
        raise ConfigError(f"{env_id} has no continuous actions: its action space is {action_space}")
    if name == "noop":
        return lambda observations: np.zeros((len(observations), *action_space.shape), np.float32)
    if name == "random":
        rng = np.random.default_rng(HELD_OUT_SEED)
        low = action_space.low
        high = action_space.high
        return lambda observations: rng.uniform(low, high, (len(observations), *action_space.shape)).astype(
            np.float32
        )
    if name != "classical":
        raise ConfigError(
            f"unknown controller {name!r}: use noop, random, classical or module:function"
            "; there is no run folder of this name"
        )
    by_action = controllers_of(env_id)
    _, arguments = find(env_id) or (None, {})
    action = (arguments | dict(env_kwargs)).get("action", next(iter(by_action), None))
    if action not in by_action:
        known = [f"{e} ({a})" for e, actions in CLASSICAL.items() for a in actions]
        raise ConfigError(
            f"no classical controller for {env_id} with action={action!r}; "
            f"there is one for: {', '.join(known)}"
        )
    return partial(by_action[action], task_of(env_id, env_kwargs))


def own_controller(name: str, action_space: spaces.Space[Any]) -> Policy:
    """Import a function of the user's, ``module:function``, and check its actions."""
    module, _, function = name.partition(":")
    try:
        found = getattr(import_module(module), function)
    except (ImportError, AttributeError, ValueError) as error:
        raise ConfigError(f"no controller {name!r}: {error}") from error
    if not callable(found):
        raise ConfigError(f"{name} is {found!r}; it must be a function from observations to actions")

    def act(observations: np.ndarray) -> np.ndarray:
        actions = np.asarray(found(observations))
        shape = (len(observations), *(action_space.shape or ()))
        if actions.shape != shape or actions.dtype.kind not in "fiu" or not np.isfinite(actions).all():
            raise ConfigError(
                f"{name} gave {actions.dtype} of shape {actions.shape}; it must give finite actions of shape "
                f"{shape} for observations of shape {observations.shape}"
            )
        return actions

    return act


def controller_env_kwargs(name: str, env_id: str, env_kwargs: Mapping[str, Any]) -> dict[str, Any]:
    """Return keyword arguments of a baseline's environment: classical control needs features, no goals."""
    kwargs = {key: value for key, value in env_kwargs.items() if key != "goals"}
    by_features = name == "classical" and controllers_of(env_id)
    return {**kwargs, **({"observation": "features"} if by_features else {})}
