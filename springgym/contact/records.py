"""The records of contact: surfaces, bodies that may meet, what is near what, and rows of contacts.

Arrays have a number of each copy of a block in each element, unless all copies share them.
"""

from __future__ import annotations

from typing import Any, NamedTuple, TypeAlias

import numpy as np

from springgym.contact.law import Span
from springgym.core.kinds import Number, Numbers, Rows, Vector

Kinds: TypeAlias = tuple[Any, ...]
"""All surfaces of each kind, see `springgym.surfaces.surface`; in overloads, Numba's types of them."""


Facing: TypeAlias = tuple[Vector, Number, Number]
"""The normal n̄ of a surface for a way, its square, and the gap [m] where the way begins."""


class Surfaces(NamedTuple):
    """Surfaces of any kinds, and how a body meets them."""

    kinds: Kinds
    strength: np.ndarray
    """c [N·m²], (1,)"""
    reach: float
    """Δ [m]"""
    radius: float | None
    """[m] of balls and rods, whose gaps count from their skin; None if all bodies are made of points"""
    coupled: bool | None
    """True if `springgym.surfaces.coupled`; else None, so that no turns are compiled"""


class Resistance(NamedTuple):
    """Coefficients of rolling and torsional resistance, of surfaces (1,) or of pairs of bodies (pairs,)."""

    rolling: np.ndarray
    """ρ [m]"""
    torsional: np.ndarray
    """τ [m]"""


class Given(NamedTuple):
    """The impulses that surfaces give a particle at a node, as changes of its velocity."""

    change: Vector
    """change of velocity by the pushes of surfaces [m/s]"""
    rub: Vector
    """change of velocity by friction [m/s]"""
    force: Vector
    """Σ J n [m/s]: the work of the barriers is its product with the way, over the time"""


PASSES = 2
"""Number of iterations, within a turn, that find the couple and the friction of a contact from each other."""


LEAST = 0.01
"""Least share of K by which friction is taken to change the slip of a feature that does not turn."""


class Rounds(NamedTuple):
    """The round features of a body."""

    first: np.ndarray
    """(features,) index of the first carrier of each feature in the arrays of carriers below"""
    behind: np.ndarray
    """(features,) and where they end"""
    particle: np.ndarray
    """(carriers,)"""
    base: np.ndarray
    """(carriers,) weight of the feature's centre"""
    slope: np.ndarray
    """(carriers, 3) B [1/m]"""
    matrix: np.ndarray
    """(3 features, 3) rows of A [m²]"""


class Rolling(NamedTuple):
    """Workspace in which round features roll: of particles (N, 3), and of rows (rows, 3).

    There is a row for each feature and surface.
    """

    velocity: Rows
    """velocities after the node, with the impulses found so far [m/s]"""
    change: Rows
    """change of velocity by pushes [m/s]; this and the next two as `springgym.contact.records.Given`"""
    rub: Rows
    """change of velocity by friction [m/s]"""
    force: Rows
    """Σ J n [m/s]"""
    point: Rows
    """ξ − ξc of the support point [m]"""
    normal: Rows
    """n, of the surface"""
    size: Rows
    """the gap where the step begins, d + s where it was not missed [m], W n² [1/kg]"""
    push: Rows
    """J L [N·s], and J"""
    friction: Rows
    """j [N·s]"""
    couple: Rows
    """q [N·m·s], if the scene has rolling or torsional resistance"""


class Shapes(NamedTuple):
    """The features of all bodies, one body after another, by the numbers of the scene's particles."""

    vertices: np.ndarray
    """(V, 1) the particle at each vertex"""
    triangles: np.ndarray | None
    """(T, 3) the particles at the corners of each triangle; None if no body has triangles"""
    edges: np.ndarray | None
    """(E, 2) the particles at the ends of each sharp edge, or rod of a body without triangles; None if no
    body has any"""
    start: np.ndarray
    """(3, bodies + 1) where each body's vertices, triangles and edges begin, and the end"""
    radius: np.ndarray
    """(bodies,) [m] of balls and rods"""
    rods: np.ndarray | None
    """(bodies,) whether a body is of rods; None if none is"""
    balls: np.ndarray | None
    """(bodies,) whether a body is a ball; None if none is"""


class Pairs(NamedTuple):
    """The pairs of bodies that may meet; each array has shape (pairs,)."""

    first: np.ndarray
    """the index of the first body of each pair"""
    second: np.ndarray
    """the index of the second body of each pair"""
    reach: np.ndarray
    """the reach Δ, the gap below which contact repels both bodies [m]"""
    least_reach: float
    """the least Δ of all pairs [m]"""
    parallel: np.ndarray
    """σ², the square of the sine below which two edges count as parallel [1]"""
    strength: np.ndarray
    """c of the barrier [N·m²]"""
    friction: np.ndarray | None
    """μ [1]; None if no pair rubs"""
    resistance: Resistance | None
    """the coefficients of rolling and torsional resistance of all pairs; None if all are zero"""
    loss: np.ndarray | None
    """β of restitution [1]; None if no pair loses any energy by it"""
    shapes: Shapes
    most: int
    """how many contacts a copy can have"""
    sweeps: int
    """in how many sweeps impulses are found"""


