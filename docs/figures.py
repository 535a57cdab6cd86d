"""Make every figure and film of the repository anew; nothing is measured or trained.

    python docs/figures.py                       # all
    python docs/figures.py accuracy scenes       # some
    python docs/figures.py agent --agent runs/SpringTop-v0-ppo-0

Curves come from figures/accuracy.json and numbers.json, which ``python -m benchmarks.accuracy`` and
``python docs/measured.py --write`` write.
"""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Iterator, Sequence
from dataclasses import replace
from fractions import Fraction
from itertools import islice
from pathlib import Path

import imageio_ffmpeg
import numpy as np
from PIL import Image, ImageDraw, ImageFont

from springgym.envs.registration import ENVIRONMENTS
from springgym.rendering import Renderer
from springgym.scenes import load
from springgym.scenes.film import GIF_FPS, visible_speed
from springgym.scenes.recording import record
from springgym.view.episodes import Agent, find_agent, played
from springgym.view.motion import Motion

HERE = Path(__file__).parent
FIGURES = HERE / "figures"
SCENES = ("top", "elongated-top", "unbalanced-top", "irregular-fall")
"""Figures 5, 6, 7 and 9 of the paper."""
FILMED = "SpringTop-v0"
FILM_SIZE, FILM_SECONDS = 400, 2.4
"""Pixels of the film, the size that the README shows it at, and seconds of the motion."""
COLUMNS, TILE, SEED, MOMENT = 5, 420, 8, 0.7
"""Of the sheet of environments: columns, pixels of a picture, seed and second of its episode."""
POSTER, EARLY, MIDDLE = 320, 0.08, 0.6
"""Of a poster: its larger side in pixels, and what share of the film of an environment, where the agent still
has something to do, or of a scene runs before it."""
INK = (52, 60, 76)


def classical(env_id: str) -> Agent:
    """The classical controller of an environment."""
    sys.path.insert(0, str(HERE.parent / "agents"))
    from watch import watched

    return watched("classical", env_id, {})


def accuracy(folder: Path, args: argparse.Namespace) -> None:
    """Error against cost, from what was measured."""
    from benchmarks.figures import draw_accuracy

    report = json.loads((FIGURES / "accuracy.json").read_text(encoding="utf-8"))
    for name, result in report.items():
        draw_accuracy(name, result, folder / f"{name}.svg")


def speed(folder: Path, args: argparse.Namespace) -> None:
    """Speed of programs and sizes, and error against cost of environments, from what was measured."""
    from benchmarks.figures import draw_curves, draw_speed

    numbers = json.loads((FIGURES.parent / "numbers.json").read_text(encoding="utf-8"))
    draw_speed(numbers, folder / "speed.svg")
    draw_curves(numbers["curves"]["rows"], folder / "curves.svg")


def scenes(folder: Path, args: argparse.Namespace) -> None:
    """Scenes of the paper."""
    from springgym.scenes.plots import draw

    for name in SCENES:
        path = folder / f"scene-{name}.png"
        draw(record(load(name))).savefig(path)
        shrunk(Image.open(path)).save(path, optimize=True)


