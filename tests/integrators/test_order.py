"""Every method converges with the order its record states."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from springgym.dynamics.methods import METHODS, integrator
from tests.integrators.problems import error, reference, simulator, tetrahedron

DURATION = 0.6
DAMPING = 1.0
FIRST = {1: 1024, 2: 256, 3: 256, 4: 128, 6: 16}
"""Steps of the coarsest run by order: errors from 1e-2 down to 1e-12, where the leading term rules."""

FIXED = [name for name in METHODS if not integrator(name).adaptive]


def fitted_order(name: str, record: Any) -> float:
    steps = FIRST[record.order] * np.array([1, 2, 4])
    exact = reference(0.0 if record.negative_substeps else DAMPING, DURATION)
    errors = []
    for count in steps.tolist():
        made = simulator(tetrahedron(record.name, DAMPING), name, DURATION / count)
        made.advance(count)
        errors.append(error(made, exact))
    return -np.polyfit(np.log(steps), np.log(errors), 1)[0]


def tolerance_slope(name: str) -> float:
    """d log(error) / d log(tolerance) from 1e-4 to 1e-9."""
    tolerances = 10.0 ** -np.arange(4, 10)
    exact = reference(DAMPING, DURATION)
    errors = []
    for tolerance in tolerances:
        made = simulator(
            tetrahedron("dopri5", DAMPING), name, DURATION / 12, tolerance=(tolerance, tolerance)
        )
        made.advance(12)
        errors.append(error(made, exact))
    return np.polyfit(np.log(tolerances), np.log(errors), 1)[0]


@pytest.mark.parametrize("name", FIXED)
def test_order_is_the_declared_one(name: str) -> None:
    record = integrator(name)
    moved = reference(DAMPING, DURATION)[0] - tetrahedron(name, DAMPING).positions
    assert np.abs(moved).max() > 0.5
    assert fitted_order(name, record) == pytest.approx(record.order, abs=0.1)


def test_error_follows_the_tolerance() -> None:
    # local errors of h^5 are kept at the tolerance and add up over 1/h steps, extrapolated: slope 1
    assert tolerance_slope("dopri5") == pytest.approx(1.0, abs=0.2)
