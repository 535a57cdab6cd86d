"""Bodies from a shape and a material: masses from moments, springs from elasticity, dampers from loss.

A body of ten to forty particles is not a discretised solid. It is a reduced model with few parameters. They
are chosen such that these properties agree with the solid:

- **Masses.** Σ m (1, x, x xᵀ) = ∫ρ (1, x, x xᵀ): mass, centre and inertia tensor are the solid's.
- **Springs.** The lowest frequency ω₁ of the free body, and the growth of its moments of inertia under
  spin about three axes, are the solid's (`springgym.theory.solid`): see `bodies.network.calibrated`.
- **Dampers.** c = η k/ω₁, so that its lowest vibration has the damping ratio η/2.

`Body.solid` holds the solid and how well the body agrees with it. The body's repr shows this.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from functools import lru_cache
from itertools import permutations, product
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from springgym.checks import TINY, array, instance, number, refusing_unknown, shown, whole
from springgym.model.bodies.body import MOST_PARTICLES, Body
from springgym.model.bodies.cube import CORNERS, FACES
from springgym.model.bodies.elastic import HIGHER, Cable, Elastic
from springgym.model.bodies.irregular import MOST_VERTICES, braces, convex_hull, read_mesh
from springgym.model.bodies.lattice import grid, lattice
from springgym.model.bodies.network import (
    Network,
    bars,
    calibrated,
    moment_masses,
    orbits,
    response,
    second_moments,
)
from springgym.model.bodies.network import missed as missed_by
from springgym.model.bodies.rope import rope
from springgym.model.bodies.surface import all_edges
from springgym.model.materials import SOFTEST, Material, material_of
from springgym.theory import rope as chain
from springgym.theory import solid as theory

ENOUGH = 0.01
"""Relative error of frequency and growths above which a hull gets more particles."""

MOST_RING = 40
"""Largest number of particles in a top's ring: its four kinds of springs fit no better with more."""

MOST_UNEQUAL = 100.0
"""Largest ratio of radius and height of a top, or its inverse."""

FLATTEST = 30.0
"""Largest ratio of the root mean square coordinates of other solids along their principal axes."""

AXIS_RELUCTANCE = 30.0
"""The spring along the axis of a top changes less than others in calibration, by this weight."""

FINE = 60
"""Solids of more triangles than this are solved with polynomials of degree 6, with errors up to 2e-3."""

REFLECTIONS = tuple(np.diag(signs) for signs in product((1.0, -1.0), repeat=3))
"""The symmetries of wood with its grain along z."""

SWAPS = tuple(np.eye(3)[list(order)] @ signs for order in permutations(range(3)) for signs in REFLECTIONS)
"""The symmetries of a cube."""

Tensor = tuple[float, ...]
"""An elasticity tensor over the Young's modulus, flat, to 12 digits: a key for cached solutions."""


class Unit(NamedTuple):
    """A solved shape, of unit density and Young's modulus."""

    network: Network
    stiffness: np.ndarray
    """(S,) stiffness of each spring"""
    solid: theory.ElasticSolid
    axes: np.ndarray
    """(3, 3) axes of spin, columns"""
    frequency_ratio: float
    stretch_ratios: np.ndarray
    """(3,) as ``frequency_ratio``, of the springs over those of the solid"""
    moved: np.ndarray
    """(3, N, 3) displacements of the particles by the centrifugal force of a spin ω = 1 about each axis,
    relative to the centre of mass"""


# --- Shapes -----------------------------------------------------------------------------------------


