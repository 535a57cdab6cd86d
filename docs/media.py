"""Films, figures and checks of the site: of every scene, and of the trained agent of every environment.

    python docs/media.py SpringTop-v0 elongated-top    # of these alone, into docs/_media

docs/build.py makes all. It keeps what is there and newer than the package; so the first build takes minutes,
and the next ones do not.
"""

from __future__ import annotations

import json
import subprocess
import sys
from base64 import b64encode
from collections.abc import Callable, Iterable, Iterator
from dataclasses import replace
from functools import partial
from itertools import count, islice
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import gymnasium as gym
import imageio_ffmpeg
import numpy as np

from springgym import load_agent
from springgym.cli import write_text
from springgym.envs.agent import Policy
from springgym.envs.registration import ENVIRONMENTS
from springgym.envs.trained import PUBLISHED
from springgym.rendering import Marks, save_video
from springgym.scenes import film, load, names
from springgym.scenes.checks import Check, check
from springgym.scenes.checks.basis import two_figures
from springgym.scenes.plots import draw
from springgym.scenes.recording import record
from springgym.view import save_page, save_viewer

HERE = Path(__file__).parent
SECONDS, LONG = 8.0, 16.0
"""Greatest durations [s] of films of agents, and of films of scenes. The tippe-top turns over in 13 s."""
PIXELS, SMALL = 480, 320
"""Widths of films and of the front page's films [pixels]."""
SEED = 8
STILL = 1.0
"""Seconds that a film goes on after an episode has succeeded, before it shows the next one."""


def make_all(folder: Path, newest: float) -> None:
    """Make what is missing, or older than the package."""
    for name, make in MAKERS.items():
        done = folder / f"{name}.mp4"  # written last
        if not done.exists() or done.stat().st_mtime < newest:
            print(f"film of {name}", flush=True)
            make(name, folder)
    viewer(folder)


def scene(name: str, folder: Path) -> None:
    """Write NAME.png, its figure; NAME.json, its checks; NAME.js, to turn it; NAME.mp4, its film."""
    plan = load(name)
    recording = record(plan, contacts=True)  # the viewer draws forces of support where contacts tell them
    draw(recording).savefig(folder / f"{name}.png")
    told = {"checks": rows(check(recording))}
    write_text(folder / f"{name}.json", json.dumps(told))
    with TemporaryDirectory() as temporary:
        save_page(recording, page := Path(temporary) / "page.viser")
        write_text(folder / f"{name}.js", embedded(page))
    frames = islice(film.frames(recording), round(LONG * film.FPS))
    write(frames, folder / f"{name}.mp4", film.FPS)


def embedded(page: Path) -> str:
    """Return what a viewer plays as a script: browsers load scripts from a folder, and nothing else."""
    data = b64encode(page.read_bytes()).decode("ascii")
    return f'window.__VISER_EMBED_DATA__="{data}";window.__VISER_EMBED_CONFIG__={{darkMode:false}};\n'


LOAD = """<script>
const scene = location.search.slice(1);
if (/^[a-z0-9-]+$/.test(scene)) document.write('<script src="' + scene + '.js"></' + 'script>');
</script>
"""


def viewer(folder: Path) -> None:
    """Write view.html, which plays NAME.js at the address ``view.html?NAME``, with or without a server."""
    save_viewer(path := folder / "view.html")
    page = path.read_text(encoding="utf-8")
    write_text(path, page.replace("</head>", LOAD + "</head>", 1))


def rows(checks: Iterable[Check]) -> list[list[str]]:
    """Return verdicts, and theory beside what was measured. Units have a column of their own."""
    told = [["", "", "theory", "measured", "", "off by", "allowed"]]
    for each in checks:
        numbers = [f"{each.theory:.5g}", f"{each.measured:.5g}", each.unit]
        off, allowed = (two_figures(each, x) for x in (each.measured - each.theory, each.tolerance))
        if each.unit and not each.theory:  # then these are no %
            off = off.removesuffix(f" {each.unit}")
            allowed = allowed.removesuffix(f" {each.unit}")
        told.append([each.verdict, each.quantity, *numbers, off, allowed])
    return told


def environment(env_id: str, folder: Path) -> None:
    """Write episodes of the published agent, in real time: ID.mp4 and, for the front page, ID-small.mp4.

    The small one has no readings and no key, which nobody could read.
    """
    agent = load_agent(env_id)
    for pixels, suffix in (SMALL, "-small"), (PIXELS, ""):
        env = agent.make(render_mode="rgb_array_list")
        episodes: Any = env.unwrapped.episodes  # type: ignore[attr-defined]
        if suffix:
            episodes.marks = partial(unnamed, episodes.marks)
        rate = 1 / episodes.task.period
        pictures = played(env, agent.policy(env), round(STILL * rate))
        write(islice(pictures, round(SECONDS * rate)), folder / f"{env_id}{suffix}.mp4", rate, pixels)
        env.close()


def unnamed(marks: Callable[[int], Marks], copy: int) -> Marks:
    """Return the marks of a copy without words."""
    return replace(marks(copy), text=(), key=())


def played(env: gym.Env, policy: Policy, still: int) -> Iterator[np.ndarray]:
    """Yield pictures of episodes, each until it ends or ``still`` steps after it has succeeded."""
    for seed in count(SEED):
        observation, _ = env.reset(seed=seed)
        over = False
        left = still
        yield from env.render()  # type: ignore[misc]
        while not over and left:
            observation, _, terminated, truncated, info = env.step(policy(observation[None])[0])
            over = terminated or truncated
            left -= bool(info.get("is_success"))
            yield from env.render()  # type: ignore[misc]


def write(frames: Iterable[np.ndarray], path: Path, rate: float, pixels: int = PIXELS) -> None:
    """A film of the size that pages show, small enough to load at once, and its first picture."""
    with TemporaryDirectory() as folder:
        large = Path(folder) / "large.mp4"
        save_video(frames, large, rate)
        shrink = ["-vf", f"scale={pixels}:-2:flags=lanczos"]
        ffmpeg = [imageio_ffmpeg.get_ffmpeg_exe(), "-y", "-loglevel", "error", "-i", str(large)]
        first = ["-frames:v", "1", "-q:v", "4", str(path.with_suffix(".jpg"))]
        subprocess.run([*ffmpeg, *shrink, *first], check=True)
        film = ["-crf", "30", "-preset", "slow", "-movflags", "+faststart", str(path)]
        subprocess.run([*ffmpeg, *shrink, *film], check=True)


AGENTS = [row.id for row in ENVIRONMENTS if (PUBLISHED / row.id).is_dir()]
MAKERS = dict.fromkeys(names(), scene) | dict.fromkeys(AGENTS, environment)
"""Functions that make the film of a scene or of an environment, by its name."""

if __name__ == "__main__":
    if unknown := sorted(set(sys.argv[1:]) - MAKERS.keys()):
        sys.exit(f"{unknown[0]!r} is neither a scene nor an environment")
    (HERE / "_media").mkdir(exist_ok=True)
    for own in sys.argv[1:]:
        MAKERS[own](own, HERE / "_media")
