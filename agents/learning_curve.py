"""The figure of an agent's learning curve."""

from __future__ import annotations

import csv
from collections.abc import Sequence

import matplotlib
from evaluate import Evaluation
from runs import Run

from springgym.cli import whole_file

matplotlib.use("Agg")
from matplotlib import pyplot as plt
from matplotlib.ticker import EngFormatter


def plot_learning_curve(run: Run, end: int, evaluations: Sequence[Evaluation]) -> None:
    """Draw metrics.csv, and what the agent after ``end`` steps and the baselines reach, as a PNG."""
    with open(run.folder / "metrics.csv", newline="") as file:
        rows = list(csv.DictReader(file))
    progress: list[dict[str, str]] = []
    if (run.folder / "progress.csv").exists():
        with open(run.folder / "progress.csv", newline="") as file:
            progress = list(csv.DictReader(file))

    def curve(column: str, scale: float = 1.0) -> tuple[list[int], list[float]]:
        given = [row for row in rows if row[column]]
        return (
            [int(row["timesteps"]) for row in given],
            [scale * float(row[column]) for row in given],
        )

    trained, *baselines = evaluations
    figure, (top, bottom) = plt.subplots(
        2, 1, figsize=(7, 6), sharex=True, layout="constrained", height_ratios=(3, 2)
    )
    top.plot(*curve("reward_per_step"), color="0.6", lw=1, label="training steps")
    top.plot(*curve("return_per_step"), color="C0", lw=2, label="last 100 training episodes")
    top.plot(end, trained.return_per_step, "o", color="k", clip_on=False, label="trained agent")
    for i, baseline in enumerate(baselines, start=1):
        top.axhline(baseline.return_per_step, color=f"C{i}", ls="--", label=baseline.agent)
    top.set(ylabel="return per step", title=f"{run.env_id}, {run.algo.upper()}, seed {run.seed}")
    for axes, column, scale in (
        (top, "return_per_step", 1.0),
        (bottom, "success_rate", 100.0),
    ):
        if any(row[column] for row in progress):
            steps = [int(row["timesteps"]) for row in progress]
            reached = [scale * float(row[column]) for row in progress]
            axes.plot(steps, reached, "k.-", label="evaluation, without exploration")
    top.legend()
    bottom.plot(*curve("success_rate", 100), color="C0", lw=2)
    if trained.success_rate is not None:
        bottom.plot(end, 100 * trained.success_rate, "o", color="k", clip_on=False)
    bottom.set(xlabel="environment steps", ylabel="success, %", xlim=(0, None), ylim=(-5, 105))
    bottom.xaxis.set_major_formatter(EngFormatter())
    for axes in (top, bottom):
        axes.grid(alpha=0.3)
    with whole_file(run.folder / "learning_curve.png") as path:
        figure.savefig(path, dpi=120)
    plt.close(figure)