NONE = -1.0
"""Of a list, in a copy that has less than others."""


WATCHED, CLOSE = range(2)
"""Lists of pairs."""


class Lists(NamedTuple):
    """The lists of features that are near each other: the workspace of `springgym.contact.search`.

    Lists of features stay from node to node, one pair's behind another's.
    """

    origin: np.ndarray
    """(particles, 3) where vertices were when features were listed [m]"""
    shift: np.ndarray
    """(particles, 3) how far they moved since then [m]"""
    moved: np.ndarray
    """(bodies,) the farthest that a vertex moved [m]"""
    mean_shift: np.ndarray
    """(bodies, 3) the mean of how far vertices moved [m]"""
    bend: np.ndarray
    """(bodies,) the largest difference from it [m]"""
    mean: np.ndarray
    """(bodies, 3) the mean velocity of vertices [m/s]"""
    turning: np.ndarray
    """(bodies,) the largest difference from it [m/s]"""
    low: np.ndarray
    """(bodies, 3) lower corners of the boxes around the bodies, when features were listed [m]"""
    high: np.ndarray
    """(bodies, 3) and their upper corners [m]"""
    along: np.ndarray
    """(particles,) how far vertices are from the other body of a pair, along the line between both [m]"""
    listed: np.ndarray
    """(pairs,) all features of a pair that were nearer than this were listed; 0 before any were [m]"""
    gap: np.ndarray
    """(pairs,) no features of the pair were nearer than this when they were listed [m]"""
    nearest: np.ndarray
    """(pairs,) nor are any nearer than this at this node [m]"""
    reach: np.ndarray
    """(pairs,) how far to look for contacts at this node [m]"""
    watched: np.ndarray
    """(pairs,) list: pairs of bodies that are not far apart in some copy, ascending"""
    ahead: np.ndarray
    """(bodies,) by how much the way in half a step exceeds what is allowed for, as pairs were watched [m]"""
    margin: np.ndarray
    """(bodies,) the distance that a body may move before the search lists the watched pairs anew [m]"""
    travelled: np.ndarray
    """(bodies,) how far it moved at most since pairs were watched, up to when features were listed [m]"""
    close: np.ndarray
    """(pairs,) list of the watched pairs that may touch at this node"""
    length: np.ndarray
    """(2,) how many are `WATCHED`, and how many `CLOSE`"""
    kept: np.ndarray
    """(1,) whether the lists of all pairs are there"""
    used: np.ndarray
    """(4,) how many rows of vertices, triangles, edges and candidates are in use"""
    ends: np.ndarray
    """(pairs, 3, 3) where vertices, triangles and edges begin of the first body, of the second, and end"""
    vertex: np.ndarray
    """(V,) list: vertices of a pair that lie between the two bodies, the first's before"""
    vertex_particle: np.ndarray
    """(V,) which particles they are"""
    point: np.ndarray
    """(V, 3) where they are [m]"""
    triangle: np.ndarray
    """(T,) list of the triangles of a pair that lie between both bodies: those of the first body, then of the
    second"""
    triangle_particles: np.ndarray
    """(3 T,) the particles at the corners of these triangles"""
    corner: np.ndarray
    """(T, 3) the first corner of each triangle [m]"""
    first: np.ndarray
    """(T, 3) the side u of each triangle, from its first corner to its second [m]"""
    second: np.ndarray
    """(T, 3) the side w of each triangle, from its first corner to its third [m]"""
    normal: np.ndarray
    """(T, 3) the cross product u × w, whose length is twice the area of the triangle [m²]"""
    square: np.ndarray
    """(T,) |u × w|², the square of twice the area [m⁴]; −1 in rows without a triangle"""
    products: np.ndarray
    """(T, 3) the products |u|², u·w and |w|² of the sides [m²]"""
    sizes: np.ndarray
    """(T, 3) 1 over ``square`` [m⁻⁴], 1 over the product of all sides' squares [m⁻⁶], the largest of
    these [m²]"""
    edge: np.ndarray
    """(E,) list of the edges of a pair that lie between both bodies: those of the first body, then of the
    second"""
    edge_particles: np.ndarray
    """(2 E,) the particles at the ends of these edges"""
    start: np.ndarray
    """(E, 3) the first end of each edge [m]"""
    way: np.ndarray
    """(E, 3) the way from the first end of each edge to its second [m]; 0 in rows without an edge"""
    candidate: np.ndarray
    """rows of triangles and edges: first all of them, in turn; then those near a vertex or an edge"""
    faces: np.ndarray
    """(V, 2) where the candidates of a vertex begin there, and end: triangles of the other body"""
    partners: np.ndarray
    """(E, 2) where the candidates of an edge of the first body begin there, and end: edges of the second"""
    crossed: np.ndarray
    """(most,) list of the rows of edges of one body that cross edges of the other"""
    crossing: np.ndarray
    """(most,) the rows of the edges that they cross"""


