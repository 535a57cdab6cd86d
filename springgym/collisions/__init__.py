"""Find which bodies of a scene collide, and how. `springgym.contact` computes with it."""

from springgym.collisions.meeting import Collisions, Meeting, Meetings, Pair, meetings
from springgym.collisions.overlap import check_apart
from springgym.collisions.shape import Shape, as_met, shape

__all__ = ["Collisions", "Meeting", "Meetings", "Pair", "Shape", "as_met", "check_apart", "meetings", "shape"]
