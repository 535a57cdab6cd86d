"""Pairs of bodies in a scene that collide, and their contact parameters, for `springgym.dynamics.contact`."""

from springgym.model.collisions.meeting import Collisions, Meeting, Meetings, Pair, meetings
from springgym.model.collisions.overlap import check_apart
from springgym.model.collisions.shape import Shape, as_met, shape

__all__ = ["Collisions", "Meeting", "Meetings", "Pair", "Shape", "as_met", "check_apart", "meetings", "shape"]
