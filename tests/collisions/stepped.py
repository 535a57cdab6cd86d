"""Scenes of colliding bodies on a `Simulator`, as tests read them."""

from __future__ import annotations

from typing import Any
from unittest import mock

import numpy as np

from springgym import packing
from springgym.contact.pairs import Pairs
from springgym.contact.totals import ENTRIES
from springgym.core.blocks import to_copies
from springgym.packing import pack_pairs
from springgym.scene import Scene
from springgym.simulator import Simulator
from tests.collisions.world import with_all_features


class Stepped:
    """A simulator with what tests ask for.

    Unless it is to be ``lean``, it has all kinds of terms, be they zero or empty: all share code.
    """

    def __init__(
        self,
        scene: Scene,
        *,
        step: float | None = None,
        copies: int = 2,
        dtype: Any = float,
        lean: bool = False,
        threads: int = 1,
    ) -> None:
        self.scene = scene if lean or scene.gravity else scene.with_(gravity=(0.0, 0.0, 0.0))
        varying = ("damping", "friction", "restitution") if scene.surfaces else ("damping",)
        whole = lambda *given: with_all_features(pack_pairs(*given))  # noqa: E731
        with mock.patch.object(packing, "pack_pairs", pack_pairs if lean else whole):
            self.simulator = Simulator(
                self.scene,
                step=step,
                copies=copies,
                dtype=dtype,
                threads=threads,
                unresolved="count",
                varying=() if lean else varying,
            )
        self.step = self.simulator.step

    @property
    def pairs(self) -> Pairs:
        return self.simulator._terms.collisions.pairs

    def place(self, positions: np.ndarray, velocities: np.ndarray) -> None:
        self.simulator.place(positions, velocities)

    def run(self, steps: int) -> None:
        self.simulator.advance(steps)

    @property
    def x(self) -> np.ndarray:
        """(copies, N, 3)"""
        return self.simulator.positions

    @property
    def v(self) -> np.ndarray:
        return self.simulator.velocities

    @property
    def totals(self) -> np.ndarray:
        """(copies, pairs, ENTRIES)"""
        found = to_copies(self.simulator._terms.collisions.totals, self.simulator.copies)
        return found.reshape(len(found), -1, ENTRIES).astype(float)

    def momenta(self) -> np.ndarray:
        """Momentum and angular momentum about the origin, (copies, 6)."""
        m, x, v = self.scene.masses[:, None], self.x, self.v
        return np.concatenate([(m * v).sum(1), (m * np.cross(x, v)).sum(1)], axis=1)

    def energy(self) -> np.ndarray:
        """Return what the method keeps of the energy (copies,): without contact, less h²/8 a·M a of the
        springs."""
        measured, x = self.simulator.measure(), self.x
        i, j = self.scene.springs.T
        along = x[:, j] - x[:, i]
        length = np.linalg.norm(along, axis=-1, keepdims=True)
        k = self.scene.of_bodies("stiffness")[:, None]
        pull = k * (length - self.scene.of_bodies("lengths")[:, None]) * along / length
        force = np.zeros_like(x)
        for copy in range(len(x)):
            np.add.at(force[copy], i, pull[copy])
            np.add.at(force[copy], j, -pull[copy])
        swing = self.step**2 / 8 * (force**2 / self.scene.masses[:, None]).sum(axis=(1, 2))
        return np.asarray(measured.energy - swing)