@refusing_unknown
def solid_top(
    radius: float, height: float, material: Material | str, ring: int = 12, softened: float = 1.0
) -> Body:
    """Make a solid cone on its tip: a ring of particles at its edge, a tip, and a heart on the axis.

    The heart lies at two thirds of the height and has 0.675 of the mass. The ring has 0.3, and the tip 0.025.
    Only these values give the cone's mass, centre and inertia. Springs join ring neighbours, and join
    heart and tip to the ring and to each other. Wood has its grain along the axis.

    Parameters
    ----------
    radius, height
        Radius and height of the cone [m].
    material
        A `springgym.model.materials.Material`, or the name of one in `springgym.model.materials.MATERIALS`.
    ring
        Number of particles in the ring, at least 4.
    softened
        Factor by which the body is softer than the material, see `Material.softened`.

    Raises
    ------
    TypeError
        If an argument has the wrong type, see `springgym.checks`.
    ValueError
        If a number is out of bounds (a height is from 1/100 to 100 radii), or the material is unknown.
    """
    ring = whole("ring", ring, 4, MOST_RING)
    radius = number("radius", radius, low=TINY)
    height = number("height", height, low=TINY)
    if not 1 / MOST_UNEQUAL <= radius / height <= MOST_UNEQUAL:
        raise ValueError(
            f"radius is {radius:g} and height {height:g}; neither must be more than {MOST_UNEQUAL:g} "
            "times the other"
        )
    made = material_of(material, softened)
    unit = _unit_top(radius / height, ring, _tensor(made))
    heart = ring
    tip = ring + 1
    edge = [(n, (n + 1) % ring) for n in range(ring)]
    # pinned at its tip, at a height l = ¾ h below its centre, a top precesses at Ω = M g l/I₃ω
    of_springs = unit.solid.stretch[2] * unit.stretch_ratios[2] + unit.moved[2, tip, 2] / 0.75
    of_solid = unit.solid.stretch[2] + unit.solid.moved[2, 0, 2] / 0.75
    return _body(
        unit,
        made,
        height,
        "cone",
        precession_ratio=float(of_springs / of_solid),
        name="top",
        markers=(tip, heart, 0),
        parts={"ring": tuple(range(ring)), "heart": (heart,), "tip": (tip,)},
        triangles=np.array([(heart, i, j) for i, j in edge] + [(tip, j, i) for i, j in edge]),
    )


@lru_cache(maxsize=64)
def _unit_top(ratio: float, ring: int, tensor: Tensor) -> Unit:
    """Make a cone of height 1 and this radius."""
    angle = 2 * math.pi * np.arange(ring) / ring
    heart = ring
    tip = ring + 1
    positions = np.zeros((ring + 2, 3))
    positions[:ring, 0], positions[:ring, 1] = ratio * np.cos(angle), ratio * np.sin(angle)
    positions[:ring, 2] = 1.0
    positions[heart, 2] = 2 / 3
    springs = [pair for n in range(ring) for pair in ((n, (n + 1) % ring), (n, heart), (n, tip))]
    masses = math.pi * ratio**2 / 3 * np.array([0.3 / ring] * ring + [0.675, 0.025])
    step = 2 * math.pi / ring
    turn = np.array([[math.cos(step), -math.sin(step), 0], [math.sin(step), math.cos(step), 0], [0, 0, 1]])
    network = Network(positions, masses, np.array([*springs, (heart, tip)]))
    begin = bars(network)
    reluctance = np.ones(len(network.springs))
    # core of the cone: its mean section over the spring's length; flat tops would need small steps
    begin[-1] = min(1.5 * masses.sum(), 1.0)
    reluctance[-1] = AXIS_RELUCTANCE
    return _solved(
        network,
        theory.cone_rule(ratio, 1.0),
        tensor,
        [*REFLECTIONS, *([turn] if _is_isotropic(tensor) else [])],
        begin,
        reluctance,
        marks=positions[tip],
    )


