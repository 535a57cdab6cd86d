"""Bodies of every material and shape, struck: they ring as the solid does, and die away as its loss says."""

import math
from dataclasses import replace

import numpy as np
import pytest

from springgym.model.bodies import vibrations
from springgym.scenes import load
from springgym.scenes.checks import check
from springgym.scenes.recording import record
from tests.bodies.test_solid import EACH, SHAPES
from tests.params import slow_but


def struck(body):
    """A recording of the lowest vibration of a body, over a thousand periods or until a tenth is left."""
    frequencies, modes = vibrations(body)
    period = 2 * math.pi / frequencies[0]
    loss = body.solid.material.loss
    samples = 20 if loss <= 0.01 else 160  # peaks that fall fast are found by parabolas if these are narrow
    duration = period * min(1000.0, math.log(10) / (math.pi * loss))
    size = np.ptp(body.positions, axis=0).max()
    velocities = 1e-6 * size * frequencies[0] * modes[0] / np.abs(modes[0]).max()
    plan = load("ringing-top")
    scene = plan.scene.with_(body=body, positions=body.positions, velocities=velocities)
    return record(replace(plan, scene=scene, duration=duration, interval=period / samples))


def rings(recording):
    checks = ("ring_frequency", "ring_down", "energy")
    return [found.passed for found in check(replace(recording, plan=replace(recording.plan, checks=checks)))]


@pytest.mark.parametrize(("shape", "name"), slow_but(EACH, EACH[-1]))
def test_frequency_and_decay(shape, name):
    """Within 1e-4 and what calibration missed, and within half a per cent; energy to the method's order."""
    assert rings(struck(SHAPES[shape](name))) == [True] * 3
