"""What is measured is told once: pages and source agree, and a source older than the code is found."""

from __future__ import annotations

import copy
import re
from pathlib import Path

import pytest

from benchmarks import conditions
from springgym.envs.registration import ENVIRONMENTS, VARIANTS, Row
from tests.test_docs import page_writer

ROOT = Path(__file__).parents[1]
MEASURED = page_writer("measured")
ENVIRONMENTS_PAGE = page_writer("environments")
REPORT = MEASURED.read()


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
    assert typed((ROOT / name).read_text(encoding="utf-8")) == []


def typed(text: str) -> list[str]:
    for pattern in (MEASURED.NUMBER, MEASURED.TABLE, re.compile(r"^```.*?^```", re.MULTILINE | re.DOTALL)):
        text = pattern.sub("", text)
    text = re.sub(r"\s+", " ", text)
    for known in KNOWN:
        text = text.replace(known, "")
    return TYPED.findall(text)


def test_what_is_changed_by_hand_or_in_the_source_is_found() -> None:
    text = (ROOT / "docs" / "speed.md").read_text(encoding="utf-8")
    marks = {"<!--n:top float32-->": "top float32: '9", "| `SpringTop-v0` | ": "environments: "}
    for where, told in marks.items():
        assert where in text
        found = MEASURED.differences(text.replace(where, f"{where}9"), REPORT)
        assert any(of.startswith(told) for of in found)
    report = copy.deepcopy(REPORT)
    how = ("native, float32", 1)
    (own,) = (own for own in report["environments"]["rows"] if (own["how"], own.get("threads")) == how)
    own["median"] *= 2
    for page in ("README.md", "docs/speed.md", "docs/index.md"):
        assert MEASURED.differences((ROOT / page).read_text(encoding="utf-8"), report)


def test_tasks_beside_mujoco_have_the_errors_of_both() -> None:
    """Of the solver that is named in the ratio; what was not measured is told."""
    task = MEASURED.TASKS[0]
    speeds = {"springgym": 5e4, "springgym, single": 4e3, "MuJoCo Newton": 2e4, "MuJoCo CG": 1.4e4}
    errors = {"error": 1.2e-3, "largest": 3.4e-2}
    rows = [{"environment": task, "program": name, "median": n} | errors for name, n in speeds.items()]
    for name, ratio in (("springgym", 2.5), ("springgym, single", 0.2)):
        span = {"median": ratio, "low": 0.9 * ratio, "high": 1.2 * ratio}
        rows.append({"environment": task, "program": f"{name} / MuJoCo Newton"} | span)
    report = REPORT | {MEASURED.CONTACT_TASKS: {"rows": rows}}
    _, _, first, second, *_ = MEASURED.table_of_contact_tasks(report).split("\n")
    own = MEASURED.row(REPORT, "errors", environment=task)
    told = f"{MEASURED.power(own['median'])}; {MEASURED.power(own['high'])}"
    speeds_told = "50,000 | 4,000 | 20,000 | Newton | × 2.5 (2.2–3)"
    assert first == f"| `{task}` | {speeds_told} | {told} | 1.2e-3; 3.4e-2 |"
    assert second.count("not yet") == 7
    assert MEASURED.NUMBERS["contact tasks / MuJoCo"](report) == "2.5"
    assert MEASURED.NUMBERS["single contact tasks / MuJoCo"](report) == "0.20"


def test_a_line_does_not_begin_with_a_number() -> None:
    """Markdown would take it for a block of HTML."""
    right = f"<!--n:top steps-->{MEASURED.NUMBERS['top steps'](REPORT)}<!--/n-->"
    assert MEASURED.differences(f"of {right}", REPORT) == []
    assert MEASURED.differences(f"of\n{right}", REPORT) != []


def test_a_name_that_is_not_there_is_told() -> None:
    with pytest.raises(KeyError, match="no such number"):
        MEASURED.filled("<!--n:no such number-->1<!--/n-->", REPORT)


