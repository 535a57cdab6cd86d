"""The fuzzing command: it passes on what is right, and sees what is not."""

from __future__ import annotations

import re
import sys
from typing import Any

import numpy as np
import pytest

from springgym.envs.episodes import Episodes
from springgym.simulator import Simulator
from tests.params import slow_but
from tools import fuzz
from tools.fuzz import Player, Round

USUAL = Round("SpringTop-v0", {"observation": "features", "dtype": "float64"}, 3, "SameStep", 1)


def play(what: Round = USUAL, seed: int = 0, length: int = 120) -> Player:
    player = Player(what, np.random.default_rng(seed))
    player.play(length)
    return player


@pytest.mark.parametrize("autoreset", slow_but(["NextStep", "SameStep", "Disabled"], "SameStep"))
def test_rounds(autoreset: str) -> None:
    player = play(USUAL._replace(autoreset=autoreset))
    assert player.steps == 3 * 120
    assert 0 < player.drift < fuzz.DRIFT
    assert play(USUAL._replace(copies=None)).steps == 120


def test_a_round_of_bodies_that_collide() -> None:
    assert play(Round("SpringBalance-v0", {"observation": "features"}, 3, "SameStep", 1)).steps == 3 * 120


def test_command_prints_seeds_and_repeats_itself(capsys: pytest.CaptureFixture[str]) -> None:
    def said(*options: str) -> list[str]:
        with pytest.MonkeyPatch.context() as patch:
            patch.setattr(sys, "argv", ["fuzz", "--only", "SpringTop", "--length", "20", *options])
            assert fuzz.main() == 0
        return [re.sub(r"[\d.]+ (s|min)\b", "", line) for line in capsys.readouterr().out.splitlines()]

    both = said("--seed", "42", "--rounds", "2")
    assert [line.split(" ")[:3] for line in both[:2]] == [["seed", f"{n}:", "SpringTop-v0"] for n in (42, 43)]
    assert "failed seeds: none" in both[2]
    assert said("--seed", "43", "--rounds", "1")[0] == both[1]
    assert said("--seed", "42", "--steps", "21")[:2] == both[:2]


def test_rounds_in_a_row_are_of_one_environment(monkeypatch: pytest.MonkeyPatch) -> None:
    """Which is compiled once; what is played in each is another."""
    played: list[Round] = []

    class Noted:
        steps = 1
        drift = 0.0

        def __init__(self, what: Round, rng: np.random.Generator) -> None:
            played.append(what)

        def play(self, length: int) -> None:
            """Nothing."""

    monkeypatch.setattr(fuzz, "Player", Noted)
    assert fuzz.fuzz(16, steps=np.inf, rounds=24, repeats=8) == []
    kinds = [(one.env_id, str(one.arguments)) for one in played]
    assert [kinds[n] == kinds[n - 1] for n in range(1, 24)] == [n % 8 != 0 for n in range(1, 24)]
    assert len({(one.copies, one.autoreset, one.threads) for one in played}) > 12


@pytest.mark.parametrize(
    ("options", "says"),
    [
        (("--only", "Nothing"), "no environment and no scene has 'Nothing' in its name"),
        (("--repeats", "0"), "--length and --repeats are at least 1"),
        (("--length", "0"), "--length and --repeats are at least 1"),
    ],
)
def test_what_cannot_be_played_is_told(
    options: tuple[str, ...], says: str, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(sys, "argv", ["fuzz", *options])
    with pytest.raises(SystemExit):
        fuzz.main()
    assert says in capsys.readouterr().err


def test_failures_are_told(capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch) -> None:
    broken(monkeypatch, Episodes, "observe", too_large)
    assert fuzz.fuzz(18, steps=1, rounds=1, only="SpringTop") == [18]
    text = capsys.readouterr().out
    assert "FAILED" in text
    assert "Fault: observation is outside of its space" in text
    assert "failed seeds: 18" in text


def broken(monkeypatch: pytest.MonkeyPatch, owner: type, name: str, change: Any) -> None:
    own = getattr(owner, name)
    monkeypatch.setattr(owner, name, lambda self, *args, **kwargs: change(own, self, *args, **kwargs))


def one_copy_off(own: Any, self: Any, *args: Any, **kwargs: Any) -> Any:
    seen = own(self, *args, **kwargs)
    if self.copies > 1:
        seen += np.float32(1e-6)
    return seen


def too_large(own: Any, self: Any, *args: Any, **kwargs: Any) -> Any:
    return own(self, *args, **kwargs) + np.float32(20.0)


def nan(own: Any, self: Any, *args: Any, **kwargs: Any) -> Any:
    result, seen = own(self, *args, **kwargs)
    result.reward[:] = np.nan
    return result, seen


def forgetful(own: Any, self: Any, state: Any, copies: Any = None) -> None:
    own(self, state, copies)
    self.simulator.place(self.particles[0] + 1e-6, self.particles[1])


def heated(own: Any, self: Any, *args: Any, **kwargs: Any) -> Any:
    self.balance -= 1e4
    return own(self, *args, **kwargs)


def warned(own: Any, self: Any, *args: Any, **kwargs: Any) -> Any:
    np.zeros(1) / np.zeros(1)
    return own(self, *args, **kwargs)


@pytest.mark.parametrize(
    ("owner", "name", "change", "said"),
    [
        (Episodes, "observe", one_copy_off, "single environment"),
        (Episodes, "observe", too_large, "observation is outside of its space"),
        (Episodes, "step", nan, "reward is not finite|differs"),
        (Episodes, "restore", forgetful, "copy differs from a single environment"),
        (Episodes, "step", heated, "energy drift"),
        (Simulator, "place", warned, "invalid value"),
    ],
)
def test_faults_are_seen(
    owner: type, name: str, change: Any, said: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    broken(monkeypatch, owner, name, change)
    with pytest.raises((AssertionError, RuntimeWarning), match=said):
        [play(seed=seed) for seed in range(3)]
