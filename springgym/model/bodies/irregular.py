"""Bodies of any shape: from points, from a mesh, and from convex parts (section 5.1.2)."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from itertools import combinations
from os import PathLike
from pathlib import Path
from typing import Literal

import numpy as np

from springgym.checks import TINY, array, chosen, instance, number, refusing_unknown, shown, unreadable
from springgym.core.extras import missing
from springgym.model.bodies import surface
from springgym.model.bodies.body import Body, rigid_motions, rigidity_matrix

LARGEST = 100_000_000
"""Largest size of a mesh file [bytes]."""

MOST_VERTICES = 400
"""Largest number of vertices of a body. More particles would be so light that only tiny steps are stable, and
the search for braces takes a time that grows as the third power of their number."""

MOST_POINTS = 10_000
"""Largest number of points of a hull: more take minutes."""

MERGED = 1e-6
"""Distance of corners of a mesh file below which they are one, relative to its size: many have six digits."""

MANY_PAIRS = 10_000
"""Number of pairs that are processed at once: 100 MB of numbers at `MOST_VERTICES`."""


@refusing_unknown
def from_points(
    points: Sequence[Sequence[float]],
    mass: float | Sequence[float] = 1.0,
    centre_mass: float | None = None,
    stiffness: float = 1e5,
    damping: float = 10.0,
) -> Body:
    """Make a body from the convex hull of points, with springs along its edges and to a centre.

    The centre lies at the mean of the corners. If the body is not rigid, springs are added until it is.

    Parameters
    ----------
    points : (n, 3)
        At least four, not in a plane [m].
    mass
        Mass of all corners together, shared equally, or mass of each point [kg]. In the first case, points
        inside the hull are left out. In the second case, there must be none.
    centre_mass
        Mass of the centre [kg]. The default is the mean of the corners' masses.
    stiffness, damping
        k [N/m], c [kg/s] of every spring.

    Raises
    ------
    ValueError
        If the points have no volume or are not finite, the masses do not fit them, or `Body` refuses the
        body.
    """
    cloud = array("points", points, (None, 3), (0,))
    masses = array("mass", mass, (), (len(cloud),), low=TINY)
    if centre_mass is not None:
        centre_mass = number("centre_mass", centre_mass, low=TINY)
    triangles = convex_hull(cloud)
    corners, triangles = np.unique(triangles, return_inverse=True)
    if masses.ndim:
        if len(corners) < len(cloud):
            inside = int(np.setdiff1d(np.arange(len(cloud)), corners)[0])
            raise ValueError(f"point {inside} at {cloud[inside]} lies inside the hull and cannot have a mass")
    else:
        masses = np.full(len(corners), masses / len(corners))
    return _braced(
        "hull",
        cloud[corners],
        triangles.reshape(-1, 3),
        np.append(masses, masses.mean() if centre_mass is None else centre_mass),
        cloud[corners].mean(axis=0),
        stiffness,
        damping,
    )


@refusing_unknown
def from_mesh(
    path: str | Path,
    mass: float = 1.0,
    by: Literal["volume", "area"] = "volume",
    scale: float = 1.0,
    stiffness: float = 1e5,
    damping: float = 10.0,
) -> Body:
    """Make a body of the vertices and edges of a mesh file (OBJ, STL, …), with springs through it.

    By volume, each tetrahedron between a triangle and the centre of the solid gives a quarter of its mass
    to each corner. The centre is a particle with springs to all vertices, so the centre of mass is that of
    the solid. By area, each triangle gives a third of its mass to each corner. There is no centre, and a
    spring joins each vertex to the farthest one. In both cases, springs are added until the body is rigid.
    The inertia is larger than the solid's, because the mass is at the vertices. It also depends on how the
    file divides the surface into triangles: another diagonal of a square gives its corners other shares.

    Corners nearer to each other than `MERGED` of the size are one. Triangles with two corners in one place,
    and those that are there already, are left out.

    Parameters
    ----------
    path
        The file; it needs ``trimesh`` (extra ``mesh``).
    mass
        Total mass [kg].
    by
        How the mass is shared.
    scale
        Length of the file's unit [m].
    stiffness, damping
        k [N/m], c [kg/s] of every spring.

    Raises
    ------
    ImportError
        Without trimesh.
    OSError
        If the file cannot be read.
    ValueError
        If the file holds no triangles; the mesh is too fine, is not closed, has triangles of both
        orientations, or consists of several solids; a vertex would have no mass by volume, because the mesh
        is far from convex; or `Body` refuses the body.
    """
    mass = number("mass", mass, low=TINY)
    chosen("by", by, ("volume", "area"))
    name, vertices, triangles, centre = read_mesh(path, scale)
    a, b, c = vertices[triangles].transpose(1, 0, 2)
    if by == "area":
        share = np.linalg.norm(np.cross(b - a, c - a), axis=1) / 6
        masses = np.bincount(triangles.ravel(), np.repeat(share, 3))
        return _braced(name, vertices, triangles, mass * masses / masses.sum(), None, stiffness, damping)
    volume = np.linalg.det(np.stack([a - centre, b - centre, c - centre], axis=1)) / 6
    masses = np.bincount(triangles.ravel(), np.repeat(volume / 4, 3))
    if (masses <= 0).any():
        vertex = int(np.argmin(masses))
        raise ValueError(
            f"{path} is so far from convex that vertex {vertex} would have no mass: "
            "take by='area', or the union of convex parts"
        )
    total = np.append(masses, volume.sum() / 4)
    return _braced(name, vertices, triangles, mass * total / total.sum(), centre, stiffness, damping)


def read_mesh(path: str | Path, scale: float) -> tuple[str, np.ndarray, np.ndarray, np.ndarray]:
    """Read a mesh file: name, vertices (n, 3) [m], triangles (T, 3), centre of mass of the solid (3,) [m].

    The surface is closed, its triangles anticlockwise seen from outside. Parameters and errors are those
    of `from_mesh`.
    """
    try:
        import trimesh
    except ImportError as error:
        raise ImportError(missing("reading a mesh", "trimesh", "mesh")) from error
    scale = number("scale", scale, low=TINY)
    path = Path(instance("path", path, str, PathLike))
    if why := unreadable(path, LARGEST):
        raise FileNotFoundError(f"mesh file {path}: {why}")
    try:
        mesh = trimesh.load_mesh(path, process=False)
    except Exception as error:  # its readers raise errors of any kind
        raise ValueError(f"{path} cannot be read as a mesh: {error}") from error
    if not len(mesh.faces):
        raise ValueError(
            f"{path} holds no triangles: it is empty, or not a mesh of the kind that its name says"
        )
    corners, triangles = _cleaned(array(f"{path}: vertices", np.array(mesh.vertices), (None, 3)), mesh.faces)
    if len(corners) > MOST_VERTICES:
        raise ValueError(f"{path} has {len(corners)} vertices; simplify it to at most {MOST_VERTICES}")
    edges, counts = surface.edges_and_counts(triangles)
    if (counts != 2).any():
        n = int(np.argmax(counts != 2))
        i, j = corners[edges[n]].tolist()
        there = "is 1 triangle" if counts[n] == 1 else f"are {counts[n]} triangles"
        raise ValueError(
            f"{path} is not a closed surface: at the edge from {i} to {j} there {there}; there must be 2 at "
            "each edge"
        )
    vertices = scale * corners
    solid = trimesh.Trimesh(corners, triangles, process=False)
    if len(edges := surface.same_sense(triangles)):
        i, j = corners[edges[0]].tolist()
        raise ValueError(
            f"{path} has triangles that face inwards beside others that face outwards, such as one at the "
            f"edge from {i} to {j}; reverse them, as trimesh.repair.fix_winding does"
        )
    if surface.volume(vertices, triangles) < 0:
        triangles = triangles[:, ::-1]
    if not surface.faces_out(vertices, triangles):
        raise ValueError(
            f"{path} does not enclose a solid: parts of its surface cut or "
            "cover each other, or are inside out"
        )
    solids = [shell for shell in surface.shells(triangles) if surface.volume(vertices, shell) > 0]
    if len(solids) > 1:  # those with inward normals are cavities
        raise ValueError(
            f"{path} is {len(solids)} solids that share no edge; it must be one. Make a body of each, and "
            "join them by springs, or by their union if they touch"
        )
    return path.stem, vertices, triangles, scale * np.array(solid.center_mass)


def _cleaned(vertices: np.ndarray, triangles: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return corners (n, 3) and triangles (T, 3) of a mesh without what repeats another or has no area.

    Corners are one if each of their coordinates differs by less than `MERGED` of the size.
    """
    near = MERGED * np.ptp(vertices, axis=0).max()
    place = np.empty(vertices.shape, int)
    for axis, values in enumerate(vertices.T):
        order = np.argsort(values)
        steps = np.diff(values[order], prepend=values[order[:1]])
        place[order, axis] = np.cumsum(steps > near)
    _, first, corner = np.unique(place, axis=0, return_index=True, return_inverse=True)
    triangles = first[corner.ravel()][triangles]
    ordered = np.sort(triangles, axis=1)
    wide = (ordered[:, 0] < ordered[:, 1]) & (ordered[:, 1] < ordered[:, 2])
    _, once = np.unique(ordered, axis=0, return_index=True)
    kept = triangles[np.intersect1d(np.flatnonzero(wide), once)]
    used, triangles = np.unique(kept, return_inverse=True)
    return vertices[used], triangles.reshape(-1, 3)


