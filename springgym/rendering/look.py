"""Records of a picture's content: the body's `Look`, the fixed `Scenery` and the `Marks` of one frame."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from springgym.checks import (
    TINY,
    array,
    direction,
    instance,
    number,
    refusing_unknown,
    shown,
    whole,
    whole_array,
)
from springgym.model.records import read_only
from springgym.model.surfaces.surface import Surface

Color = tuple[int, int, int]
Point = Sequence[float] | NDArray[np.float64]
Disk = tuple[Point, float, Color]

BLUE: Color = (43, 92, 150)
IVORY: Color = (243, 239, 230)
SLATE: Color = (96, 112, 133)
STEEL: Color = (148, 158, 172)
ORANGE: Color = (228, 94, 44)
GREEN: Color = (34, 150, 100)
AMBER: Color = (242, 172, 60)
TEAL: Color = (62, 146, 158)
RED: Color = (190, 50, 60)
INK: Color = (52, 60, 76)
GRAPHITE: Color = (110, 120, 138)


MOST_SECTORS = 1_000_000
"""Largest number of sectors that `two_tone` colours."""


def _color(name: str, value: object) -> np.ndarray:
    """Return a colour (3,) as numbers from 0 to 255; errors call it ``name``."""
    return array(name, value, (3,), low=0.0, high=255.0)


@refusing_unknown
def two_tone(
    count: int, blocks: int = 4, colors: tuple[Color, Color] = (BLUE, IVORY), odd: Color = AMBER
) -> NDArray[np.uint8]:
    """Return colours of ``count`` sectors: ``blocks`` runs of alternating colour, the last one odd.

    With few wide runs the eye can follow a spin that turns by many narrow sectors between frames. The odd one
    shows the direction: without it, four runs look the same after half a turn, and a spin by more than a
    quarter of a turn between frames would be seen backwards.

    Returns
    -------
    (count, 3) uint8 array

    Raises
    ------
    TypeError, ValueError
        If a number is not whole or out of bounds, or a colour is not one; the message names it.
    """
    count = whole("count", count, high=MOST_SECTORS)
    blocks = whole("blocks", blocks, 1, MOST_SECTORS)
    colors = tuple(array("colors", colors, (2, 3), low=0.0, high=255.0))
    last = _color("odd", odd)
    run = np.arange(count) * blocks // count
    table = np.array([colors[n % 2] for n in range(blocks - 1)] + [last], dtype=np.uint8)
    return table[run]


@refusing_unknown
@dataclass(frozen=True, eq=False)
class Look:
    """The appearance of one body of N particles; it is checked when it is created.

    Parameters
    ----------
    triangles : (T, 3) array_like of int
        Indices of the surface's corners, anticlockwise seen from outside: particles, and behind them the
        points of the skin.
    triangle_colors : (T, 3) or (3,) array_like, optional
        RGB, 0..255, of each triangle or of all. See `two_tone`.
    opacity : float or (T,) array_like
        1 for a closed surface, of which only the near side is visible; less for translucent sheets, visible
        from both sides.
    bars : (B, 2) array_like of int
        Particle pairs drawn as round bars: axles, ropes.
    bar_radius : float or (B,) array_like
        m.
    bar_colors : (B, 3) or (3,) array_like, optional
        RGB, 0..255.
    radii : (N,) array_like, optional
        Radius of the ball drawn at each particle, m; 0 draws none.
    ball_colors : (N, 3) or (3,) array_like, optional
        RGB, 0..255.
    springs : (S, 2) array_like of int
        Particle pairs, drawn when a frame is given their strains.
    strain_scale : float
        Strain of the full colour, blue at minus and red at plus this value.
    skin : (V, N) array_like, optional
        Weights by which the N particles carry further points: that of a row is the sum of the particles'
        positions, each times its weight.
    trace : int, optional
        Particle that leaves a fading trace.
    trace_length : int
        Length of the trace in frames.

    Raises
    ------
    ValueError
        If an index is negative, or lengths or colours do not fit.
    """

    triangles: ArrayLike = ()
    triangle_colors: ArrayLike | None = None
    opacity: ArrayLike = 1.0
    bars: ArrayLike = ()
    bar_radius: ArrayLike = 0.015
    bar_colors: ArrayLike | None = None
    radii: ArrayLike = ()
    ball_colors: ArrayLike | None = None
    springs: ArrayLike = ()
    strain_scale: float = 1e-3
    skin: ArrayLike = ()
    trace: int | None = None
    trace_length: int = 300

    def __post_init__(self) -> None:
        def put(name: str, table: NDArray[Any], *shape: int) -> None:
            object.__setattr__(self, name, read_only(np.broadcast_to(table, shape) if shape else table))

        def checked(name: str, *shapes: tuple[int | None, ...], **bounds: float) -> NDArray[np.float64]:
            return array(f"Look.{name}", getattr(self, name), *shapes, **bounds)

        for name, columns in (("triangles", 3), ("bars", 2), ("springs", 2)):
            table = whole_array(f"Look.{name}", getattr(self, name), (None, columns), (0,))
            put(name, table.reshape(-1, columns))
        put("radii", checked("radii", (None,), low=0.0))
        triangles, bars, balls = (len(np.asarray(of)) for of in (self.triangles, self.bars, self.radii))
        put("bar_radius", checked("bar_radius", (), (bars,), low=TINY), bars)
        put("opacity", checked("opacity", (), (triangles,), low=TINY, high=1.0), triangles)
        for name, default, count in (
            ("triangle_colors", BLUE, triangles),
            ("bar_colors", STEEL, bars),
            ("ball_colors", SLATE, balls),
        ):
            given = default if getattr(self, name) is None else getattr(self, name)
            table = array(f"Look.{name}", given, (3,), (count, 3), low=0, high=255)
            put(name, table.astype(np.uint8), count, 3)
        put("skin", checked("skin", (None, None), (0,)))
        number("Look.strain_scale", self.strain_scale, TINY)
        if self.trace is not None:
            whole("Look.trace", self.trace)
        whole("Look.trace_length", self.trace_length, 2)

    @property
    def particles(self) -> int:
        """Return the least number of particles that the body must have."""
        skin = np.asarray(self.skin)
        triangles = np.asarray(self.triangles)
        if skin.size:
            triangles = triangles[:0]
        tables = (triangles, np.asarray(self.bars), np.asarray(self.springs))
        ends = [int(table.max()) + 1 for table in tables if table.size]
        traced = 0 if self.trace is None else self.trace + 1
        return max([0, *ends, len(np.asarray(self.radii)), traced, skin.shape[1] if skin.size else 0])

    def points(self, positions: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return all points that are drawn (…, N + V, 3): the particles, then those of the skin."""
        skin = np.asarray(self.skin)
        if not skin.size:
            return positions
        return np.concatenate([positions, skin @ positions[..., : skin.shape[1], :]], axis=-2)

    @cached_property
    def edges(self) -> NDArray[np.intp]:
        """Return rows (triangle, place of the edge's first corner in it, triangle across the edge).

        An edge that only one triangle has is not listed.
        """
        triangles = np.asarray(self.triangles).tolist()
        owner = {(t[k], t[(k + 1) % 3]): (i, k) for i, t in enumerate(triangles) for k in range(3)}
        rows = [(*owner[a, b], owner[b, a][0]) for a, b in owner if a < b and (b, a) in owner]
        return np.array(rows, dtype=np.intp).reshape(-1, 3)


