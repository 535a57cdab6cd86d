"""Pairs of bodies that may collide, and their contact parameters, given by a scene or derived."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from springgym.checks import instance, refusing_unknown, shown, whole
from springgym.model.bodies import Body
from springgym.model.collisions.shape import check_shape, shape
from springgym.model.records import ReadOnly
from springgym.model.surfaces import DEFAULT_REACH, Contact, PaperContact, derived_strength
from springgym.model.surfaces.contact import strength_of_impact

ALL = "all"


@refusing_unknown
@dataclass(frozen=True)
class Pair:
    """Two bodies that may collide.

    Parameters
    ----------
    first, second
        Names of the bodies, or their indices.
    contact
        Parameters of their contact; by default those of the scene's contact. By default Δ is `DEFAULT_REACH`
        times the smaller body's `Body.swept`, and c is the `derived_strength` of the softer body's largest
        stiffness and the reduced mass. The springs of spheres and of bodies that are all pinned do not count:
        contacts do not strain them. If no others are left, c is that of `strength_of_impact`.

    Raises
    ------
    TypeError
        If an argument has the wrong type; the message names it.
    """

    first: str | int
    second: str | int
    contact: Contact | None = None

    def __post_init__(self) -> None:
        for name in ("first", "second"):
            body = getattr(self, name)
            if not isinstance(body, str):
                object.__setattr__(self, name, whole(f"{name} of a pair", body))
        instance("contact of a pair", self.contact, Contact, type(None))


Collisions = str | Contact | Sequence[Pair] | None
"""Collisions of a scene: "all", a contact for all pairs, a sequence of pairs, or None."""


class Meeting(NamedTuple):
    """Two bodies that may collide, by their indices, and the parameters of their contact."""

    first: int
    second: int
    contact: Contact
    strength: float
    """c [N·m²]"""
    reach: float
    """Δ [m]"""


@dataclass(frozen=True, eq=False)
class Meetings(ReadOnly):
    """The pairs of bodies that may collide, ordered by their bodies, as arrays of shape (pairs,).

    A thousand bodies make half a million pairs: each `Meeting` is created on access.
    """

    first: np.ndarray
    second: np.ndarray
    contacts: tuple[Contact, ...]
    """distinct sets of contact parameters; several pairs may share one"""
    how: np.ndarray
    """(pairs,) index of each pair's contact in `contacts`"""
    strength: np.ndarray
    """c [N·m²]"""
    reach: np.ndarray
    """Δ [m]"""

    def __post_init__(self) -> None:
        for name in ("first", "second", "how", "strength", "reach"):
            self.keep(name, getattr(self, name))

    def __len__(self) -> int:
        return len(self.first)

    def __getitem__(self, pair: int) -> Meeting:
        first = int(self.first[pair])
        second = int(self.second[pair])
        contact = self.contacts[self.how[pair]]
        return Meeting(first, second, contact, float(self.strength[pair]), float(self.reach[pair]))

    def __iter__(self) -> Iterator[Meeting]:
        return (self[pair] for pair in range(len(self)))

    def of_contacts(self, name: str) -> np.ndarray:
        """Value of a field of its `Contact` for each pair, (pairs,)."""
        return np.array([getattr(contact, name) for contact in self.contacts])[self.how]

    def by(self, contact: Any) -> np.ndarray:
        """Mask (pairs,) of the pairs whose contact is this object."""
        return np.array([own is contact for own in self.contacts], bool)[self.how]


class BodyRef(NamedTuple):
    """A body of a scene, with the data that collisions need."""

    name: str
    body: Body
    moves: bool
    """whether any of its particles is free"""
    partly_pinned: bool = False
    """whether some of them are pinned, and others not"""


def meetings(collisions: Collisions, contact: Contact | PaperContact, bodies: Sequence[BodyRef]) -> Meetings:
    """Return the pairs of bodies that collide, with their contact parameters, from a scene's ``collisions``.

    Raises
    ------
    TypeError
        If ``collisions`` has the wrong type.
    ValueError
        If bodies are unknown, paired twice or unfit to collide, or if c or Δ cannot be derived.
    """
    ways: list[Contact | PaperContact] = [contact]
    count = len(bodies)
    if collisions is None:
        first = second = how = np.zeros(0, int)
    elif isinstance(collisions, Contact) or (isinstance(collisions, str) and collisions == ALL):
        ways = [collisions if isinstance(collisions, Contact) else contact]
        moves = np.array([named.moves for named in bodies], bool)
        first, second = np.triu_indices(count, 1)
        move = moves[first] | moves[second]
        first = first[move]
        second = second[move]
        how = np.zeros(np.count_nonzero(move), int)
    else:
        if isinstance(collisions, str) or not isinstance(collisions, Sequence):
            raise (ValueError if isinstance(collisions, str) else TypeError)(
                f"collisions is {shown(collisions)}; it must be {ALL!r}, None, a Contact, or a tuple of Pair"
            )
        named = _numbered(collisions, bodies)
        owned = [pair.contact for pair in collisions if isinstance(pair, Pair)]
        ways += [contact for contact in owned if contact is not None]
        given = np.array([contact is not None for contact in owned], bool)
        own = np.cumsum(given)
        first, second = np.array(named, int).reshape(-1, 2).T
        order = np.argsort(first * count + second)
        first = first[order]
        second = second[order]
        how = np.where(given, own, 0)[order]
    return _meetings(first, second, ways, how, bodies)