Quad: TypeAlias = tuple[Number, Number, Number, Number]
"""A number of each of four particles."""


class Near(NamedTuple):
    """Two bodies near each other at a node."""

    pair: int
    bodies: tuple[int, int]
    lead: Number
    """time since the step began [s]"""
    reach: Number
    """how far to look for contacts [m]"""
    radius: Number
    """the radii of what lies around their features, both together [m]"""


class Touch(NamedTuple):
    """A contact of each copy, where its ``share`` is positive."""

    particles: Quad
    """the numbers of up to four particles"""
    weights: Quad
    """w of each: they sum to 0"""
    normal: Vector
    """n, from the second body to the first"""
    gap: Number
    """d [m]"""
    share: Number
    """Φ of the strength"""


FAR = 1e9
"""Distance [m] of what is no contact, in a lane where another copy has one."""


MET, ROWS = range(2)
"""The list of pairs that have contacts, and the rows of contacts."""


GOING, CHANGE = range(2)
"""Of a copy: 1 while its impulses are to change, else 0; and the largest change of a contact's speed since it
was set to 0, over its Δ [1/s]."""


Ends: TypeAlias = tuple[Vector, Vector, Vector, Vector]
"""A vector of each of the four ends of two edges."""


class Solids(NamedTuple):
    """Rigid bodies as contacts see them at a node, where an array has v [m/s] and L [kg·m²/s] of each in two
    rows."""

    start: np.ndarray
    """(bodies + 1,) where the particles of each begin among all, and the end"""
    balls: np.ndarray
    """(bodies,) whether a body is a single particle"""
    lightness: np.ndarray
    """(bodies,) 1/M [1/kg]; 0 of what is pinned"""
    turn: np.ndarray
    """(2 bodies, 3) I⁻¹ about the body's point: xx, yy, zz; xy, xz, yz [1/(kg·m²)]"""
    point: np.ndarray
    """(bodies, 3) [m]"""
    arm: np.ndarray
    """(2 contacts, 3) from the points of both bodies to where they are pushed [m]"""
    turns: np.ndarray
    """(2,) `GOING`, `CHANGE`"""


class Spheres(NamedTuple):
    """The spheres and capsules among bodies that collide, and all particles as contacts see them."""

    start: np.ndarray
    """(bodies + 1,) where the particles of each body begin among all, and the end"""
    radius: np.ndarray
    """(bodies,) [m]; 0 of what is no sphere"""
    skin: np.ndarray
    """(bodies,) the radius of spheres and capsules [m]; 0 of others"""
    thick: np.ndarray
    """(bodies,) the radius of all that is round, ropes and balls that do not turn among them [m]; else 0"""
    x: Rows
    """(N, 3) positions of the particles at the node [m]; in the first row of a sphere, its centre of mass"""
    before: Rows
    """(N, 3) velocities of the particles before the node [m/s]; in the first two rows of a sphere, v and ω"""
    inverse_mass: Numbers
    """(N,) inverse masses [1/kg]; in the first row of a sphere, 1/M"""
    turns: np.ndarray
    """(bodies,) whether contacts turn a body as a whole: spheres, capsules, and what resists their turning"""
    mass: Numbers
    """(N,) masses of the particles of bodies that turn [kg]"""
    centre: Rows
    """(bodies, 3) centres of mass of bodies that turn [m]"""
    turn: Rows
    """(2 bodies, 3) the inverse inertia I⁻¹ of each body that turns, in two rows: xx, yy, zz, and xy, xz, yz
    [1/(kg·m²)]; 0 if it is pinned"""
    kept: Rows
    """(N, 3) velocities of the particles of spheres, saved while their rows hold v and ω [m/s]"""
    began: Rows
    """(2 bodies, 3) v [m/s] and ω [rad/s] of each sphere that follow from the kept velocities"""


