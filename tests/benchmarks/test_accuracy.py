"""Problems, references, work-precision and studies of `benchmarks.accuracy`."""

from __future__ import annotations

import json
import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from benchmarks import studies, work_precision
from benchmarks.accuracy import REPORT, main
from benchmarks.peers import derivative, jacobian, mujoco_rungs, scipy_rungs
from benchmarks.problems import PROBLEMS
from benchmarks.timing import FAILED, rows_of
from benchmarks.work_precision import cheapest, default_count, edge, measure, own_rung, reference
from springgym.model.bodies import cube
from springgym.model.bodies.distances import largest_distance, rms_distance
from springgym.simulator import Simulator


@pytest.fixture
def ledgers(monkeypatch: pytest.MonkeyPatch) -> None:
    """Let simulators keep a ledger, so that they share kernels with other tests: the motion is the same."""

    def made(*given: Any, ledger: bool, **options: Any) -> Simulator:
        assert not ledger
        return Simulator(*given, **options)

    monkeypatch.setattr(work_precision, "Simulator", made)


@pytest.mark.parametrize("name", [name for name, problem in PROBLEMS.items() if problem.rigid])
def test_start_is_that_of_rigid_theory_but_for_the_strain(name: str) -> None:
    problem = PROBLEMS[name]
    assert problem.rigid is not None
    scene = problem.scene(1e9)
    assert np.abs(scene.positions - problem.rigid(0.0)).max() < 1e-5
    assert np.abs(problem.rigid(0.05) - problem.rigid(0.0)).max() > 1e-3


@pytest.mark.usefixtures("ledgers")
def test_verlet_halves_the_step_and_quarters_the_error_against_another_method() -> None:
    problem = PROBLEMS["cube-swing"]._replace(seconds=0.2)
    scene = problem.scene(problem.stiffness)
    (exact,) = (rung.run()[0] for rung in scipy_rungs(problem, scene) if rung.step == 1e-9)
    first = default_count(problem, scene)
    rungs = [own_rung(problem, scene, "verlet", n * first, None) for n in (1, 2, 4)]
    rows = rows_of(rungs, exact, scene, 3)
    errors = np.array([row["error"] for row in rows])
    np.testing.assert_allclose(errors[:-1] / errors[1:], 4, rtol=0.1)
    assert [row["evaluations"] for row in rows] == pytest.approx([5 * first, 10 * first, 20 * first])
    for row in rows:
        low, high = row["cost_quartiles"]
        assert 0 < low <= row["cost"] <= high
    wrong = rows_of(rungs, exact + 1.0, scene, 1)
    assert all(row["error"] is None for row in wrong)  # 1 m off is a failure
    assert FAILED < 1 / 1.8


def test_edge_is_within_the_limit_and_the_rung_before_is_not() -> None:
    problem = PROBLEMS["cusp-top"]
    scene = problem.scene(problem.stiffness)
    count = edge(problem, scene, "verlet")
    own_rung(problem, scene, "verlet", count, None)
    with pytest.raises(ValueError, match="unstable"):
        own_rung(problem, scene, "verlet", int(0.97 * count), None)


def test_mujoco_is_given_the_same_springs() -> None:
    pytest.importorskip("mujoco")
    problem = PROBLEMS["rope"]._replace(seconds=0.1)  # pinned and damped
    scene = problem.scene(problem.stiffness)
    (exact,) = (rung.run()[0] for rung in scipy_rungs(problem, scene) if rung.step == 1e-9)
    rungs = [rung for rung in mujoco_rungs(problem, scene) if rung.method == "MuJoCo RK4"]
    errors = [largest_distance(rung.run()[0], exact, scene.sizes) for rung in rungs[1:]]
    assert np.abs(exact[-1] - scene.positions).max() > 0.01
    assert errors[-1] < 1e-7
    assert errors[0] / errors[-1] > 100  # fourth order over two halvings: 256


