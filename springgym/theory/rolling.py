"""Rolling balls and their impacts; a tippe-top, an egg, Euler's disk, and a rattleback as an ODE."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import ArrayLike

from springgym.checks import TINY, number, shown
from springgym.theory.checking import (
    ROUNDING,
    VECTORS,
    between,
    checked,
    count,
    fit,
    not_negative,
    numbers,
    positive,
    positives,
    principal_moments,
    rotations,
    symmetric,
    units,
)
from springgym.theory.frames import Floats

__all__ = [
    "MOST",
    "SHEAR",
    "TOGETHER",
    "acceleration",
    "after_skidding",
    "after_struck",
    "disk_rate",
    "egg_rise",
    "jellett",
    "needed_friction",
    "off_a_wall",
    "resisted_acceleration",
    "resisted_spin",
    "resisted_way",
    "rolling_ellipsoid",
    "turntable_rate",
]

MOST = 10_000
"""Largest number of steps between two times."""

SHEAR = 1e-3
"""Largest entry of |R R^T - 1|, with R the body's rotation matrix. Beyond it, the steps are too long."""

TOGETHER = 1_000_000
"""Largest number of steps from the first to the last time."""


@checked(angle=between(-math.pi / 2, math.pi / 2), moment=not_negative, gravity=not_negative)
def acceleration(angle: float, moment: float, gravity: float = 9.81) -> float:
    """Return the acceleration of a ball that rolls down a slope, g sin a / (1 + I/(m r^2)), m/s^2.

    Parameters
    ----------
    angle : float
        a of the slope, rad.
    moment : float
        I/(m r^2) about the centre, 2/5 of a solid ball.
    gravity : float
        g, m/s^2.
    """
    return gravity * math.sin(angle) / (1 + moment)


@checked(angle=between(0.0, math.pi / 2), moment=not_negative)
def needed_friction(angle: float, moment: float) -> float:
    """Return the least coefficient of friction by which a ball rolls down a slope, tan a / (1 + m r^2/I)."""
    return math.tan(angle) * moment / (1 + moment)


@checked(
    angle=between(-math.pi / 2, math.pi / 2),
    moment=not_negative,
    resistance=not_negative,
    radius=positive,
    gravity=not_negative,
)
def resisted_acceleration(
    angle: float, moment: float, resistance: float, radius: float, gravity: float = 9.81
) -> float:
    """Return the acceleration of a ball that rolls down a slope from rest with rolling resistance, m/s^2.

    With the couple rho N against its turning, I dw/dt = f r - rho N and m dv/dt = m g sin a - f, so that
    dv/dt = g (sin a - rho/r cos a)/(1 + I/(m r^2)). It stays at rest where tan a is rho/r or less. On level
    ground a rolling ball decelerates at rho g/(r (1 + I/(m r^2))); see `resisted_way`.

    Parameters
    ----------
    angle : float
        a of the slope, rad.
    moment : float
        I/(m r^2) about the centre, 2/5 of a solid ball.
    resistance, radius : float
        rho and r, m.
    gravity : float
        g, m/s^2.
    """
    pull = abs(math.sin(angle)) - resistance / radius * math.cos(angle)
    return math.copysign(gravity * max(pull, 0.0) / (1 + moment), angle)


@checked(speed=not_negative, moment=not_negative, resistance=positive, radius=positive, gravity=positive)
def resisted_way(
    speed: float, moment: float, resistance: float, radius: float, gravity: float = 9.81
) -> tuple[float, float]:
    """Return the distance and the time in which rolling resistance stops a ball on level ground, m and s.

    It slows down by rho g/(r (1 + I/(m r^2))), see `resisted_acceleration`.
    """
    slower = resistance * gravity / (radius * (1 + moment))
    return speed**2 / (2 * slower), speed / slower


@checked(spin=not_negative, moment=not_negative, resistance=positive, radius=positive, gravity=positive)
def resisted_spin(
    spin: float, moment: float, resistance: float, radius: float, gravity: float = 9.81
) -> float:
    """Return the time in which torsional resistance stops a spin about the vertical, I w/(tau m g), s.

    ``moment`` is I/(m r^2), ``resistance`` tau, and ``radius`` r, m.
    """
    return moment * radius**2 * spin / (resistance * gravity)


