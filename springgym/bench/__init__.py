"""``springgym bench``: measure speed and error on this machine, and compare with other programs.

================  ====================================================================
`sections`        the measurements: functions that return rows
`environments`    environment steps, also through Stable-Baselines3
`errors`          the error of an environment step
`curves`          error against cost of every environment
`problem`         the paper's top, and the distance of a program from its exact motion
`peers`           C++, MuJoCo, JAX and SciPy on the same top
`timing`          cases, measured in turn
`ratios`          the comparisons that matter
`figures`         the figure
================  ====================================================================
"""

from __future__ import annotations

import argparse
import inspect
import json
import time
from pathlib import Path
from typing import Any

from springgym.accuracy import conditions
from springgym.cli import check_ending, whole_file

NAMES = (
    *("kernel", "environments", "errors", "curves", "features", "startup", "peers", "equal-error"),
    "sizes",
)
"""Names of the sections, available without importing them."""

FIGURES = (".svg", ".png", ".pdf")
"""The file name endings of the formats in which the figure can be drawn."""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the options."""
    parser.add_argument(
        "--only",
        nargs="+",
        choices=NAMES,
        metavar="SECTION",
        help=f"sections to measure (default: all), out of {', '.join(NAMES)}",
    )
    parser.add_argument("--rounds", type=int, default=21, help="rounds for each median (default: 21)")
    parser.add_argument("--quick", action="store_true", help="3 rounds")
    parser.add_argument("--out", type=Path, help="write the results to this JSON file, see docs/speed.md")
    parser.add_argument(
        "--figure", type=Path, help="draw peers and sizes to this file, .svg, .png or .pdf (needs matplotlib)"
    )


def measure(name: str, rounds: int) -> dict[str, Any]:
    """Measure a section, print its rows, and give them for JSON."""
    from springgym.bench.sections import SECTIONS

    what = inspect.cleandoc(SECTIONS[name].__doc__ or "")
    print(f"\n{name}: {what}\n", flush=True)
    started = time.perf_counter()
    rows = SECTIONS[name](rounds)
    print("\n".join(f"  {row}" for row in rows))
    took = time.perf_counter() - started
    print(f"  (took {took:.0f} s)", flush=True)
    return {"what": what, "rounds": rounds, "took": took, "rows": [row.flat() for row in rows]}


def run(args: argparse.Namespace) -> int:
    """Measure, print, and write JSON."""
    from springgym.bench.ratios import ratios

    if args.rounds < 1:
        raise ValueError(f"--rounds {args.rounds}: it must be at least 1")
    _check_files(args)
    report: dict[str, Any] = {"conditions": conditions()}
    print(json.dumps(report["conditions"]))
    for name in args.only or NAMES:
        report[name] = measure(name, 3 if args.quick else args.rounds)
    report["ratios"] = ratios(report)
    print("\nratios\n")
    for what, ratio in report["ratios"].items():
        print(f"  {what:76}{ratio:8.3g}")
    if args.out:
        with whole_file(args.out) as path:
            path.write_text(json.dumps(report, indent=1, ensure_ascii=False) + "\n", encoding="utf-8")
    if args.figure:
        from springgym.bench.figures import draw

        draw(report, args.figure)
    return 0


def _check_files(args: argparse.Namespace) -> None:
    """Make the folders of files, and refuse what cannot be written, before the work is done."""
    if args.figure is not None:
        check_ending("figure", args.figure, FIGURES)
    for option in ("out", "figure"):
        path: Path | None = getattr(args, option)
        if path is not None and path.is_dir():
            raise ValueError(f"--{option} {path}: it is a folder; it must be a file")
        if path is not None:
            path.parent.mkdir(parents=True, exist_ok=True)
