"""Tell setuptools what pyproject.toml cannot: the scripts within the package, and the README as it is
uploaded."""

from __future__ import annotations

import shutil
import sys
from pathlib import Path

from setuptools import setup
from setuptools.command.build_py import build_py

ROOT = Path(__file__).resolve().parent
sys.path.insert(0, str(ROOT / "tools"))

from release import text, with_addresses  # noqa: E402


class BuildWithScripts(build_py):
    """Builds the package with a copy of the scripts, their configurations and the published agents."""

    def run(self) -> None:
        """Copy scripts after the modules; an editable package has them beside it."""
        super().run()
        for folder in () if self.editable_mode else ("agents", "configs"):
            copy = Path(self.build_lib) / "springgym" / folder
            left_out = shutil.ignore_patterns("__pycache__", "*.pyc")
            shutil.copytree(ROOT / folder, copy, ignore=left_out, dirs_exist_ok=True)


setup(
    cmdclass={"build_py": BuildWithScripts},
    long_description=with_addresses(text("README.md")),
    long_description_content_type="text/markdown",
)
