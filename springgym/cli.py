"""The command ``springgym``: a table of subcommands, each in a module of its own.

A module offers ``add_arguments(parser)`` and ``run(args)``, which returns the exit status. It is
imported when its command is given, and not before.
"""

from __future__ import annotations

import argparse
import importlib
import io
import os
import sys
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path

from gymnasium.error import DependencyNotInstalled

from springgym import scripts
from springgym.extras import install

COMMANDS = {
    "simulate": ("springgym.simulating", "scenes", "run a scene; plot it, film it, hold it against theory"),
    "view": ("springgym.view", "view", "turn, play and change a scene or an episode in the browser"),
    "model": ("springgym.modelling", "scenes", "find the cheapest model of a top that is true enough"),
    "compile": ("springgym.precompiling", "", "compile environments ahead of their first step"),
    "bench": ("springgym.bench", "bench", "measure the speed on this machine"),
    "accuracy": ("springgym.accuracy", "accuracy", "measure error against cost of every integrator"),
    "hard-cases": ("springgym.accuracy.hard_cases", "accuracy", "run the cases where simulators break"),
}
"""Name of each subcommand, its module, the extra that holds what it needs, and a line of help."""

SCRIPTS = {
    "train": "train an agent, compare it with baselines and film it",
    "evaluate": "compare agents on the same held-out episodes",
    "watch": "watch an agent in a window, in the browser or as a film",
}
"""Subcommands that run the script of their name in ``agents/`` and need that extra, and a line of help."""

MENDABLE = (
    *(ValueError, KeyError, OSError, ArithmeticError, MemoryError, ImportError),
    DependencyNotInstalled,
)
"""Errors that a user can correct. The commands report them in one line."""

WRONG_USE = 2
INTERRUPTED = 130
NO_READER = 141
"""Exit statuses; the last two are those of Ctrl-C and of a closed pipe, 128 and the number of the signal."""


def main(argv: Sequence[str] | None = None) -> int:
    """Run a command line and return its exit status, see `guarded`."""
    arguments = list(sys.argv[1:] if argv is None else argv)
    name = arguments[0] if arguments else ""

    def run() -> int:
        if name in SCRIPTS:
            return scripts.run(name, arguments[1:])
        args = _parser(name).parse_args(arguments)
        return int(importlib.import_module(COMMANDS[args.command][0]).run(args))

    extra = "agents" if name in SCRIPTS else COMMANDS[name][1] if name in COMMANDS else ""
    return guarded("springgym", run, extra=extra)


def guarded(
    program: str,
    action: Callable[[], int],
    mendable: tuple[type[Exception], ...] = MENDABLE,
    extra: str = "",
) -> int:
    """Do what a command is to do, and return its exit status.

    What the user can mend (a wrong argument or file, a package that is missing, a simulation that
    diverges) is told in one line on stderr, with status 2; Ctrl-C gives 130, an output that is read no
    further 141.

    Parameters
    ----------
    program
        What the line begins with.
    action
        Returns the status, if nothing goes wrong.
    mendable
        The errors that are told in a line; others are faults of the program, with a traceback.
    extra
        What holds the packages that the command needs, of `springgym[...]`.
    """
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper):  # a Greek letter that it lacks becomes a question mark
            stream.reconfigure(errors="replace")
    try:
        status = action()
        sys.stdout.flush()
        return status
    except BrokenPipeError:
        _give_up_stdout()
        return NO_READER
    except mendable as error:
        _give_up_stdout()
        print(f"{program}: error: {_told(error, extra)}", file=sys.stderr)
        return WRONG_USE
    except KeyboardInterrupt:
        print(f"{program}: interrupted", file=sys.stderr)
        return INTERRUPTED


def _told(error: Exception, extra: str) -> str:
    """An error in a line."""
    message: object = error.args[0] if isinstance(error, KeyError) and error.args else error
    if isinstance(error, ModuleNotFoundError) and extra:
        message = f"{error}: {install(extra)}"
    if isinstance(error, MemoryError):
        message = str(error) or "not enough memory"
    return " ".join(str(message).split()) or type(error).__name__


def _give_up_stdout() -> None:
    """Drop what cannot be written, on a full disk or where nobody reads: Python would try again at exit."""
    try:
        sys.stdout.flush()
    except OSError:
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())


@contextmanager
def whole_file(path: Path) -> Iterator[Path]:
    """Another name to write a file under: it takes its own once it is whole and on the disk, or goes.

    Whenever the program is ended, there is the old file or the new one. What is no file, as a device or a
    pipe, is written to; a link stays one.
    """
    place = path.resolve()
    temporary = place.with_name(f"{place.stem}.tmp{place.suffix}")
    try:
        if place.exists() and not place.is_file():
            yield path
            return
        yield temporary
        with temporary.open("rb+") as file:  # Windows syncs what may be written
            os.fsync(file.fileno())
        os.replace(temporary, place)
    except OSError as error:
        raise OSError(f"{path}: {error.strerror or error}") from error
    finally:
        temporary.unlink(missing_ok=True)


def _parser(given: str) -> argparse.ArgumentParser:
    """The parser of all commands, with the options of the one that is given."""
    parser = argparse.ArgumentParser(
        prog="springgym", description="Mass-spring bodies: agents, simulation, speed, accuracy."
    )
    commands = parser.add_subparsers(dest="command", metavar="command", required=True)
    for name, line in SCRIPTS.items():
        commands.add_parser(name, help=line, add_help=False)  # the script reads its arguments
    for name, (module, _, line) in COMMANDS.items():
        command = commands.add_parser(name, help=line, description=line[0].upper() + line[1:] + ".")
        if name == given:
            importlib.import_module(module).add_arguments(command)
    return parser


if __name__ == "__main__":
    sys.exit(main())
