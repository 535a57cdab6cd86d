"""The habits of the project: what is written down in several places says the same."""

from __future__ import annotations

import json
import os
import re
import shutil
import subprocess
import sys
import tomllib
from pathlib import Path
from typing import Any

import pytest
import yaml

import springgym

ROOT = Path(__file__).parents[1]
WORKFLOWS = sorted((ROOT / ".github" / "workflows").glob("*.yml"))
sys.path.insert(0, str(ROOT / "tools"))

import readme_commands  # noqa: E402
import rehearse  # noqa: E402
import release  # noqa: E402


def project() -> dict[str, Any]:
    with (ROOT / "pyproject.toml").open("rb") as file:
        found: dict[str, Any] = tomllib.load(file)["project"]
    return found


ADDRESS = "https://github.com/mcd/springgym"
COLAB = release.COLAB
AUTHOR = project()["authors"][0]["name"]


def text(path: str) -> str:
    return (ROOT / path).read_text(encoding="utf-8")


def test_version_authors_and_address_are_set_once() -> None:
    """If this fails: ``python tools/release.py --write``."""
    version = springgym.__version__
    assert release.version() == version
    assert yaml.safe_load(text("CITATION.cff"))["version"] == version
    assert f"version = {{{version}}}" in text("docs/citing.md")
    assert f"\n## {version} (" in text("CHANGELOG.md")
    for path, wanted in release.repeated().items():
        assert text(path) == wanted, path


def test_addresses_stand_where_the_release_writes_them_and_nowhere_else() -> None:
    kinds = ("*.md", "*.py", "*.toml", "*.cff", "*.yml", "*.ipynb")
    folders = (".github", "agents", "configs", "docs", "springgym")
    places = [*(path for kind in kinds for path in ROOT.glob(kind))]
    places += [path for folder in folders for kind in kinds for path in (ROOT / folder).rglob(kind)]
    assert len(places) > 300
    own = re.compile(r"OWNER|github(\.com)?/[\w-]+/springgym|[\w-]+\.github\.io/springgym")
    holding = {
        path.relative_to(ROOT).as_posix()
        for path in places
        if "_build" not in path.parts and own.search(path.read_text(encoding="utf-8"))
    }
    written = {"pyproject.toml", "CITATION.cff", "docs/citing.md", COLAB}
    assert holding == (written if release.source() else set())


