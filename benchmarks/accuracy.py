"""Error against cost of every integrator: ``python -m benchmarks.accuracy``.

=================  ====================================================================
`problems`         scenes, with the results of rigid theory
`work_precision`   every method on every problem, over a ladder of steps
`studies`          spin-down, rigid gap, crossover stiffness, rigid twin
`peers`            MuJoCo and SciPy on the same scenes
`figures`          the figures
=================  ====================================================================
"""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from benchmarks.conditions import conditions
from benchmarks.problems import PROBLEMS
from benchmarks.studies import STUDIES
from benchmarks.work_precision import TOLERANCES, cheapest, measure
from springgym.cli import check_new, guarded, significant, write_text

REPORT = "accuracy.json"


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command, and return its exit status."""
    parser = argparse.ArgumentParser(
        "benchmarks.accuracy", description="Measure error against cost of every integrator."
    )
    parser.add_argument(
        "problems",
        nargs="*",
        metavar="PROBLEM",
        help=f"any of {', '.join([*PROBLEMS, *STUDIES])}; default: all",
    )
    parser.add_argument("--quick", action="store_true", help="fewer steps, and 5 timed runs instead of 20")
    parser.add_argument("--no-peers", action="store_true", help="do not measure MuJoCo and SciPy")
    parser.add_argument("--out", type=Path, default=Path("accuracy"), help=f"folder of {REPORT} and figures")
    args = parser.parse_args(arguments)
    return guarded(parser.prog, lambda: run(args), extra="bench")


def run(args: argparse.Namespace) -> int:
    """Measure, print, and write a report and figures.

    Raises
    ------
    ValueError
        If there is no problem of a name.
    """
    names = args.problems or [*PROBLEMS, *STUDIES]
    for name in names:
        if name not in PROBLEMS and name not in STUDIES:
            raise ValueError(f"unknown problem {name!r}; there are {', '.join([*PROBLEMS, *STUDIES])}")
    args.out.mkdir(parents=True, exist_ok=True)
    path = args.out / REPORT
    check_new(path)
    report = _report_so_far(path)
    for name in names:
        result = (
            STUDIES[name](args.quick) if name in STUDIES else measure(name, args.quick, not args.no_peers)
        )
        report[name] = result | {"measured": conditions()}
        write_text(path, json.dumps(report, indent=1) + "\n")
        print("\n".join(summary(name, result)), flush=True)
    print(table(report))
    from benchmarks.figures import draw_accuracy

    for name in names:
        draw_accuracy(name, report[name], args.out / f"{name}.svg")
    return 0


def _report_so_far(path: Path) -> dict[str, Any]:
    if not path.exists():
        return {}
    try:
        report = json.loads(path.read_text(encoding="utf-8"))
    except ValueError as error:
        raise ValueError(f"{path}: cannot add to this report: {error}") from error
    if not isinstance(report, dict):
        raise ValueError(f"{path}: cannot add to this report: it must hold an object")
    return report


def summary(name: str, result: dict[str, Any]) -> list[str]:
    """Return the lines that report a result."""
    lines = [f"{name}: {result['kind']}"]
    if "agreement" in result:
        lines.append(f"  reference: {result['reference']}, which agree to {result['agreement']:.1e}")
    if "model" in result:
        model = result["model"]
        lines.append(f"  model error {model['errors'][0]:.2e} at k, ∝ k^{model['power']:.3f}")
    if "rows" in result:
        for tolerance in TOLERANCES:
            lines.append(f"  {tolerance:.0e}: {told(cheapest(result, tolerance))}")
    if result["kind"] == "spin-down":
        first, second = result["theory_errors"]
        lines.append(f"  implicit_euler within {first:.1e} of theory at 0.5 ms, {second:.1e} at 10 ms")
        for curve in result["curves"]:
            if "growth" in curve:
                lines.append(
                    f"  {curve['method']}, h = {curve['step']:g} s: "
                    f"spin × {curve['spins'][24]:.3f} after 1 s, "
                    f"size × {curve['growth']:.4f} after 2 s"
                )
    for body, power in result.get("powers", {}).items():
        lines.append(f"  {body}: gap ∝ k^{power:.3f}, {result['gaps'][body][0]:.1e} at k = 1e5")
    for body, found in result.get("bodies", {}).items():
        lines.append(f"  {body}: implicit pays from k = {found['crossover'] or float('inf'):.1e} N/m")
    return lines


def table(report: dict[str, Any]) -> str:
    """Write the cheapest method of each problem at each tolerance as Markdown, and how much verlet costs."""
    heads = " | ".join(f"{tolerance:.0e}" for tolerance in TOLERANCES)
    lines = [f"| problem | {heads} |", "|---" * (1 + len(TOLERANCES)) + "|"]
    for name in PROBLEMS:
        cells = [name]
        for tolerance in TOLERANCES:
            best = cheapest(report.get(name, {"rows": []}), tolerance)
            if best is None:
                cells.append("none")
                continue
            cell = f"{best['method']}, {significant(best['cost'], 3)} µs"
            verlet = cheapest(report[name], tolerance, among="verlet")
            if verlet and verlet is not best:
                cell += f" (verlet × {verlet['cost'] / best['cost']:.1f})"
            elif not verlet:
                cell += " (verlet: none)"
            cells.append(cell)
        if name in report:
            lines.append(f"| {' | '.join(cells)} |")
    return "\n".join(lines)


def told(row: dict[str, Any] | None) -> str:
    """Describe a row in words."""
    if row is None:
        return "none"
    low, high = row["cost_quartiles"]
    return (
        f"{row['method']}, {row['step']:.3g}: error {row['error']:.1e}, "
        f"{row['cost']:.4g} ({low:.4g} … {high:.4g}) µs/s, {row['evaluations']:.4g} evaluations/s"
    )


if __name__ == "__main__":
    sys.exit(main())
