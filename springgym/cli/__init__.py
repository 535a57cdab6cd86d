"""The command ``springgym``: a table of subcommands, each in a module of its own.

A module has ``add_arguments(parser)`` and ``run(args)``, which returns the exit status. It is imported only
when its command is used.
"""

from __future__ import annotations

import argparse
import importlib
import io
import os
import stat
import sys
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from tempfile import TemporaryFile
from typing import Any, NoReturn
from uuid import uuid4

from gymnasium.error import DependencyNotInstalled

import springgym
from springgym.checks import printable, similar
from springgym.core.extras import install
from springgym.envs import scripts

COMMANDS = {
    "simulate": (
        "springgym.cli.simulate",
        "scenes",
        "simulate a scene; plot it, record a video, compare it with theory",
    ),
    "view": ("springgym.view", "view", "view and change a scene or an episode in the browser"),
    "compile": ("springgym.cli.compile_all", "", "compile environments ahead of time"),
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
        Name of the program, whose first word begins the line.
    action
        A function that returns the status.
    mendable
        Types of the errors that appear in one line. Others are bugs, and have a traceback.
    extra
        The extra of `springgym[...]` with the packages that the command needs.
    """
    for name in ("stdout", "stderr"):
        if getattr(sys, name) is None:  # closed, as that of a daemon: nobody reads it
            setattr(sys, name, open(os.devnull, "w", encoding="utf-8"))  # noqa: SIM115 (for the whole run)
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
        print(complaint(program, _message(error, extra)), file=sys.stderr)
        return WRONG_USE
    except KeyboardInterrupt:
        print(f"{_first(program)}: interrupted", file=sys.stderr)
        return INTERRUPTED


def _message(error: Exception, extra: str) -> str:
    """Return the message of an error, in one line."""
    message: object = error.args[0] if isinstance(error, KeyError) and error.args else error
    if isinstance(error, ModuleNotFoundError) and extra:
        message = f"{error}: {install(extra)}"
    if isinstance(error, MemoryError):
        message = str(error) or "not enough memory"
    return str(message) or type(error).__name__


def complaint(program: str, message: str) -> str:
    """Return an error as every command reports it: in one line, with nothing that a terminal would obey."""
    return f"{_first(program)}: error: {printable(' '.join(message.split()))}"


def _first(program: str) -> str:
    """Return the first word of a program's name: "springgym" of "springgym train"."""
    return program.partition(" ")[0]


def _give_up_stdout() -> None:
    """Discard the output that cannot be written. Otherwise Python would try again at exit."""
    try:
        sys.stdout.flush()
    except OSError:
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())


@contextmanager
def whole_file(path: Path) -> Iterator[Path]:
    """Yield a temporary path for writing a file, which gets its own name when it is complete and on disk.

    Whenever the program ends, there is either the old file or the new one, and of several writers, one is the
    last. The new file has the mode of the old one. Devices and pipes are written directly; a link remains
    one, and the file that it leads to is replaced.
    """
    place = Path(os.path.realpath(path))
    try:
        there = _is_there(place)
        if there and not place.is_file():
            yield path
            return
        suffix = place.suffix if len(os.fsencode(place.suffix)) <= LONGEST_SUFFIX else ""
        temporary = place.with_name(f".{uuid4().hex}{suffix}")  # writers choose the format by the suffix
        mode = stat.S_IMODE(place.stat().st_mode) if there else None
        os.close(os.open(temporary, os.O_CREAT | os.O_EXCL | os.O_WRONLY, 0o666 if mode is None else 0o600))
        try:
            yield temporary
            with temporary.open("rb+") as file:  # Windows syncs only writable files
                if not os.fstat(file.fileno()).st_size:
                    raise OSError("nothing was written")
                os.fsync(file.fileno())
            if mode is not None:
                temporary.chmod(mode)
            os.replace(temporary, place)
        finally:
            temporary.unlink(missing_ok=True)
    except OSError as error:
        raise OSError(f"{path}: {error.strerror or error}") from error


LONGEST_SUFFIX = 16
"""Longest suffix that a temporary file has, too [bytes]: names have at most 255."""


def write_text(path: Path, text: str) -> None:
    """Write a `whole_file`."""
    with whole_file(path) as temporary:
        temporary.write_text(text, encoding="utf-8")


def check_new(path: Path, endings: Sequence[str] = ()) -> None:
    """Raise ValueError unless a file can be written, before the work whose result it is to hold.

    Raises
    ------
    ValueError
        If its name has none of the endings, its folder is missing or not writable, or it is a folder.
    """
    if endings and path.suffix.lower() not in endings:
        raise ValueError(f"{path}: the name must end in {' or '.join(endings)}")
    place = Path(os.path.realpath(path))
    if not place.parent.is_dir():
        raise ValueError(f"{path}: there is no folder {place.parent}")
    try:
        if place.is_dir():
            raise ValueError(f"{path}: it is a folder")
        if place.is_file() or not _is_there(place):
            with TemporaryFile(dir=place.parent):
                pass
        elif not os.access(place, os.W_OK):
            raise ValueError(f"{path}: it cannot be written")
    except OSError as error:
        raise ValueError(f"{path}: it cannot be written: {error.strerror or error}") from error


def _is_there(place: Path) -> bool:
    """Return whether there is anything at a place.

    Raises
    ------
    OSError
        If nothing can be: its name is too long, or a link leads to itself.
    """
    try:
        place.stat()
    except FileNotFoundError:
        return False
    return True


def significant(number: float, figures: int) -> str:
    """Return a number with a few significant figures, as 29,840 and not as 2.984e+04."""
    return f"{float(f'{number:.{figures}g}'):,.12g}"


class Parser(argparse.ArgumentParser):
    """A parser of arguments whose errors have one line, suggest a similar word, and are not preceded by the
    usage."""

    def error(self, message: str) -> NoReturn:
        """Print an error and exit."""
        help_with = "" if "; did you mean " in message else f"; see {self.prog} --help"
        self.exit(WRONG_USE, f"{complaint(self.prog, message + help_with)}\n")

    def parse_args(self, args: Any = None, namespace: Any = None) -> Any:
        """Parse arguments; the first option that is unknown is an error with a similar one."""
        parsed, unknown = self.parse_known_args(args, namespace)
        if unknown:
            self.refuse(unknown)
        return parsed

    def refuse(self, unknown: Sequence[str]) -> NoReturn:
        """Print an error about unknown arguments and exit."""
        options = [option for option in self._option_string_actions if option.startswith("--")]
        self.error(
            f"unrecognized arguments: {' '.join(unknown)}{similar(unknown[0].partition('=')[0], options)}"
        )

    def _check_value(self, action: argparse.Action, value: Any) -> None:
        if action.choices is not None and value not in action.choices:
            close = similar(value, map(str, action.choices))
            known = close or f"; choose from: {', '.join(map(str, action.choices))}"
            raise argparse.ArgumentError(action, f"invalid choice: {value!r}{known}")


def _parse(name: str, arguments: list[str]) -> argparse.Namespace:
    """Parse a command line. An unknown option is an error of the command, which suggests its own options."""
    args, unknown = (parser := _parser(name)).parse_known_args(arguments)
    if unknown:
        (commands,) = (a for a in parser._actions if isinstance(a, argparse._SubParsersAction))
        commands.choices[args.command].refuse(unknown)
    return args


def _parser(given: str) -> Parser:
    """Return the parser of all commands, with the options of the given one."""
    parser = Parser(prog="springgym", description="Train agents and simulate mass-spring bodies.")
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
