"""Records and what is refused on their strength."""

from __future__ import annotations

import math
import subprocess
import sys

import numpy as np
import pytest

from springgym.core.compiler.cache import SOURCES
from springgym.core.compiler.code_digest import digest
from springgym.dynamics.measures import read
from springgym.dynamics.methods import METHODS, advance_kernel, integrator
from springgym.simulator import Simulator
from tests.integrators.problems import tetrahedron


@pytest.mark.parametrize("name", METHODS)
def test_record_is_complete(name: str) -> None:
    record = integrator(name)
    assert record.name == name
    assert record.order >= 1
    assert record.evaluations >= 1
    assert record.imaginary_limit > 0
    assert record.workspace >= 1
    assert any(character.isdigit() for character in record.citation)
    if record.implicit:
        assert math.isinf(record.imaginary_limit)
        assert math.isinf(record.real_limit)
    if record.negative_substeps:
        assert record.real_limit == 0


@pytest.mark.parametrize("name", METHODS)
def test_damping_is_refused_by_methods_that_allow_none(name: str) -> None:
    damped = tetrahedron("verlet", 1.0)
    undamped = damped.with_(body=damped.body.with_(damping=0.0))
    Simulator(undamped, integrator=name)
    if integrator(name).real_limit == 0:
        for scene, varying in ((damped, ()), (undamped, ("damping",))):
            with pytest.raises(ValueError, match=f"{name} takes (substeps back in time|no dampers)"):
                Simulator(scene, integrator=name, varying=varying)
    else:
        Simulator(damped, integrator=name, varying=("damping",))


@pytest.mark.parametrize("name", METHODS)
def test_tolerance_goes_to_methods_that_have_one(name: str) -> None:
    scene = tetrahedron(name, 0.0)
    if not integrator(name).controlled:
        with pytest.raises(ValueError, match=f"{name} has no tolerance"):
            Simulator(scene, integrator=name, tolerance=(1e-6, 1e-9))
        with pytest.raises(ValueError, match="no counts"):
            Simulator(scene, integrator=name).counts()
        return
    assert Simulator(scene, integrator=name, copies=3).counts().shape == (3, 3)
    with pytest.raises(ValueError, match=r"tolerance is 1e-06; it must be a pair, \(relative, absolute\)"):
        Simulator(scene, integrator=name, tolerance=1e-6)  # type: ignore[arg-type]
    for wrong in ((0.0, 0.0), (-1e-6, 1e-3), (math.nan, 1e-3)):
        with pytest.raises(ValueError, match=r"tolerance(\[\d\])? is"):
            Simulator(scene, integrator=name, tolerance=wrong)


def test_each_method_has_its_own_cache_entry() -> None:
    digests = {name: digest(advance_kernel(name, read).py_func, (), SOURCES) for name in METHODS}
    assert len(set(digests.values())) == len(METHODS)
    script = (
        "from springgym.core.compiler.cache import SOURCES; "
        "from springgym.core.compiler.code_digest import digest; "
        "from springgym.dynamics.methods import advance_kernel; "
        "from springgym.dynamics.measures import read; "
        "print(digest(advance_kernel('rk4', read).py_func, (), SOURCES).hex())"
    )
    alone = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, check=True).stdout
    assert alone.strip() == digests["rk4"].hex()  # whatever else this process has imported


@pytest.mark.slow
def test_newton_converges_in_float32() -> None:
    ends = []
    for dtype in (np.float32, np.float64):
        made = Simulator(tetrahedron("tr_bdf2", 1.0), integrator="tr_bdf2", step=0.01, dtype=dtype)
        made.advance(50)
        ends.append(made.positions[0])
    np.testing.assert_allclose(ends[0], ends[1], atol=2e-4)


def test_a_method_that_chooses_its_steps_says_what_the_step_is() -> None:
    with pytest.raises(
        ValueError,
        match=r"dopri5 on this body allows at most .* s\. It chooses its own steps up to the given one",
    ):
        Simulator(tetrahedron("dopri5", 0.0), integrator="dopri5", step=1.0)