@checked(speed=not_negative, moment=not_negative, friction=positive, gravity=positive)
def after_skidding(
    speed: float, moment: float, friction: float, gravity: float = 9.81
) -> tuple[float, float]:
    """Return speed and time at which a ball thrown without spin rolls, v / (1 + I/(m r^2)).

    It skids for (v I/(m r^2)) / (mu g (1 + I/(m r^2))). A solid ball keeps 5/7 v for any friction, which acts
    along the line of contact and conserves the angular momentum about it.

    Returns
    -------
    speed, m/s, and time, s
    """
    rolls = speed / (1 + moment)
    return rolls, (speed - rolls) / (friction * gravity)


@checked(velocity=numbers((3,)), line=units((3,)), moment=not_negative, restitution=between(0.0, 1.0))
def after_struck(
    velocity: ArrayLike, line: ArrayLike, moment: float, restitution: float = 1.0
) -> tuple[Floats, Floats]:
    """Return the final velocities of two equal balls after one rolled into the other at rest, m/s.

    Without friction between the balls, (1 + e)/2 of the velocity along the line of centres is transferred,
    and no spin. Friction with the table acts at the lowest point, and so does not change m v - z x I w/r of
    either ball. For a rolling ball that is (1 + I/(m r^2)) m v.

    Parameters
    ----------
    velocity : (3,) array_like
        Velocity of the rolling ball, along the table, m/s.
    line : (3,) array_like
        Unit vector from its centre to that of the other ball.
    moment : float
        I/(m r^2) about the centre, 2/5 of a solid ball.
    restitution : float
        e between the balls.

    Returns
    -------
    velocities of the first ball and of the struck one, each (3,): 2/7 and 5/7 of v for head-on impacts of
    solid balls with e = 1
    """
    came = np.asarray(velocity, float)
    along = np.asarray(line, float)
    if came @ along < 0:
        raise ValueError(f"velocity is {shown(velocity)}; it must not lead away from the ball along the line")
    given = (1 + restitution) / 2 * float(came @ along) / (1 + moment) * along
    return came - given, given


@checked(
    velocity=numbers((3,)),
    omega=numbers((3,)),
    normal=units((3,)),
    radius=positive,
    moment=not_negative,
    friction=not_negative,
    restitution=between(0.0, 1.0),
)
def off_a_wall(
    velocity: ArrayLike,
    omega: ArrayLike,
    normal: ArrayLike,
    radius: float,
    moment: float,
    friction: float,
    restitution: float,
) -> Floats:
    """Return the velocity of a ball after it struck a wall with Coulomb friction, m/s.

    The wall exerts J = m (1 + e) |v_n| along its normal n. Its friction acts against the slip u of the point
    of contact, the part of v - r w x n perpendicular to n. It stops the slip by the impulse
    m u/(1 + m r^2/I), or is mu J if that is less.

    Parameters
    ----------
    velocity, omega, normal : (3,) array_like
        v, m/s, and w, rad/s, before; unit vector n from the wall to the ball.
    radius, moment : float
        r, m, and I/(m r^2).
    friction, restitution : float
        mu and e at this speed.
    """
    v, w, n = (np.asarray(of, float) for of in (velocity, omega, normal))
    towards = float(v @ n)
    if towards > 0:
        raise ValueError(
            f"velocity is {shown(velocity)}; it must not lead away from the wall along the normal"
        )
    slip = v - radius * np.cross(w, n) - towards * n
    speed = float(np.linalg.norm(slip))
    push = -(1 + restitution) * towards
    rub = min(speed * moment / (1 + moment), friction * push)
    return np.asarray(v + push * n - (rub / speed * slip if speed > 0 else 0.0))


@checked(rate=number, moment=not_negative)
def turntable_rate(rate: float, moment: float) -> float:
    """Return the rate at which a ball that rolls on a turning table moves around its circle, rad/s.

    With the table's W, m dv/dt = f and I dw/dt = -r z x f, and v - r w x z = W z x x as it rolls, so that
    dv/dt = W/(1 + m r^2/I) z x v: 2/7 W for a solid ball, on a circle of any radius and centre (Weckesser,
    Am. J. Phys. 65 (1997) 736, doi:10.1119/1.18643).

    Parameters
    ----------
    rate : float
        W of the table, rad/s.
    moment : float
        I/(m r^2) about the centre, 2/5 of a solid ball.
    """
    return rate * moment / (1 + moment)


