"""The simulator: a scene, an integrator and a step, for one copy or many."""

from __future__ import annotations

import math
import os
import sys
import warnings
from collections import deque
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping, Sequence, Set
from concurrent.futures import ThreadPoolExecutor
from copy import deepcopy
from functools import cached_property, lru_cache
from itertools import repeat
from numbers import Real
from threading import Lock
from typing import Any, Self

import numpy as np
from numpy.typing import ArrayLike, DTypeLike

from springgym import checks
from springgym.checks import FLOAT, HUGE, INDEX, LARGEST_WHOLE, TINY, refusing_unknown
from springgym.core.compiler.decorators import SameTypes
from springgym.core.guard import Guard, guarded
from springgym.core.language.blocks import (
    WIDTH,
    aligned_zeros,
    ascending,
    block_array,
    by_copies,
    chosen_copies,
    flat_numbers,
    get_copies,
    layout_for,
    numbers,
    put,
    to_copies,
)
from springgym.core.language.kinds import Nested, Ragged
from springgym.core.language.ragged import share, stacked
from springgym.dynamics import contacts, measures, packing, stability
from springgym.dynamics.contact import totals
from springgym.dynamics.contact.law import SLOW
from springgym.dynamics.contact.overlap import find_overlaps, outlines
from springgym.dynamics.contact.totals import RESOLVED, PairReadings
from springgym.dynamics.contacts import Contacts, PairSums
from springgym.dynamics.forces.ledger import LEDGER_ENTRIES
from springgym.dynamics.measures import Markers, Measures, Reading, Readout
from springgym.dynamics.methods.clock import Clock
from springgym.dynamics.methods.record import STEP_COUNTS, Control, Phase
from springgym.dynamics.packing import PARAMETERS, Options, Packed, pack
from springgym.dynamics.stepping import DYNAMICS, StepPlan, plan_steps
from springgym.model.identity import check_array, check_keys, check_same
from springgym.model.resolution import (
    GROSS,
    PossibleContacts,
    error_by_steps,
    max_impact_speeds,
    possible_contacts,
    remedy,
)
from springgym.model.scene import Scene
from springgym.model.surfaces import Contact, PaperContact

__all__ = [
    "AT_ONCE",
    "COARSE",
    "FEWEST",
    "FOLLOWING",
    "GOES_FORWARD",
    "MARKS",
    "MAY_DIVERGE",
    "MOST_PARTICLES",
    "MOST_THREADS",
    "NEIGHBOURS",
    "OF_A_STEP",
    "PAPER_SETTINGS",
    "PAPER_STEP",
    "STRAINED",
    "STRAIN_LIMIT",
    "UNRESOLVED",
    "WORTH_A_THREAD",
    "PrecisionWarning",
    "SimulationDivergedError",
    "Simulator",
    "UnresolvedContactError",
    "copies_in",
    "most_copies",
]

STRAIN_LIMIT = 0.5
"""Largest strain of a spring for which the model holds."""

STRAINED = 0.3
"""Strain above which a spring no longer keeps a body in shape. A `PrecisionWarning` then appears."""

COARSE = 1e-5
"""A `PrecisionWarning` appears if rounding of positions exceeds this fraction of the shortest spring. The
rounding stretches the spring, and energy grows with every step."""

WORTH_A_THREAD = 10_000
"""Amount of work, (springs + pairs of bodies) × steps × blocks, above which another thread saves time: some
0.2 ms. Waking a thread takes some 0.1 ms."""

AT_ONCE = 4_000_000
"""Largest amount of such work in one compiled call: some 0.1 s, or some seconds with implicit methods. Python
handles Ctrl-C between the calls."""

NEIGHBOURS = 6
"""Largest number of pairs per body that count as work: bodies far apart cost nothing."""

FEWEST = 64
"""Least number of steps of one compiled call at any cost, as a call begins and ends with half a step."""

OF_A_STEP = ("terms.last", "terms.cycle")
"""Arrays of `Simulator._changing` that describe the current or the last step."""

FOLLOWING = (
    "terms.particles.inverse_mass",
    "terms.dampers.half",
    "terms.dampers.whole",
    "terms.collisions.pairs",
    "terms.collisions.stored",
    "twin",
)
"""Arrays that follow from parameters or from totals of contacts, and so are not part of the state."""

MAY_DIVERGE = (
    "x",
    "v",
    "ledger",
    "terms.last.half_change",
    "terms.surfaces.totals",
    "terms.collisions.totals",
    "terms.collisions.warm.impulse",
    "terms.collisions.warm.friction",
    "terms.collisions.warm.couple",
)
"""Arrays of the state that may hold NaN, in copies that have diverged."""

MARKS = ("terms.cycle.marks", "terms.last.sweep", "terms.collisions.fresh", "terms.collisions.warm.in_use")
"""Arrays of the state whose numbers are 0 or one other: the steps of a cycle, or 1."""

GOES_FORWARD = ("integrator", "step", "damping_every", "tolerance")
"""Names of properties in which a simulator may differ from the one whose state it takes over."""

PAPER_STEP = 5e-4
"""Step of the paper [s]."""

PAPER_SETTINGS: dict[str, Any] = {"integrator": "rk4", "step": PAPER_STEP}
"""The paper's method for scenes without surfaces; `PaperContact` is its contact with surfaces."""

MOST_PARTICLES = 10**8
"""Largest number of particles in all copies together: some 10 GB of memory."""

MOST_THREADS = 1024
"""Largest number of threads."""


class SimulationDivergedError(ArithmeticError):
    """A copy has diverged: a number is not finite, or a spring is strained beyond its limit."""


class UnresolvedContactError(SimulationDivergedError):
    """A step cannot resolve a contact: bodies are too fast, overlap too deeply, or touch in too many
    points."""


class PrecisionWarning(UserWarning):
    """A simulation is less accurate than it seems, see `STRAINED`, `COARSE` and
    `springgym.model.resolution.GROSS`. It appears once."""


UNRESOLVED = ("raise", "count")
"""Options of `Simulator.advance` for contacts that a step cannot resolve."""


