"""Readme and site: their code runs, their commands are understood, and what they name is there.

A page's ``python`` blocks run in order, in one namespace and an empty folder. A ``text`` block right after
one is what it prints. A ``yaml`` block that starts with ``# NAME.yaml`` is saved under that name first.
"""

from __future__ import annotations

import ast
import contextlib
import doctest
import io
import json
import re
import shlex
import subprocess
import sys
import tomllib
from collections.abc import Iterator
from importlib import import_module
from pathlib import Path
from typing import Any, NamedTuple

import gymnasium as gym
import pytest

from springgym import cli
from springgym.scenes import load, names
from springgym.scenes.reading import document
from tests.params import slow_unless
from tests.test_docs import page_writer

ROOT = Path(__file__).parents[1]
DOCS = ROOT / "docs"
MADE = ("_build", "_media", "api")
"""Folders of ``docs`` that building the site makes."""

PAGES = sorted(
    [*ROOT.glob("*.md"), *(p for p in DOCS.rglob("*.md") if p.relative_to(DOCS).parts[0] not in MADE)]
)
NOTEBOOKS = sorted((DOCS / "notebooks").glob("*.ipynb"))
SLOW = {
    *("SpringDuel-v0.md", "features.md", "force.md", "scene.md", "surface.md", "training.md", "why.md"),
    *(path.name for path in NOTEBOOKS),
}
"""Pages whose code takes long."""

RUNNER = page_writer("notebooks")
MEASURED = page_writer().MEASURED

FENCE = re.compile(r"^(`{3,})([^\n`]*)\n(.*?)^\1`*\s*$", re.MULTILINE | re.DOTALL)


class Block(NamedTuple):
    """A fenced block of a page."""

    line: int
    language: str
    text: str
    printed: str | None
    """the text block right after it"""


def blocks(page: Path) -> list[Block]:
    source = page.read_text(encoding="utf-8")
    found = list(FENCE.finditer(source))
    listed = []
    for n, match in enumerate(found):
        follower = found[n + 1] if n + 1 < len(found) else None
        follows = follower is not None and not source[match.end() : follower.start()].strip()
        printed = follower[3] if follower is not None and follows and follower[2].strip() == "text" else None
        line = source.count("\n", 0, match.start()) + 2
        listed.append(Block(line, match[2].strip(), match[3], printed))
    return listed


def cases(pages: list[Path], runs: bool = False) -> list[Any]:
    """Return a test parameter for each page; with ``runs``, mark those of the pages in `SLOW` as slow."""
    return [
        pytest.param(p, id=str(p.relative_to(ROOT)), marks=slow_unless(not runs or p.name not in SLOW))
        for p in pages
    ]


# --- Code ---------------------------------------------------------------------------------------------


def run(code: str, name: str, line: int, namespace: dict[str, Any]) -> str:
    """Run code of a page and return its output; errors name the page and the line."""
    tree = ast.parse(code, name)
    ast.increment_lineno(tree, line - 1)
    printed = io.StringIO()
    with contextlib.redirect_stdout(printed):
        exec(compile(tree, name, "exec"), namespace)
    return printed.getvalue()


