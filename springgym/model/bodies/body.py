"""A body: point masses, and the springs that hold them in shape."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property, lru_cache
from typing import Any, Self

import numpy as np
from numpy.typing import ArrayLike

from springgym.checks import (
    TINY,
    array,
    flag,
    indices,
    instance,
    number,
    refusing_unknown,
    shown,
    whole_array,
)
from springgym.model.bodies import surface
from springgym.model.bodies.elastic import Cable, Elastic
from springgym.model.bodies.round import Round, weights
from springgym.model.records import ReadOnly, read_only

MOST_PARTICLES = 1000
"""Largest number of particles of a body. The check of its shape and the largest stable step need matrices of
(3 N)² numbers, in a time that grows as N³. At this limit it is half a minute."""

MOST_SPRINGS = 20_000
"""Largest number of springs of a body."""

EXACT = 400
"""Largest number of particles for which zero-energy modes are counted to double precision."""

PHYSICAL = ("positions", "masses", "springs", "stiffness", "damping", "lengths")
"""Fields of a `Body` that decide how it moves."""


OF_EACH = {"positions": ("masses",), "springs": ("stiffness", "damping", "lengths")}
"""Fields of a `Body` with a row for each particle or spring, and those that have a number for each row."""


class Parts(Mapping[str, tuple[int, ...]]):
    """Names of particles. Immutable; unlike a mapping proxy, it can be copied and pickled."""

    def __init__(self, named: Mapping[str, tuple[int, ...]]) -> None:
        self._named = dict(named)

    def __getitem__(self, name: str) -> tuple[int, ...]:
        return self._named[name]

    def __iter__(self) -> Iterator[str]:
        return iter(self._named)

    def __len__(self) -> int:
        return len(self._named)

    def __repr__(self) -> str:
        return repr(self._named)


@refusing_unknown
@dataclass(frozen=True, eq=False)
class Body(ReadOnly):
    """A body: its particles and springs, checked once when it is made.

    Parameters
    ----------
    name
        Name of the body.
    positions : (N, 3)
        The unstretched shape [m], of at most `MOST_PARTICLES` particles.
    masses : (N,) or a number
        [kg], all positive.
    springs : (S, 2)
        Pairs of particles, each pair once, at most `MOST_SPRINGS`.
    stiffness, damping : (S,) or a number
        k [N/m], positive; c [kg/s], not negative.
    lengths : (S,) or a number, optional
        Unstretched lengths [m]. The default is the distances in ``positions``.
    markers : (3,)
        Particles i, j, k that define the body's triad. The third axis points from i to j. The first axis is
        perpendicular to it and points to the side of k. The default is the first three particles. Unless
        the body is a single particle, i and j must differ in position. If all three lie on one line, the
        body is not `oriented`.
    parts
        Names of particles: ``{"tip": (13,), "ring": (0, …, 11)}``; kept read-only.
    triangles : (T, 3)
        The surface, for drawing and for collisions with other bodies. The corners go anticlockwise as seen
        from outside.
    floppy
        Whether the springs may leave the body free to change shape, as in a rope.
    solid
        The solid that the body represents, if it was made from a material (`springgym.model.bodies.solid`).
    radius
        Radius of balls around the particles and of rods along the springs [m]. A body without triangles
        collides by these: a single particle becomes a sphere, and a rope becomes round.
    rounds
        Round features, see `springgym.model.bodies.round`. A body that has some meets surfaces only with
        these.

    Raises
    ------
    TypeError
        If an argument has the wrong type, see `springgym.checks`.
    ValueError
        If a mass or stiffness is not positive and finite; a spring has no length, is given twice or ends at a
        particle that does not exist; a part, marker or triangle has such a particle; there is a radius
        besides triangles or round features; too few particles carry a round feature; or the body is in
        pieces, does not hold its shape, or is too large. The message names the cause.
    """

    name: str
    positions: np.ndarray
    masses: np.ndarray
    springs: np.ndarray
    stiffness: np.ndarray
    damping: np.ndarray
    lengths: np.ndarray = None  # type: ignore[assignment]
    markers: tuple[int, int, int] = None  # type: ignore[assignment]
    parts: Mapping[str, tuple[int, ...]] = field(default_factory=dict)
    triangles: np.ndarray = field(default_factory=lambda: np.zeros((0, 3), int))
    floppy: bool = False
    solid: Elastic | Cable | None = None
    radius: float = 0.0
    rounds: tuple[Round, ...] = ()

    def __post_init__(self) -> None:
        instance("name of a body", self.name, str)
        what = f"body {self.name!r}: "

        def numbers(name: str, count: int, low: float) -> None:
            given = array(what + name, getattr(self, name), (count,), (), low=low)
            self.keep(name, np.broadcast_to(given, (count,)))

        self.keep("positions", array(what + "positions", self.positions, (None, 3), (0,)))
        count = len(self.positions)
        if not 0 < count <= MOST_PARTICLES:
            raise ValueError(f"{what}it has {count} particles; it must have from 1 to {MOST_PARTICLES}")
        numbers("masses", count, TINY)
        for name, ends in (("springs", 2), ("triangles", 3)):
            given = whole_array(what + name, getattr(self, name), (None, ends), (0,), high=count - 1)
            self.keep(name, given.reshape(-1, ends))
        self._check_springs()
        if self.lengths is None:
            object.__setattr__(self, "lengths", self._distances())
        for name, low in (("stiffness", TINY), ("damping", 0.0), ("lengths", TINY)):
            numbers(name, len(self.springs), low)
        if self.markers is None:
            object.__setattr__(self, "markers", (0, min(1, count - 1), min(2, count - 1)))
        markers = whole_array(what + "markers", self.markers, (3,), high=count - 1)
        object.__setattr__(self, "markers", tuple(markers.tolist()))
        i, j, _ = self.markers
        if count > 1 and (self.positions[i] == self.positions[j]).all():
            raise ValueError(f"{what}markers is {self.markers}; the first two must be at different positions")
        parts = {}
        for name, particles in instance(what + "parts", self.parts, Mapping).items():
            instance(f"{what}a name of parts", name, str)
            parts[name] = tuple(indices(f"{what}parts[{name!r}]", particles, count).tolist())
            if not parts[name]:
                raise ValueError(f"{what}parts[{name!r}] has no particles")
        object.__setattr__(self, "parts", Parts(parts))
        flag(what + "floppy", self.floppy)
        instance(what + "solid", self.solid, Elastic, Cable, type(None))
        object.__setattr__(self, "radius", number(what + "radius", self.radius, low=0.0))
        if self.radius and len(self.triangles):
            raise ValueError(
                f"{what}radius is {self.radius:g} m, and there are {len(self.triangles)} triangles; "
                "a body has one or the other"
            )
        self._check_rounds(what)
        self._check_shape()

    def _check_rounds(self, what: str) -> None:
        if not isinstance(self.rounds, (tuple, list)):
            raise TypeError(f"{what}rounds is {shown(self.rounds)}; it must be a tuple of Round")
        object.__setattr__(self, "rounds", tuple(self.rounds))
        for n, feature in enumerate(self.rounds):
            called = f"{what}rounds[{n}]"
            carriers = instance(called, feature, Round).carriers(len(self.masses), f"{called}.particles")
            try:
                weights(self.masses, self.positions, carriers)
            except ValueError as error:
                raise ValueError(f"{called}: {error}") from None
        if self.rounds and self.radius:
            raise ValueError(
                f"{what}radius is {self.radius:g} m, and there are round "
                "features; a body has one or the other"
            )

    def _distances(self) -> np.ndarray:
        """Return distances [m] (S,) of the springs' ends in the unstretched shape."""
        first, second = self.springs.T
        return np.linalg.norm(self.positions[second] - self.positions[first], axis=1)

    def _check_springs(self) -> None:
        if len(self.springs) > MOST_SPRINGS:
            raise ValueError(
                f"body {self.name!r} has {len(self.springs)} springs; it must have at most {MOST_SPRINGS}"
            )
        seen: set[tuple[int, int]] = set()
        apart = self._distances().tolist()
        for n, (i, j) in enumerate(self.springs.tolist()):
            what = f"spring {n} of body {self.name!r} joins"
            if i == j:
                raise ValueError(f"{what} particle {i} to itself")
            if (min(i, j), max(i, j)) in seen:
                raise ValueError(f"{what} particles {i} and {j}, which are joined already")
            if apart[n] < TINY:
                raise ValueError(f"{what} particles {i} and {j}, which are at the same position")
            seen.add((min(i, j), max(i, j)))

    def _check_shape(self) -> None:
        piece = surface.pieces(len(self.positions), self.springs)
        if piece.any():
            stray = int(np.argmax(piece))
            raise ValueError(f"body {self.name!r} is in pieces: nothing joins particle {stray} to particle 0")
        if not self.floppy and (free := self.floppy_modes()) > 0:
            raise ValueError(
                f"body {self.name!r} is under-constrained ({free} zero-energy mode{'s' * (free > 1)}); "
                "add springs or pass floppy=True"
            )

    def floppy_modes(self, pinned: tuple[int, ...] = ()) -> int:
        """Return the number of zero-energy modes, which stretch no spring, with some particles pinned.

        This is the number of coordinates, 3 (N − pins), less the rank of the rigidity matrix and less the
        rigid motions that the pins allow. A direction counts as stretching no spring if it stretches them by
        less than 1e-9 (1e-6 in bodies of more than `EXACT` particles) of the largest stretch.
        """
        held = tuple(indices("pinned", pinned, len(self.masses)).tolist())
        return _floppy_modes(self.positions.tobytes(), self.springs.tobytes(), held)

    def particle(self, name: str) -> int:
        """Return the only particle of a part.

        Raises
        ------
        KeyError
            If there is no part of that name.
        ValueError
            If it has several particles.
        """
        if instance("name of a part", name, str) not in self.parts:
            known = ", ".join(self.parts) or "no parts"
            raise KeyError(f"body {self.name!r} has no {name!r}; it has {known}")
        if len(self.parts[name]) != 1:
            raise ValueError(f"{name!r} of body {self.name!r} is {len(self.parts[name])} particles, not one")
        return self.parts[name][0]

    def with_(self, **changes: Any) -> Self:
        """Return a copy with some fields changed, and check it.

        With other particles or springs, the copy has no ``solid``, unless you give one.

        Raises
        ------
        TypeError, ValueError
            If `Body` refuses the fields, or they do not fit those that are kept; the message names them.
        """
        if not changes.keys().isdisjoint(PHYSICAL):
            changes = {"solid": None} | changes
        for name, others in OF_EACH.items():
            kept = [other for other in others if other not in changes]
            given = changes.get(name)
            count = len(getattr(self, name))
            if kept and _rows(given) not in (None, count):
                raise ValueError(
                    f"{name} is {shown(given)}, of {_rows(given)} rows; it must have {count}, as many as the "
                    f"{kept[0]} that the body keeps, unless you change {', '.join(kept)}, too"
                )
        return replace(self, **changes)

    @cached_property
    def oriented(self) -> bool:
        """Return whether the markers span a plane, and so determine the orientation."""
        i, j, k = self.positions[list(self.markers)]
        third = j - i
        sideways = k - i
        across = np.linalg.norm(np.cross(third, sideways))
        return bool(across > 1e-9 * np.linalg.norm(third) * np.linalg.norm(sideways))

    @cached_property
    def mass(self) -> float:
        """Return the total mass [kg]."""
        return float(self.masses.sum())

    @cached_property
    def centre(self) -> np.ndarray:
        """Return the centre of mass of the unstretched shape [m], (3,)."""
        return read_only(self.masses @ self.positions / self.mass)

    @cached_property
    def size(self) -> float:
        """Return the largest distance between two particles [m], with their radii.

        If the extent of a round feature is larger, return that.
        """
        farthest = max(float(np.linalg.norm(self.positions - one, axis=1).max()) for one in self.positions)
        return max([farthest + 2 * self.radius, *(2 * feature.extent for feature in self.rounds)])

    @cached_property
    def swept(self) -> float:
        """Return the diameter of the ball that the body sweeps when it rotates about its centre of mass [m].

        It is an upper bound if a round feature is not at that centre.
        """
        farthest = np.linalg.norm(self.positions - self.centre, axis=1).max() + self.radius
        of = [float(np.linalg.norm(feature.centre - self.centre)) + feature.extent for feature in self.rounds]
        return 2 * max([float(farthest), *of])

    @cached_property
    def closed(self) -> bool:
        """Return whether triangles enclose the body: each edge is in two, in opposite senses."""
        return surface.is_closed(self.triangles)

    @cached_property
    def edges(self) -> np.ndarray:
        """Return the sharp edges (E, 2) of a closed surface: convex, and turning by more than 1°."""
        if not self.closed:
            return read_only(np.zeros((0, 2), int))
        return read_only(surface.sharp_edges(self.positions, self.triangles))

    @cached_property
    def thickness(self) -> float:
        """Return the least distance straight through the body [m]; twice the radius without triangles."""
        if not self.closed:
            return 2 * self.radius
        return surface.thickness(self.positions, self.triangles)

    def inertia(self, about: ArrayLike | None = None) -> np.ndarray:
        """Return the inertia tensor Σ m (r² 1 − r rᵀ) [kg·m²], (3, 3), about a point (default: centre of
        mass)."""
        return inertia(
            self.positions - (self.centre if about is None else array("about", about, (3,))), self.masses
        )

    def principal(self, about: ArrayLike | None = None) -> tuple[np.ndarray, np.ndarray]:
        """Return principal moments [kg·m²] (3,), ascending, and axes, the columns of a rotation (3, 3)."""
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


