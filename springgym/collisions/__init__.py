"""Find which bodies of a scene collide, and how. `springgym.contact` computes with it."""

from springgym.collisions.meeting import Collisions, Meeting, Meetings, Pair, meetings
from springgym.collisions.overlap import check_apart, tell_ellipsoids
from springgym.collisions.shape import Shape, as_met, place_ellipsoids, shape

__all__ = [
    "Collisions",
    "Meeting",
    "Meetings",
    "Pair",
    "Shape",
    "as_met",
    "check_apart",
    "meetings",
    "place_ellipsoids",
    "shape",
    "tell_ellipsoids",
]
