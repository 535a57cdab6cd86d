"""Writing of frames to a video file."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from os import PathLike
from pathlib import Path

import numpy as np
from gymnasium.error import DependencyNotInstalled
from numpy.typing import NDArray

from springgym.checks import hides, instance, number, refusing_unknown
from springgym.core.extras import missing

Frame = NDArray[np.uint8]

RATES = (1e-3, 1e3)
"""Least and largest number of frames per second."""


@refusing_unknown
def save_video(frames: Iterable[Frame], path: str | PathLike[str], fps: float) -> None:
    """Write frames to an .mp4 (H.264, streamed) or a looping .gif.

    A GIF shows at most 50 frames per second and 256 colours.

    Parameters
    ----------
    frames : iterable of (height, width, 3) uint8 arrays
        All of one size. An MP4 of odd height or width gets one more row or column.
    path : path
        Its suffix, .mp4 or .gif, chooses the format.
    fps : float
        Frames per second.

    Raises
    ------
    TypeError
        If an argument has the wrong type.
    ValueError
        For another suffix, no frames, frames that differ in shape or are not pictures, or a rate
        that is out of bounds or too high for a GIF.
    gymnasium.error.DependencyNotInstalled
        Without the packages of the extra ``render``.
    """
    target = Path(instance("path", path, str, PathLike))
    fps = number("fps", fps, *RATES)
    write = {".mp4": _write_mp4, ".gif": _write_gif}.get(target.suffix.lower())
    if write is None:
        raise ValueError(f"cannot write {target.name!r}: use a name that ends in .mp4 or .gif")
    write(_checked(frames), target, fps)


def _checked(frames: Iterable[Frame]) -> Iterator[Frame]:
    shape: tuple[int, ...] | None = None
    for index, frame in enumerate(instance("frames", frames, Iterable)):
        if hides(instance(f"frames[{index}]", frame, np.ndarray)):
            raise ValueError(f"frames[{index}] has hidden values; it must be an array without a mask")
        shape = frame.shape if shape is None else shape
        if frame.dtype != np.uint8 or len(shape) != 3 or shape[2] != 3 or frame.shape != shape:
            raise ValueError(
                f"frame {index} has shape {frame.shape} and type {frame.dtype}; every frame must "
                "be a uint8 array of one shape (height, width, 3)"
            )
        yield frame
    if shape is None:
        raise ValueError("there are no frames to write")


def _missing(package: str) -> DependencyNotInstalled:
    return DependencyNotInstalled(missing("a film", package, "render"))


def _write_mp4(frames: Iterator[Frame], target: Path, fps: float) -> None:
    try:
        from imageio_ffmpeg import write_frames
    except ImportError as error:
        raise _missing("imageio-ffmpeg") from error
    writer = None
    try:
        for frame in frames:
            height, width = frame.shape[:2]
            even = np.pad(frame, ((0, height % 2), (0, width % 2), (0, 0)), mode="edge")
            if writer is None:
                writer = write_frames(
                    target,
                    even.shape[1::-1],
                    fps=fps,
                    quality=8,
                    macro_block_size=2,
                    output_params=["-movflags", "+faststart"],
                )
                writer.send(None)
            writer.send(np.ascontiguousarray(even))
    finally:
        if writer is not None:
            writer.close()


def _write_gif(frames: Iterator[Frame], target: Path, fps: float) -> None:
    if fps > 50.0:
        raise ValueError(f"a GIF shows at most 50 frames a second, got fps {fps}")
    try:
        from PIL import Image
    except ImportError as error:
        raise _missing("pillow") from error
    pictures = [Image.fromarray(frame) for frame in frames]
    # One palette for the whole film, so that static parts do not flicker.
    sample = pictures[:: -(-len(pictures) // 12)]
    width, height = pictures[0].size
    sheet = Image.new("RGB", (width, height * len(sample)))
    for row, picture in enumerate(sample):
        sheet.paste(picture, (0, row * height))
    palette = sheet.quantize(256, method=Image.Quantize.MEDIANCUT, kmeans=1)
    indexed = [p.quantize(palette=palette, dither=Image.Dither.NONE) for p in pictures]
    # GIF times are in 10 ms: the times are rounded, not the durations, so that no time is lost.
    moments = np.rint(np.arange(len(indexed) + 1) * (100.0 / fps)).astype(int)
    durations = (10 * np.diff(moments)).tolist()
    indexed[0].save(
        target, save_all=True, append_images=indexed[1:], duration=durations, loop=0, optimize=False
    )
