"""Materials with four constants (wood with eleven), and a table with a source for each number."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from types import MappingProxyType
from typing import Self

import numpy as np

from springgym.checks import TINY, instance, number, refusing_unknown, shown
from springgym.theory import solid

__all__ = [
    "LEAST_POISSON",
    "MATERIALS",
    "MODULI",
    "MOST_POISSON",
    "SOFTEST",
    "Grain",
    "Material",
    "material_of",
]

MODULI = ("young_r", "young_t", "shear_lr", "shear_lt", "shear_rt")
"""Fields of `Grain` that are moduli [Pa]."""

LEAST_POISSON = -0.99
"""Least Poisson's ratio. Nearer to −1, the elasticity of a solid is lost in rounding."""

MOST_POISSON = 0.49999
"""Largest Poisson's ratio. Nearer to ½, the elasticity of a solid is lost in rounding."""

SOFTEST = 1e12
"""Largest factor by which a material can be made softer or stiffer."""


@refusing_unknown
@dataclass(frozen=True)
class Grain:
    """The properties of wood across its grain, radially (R, from the pith) and tangentially (T, along rings).

    Together with E_L and ν_LR of its `Material`, these are the nine constants of an orthotropic solid. ν_ij
    is the contraction along j when a pull stretches the solid along i.
    """

    young_r: float
    """E_R [Pa]"""
    young_t: float
    """E_T [Pa]"""
    shear_lr: float
    """G_LR [Pa]"""
    shear_lt: float
    """G_LT [Pa]"""
    shear_rt: float
    """G_RT [Pa]"""
    poisson_lt: float
    """ν_LT"""
    poisson_rt: float
    """ν_RT"""

    def __post_init__(self) -> None:
        for name in MODULI:
            object.__setattr__(self, name, number(f"{name} of a grain", getattr(self, name), low=TINY))
        for name in ("poisson_lt", "poisson_rt"):
            object.__setattr__(self, name, number(f"{name} of a grain", getattr(self, name)))


@refusing_unknown
@dataclass(frozen=True)
class Material:
    """An elastic material with internal friction.

    Parameters
    ----------
    name
        Name of the material.
    young
        Young's modulus E [Pa]; for wood E_L, along the grain.
    poisson
        Poisson's ratio ν; for wood ν_LR.
    density
        ρ [kg/m³].
    loss
        Loss factor η: the fraction of its energy that a vibration at the lowest frequency of a body loses per
        radian. Its damping ratio is η/2.
    grain
        Properties of wood across the grain; None for a material without grain.
    softness
        Factor by which this material is softer than the real one, see `softened`.
    sources
        Source of each number, by the names above; "guess" if none was found.

    Raises
    ------
    TypeError
        If an argument has the wrong type, see `springgym.checks`.
    ValueError
        If a constant is not physically possible; the message names it.
    """

    name: str
    young: float
    poisson: float
    density: float
    loss: float = 0.0
    grain: Grain | None = None
    softness: float = 1.0
    sources: Mapping[str, str] = field(default_factory=dict, compare=False, repr=False)

    def __post_init__(self) -> None:
        instance("name of a material", self.name, str)
        wood = instance(f"grain of {self.name!r}", self.grain, Grain, type(None)) is not None
        bounds: dict[str, dict[str, float]] = {
            **{name: {"low": TINY} for name in ("young", "density", "softness")},
            "poisson": {} if wood else {"low": LEAST_POISSON, "high": MOST_POISSON},
            "loss": {"low": 0.0, "high": 1.0},
        }
        for name, bound in bounds.items():
            object.__setattr__(self, name, number(f"{name} of {self.name!r}", getattr(self, name), **bound))
        sources = dict(instance(f"sources of {self.name!r}", self.sources, Mapping))
        object.__setattr__(self, "sources", sources)
        if wood:
            try:
                self.elasticity()
            except ValueError as error:
                raise ValueError(f"young, poisson and grain of {self.name!r} do not fit: {error}") from error

    def softened(self, factor: float) -> Self:
        """Return the same material with all moduli divided by a factor; density and loss do not change.

        Frequencies of a body become lower by √factor, and stable steps longer by √factor. The growth of the
        body under spin, and so its difference from a rigid body, becomes larger by the factor.

        Raises
        ------
        ValueError
            If the factor is not positive, or farther from 1 than `SOFTEST`.
        """
        factor = number("factor", factor, 1 / SOFTEST, SOFTEST)
        softer = {name: getattr(self.grain, name) / factor for name in MODULI} if self.grain else {}
        grain = self.grain and replace(self.grain, **softer)
        return replace(self, young=self.young / factor, grain=grain, softness=self.softness * factor)

    def elasticity(self) -> np.ndarray:
        """Return the stiffness tensor C (3, 3, 3, 3) [Pa]; for wood, R is along x, T along y and the grain
        along z."""
        if self.grain is None:
            return solid.isotropic(self.young, self.poisson)
        grain = self.grain
        return solid.orthotropic(
            (grain.young_r, grain.young_t, self.young),
            (
                grain.poisson_rt,
                self.poisson * grain.young_r / self.young,  # ν_RL
                grain.poisson_lt * grain.young_t / self.young,  # ν_TL
            ),
            (grain.shear_rt, grain.shear_lr, grain.shear_lt),
        )

    def __str__(self) -> str:
        return self.name if self.softness == 1 else f"{self.name} made {self.softness:g} times softer"