def in_faces(triangles: np.ndarray, springs: np.ndarray, **more: Any) -> Look:
    """Return a `Look` that shows springs and a closed surface. Two triangles at a time have one colour."""
    colors = two_tone(len(triangles), blocks=max(1, len(triangles) // 2))
    return Look(triangles=triangles, triangle_colors=colors, springs=springs, **more)


def together(looks: Sequence[Look], counts: Sequence[int], trace: int | None = None) -> Look:
    """Join the looks of several bodies, whose particles lie one body after another.

    Parameters
    ----------
    looks
        The looks of the bodies; their own traces are left out.
    counts
        Number of particles of each body.
    trace
        Particle among all that leaves a fading trace.
    """
    starts = np.cumsum([0, *counts[:-1]])

    skins = [np.asarray(look.skin).reshape(-1, count) for look, count in zip(looks, counts, strict=True)]
    behind = sum(counts) + np.cumsum([0, *(len(skin) for skin in skins[:-1])])
    skin = np.zeros((sum(len(own) for own in skins), sum(counts)))
    for own, start, first in zip(skins, starts, behind - sum(counts), strict=True):
        skin[first : first + len(own), start : start + own.shape[1]] = own

    def moved(name: str) -> NDArray[np.intp]:
        """Join the indices of all bodies' particles and, from ``count`` on, of their skins."""
        tables = [np.asarray(getattr(look, name)) for look in looks]
        each = zip(tables, counts, starts, behind, strict=True)
        return np.concatenate([np.where(t < n, t + start, t - n + first) for t, n, start, first in each])

    def joined(name: str) -> NDArray[Any]:
        return np.concatenate([np.asarray(getattr(look, name)) for look in looks])

    def balls(name: str, shape: tuple[int, ...]) -> NDArray[Any]:
        """Return a property of the balls of all particles: a look may have no balls."""
        filled = [np.zeros((count, *shape)) for count in counts]
        for look, table in zip(looks, filled, strict=True):
            table[: len(np.asarray(look.radii))] = getattr(look, name)
        return np.concatenate(filled)

    return Look(
        triangles=moved("triangles"),
        triangle_colors=joined("triangle_colors"),
        opacity=joined("opacity"),
        bars=moved("bars"),
        bar_radius=joined("bar_radius"),
        bar_colors=joined("bar_colors"),
        radii=balls("radii", ()),
        ball_colors=balls("ball_colors", (3,)),
        springs=moved("springs"),
        skin=skin if skin.size else (),
        trace=trace,
    )


Part = Callable[[str, Any], object]

PARTS: Mapping[str, Part] = {
    **dict.fromkeys(
        ("point", "centre", "start", "end", "foot"), lambda name, value: array(name, value, (3,))
    ),
    **dict.fromkeys(("radius", "height"), lambda name, value: number(name, value, 0.0)),
    "normal": direction,
    "color": _color,
    "text": lambda name, value: instance(name, value, str),
}
"""Checks of the parts of marks and scenery, by their names."""


def _check_each(name: str, given: object, *parts: str) -> None:
    """Raise TypeError or ValueError unless a list holds tuples of some `PARTS`."""
    for n, row in enumerate(_list(name, given)):
        _check_parts(f"{name}[{n}]", row, *parts)


def _check_parts(name: str, row: object, *parts: str) -> None:
    """Raise TypeError or ValueError unless a tuple consists of some `PARTS`."""
    if not isinstance(row, (Sequence, np.ndarray)) or isinstance(row, str) or len(row) != len(parts):
        raise TypeError(f"{name} is {shown(row)}; it must be ({', '.join(parts)})")
    for part, value in zip(parts, row, strict=True):
        PARTS[part](f"{name}: {part}", value)


def _list(name: str, given: Any) -> Sequence[Any]:
    """Return a list or tuple, after checking that it is one."""
    if not isinstance(given, (Sequence, np.ndarray)) or isinstance(given, (str, bytes)):
        raise TypeError(f"{name} is {shown(given)}; it must be a list or tuple")
    return given  # type: ignore[return-value]


@refusing_unknown
@dataclass(frozen=True, eq=False)
class Arrow:
    """An arrow from ``origin`` by ``vector`` (both m, world axes): a force, an impulse, a direction.

    With a ``radius`` [m] it runs around the axis through ``origin`` along ``vector``, by the right hand, over
    an arc as long as ``vector``: a torque.

    Raises
    ------
    TypeError, ValueError
        If a vector, the colour or the radius is not one; the message names it.
    """

    origin: Point
    vector: Point
    color: Color = RED
    radius: float = 0.0

    def __post_init__(self) -> None:
        for name in ("origin", "vector"):
            array(f"Arrow.{name}", getattr(self, name), (3,))
        for name in ("color", "radius"):
            PARTS[name](f"Arrow.{name}", getattr(self, name))


@refusing_unknown
@dataclass(frozen=True, eq=False)
class Scenery:
    """The static surroundings of a body. Surfaces receive the shadow of the body.

    Parameters
    ----------
    floor : float, optional
        Height of a horizontal floor, m.
    planes : sequence of (point, normal)
        Further flat surfaces, walls or slopes: a point (m) and the normal into the free side.
    surfaces : sequence of Surface
        Curved surfaces around the body.
    vertical : (foot, height), optional
        Dashed reference line upwards from the point ``foot``, m.
    disks : sequence of (centre, radius, color)
        Horizontal disks on the floor, m; later ones cover earlier ones.

    Raises
    ------
    TypeError, ValueError
        If something has the wrong type, or a number is not finite; the message names it.
    """

    floor: float | None = None
    planes: Sequence[tuple[Point, Point]] = ()
    surfaces: Sequence[Surface] = ()
    vertical: tuple[Point, float] | None = None
    disks: Sequence[Disk] = ()

    def __post_init__(self) -> None:
        if self.floor is not None:
            number("Scenery.floor", self.floor)
        _check_each("Scenery.planes", self.planes, "point", "normal")
        for n, surface in enumerate(_list("Scenery.surfaces", self.surfaces)):
            instance(f"Scenery.surfaces[{n}]", surface, Surface)
        if self.vertical is not None:
            _check_parts("Scenery.vertical", self.vertical, "foot", "height")
        _check_each("Scenery.disks", self.disks, "centre", "radius", "color")


@refusing_unknown
@dataclass(frozen=True, eq=False)
class Marks:
    """Marks besides the body, which may change with every frame.

    A body hides what lies behind it. Arrows and balls show faintly through it, as the trace does.

    Parameters
    ----------
    disks : sequence of (centre, radius, color)
        Horizontal disks on the floor, m.
    rings : sequence of (centre, radius)
        Horizontal target rings, m.
    balls : sequence of (centre, radius)
        Translucent target balls, m.
    lines : sequence of (start, end)
        Rails and other slender straight objects, m.
    edges : sequence of (start, end, color)
        Coloured straight lines, m: outlines, ways to go.
    arrows : sequence of Arrow
        Forces, torques, directions to reach.
    text : sequence of str
        Lines in the top left corner.
    key : sequence of (color, str)
        Legend of the colours of arrows, rings and balls, in the bottom left corner.

    Raises
    ------
    TypeError, ValueError
        If something has the wrong type, or a number is not finite; the message names it.
    """

    disks: Sequence[Disk] = ()
    rings: Sequence[tuple[Point, float]] = ()
    balls: Sequence[tuple[Point, float]] = ()
    lines: Sequence[tuple[Point, Point]] = ()
    edges: Sequence[tuple[Point, Point, Color]] = ()
    arrows: Sequence[Arrow] = ()
    text: Sequence[str] = ()
    key: Sequence[tuple[Color, str]] = ()

    def __post_init__(self) -> None:
        _check_each("Marks.disks", self.disks, "centre", "radius", "color")
        for name in ("rings", "balls"):
            _check_each(f"Marks.{name}", getattr(self, name), "centre", "radius")
        _check_each("Marks.lines", self.lines, "start", "end")
        _check_each("Marks.edges", self.edges, "start", "end", "color")
        for n, arrow in enumerate(_list("Marks.arrows", self.arrows)):
            instance(f"Marks.arrows[{n}]", arrow, Arrow)
        for n, line in enumerate(_list("Marks.text", self.text)):
            instance(f"Marks.text[{n}]", line, str)
        _check_each("Marks.key", self.key, "color", "text")