@refusing_unknown
def union(bodies: Sequence[Body], name: str = "union") -> Body:
    """Join bodies that touch. Particles at the same position become one, with the sum of the masses.

    If two bodies have a spring between the same two particles, stiffness and damping add up. Springs are
    added until the whole is rigid, so bodies may touch in an edge or a corner only.

    Parameters
    ----------
    bodies
        The bodies, in common coordinates. Each becomes a part, under its name.
    name
        Name of the new body.

    Raises
    ------
    ValueError
        If two bodies have the same name, a body touches no other, or has what a union does not take over: no
        springs or strained ones, a radius or round features.
    """
    if isinstance(bodies, (str, Body)) or not isinstance(bodies, Sequence) or not bodies:
        raise TypeError(f"bodies is {shown(bodies)}; it must be a list of bodies, at least one")
    bodies = [instance(f"bodies[{n}]", body, Body) for n, body in enumerate(bodies)]
    count = sum(len(body.masses) for body in bodies)
    if count > MOST_VERTICES:
        raise ValueError(f"bodies have {count} particles together; they must have at most {MOST_VERTICES}")
    instance("name", name, str)
    for body in bodies:
        has = {
            "round features": body.rounds,
            "a radius": body.radius,
            "no shape of its own": body.floppy,
            "no springs": not len(body.springs),
            "springs of other lengths": not np.allclose(body.lengths, body.with_(lengths=None).lengths),
        }
        if what := next((name for name, holds in has.items() if holds), ""):
            raise ValueError(f"body {body.name!r} has {what}, which a union does not keep")
    names = [body.name for body in bodies]
    if len(set(names)) < len(names):
        raise ValueError(f"bodies have the names {', '.join(names)}; they must differ")
    every = np.concatenate([body.positions for body in bodies])
    near = np.linalg.norm(every[:, None] - every, axis=2) < 1e-9 * np.ptp(every, axis=0).max()
    kept, index = np.unique(np.argmax(near, axis=1), return_inverse=True)
    offsets = np.cumsum([0] + [len(body.masses) for body in bodies])[:-1]
    strength: dict[tuple[int, int], np.ndarray] = {}
    triangles: list[tuple[int, int, int]] = []
    parts: dict[str, tuple[int, ...]] = {}
    for body, offset in zip(bodies, offsets, strict=True):
        place = index[offset : offset + len(body.masses)]
        parts[body.name] = tuple(place.tolist())
        for (i, j), k, c in zip(np.sort(place[body.springs]), body.stiffness, body.damping, strict=True):
            pair = int(i), int(j)
            strength[pair] = strength.get(pair, np.zeros(2)) + np.array([k, c])
        triangles += map(tuple, place[body.triangles].tolist())
    shared = Counter(frozenset(triangle) for triangle in triangles)
    outer = [triangle for triangle in triangles if shared[frozenset(triangle)] == 1]
    positions = every[kept]
    springs = np.array(list(strength), int).reshape(-1, 2)
    if (apart := surface.pieces(len(positions), springs)).any():
        stray = next(name for name, place in parts.items() if int(np.argmax(apart)) in place)
        raise ValueError(f"body {stray!r} does not touch body {names[0]!r}, directly or through others")
    added = braces(positions, springs)
    values = np.array(list(strength.values())).reshape(-1, 2)
    values = np.vstack([values, *[values.mean(axis=0)] * len(added)])
    return Body(
        name=name,
        positions=positions,
        masses=np.bincount(index, np.concatenate([body.masses for body in bodies])),
        springs=np.concatenate([springs, added]),
        stiffness=values[:, 0],
        damping=values[:, 1],
        parts=parts,
        triangles=np.array(outer, int).reshape(-1, 3),
    )