def _described(sources: str, **others: str) -> Mapping[str, str]:
    """Return the source of each number: one for all, and others by name."""
    names = ("young", "poisson", "density", "loss")
    return dict.fromkeys(names, sources) | others


IRVINE = "T. Irvine, Damping Properties of Materials, rev. C (2004), tables 1 and 2"
BEECH = "table 1 of doi:10.1186/s10086-019-1794-4"
ACROSS = (
    f"{BEECH}, which contradicts itself: from its ν_RT follows ν_TR = ν_RT E_T/E_R = 0.219, and it prints "
    "0.373; ν_RT is taken. G_RT: no second source was found. G_LR: 0.93 to 1.29 GPa in an abstract of Krüger "
    "and Wagenführ, Comparison of methods for determining shear modulus of wood (2020)"
)
WOOD_LOSS = (
    "guess, within what the Wood Handbook (FPL-GTR-282, page 5-21, as others quote it) says of all woods: "
    "logarithmic decrements πη from less than 0.02, hot and dry, to 0.1, hot and moist"
)
OAK = "Wood Handbook (USDA), laurel (red) oak at 12 % moisture"
PLASTICS = "engineersedge.com, properties of plastic materials, table 14630"
ABS = "makeitfrom.com, unfilled ABS"
NATURAL = "MatWeb, vulcanised natural rubber"

MATERIALS: Mapping[str, Material] = MappingProxyType(
    {
        material.name: material
        for material in (
            Material(
                "steel",
                *(210e9, 0.31, 7800.0, 2e-4),
                sources=_described(IRVINE, loss=f"{IRVINE}: 0.2e-4 to 3e-4"),
            ),
            Material(
                "aluminium",
                *(72e9, 0.34, 2700.0, 1e-4),
                sources=_described(IRVINE, loss=f"{IRVINE}: about 1e-4 in bending"),
            ),
            Material(
                "brass",
                *(95e9, 0.33, 8500.0, 5e-4),
                sources=_described(IRVINE, loss=f"{IRVINE}: 2e-4 to 1e-3"),
            ),
            Material(
                "beech",
                *(12.205e9, 0.502, 710.0, 0.01),
                grain=Grain(1.858e9, 0.774e9, 0.899e9, 0.595e9, 0.195e9, 0.705, 0.526),
                sources=_described(
                    BEECH, density="wood-database.com, European beech, dried", loss=WOOD_LOSS, grain=ACROSS
                ),
            ),
            Material(
                "oak",
                *(12.9e9, 0.350, 706.0, 0.01),
                grain=Grain(1.98e9, 1.06e9, 1.15e9, 1.04e9, 0.21e9, 0.448, 0.560),
                sources=_described(
                    OAK,
                    young=f"{OAK}: 1.1 times its 11.7 GPa in bending, as that book advises",
                    density=f"{OAK}: 1.12 times its specific gravity of 0.63",
                    loss=WOOD_LOSS,
                    grain=f"{OAK}, as shares of E_L; G_RT: guess, the share of beech",
                ),
            ),
            Material(
                "nylon",
                *(2.69e9, 0.40, 1140.0, 0.03),
                sources=_described(
                    PLASTICS, young=f"{PLASTICS}: nylon 6/6, dry", poisson="guess", loss="guess"
                ),
            ),
            Material(
                "abs",
                *(2.0e9, 0.41, 1050.0, 0.02),
                sources=_described(ABS, density=f"{PLASTICS}: ABS, extrusion grade", loss="guess"),
            ),
            Material(
                "rubber",
                *(1.5e6, 0.4999, 950.0, 0.1),
                sources=_described(
                    NATURAL,
                    young=f"{NATURAL}: three times its shear modulus of 0.5 MPa",
                    poisson="½ − E/6K with K = 2.9 GPa, the mean of 14 rubbers in Burns, Dubbelday & Ting, "
                    "Dynamic Bulk Modulus of Various Elastomers",
                    loss="SolidWorks help, viscous damping ratios, after Adams & Askenazi: ζ = 0.05",
                ),
            ),
        )
    }
)
"""Materials by name. Values are typical: samples of wood and plastic differ by 10 % and more."""


def material_of(given: Material | str, softened: float = 1.0) -> Material:
    """Return a material, given itself or by its name in `MATERIALS`, made softer by a factor.

    Raises
    ------
    TypeError
        If ``given`` is neither a material nor a name.
    ValueError
        If there is no material of that name, or the factor is out of bounds, see `Material.softened`.
    """
    softened = number("softened", softened, 1 / SOFTEST, SOFTEST)
    if isinstance(given, str):
        if given not in MATERIALS:
            raise ValueError(f"material is {shown(given)}; it must be one of {', '.join(MATERIALS)}")
        given = MATERIALS[given]
    made: Material = instance("material", given, Material, str)
    return made.softened(softened)
