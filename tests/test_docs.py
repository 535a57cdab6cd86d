"""The documentation says what the code says."""

from __future__ import annotations

import importlib.util
import json
from pathlib import Path
from types import ModuleType

import gymnasium as gym
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
    """Run ``python docs/environments.py`` after changing an environment's docstring, or numbers of it."""
    writer, page = page_writer(), (DOCS / "environments.md").read_text(encoding="utf-8")
    assert page == writer.page(json.loads(writer.NUMBERS.read_text(encoding="utf-8")))
    for row in writer.ENVIRONMENTS:
        its = (DOCS / "environments" / f"{row.id}.md").read_text(encoding="utf-8")
        assert its == writer.describe(row)
        assert f"| `{row.id}` |" in page
    assert len(list((DOCS / "environments").glob("*.md"))) == len(writer.ENVIRONMENTS)


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
    with pytest.warns(UserWarning, match="without a vector_entry_point"):
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
    """Rows of a task whose physics or reward has changed say nothing of it: benchmark anew, or mark them.

    What classical control does changes with the task.
    """
    pytest.importorskip("torch")
    writer = page_writer("baselines")  # it puts agents/ on the path
    benchmark = importlib.import_module("benchmark")
    plan = benchmark.Plan(Path(), benchmark.EPISODES, (), None)
    rows = writer.read(writer.ROWS)
    probes = {task: benchmark.probe(task) for task in sorted({row["task"] for row in rows})}
    for row in rows:
        cell = benchmark.Cell(*writer.key(row))
        assert row["episodes"] == benchmark.EPISODES
        marked = "present_probe" in row
        digest = benchmark.digest(cell, plan)
        if cell.algorithm == "classical":  # a sum of what it does
            assert marked or abs(float(row["config"]) - float(digest)) < 1e-3, f"{cell}: it has changed"
        else:
            assert row["config"] == digest, f"{cell}: its configuration has changed"
        present = row["present_probe"] if marked else row["probe"]
        assert abs(present - probes[cell.task]) <= writer.SAME, f"{cell}: its task has changed"
        assert not marked or abs(row["probe"] - present) > writer.SAME, f"{cell}: its task has not changed"


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
