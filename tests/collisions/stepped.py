"""Scenes of colliding bodies on a `Simulator`, as tests read them."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from typing import Any
from unittest import mock

import numpy as np

from benchmarks.hard_cases import kept_by_nodes
from springgym import simulator
from springgym.checks import HUGE
from springgym.core.language import ragged
from springgym.core.language.blocks import numbers, to_copies
from springgym.core.language.kinds import Each
from springgym.dynamics import packing, stepping
from springgym.dynamics.contact.round import packed_rounds
from springgym.dynamics.records import PAIR_TOTALS, Pairs, Turning
from springgym.dynamics.stepping import StepRequirements
from springgym.dynamics.terms import Drive, Terms, Thrust, Wrench
from springgym.model.scene import Scene
from springgym.model.surfaces import Contact, Plane
from springgym.simulator import Simulator

FAR = Plane((0, 0, -100), (0, 0, 1))
"""A floor that nothing comes near."""


def with_gravity(scene: Scene) -> Scene:
    """A scene with gravity, be it zero."""
    return scene if scene.gravity else scene.with_(gravity=(0.0, 0.0, 0.0))


def with_all_terms(scene: Scene) -> Scene:
    """A scene with gravity and a floor, be they without effect."""
    scene = with_gravity(scene)
    if scene.surfaces:
        return scene
    contact = scene.contact if scene.collisions == "all" else Contact(strength=1e-3, reach=1e-3)
    return scene.with_(surfaces=(FAR,), contact=contact)


ALIKE = frozenset({"masses", "stiffness", "lengths", "gravity"})
"""If one of these parameters varies, tests let all of them vary, so that scenes share code; where nothing
collides, in all scenes."""


def shares_code(scene: Scene, method: str, twin: bool) -> bool:
    """Return whether a scene is given all kinds of terms: bodies that collide, and others by verlet or rigid,
    if nothing is of a kind that few scenes have, such as a bowl."""
    level = all(isinstance(surface, Plane) for surface in scene.surfaces)
    usual = isinstance(scene.contact, Contact) and not any(placed.forces for placed in scene.bodies)
    return level and (bool(scene.meetings) or (usual and (twin or method == "verlet")))


def with_all_features(pairs: Pairs, blocks: Callable[..., np.ndarray]) -> Pairs:
    """Pairs without None, and with friction and loss of each copy in ``blocks``."""
    shapes = pairs.shapes
    count = len(pairs.first)

    def of_copies(values: np.ndarray | None) -> np.ndarray:
        if values is not None and values.dtype.names:
            return values
        array = blocks(count)
        numbers(array)[:] = np.zeros((count, 1)) if values is None else values[:, None]
        return array

    if shapes is not None:
        none = np.zeros(len(shapes.radius), bool)
        shapes = shapes._replace(
            triangles=np.zeros((0, 3), np.uint32) if shapes.triangles is None else shapes.triangles,
            edges=np.zeros((0, 2), np.uint32) if shapes.edges is None else shapes.edges,
            rods=none if shapes.rods is None else shapes.rods,
            balls=none if shapes.balls is None else shapes.balls,
        )
    return pairs._replace(
        friction=of_copies(pairs.friction),
        loss=of_copies(pairs.loss),
        strength=of_copies(pairs.strength),
        shapes=shapes,
    )


class Packing:
    """The state of `all_kinds_of_terms` while it packs a scene."""

    shares = False
    """whether the scene is given all kinds of terms"""
    twin = False
    """whether the bodies of the scene are rigid"""


@contextmanager
def all_kinds_of_terms() -> Iterator[None]:
    """Give scenes every kind of term, so that they share compiled code.

    Scenes share it if their surfaces are of the same kinds, if bodies collide in both or in none, and if
    dampers act in cycles in both or in none. `shares_code` tells which do.

    What a scene does not have does nothing there: gravity, damping, friction, loss and radii of zero, no
    round features, idle actuators, and `FAR` where bodies that collide have no surface. Numbers that are the
    same in all bodies that collide are of each body. In environments with contact dampers act in every step,
    where their tasks ask for cycles.
    """
    pack = packing._packed
    share = packing._shared
    pack_pairs = packing.pack_pairs
    make_turning = packing.new_turning
    whole_pack = packing.pack
    make_workspaces = packing.workspaces
    actuators = packing._actuators
    stack = ragged.stacked
    cycles_in = stepping._cycles_in

    def in_cycles(scene: Scene, task: StepRequirements, steps: int, exactly: bool) -> tuple[int, int]:
        return (steps, 1) if scene.can_touch else cycles_in(scene, task, steps, exactly)

    def pack_whole(scene: Scene, twin: bool, options: packing.Options) -> Any:
        Packing.shares = shares_code(scene, options.method.name, twin)
        Packing.twin = twin
        asks = options.varying & {"friction", "restitution"}  # which is refused where there is no surface
        alone = twin or asks or not (scene.meetings and Packing.shares)
        return whole_pack(scene if alone else with_all_terms(scene), twin, options)

    def workspaces(scene: Scene, method: Any, collisions: Any, twin: bool, *others: Any) -> list[Any]:
        Packing.shares = shares_code(scene, method.name, twin)
        Packing.twin = twin
        full = scene if twin or not (scene.meetings and Packing.shares) else with_all_terms(scene)
        return make_workspaces(full, method, collisions, twin, *others)

    def varied(whole: Scene, given: packing.Options, twin: bool) -> packing.Options:
        rubs = whole.surfaces or whole.meetings.by(whole.contact).any()
        names = {"friction", "restitution"} if rubs else set()
        names |= set() if twin else {"damping"}
        names |= {"strength"} if whole.surfaces and not whole.meetings else set()
        names |= ALIKE if not twin and (given.varying & ALIKE or not whole.meetings) else set()
        return given._replace(varying=given.varying | names)

    def shared(whole: Scene, given: packing.Options) -> Terms:
        if not Packing.shares:
            return share(whole, given)
        return share(with_gravity(whole), varied(whole, given, Packing.twin))

    def packed(part: Scene, whole: Scene, terms: Terms, twin: bool, given: packing.Options) -> packing.Packed:
        if not Packing.shares:
            return pack(part, whole, terms, twin, given)
        found = pack(part, whole, terms, twin, varied(whole, given, twin))
        rigid = found.twin
        if twin and rigid[1] is None:
            rigid = (rigid[0], given.parameter({"masses"}, np.zeros(1)))
        surfaces = found.terms.surfaces
        rounds = found.terms.rounds
        dampers = found.terms.dampers
        if surfaces is not None:
            surfaces = surfaces._replace(radius=float(part.body.radius))
            if packing.solves_rows(whole, given.method, twin):
                rounds = packed_rounds(part.body)
        if twin and not whole.meetings:
            dampers = None
        return found._replace(
            terms=found.terms._replace(surfaces=surfaces, rounds=rounds, dampers=dampers), twin=rigid
        )

    def turning(turns: np.ndarray, *others: Any) -> Turning | None:
        if not Packing.shares:
            return make_turning(turns, *others)
        found: Any = make_turning(np.ones(len(turns), bool), *others)
        return found._replace(turns=turns)

    def actuated(part: Scene, whole: Scene, blocks: Callable[..., np.ndarray]) -> dict[str, Any]:
        if not Packing.shares:
            return actuators(part, whole, blocks)
        markers = np.array(part.body.markers, np.uint32)
        idle: dict[str, Any] = {
            "wrench": Wrench(blocks(3), blocks(3), blocks(3), markers, part.pivot, 1.0),
            "thrust": Thrust(np.zeros(0, np.uint32), blocks(0, 3), markers, False),
        }
        if not whole.meetings:
            idle["drive"] = Drive(-1, blocks(3), HUGE)
        return idle | actuators(part, whole, blocks)

    def paired(whole: Scene, twin: bool, given: packing.Options) -> Pairs:
        pairs = pack_pairs(whole, twin, given)
        return with_all_features(pairs, given.blocks) if Packing.shares else pairs

    def stacked(terms: Sequence[Any]) -> Any:
        first = terms[0]
        if len(terms) == 1 or isinstance(first, np.ndarray):
            return stack(terms)
        if isinstance(first, bool | int | float):
            return Each(np.array(terms))
        if isinstance(first, tuple) and any(term is not first for term in terms):
            parts = [stacked(of) for of in zip(*terms, strict=True)]
            return type(first)(*parts) if hasattr(first, "_fields") else tuple(parts)
        return stack(terms)

    changed = {"_shared": shared, "_packed": packed, "_actuators": actuated, "pack_pairs": paired}
    changed |= {"new_turning": turning, "workspaces": workspaces}
    with (
        mock.patch.multiple(packing, **changed, stacked=stacked),
        mock.patch.multiple(simulator, pack=pack_whole, stacked=stacked),
        mock.patch.object(stepping, "_cycles_in", in_cycles),
    ):
        yield


def full(scene: Scene, *, dynamics: str = "springs", **options: Any) -> Simulator:
    """A simulator of bodies that collide, with all kinds of terms, and a floor far below if it has none."""
    varying = ("friction", "restitution", *(("damping",) if dynamics == "springs" else ()))
    with all_kinds_of_terms():
        return Simulator(with_all_terms(scene), dynamics=dynamics, varying=varying, **options)


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
    ) -> None:
        options: dict[str, Any] = {"step": step, "copies": copies, "dtype": dtype}
        options |= {"unresolved": "count"}
        self.scene = scene if lean else with_all_terms(scene)
        self.simulator = Simulator(scene, **options) if lean else full(scene, **options)
        self.step = self.simulator.step

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
        """(copies, pairs, PAIR_TOTALS)"""
        found = to_copies(self.simulator._terms.collisions.totals, self.simulator.copies)
        return found.reshape(len(found), -1, PAIR_TOTALS).astype(float)

    def momenta(self) -> np.ndarray:
        """Momentum and angular momentum about the origin, (copies, 6)."""
        m = self.scene.masses[:, None]
        x = self.x
        v = self.v
        return np.concatenate([(m * v).sum(1), (m * np.cross(x, v)).sum(1)], axis=1)

    def energy(self) -> np.ndarray:
        """Return what the method keeps of the energy (copies,)."""
        return kept_by_nodes(self.simulator)