@pytest.fixture
def to_release(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A tree that can be released as v1.2.3, but for what a test does to it."""
    pages = ("CHANGELOG.md", "CITATION.cff", "README.md", "docs/citing.md", "docs/start.md", COLAB)
    for path in ("pyproject.toml", "springgym/version.py", *pages):
        (tmp_path / path).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / path).write_text(text(path), encoding="utf-8")
    (tmp_path / "springgym" / "version.py").write_text('__version__ = "1.2.3"\n')
    log = "## 1.2.3 (2031-02-03)\n\n### Added\n- A [top](docs/top.md).\n\n## 1.2.2 (2030-01-01)\n\n- Old.\n"
    (tmp_path / "CHANGELOG.md").write_text(log)
    monkeypatch.setattr(release, "ROOT", tmp_path)
    assert release.main(["--write", "--address", ADDRESS]) == 0
    return tmp_path


def test_what_can_be_released(to_release: Path, capsys: pytest.CaptureFixture[str]) -> None:
    notes = to_release / "notes.md"
    assert release.main(["v1.2.3", "--notes", str(notes)]) == 0
    assert notes.read_text() == f"### Added\n- A [top]({ADDRESS}/blob/v1.2.3/docs/top.md).\n"
    citation = yaml.safe_load((to_release / "CITATION.cff").read_text())
    assert (citation["version"], citation["date-released"]) == ("1.2.3", "2031-02-03")
    assert (citation["repository-code"], citation["url"]) == (ADDRESS, "https://mcd.github.io/springgym")
    citing = (to_release / "docs" / "citing.md").read_text()
    assert f"version = {{1.2.3}},\n  year    = {{2031}},\n  url     = {{{ADDRESS}}},\n}}" in citing
    urls = tomllib.loads((to_release / "pyproject.toml").read_text())["project"]["urls"]
    assert (urls["Source"], urls["Issues"]) == (ADDRESS, f"{ADDRESS}/issues")
    cell = json.loads((to_release / COLAB).read_text())["cells"][0]["source"]
    assert f"(https://colab.research.google.com/github/mcd/springgym/blob/main/{COLAB})\n" in cell[2]
    assert capsys.readouterr().err == ""


def test_the_address_can_be_written_again(to_release: Path) -> None:
    before = {path: path.read_text() for path in to_release.rglob("*") if path.is_file()}
    assert release.main(["--write", "--address", "https://github.com/other/springs"]) == 0
    assert "/mcd/" not in "".join(path.read_text() for path in before)
    assert release.main(["--write", "--address", ADDRESS]) == 0
    assert {path: path.read_text() for path in before} == before
    for wrong in (["v1.2.3", "--address", ADDRESS], ["--write", "--address", "github.com/mcd"]):
        with pytest.raises(SystemExit):
            release.main(wrong)


@pytest.mark.parametrize("page", ["README.md", "docs/start.md"])
def test_pages_say_that_springgym_is_on_pypi_once_it_is(page: str, to_release: Path) -> None:
    before, after = (f"\n{release.ON_PYPI[released]}\n" for released in (False, True))
    said = (to_release / page).read_text()
    assert after in said
    assert before not in said
    log = to_release / "CHANGELOG.md"
    log.write_text("## 1.2.3 (not released yet)\n\n- A top.\n")
    assert release.main(["--write"]) == 0
    assert (to_release / page).read_text() == said.replace(after, before)
    (to_release / page).write_text(said.replace(after, "\n"))
    with pytest.raises(ValueError, match=re.escape(f"{page} must say once")):
        release.repeated()


@pytest.mark.parametrize(
    ("path", "old", "new", "says"),
    [
        ("pyproject.toml", "[project.urls]", "[tool.urls]", "pyproject.toml has no addresses"),
        ("springgym/version.py", "1.2.3", "1.2.4", "v1.2.3, but springgym/version.py has version 1.2.4"),
        ("CHANGELOG.md", "2031-02-03", "not released yet", "has no heading '## 1.2.3 (YYYY-MM-DD)'"),
        ("CHANGELOG.md", "## 1.2.3", "## Unreleased", "has no heading '## 1.2.3 (YYYY-MM-DD)'"),
        ("CHANGELOG.md", "### Added\n- A [top](docs/top.md).\n", "", "CHANGELOG.md has no entries for 1.2.3"),
        ("CITATION.cff", "1.2.3", "1.2.2", "CITATION.cff has another version, date"),
        ("docs/citing.md", "/mcd/", "/other/", "docs/citing.md has another version, date"),
        ("README.md", release.ON_PYPI[True], release.ON_PYPI[False], "README.md has another version"),
        (COLAB, "github/mcd/springgym/blob", "github/x/springgym/blob", f"{COLAB} has another"),
        ("pyproject.toml", AUTHOR, "J. McDonald", "CITATION.cff has another version, date"),
    ],
)
def test_what_cannot_be_released(
    path: str, old: str, new: str, says: str, to_release: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Above all: an address that nobody has set."""
    before = (to_release / path).read_text(encoding="utf-8")
    assert old in before
    (to_release / path).write_text(before.replace(old, new), encoding="utf-8")
    assert release.main(["v1.2.3", "--notes", str(to_release / "notes.md")]) == 1
    assert says in capsys.readouterr().err
    assert not (to_release / "notes.md").exists()


def test_links_of_what_is_uploaded_are_whole(to_release: Path) -> None:
    uploaded = release.with_addresses(text("README.md"))
    links = re.findall(r'\]\(([^)\s]+)\)|(?:src|href)="([^"]+)"', uploaded)
    assert len(links) > 20
    for one, other in links:
        link = one or other
        assert re.match(r"https?://|#", link), link
        if link.startswith(f"{ADDRESS}/"):
            kind, tag, path = link.removeprefix(f"{ADDRESS}/").split("/", 2)
            assert (kind, tag) == ("raw" if other else "blob", "v1.2.3")
            assert (ROOT / path.partition("#")[0]).exists(), link


def test_the_readme_has_the_commands_of_the_main_job_and_of_the_tests() -> None:
    main, tests = readme_commands.commands(text("README.md"))
    install = '.venv/bin/pip install -c constraints.txt -e ".[{}]" && .venv/bin/{}'
    assert main == f"python3 -m venv .venv && {install.format('agents', 'springgym train SpringTop-v0')}"
    assert tests == install.format("test", "python -m pytest")
    assert {"agents", "test"} <= project()["optional-dependencies"].keys()
    for page in ("README.md", "docs/start.md"):
        (pytorch,) = re.findall(r"pip install (torch==\S+) --index-url", text(page))
        assert f"\n{pytorch}\n" in text("constraints.txt"), page


def block(command: str) -> str:
    return f"Text.\n\n```sh\n{command}\n```\n"


JOB = "echo .venv/springgym train Top"
TESTS = "echo .venv/python -m pytest && {} && echo 2 passed"


def ci_run(folder: Path, *blocks: str) -> subprocess.CompletedProcess[str]:
    """Run the script of continuous integration over another README."""
    for path in (".ci/run", "tools/readme_commands.py"):
        (folder / path).parent.mkdir(parents=True, exist_ok=True)
        shutil.copy(ROOT / path, folder / path)
    (folder / "README.md").write_text("".join(map(block, blocks)), encoding="utf-8")
    command = [shutil.which("bash") or "bash", ".ci/run"]
    return subprocess.run(command, cwd=folder, capture_output=True, text=True, check=False)


@pytest.mark.skipif(os.name == "nt", reason="it is a script of bash")
def test_ci_runs_the_commands_of_the_readme(tmp_path: Path) -> None:
    done = ci_run(tmp_path, JOB, "# Optional\nfalse", TESTS.format("true"))
    assert done.returncode == 0, done.stderr
    told, job, said, tests, last = done.stdout.splitlines()
    venv = tests.removesuffix("/python -m pytest")
    assert told == f"== {JOB}".replace(".venv", venv)
    assert said == f"== {TESTS}".replace(".venv", venv).format("true")
    assert job.startswith(f"{venv}/springgym train Top --timesteps ")
    assert not Path(venv).parent.exists()
    assert last == "2 passed"


@pytest.mark.skipif(os.name == "nt", reason="it is a script of bash")
@pytest.mark.parametrize(
    "blocks",
    [
        (),
        (JOB,),
        (TESTS.format("true"), JOB),
        (JOB, JOB, TESTS.format("true")),
        (f"{JOB}\n{JOB}", TESTS.format("true")),
        (JOB, TESTS.format("false")),
        (f"false && {JOB}", TESTS.format("true")),
    ],
    ids=["nothing", "no tests", "turned round", "three", "two lines", "tests fail", "the job fails"],
)
def test_ci_fails_where_a_command_fails_or_is_missing(blocks: tuple[str, ...], tmp_path: Path) -> None:
    done = ci_run(tmp_path, *blocks)
    assert done.returncode != 0
    assert "2 passed" not in done.stdout.splitlines()


def test_citation_has_what_its_format_asks_for() -> None:
    citation = yaml.safe_load(text("CITATION.cff"))
    assert citation["cff-version"] == "1.2.0"
    assert all(citation[key] for key in ("message", "title", "authors"))
    assert citation["license"] == project()["license"]
    assert ("date-released" in citation) == ("not released yet" not in text("CHANGELOG.md"))


@pytest.mark.parametrize("path", WORKFLOWS, ids=lambda path: path.stem)
def test_workflows_are_careful(path: Path) -> None:
    """They may read, are stopped, do not pile up, and name versions, extras and chores that there are."""
    found = yaml.safe_load(path.read_text(encoding="utf-8"))
    assert {"name", True, "permissions", "concurrency", "jobs"} <= found.keys()  # YAML 1.1 reads `on` as true
    assert found["permissions"] == {"contents": "read"}
    extras = project()["optional-dependencies"].keys()
    chores = set(re.findall(r"@nox.session\ndef (\w+)", text("noxfile.py")))
    for name, job in found["jobs"].items():
        needs = job.get("needs", [])
        assert set([needs] if isinstance(needs, str) else needs) <= found["jobs"].keys(), name
        if "uses" in job:
            assert (ROOT / job["uses"]).is_file()
            continue
        assert 0 < job["timeout-minutes"] <= 360, name
        for step in job["steps"]:
            assert len({"uses", "run"} & step.keys()) == 1, step
            assert re.fullmatch(r"[\w-]+(/[\w-]+)+@[\w./-]+", step.get("uses", "a/b@v1"))
            words = step.get("run", "")
            for named in re.findall(r"\[([a-z,]+)\]", words):
                assert set(named.split(",")) <= extras, words
            for named in re.findall(r"^nox -s ([a-z ]+)$", words, re.MULTILINE):
                assert set(named.split()) <= chores, words


@pytest.mark.skipif(not WORKFLOWS, reason="this is not the repository")
def test_workflows_try_what_is_promised() -> None:
    """The lower bounds of all dependencies, each Python and each system that the classifiers name."""
    jobs = yaml.safe_load(text(".github/workflows/tests.yml"))["jobs"]
    rows = jobs["tests"]["strategy"]["matrix"]["include"]
    (lowest,) = (row["versions"].split() for row in rows if row["what"] == "lower bounds")
    bounds = [re.match(r"(\w+)>=([\d.]+)", wanted) for wanted in project()["dependencies"]]
    assert all(bounds)
    for bound, pinned in zip(bounds, lowest, strict=True):
        assert re.fullmatch(rf"{bound[1]}=={re.escape(bound[2])}(\.0)*", pinned)  # type: ignore[index]
    promised = [classifier.split(" :: ") for classifier in project()["classifiers"]]
    pythons = {words[-1] for words in promised if words[1] == "Python" and "." in words[-1]}
    assert {row["python"] for row in rows} == pythons
    systems = {"ubuntu": "Linux", "macos": "MacOS", "windows": "Windows"}
    assert {systems[row["os"]] for row in rows} == {w[-1] for w in promised if w[0] == "Operating System"}


def test_the_rehearsal_tries_lower_bounds_and_tests_that_there_are() -> None:
    bounds = [re.match(r"(\w+)>=([\d.]+)", wanted) for wanted in project()["dependencies"]]
    lowest = {bound[1]: bound[2] for bound in bounds if bound}
    assert len(bounds) == len(lowest) == len(rehearse.LOWEST)
    for name, version in rehearse.LOWEST.items():
        assert re.fullmatch(rf"{re.escape(lowest[name])}(\.0)*", version), name
    promised = re.search(r">=(\d+)\.(\d+)", project()["requires-python"])
    assert promised
    assert tuple(map(int, promised.groups())) == rehearse.LOWEST_ON
    assert [path for path in rehearse.TESTS if not (ROOT / path).exists()] == []
    assert f"def test_{rehearse.SKIPPED}_runs(" in text("tests/test_pages.py")
    for code in (rehearse.STEPS.read_text(encoding="utf-8"), rehearse.AT_ONCE, rehearse.EVERY):
        compile(code, "rehearse.py", "exec")


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
