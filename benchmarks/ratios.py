"""The comparisons that matter, from what was measured."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from springgym.envs.registration import ENVIRONMENTS

MORE = 1.1
"""Programs whose errors differ by less than this factor are compared by speed."""


def ratios(report: Mapping[str, Any]) -> dict[str, float]:
    """Ratios by name, of those whose both sides are in the report."""
    found = {}
    for name, (section, above, below) in _wanted().items():
        a, b = (speed(report, section, **which) for which in (above, below))
        if a and b:
            found[name] = a / b
    return found | _against_reference(report) | _equal_error(report) | _outside(report) | _linear(report)


def speed(report: Mapping[str, Any], section: str, **which: object) -> float | None:
    """Return the median of the row that is ``which``, or None."""
    for row in report.get(section, {}).get("rows", ()):
        if all(row.get(name) == value for name, value in which.items()):
            return float(row["median"])
    return None


def _against_reference(report: Mapping[str, Any]) -> dict[str, float]:
    """Divide each method by the same in C++; with dampers, by the fastest of those that err no more."""
    rows = report.get("peers", {}).get("rows", ())
    found = {}
    for own in rows:
        name = own["program"].removeprefix("springgym ")
        methods = {
            "rk4": ["C++ rk4"],
            "verlet": ["C++ verlet"],
            "damped verlet": ["C++ verlet, dampers swept", "C++ verlet, dampers in the force"],
        }.get(name, ())
        speeds = [
            row["median"]
            for row in rows
            if row["program"] in methods
            and all(row[same] == own[same] for same in ("precision", "copies"))
            and row["error"] <= MORE * own["error"]
        ]
        if speeds:
            what = f"{name} {own['precision']}, {own['copies']} copies: springgym / C++"
            found[what] = own["median"] / max(speeds)
    return found


def _wanted() -> dict[str, tuple[str, dict[str, Any], dict[str, Any]]]:
    """Return, by name, a section and which of its numbers are divided."""
    wanted: dict[str, tuple[str, dict[str, Any], dict[str, Any]]] = {}
    for name, program, peer, copies in (
        ("single rk4 / MuJoCo RK4, same springs and step", "springgym rk4", "MuJoCo RK4", 1),
        ("batch verlet / MuJoCo Euler, same springs and step", "springgym verlet", "MuJoCo Euler", 1024),
        ("batch rk4 / JAX", "springgym rk4", "JAX", 1024),
    ):
        above = {"program": program, "precision": "float64", "copies": copies}
        wanted[name] = ("peers", above, {"program": peer})
    for method in ("rk4", "verlet"):
        for precision in ("float64", "float32"):
            same: dict[str, Any] = {"method": method, "precision": precision, "copies": 1024}
            two, one = ({"threads": threads} | same for threads in (2, 1))
            wanted[f"{method} {precision}, 1024 copies: 2 threads / 1"] = ("kernel", two, one)
    for row in ENVIRONMENTS:
        same = {"environment": row.id, "copies": 64}
        own = {"how": "native", "threads": 1} | same
        other = {"how": "SyncVectorEnv"} | same
        wanted[f"{row.id}, 64 copies: native / SyncVectorEnv"] = ("environments", own, other)
    adapter, looped = ({"how": f"PPO collects, {how}"} for how in ("adapter", "DummyVecEnv"))
    wanted["PPO collects, 64 copies: adapter / DummyVecEnv"] = ("environments", adapter, looped)
    return wanted


def _equal_error(report: Mapping[str, Any]) -> dict[str, float]:
    """Divide the default method by the fastest of MuJoCo's integrators, with as many copies and threads."""
    rows = report.get("equal-error", {}).get("rows", ())
    found = {}
    for own in (row for row in rows if row["program"].startswith("springgym")):
        copies, threads = like(own)
        others = [r["median"] for r in rows if r["program"].startswith("MuJoCo") and like(r) == like(own)]
        if others:
            what = f"default {own['precision']}, {copies} copies, {threads} threads"
            found[f"{what} / MuJoCo's best, same springs and error"] = own["median"] / max(others)
    return found


def like(row: Mapping[str, Any]) -> tuple[int, int]:
    """Return the copies and threads of a row: what is compared has the same."""
    return row["copies"], row.get("threads", 1)


def _outside(report: Mapping[str, Any]) -> dict[str, float]:
    """Return the time that SpringTop-v0 spends outside of its compiled control period."""
    found = {}
    for copies, which in ((1, {"how": "single"}), (1024, {"how": "native", "copies": 1024, "threads": 1})):
        whole = speed(report, "environments", environment="SpringTop-v0", **which)
        alone = speed(report, "environments", how="compiled alone", copies=copies)
        if whole and alone and copies == 1:
            found["single env.step: µs outside of the control period"] = 1e6 / whole - 1e6 / alone
        elif whole and alone:
            found["native 1024: share of time outside of the control period"] = 1 - whole / alone
    return found


def _linear(report: Mapping[str, Any]) -> dict[str, float]:
    """Return the largest ring, and number of copies, where a spring costs at most 1.25 times the least."""
    rows = report.get("sizes", {}).get("rows", ())
    found = {}
    for axis, rest, name in (
        ("ring", {"copies": 1}, "cost is linear up to a ring of, 1 copy"),
        ("ring", {"copies": 64}, "cost is linear up to a ring of, 64 copies"),
        ("copies", {"ring": 12}, "cost is linear up to copies, ring of 12"),
    ):
        line = sorted((row[axis], row["median"]) for row in rows if rest.items() <= row.items())
        good = [size for size, rate in line if rate * 1.25 >= max(rate for _, rate in line)]
        if good:
            found[name] = float(good[-1])
    return found
