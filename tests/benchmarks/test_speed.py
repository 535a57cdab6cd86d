"""`benchmarks.speed` runs and compares; how fast it finds things is not judged here."""

from __future__ import annotations

import json
import re
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from benchmarks import curves, peers, speed
from benchmarks.conditions import progress
from benchmarks.errors import step_errors
from benchmarks.paper_top import error, exact_positions, paper_top, rounding, stepping
from benchmarks.ratios import ratios
from benchmarks.speed import SECTIONS, main
from benchmarks.timing import Case, Row, measured
from springgym.envs.task import Task
from springgym.model.bodies.distances import rms_distance
from springgym.simulator import PAPER_STEP, Simulator
from tests.params import slow_but

pytestmark = pytest.mark.own_kernels


def test_rates_are_units_over_seconds(monkeypatch: pytest.MonkeyPatch) -> None:
    """The rates follow a clock that the cases advance: 5 units in 0.01 s and in 0.02 s, after a first run."""
    now = [0.0]

    def take(seconds: float) -> None:
        now[0] += seconds

    monkeypatch.setattr("benchmarks.timing.time.perf_counter", lambda: now[0])
    cases = [
        Case({"name": "a"}, lambda: take(0.01), 5.0),
        Case({"name": "b"}, lambda: take(0.02), 5.0, begin=lambda: take(3.0), facts={"error": 0.1}),
    ]
    a, b = measured(cases, rounds=3, unit="steps/s")
    assert (a.median, a.low, a.high) == pytest.approx((500, 500, 500))
    speeds = {name: pytest.approx(250) for name in ("median", "low", "high")}
    assert b.flat() == {"name": "b", "unit": "steps/s", "error": 0.1} | speeds
    assert str(b).split() == ["b", "250", "steps/s", "(250", "…", "250)", "error", "0.1"]


