"""What an installation finds: an editable one the package, an sdist all that its tests need."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
import tarfile
import zipfile
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
NOT_SOURCE = shutil.ignore_patterns(".*", "*.egg-info", "__pycache__", "build", "dist", "runs", "out", "venv")


@pytest.fixture(scope="module")
def clone(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A copy of the repository in a folder ``springgym``."""
    if not (ROOT / "pyproject.toml").exists():
        pytest.skip("this is not the repository")
    pytest.importorskip("setuptools", minversion="77")
    return Path(shutil.copytree(ROOT, tmp_path_factory.mktemp("parent") / "springgym", ignore=NOT_SOURCE))


def built(kind: str, clone: Path, folder: Path) -> Path:
    """What setuptools makes of the clone."""
    code = f"import sys; from setuptools import build_meta; build_meta.build_{kind}(sys.argv[1])"
    subprocess.run([sys.executable, "-c", code, str(folder)], cwd=clone, check=True, capture_output=True)
    (made,) = folder.iterdir()
    return made


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
    wanted = [
        str(path.relative_to(clone))
        for folder in ("agents", "configs", "docs", "springgym", "tests")
        for path in (clone / folder).rglob("*")
        if path.is_file() and "__pycache__" not in path.parts and path.suffix != ".pyc"
    ]
    assert len(wanted) > 100
    assert sorted(set(wanted) - names) == []
    assert {"constraints.txt", "pyproject.toml", "README.md", "LICENSE"} <= names