def _numbered(pairs: Sequence[Any], bodies: Sequence[BodyRef]) -> list[tuple[int, int]]:
    """Return the indices of each pair's bodies, ascending."""
    numbers = {named.name: n for n, named in enumerate(bodies)}
    found: dict[tuple[int, int], None] = {}
    for n, pair in enumerate(pairs):
        what = f"collisions[{n}]"
        instance(what, pair, Pair)
        for given in (pair.first, pair.second):
            if isinstance(given, str) and given not in numbers:
                raise ValueError(f"{what} names {given!r}; it must be one of {', '.join(map(repr, numbers))}")
            if not isinstance(given, str):
                whole(what, given, high=len(bodies) - 1)
        i, j = sorted(numbers[of] if isinstance(of, str) else of for of in (pair.first, pair.second))
        if i == j:
            raise ValueError(f"{what} pairs {bodies[i].name!r} with itself; it must name two bodies")
        if not (bodies[i].moves or bodies[j].moves):
            raise ValueError(
                f"{what} pairs {bodies[i].name!r} with {bodies[j].name!r}, which are both pinned"
            )
        if (i, j) in found:
            raise ValueError(
                f"{what} pairs {bodies[i].name!r} with {bodies[j].name!r}, which are already paired"
            )
        found[i, j] = None
    return list(found)


def _meetings(
    first: np.ndarray, second: np.ndarray, ways: Sequence[Any], how: np.ndarray, bodies: Sequence[BodyRef]
) -> Meetings:
    """Find c and Δ of each pair; raise ValueError if bodies are not fit to collide."""
    used = np.unique(how)
    for way in used:
        if not isinstance(ways[way], Contact):
            pair = int(np.argmax(how == way))
            raise ValueError(
                f"{_called(first[pair], second[pair], bodies)} cannot collide by the scene's "
                f"{type(ways[way]).__name__}; give collisions a Contact, or say collisions=None"
            )
        if ways[way].resists:
            _check_resisted(ways[way], first[how == way], second[how == way], bodies)
    contacts = tuple(ways[way] for way in used)
    how = np.searchsorted(used, how)

    def given(name: str) -> np.ndarray:
        """Value of a contact's field for each pair; NaN where it is None."""
        return np.array([getattr(contact, name) for contact in contacts], float)[how]

    def of_both(values: Sequence[float]) -> tuple[np.ndarray, np.ndarray]:
        return np.array(values)[first], np.array(values)[second]

    reach = given("reach")
    derived = DEFAULT_REACH * np.minimum(*of_both([named.body.swept for named in bodies]))
    reach = np.where(np.isnan(reach), derived, reach)
    farthest = np.zeros(len(bodies))
    for of in (first, second):
        np.maximum.at(farthest, of, reach)
    for named, most in zip(bodies, farthest.tolist(), strict=True):
        if most > 0:
            check_shape(named.name, named.body, most, named.partly_pinned)
    kept = [shape(of.body).turns or not of.moves for of in bodies]  # in shape: contacts do not strain these
    each = zip(bodies, kept, strict=True)
    stiff = [np.inf if rigid else float(of.body.stiffness.max(initial=0.0)) or np.inf for of, rigid in each]
    softer = np.minimum(*of_both(stiff))
    inverse = np.add(*of_both([1 / of.body.mass if of.moves else 0.0 for of in bodies]))
    strength = given("strength")
    mass = np.divide(1.0, inverse, out=np.zeros(len(inverse)), where=inverse > 0)
    derived = derived_strength(np.where(np.isinf(softer), 0.0, softer), mass, reach)
    firm = np.isinf(softer) & np.logical_or(*of_both(kept))
    derived = np.where(firm, strength_of_impact(mass, reach), derived)
    strength = np.where(np.isnan(strength), derived, strength)
    wrong = ~((reach > 0) & (strength > 0))
    if wrong.any():
        pair = int(np.argmax(wrong))
        raise ValueError(
            f"{_called(first[pair], second[pair], bodies)} have no size or no springs to derive their "
            "contact from; give the contact of the pair a strength and a reach"
        )
    return Meetings(first, second, contacts, how, strength, reach)


def _check_resisted(
    contact: Contact, first: np.ndarray, second: np.ndarray, bodies: Sequence[BodyRef]
) -> None:
    """Raise ValueError if a contact would resist the turning of bodies that a couple cannot turn."""
    reasons = [_not_turned(named) for named in bodies]
    skin = np.array([shape(named.body).skin for named in bodies], bool)
    unfit = np.array([bool(reason) for reason in reasons]) | (not contact.friction > 0)
    wrong = (skin[first] | skin[second]) & (unfit[first] | unfit[second])
    if wrong.any():
        pair = int(np.argmax(wrong))
        both = first[pair], second[pair]
        reason = "the contact has no friction, by which bodies roll"
        reason = next((reasons[n] for n in both if reasons[n]), reason)
        raise ValueError(
            f"{_called(*both, bodies)} would collide by a contact with rolling_resistance or "
            f"torsional_resistance, but {reason}; give the pair a Contact without them"
        )


def _not_turned(named: BodyRef) -> str:
    """Return the reason why a couple cannot turn a body; an empty string if it can."""
    if named.body.floppy:
        return f"{named.name!r} is floppy, and a couple cannot turn it"
    if len(named.body.masses) < 4:
        return f"{named.name!r} has too few particles to be turned by a couple"
    if named.partly_pinned:
        return f"only some particles of {named.name!r} are pinned; pin all or none"
    return ""


def _called(first: Any, second: Any, bodies: Sequence[BodyRef]) -> str:
    return f"bodies {bodies[first].name!r} and {bodies[second].name!r}"
