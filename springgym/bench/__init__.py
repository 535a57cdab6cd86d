"""``springgym bench``: how fast it is on this machine, beside what else is installed."""

from __future__ import annotations

import argparse
import json
from pathlib import Path
from typing import Any

from springgym.accuracy import conditions


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the options."""
    parser.add_argument(
        "--only",
        nargs="+",
        metavar="SECTION",
        help="kernel, environments, features, startup, peers, equal-error, sizes",
    )
    parser.add_argument("--rounds", type=int, default=21, help="rounds that medians are taken over (21)")
    parser.add_argument("--out", type=Path, help="write the results to this JSON file")
    parser.add_argument("--figure", type=Path, help="draw peers and sizes to this file (needs matplotlib)")


def run(args: argparse.Namespace) -> int:
    """Measure, print, and write JSON."""
    from springgym.bench.sections import SECTIONS, ratios

    names = args.only or list(SECTIONS)
    if unknown := [name for name in names if name not in SECTIONS]:
        raise ValueError(f"there is no section {unknown[0]!r}; there are {', '.join(SECTIONS)}")
    report: dict[str, Any] = {"conditions": conditions()}
    print(json.dumps(report["conditions"]))
    for name in names:
        print(f"\n{name}: {SECTIONS[name].__doc__}\n", flush=True)
        report[name] = SECTIONS[name](args.rounds)
        for what, found in report[name].items():
            print(f"  {what:48}{told(found)}", flush=True)
    report["ratios"] = ratios(report)
    if report["ratios"]:
        print("\nratios\n")
        for what, ratio in report["ratios"].items():
            print(f"  {what:56}{ratio:8.2f}")
    if args.out:
        args.out.parent.mkdir(parents=True, exist_ok=True)
        args.out.write_text(json.dumps(report, indent=1) + "\n")
    if args.figure:
        from springgym.bench.figures import draw

        draw(report, args.figure)
    return 0


def told(found: Any) -> str:
    """A rate, or seconds, with its spread."""
    if isinstance(found, dict):
        return f"{found['median']:9.2f} s   ({found['low']:.2f} … {found['high']:.2f})"
    middle, low, high = found
    return f"{middle:14,.0f} /s ({low:,.0f} … {high:,.0f})"
