"""Model only what a scene needs: errors as asked for, costs in order."""

import re

import numpy as np
import pytest

from benchmarks.top_models import main, needed, steady_of
from springgym.scenes import load, names
from tests.params import slow_but


@pytest.mark.slow
def test_rubber_top():
    need = needed(load("rubber-top"), 0.02, implicit=())
    assert need.steady.gap == pytest.approx(-0.0117, rel=0.01)
    rigid, *springs = sorted(need.models, key=lambda model: (model.dynamics, model.softened))
    assert rigid.error == pytest.approx(0.0118, rel=0.01)  # the rigid top is faster by the gap
    real, softer = springs
    assert real.error < 1e-4
    assert 0.015 < softer.error < 0.02
    assert 2 < softer.softened < 4
    assert softer.step == pytest.approx(real.step * np.sqrt(softer.softened), rel=0.1)
    assert need.models == sorted(need.models, key=lambda model: model.cost)
    assert need.cheapest.error <= 0.02


@pytest.mark.slow
def test_less_than_the_gap_rules_the_rigid_top_out():
    need = needed(load("rubber-top"), 0.005, implicit=(), duration=0.3)
    assert need.cheapest.dynamics == "springs"
    assert max(model.error for model in need.models) == pytest.approx(0.0118, rel=0.01)
    with pytest.raises(ValueError, match="no model precesses within 1e-09 of the real top"):
        _ = need._replace(wanted=1e-9).cheapest


@pytest.mark.parametrize(
    "name", slow_but(names(), "beech-top", "cube-pendulum", "dominoes", "gyroscope", "rope-swing")
)
def test_a_scene_is_a_top_or_is_refused_for_what_it_is(name):
    why = ""
    try:
        assert np.isfinite(steady_of(load(name))).all()
    except ValueError as error:
        why = str(error)
    assert re.search(r"^$|is not a heavy top: |no steady precession|has \d+ bodies; it must have one", why)


def test_what_is_no_top_is_refused(capsys):
    assert main(["two-tops"]) == 2
    assert "scene 'two-tops' has 2 bodies; it must have one, a heavy top" in capsys.readouterr().err
    for name in ("steel-rope", "steel-cube", "bouncing-ball"):
        with pytest.raises(ValueError, match="is not a heavy top"):
            needed(load(name), 1e-3)


def test_command(capsys):
    assert main(["rubber-top", "--gap", "0.02", "--implicit"]) == 0
    said = capsys.readouterr().out
    assert "a rigid top precesses at 3.818488 rad/s, the real one 0.012 slower" in said
    assert "→  " in said
    assert main(["steel-rope"]) == 2
    for gap in ("2", "0", "nan"):
        assert main(["rubber-top", "--gap", gap]) == 2
        assert f"--gap is {float(gap)}; it must be a positive number" in capsys.readouterr().err
    for wrong in (["rubber-top", "--implicit", "bdf"], []):
        with pytest.raises(SystemExit):
            main(wrong)


@pytest.mark.slow
def test_steel_top_is_rigid_for_all_one_sees():
    need = needed(load("steel-top"), 1e-3)
    assert need.cheapest.dynamics == "rigid"
    assert need.cheapest.error == pytest.approx(9.5e-7, rel=0.02)
    softer = next(model for model in need.models if model.softened > 1)
    assert 700 < softer.softened < 1500
    implicit = next(model for model in need.models if model.integrator == "tr_bdf2")
    assert implicit.error < 1e-3
    assert implicit.step > 100 * 8.7e-7