def _rows(given: object) -> int | None:
    """Return the number of rows of an array or list; None for all else."""
    if isinstance(given, np.ndarray):
        return given.shape[0] if given.ndim else None
    return len(given) if isinstance(given, (list, tuple)) else None


class ByValue:
    """A body as a key of a cache: equal to others with the same numbers, regardless of names."""

    def __init__(self, body: Body) -> None:
        self.body = body
        arrays = (getattr(body, name) for name in PHYSICAL)
        self._numbers = (body.markers, *(array.tobytes() for array in arrays))
        self._hash = hash(self._numbers)

    def __eq__(self, other: object) -> bool:
        return isinstance(other, ByValue) and self._numbers == other._numbers

    def __hash__(self) -> int:
        return self._hash


@lru_cache(maxsize=32)
def _floppy_modes(places: bytes, pairs: bytes, held: tuple[int, ...]) -> int:
    """Compute `Body.floppy_modes` from positions and springs; cached, as bodies often share these."""
    positions = np.frombuffer(places).reshape(-1, 3)
    springs = np.frombuffer(pairs, np.int64).reshape(-1, 2)
    free = np.setdiff1d(np.arange(len(positions)), held)
    moving = rigid_ways(positions) - rigid_ways(positions, np.array(held, int))
    if len(positions) > EXACT:
        first, second = springs.T
        along = positions[second] - positions[first]
        along = along / np.linalg.norm(along, axis=1)[:, None]
        squares = assembled(along[:, :, None] * along[:, None, :], springs, len(positions))
        coordinates = (3 * free[:, None] + np.arange(3)).ravel()
        sizes = np.linalg.eigvalsh(squares[np.ix_(coordinates, coordinates)])  # of the matrix squared
        stretching = int(np.sum(sizes > 1e-12 * sizes[-1])) if len(sizes) else 0
    else:
        rows = rigidity_matrix(positions, springs)[:, free]
        stretching = rank(rows.reshape(len(rows), 3 * len(free)))
    return 3 * len(free) - moving - stretching


