"""Every hard case passes, and its broken twin does not."""

from __future__ import annotations

import pytest

from benchmarks.hard_cases import CASES, Case, main

EACH = [
    pytest.param(
        case,
        id=f"{case.number} {case.name}",
        marks=[pytest.mark.slow] * case.slow,
    )
    for case in CASES
]


def test_all_cases_are_there() -> None:
    assert [case.number for case in CASES] == list(range(1, 29))


@pytest.mark.parametrize("case", EACH)
@pytest.mark.often("1 *", "4 *", "9 *", "10 *", "11 *", "12 *", "15 *", "17 *", "23 *")
def test_case_passes(case: Case) -> None:
    outcome = case.run(False)
    assert outcome.passed is True, outcome.measured


@pytest.mark.parametrize("case", EACH)
@pytest.mark.often("1 *", "4 *", "9 *", "10 *", "15 *", "17 *", "23 *")
def test_broken_twin_fails(case: Case) -> None:
    outcome = case.run(True)
    assert outcome.passed is False, outcome.measured


def test_command_gives_1_if_a_case_fails(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["23"]) == 0
    assert "pass  degenerate input" in capsys.readouterr().out
    broken = CASES[22].run(True)
    assert not broken.passed
    CASES.append(Case(29, "broken", "", "", lambda _: broken, False))
    try:
        assert main(["29"]) == 1
    finally:
        CASES.pop()


def test_command_refuses_a_case_that_is_not_there() -> None:
    assert main(["99"]) == 2
