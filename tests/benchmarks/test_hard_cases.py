"""Every hard case passes, and its broken twin does not."""

from __future__ import annotations

import pytest

from benchmarks.hard_cases import CASES, Case, main
from tests.params import slow_unless


def each(*usual: int) -> pytest.MarkDecorator:
    """Run a test always on the cases of these numbers, on all others in slow runs."""
    params = [
        pytest.param(case, id=f"{case.number} {case.name}", marks=slow_unless(case.number in usual))
        for case in CASES
    ]
    return pytest.mark.parametrize("case", params)


def test_all_cases_are_there() -> None:
    assert [case.number for case in CASES] == list(range(1, 29))


@each(1, 4, 9, 10, 11, 12, 15, 17, 23)
def test_case_passes(case: Case) -> None:
    outcome = case.run(False)
    assert outcome.passed is True, outcome.measured


@each(1, 4, 9, 10, 15, 17, 23)
def test_broken_twin_fails(case: Case) -> None:
    outcome = case.run(True)
    assert outcome.passed is False, outcome.measured


def test_command_gives_1_if_a_case_fails(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["23"]) == 0
    assert "pass  degenerate input" in capsys.readouterr().out
    broken = CASES[22].run(True)
    assert not broken.passed
    CASES.append(Case(29, "broken", "", "", lambda _: broken))
    try:
        assert main(["29"]) == 1
    finally:
        CASES.pop()


def test_command_refuses_a_case_that_is_not_there() -> None:
    assert main(["99"]) == 2
