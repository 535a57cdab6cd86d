"""Rehearse the release of a tag: from a clone to an index on disk, and from there into clean environments.

    python tools/rehearse.py v0.2.0                                  # what the workflows do, but publishing
    python tools/rehearse.py v0.2.0 --python python3.11 python3.13   # first steps on these, too
    python tools/rehearse.py v0.2.0 --ids SpringTop-v0 SpringRope-v0 # compiled code of these environments
    python tools/rehearse.py v0.2.0 --site                           # the site, films included: ten minutes
    python tools/rehearse.py v0.2.0 --cache FOLDER                   # compiled code is kept there

The clone is of what is committed here. In it alone, the addresses get an owner and the changelog a date if
they have none. The first command that fails ends the rehearsal; else a table tells how long each took.
"""

from __future__ import annotations

import argparse
import os
import re
import shutil
import subprocess
import sys
import tarfile
import time
from collections.abc import Sequence
from datetime import date
from pathlib import Path

from release import DATE, HEADING

ROOT = Path(__file__).resolve().parents[1]
STEPS = ROOT / "tools" / "first_steps.py"
"""First steps that need no extra."""
LOWEST = {"gymnasium": "1.2.2", "numpy": "1.26.0", "numba": "0.62.0", "pyyaml": "6.0", "tqdm": "4.66.0"}
"""Lower bounds of what the package depends on."""
LOWEST_ON = (3, 11)
"""Python that these have wheels for."""
AT_ONCE = """
import os, sys
import gymnasium, springgym
for name in sys.argv[1:]:
    env = gymnasium.make(name)
    env.reset(seed=0)
    env.step(env.action_space.sample())
assert not os.path.exists(os.environ["SPRINGGYM_CACHE_DIR"]), "something was compiled"
"""
EVERY = """
import math, time
import gymnasium, springgym
from springgym.envs.registration import ALL_IDS
for env_id in ALL_IDS:
    begun = time.perf_counter()
    env = gymnasium.make(env_id)
    env.reset(seed=0)
    observation, reward, *_ = env.step(env.action_space.sample())
    assert math.isfinite(reward) and observation in env.observation_space, env_id
    print(f"{env_id:26} {time.perf_counter() - begun:6.1f} s, reward {reward:.3f}", flush=True)
"""
TESTS = (
    "tests/test_project.py",
    "tests/test_layers.py",
    "tests/test_types.py",
    "tests/test_docs.py",
    "tests/test_pages.py",
    "tests/test_strict_yaml.py",
    "tests/agents/test_config.py",
    "tests/bodies",
    "tests/theory",
)
"""The tests that run from the sdist: some of the project, the scripts and the package."""
SKIPPED = "code_of_a_page"
"""The tests among them that do not run, because they compile for minutes."""


class Rehearsal:
    """Run commands in a folder of their own, and keep how long they took.

    Parameters
    ----------
    folder
        Where everything is written.
    cache
        Where compiled code is kept, but that of first steps.
    """

    def __init__(self, folder: Path, cache: Path) -> None:
        self.folder = folder
        self.cache = cache
        self.took: list[tuple[str, float]] = []
        hidden = ("PYTHONPATH", "VIRTUAL_ENV")
        self._environment = {name: value for name, value in os.environ.items() if name not in hidden}
        self._environment |= {"SDL_VIDEODRIVER": "dummy", "MPLBACKEND": "agg"}

    def run(self, what: str, *command: object, cwd: Path | None = None, cache: str | None = None) -> None:
        """Run a command; its output is shown. ``cache`` is a folder of its own for its compiled code.

        Raises
        ------
        SystemExit
            If it fails.
        """
        print(f"\n== {what}: {' '.join(map(str, command))[:160]}", flush=True)
        environment = self._environment | {
            "SPRINGGYM_CACHE_DIR": str(self.folder / cache if cache else self.cache)
        }
        begun = time.perf_counter()
        done = subprocess.run([*map(str, command)], cwd=cwd or self.folder, env=environment)
        self.took.append((what, time.perf_counter() - begun))
        if done.returncode:
            self.tell()
            raise SystemExit(f"rehearse.py: {what} failed; everything is in {self.folder}")

    def tell(self) -> None:
        """Print how long everything took."""
        print(f"\n{'seconds':>8}")
        for what, seconds in self.took:
            print(f"{seconds:8.1f}  {what}")

    def environment(self, name: str, python: str = sys.executable) -> Path:
        """Make a clean virtual environment, and return its interpreter."""
        folder = self.folder / name
        self.run(f"{name}: an empty environment", python, "-m", "venv", folder)
        return folder / ("Scripts/python.exe" if os.name == "nt" else "bin/python")

    def install(self, what: str, python: Path, *arguments: object) -> None:
        """Install into an environment, by uv where there is one."""
        uv = shutil.which("uv")
        installer = (
            [uv, "pip", "install", "--python", python] if uv else [python, "-m", "pip", "install", "-q"]
        )
        self.run(what, *installer, *arguments)


