"""The wave of dominoes, against the laws of energy and of motion that it follows from."""

import math

import numpy as np
import pytest
from scipy.integrate import quad, solve_ivp

from springgym.theory import dominoes

H = 0.048
D = 0.0075
S = 0.0144
G = 9.81
INERTIA = (H * H + D * D) / 3
START = 7.0
LAST = math.asin(S / H)


def test_without_friction_the_energy_is_kept_from_impact_to_impact():
    hits = dominoes.impacts(4, H, D, S, INERTIA, START, G)

    def of(angle, train):
        angles, rates = dominoes.leaning(angle, train, H, D, S)
        return (H * np.cos(angles) + D * np.sin(angles)).sum() / 2, (rates**2).sum()

    rate = START
    times = []
    for train in range(1, 5):
        high, together = of(0.0, train)
        energy = INERTIA * together * rate**2 / 2 + G * high

        def speed(angle, train=train, energy=energy):
            high, together = of(angle, train)
            return math.sqrt(2 * (energy - G * high) / (INERTIA * together))

        times.append(quad(lambda angle, speed=speed: 1 / speed(angle), 0, LAST, epsabs=0, epsrel=1e-11)[0])
        together = of(LAST, train)[1]
        rate = speed(LAST) * together / (together + 1)
    # Simpson's rule and Runge and Kutta's in 40 parts, and differences of 1e-5
    assert np.diff(hits, prepend=0.0) == pytest.approx(times, rel=1e-7)


@pytest.mark.parametrize("friction", [0.0, 0.2, 0.5])
def test_two_dominoes_move_as_their_forces_say(friction):
    """With the push N found from the constraint at each moment, and so the impulse at the impact."""
    pitch = S + D

    def constraint(behind, ahead):
        """Derivatives of h sin δ − (s + d) cos θ by both angles, and of second order along rates."""
        lean = behind - ahead
        first = np.array([H * math.cos(lean), -H * math.cos(lean) + pitch * math.sin(ahead)])

        def second(rates):
            return -H * math.sin(lean) * (rates[0] - rates[1]) ** 2 + pitch * math.cos(ahead) * rates[1] ** 2

        return first, second

    def moments(behind, ahead):
        """Of a push of 1 N on both."""
        lean = behind - ahead
        arm = H * math.cos(lean) - pitch * math.sin(ahead)
        return np.array([-H * (math.cos(lean) + friction * math.sin(lean)), arm - friction * D])

    def slope(_, y):
        angles = y[:2]
        rates = y[2:]
        first, second = constraint(*angles)
        free = 0.5 * G / INERTIA * (H * np.sin(angles) - D * np.cos(angles))
        pushed = moments(*angles)
        push = -(first @ free + second(rates)) / (first @ pushed)
        return np.concatenate([rates, free + push * pushed])

    def there(_, y):
        return y[1] - LAST

    there.terminal = True
    square = START**2 + G / INERTIA * (H * (1 - math.cos(LAST)) - D * math.sin(LAST))
    before = np.array([math.sqrt(square), 0.0])
    first, _ = constraint(LAST, 0.0)
    pushed = moments(LAST, 0.0)
    after = before - (first @ before) / (first @ pushed) * pushed
    run = solve_ivp(slope, (0, 1), [LAST, 0.0, *after], events=there, rtol=1e-11, atol=1e-13)
    hits = dominoes.impacts(2, H, D, S, INERTIA, START, G, friction)
    assert hits[1] - hits[0] == pytest.approx(run.t_events[0][0], rel=1e-7)


def test_friction_slows_the_wave_down():
    """By a quarter, for μ = 0.2 and a third of the height between dominoes."""
    smooth, rough = (dominoes.speed(H, D, S, INERTIA, G, 25, of) for of in (0.0, 0.2))
    assert rough / smooth == pytest.approx(0.76, abs=0.02)


def test_dominoes_that_do_not_reach_each_other_are_refused():
    with pytest.raises(ValueError, match="less than the height"):
        dominoes.impacts(3, H, D, H, INERTIA, START, G)
    with pytest.raises(ValueError, match="comes to rest before it hits the next"):
        dominoes.impacts(3, H, D, 0.2 * H, INERTIA, 0.1, G)
