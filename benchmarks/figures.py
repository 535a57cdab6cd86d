"""The figures of measurements on the site. Needs Matplotlib.

Every curve has its name beside its end. Methods of springgym are coloured, each in the same colour in all
figures; other programs are grey.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

from springgym.rendering import srgb

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

COLORS = {
    "verlet": "#2b5c96",
    "symplectic_euler": "#8fb3dd",
    "rk4": "#22966a",
    "pefrl": "#7cc49f",
    "blanes_moan": "#8048a0",
    "dopri5": "#c08bd6",
    "implicit_euler": "#be323c",
    "implicit_midpoint": "#e45e2c",
    "tr_bdf2": "#d39b2a",
    "rodas3": "#8a6a2f",
    "rigid suzuki": "#8048a0",
    "rigid kahan_li": "#22966a",
    "rigid verlet": "#2b5c96",
}
"""Implicit methods are warm, explicit ones cold."""
PEER = "#9aa3ad"
INK = "#343c4c"
PEERS = ("MuJoCo", "SciPy")
MARKS = {"MuJoCo": "s", "SciPy": "^"}
TITLES = {
    "spin-down": "the spin that implicit methods leave a free cube",
    "rigid gap": "how far bodies of springs are from rigid ones",
    "crossover": "where implicit methods begin to pay",
    "rigid twin": "the top as one rigid body",
}
"""Titles of results that carry none of their own."""
LEAST, MOST = 1e-14, 0.3
"""Errors beyond are drawn at these edges: of round-off, and where nothing is right any more."""
SMALL = 8.5
"""The smallest text [pt]: 11 pixels on a page, which shows a figure of 7.6 inches in its own size."""
APART = 0.042
"""Least distance of two names, as a share of the figure's height."""


LIGHTEST = 0.18
"""Greatest luminance of a name's colour: its contrast is 4.5 on white, and as much where a dark page
turns figures light on dark."""


class End(NamedTuple):
    """The last point of a curve, and the name that stands there."""

    x: float
    y: float
    name: str
    color: str


def readable(color: str) -> tuple[float, float, float]:
    """Return a colour, darkened as far as text needs it, see `LIGHTEST`."""
    from matplotlib.colors import to_rgb

    light = srgb.to_light(to_rgb(color))
    light *= min(1.0, LIGHTEST / max(float(light @ (0.2126, 0.7152, 0.0722)), 1e-9))
    red, green, blue = srgb.from_light(light).tolist()
    return red, green, blue


