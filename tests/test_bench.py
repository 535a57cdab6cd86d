"""`springgym bench` runs and compares; what it measures is not judged here."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from springgym.bench.peers import compiled_cpp
from springgym.bench.sections import H, ratios, top_scene
from springgym.bench.timing import rates
from springgym.cli import main


def test_rates_are_units_over_seconds(monkeypatch: pytest.MonkeyPatch) -> None:
    """By a clock that the pieces themselves move on: 5 units in 0.01 s, and in 0.02 s."""
    now = [0.0]

    def take(seconds: float) -> None:
        now[0] += seconds

    monkeypatch.setattr("springgym.bench.timing.time.perf_counter", lambda: now[0])
    found = rates({"a": (lambda: take(0.01), 5.0), "b": (lambda: take(0.02), 5.0)}, rounds=3)
    assert found["a"] == pytest.approx((500, 500, 500))
    assert found["b"] == pytest.approx((250, 250, 250))


def test_section_to_json_and_figure(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    out, figure = tmp_path / "bench.json", tmp_path / "bench.svg"
    arguments = ["bench", "--only", "features", "--rounds", "1", "--out", str(out), "--figure", str(figure)]
    assert main(arguments) == 0
    report = json.loads(out.read_text())
    assert report["conditions"]["cpu"]
    assert all(rate[0] > 0 for rate in report["features"].values())
    assert "+ damping" in capsys.readouterr().out
    assert figure.exists()


def test_unknown_section(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["bench", "--only", "smell"]) == 2
    assert "no section 'smell'" in capsys.readouterr().err


def test_ratios_come_from_what_was_measured() -> None:
    results = {"peers": {"springgym rk4 float64 8": (3.0, 2, 4), "C++ rk4 float64 8": (2.0, 1, 3)}}
    assert ratios(results) == {"rk4 float64 8: springgym / C++": 1.5}


def test_reference_steps_as_the_package_does() -> None:
    """The yardstick computes the same motion, so the comparison is of like with like."""
    from springgym.simulator import Simulator

    scene = top_scene()
    piece = compiled_cpp(scene, H, 1, np.float64)
    if piece is None:
        pytest.skip("no C++ compiler")
    run, steps = piece
    run()
    positions = run.__defaults__[0][0][0]
    simulator = Simulator(scene, integrator="rk4", step=H)
    simulator.advance(int(steps))
    np.testing.assert_allclose(positions[0, :, :, 0], simulator.positions[0], atol=1e-9)
    assert np.abs(simulator.positions[0] - scene.positions).max() > 0.1


def test_reference_leaves_arithmetic_alone() -> None:
    """Loading code linked with -ffast-math would flush subnormal numbers to zero in the whole process."""
    if compiled_cpp(top_scene(), H, 1, np.float64) is None:
        pytest.skip("no C++ compiler")
    assert np.array([5e-324])[0] * 1.0 > 0