@refusing_unknown
def solid_box(
    sides: Sequence[float], material: Material | str, cells: int = 1, softened: float = 1.0
) -> Body:
    """Make a solid box about the origin.

    With ``cells`` = 1, the box has nearly cubic cells, one along its shortest side, with particles at
    their corners and centres. Springs join neighbours and are calibrated. A cube has 9 particles and 32
    springs. Wood has its grain along z.

    With more cells along its shortest side, the box is a lattice of springs along edges and face diagonals.
    Their stiffnesses follow from the Young's modulus alone. With more cells, the lattice converges to a solid
    without grain whose Poisson's ratio is ¼, as springs between neighbours imply.

    Parameters
    ----------
    sides : (3,)
        [m]
    material
        A `springgym.model.materials.Material`, or the name of one in `springgym.model.materials.MATERIALS`.
    cells
        Number of cells along the shortest side.
    softened
        Factor by which the body is softer than the material, see `Material.softened`.

    Raises
    ------
    TypeError
        If an argument has the wrong type, see `springgym.checks`.
    ValueError
        If a number is out of bounds, the material is unknown, a lattice is of wood, cells are too far from
        cubes, or the body would have more than 400 particles.
    """
    lengths = array("sides", sides, (3,), low=TINY)
    cells = whole("cells", cells, 1, MOST_VERTICES)
    made = material_of(material, softened)
    size = float(lengths.min())
    shares = tuple((lengths / size).tolist())
    counts = tuple(max(1, round(cells * share)) for share in shares)
    particles = math.prod(n + 1 for n in counts) + (math.prod(counts) if cells == 1 else 0)
    if particles > MOST_VERTICES:
        raise ValueError(
            f"sides are {shown(sides)} and cells {cells}; such a box has {particles:g} particles, and must "
            f"have at most {MOST_VERTICES}"
        )
    if cells > 1 and made.grain:
        raise ValueError(f"cells is {cells}; a box of {made.name!r} must have 1: a lattice has no grain")
    unit = _unit_box(shares, counts, _tensor(made)) if cells == 1 else _unit_lattice(shares, counts)
    where = np.array(shares) / 2 * np.vstack([CORNERS, CORNERS * (1, 1, -1)])
    corner = np.linalg.norm(unit.network.positions - where[:, None], axis=2).argmin(axis=1).tolist()
    return _body(
        unit,
        made,
        size,
        "box",
        missed=HIGHER if cells == 1 else f"a Poisson's ratio of {made.poisson}",
        name="box",
        markers=(corner[4], corner[0], corner[5]),
        parts={f"corner {n}": (i,) for n, i in enumerate(corner)}
        | {"top": tuple(corner[:4]), "bottom": tuple(corner[4:])},
        triangles=np.array([[corner[n] for n in t] for a, b, c, d in FACES for t in ((a, b, c), (a, c, d))]),
    )


@lru_cache(maxsize=64)
def _unit_box(sides: tuple[float, ...], counts: tuple[int, ...], tensor: Tensor) -> Unit:
    """Return a solved box of cells with a particle at each corner and centre."""
    cell = np.array(sides) / counts
    corners = grid(sides, counts)
    centres = grid(sides - cell, np.array(counts) - 1)
    positions = np.vstack([corners, centres])
    apart = np.abs(positions[:, None] - positions) / cell
    close = (apart < 1 + 1e-9).all(axis=2)  # of the same cell
    along = np.isclose(apart.sum(axis=2), 1)  # edges of cells, links between centres
    face = close & (np.isclose(apart.sum(axis=2), 2)) & (np.isclose(apart.max(axis=2), 1))
    spoke = close & np.isclose(apart, 0.5).all(axis=2)
    springs = np.argwhere(np.triu(along | face | spoke, 1))
    rule = theory.box_rule(sides)
    masses = moment_masses(positions, rule)
    if masses is None:
        raise ValueError(
            f"no masses at {len(positions)} particles have the moments of a box of sides {sides}"
        )
    symmetries = SWAPS if _is_isotropic(tensor) else REFLECTIONS
    return _solved(Network(positions, masses, springs), rule, tensor, list(symmetries))


@lru_cache(maxsize=64)
def _unit_lattice(sides: tuple[float, ...], counts: tuple[int, ...]) -> Unit:
    """Return a solved box of cells with edges and face diagonals, see `lattice`."""
    network, stiffness = lattice(sides, counts)
    tensor = tuple(theory.isotropic(1.0, 0.25).ravel())
    solid = theory.elastic_solid(theory.box_rule(sides), 1.0, np.reshape(tensor, (3,) * 4))
    return _measured(network, stiffness, np.eye(3), solid)