@checked(angle=between(TINY, math.pi / 2), radius=positive, across=positive, gravity=not_negative)
def disk_rate(angle: float, radius: float, across: float, gravity: float = 9.81) -> float:
    """Return the rate at which a disk that rolls on its rim, centre at rest, rotates about z, rad/s.

    The point of contact and the centre are at rest, so that it turns about the diameter between them:
    L = I_1 W sin a along it. The floor's m g acts R cos a beside the centre, and turns L with W about the
    vertical: m g R cos a = W I_1 W sin a cos a. For a thin disk I_1 = m R^2/4 and W = sqrt(4 g/(R sin a))
    (Euler's disk; Moffatt, Nature 404 (2000) 833, doi:10.1038/35009017).

    Parameters
    ----------
    angle : float
        a between the disk and the floor, rad.
    radius : float
        R, m.
    across : float
        I_1/m about a diameter, m^2.
    gravity : float
        g, m/s^2.
    """
    return math.sqrt(gravity * radius / (across * math.sin(angle)))


@checked(angular_momentum=numbers(*VECTORS), axis=units(*VECTORS), radius=positive, offset=not_negative)
def jellett(angular_momentum: ArrayLike, axis: ArrayLike, radius: float, offset: float) -> Floats:
    """Return Jellett's constant of a tippe-top, L . (r z - a e), kg m^3/s, which friction does not change.

    r z - a e is the arm from the point that touches to the centre of mass, of a sphere whose centre lies a e
    from it. All forces act at that point, so that dL/dt has no part along the arm; and L . d(arm)/dt is
    -a L . (w x e), which is 0 of a body that is symmetric about e (Cohen, Am. J. Phys. 45 (1977) 12,
    doi:10.1119/1.10926).

    Parameters
    ----------
    angular_momentum : (..., 3) array_like
        L about the centre of mass, kg m^2/s.
    axis : (..., 3) array_like
        e, unit vectors from the centre of mass to that of the sphere.
    radius, offset : float
        r of the sphere, and a, m.
    """
    spin = np.asarray(angular_momentum, float)
    up = np.asarray(axis, float)
    fit(angular_momentum=spin, axis=up)
    arm = radius * np.array([0.0, 0.0, 1.0]) - offset * up
    return np.asarray((spin * arm).sum(axis=-1))


@checked(
    start=between(0.0, math.pi / 2),
    end=between(0.0, math.pi / 2),
    semi_axes=positives((2,)),
    jellett=positive,
    weight=positive,
    friction=positive,
)
def egg_rise(
    start: float, end: float, semi_axes: tuple[float, float], jellett: float, weight: float, friction: float
) -> float:
    """Return the time in which a spinning spheroid rises from one tilt to another, s.

    While it spins fast and slides, J = -L . rho of the point rho that touches hardly changes, and the tilt t
    of its axis from the vertical obeys J dt/dt = -mu m g h^2, with the height h^2 = a^2 cos^2 t + b^2 sin^2 t
    of its centre. So arctan(b/a tan t) falls at the rate a b mu m g/J (Moffatt & Shimomura, Nature 416 (2002)
    385, doi:10.1038/416385a).

    Parameters
    ----------
    start, end : float
        Initial (greater) and final tilt, rad.
    semi_axes : (2,)
        a along the axis of symmetry and b across it, m.
    jellett : float
        J, kg m^2/s.
    weight, friction : float
        m g, N, and mu.
    """
    if end > start:
        raise ValueError(f"end is {end} rad; it must be at most the start, {start} rad")
    a, b = (float(axis) for axis in semi_axes)
    turned = [math.atan2(b * math.sin(tilt), a * math.cos(tilt)) for tilt in (start, end)]
    return (turned[0] - turned[1]) * jellett / (a * b * friction * weight)


