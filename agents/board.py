"""The TensorBoard log of a run."""

from __future__ import annotations

import os
import platform
import time
from pathlib import Path
from typing import Any

import numpy as np
from runs import Run
from stable_baselines3.common.logger import KVWriter, Logger, filter_excluded_keys
from tensorboard.compat.proto.event_pb2 import Event, SessionLog
from tensorboard.compat.proto.summary_pb2 import Summary
from tensorboard.summary.writer.record_writer import RecordWriter


class TensorBoard(KVWriter):
    """TensorBoard scalars, hiding what a stopped run wrote beyond ``timesteps``.

    They are written at once; PyTorch's writer does that in a thread, where nobody hears of a full disk.
    """

    def __init__(self, folder: Path, timesteps: int) -> None:
        folder.mkdir(parents=True, exist_ok=True)
        self.path = folder / f"events.out.tfevents.{time.time_ns()}.{platform.node()}.{os.getpid()}"
        start = SessionLog(status=SessionLog.START)
        self._append(Event(file_version="brain.Event:2"), Event(step=timesteps + 1, session_log=start))

    def write(
        self, key_values: dict[str, Any], key_excluded: dict[str, tuple[str, ...]], step: int = 0
    ) -> None:
        """Write what is a number and not excluded."""
        shown = filter_excluded_keys(key_values, key_excluded, "tensorboard")
        scalars = [
            Summary.Value(tag=key, simple_value=float(value))
            for key, value in shown.items()
            if isinstance(value, (int, float, np.number))
        ]
        self._append(Event(step=step, summary=Summary(value=scalars)))

    def _append(self, *events: Event) -> None:
        with open(self.path, "ab") as file:
            for event in events:
                event.wall_time = time.time()
                RecordWriter(file).write(event.SerializeToString())

    def close(self) -> None:
        """Leave nothing open."""


def make_logger(run: Run, timesteps: int) -> Logger:
    """Make the log of a run that has come to ``timesteps``."""
    folder = run.folder / "tensorboard"
    return Logger(str(folder), [TensorBoard(folder, timesteps)])