@refusing_unknown
def solid_hull(points: Sequence[Sequence[float]], material: Material | str, softened: float = 1.0) -> Body:
    """Make the solid convex hull of points, with particles at its corners and at its centre of mass.

    If no positive masses of these particles give the solid's moments, or no springs between them give its
    lowest frequency, there are further particles in the middles of the edges. Wood has its grain along z.

    Parameters
    ----------
    points : (n, 3)
        At least four, not in a plane [m].
    material
        A `springgym.model.materials.Material`, or the name of one in `springgym.model.materials.MATERIALS`.
    softened
        Factor by which the body is softer than the material, see `Material.softened`.

    Raises
    ------
    TypeError
        If an argument has the wrong type, see `springgym.checks`.
    ValueError
        If the points have no volume or are not finite, or the material is unknown.
    """
    cloud = array("points", points, (None, 3), (0,))
    made = material_of(material, softened)
    corners, triangles = np.unique(convex_hull(cloud), return_inverse=True)
    return _polyhedron("hull", cloud[corners], triangles.reshape(-1, 3), made, "convex hull")


@refusing_unknown
def solid_mesh(path: str | Path, material: Material | str, scale: float = 1.0, softened: float = 1.0) -> Body:
    """Make the solid inside the closed surface of a mesh file, with particles at vertices and centre of mass.

    If no positive masses of these particles give the solid's moments, or no springs between them give its
    lowest frequency, there are further particles in the middles of the edges. Wood has its grain along z.

    Parameters
    ----------
    path
        The file; it needs ``trimesh`` (extra ``mesh``).
    material
        A `springgym.model.materials.Material`, or the name of one in `springgym.model.materials.MATERIALS`.
    scale
        Length of the file's unit [m].
    softened
        Factor by which the body is softer than the material, see `Material.softened`.

    Raises
    ------
    ImportError
        Without trimesh.
    OSError
        If the file cannot be read.
    ValueError
        If the file is not a mesh, `from_mesh` refuses it, or no masses give its moments.
    """
    made = material_of(material, softened)
    name, vertices, triangles, _ = read_mesh(path, scale)
    return _polyhedron(name, vertices, triangles, made, "mesh")


def _polyhedron(
    name: str, vertices: np.ndarray, triangles: np.ndarray, material: Material, shape: str
) -> Body:
    size = float(np.ptp(vertices, axis=0).max())
    middle = vertices.mean(axis=0)
    unit, outside = _unit_polyhedron(
        tuple(map(tuple, ((vertices - middle) / size).tolist())),
        tuple(map(tuple, triangles.tolist())),
        _tensor(material),
    )
    last = len(unit.network.masses) - 1
    return _body(
        unit,
        material,
        size,
        shape,
        at=middle,
        name=name,
        markers=(last, 0, 1),
        parts={"surface": tuple(range(last)), "centre": (last,)},
        triangles=outside,
    )


