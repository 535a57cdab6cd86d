"""What an installation finds: an editable one the package, an sdist all that its tests need."""

from __future__ import annotations

import json
import os
import re
import shutil
import subprocess
import sys
import tarfile
import tomllib
import zipfile
from contextlib import suppress
from importlib.metadata import PackageNotFoundError, requires
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
NOT_SOURCE = shutil.ignore_patterns(
    *(".git", ".venv", ".*cache", ".hypothesis", ".nox", "*.egg-info", "__pycache__", "*.pyc"),
    *("build", "dist", "runs", "out", "venv", "_build", "_media"),
)


@pytest.fixture(scope="module")
def clone(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A copy of the repository in a folder ``springgym``."""
    if not (ROOT / "pyproject.toml").exists():
        pytest.skip("this is not the repository")
    pytest.importorskip("setuptools", minversion="77")
    return Path(shutil.copytree(ROOT, tmp_path_factory.mktemp("parent") / "springgym", ignore=NOT_SOURCE))


def built(kind: str, clone: Path, folder: Path) -> Path:
    """Return what setuptools makes of the clone."""
    code = f"import sys; from setuptools import build_meta; build_meta.build_{kind}(sys.argv[1])"
    subprocess.run([sys.executable, "-c", code, str(folder)], cwd=clone, check=True, capture_output=True)
    (made,) = folder.iterdir()
    return made


def files(folder: Path) -> set[str]:
    """Those in a folder, by their paths from it."""
    return {path.relative_to(folder).as_posix() for path in folder.rglob("*") if path.is_file()}


@pytest.mark.slow
def test_an_editable_install_wins_over_the_folder_that_holds_the_clone(clone: Path, tmp_path: Path) -> None:
    """Without ``__init__.py`` a folder ``springgym`` is a package too, if there is no other on the path."""
    site = tmp_path / "site"
    with zipfile.ZipFile(built("editable", clone, tmp_path / "wheel")) as wheel:
        wheel.extractall(site)
    code = f"import site; site.addsitedir({str(site)!r}); from importlib.util import find_spec"
    found = subprocess.run(
        [sys.executable, "-S", "-c", f"{code}; print(find_spec('springgym').origin)"],
        cwd=clone.parent,
        env={key: value for key, value in os.environ.items() if key != "PYTHONPATH"},
        capture_output=True,
        text=True,
        check=True,
    )
    assert found.stdout.strip() == str(clone / "springgym" / "__init__.py")


@pytest.mark.slow
def test_an_sdist_holds_what_its_tests_need(clone: Path, tmp_path: Path) -> None:
    with tarfile.open(built("sdist", clone, tmp_path / "dist")) as archive:
        names = {name.partition("/")[2] for name in archive.getnames()}
    wanted = {path for path in files(clone) if not path.startswith("docs/api/") and ".egg-info/" not in path}
    assert {"CHANGELOG.md", "CONTRIBUTING.md", "CITATION.cff", "agents/train.py", ".ci/run"} <= wanted
    assert sorted(wanted - names) == []


@pytest.mark.slow
def test_a_wheel_trains(clone: Path, tmp_path: Path) -> None:
    """It holds scripts, configurations and published agents, which its commands find wherever it lies."""
    site = tmp_path / "site"
    folder = tmp_path / "elsewhere"
    folder.mkdir()
    with zipfile.ZipFile(built("wheel", clone, tmp_path / "wheel")) as wheel:
        wheel.extractall(site)
    for kind in ("agents", "configs"):
        assert files(site / "springgym" / kind) == files(clone / kind)
    metadata = next(site.glob("*.dist-info/METADATA")).read_text(encoding="utf-8")
    # links are whole once there is an address
    assert ("](docs/" in metadata) == ("\nProject-URL: Source" not in metadata)

    def springgym(*words: str) -> str:
        code = "import sys; from springgym import cli; assert cli.__file__.startswith(sys.argv.pop(1)); "
        done = subprocess.run(
            [sys.executable, "-P", "-c", code + "sys.exit(cli.main())", str(site), *words],
            cwd=folder,
            env=os.environ | {"PYTHONPATH": str(site)},
            capture_output=True,
            text=True,
            check=False,
        )
        assert done.returncode == 0, done.stderr
        return done.stdout

    assert "\nSpringTop-v0  " in springgym("evaluate", "SpringTop-v0", "--episodes", "2")
    brief = ["n_envs=4", "n_steps=64", "batch_size=64", "total_timesteps=256"]
    assert "-ppo-0" in springgym("train", "SpringTop-v0", "--episodes", "2", "--set", *brief)
    run = folder / "runs" / "SpringTop-v0-ppo-0"
    assert json.loads((run / "versions.json").read_text())["git_revision"] is None
    springgym("watch", "SpringTop-v0", "--out", "top.gif", "--set", "max_episode_steps=20")
    assert (folder / "top.gif").read_bytes().startswith(b"GIF8")


def needed(packages: list[str], found: set[str]) -> set[str]:
    """The names of packages and of all that they depend on, without extras."""
    for wanted in packages:
        name = re.split(r"[^\w.-]", wanted)[0].lower().replace("_", "-")
        if "extra ==" not in wanted and name not in found:
            found.add(name)
            with suppress(PackageNotFoundError):  # which other systems or versions of Python need
                needed(requires(name) or [], found)
    return found


ALONE = """
import sys
from importlib.metadata import packages_distributions
import numpy as np
needed = set(sys.argv[1].split(","))
names = packages_distributions().items()
own = {name for name, of in names for each in of if each.lower().replace("_", "-") in needed}
others = dict(names).keys() - own
class Absent:
    def find_spec(self, name, path=None, target=None):
        if name.partition(".")[0] in others:
            raise ModuleNotFoundError(f"No module named {name!r}", name=name)
sys.meta_path.insert(0, Absent())
import springgym
from springgym.cli import main
agent = springgym.load_agent("SpringTop-v0")
env = agent.make()
assert agent.policy(env)(np.zeros(env.observation_space.shape)).shape == env.action_space.shape
assert main(["simulate", "--list"]) == 0
assert main(["view", "top"]) == 2
"""


def test_the_package_alone_loads_agents_and_lists_scenes() -> None:
    """Nothing else can be imported than what it depends on; the view says what to install."""
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    names = ",".join(needed(project["dependencies"], {"springgym"}))
    done = subprocess.run([sys.executable, "-c", ALONE, names], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    assert "\nrattleback " in done.stdout
    assert "view]" in done.stderr