class ContactRows(NamedTuple):
    """The contacts of a node, a row each, with the impulses that they give."""

    length: np.ndarray
    """(2,) how many pairs have contacts, `MET`, and how many rows of contacts there are, `ROWS`"""
    met: np.ndarray
    """(pairs,) list of the pairs that have contacts, in ascending order"""
    left_out: np.ndarray
    """(pairs,) how many contacts there was no space for, at this node"""
    have: np.ndarray
    """(2,) how many contacts each copy has: in all, and of the pair that is looked at"""
    pair: np.ndarray
    """(rows,) the pair of bodies that meet in this contact, the same in all copies"""
    members: np.ndarray
    """(rows,) the number of particles of the contact, the same in all copies"""
    particle: np.ndarray
    """(4 rows,) the indices of these particles"""
    weight: np.ndarray
    """(4 rows,) the weights w of these particles in the way from one body to the other; they sum to 0"""
    normal: np.ndarray
    """(rows, 3) the normal n, from the second body to the first"""
    gap: np.ndarray
    """(rows,) the gap d between both bodies [m]; `FAR` in copies without this contact"""
    share: np.ndarray
    """(rows,) the factor Φ, 0 to 1, by which the strength c is multiplied where edges meet"""
    approach: np.ndarray
    """(rows,) the speed u₀ along the normal before the node [m/s]"""
    gain: np.ndarray
    """(4 rows,) w/m [1/kg]"""
    inverse_mass: np.ndarray
    """(rows,) the inverse mass W along the normal [1/kg]"""
    impulse: np.ndarray
    """(rows,) the impulse J along the normal [N·s]"""
    friction: np.ndarray
    """(rows, 3) the impulse of friction [N·s]"""
    couple: np.ndarray
    """(rows, 3) the angular impulse of the couple on the first body of the pair [N·m·s]"""
    taper: np.ndarray
    """(rows, 3) the impulse of the gradient of Φ [N·s]"""
    tilt: np.ndarray
    """(2 rows, 3) G and H; of a rod, G and the direction along it: see `springgym.contact.friction`"""
    grips: np.ndarray
    """(rows,) 1 where friction acts, else 0"""
    losses: np.ndarray
    """(pairs, 3) energy that a pair lost at this node: see `add_loss` [J]"""
    solids: Solids | None
    """the rigid bodies that contacts move; None where particles move by themselves"""
    spheres: Spheres | None = None
    """the spheres that turn, among bodies of springs; None if there are none"""


class Problem(NamedTuple):
    """All that the impulses of the contacts of a node follow from."""

    span: Span
    """the time of the node"""
    rows: int
    """how many rows of contacts there are"""
    x: Rows
    """(N, 3) positions of all particles at the node [m]"""
    before: Rows
    """(N, 3) velocities before it [m/s]; of rigid bodies, as `springgym.contact.records.Solids` has them"""
    inverse_mass: Numbers
    """(N,) the inverse masses of the particles [1/kg]"""
    pairs: Pairs
    """the pairs of bodies, and what they are like"""
    contacts: ContactRows
    """the contacts, and where their impulses are written"""
    totals: Numbers
    """the totals of each pair, see `springgym.contact.totals`"""


class Search(NamedTuple):
    """All that a search for contacts reads and writes."""

    x: Rows
    """positions (N, 3) [m]"""
    w: Rows
    """velocities (N, 3) before the node [m/s]"""
    pairs: Pairs
    lists: Lists
    contacts: ContactRows


class WarmStart(NamedTuple):
    """The impulses of contacts at the last node: a table of each copy, of a power of 2 of rows."""

    pair: np.ndarray
    """(rows,) the index of the contact's pair, plus one; 0 in an empty row"""
    first: np.ndarray
    """(rows,) the first particle of the contact"""
    others: np.ndarray
    """(rows,) a number that the other ends of two edges make; 0 of the contact of a vertex"""
    impulse: np.ndarray
    """(rows,) the impulse J along the normal [N·s]"""
    friction: np.ndarray | None
    """(rows, 3) the impulse of friction [N·s]; None if no pair rubs"""
    couple: np.ndarray | None
    """(rows, 3) the angular impulse of the couple [N·m·s]; None if no turning is resisted"""


TOUCHING, IMPULSE, GAP, ENERGY, CONTACT, FRICTION, MISSES, FAST, OVERFLOW, FASTEST = range(10)
"""The totals of a pair: whether it touches; the sum of J [N·s]; the least gap [m]; the energy in the barriers
[J]; what was lost to restitution and to friction [J]; how often a contact was found too late, was faster than
it is computed well for, or had no space; and the largest speed along its normal that any contact which pushes
was reached with [m/s]."""


ENTRIES = 10


class Collisions(NamedTuple):
    """Bodies that collide, and what is told of them."""

    pairs: Pairs
    totals: np.ndarray
    """(pairs × `ENTRIES`,)"""
    totals_before: np.ndarray
    """(pairs × `ENTRIES`,) before the last node"""
    changing: np.ndarray
    """(1 + pairs,) list: how many pairs, and which, ascending, touch, or have totals that are not those from
    before the last node; the totals of all others stay as they are"""
    warm: WarmStart | None = None
    """the impulses of the last node; None if contacts start from nothing"""