def tagged(at: Rehearsal, tag: str) -> Path:
    """Return a clone with this tag, in which what a release asks for is set."""
    clone = at.folder / "clone"
    at.run("clone", "git", "clone", "--quiet", ROOT, clone)
    log = clone / "CHANGELOG.md"

    def dated(heading: re.Match[str]) -> str:
        known = heading[1] != tag.removeprefix("v") or DATE.fullmatch(heading[2])
        return heading[0] if known else f"## {heading[1]} ({date.today()})"

    log.write_text(HEADING.sub(dated, log.read_text("utf-8")), "utf-8")
    here = ("--address", "https://github.com/rehearsal/springgym")
    at.run("addresses, date", sys.executable, "tools/release.py", "--write", *here, cwd=clone)
    who = ["-c", "user.name=rehearsal", "-c", "user.email=rehearsal@example.org"]
    at.run("commit", "git", *who, "commit", "--quiet", "--all", "--allow-empty", "-m", tag, cwd=clone)
    at.run("tag", "git", *who, "tag", "-a", tag, "-m", tag, cwd=clone)
    return clone


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command line, and return the exit status."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("tag", help="the tag to rehearse, such as v0.2.0")
    parser.add_argument("--python", nargs="*", default=[], metavar="P", help="interpreters for first steps")
    parser.add_argument(
        "--ids", nargs="+", default=["SpringTop-v0"], metavar="ID", help="environments to compile in advance"
    )
    parser.add_argument("--site", action="store_true", help="build the site with its films")
    parser.add_argument(
        "--out", type=Path, default=ROOT / "build" / "rehearsal", metavar="FOLDER", help="what it leaves"
    )
    parser.add_argument(
        "--cache", type=Path, metavar="FOLDER", help="where compiled code is kept; by default it is new"
    )
    options = parser.parse_args(arguments)
    folder = options.out.resolve()
    shutil.rmtree(folder, ignore_errors=True)
    folder.mkdir(parents=True)
    at = Rehearsal(folder, (options.cache or folder / "cache").resolve())

    clone = tagged(at, options.tag)
    at.run(
        "check and notes",
        sys.executable,
        "tools/release.py",
        options.tag,
        "--notes",
        folder / "notes.md",
        cwd=clone,
    )
    nox = (sys.executable, "-m", "nox", "-s")
    at.run("sdist, wheel", *nox, "package", cwd=clone)
    at.run("wheel of compiled code", *nox, "kernels", "--", *options.ids, cwd=clone)
    index = clone / "dist"
    pins = clone / "constraints.txt"
    here = ("--no-index", "--no-deps", "--find-links", index, f"springgym=={options.tag.removeprefix('v')}")

    user = at.environment("user")
    at.install("user: the wheel, from the index", user, *here)
    (wheel,) = index.glob("springgym-*.whl")
    at.install("user: what it needs", user, "-c", pins, wheel)

    def command(what: str, words: str) -> None:
        at.run(what, user.with_name("springgym"), *words.split())

    at.run("user: first steps", user, STEPS, cache="cache-first")
    (compiled,) = index.glob("springgym_kernels-*.whl")
    at.install("user: compiled code", user, compiled)
    at.run("user: first step at once", user, "-c", AT_ONCE, *options.ids, cache="cache-not-used")
    at.install("user: extras", user, "-c", pins, f"{wheel}[agents,scenes,plot,render]")
    at.run("user: a first step of every environment", user, "-c", EVERY)
    command("user: first agent", "train SpringTop-v0 --timesteps 20000 --episodes 10")
    command("user: evaluate", "evaluate SpringTop-v0 noop --episodes 10")
    command("user: first film", "watch SpringTop-v0 --out agent.mp4")
    command("user: first scene", "simulate top --plot top.png --video top.mp4 --check")

    (sdist,) = index.glob("*.tar.gz")
    with tarfile.open(sdist) as packed:
        packed.extractall(folder, filter="data")
    source = folder / sdist.name.removesuffix(".tar.gz")
    developer = at.environment("developer")
    at.install("developer: the sdist", developer, "-c", pins, "-e", f"{source}[test,docs]")
    at.run(
        "developer: some tests", developer, "-m", "pytest", "-q", "-k", f"not {SKIPPED}", *TESTS, cwd=source
    )
    media = [] if options.site else ["--no-media"]
    at.run("developer: the site", developer, "docs/build.py", *media, cwd=source)

    for number, python in enumerate(options.python):
        newest = at.environment(f"{number}-newest", python)
        at.install(f"{python}: the wheel, newest versions", newest, wheel)
        at.run(f"{python}: first step", newest, STEPS, cache=f"cache-{number}")
        asked = "import sys; print(*sys.version_info[:2])"
        told = subprocess.run([newest, "-c", asked], capture_output=True, text=True, check=True).stdout
        if tuple(map(int, told.split())) == LOWEST_ON:
            lowest = at.environment(f"{number}-lowest", python)
            at.install(f"{python}: lower bounds", lowest, wheel, *(f"{a}=={b}" for a, b in LOWEST.items()))
            at.run(f"{python}: first step on lower bounds", lowest, STEPS, cache=f"cache-{number}-low")
    at.tell()
    return 0


if __name__ == "__main__":
    sys.exit(main())
