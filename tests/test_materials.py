"""Materials: their table, and what makes one softer."""

import copy
import pickle
from dataclasses import fields, replace

import numpy as np
import pytest

from springgym.model.materials import MATERIALS, Grain, Material, material_of

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
        ({"poisson": 0.5}, r"poisson of 'clay' is 0\.5; it must be a number from -0\.99 to 0\.49999"),
        ({"loss": -0.1}, r"loss of 'clay' is -0\.1; it must be a number from 0 to 1"),
        (
            {"grain": Grain(1e9, 1e9, 1e9, 1e9, 1e9, 0.9, 0.9), "poisson": 0.9},
            "young, poisson and grain of 'clay' do not fit: no material has E",
        ),
    ],
)
def test_impossible_materials_are_refused(changes, message):
    """`tests.api.test_bodies` tries all other arguments, those of a grain too."""
    with pytest.raises(ValueError, match=message):
        replace(Material("clay", 1e9, 0.3, 2000.0), **changes)


@pytest.mark.parametrize("factor", [0, 1e13])
def test_softening_by_no_factor_is_refused(factor):
    with pytest.raises(ValueError, match=r"factor is .*; it must be a number from 1e-12 to"):
        MATERIALS["steel"].softened(factor)


def test_by_name():
    assert material_of("oak") == MATERIALS["oak"]
    assert material_of("oak").sources == MATERIALS["oak"].sources
    assert material_of("oak", 4.0) == MATERIALS["oak"].softened(4)
    own = Material("clay", 1e9, 0.3, 2000.0)
    assert material_of(own) == own
    with pytest.raises(ValueError, match="material is 'cheese'; it must be one of steel, aluminium"):
        material_of("cheese")
    with pytest.raises(TypeError, match="material is 3; it must be Material or str"):
        material_of(3)


def test_sources_are_its_own():
    given = {"young": "a book"}
    clay = Material("clay", 1e9, 0.3, 2000.0, sources=given)
    given["young"] = "hearsay"
    assert clay.sources == {"young": "a book"}
    for copied in (pickle.loads(pickle.dumps(clay)), copy.deepcopy(clay), replace(clay)):
        assert copied == clay
        assert hash(copied) == hash(clay)
        assert copied.sources == clay.sources


def test_fields_are_described():
    """What `sources` may name are fields."""
    assert {*FIGURES, "grain"} < {field.name for field in fields(Material)}
