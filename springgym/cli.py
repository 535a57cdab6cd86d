"""The command ``springgym``: a table of subcommands, each in a module of its own.

A module offers ``add_arguments(parser)`` and ``run(args)``, which returns the exit status. It is
imported when its command is given, and not before.
"""

from __future__ import annotations

import argparse
import importlib
import io
import sys
from collections.abc import Sequence

from gymnasium.error import DependencyNotInstalled

COMMANDS = {
    "simulate": ("springgym.simulate", "scenes", "run a scene; plot it, film it, hold it against theory"),
    "model": ("springgym.modelling", "scenes", "find the cheapest model of a top that is true enough"),
    "bench": ("springgym.bench", "bench", "measure the speed on this machine"),
    "accuracy": ("springgym.accuracy", "accuracy", "measure error against cost of every integrator"),
    "hard-cases": ("springgym.accuracy.hard_cases", "accuracy", "run the cases where simulators break"),
}
"""Name of each subcommand, its module, the extra that holds what it needs, and a line of help."""

MENDABLE = (
    *(ValueError, KeyError, OSError, ArithmeticError, MemoryError, ImportError),
    DependencyNotInstalled,
)
"""What is told in a line: the user can mend it."""

WRONG_USE = 2
INTERRUPTED = 130


def main(argv: Sequence[str] | None = None) -> int:
    """Run a command line and return its exit status.

    What the user can mend (a wrong argument or file, a package that is missing, a simulation that
    diverges) is told in one line on stderr, with status 2; Ctrl-C gives 130.
    """
    arguments = list(sys.argv[1:] if argv is None else argv)
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper):  # a Greek letter that it lacks becomes a question mark
            stream.reconfigure(errors="replace")
    try:
        parser = _parser(arguments[0] if arguments else "")
        args = parser.parse_args(arguments)
        return int(importlib.import_module(COMMANDS[args.command][0]).run(args))
    except MENDABLE as error:
        message = error.args[0] if isinstance(error, KeyError) else error
        if isinstance(error, ModuleNotFoundError):
            message = f"{error}: pip install springgym[{COMMANDS[arguments[0]][1]}]"
        print(f"springgym: error: {message}", file=sys.stderr)
        return WRONG_USE
    except KeyboardInterrupt:
        print("springgym: interrupted", file=sys.stderr)
        return INTERRUPTED


def _parser(given: str) -> argparse.ArgumentParser:
    """The parser of all commands, with the options of the one that is given."""
    parser = argparse.ArgumentParser(
        prog="springgym", description="Mass-spring bodies: simulation, speed, accuracy."
    )
    commands = parser.add_subparsers(dest="command", metavar="command", required=True)
    for name, (module, _, line) in COMMANDS.items():
        command = commands.add_parser(name, help=line, description=line[0].upper() + line[1:] + ".")
        if name == given:
            importlib.import_module(module).add_arguments(command)
    return parser


if __name__ == "__main__":
    sys.exit(main())