def canvas(width: float, height: float) -> Figure:
    """Return an empty figure of so many inches, without a window."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    figure = Figure(figsize=(width, height))
    FigureCanvasAgg(figure)
    return figure


def draw_accuracy(name: str, result: dict[str, Any], path: Path) -> None:
    """Draw a result of `benchmarks.work_precision.measure`, or of a study, to a file."""
    figure = canvas(7.6, 4.8)
    kinds = {"spin-down": _spin_down, "rigid gap": _rigid_gap, "crossover": _crossover}
    kinds.get(result["kind"], _work_precision)(figure, result)
    what = result.get("what") or TITLES.get(result["kind"], result["kind"])
    figure.suptitle(f"{name}: {what}", fontsize=10, x=0.1, ha="left")
    measured = result["measured"]
    figure.text(
        0.99, 0.01, f"{measured['cpu']}, {measured['date']}", fontsize=SMALL, ha="right", color=readable(PEER)
    )
    save(figure, path)


def save(figure: Figure, path: Path) -> None:
    """Write a figure: the same picture gives the same file."""
    from matplotlib import rc_context

    path.parent.mkdir(parents=True, exist_ok=True)
    with rc_context({"svg.hashsalt": "springgym"}):
        figure.savefig(path, metadata={"Date": None})


def plain(figure: Figure, left: float, bottom: float, width: float, height: float, **options: Any) -> Axes:
    """Return axes at (left, bottom, width, height) without a frame."""
    axes = figure.add_axes((left, bottom, width, height))
    axes.set(**options)
    axes.spines[["top", "right"]].set_visible(False)
    axes.grid(alpha=0.25, linewidth=0.6)
    axes.set_axisbelow(True)
    return axes


def name_ends(axes: Axes, ends: Sequence[End]) -> None:
    """Write the names of curves in a column at the right, as near to their ends as they fit."""
    axes.get_xlim(), axes.get_ylim()  # settles the limits that the curves ask for
    to_axes = axes.transAxes.inverted()
    spots = [(to_axes.transform(axes.transData.transform((end.x, end.y))), end) for end in ends]
    height = axes.get_position().height
    apart = APART / height
    heights: list[float] = []
    for (_, y), _ in sorted(spots, key=lambda spot: spot[0][1]):
        heights.append(max(y, heights[-1] + apart) if heights else max(y, 0.0))
    over = max(0.0, heights[-1] - 1.0) if heights else 0.0
    for n in range(len(heights) - 1, -1, -1):
        limit = heights[n + 1] - apart if n + 1 < len(heights) else heights[n] - over
        heights[n] = min(heights[n], limit)
    for ((x, y), end), placed in zip(sorted(spots, key=lambda spot: spot[0][1]), heights, strict=True):
        axes.annotate(
            end.name,
            (x, y),
            (1.03, placed),
            xycoords="axes fraction",
            textcoords="axes fraction",
            va="center",
            fontsize=SMALL,
            color=readable(end.color),
            arrowprops={"arrowstyle": "-", "color": end.color, "alpha": 0.35, "linewidth": 0.6, "shrinkB": 2},
            annotation_clip=False,
        )


def _methods(result: dict[str, Any]) -> dict[str, list[dict[str, Any]]]:
    methods: dict[str, list[dict[str, Any]]] = {}
    for row in result["rows"]:
        methods.setdefault(row["method"], []).append(row)
    return methods


def _work_precision(figure: Figure, result: dict[str, Any]) -> None:
    """Draw error over cost: failed steps as crosses at the top, the default starred, the model dashed."""
    per_period = "local error" in result["kind"]
    axes = plain(
        figure,
        *(0.1, 0.14, 0.63, 0.76),
        xscale="log",
        yscale="log",
        xlabel="µs of one core per simulated second",
        ylabel="error / size of the body" + (", of a control period" if per_period else ""),
    )
    methods = _methods(result)
    ends = []
    for name, rows in sorted(methods.items(), key=lambda item: not item[0].startswith(PEERS)):
        peer = next((program for program in PEERS if name.startswith(program)), None)
        color = PEER if peer else COLORS.get(name, INK)
        good = [row for row in rows if row["error"] is not None and row["error"] < MOST]
        costs = [row["cost"] for row in good]
        errors = [max(row["error"], LEAST) for row in good]
        axes.plot(
            costs,
            errors,
            ":" if peer else "-",
            marker=MARKS.get(peer or "", "o"),
            markersize=3,
            color=color,
            linewidth=1 if peer else 1.3,
            zorder=1 if peer else 2,
        )
        failed = [row["cost"] for row in rows if row["error"] is None or row["error"] >= MOST]
        axes.plot(failed, [MOST] * len(failed), "x", color=color, markersize=4, clip_on=False)
        if good:
            last = max(good, key=lambda row: row["cost"])
            ends.append(End(last["cost"], max(last["error"], LEAST), name.replace("_", " "), color))
    if any(row["error"] is None or row["error"] >= MOST for rows in methods.values() for row in rows):
        axes.annotate(
            "× fails", (0, MOST), (4, 4), xycoords=("axes fraction", "data"), textcoords="offset points",
            fontsize=SMALL, color=INK,
        )  # fmt: skip
    if "default" in result:
        step = result["default"]["step"]
        row = min(methods["verlet"], key=lambda row: abs(row["step"] - step))
        if row["error"] is not None and abs(row["step"] / step - 1) < 0.01:
            axes.plot(row["cost"], row["error"], "*", color="k", markersize=11, zorder=5)
            axes.annotate(
                "default", (row["cost"], row["error"]), (-7, -9), textcoords="offset points", fontsize=SMALL,
                ha="right",
            )  # fmt: skip
    if "model" in result:
        error = result["model"]["errors"][0]
        axes.axhline(error, color="k", linestyle="--", linewidth=0.8)
        axes.annotate(
            "model error: springs beside a rigid body", (0.99, error), (0, 3),
            xycoords=("axes fraction", "data"), textcoords="offset points", fontsize=SMALL, ha="right",
        )  # fmt: skip
    low = min((max(row["error"], LEAST) for row in result["rows"] if row["error"]), default=LEAST)
    high = max((row["error"] or MOST for row in result["rows"]), default=MOST)
    axes.set_ylim(0.4 * low, min(3 * high, MOST))
    name_ends(axes, ends)


def _spin_down(figure: Figure, result: dict[str, Any]) -> None:
    """Draw the spin that implicit methods leave, a panel for each step; cut and name those that fly off."""
    steps = sorted({curve["step"] for curve in result["curves"]})
    for n, step in enumerate(steps):
        axes = plain(
            figure,
            *(0.1 + 0.47 * n, 0.14, 0.24, 0.7),
            xlabel="t [s]",
            ylabel="spin / spin at the start" if n == 0 else "",
            ylim=(0, 1.06),
        )
        axes.set_title(f"step {1e3 * step:g} ms", fontsize=9, loc="left")
        ends = []
        for curve in (curve for curve in result["curves"] if curve["step"] == step):
            times = curve["times"]
            spins = curve["spins"]
            name = curve["method"].replace("_", " ")
            theory = name.startswith("theory")
            color = "k" if theory else COLORS[curve["method"]]
            wild = next((k for k, spin in enumerate(spins) if not 0 <= spin <= 1.06), None)
            axes.plot(
                times[:wild], spins[:wild], "--" if theory else "-", color=color,
                linewidth=0.9 if theory else 1.5, zorder=3 if theory else 2,
            )  # fmt: skip
            if wild is not None:
                axes.plot(times[wild], 1.06, "x", color=color, clip_on=False)
                name = f"{name} (fails)"
                ends.append(End(times[-1], 1.06, name, color))
            elif not theory:
                ends.append(End(times[-1], spins[-1], name, color))
            else:
                ends.append(End(times[-1], spins[-1], "its theory", color))
        axes.set_xlim(0, max(result["curves"][0]["times"]))
        name_ends(axes, ends)


def _against_stiffness(figure: Figure, ylabel: str) -> Axes:
    return plain(
        figure, *(0.1, 0.14, 0.63, 0.76), xscale="log", yscale="log", xlabel="stiffness [N/m]", ylabel=ylabel
    )


def _rigid_gap(figure: Figure, result: dict[str, Any]) -> None:
    axes = _against_stiffness(figure, "gap to rigid theory / size")
    ends = []
    for (name, gaps), color in zip(result["gaps"].items(), COLORS.values(), strict=False):
        axes.plot(result["stiffness"], gaps, "o-", color=color)
        power = f"{name}, power {result['powers'][name]:.3f}".replace("-1", "−1")
        ends.append(End(result["stiffness"][-1], gaps[-1], power, color))
    name_ends(axes, ends)


def _crossover(figure: Figure, result: dict[str, Any]) -> None:
    axes = _against_stiffness(figure, f"µs per simulated second to an error of {result['tolerance']:g}")
    ends = []
    for (name, found), dash in zip(result["bodies"].items(), ("-", "--", ":", "-."), strict=False):
        for kind, color in (("explicit", COLORS["verlet"]), ("implicit", COLORS["implicit_euler"])):
            rows = [row for row in found["rows"] if row[kind]]
            costs = [row[kind]["cost"] for row in rows]
            axes.plot([row["stiffness"] for row in rows], costs, dash, marker=".", color=color)
            if rows:
                label = f"{name}, {'verlet' if kind == 'explicit' else 'best implicit'}"
                ends.append(End(rows[-1]["stiffness"], costs[-1], label, color))
    name_ends(axes, ends)


# --- Speed --------------------------------------------------------------------------------------------

OURS = "#2b5c96"


def draw_speed(report: dict[str, Any], path: Path) -> None:
    """Draw peers as dots and size against cost, of whatever was measured."""
    figure = canvas(7.6, 8.4)
    rows = [row for row in report.get("peers", {}).get("rows", ()) if row["precision"] == "float64"]
    _peers(plain(figure, 0.3, 0.55, 0.66, 0.41), rows)
    _sizes(plain(figure, 0.1, 0.06, 0.54, 0.38), report.get("sizes", {}).get("rows", ()))
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


class Bar(NamedTuple):
    """A bar of a chart, with its interval."""

    name: str
    value: float
    low: float
    high: float
    color: str


def draw_bars(panels: Mapping[str, Sequence[Bar]], label: str, path: Path) -> None:
    """Draw a panel of bars with intervals for each title, from 0 to 100, on a figure as wide as a phone."""
    lines = [len(bars) for bars in panels.values()]
    tall = 0.3 * sum(lines) + 0.45 * len(panels) + 0.55
    figure = canvas(4.8, tall)
    top = tall
    for title, bars in panels.items():
        height = 0.3 * len(bars)
        top -= 0.4 + height
        axes = plain(
            figure, 0.13, top / tall, 0.81, height / tall, xlim=(min(0.0, *(b.low for b in bars)), 105)
        )
        for line, bar in enumerate(reversed(bars)):
            axes.barh(line, bar.value, 0.62, color=bar.color)
            axes.plot([bar.low, bar.high], [line, line], color=INK, linewidth=2)
            told = f"{bar.value:.0f} %"
            axes.annotate(told, (bar.high, line), (5, 0), textcoords="offset points", va="center", color=INK)
        axes.axvline(100, color=INK, linestyle="--", linewidth=1)
        axes.set_xticks(range(0, 101, 20))
        axes.set_yticks(range(len(bars)), [bar.name for bar in reversed(bars)])
        axes.tick_params(axis="y", length=0)
        axes.grid(visible=False, axis="y")
        axes.set_title(title, fontsize=10, loc="left")
        axes.tick_params(labelbottom=False)
    axes.tick_params(labelbottom=True)
    figure.text(0.13, 0.02, label, fontsize=SMALL + 0.5, color=INK)
    save(figure, path)


ACROSS = 3
"""Environments side by side."""
PANEL, BELOW = 1.75, 0.55
"""Height of a panel, and of the strip below all panels that names axis and methods [inch]."""


def draw_curves(rows: list[dict[str, Any]], path: Path) -> None:
    """Draw error against cost, a panel for each environment; the default is a star."""
    names = list(dict.fromkeys(row["environment"] for row in rows))
    down = -(-len(names) // ACROSS)
    tall = PANEL * down + BELOW
    figure = canvas(7.6, tall)
    width = 0.9 / ACROSS
    height = PANEL / tall
    costs = [row["microseconds"] for row in rows]
    errors = [row["median"] for row in rows]
    for n, name in enumerate(names):
        left = 0.085 + width * (n % ACROSS)
        top = 1 - 0.02 / down - height * (n // ACROSS)
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