def convex_hull(points: np.ndarray) -> np.ndarray:
    """Return the triangles (T, 3) of the convex hull of points (n, 3), anticlockwise seen from outside.

    Points are added one by one, those farthest out first: the triangles that face a new point are replaced by
    those between it and their common rim (Clarkson & Shor 1989, doi:10.1007/BF02187740).

    Raises
    ------
    ValueError
        If the points have no volume or are not finite.
    """
    if not 4 <= len(points) <= MOST_POINTS:
        raise ValueError(f"points has {len(points)} rows; it must have 4 to {MOST_POINTS}")
    r = points - points.mean(axis=0)
    order = np.argsort(-np.linalg.norm(r, axis=1), kind="stable")
    tiny = 1e-9 * np.abs(r).max(initial=0.0)
    first = _spanning(r, order, tiny)
    middle = r[list(first)].mean(axis=0)
    faces = [t if np.linalg.det(r[list(t)] - middle) > 0 else t[::-1] for t in combinations(first, 3)]
    for p in order:
        corners = r[np.array(faces)]
        normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
        height = ((r[p] - corners[:, 0]) * normal).sum(axis=1) / np.linalg.norm(normal, axis=1)
        seen = {face for face, h in zip(faces, height, strict=True) if h > tiny}
        edges = dict.fromkeys((f[n], f[(n + 1) % 3]) for f in faces if f in seen for n in range(3))
        rim = [(a, b) for a, b in edges if (b, a) not in edges]
        faces = [face for face in faces if face not in seen] + [(a, b, int(p)) for a, b in rim]
        if len(faces) > 2 * MOST_VERTICES - 4:  # a hull of V corners has 2 V − 4
            raise ValueError(f"the hull of the points has more than {MOST_VERTICES} corners")
    return np.array(faces)


