"""Bodies of springs that hit a floor, against what is known of two masses on a spring."""

import math

import numpy as np
import pytest

from springgym.theory.impact import impact

MASS = 0.5
SPRING = 200.0
SPEED = 0.3


def dropped(damping=0.0, stiff=1e3, **changes):
    """Two equal masses, one above the other, on a floor that is ``stiff`` times as stiff as their spring."""
    along = np.diag([0.0, 0.0, 1.0])
    pair = np.block([[along, -along], [-along, along]])
    reach = 0.1
    given = {"speed": SPEED, "strength": stiff * SPRING * reach**3 / 2, "reach": reach, "gravity": 0.0}
    return impact([MASS, MASS], SPRING * pair, damping * pair, [0.0, 1.0], **(given | changes))


def test_two_masses_on_a_hard_floor():
    """The lower turns at once, meets the floor after half a vibration again, and both leave as they came.

    Each of its two meetings takes π/ω of a mass on the floor's own spring.
    """
    met = dropped()
    half = math.pi / math.sqrt(2 * SPRING / MASS)
    meeting = math.pi / math.sqrt(1e3 * SPRING / MASS)
    assert met.duration == pytest.approx(half + meeting, rel=2e-3)
    assert met.speed == pytest.approx(SPEED, rel=1e-3)
    assert met.until > met.duration


@pytest.mark.slow
def test_a_damper_takes_of_the_rebound():
    """Of the vibration exp(−ζ π) is left when the lower meets the floor again, and makes the rebound."""
    ratio = 0.05
    met = dropped(damping=ratio * math.sqrt(2 * SPRING * MASS))
    assert met.speed == pytest.approx(SPEED * math.exp(-ratio * math.pi), rel=5e-3)


@pytest.mark.slow
def test_a_soft_floor_is_a_spring():
    """Much softer than the body: half a vibration of both masses on it."""
    met = dropped(stiff=1e-3, speed=1e-3)
    # the barrier is linear to 3/2 of what it is entered by
    assert met.duration == pytest.approx(math.pi / math.sqrt(1e-3 * SPRING / (2 * MASS)), rel=0.05)
    assert met.speed == pytest.approx(1e-3, rel=1e-3)


def test_a_body_that_stays_is_named():
    with pytest.raises(ValueError, match="does not leave it"):
        dropped(stiff=10.0, speed=1e-3, gravity=9.81)