def test_jacobian_of_the_peers_is_that_of_their_derivative() -> None:
    scene = PROBLEMS["cube-swing"].scene(1e5)
    state = np.concatenate([scene.positions.ravel(), scene.velocities.ravel()])
    slope = derivative(scene)
    matrix = jacobian(scene)(0.0, state)
    for n in (3, 11, 30):
        step = np.zeros_like(state)
        step[n] = 1e-6
        numeric = (slope(0.0, state + step) - slope(0.0, state - step)) / 2e-6
        np.testing.assert_allclose(matrix[:, n], numeric, atol=1e-3 * np.abs(matrix).max() * 1e-3)
    assert np.abs(matrix).max() > 1e5


def test_cheapest_takes_what_is_accurate_enough_then_what_costs_least() -> None:
    rows = [
        {"method": "a", "error": 1e-2, "cost": 1.0},
        {"method": "b", "error": 1e-4, "cost": 3.0},
        {"method": "c", "error": 1e-5, "cost": 2.0},
        {"method": "d", "error": None, "cost": 0.1},
    ]
    assert cheapest({"rows": rows}, 1e-3) == rows[2]
    assert cheapest({"rows": rows}, 1e-3, among="b") == rows[1]
    assert cheapest({"rows": rows}, 1e-6) is None


@pytest.mark.usefixtures("ledgers")
@pytest.mark.slow
def test_command_writes_report_and_figure(tmp_path: Path) -> None:
    assert main(["tumble", "--quick", "--out", str(tmp_path)]) == 0
    (row, *_) = json.loads((tmp_path / REPORT).read_text())["tumble"]["rows"]
    assert 0 < row["error"] < 0.1
    assert row["runs"] == 5
    assert b"</svg>" in (tmp_path / "tumble.svg").read_bytes()
    assert (
        json.loads((tmp_path / REPORT).read_text())["tumble"]["measured"]["versions"]["numpy"]
        == np.__version__
    )


def test_a_report_that_cannot_be_added_to_is_told_at_once(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / REPORT).write_text("half a rep")
    assert main(["--out", str(tmp_path)]) == 2
    assert "accuracy.json: cannot add to this report: Expecting value" in capsys.readouterr().err


def test_unknown_problem_is_named(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["marble"]) == 2
    assert "'marble'" in capsys.readouterr().err


@pytest.mark.slow
def test_references_agree() -> None:
    for name in ("cube-swing", "cusp-top", "rope"):
        problem = PROBLEMS[name]
        _, agreement, _ = reference(problem, problem.scene(problem.stiffness))
        assert agreement < 1e-10


@pytest.mark.slow
def test_spin_down_is_that_of_theory() -> None:
    result = studies.spin_down()
    assert result["theory_errors"][0] < 0.01  # to first order in h: 2.5 % are left at 10 ms
    at_one = {(c["method"], c["step"]): c["spins"][24] for c in result["curves"]}
    assert at_one["implicit_euler", 0.01] < 0.25
    assert at_one["tr_bdf2", 0.01] > 0.97


@pytest.mark.slow
def test_rigid_gap_is_inverse_to_the_stiffness() -> None:
    assert all(abs(power + 1) < 0.02 for power in studies.rigid_gap()["powers"].values())


@pytest.mark.slow
def test_rigid_twin_comes_within_1e_8_of_theory() -> None:
    rows = studies.rigid_twin(quick=True)["rows"]
    assert min(row["error"] for row in rows if row["method"] == "rigid kahan_li") < 1e-8


@pytest.mark.slow
def test_all_methods_are_measured() -> None:
    result = measure("cube-swing", quick=True, peers=False)
    assert {row["method"] for row in result["rows"]} == set(PROBLEMS["cube-swing"].methods())
    assert abs(result["model"]["power"] + 1) < 0.02


def test_distances_are_shares_of_the_size() -> None:
    """Of the eight corners of a cube, whose size is its diagonal, one is moved by a diagonal."""
    body = cube()
    moved = body.positions.copy()
    moved[3] += 1.0
    assert body.size == pytest.approx(math.sqrt(3))
    assert largest_distance(moved, body.positions, body.size) == pytest.approx(1.0)
    assert rms_distance(moved, body.positions, body.size) == pytest.approx(1 / math.sqrt(8))
    moved[0] = np.nan
    assert largest_distance(moved, body.positions, body.size) == math.inf