def inertia(positions: np.ndarray, masses: np.ndarray) -> np.ndarray:
    """Return the inertia tensor Σ m (r² 1 − r rᵀ) [kg·m²], (3, 3), of particles (N, 3) about the origin."""
    r = positions
    return np.sum(masses * (r * r).sum(axis=1)) * np.eye(3) - (masses * r.T) @ r


def rigidity_matrix(positions: np.ndarray, springs: np.ndarray) -> np.ndarray:
    """Return the stretch of springs by displacements: unit vectors (S, N, 3), − and + at the ends."""
    first, second = springs.T
    along = positions[second] - positions[first]
    along = along / np.maximum(np.linalg.norm(along, axis=1), 1e-300)[:, None]
    matrix = np.zeros((len(springs), *positions.shape))
    matrix[np.arange(len(springs)), first] = -along
    matrix[np.arange(len(springs)), second] = along
    return matrix


def rigid_motions(positions: np.ndarray, about: ArrayLike | None = None) -> np.ndarray:
    """Return the displacements (N, 3, 6) by unit translations and rotations about a point (default: the
    mean)."""
    r = positions - (positions.mean(axis=0) if about is None else np.asarray(about))
    motions = np.zeros((len(r), 3, 6))
    motions[:, :, :3] = np.eye(3)
    motions[:, :, 3:] = np.cross(np.eye(3), r[:, None, :]).transpose(0, 2, 1)
    return motions


