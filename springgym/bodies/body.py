"""A body: point masses, and the springs that hold them in shape."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any, Self

import numpy as np

from springgym.bodies.elastic import Cable, Elastic

PHYSICAL = ("positions", "masses", "springs", "stiffness", "damping", "lengths")
"""Fields of a `Body` that decide how it moves."""


@dataclass(frozen=True, eq=False)
class Body:
    """Particles and springs, checked once when it is made.

    Parameters
    ----------
    name
        What it is.
    positions : (N, 3)
        The unstretched shape [m].
    masses : (N,)
        [kg], all positive.
    springs : (S, 2)
        Pairs of particles, each pair once.
    stiffness, damping : (S,) or a number
        k [N/m], positive; c [kg/s], not negative.
    lengths : (S,), optional
        Unstretched lengths [m]; those of ``positions`` if not given.
    frame : (3,)
        Particles i, j, k: the body's third axis points from i to j, its first towards k as far as that
        is perpendicular to it. The first three particles if not given.
    parts
        Names of particles: ``{"tip": (13,), "ring": (0, …, 11)}``.
    triangles : (T, 3)
        Its surface, for drawing; corners in the order that points the normal outwards.
    floppy
        Whether its springs may leave it free to change shape, as a rope is.
    solid
        What it stands for, if it was made from a material (`springgym.bodies.solid`).

    Raises
    ------
    ValueError
        Naming the offender: a mass or stiffness that is not positive and finite, a spring of no length,
        given twice or to a particle that does not exist, a part, frame or triangle of one, a body that is
        in pieces or not held in shape.
    """

    name: str
    positions: np.ndarray
    masses: np.ndarray
    springs: np.ndarray
    stiffness: np.ndarray
    damping: np.ndarray
    lengths: np.ndarray = None  # type: ignore[assignment]
    frame: tuple[int, int, int] = None  # type: ignore[assignment]
    parts: Mapping[str, tuple[int, ...]] = field(default_factory=dict)
    triangles: np.ndarray = field(default_factory=lambda: np.zeros((0, 3), int))
    floppy: bool = False
    solid: Elastic | Cable | None = None

    def __post_init__(self) -> None:
        def freeze(name: str, dtype: Any, shape: tuple[int, ...]) -> None:
            try:
                array = np.array(np.broadcast_to(np.asarray(getattr(self, name), dtype), shape))
            except ValueError as error:
                raise ValueError(f"{name} of body {self.name!r} must have shape {shape}: {error}") from None
            array.setflags(write=False)
            object.__setattr__(self, name, array)

        if len(self.positions) == 0:
            raise ValueError(f"body {self.name!r} has no particles")
        freeze("positions", float, (len(self.positions), 3))
        freeze("masses", float, (len(self.positions),))
        freeze("springs", int, (len(self.springs), 2))
        freeze("triangles", int, (len(self.triangles), 3))
        if self.frame is None:
            last = len(self.masses) - 1
            object.__setattr__(self, "frame", (0, min(1, last), min(2, last)))
        self._check_springs()
        self._check_names()
        if self.lengths is None:
            first, second = self.springs.T
            apart = np.linalg.norm(self.positions[second] - self.positions[first], axis=1)
            object.__setattr__(self, "lengths", apart)
        for name in ("stiffness", "damping", "lengths"):
            freeze(name, float, (len(self.springs),))
        self._check_values()
        self._check_shape()

    def _check_springs(self) -> None:
        count = len(self.positions)
        seen: set[tuple[int, int]] = set()
        for n, (i, j) in enumerate(self.springs.tolist()):
            what = f"spring {n} of body {self.name!r} joins"
            if not (0 <= i < count and 0 <= j < count):
                raise ValueError(f"{what} particles {i} and {j}; there are 0 to {count - 1}")
            if i == j:
                raise ValueError(f"{what} particle {i} to itself")
            if (min(i, j), max(i, j)) in seen:
                raise ValueError(f"{what} particles {i} and {j}, which are joined already")
            seen.add((min(i, j), max(i, j)))

    def _check_names(self) -> None:
        last = len(self.masses) - 1
        for name, particles in self.parts.items():
            if not particles:
                raise ValueError(f"part {name!r} of body {self.name!r} has no particles")
        named = {f"part {name!r}": particles for name, particles in self.parts.items()}
        named |= {"frame": self.frame, "triangles": tuple(self.triangles.ravel().tolist())}
        for name, particles in named.items():
            for i in particles:
                if not 0 <= i <= last:
                    what = f"{name} of body {self.name!r}"
                    raise ValueError(f"{what} names particle {i}; there are 0 to {last}")

    def _check_values(self) -> None:
        def check(name: str, wrong: np.ndarray, must: str) -> None:
            if wrong.any():
                n = int(np.argmax(wrong))
                value = getattr(self, name)[n]
                raise ValueError(f"{name}[{n}] of body {self.name!r} is {value}; it must be {must}")

        check("positions", ~np.isfinite(self.positions).all(axis=1), "finite")
        for name in ("masses", "stiffness"):
            values = getattr(self, name)
            check(name, ~((values > 0) & np.isfinite(values)), "positive and finite")
        check("lengths", ~((self.lengths > 0) & np.isfinite(self.lengths)), "positive and finite")
        check("damping", ~((self.damping >= 0) & np.isfinite(self.damping)), "finite and not negative")

    def _check_shape(self) -> None:
        piece = pieces(len(self.positions), self.springs)
        if piece.any():
            stray = int(np.argmax(piece))
            raise ValueError(f"body {self.name!r} is in pieces: nothing joins particle {stray} to particle 0")
        if not self.floppy and (free := self.floppy_modes()) > 0:
            raise ValueError(
                f"body {self.name!r} can change shape in {free} ways without stretching a spring; "
                "add springs, or say floppy=True if it is meant to"
            )

    def floppy_modes(self, pinned: tuple[int, ...] = ()) -> int:
        """Ways to change shape that stretch no spring, with some particles held.

        Of the 3 (N − pins) coordinates, those that neither a spring (the rank of the rigidity matrix) nor
        a rigid motion past the pins accounts for. Directions that stretch springs by less than 1e-9 of
        what others do count as stretching none.
        """
        free = np.setdiff1d(np.arange(len(self.masses)), pinned)
        rigid = rigid_motions(self.positions)
        moving = _rank(rigid.reshape(-1, 6)) - _rank(rigid[list(pinned)].reshape(-1, 6))
        rows = rigidity_matrix(self.positions, self.springs)[:, free]
        return 3 * len(free) - moving - _rank(rows.reshape(len(rows), 3 * len(free)))

    def particle(self, name: str) -> int:
        """The particle of a part that has just one.

        Raises
        ------
        KeyError
            If there is no part of that name.
        ValueError
            If it has several particles.
        """
        if name not in self.parts:
            known = ", ".join(self.parts) or "no parts"
            raise KeyError(f"body {self.name!r} has no {name!r}; it has {known}")
        if len(self.parts[name]) != 1:
            raise ValueError(f"{name!r} of body {self.name!r} is {len(self.parts[name])} particles, not one")
        return self.parts[name][0]

    def with_(self, **changes: Any) -> Self:
        """A copy with some fields changed, checked anew.

        With other particles or springs it stands for no ``solid`` any more, unless that is given anew.
        """
        if not changes.keys().isdisjoint(PHYSICAL):
            changes = {"solid": None} | changes
        return replace(self, **changes)

    @cached_property
    def mass(self) -> float:
        """Total mass [kg]."""
        return float(self.masses.sum())

    @cached_property
    def centre(self) -> np.ndarray:
        """Centre of mass of the unstretched shape [m], (3,)."""
        return self.masses @ self.positions / self.mass

    def inertia(self, about: Any = None) -> np.ndarray:
        """Inertia tensor Σ m (r² 1 − r rᵀ) [kg·m²], (3, 3), about a point (the centre of mass)."""
        r = self.positions - (self.centre if about is None else np.asarray(about))
        return np.sum(self.masses * (r * r).sum(axis=1)) * np.eye(3) - (self.masses * r.T) @ r

    def principal(self, about: Any = None) -> tuple[np.ndarray, np.ndarray]:
        """Principal moments [kg·m²], ascending, (3,), and axes, the columns of a rotation (3, 3)."""
        moments, axes = np.linalg.eigh(self.inertia(about))
        if np.linalg.det(axes) < 0:
            axes[:, 2] *= -1
        return moments, axes

    def __repr__(self) -> str:
        springs = "no springs"
        if len(self.springs):
            springs = (
                f"{len(self.springs)} springs of {_span(self.stiffness)} N/m, {_span(self.lengths)} m, "
                f"damping {_span(self.damping)} kg/s"
            )
        return (
            f"Body({self.name!r}: {len(self.masses)} particles of {_span(self.masses)} kg, "
            f"{self.mass:g} kg in all; {springs}{', floppy' if self.floppy else ''}; "
            f"parts: {', '.join(self.parts) or 'none'}{f'; {self.solid!r}' if self.solid else ''})"
        )


def rigidity_matrix(positions: np.ndarray, springs: np.ndarray) -> np.ndarray:
    """How displacements stretch springs: unit vectors along them, (S, N, 3), − at one end, + at the other."""
    first, second = springs.T
    along = positions[second] - positions[first]
    along = along / np.maximum(np.linalg.norm(along, axis=1), 1e-300)[:, None]
    matrix = np.zeros((len(springs), *positions.shape))
    matrix[np.arange(len(springs)), first] = -along
    matrix[np.arange(len(springs)), second] = along
    return matrix


def rigid_motions(positions: np.ndarray, about: Any = None) -> np.ndarray:
    """Displacements by unit translations and rotations about a point (the middle): (N, 3, 6)."""
    r = positions - (positions.mean(axis=0) if about is None else np.asarray(about))
    motions = np.zeros((len(r), 3, 6))
    motions[:, :, :3] = np.eye(3)
    motions[:, :, 3:] = np.cross(np.eye(3), r[:, None, :]).transpose(0, 2, 1)
    return motions


def _rank(matrix: np.ndarray) -> int:
    if not matrix.size:
        return 0
    sizes = np.linalg.svd(matrix, compute_uv=False)
    return int(np.sum(sizes > 1e-9 * sizes[0]))


def _span(values: np.ndarray) -> str:
    low, high = f"{values.min():g}", f"{values.max():g}"
    return low if low == high else f"{low}…{high}"


def pieces(count: int, springs: np.ndarray) -> np.ndarray:
    """For each particle, the first particle of the piece it belongs to."""
    piece = np.arange(count)
    while True:
        lower = piece.copy()
        for a, b in ((0, 1), (1, 0)):
            np.minimum.at(lower, springs[:, a], piece[springs[:, b]])
        if (lower == piece).all():
            return piece
        piece = lower
