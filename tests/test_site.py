"""The site: no docstring of the reference is torn, units stay with numbers, what is cut has a shadow."""

from __future__ import annotations

import ast
import importlib
import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

import springgym
from springgym.scenes.checks import Check
from tests.test_docs import page_writer

DOCS = Path(__file__).parents[1] / "docs"
MODULES = re.findall(r"^   (springgym[\w.]*)$", (DOCS / "api.md").read_text(encoding="utf-8"), re.MULTILINE)

pytestmark = pytest.mark.filterwarnings("ignore:The mapping interface")  # Sphinx's own extensions use it


GATHERS = {"springgym"}
"""Lists names of other modules, whose pages describe them."""

NOT_FOR_USERS = {"springgym.core.compiler.numba_private"}
"""Lists what it takes from Numba."""


@pytest.fixture(scope="module")
def app(tmp_path_factory: pytest.TempPathFactory) -> Any:
    """Sphinx with the settings and the extensions of the site's reference, and one page: the package's."""
    for needed in ("myst_nb", "furo", "sphinx_copybutton", "ziamath"):
        pytest.importorskip(needed)
    from sphinx.application import Sphinx

    folder = tmp_path_factory.mktemp("site")
    (folder / "conf.py").write_text(
        f"import sys\nsys.path.insert(0, {str(DOCS)!r})\n"
        f"__file__ = {str(DOCS / 'conf.py')!r}\n"
        + (DOCS / "conf.py").read_text(encoding="utf-8").replace("from __future__ import annotations", "")
    )
    listed = "\n   ".join(["springgym", *sorted(set(springgym._PUBLIC.values()))])
    (folder / "index.rst").write_text(
        f".. autosummary::\n   :toctree: api\n   :template: module.rst\n\n   {listed}\n"
    )
    unchanged = {"autodoc_preserve_defaults": False}  # else it gives live functions other signatures
    settings = unchanged | {
        "templates_path": [str(DOCS / "_templates")],
        "html_static_path": [],
        "html_favicon": None,
    }
    app = Sphinx(
        folder, folder, folder / "html", folder / "trees", "html", settings, None, warningiserror=True
    )
    app.build()
    return app


def docstrings() -> Iterator[tuple[str, str, list[str]]]:
    """Kind, name and lines of every docstring of a constant, an attribute or a property of the reference."""
    from sphinx.pycode import ModuleAnalyzer

    for module in MODULES:
        analyzer = ModuleAnalyzer.for_module(module)
        analyzer.analyze()
        for (owner, name), lines in analyzer.attr_docs.items():
            yield "attribute" if owner else "data", f"{module}.{owner or ''}.{name}", list(lines)
        for name, thing in vars(importlib.import_module(module)).items():
            if isinstance(thing, type) and thing.__module__ == module:
                for own, value in vars(thing).items():
                    if isinstance(value, property) and value.__doc__:
                        yield "property", f"{module}.{name}.{own}", value.__doc__.splitlines()


def test_no_docstring_is_torn_at_its_colon(app: Any) -> None:
    """Napoleon takes what stands before a colon for a type."""
    found = 0
    for kind, name, lines in docstrings():
        begins = lines[0].split(":")[0]
        found += ":" in lines[0]
        app.events.emit("autodoc-process-docstring", kind, name, None, {}, lines)
        assert not any(line.startswith(":type:") for line in lines), name
        assert lines[0].replace("\\", "").startswith(begins.split("`")[0].replace("\\", "")), name
    assert found > 30


def parsed() -> dict[str, ast.Module]:
    """The syntax trees of springgym's files, by the names of the modules."""
    files = sorted((DOCS.parent / "springgym").rglob("*.py"))
    names = [".".join(path.relative_to(DOCS.parent).with_suffix("").parts) for path in files]
    trees = [ast.parse(path.read_text(encoding="utf-8")) for path in files]
    return dict(zip([name.removesuffix(".__init__") for name in names], trees, strict=True))


def listed(tree: ast.Module) -> list[str] | None:
    """What ``__all__`` of a module lists."""
    for node in tree.body:
        if isinstance(node, ast.Assign) and ast.unparse(node.targets[0]) == "__all__":
            return ast.literal_eval(node.value)  # type: ignore[no-any-return]
    return None


def imported(tree: ast.Module) -> dict[str, tuple[str, str]]:
    """The module and the name there of each name that a module imports."""
    return {
        alias.asname or alias.name: (node.module or "", alias.name)
        for node in ast.walk(tree)
        if isinstance(node, ast.ImportFrom)
        for alias in node.names
    }


def test_the_reference_has_the_modules_that_list_their_names() -> None:
    having = {name for name, tree in parsed().items() if listed(tree) is not None}
    assert sorted(MODULES) == sorted(having - NOT_FOR_USERS)