def environments(folder: Path, args: argparse.Namespace) -> None:
    """Every environment with its name, some time after the start of an episode under classical control.

    Readings and keys are left out: at the size of the sheet nobody could read them.
    """
    rows = -(-len(ENVIRONMENTS) // COLUMNS)
    caption = 50
    sheet = Image.new("RGB", (COLUMNS * TILE, rows * (TILE + caption)), "white")
    write = ImageDraw.Draw(sheet)
    font = ImageFont.load_default(33)  # 11 pixels where a page shows the sheet 740 pixels wide
    for n, row in enumerate(ENVIRONMENTS):
        motion = played(classical(row.id), SEED)
        motion = replace(motion, marks=[replace(marks, text=(), key=()) for marks in motion.marks])
        *_, picture = islice(pictures(motion, 50.0, 1.0, TILE), 1 + round(50 * MOMENT))
        left = TILE * (n % COLUMNS)
        top = (TILE + caption) * (n // COLUMNS)
        sheet.paste(Image.fromarray(picture), (left, top))
        write.text((left + TILE // 2, top + TILE + caption // 2), row.id, INK, font, anchor="mm")
    sheet.save(folder / "environments.webp", quality=85, method=6)


def agent(folder: Path, args: argparse.Namespace) -> None:
    """A film of an agent, with the strain of the springs: WebP has all colors in a third of a GIF's bytes."""
    motion = played(find_agent(args.agent, FILMED), SEED)
    pace = visible_speed(motion.fastest, GIF_FPS)
    count = round(FILM_SECONDS / pace * GIF_FPS)
    shown = islice(pictures(motion, GIF_FPS, pace, FILM_SIZE, springs=True), count)
    first, *others = (Image.fromarray(picture) for picture in shown)
    first.save(
        folder / "agent.webp",
        save_all=True,
        append_images=others,
        duration=round(1000 / GIF_FPS),
        loop=0,
        quality=70,
        method=6,
    )


def posters(folder: Path, args: argparse.Namespace) -> None:
    """Write a picture out of each film that docs/build.py has made, for pages without films."""
    ids = {row.id for row in ENVIRONMENTS}
    for film in sorted((HERE / "_media").glob("*.mp4")):
        if film.stem.endswith("-small"):
            continue
        frames, _ = imageio_ffmpeg.count_frames_and_secs(str(film))
        reader = imageio_ffmpeg.read_frames(str(film))
        width, height = next(reader)["size"]
        share = EARLY if film.stem in ids else MIDDLE
        *_, picture = islice(reader, 1 + round(share * frames))
        image = Image.frombytes("RGB", (width, height), picture)
        image.thumbnail((POSTER, POSTER), Image.Resampling.LANCZOS)
        (folder / "posters").mkdir(exist_ok=True)
        image.save(folder / "posters" / f"{film.stem}.webp", quality=80, method=6)


def pictures(
    motion: Motion, fps: float, pace: float, size: int, springs: bool = False
) -> Iterator[np.ndarray]:
    """Pictures of a motion at ``pace`` seconds of it a second; where that is not 1, they say so."""
    assert motion.camera is not None
    renderer = Renderer(motion.look, motion.camera, motion.scenery, (size, size))
    note = () if pace == 1 else (f"{Fraction(pace)} of real time",)
    for time in np.arange(0.0, motion.times[-1] + 1e-9, pace / fps):
        n, share = motion.at(float(time))
        n += round(share)
        marks = motion.marks[n]
        strain = motion.strain[n] if springs else None
        told = replace(marks, text=(*marks.text, *note))
        yield renderer.draw(motion.positions[n], told, strain)  # type: ignore[misc]


def shrunk(image: Image.Image) -> Image.Image:
    """In 256 colours of its own: a third of the bytes, and the eye sees no difference."""
    return image.convert("RGB").quantize(
        256, method=Image.Quantize.MEDIANCUT, kmeans=2, dither=Image.Dither.NONE
    )


MAKERS = {maker.__name__: maker for maker in (accuracy, speed, scenes, environments, agent, posters)}


def main(arguments: Sequence[str] | None = None) -> None:
    """Command line."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("which", nargs="*", metavar="KIND", help=f"of {', '.join(MAKERS)}; default: all")
    parser.add_argument(
        "--agent", metavar="RUN", default=FILMED, help="a run folder to film, instead of the published agent"
    )
    parser.add_argument("--out", type=Path, default=FIGURES, metavar="FOLDER")
    args = parser.parse_args(arguments)
    if unknown := set(args.which) - set(MAKERS):
        parser.error(f"{sorted(unknown)[0]!r} is none of {', '.join(MAKERS)}")
    args.out.mkdir(parents=True, exist_ok=True)
    for name in args.which or MAKERS:
        print(name, flush=True)
        MAKERS[name](args.out, args)


if __name__ == "__main__":
    main()
