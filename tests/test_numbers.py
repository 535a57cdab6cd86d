"""What is measured is told once: pages and source agree, and a source older than its code is told of."""

from __future__ import annotations

import ast
import copy
import re
from pathlib import Path
from typing import Any

import pytest

from springgym.accuracy.code import PACKAGE, PARTS, digests, meaning
from springgym.registration import ENVIRONMENTS, VARIANTS, Row
from tests.test_docs import page_writer

ROOT = Path(__file__).parents[1]
MEASURED = page_writer("measured")
ENVIRONMENTS_PAGE = page_writer("environments")
REPORT = MEASURED.read()
ELSEWHERE = ("another",)
"""Sections measured on other machines; their pages tell when."""


# --- Pages and source ---------------------------------------------------------------------------------


@pytest.mark.parametrize("page", MEASURED.PAGES, ids=lambda page: str(page.relative_to(ROOT)))
def test_a_page_says_what_the_source_says(page: Path) -> None:
    """Else run ``python docs/measured.py``."""
    text = page.read_text(encoding="utf-8")
    assert MEASURED.differences(text, REPORT) == []
    assert MEASURED.filled(text, REPORT) == text
    assert text.count("<!--n:") == text.count("<!--/n-->") == len(MEASURED.NUMBER.findall(text))
    assert text.count("<!--table:") == text.count("<!--/table-->") == len(MEASURED.TABLE.findall(text))


def test_every_number_and_table_is_in_a_page() -> None:
    text = "".join(page.read_text(encoding="utf-8") for page in MEASURED.PAGES)
    assert {name for name, _ in MEASURED.NUMBER.findall(text)} == set(MEASURED.NUMBERS)
    assert {name for name, _ in MEASURED.TABLE.findall(text)} == set(MEASURED.TABLES)


TYPED = re.compile(r"(?<![\w.])\d[\d,.]*(?: ?(?:M|k|million|%|times|× C\+\+|µs|s)(?!\w)|e-\d+|(?<=\d,\d{3}))")
"""What looks like a number that somebody measured."""
KNOWN = (
    "14,000 to 18,000",  # of the paper
    "10 s", "1 s",  # what errors are after
    "1.25 times", "4 %", "10 %",  # by definition
    "1e6 N/m",
    "90 % of 20",  # what counts as learned
)  # fmt: skip


@pytest.mark.parametrize("name", ["README.md", "CONTRIBUTING.md", "docs/index.md", "docs/speed.md"])
def test_no_number_is_typed_by_hand(name: str) -> None:
    """Where pages tell what was measured: a number is of the source, or of `KNOWN`."""
    page = ROOT / name
    assert list(typed(page.read_text(encoding="utf-8"))) == []


def typed(text: str) -> list[str]:
    for pattern in (MEASURED.NUMBER, MEASURED.TABLE, re.compile(r"^```.*?^```", re.MULTILINE | re.DOTALL)):
        text = pattern.sub("", text)
    text = re.sub(r"\s+", " ", text)
    for known in KNOWN:
        text = text.replace(known, "")
    return TYPED.findall(text)


@pytest.mark.parametrize(
    ("page", "name"),
    [
        ("README.md", "top float32"),
        ("docs/speed.md", "top float32"),
        ("docs/training.md", "duel, PPO success"),
    ],
)
def test_a_number_changed_by_hand_is_found(page: str, name: str) -> None:
    text = (ROOT / page).read_text(encoding="utf-8")
    wrong = text.replace(f"<!--n:{name}-->", f"<!--n:{name}-->9")
    assert wrong != text
    assert any(told.startswith(f"{name}: '9") for told in MEASURED.differences(wrong, REPORT))


def test_a_cell_changed_by_hand_is_found() -> None:
    text = (ROOT / "docs" / "speed.md").read_text(encoding="utf-8")
    wrong = text.replace("| `SpringTop-v0` | ", "| `SpringTop-v0` | 9")
    assert any(told.startswith("environments: ") for told in MEASURED.differences(wrong, REPORT))


def test_a_source_that_changed_is_found() -> None:
    report: dict[str, Any] = copy.deepcopy(REPORT)
    (own,) = (
        row
        for row in report["environments"]["rows"]
        if (row["how"], row.get("threads")) == ("native, float32", 1)
    )
    own["median"] *= 2
    for page in ("README.md", "docs/speed.md", "docs/index.md"):
        assert MEASURED.differences((ROOT / page).read_text(encoding="utf-8"), report)


def test_a_number_beside_the_source_is_found() -> None:
    assert typed("It makes 12 million steps a second, 190 times as many, at 1.1e-5.") != []
    assert typed("It has 12 particles.") == []


def test_a_line_does_not_begin_with_a_number() -> None:
    """Markdown would take it for a block of HTML."""
    right = MEASURED.NUMBERS["top steps"](REPORT)
    assert MEASURED.differences(f"of <!--n:top steps-->{right}<!--/n-->", REPORT) == []
    assert MEASURED.differences(f"of\n<!--n:top steps-->{right}<!--/n-->", REPORT) != []


