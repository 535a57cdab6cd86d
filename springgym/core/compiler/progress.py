"""What the user is told while a kernel is compiled."""

from __future__ import annotations

import itertools
import logging
import sys
import threading
import time

LOGGER = logging.getLogger(__name__.partition(".")[0])

PATIENCE = 2.0
"""Compilation that takes longer than this is reported to the user [s]."""

_TOLD = threading.Lock()
"""Held once compilation was reported."""

_KERNELS = itertools.count(1)
"""Counts the kernels that this process compiles."""


def _report_compiling(over: threading.Event, kernel: int) -> None:
    """Report that a kernel is being compiled, until it is ``over``.

    On a terminal, a line counts the seconds, and is then erased. Elsewhere, or if logging is configured, a
    line is logged once per process.
    """
    logs = LOGGER.hasHandlers() or not LOGGER.isEnabledFor(logging.WARNING)
    if logs or sys.stderr is None or not sys.stderr.isatty():
        if _TOLD.acquire(blocking=False):
            LOGGER.warning(
                "springgym: compiling, up to a minute, once per kind of scene; see `springgym compile`"
            )
        return
    began = time.perf_counter() - PATIENCE
    while not over.wait(1.0):
        seconds = time.perf_counter() - began
        sys.stderr.write(f"\rspringgym: compiling kernel {kernel} (once, up to a minute): {seconds:.0f} s")
        sys.stderr.flush()
    sys.stderr.write("\r\033[K")


def start_waiting() -> threading.Timer:
    """Begin to wait for a kernel; the user is told if it takes long."""
    waiting = threading.Timer(PATIENCE, _report_compiling)
    waiting.args = (waiting.finished, next(_KERNELS))
    waiting.daemon = True
    waiting.start()
    return waiting


def stop_waiting(waiting: threading.Timer) -> None:
    """Stop telling the user about a kernel."""
    waiting.cancel()
    waiting.join()  # so that no thread runs if the process forks next
