"""The figure of `springgym bench`."""

from __future__ import annotations

from pathlib import Path
from typing import Any

BLUE, GREY = "#2a5c99", "#9aa3ad"


def draw(report: dict[str, Any], path: Path) -> None:
    """Draw peers as bars and size against cost, of whatever was measured."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(11, 4.6), layout="constrained")
    left, right = figure.subplots(1, 2)
    rows = [row for row in report.get("peers", {}).get("rows", ()) if row["precision"] == "float64"]
    rows.sort(key=lambda row: row["median"])
    colors = [BLUE if row["program"].startswith("springgym") else GREY for row in rows]
    names = [f"{row['program']}, {row['copies']} (error {row['error']:.0e})" for row in rows]
    left.barh(names, [row["median"] for row in rows], color=colors)
    left.set(
        xscale="log",
        xlabel="steps a second, one core",
        title="The paper's top, by program and copies",
    )
    left.tick_params(axis="y", labelsize=7)
    rows = report.get("sizes", {}).get("rows", ())
    for axis, rest, label in (
        ("copies", {"ring": 12}, "copies of a ring of 12"),
        ("ring", {"copies": 64}, "particles in the ring, 64 copies"),
        ("ring", {"copies": 1}, "particles in the ring, 1 copy"),
    ):
        points = sorted((row[axis], row["ns_a_spring"]) for row in rows if rest.items() <= row.items())
        if points:
            right.plot(*zip(*points, strict=True), "o-", label=label)
    right.set(
        xscale="log",
        xlabel="number",
        ylabel="ns a spring and step",
        title="Cost against size",
        ylim=(0, None),
    )
    if right.lines:
        right.legend(frameon=False)
    for axes in (left, right):
        axes.spines[["top", "right"]].set_visible(False)
    path.parent.mkdir(parents=True, exist_ok=True)
    figure.savefig(path)