def _spanning(r: np.ndarray, order: np.ndarray, tiny: float) -> tuple[int, ...]:
    """Return four points that are not in a plane."""
    chosen = [int(order[0])]
    rest = r - r[chosen[0]]
    for _ in range(3):
        distance = np.linalg.norm(rest, axis=1)
        farthest = int(np.argmax(distance))
        if distance[farthest] <= tiny:
            raise ValueError(f"the {len(r)} points have no volume: they lie in a plane")
        chosen.append(farthest)
        along = rest[farthest] / distance[farthest]
        rest = rest - np.outer(rest @ along, along)
    return tuple(chosen)


def braces(positions: np.ndarray, springs: np.ndarray) -> np.ndarray:
    """Return pairs of particles (b, 2) between which springs must be added so that the body holds its shape.

    Each is the pair whose distance changes most in the remaining changes of shape.
    """
    count = len(positions)
    if count < 2:
        return np.zeros((0, 2), int)
    held = np.vstack(
        [
            rigidity_matrix(positions, springs).reshape(-1, 3 * count),
            rigid_motions(positions / np.ptp(positions, axis=0).max()).reshape(3 * count, 6).T,
        ]
    )
    _, sizes, rows = np.linalg.svd(held)
    free = rows[int(np.sum(sizes > 1e-9 * sizes[0])) :].T
    added: list[np.ndarray] = []
    if not free.shape[1]:
        return np.zeros((0, 2), int)
    pairs = np.array(list(combinations(range(count), 2)))
    parts = np.array_split(pairs, -(-len(pairs) // MANY_PAIRS))
    while free.shape[1]:
        effect = np.vstack([rigidity_matrix(positions, p).reshape(-1, 3 * count) @ free for p in parts])
        size = np.linalg.norm(effect, axis=1)
        best = int(np.argmax(size))
        if size[best] < 1e-9:
            break  # the points lie in a plane; `Body` says so
        added.append(pairs[best])
        free = free @ np.linalg.svd(effect[best : best + 1])[2][1:].T
    return np.array(added, int).reshape(-1, 2)


def _braced(
    name: str,
    vertices: np.ndarray,
    triangles: np.ndarray,
    masses: np.ndarray,
    centre: np.ndarray | None,
    stiffness: float,
    damping: float,
) -> Body:
    """Return a body of vertices, and of a centre if one is given, with springs along triangles and to it.

    Without a centre, each vertex is joined to the one farthest from it.
    """
    last = len(vertices)
    positions = vertices
    springs = surface.all_edges(triangles)
    parts = {"surface": tuple(range(last))}
    markers = None
    if centre is None:
        farthest = np.argmax(np.linalg.norm(vertices[:, None] - vertices, axis=2), axis=1)
        across = np.column_stack([np.arange(last), farthest])
        springs = np.unique(np.sort(np.vstack([springs, across]), axis=1), axis=0)
    else:
        positions = np.vstack([vertices, centre])
        springs = np.vstack([springs, [(last, n) for n in range(last)]])
        parts = parts | {"centre": (last,)}
        markers = (last, 0, 1)
    return Body(
        name=name,
        positions=positions,
        masses=masses,
        springs=np.vstack([springs, braces(positions, springs)]),
        stiffness=stiffness,  # type: ignore[arg-type]
        damping=damping,  # type: ignore[arg-type]
        markers=markers,  # type: ignore[arg-type]
        parts=parts,
        triangles=triangles,
    )
