"""The disk cache of compiled code.

Numba's own cache checks only the file of the cached function, so after an edit in a file that it *calls* the
old physics would silently run, and two processes that compile at once can corrupt its index. Here a cache
entry is one file, named by a hash over everything it depends on: the code of all functions the kernel is
compiled from with the constants that they name (`springgym.core.compiler.code_digest`), the argument types,
the CPU, the versions of Python, NumPy and Numba, and those of Numba's settings that change the code. Nothing
is ever invalidated or locked: other code has another name. A function without a digest is compiled by each
process. Entries are executed, so their folder must belong to the user or to somebody trusted. Folders can be
copied, shared and read-only. Entries are found by processors that are similar to the one that made them, or
by processes with the same ``SPRINGGYM_CPU`` (`springgym.core.compiler.targets`).

If ``SPRINGGYM_CPU`` is not set, entries that the folder lacks are taken from the package `KERNELS`, if it is
installed and fits. It has code for the levels; each processor runs that of its own (`fitting_level`).

If a version of Numba lacks what the cache needs (`springgym.core.compiler.numba_private`), a warning is
issued and every process compiles again; results are the same.
"""

from __future__ import annotations

import hashlib
import importlib.util
import json
import os
import sys
import sysconfig
import threading
import warnings
from collections.abc import Callable, Iterator
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING, Any
from uuid import uuid4

import numba
import numpy as np

from springgym.core.compiler.code_digest import NotHashable, digest
from springgym.core.compiler.numba_private import binding, lacking, read_result, target_of, written_result
from springgym.core.compiler.progress import LOGGER, start_waiting, stop_waiting
from springgym.core.compiler.targets import features, fitting_level
from springgym.version import __version__

if TYPE_CHECKING:
    from springgym.core.compiler.numba_private import Asked, CompileResult, CPUContext

PACKAGE = __name__.partition(".")[0]

SOURCES = tuple(f"springgym.core.compiler.{name}" for name in ("decorators", "numba_private", "targets"))
"""The modules that turn functions into machine code: all entries depend on their source."""

SETTINGS = ("BOUNDSCHECK", "OPT", "LOOP_VECTORIZE", "SLP_VECTORIZE", "DEBUGINFO_DEFAULT")
"""Settings of `numba.config` that change the compiled code."""

VERSIONS = {
    "Python": str(sysconfig.get_config_var("EXT_SUFFIX")).split(".")[1],  # as for modules written in C
    "NumPy": np.__version__,
    "Numba": numba.__version__,
}
"""Versions that compiled code depends on, besides the processor."""

LACKING = lacking("cache")
"""What the cache needs and this version of Numba lacks."""


def _warn_uncached(why: str) -> None:
    """Warn, once per process, that compiled code is not cached."""
    global _warned
    if not _warned:
        _warned = True
        warnings.warn(
            f"Numba {numba.__version__} {why}: springgym cannot keep compiled code, and each process "
            "compiles anew, for up to a minute. Install a version of Numba that springgym asks for",
            RuntimeWarning,
            stacklevel=3,
        )


_warned = False
if LACKING:
    _warn_uncached(f"has no {', '.join(LACKING)}")


def cache_directory() -> Path | None:
    """Return the folder of compiled code: ``$SPRINGGYM_CACHE_DIR``, else the user's cache folder, or None.

    Variables of the system count only if they hold an absolute path: entries are executed, so they are not
    read from wherever Python was started. None: the user has no home folder.
    """
    if chosen := os.environ.get("SPRINGGYM_CACHE_DIR"):
        return Path(chosen).absolute()
    if sys.platform == "win32":
        named = os.environ.get("LOCALAPPDATA", "")
        usual = "~/AppData/Local"
    elif sys.platform == "darwin":
        named = ""
        usual = "~/Library/Caches"
    else:
        named = os.environ.get("XDG_CACHE_HOME", "")
        usual = "~/.cache"
    if os.path.isabs(named):
        return Path(named) / PACKAGE
    try:
        home = Path(usual).expanduser()
    except RuntimeError:  # a user without a home, as in some containers
        return None
    return home / PACKAGE if home.is_absolute() else None


KERNELS = "springgym_kernels"
"""Package of compiled code, made by ``tools/kernels.py`` of a clone: a folder of entries, and `MADE`."""

MADE = "made.json"
"""File in it: ``{"versions": {…}, "levels": […]}``, of what its code is made for; see `made_here`."""


def made_here() -> dict[str, str]:
    """Return the versions that the code of `KERNELS` must have been made for to run in this process."""
    return {PACKAGE: __version__, **VERSIONS}


@cache
def shipped() -> tuple[Path, str] | None:
    """Return the folder of `KERNELS` and the level whose code is for this process.

    None if the package is not installed, if ``SPRINGGYM_CPU`` or Numba's settings set the target, or if the
    package does not fit (then a warning gives the reason).
    """
    if os.environ.get("SPRINGGYM_CPU") or numba.config.CPU_NAME or numba.config.CPU_FEATURES is not None:
        return None
    try:
        spec = importlib.util.find_spec(KERNELS)
    except ValueError:  # a module of this name has no spec
        spec = None
    if spec is None or not spec.submodule_search_locations:
        return None
    folder = Path(next(iter(spec.submodule_search_locations)))
    level = fitting_level(binding.get_host_cpu_name(), features())
    try:
        made = json.loads((folder / MADE).read_text(encoding="utf-8"))
        versions = dict(made["versions"])
        levels = list(map(str, made["levels"]))
    except (OSError, ValueError, KeyError, TypeError, RecursionError) as error:
        why = f"it is damaged ({type(error).__name__}: {error})"
    else:
        unfit = [
            f"it is for {name} {versions.get(name)}, and this is {here}"
            for name, here in made_here().items()
            if versions.get(name) != here
        ]
        if level in levels and not unfit:
            return folder, level
        ours = f"one of {level}" if level else "none of these"
        why = unfit[0] if unfit else f"it is for processors of {', '.join(levels)}, and this is {ours}"
    LOGGER.warning("springgym: the compiled code of springgym-kernels is not used: %s", why)
    return None


