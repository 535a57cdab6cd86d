"""Find which bodies of a scene collide, and how. `springgym.contact` computes with it."""

from springgym.collisions.meeting import Collisions, Meeting, Meetings, Pair, meetings
from springgym.collisions.overlap import check_apart
from springgym.collisions.shape import Shape, shape

__all__ = ["Collisions", "Meeting", "Meetings", "Pair", "Shape", "check_apart", "meetings", "shape"]
