"""The command ``springgym``: a table of subcommands, each in a module of its own.

A module has ``add_arguments(parser)`` and ``run(args)``, which returns the exit status. It is imported only
when its command is used.
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

import springgym
from springgym import scripts
from springgym.extras import install

COMMANDS = {
    "simulate": (
        "springgym.simulate",
        "scenes",
        "simulate a scene; plot it, record a video, compare it with theory",
    ),
    "view": ("springgym.view", "view", "view and change a scene or an episode in the browser"),
    "compile": ("springgym.compile_all", "", "compile environments in advance"),
}
"""Each subcommand with its module, the extra that it needs, and a line of help."""

SCRIPTS = {
    "train": ("agents", "train an agent, compare it with baselines and record a video"),
    "evaluate": ("agents", "evaluate agents on the same held-out episodes"),
    "watch": ("render", "watch an agent in a window, in the browser or as a video"),
}
"""Subcommands that run the script of their name in ``agents/``, the extras that they need, a line of help."""

MENDABLE = (
    *(ValueError, KeyError, OSError, ArithmeticError, MemoryError, ImportError),
    DependencyNotInstalled,
)
"""Errors that a user can correct. The commands report them in one line."""

WRONG_USE = 2
INTERRUPTED = 130
NO_READER = 141
"""Exit statuses; the last two are those of Ctrl-C and of a closed pipe, 128 plus the number of the signal."""


def main(argv: Sequence[str] | None = None) -> int:
    """Run a command line and return its exit status, see `guarded`."""
    arguments = list(sys.argv[1:] if argv is None else argv)
    name = arguments[0] if arguments else ""

    def run() -> int:
        if name in SCRIPTS:
            return scripts.run(name, arguments[1:], extra)
        if not arguments:
            _parser(name).print_help(sys.stderr)
            return WRONG_USE
        args = _parse(name, arguments)
        return int(importlib.import_module(COMMANDS[args.command][0]).run(args))

    extra = SCRIPTS[name][0] if name in SCRIPTS else COMMANDS[name][1] if name in COMMANDS else ""
    return guarded("springgym", run, extra=extra)


def guarded(
    program: str, action: Callable[[], int], mendable: tuple[type[Exception], ...] = MENDABLE, extra: str = ""
) -> int:
    """Run a command, and return its exit status.

    Errors that the user can correct (a wrong argument or file, a missing package, a simulation that
    diverges) appear in one line on stderr, with status 2. Ctrl-C gives 130, and an output that is closed
    gives 141.

    Parameters
    ----------
    program
        Name of the program, at the beginning of the line.
    action
        A function that returns the status.
    mendable
        Types of the errors that appear in one line. Others are bugs, and have a traceback.
    extra
        The extra of `springgym[...]` with the packages that the command needs.
    """
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper):  # characters that it lacks become question marks
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
        print(f"{program}: error: {_message(error, extra)}", file=sys.stderr)
        return WRONG_USE
    except KeyboardInterrupt:
        print(f"{program}: interrupted", file=sys.stderr)
        return INTERRUPTED


def _message(error: Exception, extra: str) -> str:
    """Return the message of an error, in one line."""
    message: object = error.args[0] if isinstance(error, KeyError) and error.args else error
    if isinstance(error, ModuleNotFoundError) and extra:
        message = f"{error}: {install(extra)}"
    if isinstance(error, MemoryError):
        message = str(error) or "not enough memory"
    return " ".join(str(message).split()) or type(error).__name__


def _give_up_stdout() -> None:
    """Discard the output that cannot be written. Otherwise Python would try again at exit."""
    try:
        sys.stdout.flush()
    except OSError:
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())


@contextmanager
def whole_file(path: Path) -> Iterator[Path]:
    """Yield a temporary path for writing a file, which gets its own name when it is complete and on disk.

    Whenever the program ends, there is either the old file or the new one. Devices and pipes are written
    directly; links remain links.
    """
    place = path.resolve()
    temporary = place.with_name(f"{place.stem}.tmp{place.suffix}")
    try:
        if place.exists() and not place.is_file():
            yield path
            return
        yield temporary
        with temporary.open("rb+") as file:  # Windows syncs only writable files
            os.fsync(file.fileno())
        os.replace(temporary, place)
    except OSError as error:
        raise OSError(f"{path}: {error.strerror or error}") from error
    finally:
        temporary.unlink(missing_ok=True)


def check_new(path: Path, endings: Sequence[str] = ()) -> None:
    """Raise ValueError unless a file can be written: its name has one of the endings, and its folder exists.

    Raises
    ------
    ValueError
        If its name has none of the endings, or its folder is missing.
    """
    if endings and path.suffix.lower() not in endings:
        raise ValueError(f"{path}: the name must end in {' or '.join(endings)}")
    if not path.absolute().parent.is_dir():
        raise ValueError(f"{path}: there is no folder {path.absolute().parent}")


def significant(number: float, figures: int) -> str:
    """Return a number with a few significant figures, as 29,840 and not as 2.984e+04."""
    return f"{float(f'{number:.{figures}g}'):,.12g}"


def _parse(name: str, arguments: list[str]) -> argparse.Namespace:
    """Parse a command line. For an option that the command lacks, print the usage of the command and exit."""
    args, unknown = (parser := _parser(name)).parse_known_args(arguments)
    if unknown:
        (commands,) = (a for a in parser._actions if isinstance(a, argparse._SubParsersAction))
        commands.choices[args.command].error(f"unrecognized arguments: {' '.join(unknown)}")
    return args


def _parser(given: str) -> argparse.ArgumentParser:
    """Return the parser of all commands, with the options of the given one."""
    parser = argparse.ArgumentParser(
        prog="springgym", description="Train agents and simulate mass-spring bodies."
    )
    parser.add_argument("--version", action="version", version=f"springgym {springgym.__version__}")
    commands = parser.add_subparsers(dest="command", metavar="command", required=True)
    for name, (_, line) in SCRIPTS.items():
        commands.add_parser(name, help=line, add_help=False)  # the script reads its arguments
    for name, (module, _, line) in COMMANDS.items():
        command = commands.add_parser(name, help=line, description=line[0].upper() + line[1:] + ".")
        if name == given:
            importlib.import_module(module).add_arguments(command)
    return parser


if __name__ == "__main__":
    sys.exit(main())