class DigestKeyedCache:
    """Numba's cache interface with one file per entry, named by a hash of all that it depends on."""

    cache_path = None
    """for Numba's statistics"""

    def __init__(self, function: Callable[..., Any]) -> None:
        self._function = function
        self._waiting: threading.Timer | None = None

    def flush(self) -> None:
        """Do nothing: no entry is ever out of date."""

    def load_overload(self, sig: Asked, target_context: CPUContext) -> CompileResult | None:
        """Return the compiled function of a signature, if there is an entry of it."""
        found = self._load(sig, target_context)
        if found is None:
            LOGGER.info("compile %s.%s", self._function.__module__, self._function.__qualname__)
            self._waiting = start_waiting()
        return found

    def stop_waiting(self) -> None:
        """Stop reporting that a kernel is being compiled."""
        waiting = self._waiting
        self._waiting = None
        if waiting is not None:
            stop_waiting(waiting)

    def _load(self, sig: Asked, target_context: CPUContext) -> CompileResult | None:
        try:
            for path in self._places(sig, target_of(target_context)):
                if (found := self._read(path, sig, target_context)) is not None:
                    return found
        except Exception:  # Numba's internals have changed
            pass
        return None

    def _read(self, path: Path, sig: Asked, target_context: CPUContext) -> CompileResult | None:
        """Return the content of an entry; None if there is none, or if anything is wrong with it."""
        try:
            content = path.read_bytes()
            payload = content[DIGEST:]
            if content[:DIGEST] != _checksum(path, payload):
                return None
            return read_result(payload, sig, target_context)
        except Exception:  # the function is compiled again, and the entry replaced
            return None

    def save_overload(self, sig: Asked, data: CompileResult) -> None:
        """Save a compiled function."""
        try:
            folder = cache_directory()
            code = self._digest(sig)
            if folder is None:
                _warn_unsaved("this user has no home folder")
            if folder is None or code is None:
                return
            path = folder / self._name(code, target_of(data.target_context))
            payload = written_result(data)
        except (AttributeError, TypeError, ValueError) as error:  # Numba's internals have changed
            _warn_uncached(f"cannot be asked for its compiled code ({error})")
            return
        try:
            path.parent.mkdir(parents=True, exist_ok=True)
            temporary = path.with_suffix(f".{uuid4().hex}.tmp")
            try:
                with temporary.open("xb") as file:  # permissions follow the umask
                    file.write(_checksum(path, payload) + payload)
                os.replace(temporary, path)  # readers see a complete entry or none
            except BaseException:
                temporary.unlink(missing_ok=True)
                raise
        except OSError as error:  # as of a full disk, costs a compilation, not the program
            _warn_unsaved(f"{error.strerror or error}: {folder}")

    def _places(self, sig: Asked, target: tuple[str, str, str]) -> Iterator[Path]:
        """Yield the files that may hold the code: in the cache folder, then in `KERNELS`."""
        code = self._digest(sig)
        if code is None:
            return
        folder = cache_directory()
        if folder is not None:
            yield folder / self._name(code, target)
        if (found := shipped()) is not None:
            folder, level = found
            yield folder / self._name(code, (target[0], level, ""))

    def _digest(self, sig: Asked) -> bytes | None:
        """Return the digest of what the function is compiled from; None if it has none."""
        try:
            return digest(self._function, getattr(sig, "args", sig), SOURCES)
        except NotHashable as error:
            LOGGER.debug("%s is not kept: %s", self._function.__qualname__, error)
            return None

    def _name(self, code: bytes, target: tuple[str, str, str]) -> str:
        """Return the file name of an entry; ``target`` is the processor of its code, in Numba's form."""
        settings = [str(getattr(numba.config, name, None)) for name in SETTINGS]
        key = hashlib.sha256(repr((VERSIONS, target, settings)).encode() + code).hexdigest()
        return f"{self._function.__module__}.{self._function.__name__}-{key}.nbc"


_UNSAVED = threading.Lock()
"""Held once it was reported that code is not kept."""


def _warn_unsaved(why: str) -> None:
    """Log, once per process, that compiled code is not kept."""
    if _UNSAVED.acquire(blocking=False):
        LOGGER.warning(
            "springgym: compiled code is not kept, so that every start compiles again (%s); set "
            "SPRINGGYM_CACHE_DIR to a folder that can be written",
            why,
        )


DIGEST = hashlib.sha256().digest_size
"""Length of the checksum that an entry begins with [bytes]."""


def _checksum(path: Path, payload: bytes) -> bytes:
    """Return a hash of an entry's content and name, so that a renamed entry is not accepted."""
    return hashlib.sha256(path.name.encode() + payload).digest()