def test_a_name_that_is_not_there_is_told() -> None:
    with pytest.raises(KeyError, match="no such number"):
        MEASURED.filled("<!--n:no such number-->1<!--/n-->", REPORT)


def test_speeds_are_of_one_processor() -> None:
    """They stand in one table, under one line that says where they were measured."""
    sections = (*MEASURED.OF_SIMULATION, "environments", "startup")
    where = {name: (REPORT[name]["measured"]["cpu"], REPORT[name]["measured"]["cores"]) for name in sections}
    assert len(set(where.values())) == 1, where


def test_baselines_are_told_alike() -> None:
    """Controllers have the same 100 episodes on the pages of the environments and of the baselines."""
    tasks = {(row.id, repr({"action": usual(row)})): row.id for row in ENVIRONMENTS}
    for variant in VARIANTS:
        row = next(row for row in ENVIRONMENTS if row.id == variant.of)
        tasks[row.id, repr({"action": usual(row)} | variant.arguments)] = variant.id
    rows = {(own["task"], own["algorithm"]): own for own in REPORT["baselines"]}
    found = 0
    for own in REPORT["variants"]["rows"]:
        if task := tasks.get((own["environment"], own["arguments"])):
            for name in ("zero", "random", "classical"):
                there = rows[task, name]
                assert own[name][0] == pytest.approx(there["success_rate"]), (task, name)
                assert own[name][1] == pytest.approx(there["mean_return"], abs=1e-3), (task, name)
            found += 1
    assert found > len(ENVIRONMENTS) + 5


def usual(row: Row) -> str:
    """The action mode of an environment that names none."""
    return next(iter(ENVIRONMENTS_PAGE.environment(row, "").actions))


# --- Source and code ----------------------------------------------------------------------------------


def told(older: dict[str, list[str]]) -> str:
    """Sections that are older than the same code, by that code."""
    by_code: dict[str, list[str]] = {}
    for name, parts in older.items():
        by_code.setdefault(", ".join(parts), []).append(name)
    return "; ".join(f"{', '.join(names)}: older than {parts}" for parts, names in by_code.items())


def test_numbers_are_of_the_code_as_it_is() -> None:
    """Not each change of the code is followed by an hour of measuring, but each run of the tests says so."""
    if older := MEASURED.older(REPORT):
        pytest.xfail(f"to be measured before a release. {told(older)}")


@pytest.mark.slow
def test_a_release_has_numbers_of_its_own_code() -> None:
    """Run what `CONTRIBUTING.md` lists under Releases."""
    older = {name: parts for name, parts in MEASURED.older(REPORT).items() if name not in ELSEWHERE}
    assert not older, told(older)


def test_an_older_source_is_told() -> None:
    now = {"measured": {"code": dict(digests())}}
    then = {"measured": {"code": digests() | {"forces": "00000000"}}}
    report = {"kernel": now, "errors": then, "peers": {"measured": {}}}
    found = MEASURED.older(report)
    assert found.keys() == {"errors", "peers"}
    assert found["errors"] == ["forces"]
    assert "envs" not in found["peers"]
    assert "errors: older than forces" in told(found)


SOURCE = '''"""A module."""
import math

HALF = 0.5
"""What it is."""


def fall(time: float) -> float:
    """How far."""
    if time < 0:
        raise ValueError(f"time is {time}")
    return HALF * math.pi * time**2  # not a constant of nature
'''


@pytest.mark.parametrize(
    ("old", "new"),
    [
        ('"""How far."""', '"""How far it falls."""'),
        ('"""What it is."""\n', ""),
        ("  # not a constant of nature", ""),
        ("time: float", "time"),
        ("time is {time}", "time is {time}; it must be positive"),
        ("\n\n\ndef", "\n\ndef"),
    ],
)
def test_words_do_not_make_numbers_old(old: str, new: str) -> None:
    changed = SOURCE.replace(old, new)
    assert changed != SOURCE
    assert meaning(changed) == meaning(SOURCE)


@pytest.mark.parametrize(("old", "new"), [("0.5", "0.25"), ("time < 0", "time <= 0"), ("time**2", "time**3")])
def test_another_computation_makes_numbers_old(old: str, new: str) -> None:
    assert meaning(SOURCE.replace(old, new)) != meaning(SOURCE)


def test_all_that_is_simulated_with_counts() -> None:
    """Each module is of a part, but those that only check, tell, or run the others."""
    of_parts = {path for patterns in PARTS.values() for pattern in patterns for path in PACKAGE.glob(pattern)}
    free = {"__init__", "__main__", "checks", "cli", "extras", "identity", "modelling"}
    free |= {"contacts", "precompiling", "records", "registration", "scripts", "simulating", "strict_yaml"}
    missing = {path for path in PACKAGE.glob("*.py") if path not in of_parts and path.stem not in free}
    assert missing == set()
    for pattern in (pattern for patterns in PARTS.values() for pattern in patterns):
        assert list(PACKAGE.glob(pattern)), pattern
    assert all(ast.parse(path.read_text(encoding="utf-8")) for path in of_parts if path.suffix == ".py")
