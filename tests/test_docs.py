"""The documentation says what the code says."""

from __future__ import annotations

import importlib.util
from pathlib import Path
from types import ModuleType

import gymnasium as gym

DOCS = Path(__file__).parents[1] / "docs"


def page_writer() -> ModuleType:
    spec = importlib.util.spec_from_file_location("environments_page", DOCS / "environments.py")
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def test_environments_pages_are_current() -> None:
    """Run ``python docs/environments.py --pages`` after changing an environment's docstring."""
    writer, page = page_writer(), (DOCS / "environments.md").read_text(encoding="utf-8")
    for row in writer.ENVIRONMENTS:
        its = (DOCS / "environments" / f"{row.id}.md").read_text(encoding="utf-8")
        assert its == writer.describe(row)
        assert f"| `{row.id}` |" in page
    assert "\n".join(writer.table_of_environments()) in page
    assert len(list((DOCS / "environments").glob("*.md"))) == len(writer.ENVIRONMENTS)


def test_every_variant_of_the_page_can_be_made() -> None:
    writer, page = page_writer(), (DOCS / "environments.md").read_text(encoding="utf-8")
    found = [(row.id, variant) for row in writer.ENVIRONMENTS for variant in writer.variants(row)]
    assert {"hard", "start", "surface", "body"} <= {name for _, v in found for name in v.arguments}
    for env_id, variant in found:
        assert f"{variant.written} | {variant.change} |" in page
        gym.make(env_id, **variant.arguments).reset(seed=0)


def test_docstrings_have_gymnasiums_headings() -> None:
    writer = page_writer()
    headings = (
        "Description",
        "Action Space",
        "Observation Space",
        "Rewards",
        "Starting State",
        "Episode End",
        "Arguments",
        "Version History",
    )
    for row in writer.ENVIRONMENTS:
        text = writer.describe(row)
        assert [h for h in headings if f"\n## {h}\n" not in text] == [], row.id
