"""Surfaces and contact parameters: frozen data, checked once.

Each kind of surface is one file, see `springgym.model.surfaces.surface`, and a line of `SURFACES`.
"""

from __future__ import annotations

from collections.abc import Callable

from springgym.model.surfaces.bowl import Bowl as Bowl
from springgym.model.surfaces.checking import check_gradient as check_gradient
from springgym.model.surfaces.contact import DEFAULT_REACH as DEFAULT_REACH
from springgym.model.surfaces.contact import IMPACT as IMPACT
from springgym.model.surfaces.contact import NEAREST as NEAREST
from springgym.model.surfaces.contact import SOFTEST as SOFTEST
from springgym.model.surfaces.contact import STIFFEST as STIFFEST
from springgym.model.surfaces.contact import Contact as Contact
from springgym.model.surfaces.contact import PaperContact as PaperContact
from springgym.model.surfaces.contact import check_heights as check_heights
from springgym.model.surfaces.contact import check_surfaces as check_surfaces
from springgym.model.surfaces.contact import coupled as coupled
from springgym.model.surfaces.contact import derived_strength as derived_strength
from springgym.model.surfaces.contact import loss_factor as loss_factor
from springgym.model.surfaces.contact import resting as resting
from springgym.model.surfaces.contact import scales as scales
from springgym.model.surfaces.height_field import HeightField as HeightField
from springgym.model.surfaces.height_field import waves as waves
from springgym.model.surfaces.pipe import Pipe as Pipe
from springgym.model.surfaces.plane import Plane as Plane
from springgym.model.surfaces.plane import floor as floor
from springgym.model.surfaces.plane import incline as incline
from springgym.model.surfaces.round import gradients as gradients
from springgym.model.surfaces.round import heights as heights
from springgym.model.surfaces.surface import Surface as Surface
from springgym.model.surfaces.surface import by_kind as by_kind
from springgym.model.surfaces.surface import packed_kind as packed_kind

__all__ = [
    "SURFACES",
    "Bowl",
    "Contact",
    "HeightField",
    "PaperContact",
    "Pipe",
    "Plane",
    "Surface",
    "check_gradient",
    "floor",
    "incline",
    "resting",
    "waves",
]

SURFACES: dict[str, Callable[..., Surface]] = {
    "floor": floor,
    "incline": incline,
    "plane": Plane,
    "bowl": Bowl,
    "pipe": Pipe,
    "height_field": HeightField,
    "waves": waves,
}
"""The functions that make surfaces, by their names in scene files."""
