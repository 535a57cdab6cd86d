"""The figures of `springgym bench`."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

from springgym.accuracy.figures import COLORS, INK, PEER, SMALL, End, name_ends, plain, save

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

OURS = "#2b5c96"


def draw(report: dict[str, Any], path: Path) -> None:
    """Draw peers as dots and size against cost, of whatever was measured."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    figure = Figure(figsize=(7.6, 8.4))
    FigureCanvasAgg(figure)
    rows = [row for row in report.get("peers", {}).get("rows", ()) if row["precision"] == "float64"]
    _peers(plain(figure, 0.3, 0.55, 0.66, 0.41), rows)
    _sizes(plain(figure, 0.1, 0.06, 0.54, 0.38), report.get("sizes", {}).get("rows", ()))
    path.parent.mkdir(parents=True, exist_ok=True)
    save(figure, path)


def _peers(axes: Axes, rows: list[dict[str, Any]]) -> None:
    """Draw a line for each program: a ring for one copy, a dot for the best batch, and the step's error."""
    best: dict[str, dict[bool, dict[str, Any]]] = {}
    for row in rows:
        kinds = best.setdefault(row["program"], {})
        batch = row["copies"] > 1
        if batch not in kinds or row["median"] > kinds[batch]["median"]:
            kinds[batch] = row
    order = sorted(best, key=lambda name: max(row["median"] for row in best[name].values()))
    for line, program in enumerate(order):
        color = OURS if program.startswith("springgym") else PEER
        speeds = [row["median"] for row in best[program].values()]
        axes.plot([min(speeds), max(speeds)], [line, line], color=color, linewidth=1, alpha=0.5)
        for batch, row in best[program].items():
            axes.plot(
                row["median"], line, "o", color=color, markerfacecolor=color if batch else "w", markersize=7
            )
        row = max(best[program].values(), key=lambda row: row["median"])
        axes.annotate(
            f"{_short(row['median'])}  (error {row['error']:.0e})", (row["median"], line), (8, 0),
            textcoords="offset points", va="center", fontsize=SMALL, color=INK,
        )  # fmt: skip
    axes.set(
        xscale="log",
        yticks=range(len(order)),
        yticklabels=order,
        xlabel="steps a second, one core; ring: one copy, dot: the best batch",
    )
    axes.set_title("The paper's top, by program", fontsize=10, loc="left")
    axes.tick_params(axis="y", labelsize=9, length=0)
    axes.spines["left"].set_visible(False)
    if rows:
        low, high = (f(row["median"] for row in rows) for f in (min, max))
        axes.set(xlim=(0.6 * low, 60 * high), ylim=(-0.6, len(order) - 0.4))


def _short(speed: float) -> str:
    """Write a speed in three figures: 4.95 M, 197 k."""
    return f"{speed / 1e6:.3g} M" if speed >= 1e6 else f"{speed / 1e3:.3g} k"


def _sizes(axes: Axes, rows: list[dict[str, Any]]) -> None:
    """Cost of a spring and step against how many there are."""
    ends = []
    for axis, rest, label, color in (
        ("ring", {"copies": 1}, "particles in a ring, 1 copy", "#8048a0"),
        ("ring", {"copies": 64}, "particles in a ring, 64 copies", "#22966a"),
        ("copies", {"ring": 12}, "copies of a ring of 12", OURS),
    ):
        points = sorted((row[axis], row["ns_a_spring"]) for row in rows if rest.items() <= row.items())
        if points:
            axes.plot(*zip(*points, strict=True), "o-", color=color, markersize=3.5, linewidth=1.2)
            ends.append(End(*points[-1], label, color))
    axes.set(xscale="log", xlabel="number", ylabel="ns a spring and step", ylim=(0, None))
    axes.set_title("Cost against size", fontsize=10, loc="left")
    name_ends(axes, ends)


ACROSS = 3
"""Environments side by side."""
PANEL, BELOW = 1.75, 0.55
"""Height of a panel, and of the strip below all panels that names axis and methods [inch]."""


def draw_curves(rows: list[dict[str, Any]], path: Path) -> None:
    """Draw error against cost, a panel for each environment; the default is a star."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    names = list(dict.fromkeys(row["environment"] for row in rows))
    down = -(-len(names) // ACROSS)
    tall = PANEL * down + BELOW
    figure = Figure(figsize=(7.6, tall))
    FigureCanvasAgg(figure)
    width, height = 0.9 / ACROSS, PANEL / tall
    costs = [row["microseconds"] for row in rows]
    errors = [row["median"] for row in rows]
    for n, name in enumerate(names):
        left, top = 0.085 + width * (n % ACROSS), 1 - 0.02 / down - height * (n // ACROSS)
        axes = plain(figure, left, top - 0.8 * height, 0.86 * width, 0.62 * height)
        axes.set(
            xscale="log",
            yscale="log",
            xlim=(0.7 * min(costs), 1.4 * max(costs)),
            ylim=(0.3 * min(errors), 3 * max(errors)),
        )
        lowest, highest = axes.get_xlim()
        ticks = [tick for tick in (1, 3, 10, 30, 100, 300, 1000) if lowest < tick < highest]
        axes.set_xticks(ticks, [f"{tick}" for tick in ticks])
        axes.set_xticks([], minor=True)
        axes.set_title(name.removeprefix("Spring").partition("-")[0], fontsize=SMALL + 1, loc="left")
        axes.tick_params(labelsize=SMALL, which="major", labelleft=n % ACROSS == 0)
        own = [row for row in rows if row["environment"] == name]
        for method in dict.fromkeys(row["method"] for row in own):
            points = sorted(
                (row["steps"], row["microseconds"], row["median"]) for row in own if row["method"] == method
            )
            _, xs, ys = zip(*points, strict=True)
            axes.plot(xs, ys, "o-", color=COLORS.get(method, INK), markersize=3, linewidth=1.2)
        for row in own:
            if row["default"]:
                axes.plot(row["microseconds"], row["median"], "*", color="k", markersize=9, zorder=5)
    strip = BELOW / tall
    _name_methods(figure, list(dict.fromkeys(row["method"] for row in rows)))
    figure.text(0.5, 0.75 * strip, "µs of one core a step, 64 copies", fontsize=SMALL, ha="center", color=INK)
    figure.text(
        0.012, 0.5 + strip / 2, "error of a control period / size of the body", fontsize=SMALL, va="center",
        rotation=90, color=INK,
    )  # fmt: skip
    path.parent.mkdir(parents=True, exist_ok=True)
    save(figure, path)


def _name_methods(figure: Figure, methods: list[str]) -> None:
    """Draw the legend below the panels: the colour of each method, and the star of the default."""
    from matplotlib.lines import Line2D

    signs = [(name.replace("_", " "), "o", 3, COLORS.get(name, INK)) for name in methods]
    handles = [
        Line2D([], [], marker=mark, markersize=size, color=color, label=label, linewidth=1.2 * (mark == "o"))
        for label, mark, size, color in [*signs, ("default", "*", 9, "k")]
    ]
    figure.legend(
        handles=handles, loc="lower center", ncols=len(handles), frameon=False, fontsize=SMALL, labelcolor=INK
    )