@pytest.mark.parametrize(
    ("sections", "lines"),
    [
        (
            ("kernel", "features", "peers", "equal-error", "sizes", "startup"),
            ("measured", "processor of tops"),
        ),
        (("environments", MEASURED.CONTACT_TASKS), ("measured environments", "processor of environments")),
    ],
)
def test_speeds_under_one_line_are_of_one_processor(
    sections: tuple[str, ...], lines: tuple[str, str]
) -> None:
    """Each line says where the speeds of its sections were measured; README and the page have both."""
    where = {name: (REPORT[name]["measured"]["cpu"], REPORT[name]["measured"]["cores"]) for name in sections}
    assert len(set(where.values())) == 1, where
    for line, page in zip(lines, ("docs/speed.md", "README.md"), strict=True):
        assert f"<!--n:{line}-->" in (ROOT / page).read_text(encoding="utf-8"), page


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
            for name in ("noop", "random", "classical"):
                there = rows[task, name]
                assert own[name][0] == pytest.approx(there["success_rate"]), (task, name)
                assert own[name][1] == pytest.approx(there["mean_return"], abs=1e-3), (task, name)
            found += 1
    assert found > len(ENVIRONMENTS_PAGE.MEASURED) + 5


def usual(row: Row) -> str:
    """The action mode of an environment that names none."""
    return next(iter(ENVIRONMENTS_PAGE.environment(row, "").actions))


# --- Source and code ----------------------------------------------------------------------------------


@pytest.mark.slow
def test_a_release_has_numbers_of_its_own_code() -> None:
    """Run what `CONTRIBUTING.md` lists under Releases."""
    assert list(MEASURED.older(REPORT)) == []


def test_an_older_source_is_found(monkeypatch: pytest.MonkeyPatch) -> None:
    name, added = "springgym/model/scene.py", {"old": "x = 1\n", "told": '"""Otherwise."""  # told\n'}

    def git(command: str, *arguments: str) -> str | None:
        if command == "show":
            return (ROOT / name).read_text() + added[arguments[0].partition(":")[0]]
        return {"new": ""}.get(arguments[1], name if arguments[1] in added else None)

    monkeypatch.setattr(conditions, "git", git)
    commits = {"kernel": "new", "errors": "old", "peers": "lost", "sizes": None, "curves": "told"}
    report = {name: {"measured": {"commit": commit}} for name, commit in commits.items()}
    report |= {"accuracy": {"rope": {"measured": {"commit": "old"}}}, "learning": []}
    assert MEASURED.older(report) == ["errors", "peers", "sizes", "accuracy"]


def test_a_commit_is_that_of_this_clone() -> None:
    head = conditions.git("rev-parse", "HEAD")
    if head is None:
        pytest.skip("this is no clone")
    found = conditions.conditions()["commit"]
    assert head.startswith(found.removesuffix("-dirty"))
    assert conditions.changed_since(head) == found.endswith("-dirty")
    assert conditions.changed_since("0000000")


COMPARED = {"median error of a step", "largest error of a step", "median error", "largest error"}


def test_a_measure_has_one_value_in_all_pages() -> None:
    """Errors of an environment's step stand in tables of several pages, the largest beside the median."""
    found: dict[str, set[str]] = {}
    for page in (*MEASURED.PAGES, *sorted((ROOT / "docs" / "environments").glob("*.md"))):
        head: list[str] = []
        for line in page.read_text(encoding="utf-8").splitlines():
            cells = [cell.strip() for cell in line.strip("|").split("|")] if line.startswith("|") else []
            head = (head or cells) if cells else []
            for name in COMPARED & set(head):
                if cells and cells[0].startswith("`Spring") and (len(cells) == len(head)):
                    arguments = cells[head.index("arguments")] if "arguments" in head else ""
                    value = f"{float(cells[head.index(name)]):.1e}"
                    what = f"{cells[0]} {arguments} {name.removesuffix(' of a step')}"
                    found.setdefault(what, set()).add(value)
            if cells and any("median error" in name for name in head):  # it flatters, alone
                assert any("largest error" in name for name in head), (page.name, head)
    assert len(found) >= 2 * len(ENVIRONMENTS_PAGE.MEASURED)
    assert {name: values for name, values in found.items() if len(values) > 1} == {}
