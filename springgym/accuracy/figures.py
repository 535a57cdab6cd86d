"""The figures of ``springgym accuracy``. Needs Matplotlib."""

from __future__ import annotations

from pathlib import Path
from typing import Any


def draw(name: str, result: dict[str, Any], path: Path) -> None:
    """Draw a result of `springgym.accuracy.work_precision.measure`, or of a study, to a file."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    figure = Figure(figsize=(7.2, 4.6), layout="constrained")
    FigureCanvasAgg(figure)
    axes = figure.add_subplot()
    if result["kind"] == "spin-down":
        _spin_down(axes, result)
    elif result["kind"] == "rigid gap":
        _rigid_gap(axes, result)
    elif result["kind"] == "crossover":
        _crossover(axes, result)
    else:
        _work_precision(axes, result)
    axes.set_title(f"{name}: {result.get('what', result['kind'])}", fontsize=10)
    axes.grid(alpha=0.25, linewidth=0.6)
    axes.legend(fontsize=7, loc="center left", bbox_to_anchor=(1.0, 0.5), frameon=False)
    measured = result["measured"]
    figure.supxlabel(f"{measured['cpu']}, {measured['date']}", fontsize=6, x=0.99, ha="right")
    figure.savefig(path, metadata={"Date": None})


def _methods(result: dict[str, Any]) -> dict[str, list[dict[str, Any]]]:
    methods: dict[str, list[dict[str, Any]]] = {}
    for row in result["rows"]:
        methods.setdefault(row["method"], []).append(row)
    return methods


def _work_precision(axes: Any, result: dict[str, Any]) -> None:
    """Error over cost; failures as crosses at the top edge; the default starred, the model error dashed."""
    methods = _methods(result)
    for n, (name, rows) in enumerate(methods.items()):
        colour, dash = f"C{n % 10}", ":" if name.startswith(("MuJoCo", "SciPy")) else "-"
        good = [row for row in rows if row["error"] is not None]
        axes.plot(
            [row["cost"] for row in good],
            [max(row["error"], 1e-14) for row in good],
            dash,
            marker=".",
            color=colour,
            label=name.replace("_", " "),
            linewidth=1,
        )
        for row in rows:
            if row["error"] is None:
                axes.plot(row["cost"], 0.2, "x", color=colour, markersize=4)
    if "default" in result:
        step = result["default"]["step"]
        row = min(methods["verlet"], key=lambda row: abs(row["step"] - step))
        if row["error"] is not None and abs(row["step"] / step - 1) < 0.01:
            axes.plot(
                row["cost"],
                row["error"],
                "*",
                color="k",
                markersize=11,
                zorder=5,
                label="default method and step",
            )
    if "model" in result:
        axes.axhline(
            result["model"]["errors"][0], color="k", linestyle="--", linewidth=0.8, label="model error"
        )
    axes.set(xscale="log", yscale="log", xlabel="µs per simulated second", ylabel="error / size of the body")


def _spin_down(axes: Any, result: dict[str, Any]) -> None:
    for curve in result["curves"]:
        theory = curve["method"].startswith("theory")
        axes.plot(
            curve["times"],
            curve["spins"],
            "k--" if theory else "-",
            linewidth=0.8 if theory else 1.4,
            label=f"{curve['method'].replace('_', ' ')}, {1e3 * curve['step']:g} ms",
        )
    axes.set(xlabel="t [s]", ylabel="spin / spin at the start", ylim=(0, 1.05))


def _rigid_gap(axes: Any, result: dict[str, Any]) -> None:
    for name, gaps in result["gaps"].items():
        label = f"{name}: power {result['powers'][name]:.3f}"
        axes.plot(result["stiffness"], gaps, "o-", label=label)
    axes.set(xscale="log", yscale="log", xlabel="stiffness [N/m]", ylabel="gap to rigid theory / size")


def _crossover(axes: Any, result: dict[str, Any]) -> None:
    for n, (name, found) in enumerate(result["bodies"].items()):
        for kind, dash in (("explicit", "-"), ("implicit", "--")):
            rows = [row for row in found["rows"] if row[kind]]
            label = f"{name}, {'verlet' if kind == 'explicit' else 'best implicit'}"
            costs = [row[kind]["cost"] for row in rows]
            axes.plot([row["stiffness"] for row in rows], costs, dash, marker=".", color=f"C{n}", label=label)
    axes.set(
        xscale="log",
        yscale="log",
        xlabel="stiffness [N/m]",
        ylabel=f"µs per simulated second to an error of {result['tolerance']:g}",
    )