def test_a_public_name_stands_once() -> None:
    """In one ``__all__``: where it is defined, or in that of the package that users import it from."""
    trees = parsed()
    origins = {name: imported(tree) for name, tree in trees.items()}
    stands: dict[tuple[str, str], str] = {}
    for module in sorted({*MODULES} - GATHERS):
        public = listed(trees[module])
        assert public
        for name in public:
            assert hasattr(importlib.import_module(module), name), f"{module}.{name}"
            assert not name.startswith("_"), f"{module}.{name}"
            home = (module, name)
            while (origin := origins.get(home[0], {}).get(home[1], home)) != home:
                home = origin
            assert stands.setdefault(home, module) == module, f"{home} is in {stands[home]} and in {module}"


def test_dir_shows_the_names_that_users_import() -> None:
    for package in (springgym, springgym.scenes):
        assert {*package.__all__} <= {*dir(package)}
    assert all(f"`{name}`" in (springgym.__doc__ or "") for name in springgym._PUBLIC)


def test_the_first_page_of_the_reference_has_the_names_that_users_import(app: Any) -> None:
    page = (Path(app.outdir) / "api" / "springgym.html").read_text(encoding="utf-8")
    for name in sorted({*springgym.__all__} - {"register"}):
        assert f'href="{springgym._PUBLIC[name]}.html#{springgym._PUBLIC[name]}.{name}"' in page, name
    assert 'id="springgym.register"' in page


def test_pages_of_the_reference_end_with_constants(app: Any) -> None:
    found = 0
    for module in set(springgym._PUBLIC.values()):
        page = (Path(app.outdir) / "api" / f"{module}.html").read_text(encoding="utf-8")
        listed = re.findall(rf'<dt class="[^"]*" id="{re.escape(module)}\.(\w+)"', page)
        assert sorted(listed, key=str.isupper) == listed, module
        assert len(set(listed)) == len(listed) > 0, module
        found += sum(map(str.isupper, listed))
    assert found > 10


@pytest.mark.parametrize(
    ("told", "kept"),
    [
        ("100 % of 4 m", "100~% of 4~m"),
        ("2.5 kg·m²/s, 0.3 N·s, 88 N·m", "2.5~kg·m²/s, 0.3~N·s, 88~N·m"),
        ("50 rad/s (20 ms).", "50~rad/s (20~ms)."),
        ("25 × C++, 1.2 million", "25~× C++, 1.2~million"),
        ("of 3 springs, 4 monkeys, 2 hands", "of 3 springs, 4 monkeys, 2 hands"),
        ("7 s-shaped, top 5 a page", "7 s-shaped, top 5 a page"),
    ],
)
def test_units_stay_with_their_numbers(told: str, kept: str) -> None:
    pytest.importorskip("ziamath")
    assert page_writer("site_extension").BROKEN.sub("~", told) == kept


def test_built_pages_keep_units_with_their_numbers(app: Any) -> None:
    """Also those that the source of numbers writes, which have a comment of HTML before their unit."""
    from docutils import nodes

    paragraph = nodes.paragraph("", "", nodes.Text("100 % of "), nodes.literal("", "4 m"), nodes.Text(" 4"))
    paragraph += [nodes.raw("", "<!--/n-->", format="html"), nodes.Text(" s, 4 s")]
    document = app.env.get_doctree("index").deepcopy()
    document += paragraph
    extension = page_writer("site_extension")
    extension.keep_units(app, document)
    texts = [text.astext() for text in paragraph.findall(nodes.Text)]
    assert texts == ["100\N{NO-BREAK SPACE}% of ", "4 m", " 4", "<!--/n-->", *texts[-1:]]
    assert texts[-1] == "\N{NO-BREAK SPACE}s, 4\N{NO-BREAK SPACE}s"


def test_verdicts_of_the_course_come_first_and_units_once() -> None:
    """A table is as narrow as its numbers allow: on a desktop, the verdicts had no room at the right."""
    pytest.importorskip("imageio_ffmpeg")
    unit = "kg·m²/s"
    each = (Check("change of L", 0.0, 6.3e-13, 2.3e-6, unit), Check("spin", 2.0, 2.1, 0.01, "rad/s"))
    head, *rows = page_writer("media").rows(each)
    assert [row[0] for row in rows] == ["ok", "FAILED"]
    assert all(len(row) == len(head) for row in rows)
    assert [cell for cell in rows[0] if unit in cell] == [unit]
    assert rows[1][-2:] == ["5 %", "0.5 %"]


def test_all_that_scrolls_has_a_shadow_at_its_cut() -> None:
    style = re.sub(
        r"/\*.*?\*/", "", (DOCS / "_static" / "site.css").read_text(encoding="utf-8"), flags=re.DOTALL
    )
    rules = re.findall(r"([^{}]+)\{([^{}]*)\}", style)
    shadowed = next(names for names, look in rules if "local" in look).replace("article ", "")
    scrolling = [names for names, look in rules if "overflow-x: auto" in look]
    assert len(scrolling) >= 3
    for name in ",".join(scrolling).split(","):
        last = name.strip().removeprefix("article ").removeprefix(".scene ")
        assert last in [one.strip() for one in shadowed.split(",")], name
