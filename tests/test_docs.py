"""The documentation says what the code says."""

from __future__ import annotations

import importlib.util
from pathlib import Path
from types import ModuleType

import gymnasium as gym
import numpy as np
import pytest

from springgym.envs.sb3 import make_sb3

DOCS = Path(__file__).parents[1] / "docs"


def page_writer(name: str = "environments") -> ModuleType:
    spec = importlib.util.spec_from_file_location(f"{name}_page", DOCS / f"{name}.py")
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
    assert "\n".join(writer.table_of_named_variants()) in page
    assert len(list((DOCS / "environments").glob("*.md"))) == len(writer.ENVIRONMENTS)


def test_what_the_page_says_of_all_environments_is_current() -> None:
    """Run ``python docs/environments.py``; these parts it copies."""
    writer, page = page_writer(), (DOCS / "environments.md").read_text(encoding="utf-8")
    for part in (writer.RANDOMISATION, writer.PROMISES, writer.OWN_SCENES):
        assert part in page


def test_errors_of_some_environments_can_be_measured_anew(monkeypatch: pytest.MonkeyPatch) -> None:
    """The rows of these change, in both tables, and a line says so; no other line does, however often."""
    writer, page = page_writer(), (DOCS / "environments.md").read_text(encoding="utf-8")
    monkeypatch.setattr(writer, "error_per_step", lambda *_: (1.0, 2.0, 3.0, 4.0))
    monkeypatch.setattr(writer, "estimates", lambda *_, **__: (np.full(9, 2.0), np.full(9, 4.0)))
    before = [line for line in page.splitlines() if not line.startswith("Errors of ")]
    once = writer.errors_renewed(page, ["SpringTumble-v0"])
    assert writer.errors_renewed(once, ["SpringTumble-v0"]) == once
    after = once.splitlines()
    changed = [(old, new) for old, new in zip(before, after, strict=False) if old != new]
    rows = [
        new for old, new in changed if new.startswith("| `SpringTumble-v0` |") and old.startswith(new[:19])
    ]
    assert len(rows) == 3
    assert sum("| 2.0e+00 | 3.0e+00 |" in row for row in rows) == 1
    assert sum("| 0.500 |" in row for row in rows) == 2
    assert [line for line in after if line.startswith("Errors of ")] == [
        f"Errors of SpringTumble-v0 measured anew {writer.date.today()}."
    ]
    assert len(after) == len(before) + 1


def test_scene_of_the_page_is_made_as_it_says() -> None:
    code = page_writer().OWN_SCENES.split("```")
    names: dict[str, object] = {}
    gym.registry.pop("Hover-v0", None)  # pages that ran before
    for block in code[1::2]:
        exec(block.removeprefix("python"), names)
    env = names["env"]
    env.reset(seed=0)  # type: ignore[attr-defined]
    *_, info = env.step(env.action_space.sample())  # type: ignore[attr-defined]
    assert info["is_success"] is False
    hover = gym.make("Hover-v0", render_mode="rgb_array")
    assert hover.spec.max_episode_steps == 200
    hover.reset(seed=0)
    make_sb3("Hover-v0", num_envs=2).reset()
    del gym.registry["Hover-v0"]


def test_every_variant_of_the_page_can_be_made() -> None:
    writer, page = page_writer(), (DOCS / "environments.md").read_text(encoding="utf-8")
    found = [(row.id, variant) for row in writer.ENVIRONMENTS for variant in writer.variants(row)]
    assert {"hard", "start", "surface", "body"} <= {name for _, v in found for name in v.arguments}
    for env_id, variant in found:
        assert f"{variant.written} | {variant.change} |" in page
        gym.make(env_id, **variant.arguments).reset(seed=0)


def test_baselines_page_is_current() -> None:
    """Run ``python docs/baselines.py`` after the benchmark has written rows."""
    writer = page_writer("baselines")
    rows = writer.read(writer.ROWS)
    assert writer.PAGE.read_text(encoding="utf-8") == writer.page(rows)
    assert [writer.key(row) for row in rows] == sorted({writer.key(row) for row in rows})
    assert {row["task"] for row in rows} <= {task.id for task in writer.TASKS}


def test_baselines_are_of_the_tasks_and_configurations_as_they_are() -> None:
    """Rows of a task whose physics, reward or configuration has changed say nothing of it: benchmark anew."""
    pytest.importorskip("torch")
    writer = page_writer("baselines")  # it puts agents/ on the path
    benchmark = importlib.import_module("benchmark")
    plan = benchmark.Plan(Path(), benchmark.EPISODES, (), None)
    rows = writer.read(writer.ROWS)
    probes = {task: benchmark.probe(task) for task in sorted({row["task"] for row in rows})}
    for row in rows:
        cell = benchmark.Cell(*writer.key(row))
        assert row["episodes"] == benchmark.EPISODES
        assert row["config"] == benchmark.digest(cell, plan), f"{cell}: its configuration has changed"
        assert abs(row["probe"] - probes[cell.task]) <= 1e-6, f"{cell}: its task has changed"


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
