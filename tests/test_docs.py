"""The documentation says what the code says."""

from __future__ import annotations

import importlib.util
import json
import re
from pathlib import Path
from types import ModuleType
from typing import Any

import gymnasium as gym
import pytest

from springgym.envs.registration import ENVIRONMENTS
from springgym.envs.sb3 import make_sb3
from tests.envs.cases import DUEL
from tests.params import slow_unless

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
    wanted = page_writer().pages()
    assert {path: path.read_text(encoding="utf-8") for path in wanted} == wanted
    assert {*(DOCS / "environments").glob("*.md")} < wanted.keys()


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


def test_pages_show_all_kinds_of_variants() -> None:
    writer = page_writer()
    found = [variant for row in writer.ENVIRONMENTS for variant in writer.variants(row)]
    assert {"hard", "start", "surface", "body"} <= {name for v in found for name in v.arguments}


def test_variants_that_are_not_measured_yet_have_dashes() -> None:
    lines = page_writer().table_of_variants({"variants": {"rows": []}})
    rows = [line for line in lines if line.startswith("| `Spring")]
    assert len(rows) >= len(ENVIRONMENTS)
    assert all(line.endswith(" | – | – | – |") for line in rows)


@pytest.mark.parametrize(
    "row", [pytest.param(row, id=row.id, marks=slow_unless(row.id != DUEL)) for row in ENVIRONMENTS]
)
def test_every_variant_of_the_page_can_be_made(row: Any) -> None:
    listed = (DOCS / "environments.md").read_text(encoding="utf-8")
    page = " ".join((DOCS / "environments" / f"{row.id}.md").read_text(encoding="utf-8").split())
    for variant in page_writer().variants(row):
        assert re.search(rf"\| `{row.id}` \| [^|]*{re.escape(variant.written)} \|", listed)
        assert f"- {variant.written}: {variant.change}" in page
        env = gym.make(row.id, **variant.arguments)
        if variant.arguments.get("surface") != "bowl" and row.id != DUEL:  # a kernel of its own
            env.reset(seed=0)


def test_baselines_page_is_current() -> None:
    """Run ``python docs/baselines.py`` after the benchmark has written rows."""
    writer = page_writer("baselines")
    rows = writer.read(writer.ROWS)
    assert writer.PAGE.read_text(encoding="utf-8") == writer.page(rows)
    assert [writer.identity(row) for row in rows] == sorted({writer.identity(row) for row in rows})
    assert {row["task"] for row in rows} <= {task.id for task in writer.TASKS}


def test_every_environment_has_a_row_of_the_planner() -> None:
    """Made by the planner as it is, of the task as it is by the rows of the controllers."""
    pytest.importorskip("torch")
    writer = page_writer("baselines")  # it puts agents/ on the path
    planner = importlib.import_module("plan")
    rows = {row["task"]: row for row in writer.planned()}
    tasks = {own["task"]: own for own in writer.read(writer.ROWS) if own["algorithm"] == "noop"}
    for env_id in (row.id for row in page_writer().MEASURED):
        row = rows[env_id]
        own = tasks[env_id]
        assert row["episodes"] >= 5
        assert row["config"] == planner.digest(planner.planner_of(env_id)), env_id
        assert row["probe"] == own["probe"] or writer.is_old(row) or writer.is_old(own), env_id
        assert re.fullmatch("[0-9a-f]{40}", row["commit"]), env_id


def test_the_suite_says_its_reference_and_what_a_budget_bought() -> None:
    """So that a low score can be told from a strong reference, and few steps from slow learning."""
    page = page_writer("baselines")
    lines = page.suite(page.read(page.ROWS))
    rows = [line.split(" | ") for line in lines if line.startswith("| `Spring")]
    assert len(rows) == 2 * len(page.SUITE)
    for n, (task, reference, *learned, idle) in enumerate(rows):
        assert re.fullmatch(r"-?\d\.\d\d,\s\d+\s%<br>(classical|planner)", reference), task
        for cell in learned:
            assert re.search(r"\)<br>\d+\s%" + (r",\s[\d.]+\s[kM]$" if n < len(page.SUITE) else "$"), cell)
        assert "<br>" not in idle


def test_tables_of_tiers_fit_a_page() -> None:
    """Their longest words are short: cells of several runs and numbers have several lines."""
    page = page_writer("baselines")
    for tier in page.TIERS:
        for line in page.table_of(tier, page.read(page.ROWS))[2:]:
            _, *cells = line.strip("| ").split(" | ")
            width = [max(len(part) for part in cell.replace("*", "").split("<br>")) for cell in cells]
            assert sum(width) < 90, line


def test_results_are_of_commits() -> None:
    assert [path.name for path in DOCS.glob("*.json") if "-dirty" in path.read_text(encoding="utf-8")] == []