def rigid_ways(positions: np.ndarray, particles: slice | np.ndarray = slice(None)) -> int:
    """Return the number of independent rigid motions of a body that move some of its particles."""
    size = np.ptp(positions, axis=0).max() or 1.0
    return rank(rigid_motions(positions / size)[particles].reshape(-1, 6))


def assembled(blocks: np.ndarray, springs: np.ndarray, count: int) -> np.ndarray:
    """Return the matrix (3N, 3N) of springs with energies (uᵢ − uⱼ)ᵀ blockₛ (uᵢ − uⱼ)/2, blocks (S, 3, 3)."""
    first, second = springs.T
    matrix = np.zeros((count, count, 3, 3))
    np.add.at(matrix, (first, first), blocks)
    np.add.at(matrix, (second, second), blocks)
    np.add.at(matrix, (first, second), -blocks)
    np.add.at(matrix, (second, first), -blocks)
    return matrix.transpose(0, 2, 1, 3).reshape(3 * count, 3 * count)


def rank(matrix: np.ndarray) -> int:
    """Return the rank of a matrix; singular values below 1e-9 of the largest count as zero."""
    if not matrix.size:
        return 0
    sizes = np.linalg.svd(matrix, compute_uv=False)
    return int(np.sum(sizes > 1e-9 * sizes[0]))


def _span(values: np.ndarray) -> str:
    low = f"{values.min():g}"
    high = f"{values.max():g}"
    return low if low == high else f"{low}…{high}"
