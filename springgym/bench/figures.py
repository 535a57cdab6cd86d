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
    bars = {name: rate[0] for name, rate in report.get("peers", {}).items() if "float32" not in name}
    names = sorted(bars, key=bars.__getitem__)
    colors = [BLUE if name.startswith("springgym") else GREY for name in names]
    left.barh([name.replace(" float64", ",") for name in names], [bars[name] for name in names], color=colors)
    left.set(
        xscale="log", xlabel="steps a second, one core", title="The paper's top: 14 particles, 37 springs"
    )
    left.tick_params(axis="y", labelsize=7)
    for label, pattern in (
        ("copies of a ring of 12", "ring 12, "),
        ("particles in the ring, 64 copies", ", 64 copies"),
    ):
        points = []
        for name, rate in report.get("sizes", {}).items():
            ring, copies = (int("".join(filter(str.isdigit, part))) for part in name.split(","))
            if pattern in name:
                points.append((copies if "copies of" in label else ring, 1e9 / rate[0]))
        points.sort()
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
