"""``springgym simulate``: simulate a scene, write its states, plot it, film it, compare it with theory."""

from __future__ import annotations

import argparse
import csv
import sys
import textwrap
from collections.abc import Callable, Iterable, Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from springgym.checks import apart, counted, printable
from springgym.cli import INTERRUPTED, check_new, whole_file
from springgym.dynamics.contact.totals import PairReadings
from springgym.dynamics.methods import METHODS
from springgym.model.scene import MOST_LISTED
from springgym.scenes.checks import Check, check, fitting
from springgym.scenes.checks.basis import NOT_COVERED, two_figures
from springgym.scenes.plan import LEAST, Plan
from springgym.scenes.reading import document, load
from springgym.scenes.reading import names as scene_names
from springgym.scenes.recording import Progress, Recording, record
from springgym.simulator import PAPER_SETTINGS

ENERGIES = (
    *("kinetic", "gravity", "elastic", "contact"),
    *("work", "damping_loss", "contact_loss", "friction_loss"),
)
"""The energy ledger in a trace [J]."""

COLUMNS = 80
"""Width of the list of scenes [letters]."""

UNCOVERED = 3
"""Exit status if no check fails, but theory does not cover all of them."""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the options of the command."""
    parser.add_argument("scene", nargs="?", help="scene name (see --list) or YAML file")
    parser.add_argument("--list", action="store_true", help="list the scenes")
    parser.add_argument("-v", "--verbose", action="store_true", help="print all settings of the simulator")
    parser.add_argument("--duration", type=float, metavar="S", help="simulated time in seconds")
    parser.add_argument("--integrator", choices=METHODS, help="integrator, instead of the scene's")
    parser.add_argument("--step", type=float, metavar="S", help="time step in seconds")
    parser.add_argument(
        "--preset",
        choices=("default", "paper"),
        default="default",
        help="paper: the paper's settings, rk4 at 5e-4 s, with its clamp and capped friction",
    )
    parser.add_argument("--trace", type=Path, metavar="FILE", help="write all states (.npz or .csv)")
    parser.add_argument("--plot", type=Path, metavar="FILE", help="write a figure (.png, .svg or .pdf)")
    parser.add_argument("--video", type=Path, metavar="FILE", help="write a video (.mp4 or .gif)")
    parser.add_argument(
        "--check",
        action="store_true",
        help=f"compare with theory; exit with 1 on failure, {UNCOVERED} if no theory applies",
    )


def run(args: argparse.Namespace) -> int:
    """Run the command with its arguments; return the exit status."""
    if args.list:
        print("\n".join(_listed(scene_names())))
        return 0
    if args.scene is None:
        raise ValueError("no scene given: pass a scene name (see springgym simulate --list) or a YAML file")
    _check_files(args)
    writers = _writers(args)
    scene = load(args.scene)
    plan = _changed(scene, args)
    if args.check:
        fitting(plan)
    recording = record(plan, progress=_bar(plan.name))
    if not recording.complete:
        print(f"interrupted; the results end at t = {recording.times[-1]:g} s", file=sys.stderr)
    print(_summary(recording, args.verbose))
    failed = []
    for path, write in writers.items():
        try:
            with whole_file(path) as temporary:
                write(recording, temporary)
            print(f"wrote {printable(str(path))}")
        except OSError as error:  # the others may still be written
            failed.append(str(error))
    status = _report(recording, scene.duration) if args.check else 0
    if failed:
        raise OSError("; ".join(failed))
    return status if recording.complete else INTERRUPTED


def _listed(scenes: Iterable[str]) -> Iterator[str]:
    """Yield lines of at most `COLUMNS` letters with the names of scenes and their titles."""
    indent = max(map(len, scenes := list(scenes))) + 2
    for name in scenes:
        title = printable(str(document(name).at(("title",))))  # building takes a second each
        yield textwrap.fill(title, COLUMNS, initial_indent=name.ljust(indent), subsequent_indent=" " * indent)


def _writers(args: argparse.Namespace) -> dict[Path, Callable[[Recording, Path], None]]:
    """Return how each file that is asked for is written; a package that is missing raises ImportError."""
    writers: dict[Path, Callable[[Recording, Path], None]] = {}
    if args.trace:
        writers[args.trace] = save_trace
    if args.plot:
        from springgym.scenes.plots import draw

        writers[args.plot] = lambda recording, path: draw(recording).savefig(path)
    if args.video:
        from springgym.scenes.film import save_film

        writers[args.video] = lambda recording, path: save_film(recording, path, progress=_bar("film"))
    return writers


def _check_files(args: argparse.Namespace) -> None:
    """Raise ValueError for a file of the wrong kind or that cannot be written, before any work is done."""
    plots = (".png", ".svg", ".pdf")
    videos = (".mp4", ".gif")
    for option, suffixes in (("trace", (".npz", ".csv")), ("plot", plots), ("video", videos)):
        if (path := getattr(args, option)) is not None:
            check_new(path, suffixes)


def _changed(plan: Plan, args: argparse.Namespace) -> Plan:
    """Return the plan with the changes of the options."""
    for option in ("duration", "step"):
        if (seconds := getattr(args, option)) is not None and not LEAST[option] <= seconds < np.inf:
            given, least = apart(seconds, LEAST[option])
            raise ValueError(f"--{option} {given}: it must be at least {least} s, and finite")
    if args.integrator is not None and args.preset == "paper":
        raise ValueError(
            f"--integrator {args.integrator}: the paper's settings have rk4; omit one of the two options"
        )
    if args.integrator is not None:
        plan = replace(plan, integrator=args.integrator, step=None)
    if args.preset == "paper":
        plan = replace(plan, scene=plan.scene.with_(contact=plan.paper), **PAPER_SETTINGS)
    if args.duration is not None:
        plan = replace(plan, duration=args.duration)
    return plan if args.step is None else replace(plan, step=args.step)


def _bar(name: str) -> Progress:
    """Return a progress bar, shown on a terminal after a second."""

    def wrap(items: Iterable[Any]) -> Iterable[Any]:
        from tqdm import tqdm

        return tqdm(items, desc=printable(name), delay=1.0, leave=False, disable=not sys.stderr.isatty())

    return wrap


def _summary(recording: Recording, verbose: bool = False) -> str:
    """Return what a simulation consisted of, how it ended, and where its energy went."""
    plan = recording.plan
    m = recording.measures
    simulator = recording.simulator
    scene = plan.scene
    lost = float(m.damping_loss[-1] + m.contact_loss[-1] + m.friction_loss[-1])
    bodies = [counted(len(scene.bodies), "body", "bodies")] if len(scene.bodies) > 1 else []
    parts = [
        *bodies,
        counted(len(scene.masses), "particle"),
        counted(len(scene.springs), "spring"),
        recording.integrator.name,
        f"step {1e3 * recording.step:.3g} ms",
    ]
    return "\n".join(
        [
            printable(f"{plan.name}: {plan.title}"),
            ", ".join(parts),
            *([printable(str(simulator))] if verbose else []),
            f"{recording.times[-1]:g} s simulated, largest strain {m.strain.max():.3g}",
            f"energy {m.energy[0]:.6g} → {m.energy[-1]:.6g} J, lost {lost:.3g} J, "
            f"energy error {m.balance[-1] - m.balance[0]:.2g} J{_of_shadow(recording, lost)}",
            *map(printable, _between(recording)),
        ]
    )


def _between(recording: Recording) -> Iterator[str]:
    """Yield a line for each pair of bodies that touched, or one line for all if they are many."""
    scene = recording.plan.scene
    pairs = recording.pairs
    told = pairs.impulse[-1] + pairs.late_contacts[-1] + pairs.coarse_contacts[-1] + pairs.overflow[-1]
    met = np.flatnonzero(told > 0).tolist()
    if len(met) > MOST_LISTED:
        yield f"{len(met)} pairs of bodies: {_of_pairs(pairs, met)}"
        return
    for n in met:
        names = " and ".join(scene.bodies[body].name for body in scene.meetings[n][:2])
        yield f"{names}: {_of_pairs(pairs, [n])}"


def _of_pairs(pairs: PairReadings, which: list[int]) -> str:
    """Return a text with the final impulse, losses and counts of some pairs together."""
    sums = PairReadings(*(of[-1, which].sum() for of in pairs))
    wrong = {"found too late": sums.late_contacts, "coarse": sums.coarse_contacts, "left out": sums.overflow}
    counts = "".join(f", {count:.0f} {what}" for what, count in wrong.items() if count)
    lost = sums.contact_loss + sums.friction_loss
    return f"impulse {sums.impulse:.4g} N·s, lost {lost:.3g} J{counts}"


def _of_shadow(recording: Recording, lost: float) -> str:
    """Return a phrase: the drift of the shadow energy [J]; empty if that energy is not known."""
    first, last = recording.shadow
    left = last + lost - float(recording.measures.work[-1]) - first
    return "" if np.isnan(left) else f" (shadow energy drift {left:.2g} J)"


def save_trace(recording: Recording, path: Path) -> None:
    """Write times, positions, velocities and energies to a .npz (arrays) or .csv file (one row per time)."""
    energies = {name: getattr(recording.measures, name) for name in ENERGIES}
    if path.suffix.lower() == ".npz":
        scene = recording.plan.scene
        with path.open("wb") as file:  # to a path, NumPy would add a second .npz after .NPZ
            np.savez_compressed(
                file,
                times=recording.times,
                positions=recording.positions,
                velocities=recording.velocities,
                masses=scene.masses,
                springs=scene.springs,
                **{f"pairs_{name}": of for name, of in recording.pairs._asdict().items()},
                **energies,
            )
        return
    count = recording.positions.shape[1]
    names = [f"{kind}{axis}{n}" for kind in ("", "v") for n in range(count) for axis in "xyz"]
    states = (recording.positions, recording.velocities)
    columns = [recording.times[:, None], *(state.reshape(len(state), -1) for state in states)]
    rows = np.column_stack([*columns, *energies.values()])
    with path.open("w", newline="") as file:
        writer = csv.writer(file)
        writer.writerow(["time", *names, *energies])
        writer.writerows(rows.tolist())


# --- Theory beside measurement ----------------------------------------------------------------------


def _report(recording: Recording, whole: float) -> int:
    """Print the checks of a scene whose file gives a duration of ``whole`` seconds; return the exit status.

    It is 0 if all pass, 1 if one fails or the run is too short for it, and else `UNCOVERED`.
    """
    checks = check(recording)
    if not checks:
        print("this scene has no checks")
        return 0
    length = float(recording.times[-1])
    short = length < whole - recording.plan.interval
    print(table(checks, "too short" if short else "FAILED"))
    unseen = sum(bool(np.isnan(result.measured)) for result in checks)
    outside = sum(result.verdict == NOT_COVERED for result in checks)
    failed = sum(not result.passed for result in checks) - outside
    if outside:
        print(
            f"no theory applies to {outside} of {counted(len(checks), 'check')}: what theory leaves out may "
            "exceed the tolerance"
        )
    if failed and short:
        short_of = f"{failed} of {counted(len(checks), 'check')}"
        print(f"the run is too short for {short_of}: {length:g} s of {whole:g} s")
    elif failed:
        print(f"{failed} of {counted(len(checks), 'check')} failed")
    if unseen and not short:
        print(f"{unseen} of them: nothing to measure in {length:g} s; a longer run may show it (--duration)")
    return 1 if failed else UNCOVERED if outside else 0


def table(checks: list[Check], otherwise: str = "FAILED") -> str:
    """Return checks as lines of text.

    The doubt of theory is shown where it exceeds the tolerance, so that theory does not cover the run. Other
    failures are followed by ``otherwise``.
    """
    head = ("", "theory", "measured", "", "difference", "tolerance", "")
    rows = [head, *(_row(each, otherwise) for each in checks)]
    widths = [max(len(row[n]) for row in rows) for n in range(len(head))]
    return "\n".join(
        "  ".join(
            text.ljust(width) if n in (0, 3, 6) else text.rjust(width)
            for n, (text, width) in enumerate(zip(row, widths, strict=True))
        ).rstrip()
        for row in rows
    )


def _row(result: Check, otherwise: str) -> tuple[str, ...]:
    seen = not np.isnan(result.measured)
    verdict = otherwise if result.verdict == "FAILED" else result.verdict
    if verdict == NOT_COVERED:
        verdict += f", theory leaves out {two_figures(result, result.doubt)}"
    return (
        printable(result.quantity),
        f"{result.theory:.6g}",
        f"{result.measured:.6g}" if seen else "not seen",
        result.unit,
        two_figures(result, result.measured - result.theory, "+") if seen else "",
        two_figures(result, result.tolerance),
        verdict,
    )
