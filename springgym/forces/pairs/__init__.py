"""Contact between bodies: terms, how near features are found, and the impulses of a node."""

from springgym.forces.pairs.impulses import collide
from springgym.forces.pairs.terms import Pairs, Room, Shapes

__all__ = ["Pairs", "Room", "Shapes", "collide"]
