"""Pairs of bodies that may meet, and how: what a scene says, and what follows from it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

from springgym.bodies import Body
from springgym.checks import instance, shown, whole
from springgym.collisions.shape import check_shape
from springgym.surfaces import REACH, Contact, PaperContact, derived_strength

ALL = "all"


@dataclass(frozen=True)
class Pair:
    """Two bodies that may meet.

    Parameters
    ----------
    first, second
        Names of the bodies, or their numbers.
    contact
        How they meet; as the scene's contact says if not given. Its Δ is by default `REACH` of the smaller
        body's `Body.swept`, and c the `derived_strength` of the softer body's largest stiffness and the
        reduced mass.

    Raises
    ------
    TypeError
        Naming what is of the wrong kind.
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
"""What a scene says of collisions: "all", or how all meet; which pairs; or None."""


class Meeting(NamedTuple):
    """Two bodies that may meet, by their numbers, and how."""

    first: int
    second: int
    contact: Contact
    strength: float
    """c [N·m²]"""
    reach: float
    """Δ [m]"""


class Named(NamedTuple):
    """A body of a scene, as far as collisions know of it."""

    name: str
    body: Body
    moves: bool
    """whether any of its particles is free"""


def meetings(
    collisions: Collisions, contact: Contact | PaperContact, bodies: Sequence[Named]
) -> tuple[Meeting, ...]:
    """The pairs that follow from what a scene says of collisions, ordered by their bodies.

    Raises
    ------
    TypeError
        If it is of the wrong kind.
    ValueError
        Naming the bodies: unknown, named twice, unfit to collide; or if c or Δ cannot be derived.
    """
    if collisions is None:
        return ()
    if isinstance(collisions, Contact) or (isinstance(collisions, str) and collisions == ALL):
        how = collisions if isinstance(collisions, Contact) else contact
        count = range(len(bodies))
        found = [(i, j, how) for i in count for j in count[i + 1 :] if bodies[i].moves or bodies[j].moves]
    else:
        if isinstance(collisions, str) or not isinstance(collisions, Sequence):
            raise TypeError(
                f"collisions is {shown(collisions)}; it must be {ALL!r}, None, a Contact, or a tuple of Pair"
            )
        found = [_numbered(f"collisions[{n}]", pair, contact, bodies) for n, pair in enumerate(collisions)]
        for n, (i, j, _) in enumerate(found):
            if any((i, j) == of[:2] for of in found[:n]):
                raise ValueError(
                    f"collisions[{n}] is of {bodies[i].name!r} and {bodies[j].name!r}, "
                    "which were paired before"
                )
    return tuple(_meeting(i, j, how, bodies) for i, j, how in sorted(found, key=lambda of: of[:2]))


def _numbered(
    what: str, pair: Any, contact: Contact | PaperContact, bodies: Sequence[Named]
) -> tuple[int, int, Contact | PaperContact]:
    """The numbers of a pair's bodies, ascending, and how they meet."""
    instance(what, pair, Pair)
    names = [named.name for named in bodies]
    numbers = []
    for given in (pair.first, pair.second):
        if isinstance(given, str) and given not in names:
            raise ValueError(f"{what} names {given!r}; it must be one of {', '.join(map(repr, names))}")
        number = names.index(given) if isinstance(given, str) else whole(what, given, high=len(names) - 1)
        numbers.append(number)
    i, j = sorted(numbers)
    if i == j:
        raise ValueError(f"{what} pairs {names[i]!r} with itself; it must name two bodies")
    return i, j, contact if pair.contact is None else pair.contact


def _meeting(i: int, j: int, contact: Any, bodies: Sequence[Named]) -> Meeting:
    """How two bodies meet, with c and Δ, both fit for it."""
    pair = (bodies[i], bodies[j])
    called = f"bodies {pair[0].name!r} and {pair[1].name!r}"
    if not isinstance(contact, Contact):
        raise ValueError(
            f"{called} cannot collide by the scene's {type(contact).__name__}; give collisions a Contact, or "
            "say collisions=None"
        )
    reach, strength = contact.reach, contact.strength
    if reach is None:
        reach = REACH * min(named.body.swept for named in pair)
    if reach > 0:
        for named in pair:
            check_shape(named.name, named.body, reach)
    if strength is None:
        stiff = [float(of.body.stiffness.max()) for of in pair if len(of.body.springs)]
        inverse = sum(1 / of.body.mass for of in pair if of.moves)
        strength = derived_strength(min(stiff, default=0.0), 1 / inverse if inverse else 0.0, reach)
    if not (reach > 0 and strength > 0):
        raise ValueError(
            f"{called} have no size or no springs to derive their contact from; give the contact of the pair "
            "a strength and a reach"
        )
    return Meeting(i, j, contact, strength, reach)