def test_what_is_learned_from_data_stands_apart() -> None:
    """Its rows are in a file and a table of their own, with all seeds of the same data in one line."""
    writer = page_writer("baselines")
    rows = writer.read(writer.ROWS)
    own = {
        "id": "springgym/SpringTop/medium-v0",
        "agent": "medium",
        "transitions": 50_000,
        "mean_return": 0.3,
    }
    row = {"task": "SpringTop-v0", "algorithm": "iql", "steps": 9, "episodes": 100, "returns": [0.5] * 100}
    runs = [
        row | {"data": [own], "seed": seed, "mean_return": 0.5, "success_rate": share}
        for seed, share in enumerate((0.4, 0.8))
    ]
    other = row | {"data": [own | {"transitions": 7}], "seed": 0, "mean_return": 0.1, "success_rate": 0.0}
    assert writer.apart([*runs, *rows]) == (rows, runs)
    first, second = writer.table_of_data([*runs, other])[2:]
    assert "| medium | 50,000 | 0.30 | iql | 9 | 0.50 (0.50–0.50, 2) | 60 % (" in first
    assert first.endswith("| 2 |")
    assert "| 7 | 0.30 | iql | 9 | 0.10 (0.10–0.10) | 0 % (0–3) | 1 |" in second


def test_rows_of_an_earlier_protocol_or_task_are_old_and_marked() -> None:
    writer = page_writer("baselines")
    row = next(row for row in writer.read(writer.ROWS) if row["task"] == "SpringDuel-v0")
    now = row | {"protocol": writer.PROTOCOL}
    now.pop("present_probe", None)
    for own, old in (
        (now, False),
        (now | {"protocol": 1}, True),
        (now | {"present_probe": [0.0, 0.0]}, True),
        ({name: value for name, value in now.items() if name != "protocol"}, True),
    ):
        assert writer.is_old(own) == old
        assert any("`SpringDuel-v0` †" in line for line in writer.table_of("medium", [own])) == old


def outdated_rows() -> set[str]:
    """Return tasks with rows of an earlier protocol, or of another physics or reward, which are marked."""
    writer = page_writer("baselines")  # it puts agents/ on the path
    benchmark = importlib.import_module("benchmark")
    outdated = set()
    for row in [*writer.read(writer.ROWS), *writer.recorded()]:
        cell = benchmark.Cell(row["task"], row["algorithm"], row["seed"])
        assert row["episodes"] == benchmark.EPISODES
        names = ("data", "env_kwargs") if "data" in row else {"seconds"} & row["configuration"].keys()
        own = tuple(f"{name}={json.dumps(row['configuration'][name])}" for name in names)
        config = benchmark.config_of(cell, benchmark.Plan(Path(), benchmark.EPISODES, own, None))
        assert row["config"] == benchmark.digest_of(config), f"{cell}: its configuration has changed"
        if row.get("protocol") == writer.PROTOCOL:
            present = row.get("present_probe", row["probe"])
            assert writer.same_probe(present, cell.task), f"{cell}: its task has changed; see --mark"
            marked = "present_probe" in row
            assert not marked or row["probe"] != present, f"{cell}: its task has not changed"
        if writer.is_old(row):
            outdated.add(cell.task)
    return outdated


@pytest.mark.own_kernels
@pytest.mark.slow
def test_baselines_are_of_the_tasks_and_configurations_as_they_are() -> None:
    """The page marks rows that were made before the physics or the reward of their task changed.

    Not each change is followed by days of training, but each run of the tests says so.
    """
    pytest.importorskip("torch")
    if outdated := outdated_rows():
        pytest.xfail(f"to be made again before a release: rows of {', '.join(sorted(outdated))}")


@pytest.mark.own_kernels
@pytest.mark.slow
def test_a_release_has_baselines_of_its_own_tasks() -> None:
    pytest.importorskip("torch")
    assert outdated_rows() == set()


def test_pages_begin_with_what_gymnasiums_begin_with() -> None:
    """Spaces as Gymnasium prints them, how to make it, the horizon, and errors at their largest."""
    writer = page_writer()
    report = writer.read()
    for row in writer.MEASURED:
        top, _, rest = writer.describe(row, report).partition("## Description\n")
        env = gym.make(row.id)
        own = next(own for own in report["errors"]["rows"] if own["environment"] == row.id)
        spaces = (env.action_space, env.observation_space)
        told = (
            f'gymnasium.make("{row.id}")',
            *(f"| `{space}`" for space in spaces),
            writer.steps_of(row),
            row.tier,
        )
        for what in (*told, f"{own['median']:.1e}, largest {own['high']:.1e}"):
            assert what in top, (row.id, what)
        assert "\n## Version History\n" in rest


def test_a_new_environment_has_its_page_and_no_numbers(monkeypatch: pytest.MonkeyPatch) -> None:
    """So that all tests of a pull request are green before its results are there."""
    writer = page_writer()
    measured = page_writer("measured")
    report = writer.read()
    new = writer.ENVIRONMENTS[0]._replace(id="SpringFunnel-v0")
    monkeypatch.setattr(writer, "NEW", {new.id})
    text = writer.describe(new, report)
    assert f'gymnasium.make("{new.id}")' in text
    assert "## Baselines\n\nNot measured yet.\n" in text
    assert "figures/" not in text
    assert [row.id for row in measured.ENVIRONMENTS] == [row.id for row in writer.MEASURED]


@pytest.mark.slow
def test_a_release_has_results_of_every_id() -> None:
    assert not page_writer().NEW


def test_docstrings_have_gymnasiums_headings() -> None:
    writer = page_writer()
    headings = "Description, Action Space, Observation Space, Rewards, Starting State, Episode End, Arguments"
    for row in writer.ENVIRONMENTS:
        text = writer.docstring(row)
        assert [h for h in headings.split(", ") if f"## {h}\n" not in text] == [], row.id
