"""The habits of the project: what is written down in several places says the same."""

from __future__ import annotations

import re
import subprocess
import sys
import tomllib
from pathlib import Path
from typing import Any

import pytest
import yaml

import springgym

ROOT = Path(__file__).parents[1]
TEMPLATES = sorted((ROOT / ".github" / "ISSUE_TEMPLATE").glob("*.yml"))


def project() -> dict[str, Any]:
    with (ROOT / "pyproject.toml").open("rb") as file:
        found: dict[str, Any] = tomllib.load(file)["project"]
    return found


def text(path: str) -> str:
    return (ROOT / path).read_text(encoding="utf-8")


def test_version_is_one() -> None:
    version = project()["version"]
    assert springgym.__version__ == version
    assert yaml.safe_load(text("CITATION.cff"))["version"] == version
    assert f"version = {{{version}}}" in text("docs/citing.md")
    assert f"\n## {version}" in text("CHANGELOG.md")


def test_citation_has_what_its_format_asks_for() -> None:
    citation = yaml.safe_load(text("CITATION.cff"))
    assert citation["cff-version"] == "1.2.0"
    assert all(citation[key] for key in ("message", "title", "authors"))
    assert citation["license"] == project()["license"]
    assert re.fullmatch(r"\d{4}-\d\d-\d\d", citation["date-released"])


@pytest.mark.parametrize("path", TEMPLATES, ids=lambda path: path.stem)
def test_issue_forms_are_complete(path: Path) -> None:
    form = yaml.safe_load(path.read_text(encoding="utf-8"))
    assert {"name", "description", "body"} <= form.keys()
    for field in form["body"]:
        assert field["type"] in ("textarea", "input")
        assert field["attributes"]["label"]


def test_every_extra_is_explained() -> None:
    explained = set(re.findall(r"`(\w+)`", text("docs/start.md")))
    assert project()["optional-dependencies"].keys() <= explained


@pytest.mark.slow
@pytest.mark.timeout(1800)
def test_site_builds_without_a_warning_and_needs_no_other_host(tmp_path: Path) -> None:
    pytest.importorskip("sphinx")
    command = [sys.executable, "docs/build.py", "--no-media", "--out", str(tmp_path)]
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stdout + done.stderr
    pages = list(tmp_path.rglob("*.html"))
    assert len(pages) > 40
    for page in pages:
        loaded = re.findall(
            r'<(?:script|img|video|source|iframe)[^>]*?src="([^"]+)"|<link[^>]*?href="([^"]+)"',
            page.read_text(encoding="utf-8"),
        )
        assert [url for pair in loaded for url in pair if re.match(r"(https?:)?//", url)] == [], page
