"""Euler's free body: an asymmetric body turning without torque.

I1 w1_dot = (I2 - I3) w2 w3 and cyclic, in the principal frame. Kinetic energy T and angular
momentum L are constant; the body circulates about its major axis where L^2 > 2 T I2 and about its
minor axis where L^2 < 2 T I2. Moments may be given in any order and need not differ.

Sources: Landau & Lifshitz, *Mechanics*, 3rd ed., section 37; Whittaker, *Analytical Dynamics*,
4th ed., chapter VI.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from springgym.checks import number
from springgym.theory.checking import (
    ANY,
    FRAMES,
    VECTORS,
    checked,
    numbers,
    optional,
    positive,
    principal_moments,
    rotations,
)
from springgym.theory.elliptic import Jacobi, complete_k, incomplete_f, jacobi, third_kind
from springgym.theory.frames import Floats, euler_zxz

__all__ = ["FreeMotion", "corner_box_inertia", "flip_interval", "growth_rate", "motion"]


@checked(omega_body=numbers(*VECTORS), omega_world=numbers(*VECTORS), attitude=rotations(*FRAMES))
class FreeMotion(NamedTuple):
    """Motion at times of shape S.

    `omega_body`, shape S + (3,), in the principal frame, and `omega_world`, rad/s; `attitude`, shape
    S + (3, 3), from principal to world coordinates.
    """

    omega_body: Floats
    omega_world: Floats
    attitude: Floats


@checked(mass=positive, edges=numbers((3,), low=0.0))
def corner_box_inertia(mass: float, edges: ArrayLike) -> Floats:
    """Return the inertia of eight equal corner masses: I_x = M (b^2 + c^2)/4 and cyclic, kg m^2.

    Parameters
    ----------
    mass : float
        Total mass M, kg.
    edges : array_like, shape (3,)
        Edge lengths a, b, c along x, y, z, m.

    Source: sum of m (y^2 + z^2) over corners at (+-a/2, +-b/2, +-c/2).
    """
    squares = np.asarray(edges, float) ** 2
    return np.asarray(mass / 4 * (squares.sum() - squares))


@checked(inertia=principal_moments, spin=number)
def growth_rate(inertia: ArrayLike, spin: float) -> float:
    """Return the rate at which a disturbance of spin about the middle axis grows, 1/s.

    |w2| sqrt((I2 - I1)(I3 - I2) / (I1 I3)), I1 <= I2 <= I3 the sorted moments.

    Parameters
    ----------
    inertia : array_like, shape (3,)
        Principal moments in any order, kg m^2.
    spin : float
        Angular velocity about the middle axis, rad/s.

    Source: Euler's equations linearised; Landau & Lifshitz section 37.
    """
    low, middle, high = np.sort(np.asarray(inertia, float))
    return float(abs(spin) * math.sqrt((middle - low) * (high - middle) / (low * high)))


@dataclass(frozen=True)
class _Circulation:
    """Motion about axis c of axes (a, b, c) = turn @ principal axes; b is the middle one.

    omega = (A cn, B sn, C dn)(start + rate t), its amplitudes signed.
    """

    turn: Floats
    moments: Floats
    amplitudes: Floats
    rate: float
    m1: float
    start: float


def _circulation(inertia: Floats, omega: Floats) -> _Circulation | None:
    """Return constants of the Jacobi solution; None for a steady spin (omega parallel to I omega).

    With c the axis circulated about, D_j = L^2 - 2 T I_j:
    rate^2 = (I_c - I_b) D_a / (I_a I_b I_c), 1 - k^2 = (I_c - I_a) D_b / ((I_c - I_b) D_a).
    """
    floor = 1e-100 * max(1.0, abs(omega).max())  # squares of less would underflow
    omega = np.where(abs(omega) < floor, 0.0, omega)
    order = np.argsort(inertia)
    difference = inertia - np.roll(inertia, 1)
    other = np.roll(omega, 1)
    if not (difference * omega * other).any():
        return None
    gaps = inertia * (inertia - inertia[order[1]])  # D_b = sum of gaps w^2
    if inertia[order[2]] == inertia[order[1]] or gaps @ omega**2 < 0:
        order = order[::-1]
    turn = np.eye(3)[order]
    turn *= np.linalg.det(turn).round()
    moments = inertia[order]
    spin = turn @ omega
    ia, ib, ic = moments
    d_a, d_b, d_c = (float(moments * (moments - other) @ spin**2) for other in moments)
    amplitude = np.sqrt([d_c / (ia * (ia - ic)), d_c / (ib * (ib - ic)), d_a / (ic * (ic - ia))])
    first = math.copysign(1.0, spin[0])
    last = math.copysign(1.0, spin[2])
    signs = np.array([first, first * last * math.copysign(1.0, ic - ib), last])
    m1 = min((ic - ia) * d_b / ((ic - ib) * d_a), 1.0)
    rate = math.sqrt((ic - ib) * d_a / (ia * ib * ic))
    start = incomplete_f(signs[1] * spin[1] / amplitude[1], abs(spin[0]) / amplitude[0], m1)
    return _Circulation(turn, moments, signs * amplitude, rate, m1, start)


@checked(inertia=principal_moments, omega=numbers((3,)))
def flip_interval(inertia: ArrayLike, omega: ArrayLike) -> float:
    """Return the time between reversals of the middle component, 2 K(k) / p, s.

    For L^2 > 2 T I2:  p = sqrt((I3 - I2)(L^2 - 2 T I1) / (I1 I2 I3)),
    k^2 = (I2 - I1)(2 T I3 - L^2) / ((I3 - I2)(L^2 - 2 T I1)); else with 1 and 3 exchanged.
    This function needs SciPy.

    Parameters
    ----------
    inertia : array_like, shape (3,)
        Principal moments in any order, kg m^2.
    omega : array_like, shape (3,)
        Angular velocity in the principal frame, rad/s.

    Returns
    -------
    float
        Infinite for a steady spin and on the separatrix L^2 = 2 T I2.

    Source: Landau & Lifshitz section 37.
    """
    solution = _circulation(np.asarray(inertia, float), np.asarray(omega, float))
    return math.inf if solution is None else 2 * complete_k(solution.m1) / solution.rate


@checked(inertia=principal_moments, omega=numbers((3,)), t=numbers(*ANY), frame=optional(rotations((3, 3))))
def motion(inertia: ArrayLike, omega: ArrayLike, t: ArrayLike, frame: ArrayLike | None = None) -> FreeMotion:
    """Return the exact motion: Jacobi functions for omega, an integral of the third kind for the frame.

    About axis c (the major axis where L^2 > 2 T I2, else the minor one), with Euler angles about
    the fixed L:  cos(theta) = I_c w_c / L, tan(psi) = I_a w_a / (I_b w_b) and

    phi_dot = (L / I_c) [1 + 1 / (I_a cn^2 / (I_c - I_a) + I_b sn^2 / (I_c - I_b))]

    The result is accurate to about 1e-12 away from the separatrix. This function needs SciPy.

    Parameters
    ----------
    inertia : array_like, shape (3,)
        Principal moments in any order, kg m^2.
    omega : array_like, shape (3,)
        Angular velocity at time 0 in the principal frame, rad/s.
    t : array_like, shape S
        Times, s.
    frame : array_like, shape (3, 3), optional
        Rotation from principal to world coordinates at time 0; the identity by default.

    Returns
    -------
    FreeMotion

    Source: Landau & Lifshitz section 37.
    """
    inertia, omega, t = (np.asarray(given, float) for given in (inertia, omega, t))
    first = np.eye(3) if frame is None else np.asarray(frame, float)
    solution = _circulation(inertia, omega)
    if solution is None:
        return _steady(omega, t, first)
    ia, ib, ic = solution.moments
    p = ia / (ic - ia)
    q = ib / (ic - ib)
    momentum = float(np.linalg.norm(inertia * omega))
    side = math.copysign(1.0, p)

    def at(time: Floats) -> tuple[Floats, Floats]:
        now = jacobi(solution.start + solution.rate * time, solution.m1)
        spin = solution.amplitudes * np.stack([now.cn, now.sn, now.dn], axis=-1)
        l_a, l_b, l_c = np.moveaxis(solution.moments * spin, -1, 0)
        wind = side * _wound(solution, abs(p), abs(q), now, solution.rate * time) / solution.rate
        phi = momentum / ic * (time + wind)
        angles = euler_zxz(phi, np.arctan2(np.hypot(l_a, l_b), l_c), np.arctan2(l_a, l_b))
        return spin @ solution.turn, angles @ solution.turn

    spin, turned = at(t)
    turned = first @ at(np.zeros(()))[1].T @ turned
    return FreeMotion(spin, np.einsum("...ij,...j->...i", turned, spin), turned)


def _wound(solution: _Circulation, p: float, q: float, now: Jacobi, phase: Floats) -> Floats:
    """Return the integral of du / (p cn^2 + q sn^2) from `start` to `start` + phase.

    Two integrals from 0 would cancel over a small phase; there it is Gauss's quadrature, whose error is
    below round-off while the nearest pole, about sqrt(p/q) or sqrt(q/p) off, is ten times as far.
    """
    start = np.asarray(solution.start)
    m1 = solution.m1
    wound = third_kind(now, m1, p, q) - third_kind(jacobi(start, m1), m1, p, q)
    small = abs(phase) < 0.1 * math.sqrt(min(p / q, q / p))
    if not small.any():
        return wound
    nodes, weights = np.polynomial.legendre.leggauss(12)
    between = jacobi(start + np.where(small, phase, 0.0)[..., None] * (1 + nodes) / 2, m1)
    mean = (1 / (p * between.cn**2 + q * between.sn**2)) @ weights / 2
    return np.where(small, phase * mean, wound)


def _steady(omega: Floats, t: Floats, first: Floats) -> FreeMotion:
    """Return a uniform rotation by Rodrigues' formula."""
    speed = float(np.linalg.norm(omega))
    x, y, z = omega / speed if speed else omega
    cross = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    angle = (speed * t)[..., None, None]
    frame = first @ (np.eye(3) + np.sin(angle) * cross + (1 - np.cos(angle)) * cross @ cross)
    spin = np.broadcast_to(omega, (*t.shape, 3)).copy()
    return FreeMotion(spin, spin @ first.T, frame)