@lru_cache(maxsize=64)
def _unit_polyhedron(
    points: tuple[tuple[float, ...], ...], faces: tuple[tuple[int, ...], ...], tensor: Tensor
) -> tuple[Unit, np.ndarray]:
    """Return the unit with the fewest particles that fits the solid, and the triangles of its surface."""
    vertices = np.array(points)
    triangles = np.array(faces)
    rule = theory.polyhedron_rule(vertices, triangles, theory.DEGREE if len(faces) <= FINE else 6)
    centre = rule.weights @ rule.points / rule.weights.sum()
    arm = rule.points - centre
    extents = np.sqrt(np.maximum(np.linalg.eigvalsh((rule.weights * arm.T) @ arm), 0.0))
    if not FLATTEST * extents[0] >= extents[-1]:
        raise ValueError(
            "the points of the surface are too flat or slender: in one direction the solid extends less "
            f"than 1/{FLATTEST:g} of what it does in another"
        )
    symmetries = SWAPS if _is_isotropic(tensor) else REFLECTIONS
    found: list[tuple[Unit, np.ndarray]] = []
    for corners, outside in ((vertices, triangles), _subdivided(vertices, triangles)):
        if len(corners) > MOST_VERTICES:
            break
        positions = np.vstack([corners, centre])
        masses = moment_masses(positions, rule)
        if masses is None:
            continue
        springs = np.vstack([all_edges(outside), [(len(corners), n) for n in range(len(corners))]])
        springs = np.vstack([springs, braces(positions, springs)])
        unit = _solved(Network(positions, masses, springs), rule, tensor, list(symmetries))
        found.append((unit, outside))
        if missed_by(unit.frequency_ratio, unit.stretch_ratios) < ENOUGH:
            break
    if not found:
        raise ValueError(
            f"no positive masses at the {len(vertices)} corners and the centre of mass have the moments of "
            "the solid: it is too far from convex, or too fine to be refined"
        )
    return min(found, key=lambda pair: missed_by(pair[0].frequency_ratio, pair[0].stretch_ratios))


