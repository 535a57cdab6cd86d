"""Materials: their table, and what makes one softer."""

from dataclasses import fields, replace

import numpy as np
import pytest

from springgym.materials import MATERIALS, Grain, Material, material_of

FIGURES = ("young", "poisson", "density", "loss")


@pytest.mark.parametrize("name", MATERIALS)
def test_every_figure_has_its_source(name):
    material = MATERIALS[name]
    assert material.name == name
    wanted = {*FIGURES} | ({"grain"} if material.grain else set())
    assert set(material.sources) == wanted
    assert all(material.sources.values())


@pytest.mark.parametrize("name", MATERIALS)
def test_strain_energy_is_positive(name):
    """Of six independent strains, in Voigt's order."""
    c = MATERIALS[name].elasticity()
    strains = [np.eye(3)[[i]].T @ np.eye(3)[[j]] for i, j in ((0, 0), (1, 1), (2, 2), (1, 2), (0, 2), (0, 1))]
    strains = [(strain + strain.T) / 2 for strain in strains]
    energy = np.array([[np.einsum("ij,ijkl,kl", a, c, b) for b in strains] for a in strains])
    assert np.linalg.eigvalsh(energy)[0] > 0
    assert c == pytest.approx(c.transpose(2, 3, 0, 1), rel=1e-9)


def test_grain_lies_along_z():
    """A pull along z stretches beech by 1/E_L; along x, the radial direction, by 1/E_R: 6.6 times as much."""
    beech = MATERIALS["beech"]
    c = beech.elasticity()
    voigt = [(0, 0), (1, 1), (2, 2), (1, 2), (0, 2), (0, 1)]
    compliance = np.linalg.inv([[c[i][j][k][m] for k, m in voigt] for i, j in voigt])
    assert 1 / np.diag(compliance)[:3] == pytest.approx([1.858e9, 0.774e9, 12.205e9])
    assert 1 / np.diag(compliance)[3:] == pytest.approx([0.595e9, 0.899e9, 0.195e9])  # LT, LR, RT
    assert -compliance[0, 2] * 12.205e9 == pytest.approx(0.502)  # ν_LR
    assert -compliance[1, 2] * 12.205e9 == pytest.approx(0.705)  # ν_LT
    assert -compliance[0, 1] * 1.858e9 == pytest.approx(0.526)  # ν_RT


@pytest.mark.parametrize("name", ["steel", "beech"])
def test_softened(name):
    material = MATERIALS[name]
    softer = material.softened(8).softened(2)
    assert softer.elasticity() == pytest.approx(material.elasticity() / 16)
    assert (softer.density, softer.loss, softer.softness) == (material.density, material.loss, 16)
    assert str(softer) == f"{name} made 16 times softer"
    assert str(material) == name


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"young": 0.0}, r"young of 'clay' is 0\.0; it must be positive"),
        ({"density": float("nan")}, "density of 'clay' is nan; it must be positive"),
        ({"poisson": 0.5}, r"poisson of 'clay' is 0\.5; it must lie between −1 and 0\.5"),
        ({"loss": -0.1}, r"loss of 'clay' is -0\.1; it must be at least 0"),
        ({"grain": Grain(1e9, 1e9, 1e9, 1e9, 1e9, 0.9, 0.9), "poisson": 0.9}, "no material has E"),
    ],
)
def test_impossible_materials_are_refused(changes, message):
    with pytest.raises(ValueError, match=message):
        replace(Material("clay", 1e9, 0.3, 2000.0), **changes)


def test_softening_by_nothing_is_refused():
    with pytest.raises(ValueError, match="softened is 0; it must be positive"):
        MATERIALS["steel"].softened(0)


def test_by_name():
    assert material_of("oak") is MATERIALS["oak"]
    own = Material("clay", 1e9, 0.3, 2000.0)
    assert material_of(own) is own
    with pytest.raises(ValueError, match="unknown material 'cheese'; there are steel, aluminium"):
        material_of("cheese")


def test_fields_are_described():
    """What `sources` may name are fields."""
    assert {*FIGURES, "grain"} < {field.name for field in fields(Material)}
