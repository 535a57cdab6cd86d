"""Estimates of the error of each control period by step doubling.

A method of order p has an error C hᵖ. Steps of h/2 have 2⁻ᵖ of it, so the two results differ by 1 − 2⁻ᵖ of
the error of the longer steps (Richardson). A second simulator repeats each control period from the same
state, in steps of h/2. Its result is used only for the estimate: the episode continues from that of the first
one.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from springgym.model.bodies.distances import largest_distances
from springgym.simulator import Simulator

__all__ = ["FINER", "StepError"]

FINER = 2
"""Number of steps of the second simulator in a step of the first."""


class StepError:
    """Estimate the distance of copies, after a control period, from the exact solution.

    Parameters
    ----------
    simulator
        The simulator of the copies.
    made
        The arguments with which it was made, other than scene, method and steps.

    Raises
    ------
    ValueError
        If its method chooses its own steps.
    """

    def __init__(self, simulator: Simulator, **made: Any) -> None:
        method = simulator.integrator
        if method.adaptive:
            raise ValueError(
                f"integrator is {method.name!r}, which chooses its own steps; error and tolerance compare "
                "with steps of half the length. Take another integrator, or leave them out"
            )
        every = simulator.damping_every
        self.finer = Simulator(simulator.scene, step=simulator.step / FINER, damping_every=every, **made)
        self._share = 1 / (1 - FINER**-method.order)
        self.last = np.zeros(simulator.copies)
        """largest distance of a particle after a control period of the last step, relative to its body's
        size"""

    def estimate(self, simulator: Simulator, steps: int) -> None:
        """Estimate the error of the last ``steps`` of the simulator, since the finer one copied its state."""
        self.finer.advance(FINER * steps, check=False, read=True)
        own = simulator.readout.positions
        finer = self.finer.readout.positions
        apart = largest_distances(own, finer, simulator.scene.sizes)
        np.maximum(self.last, self._share * apart, out=self.last)