def _subdivided(vertices: np.ndarray, triangles: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Divide each triangle of a surface into four, with the middles of its edges as further vertices."""
    edges = all_edges(triangles)
    middle = {pair: len(vertices) + n for n, pair in enumerate(map(tuple, edges.tolist()))}
    finer = []
    for corner in triangles.tolist():
        ab, bc, ca = (middle[min(p), max(p)] for p in zip(corner, corner[1:] + corner[:1], strict=True))
        a, b, c = corner
        finer += [(a, ab, ca), (ab, b, bc), (ca, bc, c), (ab, bc, ca)]
    return np.vstack([vertices, vertices[edges].mean(axis=1)]), np.array(finer)


@refusing_unknown
def solid_rope(
    material: Material | str,
    diameter: float,
    length: float = 5.0,
    end_mass: float = 70.0,
    beads: int = 10,
    softened: float = 1.0,
) -> Body:
    """Make a round cable with a weight at its end, from the origin straight down. The body is floppy.

    Each of the n = ``beads`` − 1 springs has k = E A n/L. Each bead has the mass ρ A L/n of the cable around
    it, and the two ends have half of that. Dampers follow from the lowest bounce, c = η k/ω. The cable does
    not resist bending.

    Parameters
    ----------
    material
        A `springgym.model.materials.Material`, or the name of one in `springgym.model.materials.MATERIALS`.
    diameter, length
        [m], unstretched.
    end_mass
        Mass of the weight [kg].
    beads
        Number of particles, at least 2, including the top one (which you pin) and the weight at the end.
    softened
        Factor by which the body is softer than the material, see `Material.softened`.

    Raises
    ------
    TypeError
        If an argument has the wrong type, see `springgym.checks`.
    ValueError
        If a number is out of bounds, or the material is unknown.
    """
    diameter = number("diameter", diameter, low=TINY)
    length = number("length", length, low=TINY)
    beads = whole("beads", beads, 2, MOST_PARTICLES)
    end_mass = number("end_mass", end_mass, low=TINY)
    cable = Cable(material_of(material, softened), diameter, length, end_mass)
    masses = np.full(beads, cable.mass / (beads - 1))
    masses[[0, -1]] /= 2
    masses[-1] += end_mass
    stiffness = cable.material.young * cable.section * (beads - 1) / length
    bounce = chain.bounce_modes(masses[1:], stiffness).frequencies[0]
    damping = cable.material.loss * stiffness / bounce
    even = rope(beads, length, stiffness=stiffness, damping=damping)
    return even.with_(masses=masses, solid=cable)


@refusing_unknown
def softened(body: Body, factor: float) -> Body:
    """Return a body with stiffnesses divided by a factor, dampers by its root: damping ratios are equal.

    A body of a material becomes one of `Material.softened`. Other bodies work, too.

    Raises
    ------
    TypeError
        If an argument has the wrong type, see `springgym.checks`.
    ValueError
        If the factor is not positive, or farther from 1 than `springgym.model.materials.SOFTEST`.
    """
    factor = number("factor", factor, 1 / SOFTEST, SOFTEST)
    solid = instance("body", body, Body).solid
    if isinstance(solid, Elastic):
        solid = replace(
            solid,
            material=solid.material.softened(factor),
            frequency=solid.frequency / math.sqrt(factor),
            stretch=solid.stretch * factor,
        )
    elif solid is not None:
        solid = replace(solid, material=solid.material.softened(factor))
    return body.with_(
        stiffness=body.stiffness / factor, damping=body.damping / math.sqrt(factor), solid=solid
    )


# --- From a shape to a body -------------------------------------------------------------------------


def _tensor(material: Material) -> Tensor:
    return tuple(np.round(material.elasticity() / material.young, 12).ravel().tolist())


def _is_isotropic(tensor: Tensor) -> bool:
    """Return whether an elasticity tensor is isotropic: no grain."""
    c = np.reshape(tensor, (3, 3, 3, 3))
    return bool(np.isclose(c[0, 0, 0, 0], c[2, 2, 2, 2]) and np.isclose(c[0, 0, 0, 0], c[1, 1, 1, 1]))


def _solved(
    network: Network,
    rule: theory.Rule,
    tensor: Tensor,
    symmetries: Sequence[np.ndarray],
    begin: np.ndarray | None = None,
    reluctance: np.ndarray | float = 1.0,
    marks: ArrayLike = (),
) -> Unit:
    """Return a network with calibrated springs; see `calibrated`, `springgym.theory.solid.elastic_solid`."""
    second = second_moments(network)
    axes = np.eye(3)
    if np.abs(second - np.diag(np.diag(second))).max() > 1e-9 * np.trace(second):
        axes = np.linalg.eigh(second)[1]
    solid = theory.elastic_solid(rule, 1.0, np.reshape(tensor, (3,) * 4), axes, marks)
    groups = orbits(network, symmetries)
    frequency = float(solid.frequencies[0])
    begin = bars(network) if begin is None else begin
    stiffness = calibrated(network, axes, frequency, solid.stretch, groups, begin, reluctance)
    return _measured(network, stiffness, axes, solid)


def _measured(network: Network, stiffness: np.ndarray, axes: np.ndarray, solid: theory.ElasticSolid) -> Unit:
    reached = response(network, stiffness, axes)
    ratio = math.sqrt(reached.squares[0]) / float(solid.frequencies[0])
    ratios = reached.stretch / solid.stretch
    return Unit(network, stiffness, solid, axes, ratio, ratios, reached.moved)


def _body(
    unit: Unit,
    material: Material,
    size: float,
    shape: str,
    *,
    at: Sequence[float] | np.ndarray = (0.0, 0.0, 0.0),
    missed: str = HIGHER,
    precession_ratio: float | None = None,
    **named: Any,
) -> Body:
    """Return the body of a unit of length ``size`` [m], at ``at`` [m]; ``named`` are fields of `Body`."""
    solid = unit.solid
    scale = material.density * size**3
    frequency = float(solid.frequencies[0]) * math.sqrt(material.young / material.density) / size
    stiffness = unit.stiffness * material.young * size
    stands_for = Elastic(
        material=material,
        shape=shape,
        mass=solid.mass * scale,
        centre=solid.centre * size + at,
        inertia=solid.inertia * scale * size**2,
        frequency=frequency,
        axes=unit.axes,
        stretch=solid.stretch * material.density * size**2 / material.young,
        frequency_ratio=unit.frequency_ratio,
        stretch_ratios=unit.stretch_ratios,
        precession_ratio=precession_ratio,
        missed=missed,
    )
    return Body(
        positions=unit.network.positions * size + at,
        masses=unit.network.masses * scale,
        springs=unit.network.springs,
        stiffness=stiffness,
        damping=material.loss * stiffness / frequency,
        solid=stands_for,
        **named,
    )
