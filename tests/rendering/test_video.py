import subprocess
import sys

import numpy as np
import pytest
from gymnasium.error import DependencyNotInstalled

from springgym.rendering import save_video


def film(count, height=48, width=64):
    """A red block that moves right over a grey gradient."""
    frames = []
    for k in range(count):
        frame = np.repeat(np.linspace(180, 250, height, dtype=np.uint8)[:, None], width, axis=1)
        frame = np.stack([frame, frame, frame], axis=-1)
        frame[10:30, 2 * k : 2 * k + 12] = (200, 40, 30)
        frames.append(frame)
    return frames


def test_gif_keeps_frames_time_and_colours(tmp_path):
    from PIL import Image

    frames = film(15)
    save_video(iter(frames), tmp_path / "a.gif", fps=30)
    durations = []
    with Image.open(tmp_path / "a.gif") as image:
        assert image.n_frames == 15
        assert image.info["loop"] == 0
        for k in range(15):
            image.seek(k)
            durations.append(image.info["duration"])
            error = np.abs(np.asarray(image.convert("RGB"), dtype=int) - frames[k])
            assert error.max() <= 8
    assert sum(durations) == 500  # 15 frames at 30 a second, though GIF counts in 10 ms
    assert set(durations) <= {30, 40}


@pytest.mark.parametrize("size", [(48, 64), (47, 63)])
def test_mp4_keeps_frames_and_rate(tmp_path, caplog, size):
    from imageio_ffmpeg import get_ffmpeg_exe

    frames = film(20, *size)
    save_video(iter(frames), tmp_path / "a.mp4", fps=25)
    assert not caplog.records  # nothing was rescaled
    decode = [get_ffmpeg_exe(), "-i", tmp_path / "a.mp4", "-f", "rawvideo", "-pix_fmt", "rgb24", "-"]
    done = subprocess.run(decode, capture_output=True, check=True)
    assert b"h264" in done.stderr
    assert b", 64x48" in done.stderr
    assert b", 25 fps" in done.stderr
    shown = np.frombuffer(done.stdout, np.uint8).reshape(-1, 48, 64, 3).astype(int)
    assert len(shown) == 20
    for k in (0, 10, 19):
        assert np.abs(shown[k][: size[0], : size[1]] - frames[k]).mean() < 6
    assert np.abs(shown[19] - shown[0]).mean() > 6


BAD = [
    ([], 10, "no frames"),
    ([*film(2), film(1, 32)[0]], 10, "frame 2"),
    ([film(1)[0].astype(float)], 10, "frame 0.*float64"),
    ([film(1)[0][..., 0]], 10, "frame 0"),
    (film(2), 0, "fps"),
]


@pytest.mark.parametrize(
    ("name", "frames", "fps", "message"),
    [
        *((name, *row) for name in ("a.gif", "a.mp4") for row in BAD),
        ("a.gif", film(2), 60, "at most 50"),
        ("a.avi", film(2), 10, r"a\.avi.*\.mp4 or \.gif"),
    ],
)
def test_bad_films(tmp_path, name, frames, fps, message):
    with pytest.raises(ValueError, match=message):
        save_video(frames, tmp_path / name, fps)


@pytest.mark.parametrize(("name", "module"), [("a.gif", "PIL"), ("a.mp4", "imageio_ffmpeg")])
def test_missing_package(tmp_path, monkeypatch, name, module):
    monkeypatch.setitem(sys.modules, module, None)
    with pytest.raises(DependencyNotInstalled, match=r"a film needs .*: pip install .*render"):
        save_video(film(2), tmp_path / name, fps=10)
