"""Heavy symmetric top with one point fixed (Lagrange's top).

Angles are those of `frames.euler_zxz`: theta is the tilt of the axis from the upward vertical, phi
its azimuth, psi the rotation about it; omega3 = psi_dot + phi_dot cos(theta) is constant. With
u = cos(theta) the tilt obeys u_dot^2 = f(u), where

    f(u) = (1 - u^2)(alpha - beta u) - (b - a u)^2
    a = I3 omega3 / I1,  b = L_z / I1,  beta = 2 Mgl / I1,  alpha = 2 (E - I3 omega3^2 / 2) / I1

with roots u1 <= u2 <= 1 <= u3, so that u swings between u1 and u2.

Sources: Goldstein, Poole & Safko, *Classical Mechanics*, 3rd ed., section 5.7; Whittaker,
*Analytical Dynamics*, 4th ed., chapter VI (elliptic solution); Landau & Lifshitz, *Mechanics*,
3rd ed., section 35, problems 1-3.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from springgym.checks import TINY, number
from springgym.theory.checking import (
    ANY,
    FRAMES,
    ROUNDING,
    VECTORS,
    between,
    checked,
    instance_of,
    not_zero,
    numbers,
    positive,
    rotations,
)
from springgym.theory.elliptic import complete_k, incomplete_f, jacobi, third_kind
from springgym.theory.frames import Floats, euler_zxz

__all__ = [
    "Constants",
    "HeavyTop",
    "TopMotion",
    "TopState",
    "cone_top_inertia",
    "constants",
    "cubic",
    "effective_potential",
    "motion",
    "nutation_frequency",
    "nutation_period",
    "sleeping_threshold",
    "steady_precession",
    "turning_points",
]


@checked(i1=positive, i3=positive, mgl=positive)
@dataclass(frozen=True)
class HeavyTop:
    """A rigid symmetric top about its fixed point.

    Attributes
    ----------
    i1, i3 : float
        Moments of inertia about the fixed point, across and along the axis, kg m^2.
    mgl : float
        Weight times distance from the fixed point to the centre of mass, N m.

    Raises
    ------
    ValueError
        If I3 is more than 2 I1, as of no body.
    """

    i1: float
    i3: float
    mgl: float

    def __post_init__(self) -> None:
        if self.i3 > 2 * self.i1 * (1 + ROUNDING):
            raise ValueError(f"i3 is {self.i3}; it must be at most twice i1, {self.i1}, as of any body")


@checked(theta=between(0.0, math.pi), omega3=number, theta_dot=number, phi_dot=number, phi=number, psi=number)
@dataclass(frozen=True)
class TopState:
    """Initial motion of a top; the defaults are a spinning top released at rest (cusps).

    Attributes
    ----------
    theta : float
        Tilt, rad, 0 <= theta <= pi.
    omega3 : float
        Component of the angular velocity along the axis, rad/s.
    theta_dot, phi_dot : float
        Rates of tilt and azimuth, rad/s.
    phi, psi : float
        Azimuth and spin angle, rad.
    """

    theta: float
    omega3: float
    theta_dot: float = 0.0
    phi_dot: float = 0.0
    phi: float = 0.0
    psi: float = 0.0


@checked(a=number, b=number, alpha=number, beta=positive)
class Constants(NamedTuple):
    """Constants of f(u): a, b in 1/s, alpha, beta in 1/s^2."""

    a: float
    b: float
    alpha: float
    beta: float


@checked(
    theta=numbers(*ANY),
    phi=numbers(*ANY),
    psi=numbers(*ANY),
    theta_dot=numbers(*ANY),
    phi_dot=numbers(*ANY),
    attitude=rotations(*FRAMES),
    omega_world=numbers(*VECTORS),
)
class TopMotion(NamedTuple):
    """Motion at the requested times, of their shape S.

    `theta`, `phi`, `psi`, rad, and `theta_dot`, `phi_dot`, rad/s; `attitude`, shape S + (3, 3), from
    body to world; `omega_world`, shape S + (3,), rad/s. Where the axis goes exactly through the
    vertical, theta runs on past 0 or pi instead of phi jumping by pi; the frame is smooth always.
    """

    theta: Floats
    phi: Floats
    psi: Floats
    theta_dot: Floats
    phi_dot: Floats
    attitude: Floats
    omega_world: Floats


@checked(mass=positive, radius=positive, height=positive, gravity=positive)
def cone_top_inertia(mass: float, radius: float, height: float, gravity: float = 9.81) -> HeavyTop:
    """Return the paper's top about its tip: I3 = M r^2/2, I1 = M (3 h^2/4 + r^2/4), Mgl = 3/4 Mgh.

    A ring of total mass M/2 and radius r (m) at `height` h (m) above the fixed tip of mass M/4,
    and a crown of mass M/4 at height h, with M in kg and gravity in m/s^2. The ring needs three
    equal masses or more.

    Source: sums of m r^2 over the masses of McDonald, *On flexible body approximations of rigid
    body dynamics*, section on the top.
    """
    return HeavyTop(
        i1=mass * (0.75 * height**2 + 0.25 * radius**2),
        i3=0.5 * mass * radius**2,
        mgl=0.75 * mass * gravity * height,
    )


@checked(top=instance_of(HeavyTop), state=instance_of(TopState))
def constants(top: HeavyTop, state: TopState) -> Constants:
    """Return constants a, b, alpha, beta of f(u) (Goldstein section 5.7)."""
    u = math.cos(state.theta)
    sin2 = math.sin(state.theta) ** 2
    a = top.i3 * state.omega3 / top.i1
    beta = 2 * top.mgl / top.i1
    return Constants(
        a=a,
        b=a * u + sin2 * state.phi_dot,
        alpha=state.theta_dot**2 + sin2 * state.phi_dot**2 + beta * u,
        beta=beta,
    )


@checked(u=numbers(*ANY), of=instance_of(Constants))
def cubic(u: ArrayLike, of: Constants) -> Floats:
    """Return f(u) = (1 - u^2)(alpha - beta u) - (b - a u)^2 = u_dot^2, 1/s^2 (Goldstein section 5.7)."""
    u = np.asarray(u, float)
    return (1 - u**2) * (of.alpha - of.beta * u) - (of.b - of.a * u) ** 2


@checked(theta=numbers(*ANY, low=TINY, high=math.pi), top=instance_of(HeavyTop), state=instance_of(TopState))
def effective_potential(theta: ArrayLike, top: HeavyTop, state: TopState) -> Floats:
    """Return V(theta) = I1 (b - a cos theta)^2 / (2 sin^2 theta) + Mgl cos theta, J.

    I1 theta_dot^2 / 2 + V(theta) is constant. `state` gives the constants a and b; theta in rad
    must not be a multiple of pi. Source: Goldstein section 5.7.
    """
    of = constants(top, state)
    theta = np.asarray(theta, float)
    lift = (of.b - of.a * np.cos(theta)) / np.sin(theta)
    return np.asarray(0.5 * top.i1 * lift**2 + top.mgl * np.cos(theta))


class _Roots(NamedTuple):
    """Roots of f by their distances from 1 and -1, each free of cancellation."""

    below: tuple[float, float]  # 1 - u1, 1 - u2
    above: tuple[float, float]  # 1 + u1, 1 + u2
    third: float  # u3 - 1
    fall: float  # u0 - u1
    rise: float  # u2 - u0
    poles: tuple[float, float]  # b - a, b + a

    @property
    def m1(self) -> float:
        return min((self.third + self.below[1]) / (self.third + self.below[0]), 1.0)


def _roots(top: HeavyTop, state: TopState) -> _Roots:
    """Return roots from f expanded about u0, whose coefficients are known without cancellation.

    f(u0 + x) = c0 + c1 x + c2 x^2 + beta x^3. The largest root x3 comes by Newton's method from
    above (monotone), the other two from x^2 + p x + q with q <= 0. The identities
    f(1) = -(b - a)^2 and f(-1) = -(b + a)^2 give 1 - u2 and 1 + u1 near the poles.
    """
    a, _, _, beta = constants(top, state)
    u = math.cos(state.theta)
    down = 2 * math.sin(state.theta / 2) ** 2
    up = 2 * math.sin((math.pi - state.theta) / 2) ** 2
    sin2 = down * up
    low = sin2 * state.phi_dot - a * down
    high = sin2 * state.phi_dot + a * up
    # a pole missed by less than 1e-30 is met, an amplitude below 1e-50 is none: squares underflow
    poles = low if low**2 > 1e-60 * beta else 0.0, high if high**2 > 1e-60 * beta else 0.0
    c0 = sin2 * state.theta_dot**2
    turn = 2 * a * state.phi_dot - beta - 2 * u * state.phi_dot**2
    c1 = sin2 * turn - 2 * u * state.theta_dot**2
    c2 = 2 * beta * u - a**2 - state.theta_dot**2 - sin2 * state.phi_dot**2
    if c0 + abs(c1) < 1e-100 * beta:  # steady: u0 is a double root
        return _Roots((down, down), (up, up), -c2 / beta - down, 0.0, 0.0, poles)
    x3 = 1 + max(abs(c0), abs(c1), abs(c2)) / beta
    while True:
        value = ((beta * x3 + c2) * x3 + c1) * x3 + c0
        slope = (3 * beta * x3 + 2 * c2) * x3 + c1
        if value <= 0 or slope <= 0 or x3 - value / slope >= x3:
            break
        x3 -= value / slope
    x3 = max(x3, down)
    p = -(c0 / x3 + c1) / (beta * x3)
    q = -c0 / (beta * x3)
    large = abs(p) / 2 + math.sqrt(p**2 / 4 - q)
    small = -q / large
    fall, rise = (large, small) if p >= 0 else (small, large)
    below = [down + fall, max(down - rise, 0.0)]
    third = x3 - down
    product = poles[0] ** 2 / (beta * below[0])  # (1 - u2)(u3 - 1)
    if third >= below[1] and third > 0:
        below[1] = product / third
    elif below[1] > 0:
        third = product / below[1]
    above = up + rise
    lowest = poles[1] ** 2 / (beta * above * (2 + third))
    return _Roots((below[0], below[1]), (lowest, above), third, fall, rise, poles)


@checked(top=instance_of(HeavyTop), state=instance_of(TopState))
def turning_points(top: HeavyTop, state: TopState) -> tuple[float, float, float]:
    """Return roots u1 <= u2 <= u3 of f(u): the axis swings between arccos(u1) and arccos(u2).

    Returns
    -------
    u1, u2, u3 : float
        Cosines, with u3 outside the motion. At a steady precession u1 = u2 = cos(theta), and u3
        lies below them only for the axis balanced upright under the sleeping threshold.

    Source: Goldstein section 5.7; Whittaker chapter VI.
    """
    roots = _roots(top, state)
    return roots.above[0] - 1, 1 - roots.below[1], 1 + roots.third


@checked(top=instance_of(HeavyTop), theta=between(0.0, math.pi), omega3=number)
def steady_precession(top: HeavyTop, theta: float, omega3: float) -> tuple[float, float]:
    """Return both rates of steady precession: I1 cos(theta) W^2 - I3 omega3 W + Mgl = 0.

    W = [I3 omega3 +- sqrt(I3^2 omega3^2 - 4 I1 Mgl cos theta)] / (2 I1 cos theta)

    Parameters
    ----------
    theta, omega3 : float
        Tilt, rad, and spin about the axis, rad/s.

    Returns
    -------
    slow, fast : float
        In rad/s, |slow| <= |fast|; fast is infinite for a horizontal axis.

    Raises
    ------
    ValueError
        If the spin is too slow for any steady precession at this tilt.

    Source: Goldstein section 5.7.
    """
    momentum = top.i3 * omega3
    cosine = math.cos(theta)
    square = momentum**2 - 4 * top.i1 * top.mgl * cosine
    if square < 0 or (square == 0 and momentum == 0):
        least = 2 * math.sqrt(max(top.i1 * top.mgl * cosine, 0.0)) / top.i3
        raise ValueError(
            f"no steady precession at theta = {theta} rad with omega3 = {omega3} rad/s: "
            f"it needs |omega3| >= {least:.6g} rad/s"
        )
    sum_ = momentum + math.copysign(math.sqrt(square), momentum)
    fast = sum_ / (2 * top.i1 * cosine) if cosine != 0 else math.copysign(math.inf, sum_)
    return 2 * top.mgl / sum_, fast


@checked(top=instance_of(HeavyTop), theta=between(0.0, math.pi), precession=not_zero)
def nutation_frequency(top: HeavyTop, theta: float, precession: float) -> float:
    """Return the angular frequency of small nutation about a steady precession W, rad/s.

    omega_n^2 = [(Mgl)^2 - 2 I1 Mgl W^2 cos(theta) + I1^2 W^4] / (I1 W)^2

    Parameters
    ----------
    theta, precession : float
        Tilt, rad, and rate of steady precession W, rad/s (not zero).

    Source: -f''(u)/2 at the double root; for a fast top it tends to I3 omega3 / I1
    at the slow root.
    """
    push = top.mgl / (top.i1 * precession)
    turn = precession
    return math.sqrt(push**2 - 2 * push * turn * math.cos(theta) + turn**2)


@checked(top=instance_of(HeavyTop), state=instance_of(TopState))
def nutation_period(top: HeavyTop, state: TopState) -> float:
    """Return the period of the tilt, T = 4 K(k) / sqrt(beta (u3 - u1)), k^2 = (u2 - u1)/(u3 - u1), s.

    It is infinite on the separatrix (an axis that creeps to the upright) and for an axis balanced
    upright below the sleeping threshold. At a steady precession, it is the period of small nutation.

    Source: Whittaker chapter VI.
    """
    roots = _roots(top, state)
    span = roots.third + roots.below[0]
    if span <= 0:
        return math.inf
    return 4 * complete_k(roots.m1) / math.sqrt(constants(top, state).beta * span)


@checked(top=instance_of(HeavyTop))
def sleeping_threshold(top: HeavyTop) -> float:
    """Return the spin above which the upright top is stable, omega3 = 2 sqrt(Mgl I1) / I3, rad/s.

    For the cone top omega3^2 = 3 g h (3 h^2 + r^2) / r^4. Source: Goldstein section 5.7;
    Landau & Lifshitz section 35, problem 2.
    """
    return 2 * math.sqrt(top.mgl * top.i1) / top.i3


@checked(top=instance_of(HeavyTop), state=instance_of(TopState), t=numbers(*ANY))
def motion(top: HeavyTop, state: TopState, t: ArrayLike) -> TopMotion:
    """Return the exact motion from `state` at time 0, in Jacobi functions and integrals of the third kind.

    u(t) = u1 + (u2 - u1) sn^2(w), w = w0 + t sqrt(beta (u3 - u1))/2
    phi_dot = [(b - a)/(1 - u) + (b + a)/(1 + u)] / 2
    psi_dot = omega3 - a - [(b - a)/(1 - u) - (b + a)/(1 + u)] / 2

    The result is accurate to about 1e-12 away from the separatrix, for any number of turns. This function
    needs SciPy.

    Parameters
    ----------
    t : array_like, shape S
        Times, s.

    Returns
    -------
    TopMotion
        Angles, frame and angular velocity; `frames.carry` turns them into particles.

    Source: Whittaker chapter VI; integrals by Carlson's forms, DLMF 19.25.
    """
    of = constants(top, state)
    roots = _roots(top, state)
    t = np.asarray(t, float)
    low, high = roots.poles
    if roots.fall == 0 and roots.rise == 0:
        flat = np.zeros_like(t)
        sine = np.full_like(t, math.sin(state.theta / 2))
        cosine = flat + math.sqrt(roots.above[0] / 2)
        theta_dot = flat
        near = 0.5 * low / roots.below[0] * t if low else flat
        far = 0.5 * high / roots.above[0] * t if high else flat
    else:
        rate = math.sqrt(of.beta * (roots.third + roots.below[0])) / 2
        side = -1.0 if state.theta_dot > 0 else 1.0
        start = side * incomplete_f(math.sqrt(roots.fall), math.sqrt(roots.rise), roots.m1)
        begin = jacobi(np.asarray(start), roots.m1)
        now = jacobi(start + rate * t, roots.m1)

        def integral(distances: tuple[float, float]) -> Floats:
            ends = third_kind(now, roots.m1, *distances), third_kind(begin, roots.m1, *distances)
            return (ends[0] - ends[1]) / rate

        near = 0.5 * low * integral(roots.below) if low else np.zeros_like(t)
        far = 0.5 * high * integral(roots.above) if high else np.zeros_like(t)
        # sin and cos of theta/2; one that reaches zero keeps its sign change
        if roots.below[1] == 0:
            sine = math.sqrt(roots.below[0] / 2) * now.cn
            cn_over_sine = np.full_like(t, math.sqrt(2 / roots.below[0]))
        else:
            sine = np.sqrt((roots.below[0] * now.cn**2 + roots.below[1] * now.sn**2) / 2)
            cn_over_sine = now.cn / sine
        if roots.above[0] == 0:
            cosine = side * math.sqrt(roots.above[1] / 2) * now.sn
            sn_over_cosine = np.full_like(t, side * math.sqrt(2 / roots.above[1]))
        else:
            cosine = np.sqrt((roots.above[0] * now.cn**2 + roots.above[1] * now.sn**2) / 2)
            sn_over_cosine = now.sn / cosine
        swing = rate * (roots.fall + roots.rise)
        theta_dot = -swing * now.dn * sn_over_cosine * cn_over_sine

    theta = 2 * np.arctan2(sine, cosine)
    phi = state.phi + near + far
    psi = state.psi + (state.omega3 - of.a) * t - near + far
    phi_dot = np.zeros_like(t)
    if low:
        phi_dot = phi_dot + low / (4 * sine**2)
    if high:
        phi_dot = phi_dot + high / (4 * cosine**2)
    frame = euler_zxz(phi, theta, psi)
    cf = np.cos(phi)
    sf = np.sin(phi)
    ct = np.cos(theta)
    st = np.sin(theta)
    across = np.stack([-ct * sf, ct * cf, st], axis=-1)
    node = np.stack([cf, sf, np.zeros_like(t)], axis=-1)
    omega = theta_dot[..., None] * node + (phi_dot * st)[..., None] * across + state.omega3 * frame[..., :, 2]
    return TopMotion(theta, phi, psi, theta_dot, phi_dot, frame, omega)
