"""How elastic tops turn: laws that the gap to a rigid top obeys. Its size is measured in the scenes."""

import numpy as np
import pytest

from springgym.model.bodies import box, softened, solid_box, solid_top, top
from springgym.model.bodies.precession import heavy_top, precession_gap, wobble_growth
from tests.params import slow_but

G = (0.0, 0.0, -9.81)


def test_heavy_top_of_a_solid_cone():
    """About its tip: I₃ = 0.3 M r², I₁ = M (0.6 h² + 0.15 r²), centre of mass at 0.75 h."""
    body = solid_top(0.03, 0.04, "brass")
    found = heavy_top(body, body.parts["tip"], G)
    mass = 8500 * np.pi * 0.03**2 * 0.04 / 3
    assert found.i3 == pytest.approx(0.3 * mass * 0.03**2, rel=1e-12)
    assert found.i1 == pytest.approx(mass * (0.6 * 0.04**2 + 0.15 * 0.03**2), rel=1e-12)
    assert found.mgl == pytest.approx(mass * 9.81 * 0.03, rel=1e-12)


@pytest.mark.parametrize(
    ("body", "pinned", "gravity", "why"),
    [
        (top(), (), G, "it needs one pin, and vertical gravity"),
        (top(), (13,), (1.0, 0.0, -9.81), "it needs one pin, and vertical gravity"),
        (box((1, 2, 3)), (0,), G, "it is not symmetric about its axis"),
    ],
)
def test_what_is_no_heavy_top(body, pinned, gravity, why):
    with pytest.raises(ValueError, match=f"is not a heavy top: {why}"):
        heavy_top(body, pinned, gravity)


@pytest.mark.parametrize("name", slow_but(["steel", "beech"], "beech"))
def test_gap_goes_with_the_softness_and_the_square_of_the_spin(name):
    body = solid_top(0.03, 0.04, name)
    pin = body.parts["tip"]
    gap = precession_gap(body, pin, G, 0.35, 300.0)
    grown = body.solid.stretch[2] * 300.0**2
    assert -1.4 * grown < gap < -grown  # more than the growth, since the centre of mass sinks
    assert 0.75 < body.solid.precession_ratio < 1
    assert precession_gap(softened(body, 100), pin, G, 0.35, 300.0) == pytest.approx(100 * gap, rel=0.01)
    # twice as fast; the share of the precession itself in it falls with its rate over the spin
    assert precession_gap(body, pin, G, 0.35, 600.0) == pytest.approx(4 * gap, rel=0.08)


@pytest.mark.slow
def test_paper_top_has_a_gap_too():
    """It grows as it spins, by some 1e-3."""
    body = top()
    gap = precession_gap(body, body.parts["tip"], G, 0.35, 49.8)
    assert -6e-3 < gap < -1e-3


def test_slender_bodies_turn_over_and_flat_ones_come_to_rest():
    slender = solid_top(0.018, 0.06, "beech", softened=400)
    flat = solid_top(0.06, 0.06, "beech", softened=400)
    assert wobble_growth(slender, 1000.0) > 0
    assert wobble_growth(flat, 300.0) < 0
    # as far as it is slow beside the vibrations, with the fourth power of the spin, and with the loss
    assert wobble_growth(slender, 700.0) / wobble_growth(slender, 350.0) == pytest.approx(16, rel=0.15)
    lossier = slender.with_(damping=3 * slender.damping)
    assert wobble_growth(lossier, 700.0) == pytest.approx(3 * wobble_growth(slender, 700.0), rel=1e-3)


def test_wobble_without_friction_stays():
    body = solid_box((0.02, 0.02, 0.04), "rubber")
    still = body.with_(damping=np.zeros(len(body.springs)))
    assert abs(wobble_growth(still, 200.0)) < 1e-3 * wobble_growth(body, 200.0)