@refusing_unknown
class Simulator:
    """Simulate copies of a scene. Attributes that the constructor sets are read-only.

    Only one thread at a time may use a simulator. A call during a call of another thread raises a
    RuntimeError.

    `springgym.checks` describes how arguments are checked. Some methods take ``copies``: indices that are not
    negative and do not repeat, or a mask (copies,). None stands for all copies. Values for them have one row
    for each of these copies, or are one row for all.

    Parameters
    ----------
    scene
        The scene to simulate.
    dynamics
        "springs", or "rigid" for the same particles as one rigid body.
    integrator
        Name of the method, see `springgym.dynamics.methods.METHODS`, or `springgym.dynamics.rigid.METHODS`
        for rigid dynamics. The default is "verlet", or "suzuki" for rigid bodies that can touch nothing.
    step
        Step h [s]. By default it follows from the stability limit, or for rigid dynamics from the angular
        velocities at the start.
    copies
        Number of copies. All start as in the scene. Together they have at most `MOST_PARTICLES` particles.
    dtype
        float64, or float32 for single precision at about twice the speed.
    threads
        Number of threads that share the copies, at most `MOST_THREADS`. Results are bit-identical for any
        number of threads and of ``copies``.
    varying
        Names from `springgym.dynamics.packing.PARAMETERS`. `vary` can set these for each copy.
    ledger
        Whether to record work and losses, see `Measures`.
    tolerance
        (relative, absolute) tolerance for a method that controls its error, see
        `springgym.dynamics.methods.record.Control`. The default is (1e-6, 1e-9).
    strain_limit
        Largest |L/L₀ − 1| of a spring. A copy beyond it has diverged. The default is `STRAIN_LIMIT`. If you
        give a limit, you intend strains up to it, and no `PrecisionWarning` appears.
    unresolved
        What `advance` does with contacts of bodies, or with a surface, that a step cannot resolve: "raise" an
        error, or "count" them, so that `pairs` and `unresolved` report them.
    damping_every
        Number of steps in a cycle of dampers and wrench, see `springgym.dynamics.forces.cycle`: 1, or an even
        number of at most `springgym.dynamics.stability.LONGEST_CYCLE`. `advance` then takes whole cycles. It
        must be 1 where `springgym.dynamics.stability.damps_each_step` returns a reason.

    Raises
    ------
    TypeError
        If an argument has the wrong type, see `springgym.checks`.
    ValueError
        If a number is out of bounds, the dynamics or the integrator is unknown, the step is beyond the
        stability limit, the scene has no rigid twin, or the integrator does not suit the scene or has no
        tolerance.
    """

    def __init__(
        self,
        scene: Scene,
        *,
        dynamics: str = "springs",
        integrator: str | None = None,
        step: float | None = None,
        copies: int = 1,
        dtype: DTypeLike = np.float64,
        threads: int = 1,
        varying: Collection[str] = (),
        ledger: bool = True,
        tolerance: tuple[float, float] | None = None,
        strain_limit: float | None = None,
        damping_every: int = 1,
        unresolved: str = "raise",
    ) -> None:
        self._guard = Guard()
        self.scene = checks.instance("scene", scene, Scene)
        varying = _checked_names(varying)
        plan = plan_steps(
            scene,
            dynamics=dynamics,
            integrator=integrator,
            step=step,
            damping_every=damping_every,
            varying=varying,
        )
        self.dynamics = dynamics
        self._kind = DYNAMICS[dynamics]
        self.integrator = plan.method
        self.step = plan.step
        self.damping_every = plan.cycle
        """number of steps in a cycle of dampers and wrench"""
        self.largest_step = plan.limit
        """stability limit [s]"""
        particles = len(scene.positions)
        self.copies = checks.whole("copies", copies, 1, most_copies(scene))
        self.threads = checks.whole("threads", threads, 1, MOST_THREADS)
        self.dtype = _checked_dtype(dtype)
        ledger = checks.flag("ledger", ledger)
        self.strain_limit = (
            STRAIN_LIMIT if strain_limit is None else checks.number("strain_limit", strain_limit, low=TINY)
        )
        """largest |L/L₀ − 1| of a spring; a copy beyond it has diverged"""
        shaped = not any(placed.body.floppy for placed in scene.bodies)
        self._strained = STRAINED if shaped and strain_limit is None else math.inf
        """strain from which to warn"""
        self._far = self._far_for_dtype()
        self._told: int | None = 0
        """number of coarse contacts of all copies when last looked at; None after a warning of them"""
        self.time = np.zeros(self.copies)
        """time of each copy [s], (copies,)"""
        self._x = self._blocks(particles, 3)
        self._v = self._blocks(particles, 3)
        bodies = len(scene.bodies)
        self._ledger = self._blocks(bodies * LEDGER_ENTRIES) if ledger else None
        shares = range(min(self.threads, self._x.shape[0]))
        self._control = self._controlled(tolerance)
        self.unresolved = np.zeros(self.copies, bool)
        """mask (copies,) of copies with contacts that a step cannot resolve, by the counts of `pairs`, since
        they were placed or counts were reset; writing to it has no effect"""
        self.coarse_contacts = np.zeros(self.copies, int)
        """number (copies,) of contacts, each counted in every step in which it pushes, that were too fast to
        keep the scene's restitution, see `max_impact_speed`; since copies were placed or counts were reset"""
        self._raises = checks.chosen("unresolved", unresolved, UNRESOLVED) == UNRESOLVED[0]
        rows = np.zeros((self.copies, measures.SIZE))
        shape = (self.copies, particles, 3)
        each = rows[:, None] if bodies == 1 else np.zeros((self.copies, bodies, measures.SIZE))
        self.readout = Readout(rows, np.zeros(shape), np.zeros(shape), each)
        """the last reading of the copies, see `read`: one row for each copy; writing to it has no effect"""
        room = (measures.SIZE,) if bodies == 1 else (2, measures.SIZE)
        self._space = aligned_zeros((len(shares), *room), self._x.dtype)
        self._markers = Markers(
            stacked([placed.pivot for placed in scene.bodies]),
            stacked([np.array(placed.body.markers, np.uint32) for placed in scene.bodies]),
        )
        self._busy = len(scene.springs) + min(len(scene.meetings), NEIGHBOURS * bodies)
        options = Options(self.integrator, self.step, self.damping_every, varying, self._blocks)
        self._terms, self._twin, self._packed = pack(scene, self._kind.rigid, options)
        self._workspace = self._workspaces()
        for term, axes in (((self._terms, self._twin), 3), (tuple(self._workspace[:1]), 2)):
            _check_rows(term, axes)
        self._outlines = outlines(scene.shapes, scene.offsets)
        self._boxes = np.zeros((len(shares), bodies + 1, 2, 3))
        self._shown = np.zeros((self.copies, len(scene.meetings)), bool)
        self._varying = sorted(varying)
        if self.dtype != np.float64:  # what was packed follows from parameters before they were rounded
            names = {"masses", "lengths"}.intersection(varying)
            rounded = [{name: packing.values(own, name, self._all) for name in names} for own in self._packed]
            self._derive(self._all, self._followed(self._all, rounded))
        self._actuators = self._actuated()
        self._advance = self._kernel()
        self._check_settled(scene.positions[None], scene.velocities[None], np.zeros(1, int))
        self._check_distance(scene.positions)
        for array, start in ((self._x, scene.positions), (self._v, scene.velocities)):
            numbers(array)[:] = start[..., None]  # the padding of the last block, too
        self._begin(self._all)

    @property
    def _nodes(self) -> bool:
        """Return whether steps go through nodes, see `springgym.dynamics.step`."""
        return packing.has_nodes(self.scene, self.integrator)

    @classmethod
    def paper(cls, scene: Scene, **options: Any) -> Self:
        """Make a simulator with the paper's settings: RK4 with h = 5e-4 s and, on surfaces, the paper's
        contact.

        Parameters
        ----------
        scene
            Its `Contact` becomes a `PaperContact` of the same friction, strength and reach.
        options
            The other parameters of `Simulator`: ``copies`` and so on.

        Raises
        ------
        ValueError
            If the contact has a restitution. The paper uses damping instead, see `PaperContact`.
        """
        contact = checks.instance("scene", scene, Scene).contact
        if scene.surfaces and isinstance(contact, Contact):
            if contact.restitution < 1:
                raise ValueError(
                    f"restitution is {contact.restitution}; the paper's settings have a damping: give the "
                    "scene a PaperContact"
                )
            contact = PaperContact(contact.friction, 0.0, contact.strength, contact.reach)
        return cls(scene.with_(contact=contact), **(PAPER_SETTINGS | options))

    def _kernel(self) -> SameTypes:
        read = measures.read if len(self.scene.bodies) == 1 else measures.read_bodies
        return SameTypes(
            self._kind.advance_kernel(
                self.integrator.name,
                read,
                self._nodes,
                self._terms.collisions is not None,
                self._terms.cycle is not None,
            )
        )

    # --- Building ---------------------------------------------------------------------------------

    def _blocks(self, *shape: int) -> np.ndarray:
        return block_array(self.copies, shape, self.dtype)

    def _workspaces(self) -> list[Any]:
        """Return the work arrays of each thread, which hold nothing from call to call."""
        collisions = self._terms.collisions
        shares = len(self._space)
        return packing.workspaces(
            self.scene, self.integrator, collisions, self._kind.rigid, self._x.dtype, shares
        )

    def _controlled(self, tolerance: tuple[float, float] | None) -> float | Control:
        """Return the step for the method: h, or the `Control` of a method that chooses its steps."""
        if not self.integrator.controlled:
            if tolerance is not None:
                raise ValueError(
                    f"tolerance is {checks.shown(tolerance)}; {self.integrator.name} "
                    "has no tolerance: leave it out"
                )
            return self.step
        if isinstance(tolerance, Real):
            raise ValueError(f"tolerance is {tolerance}; it must be a pair, (relative, absolute)")
        relative, absolute = (
            (1e-6, 1e-9) if tolerance is None else checks.array("tolerance", tolerance, (2,), low=0.0)
        )
        if not relative + absolute >= TINY:
            raise ValueError(f"tolerance is {tolerance}; one of the two must be more than 0")
        return Control(self.step, float(relative), float(absolute), self._blocks(STEP_COUNTS))

    @cached_property
    def max_impact_speed(self) -> float:
        """Highest impact speed [m/s] at which all contacts keep their restitution, with this step.

        Up to there, the energy that an impact loses is right to `springgym.model.resolution.WRONG`. It is 0
        if the step does not resolve the frequency of a contact, and infinite without contacts. Faster impacts
        are counted in `coarse_contacts`."""
        return float(max_impact_speeds(self._possible, self.step).min(initial=math.inf))

    @cached_property
    def _possible(self) -> PossibleContacts:
        """Return the contacts that the scene allows, those of bodies with surfaces after pairs of bodies."""
        return possible_contacts(self.scene, not self._kind.rigid)

    @cached_property
    def _phase(self) -> Phase:
        """Return positions, velocities and ledger in the form of kernels."""
        slices = self.scene.slices
        if len(slices) == 1:
            return Phase(self._x, self._v, self._ledger)
        particles = np.array([0, *(own.stop for own in slices)])
        entries = np.arange(len(slices) + 1) * LEDGER_ENTRIES
        ledger = None if self._ledger is None else Ragged(self._ledger, entries)
        return Phase(Ragged(self._x, particles), Ragged(self._v, particles), ledger)

    @cached_property
    def _clock(self) -> Clock:
        """Return the clock of the copies in the form of kernels."""
        return Clock(self.time, self.step, self.width)

    @cached_property
    def _moving(self) -> tuple[np.ndarray, np.ndarray]:
        """Return writable `flat_numbers` of positions and velocities."""
        return flat_numbers(self._x), flat_numbers(self._v)

    @cached_property
    def _emptied(self) -> list[tuple[np.ndarray, np.ndarray]]:
        """Arrays that `place` sets to zero, each with a row of zeros: the ledger and the reset flags."""
        ledger = [] if self._ledger is None else [self._ledger]
        emptied = map(flat_numbers, (*ledger, *packing.reset_flags(self._terms)))
        return [(lanes, np.zeros((1, lanes.shape[1]))) for lanes in emptied]

    @cached_property
    def _totals(self) -> tuple[np.ndarray | None, np.ndarray]:
        """Return the totals of contacts that determine `unresolved`, and the reach Δ [m] of each.

        They are those of pairs; or of bodies, if their particles touch surfaces separately. Without contacts,
        the totals are None.
        """
        if self._terms.collisions is not None:
            return self._terms.collisions.totals, self._terms.collisions.pairs.reach
        of = [packed.terms.surfaces for packed in self._packed if packed.terms.surfaces is not None]
        own = None if self._terms.surfaces is None else self._terms.surfaces.totals
        return own.values if isinstance(own, Ragged) else own, np.array([each.reach for each in of])

    @cached_property
    def _all(self) -> np.ndarray:
        """Return the indices of all copies."""
        return np.arange(self.copies)

    @cached_property
    def _readings(self) -> list[Reading]:
        """Return the arrays by which each thread reads copies."""
        return [Reading(self.readout, space, self._markers) for space in self._space]

    @cached_property
    def _acting(self) -> tuple[object, ...]:
        """Return the scene in the form of kernels."""
        return (*self._twin, self._terms) if self._twin else self._terms

    def _actuated(self) -> dict[str, tuple[tuple[int, ...], np.ndarray]]:
        """Shapes of the values that `actuate` sets, by name, with the `flat_numbers` to write to."""
        several = len(self._packed) > 1
        return {
            f"{placed.name}.{name}" if several else name: (
                (self.copies, *array.shape[1:]),
                flat_numbers(array),
            )
            for placed, packed in zip(self.scene.bodies, self._packed, strict=True)
            for name, array in packing.actuators(packed).items()
        }

    # --- State ------------------------------------------------------------------------------------

    @property
    @guarded
    def positions(self) -> np.ndarray:
        """Return a copy of the positions of the particles [m], (copies, N, 3)."""
        return to_copies(self._x, self.copies)

    @property
    @guarded
    def velocities(self) -> np.ndarray:
        """Return a copy of the velocities of the particles [m/s], (copies, N, 3)."""
        return to_copies(self._v, self.copies)

    @cached_property
    def width(self) -> int:
        """Return the number of copies in a block."""
        return int(numbers(self._x).shape[-1])

    @guarded
    def place(
        self,
        positions: ArrayLike,
        velocities: ArrayLike,
        copies: ArrayLike | None = None,
        *,
        check: bool = True,
        read: bool = False,
    ) -> None:
        """Place some copies (default: all), with an empty ledger and at time 0.

        Parameters
        ----------
        positions, velocities : (k, N, 3) or (N, 3)
            [m], [m/s]
        copies : (k,), optional
            Which copies; all by default.
        check
            Whether to call `Scene.check_start`. Starts that are known to be possible do not need it.
        read
            Whether to `read` them afterwards.

        Raises
        ------
        TypeError
            If an argument has the wrong type; nothing is changed.
        ValueError
            If a shape is wrong, a number is not finite, there is no such copy, or `Scene.check_start` refuses
            the start; nothing is changed.
        """
        index = self._index(copies)
        read = checks.flag("read", read)
        shape = self.scene.positions.shape
        x = self._rows("positions", positions, index, shape)
        v = self._rows("velocities", velocities, index, shape)
        if checks.flag("check", check):
            self.scene.check_start(x, v, index)
        self._check_settled(x, v, index)
        self._check_distance(x)
        for lanes, values in zip(self._moving, (x, v), strict=True):
            put(lanes, index, np.array(values, order="C").reshape(len(index), lanes.shape[1]), HUGE)
        for lanes, zeros in self._emptied:
            put(lanes, index, zeros, HUGE)
        if self._terms.collisions is not None:
            totals.empty_totals(self._terms.collisions, index)
        self.unresolved[index] = False
        self.coarse_contacts[index] = 0
        self._begin(index)
        self.time[index] = 0.0
        if read:
            self._read(index)

    def _check_settled(self, x: np.ndarray, v: np.ndarray, index: np.ndarray) -> None:
        """Raise ValueError for starts that are not possible after `_settle`."""
        if self._kind.settled:
            settled = [
                self._kind.settled(packed, x[:, own], index)
                for packed, own in zip(self._packed, self.scene.slices, strict=True)
            ]
            self.scene.check_start(np.concatenate(settled, axis=1), v, index)

    def _index(self, copies: ArrayLike | None) -> np.ndarray:
        """Return indices (k,) of copies, checked."""
        if copies is None:
            return self._all
        # Fast path for the arguments of environments at every step.
        plain = type(copies) is np.ndarray and copies.dtype is INDEX and copies.ndim == 1
        if plain and ascending(index := np.array(copies), self.copies):
            return index
        return checks.indices("copies", copies, self.copies, once=True)

    def _rows(
        self,
        name: str,
        value: ArrayLike,
        index: np.ndarray,
        shape: tuple[int, ...],
        low: float = -HUGE,
        high: float = HUGE,
    ) -> np.ndarray:
        """Return a value for each of some copies, (k, *shape), from such an array or one value for all."""
        rows = (len(index), *shape)
        given = checks.array(name, value, rows, shape, low=low, high=high)
        return given if given.shape == rows else np.broadcast_to(given, rows)

    def _begin(self, index: np.ndarray) -> None:
        """Prepare copies that were just placed: find which bodies touch, and move rigid ones to their shapes.

        A call moves all copies of its blocks. The other ones have their shapes, but for rounding: they get
        back the bits that they had.
        """
        if not (self._kind.rigid or self.scene.meetings):
            return
        width = self.width
        blocks, row = np.unique(index // width, return_inverse=True)
        placed = np.zeros((len(blocks), width), bool)
        placed[row, index % width] = True
        before = [numbers(array)[blocks] for array in (self._x, self._v)]
        for first, last in self._block_ranges(index):
            self._run(0, first, last, 0, placed=True, reads=False)
        if self._kind.rigid:
            for array, others in zip((self._x, self._v), before, strict=True):
                lanes = numbers(array)
                lanes[blocks] = np.where(placed[:, None, None], lanes[blocks], others)

    @guarded
    def vary(self, copies: ArrayLike, **values: ArrayLike) -> None:
        """Set parameters of some copies.

        Parameters
        ----------
        copies : (k,)
            Which copies; all if None.
        values
            ``masses`` (k, N), ``stiffness``, ``damping``, ``lengths`` (k, S), ``gravity`` (k, 3),
            ``friction``, ``restitution`` (k,) and ``strength`` (k,), or
            (k, bodies) for several bodies. Without the k, a value holds for all of these copies. N and S
            count the particles and springs of all bodies, one body after another. Friction and restitution
            concern the surfaces, and bodies that collide by the scene's contact. Strength concerns the
            surfaces.

        Raises
        ------
        TypeError
            If an argument has the wrong type; nothing is changed.
        ValueError
            If a shape is wrong, a number is out of bounds, there is no such copy, or the parameter does not
            vary in this simulator or makes its step unstable; nothing is changed.
        """
        index = self._index(copies)
        given: list[dict[str, np.ndarray]] = [{} for _ in self._packed]
        for name, value in values.items():
            parameter = PARAMETERS[checks.chosen("a parameter to vary", name, PARAMETERS)]
            if not packing.varies(self._packed[0], name):
                raise ValueError(f"{name!r} does not vary in this simulator; name it in varying")
            shapes = [packing.shape(packed, name) for packed in self._packed]
            shared = len(shapes) == 1 or parameter.extent in ("axes", "scene")
            ends = np.cumsum([0, *(shape[0] if shape else 1 for shape in shapes)])
            rows = self._rows(
                name, value, index, shapes[0] if shared else (int(ends[-1]),), parameter.least, parameter.most
            )
            if name in ("masses", "lengths"):  # what follows from them must follow from what is stored
                rows = rows.astype(self.dtype).astype(float)
            parts = [rows] * len(given) if shared else np.split(rows, ends[1:-1], axis=1)
            for own, shape, part in zip(given, shapes, parts, strict=True):
                own[name] = part if shape or shared else part[:, 0]
        followed = self._followed(index, given)
        for packed, own in zip(self._packed, given, strict=True):
            packing.vary(packed, index, own)
        self._derive(index, followed)

    @guarded
    def actuate(self, **values: Any) -> None:
        """Set force [N], torque [N·m], acceleration [m/s²] and thrust [N] of actuators, until the next call.

        Parameters
        ----------
        values
            ``force`` [N], ``torque`` and ``body_torque`` [N·m] of the wrench and ``acceleration`` [m/s²] of
            the drive, each (copies, 3), and ``thrust`` [N] (copies, thrusters, 3). Without the copies, a
            value holds for all of them. Only bodies that are `Body.oriented` have a ``body_torque``. In a
            scene of several bodies, the name of the body and a dot come first: "left.force".

        Raises
        ------
        TypeError
            If an argument has the wrong type; nothing is changed.
        ValueError
            If a shape is wrong, a number is not finite, or the scene has no such actuator; nothing is
            changed.
        """
        actuators = self._actuators
        given = []
        for name, value in values.items():
            if name not in actuators:
                known = ", ".join(actuators) or "none"
                raise ValueError(f"the scene has no actuator for {name!r}; it has {known}")
            shape, lanes = actuators[name]
            if value.__class__ is not np.ndarray or value.dtype is not FLOAT or value.shape != shape:
                value = np.array(np.broadcast_to(checks.array(name, value, shape, shape[1:]), shape))
            rows = np.ascontiguousarray(value).reshape(self.copies, lanes.shape[1])
            if not put(lanes, self._all[:0], rows, HUGE):
                checks.array(name, value, shape)  # raises the error
            given.append((lanes, rows))
        for lanes, rows in given:
            put(lanes, self._all, rows, HUGE)

    @guarded
    def state(self, copies: ArrayLike | None = None, *, parameters: bool = True) -> dict[str, Any]:
        """Return a copy of the state, for `restore` of this simulator or of an equal one.

        It holds arrays by name, and as "of" the `identity` of the simulator. ``state["x"]["lanes"]`` are the
        positions [m], (blocks, N, 3, copies of a block), and ``state["v"]["lanes"]`` the velocities [m/s].
        You may edit an array: a state holds nothing twice, so the simulation continues from what was edited.

        Parameters
        ----------
        copies : (k,), optional
            The copies whose state is returned, as that of a simulator of k copies. The default is all.
        parameters
            Whether the state holds the parameters that vary.

        Raises
        ------
        TypeError, ValueError
            If there are no such copies.
        """
        index = self._index(copies)
        of = dict(self.identity)
        own = self._changing if parameters else self._moves
        if copies is None:
            arrays = {name: array.copy() for name, array in own.items()}
        else:
            of["copies"] = len(index)
            arrays = {
                name: chosen_copies(array, index) if array.dtype.names else array[index]
                for name, array in own.items()
            }
        return {"of": of, **arrays}

    @cached_property
    def identity(self) -> dict[str, Any]:
        """Return plain data by name that describe the simulator; simulators with equal data share states."""
        control = self._control
        return {
            "copies": self.copies,
            "dtype": self.dtype.name,
            "dynamics": self.dynamics,
            "integrator": self.integrator.name,
            "step": self.step,
            "damping_every": self.damping_every,
            "tolerance": [control.relative, control.absolute] if isinstance(control, Control) else None,
            "ledger": self._ledger is not None,
            "varying": self._varying,
            **self.scene.identity,
        }

    @guarded
    def restore(
        self,
        state: Mapping[str, Any],
        copies: ArrayLike | None = None,
        *,
        parameters: Mapping[str, ArrayLike] | None = None,
    ) -> None:
        """Restore a state that `state` returned, exactly, or one that was edited since.

        Parameters
        ----------
        state
            A state of as many copies as this simulator has, unless ``copies`` is given.
        copies : (k,), optional
            The copies to set; the others do not change. The state then has k copies, or one for all of
            them. It may come from a simulator with any number of copies.
        parameters
            For a state without parameters: their values for `vary`. Those that are left out do not change.

        Raises
        ------
        TypeError
            If ``state`` is not a state, or something in it has the wrong type; nothing is changed.
        ValueError
            If the state belongs to a different simulator (the message says what differs), an array has
            another shape or dtype, a number is not finite except in the motion of a copy that has diverged,
            `vary` would refuse a parameter, or there are no such copies; nothing is changed.
        """
        index = self._index(copies)
        own = self._changing if parameters is None else self._moves
        given = checks.instance("state", state, Mapping)
        if "of" in given:
            check_same("the state", given["of"], self.identity, () if copies is None else ("copies",))
        check_keys("state", given, ("of", *own))
        count = self.copies if copies is None else copies_in(given, len(index))
        for name, array in own.items():
            self._check_array(name, given[name], array, None if copies is None else count)
        rows = np.zeros(len(index), int) if count == 1 else self._all[:count]
        if parameters is None:
            varied = self._differing(index, given, rows)
        else:
            varied = []
            if parameters:
                self.vary(index, **parameters)
        if copies is None:
            _set(own.values(), (given[name] for name in own))
        else:
            self._set_some(index, given, rows, own)
        self._derive(index, varied)
        self._recall()

    def _check_array(self, name: str, value: Any, own: np.ndarray, count: int | None) -> None:
        """Raise an error if a value cannot be that of an array in a state of ``count`` copies (None: all)."""
        shape = own.shape
        dtype = own.dtype
        if count is not None and dtype.names:
            shape, dtype = layout_for(own, count)
        elif count is not None:
            shape = (count, *shape[1:])
        check_array(name, value, shape, dtype, name in self._always_finite)
        if name in self._marks and value.tobytes() != own.tobytes():
            most = self._marks[name]
            lanes = numbers(value)
            if not ((lanes == 0) | (lanes == most)).all():
                raise ValueError(f"state[{name!r}] holds other numbers than 0 and {most}")

    @cached_property
    def _always_finite(self) -> frozenset[str]:
        """Names of the arrays in a state whose numbers are finite even after divergence."""
        return frozenset(name for name in self._changing if not name.startswith(MAY_DIVERGE))

    @cached_property
    def _marks(self) -> dict[str, int]:
        """By the names of `MARKS` in a state, the number other than 0."""
        return {
            name: self.damping_every if name.startswith(MARKS[0]) else 1
            for name in self._changing
            if name.startswith(MARKS)
        }

    def _set_some(
        self, index: np.ndarray, state: Mapping[str, Any], rows: np.ndarray, own: Mapping[str, np.ndarray]
    ) -> None:
        """Set some copies (k,) to copies ``rows`` (k,) of a state, in the arrays of our ``own``."""
        arrays = []
        values = []
        where = []
        for name, array in own.items():
            blocks = array.dtype.names is not None
            arrays.append(by_copies(array) if blocks else array)
            values.append(get_copies(state[name], rows) if blocks else state[name][rows])
            where.append((index // self.width, index % self.width) if blocks else index)
        _set(arrays, values, where)

    def _differing(
        self, index: np.ndarray, state: Mapping[str, np.ndarray], rows: np.ndarray
    ) -> list[tuple[Packed, Set[str], Any]]:
        """Return by body which parameters of copies (k,) a state with copies ``rows`` (k,) changes.

        The rest is as in `_followed`.

        Raises
        ------
        ValueError
            If one is out of bounds, or makes the step unstable.
        """
        given: list[dict[str, np.ndarray]] = [{} for _ in self._packed]
        for name, (key, start) in self._varied.items():
            parameter = PARAMETERS[name]
            for n, packed in enumerate(self._packed):
                stored = state[key] if start is None else state[key][:, start[n] : start[n + 1]]
                values = get_copies(stored, rows)
                if not np.array_equal(values, get_copies(parameter.stored(packed.terms), index)):
                    most = 1.0 if name == "restitution" else parameter.most
                    checks.array(f"state[{key!r}]", values, values.shape, low=parameter.least, high=most)
                    given[n][name] = packing.in_order(packed, name, values)
        if not any(given):
            return []
        return self._followed(index, given)

    def _followed(
        self, index: np.ndarray, given: Sequence[Mapping[str, np.ndarray]]
    ) -> list[tuple[Packed, Set[str], Any]]:
        """Return, by body, the names of ``given`` parameters of copies (k,), and what follows from them.

        Raises
        ------
        ValueError
            If they make the step unstable.
        """
        plan = StepPlan(self.integrator, self.step, self.damping_every, self.largest_step)
        return [
            (packed, own.keys(), self._kind.follow(packed, index, own, plan))
            for packed, own in zip(self._packed, given, strict=True)
        ]

    def _derive(self, index: np.ndarray, varied: Sequence[tuple[Packed, Set[str], Any]]) -> None:
        """Set what follows from parameters of some copies (k,) that have just been set, see `_followed`."""
        for packed, names, shapes in varied:
            packing.derive(packed, index, self.damping_every * self.step, names, shapes)
        names = {name for _, own, _ in varied for name in own}
        if names:
            packing.derive_pairs(self._terms.collisions, self.scene, index, self._packed, names)

    @cached_property
    def _varied(self) -> dict[str, tuple[str, np.ndarray | None]]:
        """By the names of `PARAMETERS` that vary: the name in a state, and where the rows of bodies start."""
        names = {id(array): name for name, array in self._changing.items()}
        stored = {name: PARAMETERS[name].stored(self._terms) for name in self._varying}
        return {
            name: (names[id(own.values)], own.start) if isinstance(own, Ragged) else (names[id(own)], None)
            for name, own in stored.items()
        }

    def _recall(self) -> None:
        """Compute the quantities that follow from a new state, but are not part of the state."""
        if self._terms.collisions is not None:
            totals.find_changing(self._terms.collisions)
            totals.share_energy(self._terms.collisions)
        self._find_unresolved(0, len(self._x))

    @guarded
    def take_over(self, other: Simulator) -> None:
        """Take over the state of another simulator of the same scene, and continue with a different step.

        The state is bit-identical. With contact, or dampers that act once in several steps, the copies start
        as if they had been placed.

        Raises
        ------
        TypeError, ValueError
            If the other simulator differs in more than `GOES_FORWARD`, or its parameters make the step of
            this one unstable; nothing is changed.
        """
        must = "; it must be made like this simulator but for its step"
        made = checks.instance("other", other, Simulator).identity
        check_same("other", made, self.identity, but=GOES_FORWARD, must=must)
        theirs = other._changing
        varied = self._differing(self._all, theirs, self._all)
        own = {name: array for name, array in self._changing.items() if not name.startswith(OF_A_STEP)}
        _set(own.values(), (theirs[name] for name in own))
        self._derive(self._all, varied)
        packing.renew(self._terms, self._all)
        self._recall()

    @cached_property
    def _changing(self) -> dict[str, np.ndarray]:
        """Return by name the arrays of the state: those of the motion, actuators and varied parameters."""
        found = {"x": self._x, "v": self._v, "time": self.time}
        if self._ledger is not None:
            found["ledger"] = self._ledger
        blocks = _blocks_in("terms", self._terms)
        return found | {name: array for name, array in blocks if not name.startswith(FOLLOWING)}

    @cached_property
    def _moves(self) -> dict[str, np.ndarray]:
        """Return by name the arrays of the state other than parameters that vary."""
        parameters = {key for key, _ in self._varied.values()}
        return {name: array for name, array in self._changing.items() if name not in parameters}

    # --- Time -------------------------------------------------------------------------------------

    @guarded
    def advance(
        self,
        steps: int = 1,
        *,
        check: bool = True,
        read: bool = False,
        then: Callable[[int, int], None] | None = None,
    ) -> None:
        """Advance all copies by ``steps`` steps.

        Ctrl-C, or any other exception, ends the call within about a second. `time` then holds the time that
        each copy has reached. A call of many steps consists of several compiled calls. The number of steps in
        each of these depends on the scene only, so results do not depend on the copies or the threads.

        Parameters
        ----------
        steps
            Number of steps, at least 0, and a multiple of ``damping_every``.
        check
            Whether to check that no copy has diverged.
        read
            Whether to `read` the copies afterwards, in the same compiled call.
        then
            A function that each thread calls when its copies have taken the steps. Its arguments are the
            index of the first copy and the index after the last. It may use `readout`, but no method of the
            simulator.

        Raises
        ------
        TypeError, ValueError
            If ``steps`` is not a whole number of at least 0 or no multiple of ``damping_every``, or a flag
            is not a bool; nothing is changed.
        SimulationDivergedError
            If ``check`` is set and a copy has diverged. The other copies are not affected.
        UnresolvedContactError
            If ``check`` is set, ``unresolved`` is "raise", and a copy has had contacts that a step cannot
            resolve since it was placed or `pairs` was called with ``forget``.
        """
        # Compiled code must get an int and a bool, and no other type: see `SameTypes`.
        if steps.__class__ is not int or not 0 <= steps <= LARGEST_WHOLE:
            steps = checks.whole("steps", steps)
        if steps % self.damping_every:
            raise ValueError(
                f"steps is {steps}; it must be a multiple of damping_every, {self.damping_every}, "
                "as dampers act once in so many steps"
            )
        if check.__class__ is not bool or read.__class__ is not bool:
            check = checks.flag("check", check)
            read = checks.flag("read", read)
        self._run_threads(steps, reads=check or read, then=then)
        if check:
            self._check()

    def _check(self) -> None:
        """Raise an error if a copy has diverged, and warn of strain and rounding, from the last reading."""
        strain = self.readout.rows[:, measures.AT.strain]
        strained = ~(strain <= self.strain_limit)
        diverged = strained | ~np.isfinite(self.readout.rows).all(axis=1)
        if diverged.any():
            n = int(np.argmax(diverged))
            what = "not finite"
            if strained[n]:
                found, most = checks.apart(strain[n], self.strain_limit)
                what = f"strain {found}, strain_limit {most}"
            raise SimulationDivergedError(
                f"copy {n} diverged before t = {self.time[n]:g} s: {what}; step {self.step:g} s, "
                f"stability limit {self.largest_step:g} s"
            )
        if self._raises and self.unresolved.any():
            raise UnresolvedContactError(self._unresolved_message(int(np.argmax(self.unresolved))))
        if (strain > self._strained).any():
            n = int(np.argmax(strain > self._strained))
            self._strained = math.inf
            _warn(
                f"a spring of copy {n} is stretched or squeezed by {strain[n]:.2g} of its length at "
                f"t = {self.time[n]:g} s, too much to keep the shape of its body; take stiffer springs, or "
                "set strain_limit to the largest strain that you intend"
            )
        self._check_distance(self.readout.positions)
        self._check_rebounds()

    def _unresolved_message(self, copy: int) -> str:
        """Return a message that names the bodies of a copy, their contact, and remedies."""
        own, reach = self._totals
        read = PairReadings(*(of[copy] for of in totals.read_pairs(own, self.copies)))
        resolved = RESOLVED / self.step * reach
        met = self.scene.meetings
        bodies = self.scene.bodies
        n = int(np.argmax((read.fastest > resolved) | (read.late_contacts > 0) | (read.overflow > 0)))
        if n < len(met):
            who = f"bodies {bodies[met.first[n]].name!r} and {bodies[met.second[n]].name!r}"
        else:
            who = f"body {bodies[n - len(met)].name!r} and a surface"
        fast = float(read.fastest[n])
        named, harder = self._remedy(n, max(fast, TINY))
        deep = "so deep that they (almost) overlapped"
        soft = "more strength or stiffer springs"
        deeper = f"a larger reach, such as {2 * reach[n]:g} m, {soft}"
        cases = (
            (fast > resolved[n], f"at {fast:.4g} m/s", named),
            (read.late_contacts[n] > 0, deep, named if harder else deeper),
            (read.overflow[n] > 0, "at too many points, or too fast to find", "a shorter step"),
        )
        how = " and ".join(met for wrong, met, _ in cases if wrong)
        remedies = ", or ".join(dict.fromkeys(remedy for wrong, _, remedy in cases if wrong))
        return (
            f"{who} of copy {copy} met before t = {self.time[copy]:g} s {how}: a step of {self.step:g} s "
            f"cannot resolve that. It resolves contacts of up to {resolved[n]:.4g} m/s, which move by "
            f'{RESOLVED:g} of their reach of {reach[n]:g} m. Take {remedies}; or unresolved="count"'
        )

    def _remedy(self, pair: int, speed: float) -> tuple[str, bool]:
        """Return the step, and the strength if need be, that resolve an impact of a pair at a speed [m/s].

        The second value says whether it needs a strength.
        """
        step, strength = remedy(self._possible, pair, speed)
        named = f"a step of at most {_rounded(step, math.floor):.2g} s"
        if strength is None:
            return named, False
        return f"a strength of {_rounded(strength, math.ceil):.2g} N·m² or more and {named}", True

    def _check_rebounds(self) -> None:
        """Warn if steps make the energy that a contact loses wrong by more than `GROSS`."""
        coarse = int(self.coarse_contacts.sum())
        if coarse == self._told or self._told is None or not self._raises:
            return
        self._told = coarse
        fastest = totals.read_pairs(self._totals[0], self.copies).fastest
        lossy = np.where(self._possible.lossy, fastest, 0.0)
        gross = (lossy > SLOW) & (error_by_steps(self._possible, lossy, self.step) > GROSS)
        if gross.any():
            copy, pair = np.argwhere(gross)[0].tolist()
            self._told = None
            speed = lossy[copy, pair]
            _warn(
                f"a contact of copy {copy} at {speed:.3g} m/s loses less than its restitution says: it "
                f"moves by {speed * self.step / self._possible.reach[pair]:.2g} of its reach in a step of "
                f"{self.step:g} s. Take {self._remedy(pair, speed)[0]}; "
                "Simulator.max_impact_speed is the highest speed that a step resolves"
            )

    def _check_distance(self, positions: np.ndarray) -> None:
        """Warn if positions (copies, N, 3) are so far away that their rounding stretches springs."""
        if self._far == math.inf:
            return
        far = float(np.abs(positions).max(initial=0.0))
        if far > self._far:
            limit = self._far
            rounding = float(np.spacing(self.dtype.type(far)))
            self._far = math.inf
            _warn(
                f"a particle is {far:.3g} m away from the origin, where positions in {self.dtype} are "
                f"{rounding:.2g} m apart, which strains springs; stay within {limit:.3g} m, or use float64"
            )

    def _far_for_dtype(self) -> float:
        """Return the distance from the origin [m] where rounding is `COARSE`; infinite for float64."""
        lengths = self.scene.of_bodies("lengths")
        if self._kind.rigid or not len(lengths) or self.dtype != np.float32:
            return math.inf
        return COARSE * float(lengths.min()) / float(np.finfo(self.dtype).eps)

    def _run(self, thread: int, first: int, last: int, steps: int, reads: bool, placed: bool = False) -> None:
        """Advance a range of blocks, or prepare copies that were just ``placed``; then read, if ``reads``."""
        self._advance(
            self._phase,
            self._workspace[thread],
            (first, last),
            self._control,
            steps,
            placed,
            self._acting,
            self._readings[thread],
            reads,
            self._clock,
        )
        if steps > 0:
            if reads and self.scene.meetings:
                self._count_overlaps(thread, first, last)
            self._find_unresolved(first, last)

    def _count_overlaps(self, thread: int, first: int, last: int) -> None:
        """Find which pairs of bodies overlap in the positions last read, and count them for each copy."""
        start = first * self.width
        copies = slice(start, min(last * self.width, self.copies))
        overlap = self._shown[copies]
        x = self.readout.positions[copies]
        pairs = self.scene.meetings
        if find_overlaps(x, pairs.first, pairs.second, self._outlines, self._boxes[thread], overlap):
            assert self._terms.collisions is not None
            totals.count_overlaps(self._terms.collisions, start, overlap)

    def _find_unresolved(self, first: int, last: int) -> None:
        """Find the copies of blocks with contacts that a step cannot resolve, and count coarse ones."""
        own, reach = self._totals
        if own is not None:
            copies = slice(first * self.width, last * self.width)
            found = self.unresolved[copies], self.coarse_contacts[copies]
            totals.mark_unresolved(numbers(own)[first:last], reach, self.step, *found)

    @guarded
    def counts(self) -> np.ndarray:
        """Return the steps taken, steps rejected and Newton iterations of each copy so far, (copies, 3).

        Raises
        ------
        ValueError
            If the method has no tolerance, and so does not choose its steps.
        """
        if not isinstance(self._control, Control):
            raise ValueError(
                f"{self.integrator.name} neither chooses its steps nor iterates, so it has no counts"
            )
        return to_copies(self._control.counts, self.copies)

    @guarded
    def measure(self, body: int | str | None = None) -> Measures:
        """Measure energies, momenta, orientation and strain of all copies.

        Parameters
        ----------
        body
            Number or name of the body to measure. By default all bodies are measured together.
        """
        number = None if body is None else self.scene.number(body)
        self.read()
        return measures.view((self.readout.rows if number is None else self.readout.bodies[:, number]).copy())

    @guarded
    def shadow_energy(self) -> np.ndarray:
        """Compute the energy (copies,) [J] that undamped free motion conserves up to terms of order h⁴.

        It is H + (h²/12) v·V″v − (h²/24) Σ |F|²/m, with the `energy` H of `Measures`, the springs' energy V,
        and the forces F of springs and gravity on free particles. Where bodies can touch something, steps
        have another order, and it is H − (h²/24) v·V″v + (h²/12) Σ |F|²/m.

        H itself oscillates by terms of order h²: for a vibration at ω, by up to (ω h)²/4 of its energy; the
        shadow energy by up to (ω h)⁴/24. Impulses of contact, dampers and actuators change H as the ledger
        says, and the other terms, too, which the ledger does not hold: an impact that lets a body vibrate at
        ω adds (ω h)²/6 of the energy of that vibration, and dampers take it out again.

        Raises
        ------
        ValueError
            For other methods, for rigid bodies, and with user-defined forces: their shadow energy is not
            known.
        """
        if self._kind.rigid or self.integrator.name != "verlet":
            what = f"{self.integrator.name} on {self.dynamics}"
            raise ValueError(f"the shadow energy is known only for verlet with springs; this is {what}")
        if self._terms.own is not None:
            raise ValueError("the shadow energy is not known with custom forces")
        self.read()
        rows, x, v, _ = self.readout
        energy = rows[:, measures.AT.energy]
        for packed, own in zip(self._packed, self.scene.slices, strict=True):
            energy = energy + packing.shadow_difference(packed, x[:, own], v[:, own], self.step, self._nodes)
        return energy

    @guarded
    def pairs(self, *, forget: bool = False) -> PairReadings:
        """Return impulses [N·s], losses [J] and counts of pairs since the start or the last ``forget``.

        There is an entry for each pair, so 1000 bodies have half a million entries. `contacts` returns only
        those that touch.

        Parameters
        ----------
        forget
            Whether to reset impulses, losses, the least gap and all counts after this reading.

        Raises
        ------
        TypeError
            If ``forget`` is not a bool.
        """
        checks.flag("forget", forget)
        own, _ = self._totals
        readings = totals.read_pairs(own, self.copies, len(self.scene.meetings))
        if forget and own is not None:
            totals.forget_pairs(own)
            self._find_unresolved(0, len(self._x))
        return readings

    @guarded
    def pair_sums(self) -> PairSums:
        """Return the readings of `pairs`, summed over all pairs of each copy.

        Raises
        ------
        ValueError
            If the scene has no bodies that collide.
        """
        if self._terms.collisions is None or not self.scene.meetings:
            raise ValueError("the scene has no bodies that collide, and so no pairs")
        return contacts.pair_sums(self._terms.collisions, self.copies)

    @guarded
    def contacts(self) -> Contacts:
        """Return the contacts of the step that begins at the present state, with their impulses.

        The call takes this step in all copies, and then restores the state.

        Raises
        ------
        ValueError
            If the method has no nodes, see `springgym.dynamics.methods`; or if the scene has surfaces and
            several bodies that do not collide.
        """
        if reason := contacts.refusal(self.scene, self._terms, self._nodes):
            raise ValueError(reason)
        arrays = list(self._changing.values())
        found = []
        before = [array.copy() for array in arrays]
        x, v = (numbers(array).copy() for array in (self._x, self._v))
        try:
            for block in range(self._x.shape[0]) if self.scene.can_touch else ():
                self._run(0, block, block + 1, 1, reads=False)
                begin = (x[block], v[block])
                end = (numbers(self._x)[block], numbers(self._v)[block])
                here = contacts.SteppedBlock(
                    block, begin, end, self._workspace[0], self._terms, self._twin, self.step
                )
                found.append(contacts.of_block(self.scene, here))
        finally:
            _set(arrays, before)
            self._recall()
        return contacts.padded(found, self.copies)

    @guarded
    def read(self, copies: ArrayLike | None = None) -> None:
        """Write measures, positions and velocities of some copies (default: all) to their rows of `readout`.

        The rows of other copies in the same blocks are written, too.

        Raises
        ------
        TypeError, ValueError
            If there are no such copies.
        """
        if copies is None:
            self._run_threads(0, reads=True)
        else:
            self._read(self._index(copies))

    def _read(self, index: np.ndarray) -> None:
        """Read copies (k,) whose indices have been checked."""
        for first, last in self._block_ranges(index):
            self._run(0, first, last, 0, reads=True)

    def _block_ranges(self, copies: np.ndarray) -> list[tuple[int, int]]:
        """Return ranges of blocks that together hold the copies and no other block."""
        ranges: list[tuple[int, int]] = []
        width = self.width
        for block in sorted({copy // width for copy in copies.tolist()}):
            first = ranges.pop()[0] if ranges and ranges[-1][1] == block else block
            ranges.append((first, block + 1))
        return ranges

    def _run_threads(self, steps: int, reads: bool, then: Callable[[int, int], None] | None = None) -> None:
        """`_run` all blocks, on several threads where that saves time; each calls ``then`` at its end."""
        blocks = self._x.shape[0]
        threads = min(self.threads, blocks)
        if threads == 1 or blocks * max(steps, 1) * self._busy < WORTH_A_THREAD:
            for first, last, some, ends in self._calls(0, blocks, steps):
                self._run(0, first, last, some, reads and ends)
            if then is not None:
                then(0, self.copies)
            return
        edges = [blocks * n // threads for n in range(threads + 1)]
        width = self.width
        working = [Lock() for _ in range(threads)]
        over: list[bool] = []

        def work(n: int) -> None:
            with working[n]:
                for first, last, some, ends in self._calls(edges[n], edges[n + 1], steps):
                    if over:
                        return
                    self._run(n, first, last, some, reads and ends)
                if then is not None:
                    then(edges[n] * width, min(edges[n + 1] * width, self.copies))

        pool = _pool(os.getpid(), self.threads)
        try:
            rest = [pool.submit(work, n) for n in range(1, threads)]
            work(0)
            for future in rest:
                future.result()
        except BaseException:
            over.append(True)
            for lock in working:
                _wait_for(lock)
            raise

    def _calls(self, first: int, last: int, steps: int) -> Iterator[tuple[int, int, int, bool]]:
        """Yield the calls that advance blocks: first and last block, steps, and whether it is the last."""
        busy = max(self._busy, 1)
        if (last - first) * steps * busy <= AT_ONCE:
            yield first, last, steps, True
            return
        most = max(AT_ONCE // busy, FEWEST)
        most -= most % self.damping_every
        for taken in range(0, steps, most):
            some = min(most, steps - taken)
            blocks = max(AT_ONCE // (some * busy), 1)
            for block in range(first, last, blocks):
                yield block, min(block + blocks, last), some, taken + some == steps

    def __repr__(self) -> str:
        fast = self.max_impact_speed
        rebounds = f", restitution accurate up to {fast:.3g} m/s" if fast < math.inf else ""
        return (
            f"Simulator({self.copies} × {self.scene!r}, {self.dynamics}, "
            f"ω_max {stability.highest_frequency(self.scene):.5g} rad/s, {self.integrator.name}, "
            f"step {self.step:g} s of at most {self.largest_step:.5g} s, "
            f"damping every {self.damping_every}, {self.dtype}{rebounds})"
        )

    def __setattr__(self, name: str, value: object) -> None:
        if name in vars(self) and not name.startswith("_"):
            raise AttributeError(f"{name} of a simulator cannot change; make a new simulator")
        super().__setattr__(name, value)

    def __copy__(self) -> Self:
        """Return a deep copy, because two simulators must not share arrays."""
        return deepcopy(self)

    @guarded
    def __getstate__(self) -> dict[str, Any]:
        # made again: views do not survive copying, and the workspace is most of the memory with many bodies
        renewed = {"_advance", "_actuators", "_packed", "_kind", "_workspace"}
        renewed |= {name for name, own in vars(Simulator).items() if isinstance(own, cached_property)}
        return {name: value for name, value in vars(self).items() if name not in renewed} | {
            "_orders": [packed.order for packed in self._packed]
        }

    def __setstate__(self, state: dict[str, Any]) -> None:
        orders = state.pop("_orders")
        vars(self).update(state)
        self._kind = DYNAMICS[self.dynamics]
        if len(self.scene.bodies) == 1:
            vars(self)["readout"] = self.readout._replace(bodies=self.readout.rows[:, None])
        self._packed = tuple(
            Packed(part, order, share(self._terms, n), share(self._twin, n))
            for n, (part, order) in enumerate(zip(self.scene.parts, orders, strict=True))
        )
        self._workspace = self._workspaces()
        self._actuators = self._actuated()
        self._advance = self._kernel()


def most_copies(scene: Scene) -> int:
    """Return the largest number of copies of a scene."""
    return MOST_PARTICLES // len(scene.positions)


def _rounded(number: float, way: Callable[[float], int]) -> float:
    """Return a positive number with two digits, rounded down or up by a function such as `math.floor`."""
    digit = 10.0 ** (math.floor(math.log10(number)) - 1)
    return way(number / digit) * digit


def _warn(what: str) -> None:
    """Warn at the line that called the simulator."""
    level = 1
    while sys._getframe(level - 1).f_globals["__name__"] in (__name__, Guard.__module__, checks.__name__):
        level += 1
    warnings.warn(what, PrecisionWarning, stacklevel=level)


@lru_cache(maxsize=8)
def _pool(process: int, threads: int) -> ThreadPoolExecutor:
    """Return the pool of threads of this process; a forked child makes its own."""
    return ThreadPoolExecutor(threads, thread_name_prefix="springgym")


def _wait_for(lock: Lock) -> None:
    """Wait until a lock is free. Ignore Ctrl-C meanwhile: an earlier one is being handled already."""
    while True:
        try:
            with lock:
                return
        except KeyboardInterrupt:
            continue


def _checked_names(varying: object) -> frozenset[str]:
    """Return names out of `PARAMETERS`."""
    if isinstance(varying, str) or not isinstance(varying, (Set, Sequence, Mapping)):
        raise TypeError(
            f"varying is {checks.shown(varying)}; it must hold names from {', '.join(PARAMETERS)}"
        )
    return frozenset(checks.chosen("a name in varying", name, PARAMETERS) for name in varying)


def _checked_dtype(dtype: Any) -> np.dtype:
    """Return the dtype, float64 or float32."""
    try:
        given = np.dtype(dtype)
    except Exception:  # a foreign class may raise any error
        given = None
    if given not in WIDTH:
        raise (TypeError if given is None else ValueError)(
            f"dtype is {checks.shown(dtype)}; it must be float64 or float32"
        )
    return given


def copies_in(state: Mapping[str, Any], wanted: int) -> int:
    """Return the number of copies in a state of `Simulator`: ``wanted``, or 1.

    Raises
    ------
    TypeError, ValueError
        If the state has another number of copies, or no times of copies.
    """
    time = checks.instance("state", state, Mapping).get("time")
    count = np.size(checks.instance("state['time']", time, np.ndarray))
    if count not in (1, wanted):
        raise ValueError(
            f"the state holds {count} copies, but copies names {wanted}; it must hold {wanted} copies, or one"
        )
    return count


def _set(
    arrays: Iterable[np.ndarray], values: Iterable[np.ndarray], where: Iterable[Any] = repeat(...)
) -> None:
    """Copy values to arrays. Ctrl-C cannot interrupt the call, so all arrays are set or none."""
    deque(map(np.ndarray.__setitem__, tuple(arrays), where, tuple(values)), 0)


def _blocks_in(name: str, term: Nested) -> Iterator[tuple[str, np.ndarray]]:
    """Yield the arrays of values per copy in nested tuples, with their dotted names.

    Integer lists, which all copies of a block share, are left out, as they follow from these.
    """
    if isinstance(term, np.ndarray) and term.dtype.names:
        if numbers(term).dtype.kind == "f":
            yield name, term
    elif isinstance(term, tuple):
        for key, part in zip(getattr(term, "_fields", range(len(term))), term, strict=True):
            yield from _blocks_in(f"{name}.{key}", part)


def _check_rows(term: Nested, axes: int) -> None:
    """Raise an error for arrays with rows of another length than three, which compiled functions assume."""
    for name, array in _blocks_in("term", term):
        if array.ndim == axes and array.shape[-1] != 3:
            raise ValueError(f"{name} has rows of {array.shape[-1]} numbers; they must have 3")