@checked(
    semi_axes=positives((3,)),
    inertia=numbers((3, 3)),
    offset=numbers((3,)),
    frame=rotations((3, 3)),
    omega=numbers((3,)),
    times=numbers((None,)),
    gravity=not_negative,
    steps=count(1, MOST),
)
def rolling_ellipsoid(
    semi_axes: ArrayLike,
    inertia: ArrayLike,
    offset: ArrayLike,
    frame: ArrayLike,
    omega: ArrayLike,
    times: ArrayLike,
    gravity: float = 9.81,
    steps: int = 10,
) -> tuple[Floats, Floats]:
    """Return the rotation of a rigid ellipsoid that rolls on a level floor without slipping and without loss.

    With rho from the centre of mass to the point that touches and J = I/m + rho^2 1 - rho rho^T,
    J dw/dt = -w x (I/m) w + rho x (g z - w x d rho/dt): angular momentum about the point that touches
    (Kane & Levinson, Int. J. Non-Linear Mech. 17 (1982) 175, doi:10.1016/0020-7462(82)90017-8, of which this
    is the vector form). By Runge and Kutta's method of fourth order.

    Parameters
    ----------
    semi_axes : (3,) array_like
        Along the body's axes, m.
    inertia : (3, 3) array_like
        I/m about the centre of mass in the body's axes, m^2.
    offset : (3,) array_like
        From the centre of mass to that of the ellipsoid, in the body's axes, m.
    frame : (3, 3) array_like
        The body's axes at the start, in columns.
    omega : (3,) array_like
        w at the start, world axes, rad/s.
    times : (T,) array_like
        Equally spaced times from the start, s.
    gravity : float
        g, m/s^2.
    steps : int
        Number of steps between two times.

    Returns
    -------
    angular velocities (T, 3), rad/s, and frames (T, 3, 3)

    Raises
    ------
    ValueError
        If times are not equally spaced, the inertia is of no body, or the steps do not resolve the motion.
    """
    moments = np.asarray(times, float)
    gaps = np.diff(moments)
    if not len(gaps) or gaps[0] <= 0 or abs(gaps - gaps[0]).max() > ROUNDING * gaps[0]:
        raise ValueError(f"times is {shown(times)}; it must be two times or more that rise by equal steps")
    if steps * len(gaps) > TOGETHER:
        raise ValueError(
            f"steps is {steps}; it must be at most {TOGETHER // len(gaps)} for {len(gaps)} times"
        )
    _check_tensor(np.asarray(inertia, float))
    matrix = np.diag(np.asarray(semi_axes, float) ** 2)
    tensor = np.asarray(inertia, float)
    arm = np.asarray(offset, float)
    up = np.array([0.0, 0.0, 1.0])

    def slope(turn: Floats, w: Floats) -> tuple[Floats, Floats]:
        g = turn.T @ up
        pull = matrix @ g
        change = -matrix @ np.cross(turn.T @ w, g)
        size = math.sqrt(float(g @ pull))
        rho = turn @ (arm - pull / size)
        moves = np.cross(w, rho) - turn @ (change / size - pull * (float(g @ change) / size**3))
        own = turn @ tensor @ turn.T
        whole = own + float(rho @ rho) * np.eye(3) - np.outer(rho, rho)
        moment = np.cross(rho, gravity * up - np.cross(w, moves)) - np.cross(w, own @ w)
        return np.cross(w, turn.T).T, np.linalg.solve(whole, moment)

    h = float(moments[1] - moments[0]) / steps
    turn = np.array(frame, float)
    w = np.array(omega, float)
    found = [(w, turn)]
    try:
        with np.errstate(over="raise", invalid="raise"):
            for _ in range(len(moments) - 1):
                for _ in range(steps):
                    t1, w1 = slope(turn, w)
                    t2, w2 = slope(turn + h / 2 * t1, w + h / 2 * w1)
                    t3, w3 = slope(turn + h / 2 * t2, w + h / 2 * w2)
                    t4, w4 = slope(turn + h * t3, w + h * w3)
                    turn = turn + h / 6 * (t1 + 2 * t2 + 2 * t3 + t4)
                    w = w + h / 6 * (w1 + 2 * w2 + 2 * w3 + w4)
                if abs(turn @ turn.T - np.eye(3)).max() > SHEAR:
                    raise OverflowError
                found.append((w, turn))
    except (FloatingPointError, OverflowError):
        raise ValueError(f"steps is {steps}; these are too few for so fast a motion") from None
    return np.array([w for w, _ in found]), np.array([turn for _, turn in found])


def _check_tensor(inertia: Floats) -> None:
    """Raise ValueError if an inertia tensor (3, 3) is of no body."""
    principal_moments("inertia", np.linalg.eigvalsh(symmetric("inertia", inertia)))
