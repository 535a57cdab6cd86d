"""Contact between bodies: terms, how near features are found, and the impulses of a node.

`springgym.forces.together` passes nodes with them.
"""

from springgym.forces.pairs.terms import Meets, PairReadings, Pairs, Room, Shapes

__all__ = ["Meets", "PairReadings", "Pairs", "Room", "Shapes"]