@pytest.mark.parametrize(
    "page", cases([p for p in PAGES if any(b.language == "python" for b in blocks(p))], True)
)
@pytest.mark.usefixtures("own_ids")
def test_code_of_a_page_runs(page: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    namespace: dict[str, Any] = {"__name__": "__main__"}
    for block in blocks(page):
        if block.language == "yaml" and (name := re.match(r"# (\S+\.yaml)\n", block.text)):
            (tmp_path / name[1]).write_text(block.text, encoding="utf-8")
        if block.language != "python":
            continue
        printed = run(block.text, str(page), block.line, namespace)
        if block.printed is not None:
            same = doctest.OutputChecker().check_output(block.printed, printed, doctest.ELLIPSIS)
            assert same, f"{page}, line {block.line} prints\n{printed}in place of\n{block.printed}"


@pytest.mark.parametrize("notebook", cases(NOTEBOOKS, True))
def test_code_of_a_notebook_runs(notebook: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    pytest.importorskip("IPython")
    monkeypatch.chdir(tmp_path)
    namespace: dict[str, Any] = {"__name__": "__main__"}
    for n, code in enumerate(cells(notebook)):
        run(code, f"{notebook}, code cell {n}", 1, namespace)


def cells(notebook: Path) -> list[str]:
    """Return the code that is run; the cells that install the package are not."""
    return RUNNER.code_cells(json.loads(notebook.read_text(encoding="utf-8")))


@pytest.mark.parametrize("notebook", NOTEBOOKS, ids=lambda path: path.name)
def test_notebook_has_the_outputs_of_its_code(notebook: Path) -> None:
    """Run ``python docs/notebooks.py`` after changing a notebook."""
    found = json.loads(notebook.read_text(encoding="utf-8"))
    assert found["metadata"]["springgym"]["code"] == RUNNER.digest(found)
    assert notebook.stat().st_size < 250_000
    ran = [cell for cell in found["cells"] if cell.get("execution_count")]
    assert ["".join(cell["source"]) for cell in ran] == cells(notebook)
    kinds = [output["output_type"] for cell in ran for output in cell["outputs"]]
    assert "error" not in kinds
    assert {"display_data", "stream"} <= {*kinds}


@pytest.mark.parametrize("page", cases([p for p in PAGES if any(b.language == "yaml" for b in blocks(p))]))
def test_scene_files_of_a_page_load(page: Path, tmp_path: Path) -> None:
    for block in blocks(page):
        if block.language == "yaml" and re.search(r"^body:", block.text, re.MULTILINE):
            (tmp_path / "scene.yaml").write_text(block.text, encoding="utf-8")
            load(str(tmp_path / "scene.yaml"))


# --- Commands -----------------------------------------------------------------------------------------


def commands(page: Path) -> Iterator[tuple[str, list[str]]]:
    """Lines of shell blocks, one command each, and their words."""
    for block in blocks(page):
        if block.language in ("sh", "console", "bash"):
            for line in block.text.replace("\\\n", " ").splitlines():
                for part in line.split("&&"):
                    if words := shlex.split(part.removeprefix("$ "), comments=True):
                        yield line, words


def declarations(script: Path) -> str:
    """The text that declares the options of a script: its own, and that of the option it shares."""
    text = script.read_text(encoding="utf-8")
    return text + (ROOT / "agents/config.py").read_text(encoding="utf-8") * ("add_overrides(" in text)


def extras() -> set[str]:
    with (ROOT / "pyproject.toml").open("rb") as file:
        return set(tomllib.load(file)["project"]["optional-dependencies"])


@pytest.mark.parametrize("page", cases([p for p in PAGES if any(b.language == "sh" for b in blocks(p))]))
def test_commands_of_a_page_are_understood(page: Path) -> None:
    """Those of springgym by its own parser; scripts are there and have the options."""
    for line, words in commands(page):
        program = Path(words[0]).name
        name = words[1] if len(words) > 1 else ""
        script = ROOT / (f"agents/{name}.py" if name in cli.SCRIPTS else name)
        if measures := name == "-m" and words[2].startswith("benchmarks."):
            script = (ROOT / words[2].replace(".", "/")).with_suffix(".py")
            assert script.exists(), line
        if program == "springgym" and name not in cli.SCRIPTS:
            arguments = cli._parser(words[1]).parse_args(words[1:])
            if scene := getattr(arguments, "scene", None):
                assert scene in names() or scene.endswith((".yaml", ".yml")), line
        elif program == "springgym" or measures or (program.startswith("python") and name.endswith(".py")):
            for option in (word for word in words[2:] if word.startswith("--")):
                assert f'"{option}"' in declarations(script), line
        elif program.startswith("pip") or words[1:3] == ["-m", "pip"]:
            for named in re.findall(r"\[([\w,]+)\]", line):
                assert set(named.split(",")) <= extras(), line


# --- Names --------------------------------------------------------------------------------------------


def resolve(name: str) -> None:
    """Import the longest part of a dotted name that is a module, and follow the rest."""
    parts = name.split(".")
    for count in range(len(parts), 0, -1):
        try:
            thing = import_module(".".join(parts[:count]))
        except ModuleNotFoundError:
            continue
        for part in parts[count:]:
            thing = getattr(thing, part)
        return


@pytest.mark.parametrize("page", cases(PAGES))
def test_names_of_a_page_are_there(page: Path) -> None:
    text = FENCE.sub("", page.read_text(encoding="utf-8"))
    for name in set(re.findall(r"`(springgym(?:\.\w+)+)", text)):
        resolve(name)
    for env_id in set(re.findall(r"\bSpring\w+-v\d+\b", page.read_text(encoding="utf-8"))):
        assert env_id in gym.registry, env_id
    for path in set(re.findall(r"`((?:springgym|docs|tests|agents|benchmarks|configs)/[\w/.-]+)`", text)):
        assert (ROOT / path).exists() or path.startswith("docs/_build"), path


BY_PACKAGE = """
import sys
for names in sys.argv[1:]:
    for module in [module for module in sys.modules if module.partition(".")[0] == "springgym"]:
        del sys.modules[module]
    import springgym
    for name in names.split():
        try:
            eval(name)
        except AttributeError as error:
            print(error)
"""
"""Evaluates the names of each package after ``import springgym`` alone, and prints what is not there."""


def package_of(name: str) -> str:
    """Return the innermost package that a dotted name looks into."""
    inner, _, _ = name.rpartition(".")
    while not (ROOT.joinpath(*inner.split(".")) / "__init__.py").is_file():
        inner, _, _ = inner.rpartition(".")
    return inner


def test_names_of_all_pages_work_after_import_springgym() -> None:
    """As in ``import springgym; springgym.envs.parallel(…)``; in code as in sentences."""
    texts = [page.read_text(encoding="utf-8") for page in PAGES]
    found = {name for text in texts for name in re.findall(r"(?<![\w/.-])springgym(?:\.[A-Za-z_]\w*)+", text)}
    packages: dict[str, list[str]] = {}
    for name in sorted(found):
        packages.setdefault(package_of(name), []).append(name)
    assert {"springgym", "springgym.envs", "springgym.scenes.checks"} <= packages.keys()
    command = [sys.executable, "-c", BY_PACKAGE, *map(" ".join, packages.values())]
    assert subprocess.run(command, capture_output=True, text=True, check=True).stdout == ""


POSTER = re.compile(
    r"!\[([^]]+)\]\((?:\.\./)?figures/posters/([\w-]+)\.webp\)(?:<br>`springgym view ([\w-]+)`)?"
)
"""A picture out of a film, with its caption; of a scene, with the command that shows the scene."""


def test_every_scene_has_its_place_in_the_course() -> None:
    """Add a new scene to a page of ``docs/course``: why it moves so, a formula, its poster and command.

    ``python docs/figures.py posters`` makes the poster, once ``python docs/build.py`` has made the film.
    """
    text = "".join(page.read_text(encoding="utf-8") for page in (DOCS / "course").glob("*.md"))
    shown = {poster: (caption, command) for caption, poster, command in POSTER.findall(text)}
    titles = {name: document(name).value["title"] for name in names()}
    assert shown == {name: (f"{title[0].upper()}{title[1:]}.", name) for name, title in titles.items()}


def test_every_environment_is_on_the_front_page() -> None:
    shown = [poster for _, poster, _ in POSTER.findall((DOCS / "index.md").read_text(encoding="utf-8"))]
    assert shown == [row.id for row in MEASURED]


def test_posters_are_small_and_of_what_there_is() -> None:
    posters = {path.stem: path.stat().st_size for path in (DOCS / "figures" / "posters").iterdir()}
    assert posters.keys() == {*names(), *(row.id for row in MEASURED)}
    assert max(posters.values()) < 30_000