@pytest.mark.slow
def test_section_to_json_and_figure(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    """The rows of every section that a figure shows, of two cases."""
    scene = paper_top()

    def sizes(rounds: int) -> list[Row]:
        """Two sizes."""
        cases = [Case({"ring": 12, "copies": n}, lambda n=n: sum(range(1000)), 1e3 * n) for n in (1, 8)]
        return [row._replace(facts={"ns_a_spring": 1.0}) for row in measured(cases, rounds, "steps/s", 1e-3)]

    def against(rounds: int) -> list[Row]:
        """Two programs."""
        cases = [
            stepping({"program": name, "precision": "float64", "copies": 1}, scene, facts=error(scene))
            for name in ("springgym rk4", "C++ rk4")
        ]
        return measured(cases, rounds, "steps/s", 1e-3)

    monkeypatch.setitem(SECTIONS, "sizes", sizes)
    monkeypatch.setitem(SECTIONS, "peers", against)
    out = tmp_path / "bench.json"
    figure = tmp_path / "bench.svg"
    arguments = ["--only", "sizes", "peers", "--quick", "--out", str(out), "--figure", str(figure)]
    assert main(arguments) == 0
    report = json.loads(out.read_text())
    assert report["conditions"]["cpu"]
    assert [row["copies"] for row in report["sizes"]["rows"]] == [1, 8]
    assert all(row["median"] > 0 for row in report["sizes"]["rows"])
    assert report["ratios"]["rk4 float64, 1 copies: springgym / C++"] > 0
    assert "Two sizes." in capsys.readouterr().out
    assert figure.exists()


@pytest.mark.parametrize("watched", [True, False])
def test_a_bar_shows_how_far_it_is_to_who_looks(
    watched: bool, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(sys.stderr, "isatty", lambda: watched, raising=False)
    assert list(progress([1, 2, 3], "rounds", mininterval=0)) == [1, 2, 3]
    assert ("rounds:  67%" in capsys.readouterr().err) is watched


def test_unknown_section(capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit):
        main(["--only", "smell"])
    assert "invalid choice: 'smell'" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("given", "says"),
    [
        (["--figure", "x.txt"], "x.txt: the name must end in .svg or .png or .pdf"),
        (["--figure", "HERE/x.svg"], "--figure .*x.svg: it is a folder; it must be a file"),
        (["--out", "HERE"], "--out .*: it is a folder; it must be a file"),
        (["--out", "HERE/file/x.json"], "file"),
        (["--rounds", "0"], "--rounds 0: it must be at least 1"),
    ],
)
def test_what_would_fail_later_is_told_before_the_work(
    given: list[str],
    says: str,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(speed, "measure", lambda *_: pytest.fail("it measures"))
    (tmp_path / "file").touch()
    (tmp_path / "x.svg").mkdir()
    assert main([*(word.replace("HERE", str(tmp_path)) for word in given)]) == 2
    assert re.search(says, capsys.readouterr().err)


def report(section: str, *rows: dict[str, Any]) -> dict[str, Any]:
    return {section: {"rows": rows}}


def test_ratios_come_from_what_was_measured() -> None:
    what = {"precision": "float64", "copies": 8}
    what["error"] = 0.01
    rows = ({"program": name, "median": n} | what for name, n in (("springgym rk4", 3.0), ("C++ rk4", 2.0)))
    assert ratios(report("peers", *rows)) == {"rk4 float64, 8 copies: springgym / C++": 1.5}


def test_dampers_are_compared_with_the_fastest_that_errs_no_more() -> None:
    swept = "C++ verlet, dampers swept"
    in_force = "C++ verlet, dampers in the force"
    own = "springgym damped verlet"
    for error_in_force, wanted in ((0.0105, 0.5), (0.02, 2.0)):
        rows = (
            {"program": name, "median": speed, "error": its, "precision": "float32", "copies": 8}
            for name, speed, its in ((own, 4.0, 0.01), (swept, 2.0, 0.01), (in_force, 8.0, error_in_force))
        )
        found = ratios(report("peers", *rows))
        assert found == {"damped verlet float32, 8 copies: springgym / C++": wanted}


def test_equal_error_is_against_the_fastest_of_as_many_copies_and_threads() -> None:
    own = {"program": "springgym default", "precision": "float64", "copies": 8, "threads": 2, "median": 12.0}
    others = [own | {"program": f"MuJoCo {n}", "median": n} for n in (2.0, 3.0)]
    others += [others[0] | {"median": 4.0} | other for other in ({"copies": 1}, {"threads": 1})]
    (ratio,) = ratios(report("equal-error", own, *others)).values()
    assert ratio == 4.0
    assert ratios(report("equal-error", own, *others[2:])) == {}


def test_time_outside_of_the_control_period() -> None:
    top = {"environment": "SpringTop-v0"}
    single = top | {"how": "single", "median": 1e4}
    alone = top | {"how": "compiled alone", "copies": 1, "median": 2e4}
    (outside,) = ratios(report("environments", single, alone)).values()
    assert outside == pytest.approx(50.0)


def test_where_cost_stops_being_linear() -> None:
    rows = ({"ring": 12, "copies": n, "median": rate} for n, rate in ((1, 90.0), (2, 100.0), (4, 70.0)))
    found = ratios(report("sizes", *rows))
    assert found["cost is linear up to copies, ring of 12"] == 2


@pytest.mark.slow
def test_error_falls_with_the_square_of_the_step() -> None:
    """So it is the time error of verlet, and not of what it is compared with."""
    scene = paper_top()
    coarse, fine = (error(scene, step=PAPER_STEP / n)["error"] for n in (2, 4))
    assert coarse / fine == pytest.approx(4.0, rel=0.05)


def finer(task: Task, step: float, copies: int) -> tuple[Simulator, ...]:
    return (Simulator(task.scene, copies=copies, step=step / 16),)


@pytest.mark.usefixtures("few_kernels")
@pytest.mark.slow
def test_error_of_a_step_where_others_act_too() -> None:
    """Of bodies that collide, an opponent among them; an estimate says the same."""
    found = step_errors("SpringDuel-v0", finer, episodes=2, periods=6, every=2)
    assert found.errors.shape == found.estimates.shape == (6,)
    assert 0 < found.errors.min() < found.errors.max() < 1e-4  # the opponent alone moves its top by 3e-4
    np.testing.assert_allclose(found.estimates, found.errors, rtol=0.05)
    assert step_errors("SpringBilliards-v0", finer, episodes=2, periods=1).errors.max() < 1e-3  # a stroke


@pytest.mark.slow
def test_errors_are_over_starts_as_episodes_draw_them() -> None:
    """Many: the error of a top depends on its spin. What follows the end of an episode does not count."""
    at_first, later = (
        step_errors("SpringTop-v0", finer, episodes=64, periods=periods, every=1) for periods in (1, 120)
    )
    assert len(at_first.errors) == 64
    assert at_first.errors.max() > 3 * at_first.errors.min()
    assert 120 * 64 - 200 < len(later.errors) < 120 * 64
    np.testing.assert_allclose(later.estimates, later.errors, rtol=0.05)


@pytest.mark.slow
def test_a_curve_is_of_the_errors_of_the_table(monkeypatch: pytest.MonkeyPatch) -> None:
    """Its default row is what the section `errors` says; Verlet's errors fall with the square of the step."""
    monkeypatch.setattr(curves, "HIGHER", ())
    played = {"episodes": 4, "periods": 9, "every": 2}
    rows = [row.flat() for row in curves.curve("SpringTop-v0", **played)]
    (usual,) = (row for row in rows if row["default"])
    errors = step_errors("SpringTop-v0", finer, **played).errors  # steps of h/16 err by 1/256 of it
    assert usual["median"] == pytest.approx(np.median(errors), rel=0.01)
    assert usual["high"] == pytest.approx(errors.max(), rel=0.01)
    by_steps = {row["steps"] / usual["steps"]: row for row in rows}
    assert 0.25 not in by_steps  # is not stable
    for factor in (1, 2, 4):
        ratio = by_steps[factor]["median"] / by_steps[2 * factor]["median"]
        assert ratio == pytest.approx(4, rel=0.2)  # dampers act in cycles of other lengths
    assert by_steps[8]["microseconds"] > by_steps[1]["microseconds"] > 0


def test_what_an_error_costs() -> None:
    """The least of all methods, by a power of the error between two rows."""

    def row(method: str, steps: int, error: float, took: float) -> dict[str, Any]:
        return {"method": method, "steps": steps, "median": error, "microseconds": took}

    verlet = [row("verlet", 40 * n, 1e-4 / n**2, 10.0 * n) for n in (4, 1, 2)]
    assert curves.cost(verlet, 1e-4) == pytest.approx(10)
    assert curves.cost(verlet, 1e-4 / 3**2) == pytest.approx(30)
    assert curves.cost(verlet, 1e-3) == pytest.approx(10)  # no fewer steps are stable
    assert curves.cost(verlet, 1e-6) is None
    rk4 = [row("rk4", 10, 1e-3, 9.0), row("rk4", 20, 1e-3 / 16, 18.0)]
    assert curves.cost(verlet + rk4, 1e-3 / 16) == pytest.approx(10 * 1.6**0.5)
    assert curves.cost(verlet + rk4, 1e-3) == pytest.approx(9)
    assert curves.cost(rk4, 1e-3 / 4) == pytest.approx(9 * 2**0.5)
    assert curves.cost([], 1.0) is None


@pytest.mark.slow
def test_rounding_is_that_of_single_precision() -> None:
    found = rounding(paper_top(), step=PAPER_STEP)
    assert 6e-8 < found["rounding_after_1_s"] < 1e-4
    assert found["rounding_after_1_s"] < found["rounding_after_10_s"] < 1e-2


PEERS: dict[str, tuple[str, float, Any]] = {
    "MuJoCo, rigid": ("mujoco", 1e-5, lambda scene: peers.MuJoCo(scene, "RK4", 1e-3, rigid=True).peer()),
    "SciPy": ("scipy", 1e-4, lambda scene: peers.scipy_rk45(scene, PAPER_STEP)),
    "JAX": ("jax", 5e-4, lambda scene: peers.jax_batch(scene, PAPER_STEP, 2)),
} | {
    f"MuJoCo, {way}": ("mujoco", 5e-4, lambda scene, w=way: peers.MuJoCo(scene, w, PAPER_STEP / 4).peer())
    for way in ("RK4", "Euler", "implicit", "implicitfast")
}
"""By name: the package of a program, how far its positions may be off [1], and how it is run."""


@pytest.mark.parametrize("name", slow_but(PEERS, "MuJoCo, RK4", "SciPy", "JAX"))
def test_peers_move_the_same_body(name: str) -> None:
    package, off, run = PEERS[name]
    pytest.importorskip(package)
    scene = paper_top()
    exact = exact_positions(scene, 1.0, *(["rigid"] if "rigid" in name else []))
    assert rms_distance(run(scene).positions, exact, scene.sizes) < off


@pytest.mark.parametrize("threads", [1, 2])
def test_mujoco_steps_a_batch_as_it_steps_one(threads: int) -> None:
    pytest.importorskip("mujoco")
    program = peers.MuJoCo(paper_top(), "Euler", PAPER_STEP)
    one = program.peer()
    batch = program.batch(8, threads, steps=3)
    np.testing.assert_array_equal(batch.positions, one.positions)
    states = batch.run()
    assert batch.steps == 8 * 3
    assert np.shape(states) == (8, 3, len(program.state()))


@pytest.mark.parametrize(
    ("precision", "copies", "divides", "method"),
    slow_but(
        [
            ("float64", 1, True, "verlet"),
            *(("float64", 100, False, method) for method in peers.CPP),
            *(("float32", 100, True, method) for method in peers.CPP),
        ],
        ("float64", 1, True, "verlet"),
    ),
)
def test_reference_steps_as_the_package_does(precision: str, copies: int, divides: bool, method: str) -> None:
    """The yardstick computes the same motion, so the comparison is of like with like.

    Its dampers act in every step. In the force they are another method, of the same order: it differs within
    the error of the step.
    """
    scene = paper_top(damping=100.0 if "dampers" in method else 0.0)
    peer = peers.cpp(scene, PAPER_STEP, copies, precision, method, ways=((2, divides),))
    if peer is None:
        pytest.skip("no C++ compiler")
    simulator = Simulator(scene, integrator=method.partition(",")[0], step=PAPER_STEP, damping_every=1)
    simulator.advance(2000)
    tolerance = 1e-4 if precision == "float32" else 1e-5 if "force" in method else 1e-9
    np.testing.assert_allclose(peer.positions, simulator.positions[0], atol=tolerance)
    assert np.abs(simulator.positions[0] - scene.positions).max() > 0.1
    mine, its = (
        rms_distance(at, exact_positions(scene, 1.0), scene.sizes)
        for at in (simulator.positions[0], peer.positions)
    )
    assert its == pytest.approx(mine, rel=0.1)


def test_reference_leaves_arithmetic_alone() -> None:
    """Loading code linked with -ffast-math would flush subnormal numbers to zero in the whole process."""
    if peers.cpp(paper_top(), PAPER_STEP, 1, "float64") is None:
        pytest.skip("no C++ compiler")
    assert np.array([5e-324])[0] * 1.0 > 0


@pytest.mark.parametrize("name", SECTIONS)
@pytest.mark.timeout(3600)
@pytest.mark.slow
def test_every_row_has_a_speed_and_sections_their_error(name: str) -> None:
    """All of it, in one round."""
    rows = SECTIONS[name](1)
    assert all(row.low > 0 or row.unit == "of the size" for row in rows)
    stated = all("error" in row.facts or row.unit == "of the size" for row in rows)
    assert stated or "o error" in str(SECTIONS[name].__doc__)
