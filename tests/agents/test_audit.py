"""The audit: an agent that lives on errors of the simulation is found out, an honest one is not."""

import json

import audit
import numpy as np
import pytest
from evaluate import Evaluation


def test_an_honest_agent_survives(tmp_path, capsys):
    path = tmp_path / "audit.json"
    assert audit.main(["classical", "--env", "SpringTop-v0", "--episodes", "10", "--json", str(path)]) == 0
    lines = capsys.readouterr().out.splitlines()
    assert [line.split("  ")[0] for line in lines[2:]] == [
        "verlet, h = 0.5 ms", "verlet, h/4", "rk4, h", "rigid twin",
    ]  # fmt: skip
    own, *others = json.loads(path.read_text())
    assert own["return_per_step"] > 0.7
    assert all(abs(other["lost"]) < 1e-3 and other["verdict"] == "survives" for other in others)
    assert len({other["return_per_step"] for other in [own, *others]}) == 4  # they are other simulations


def test_an_agent_that_needs_the_error_does_not(monkeypatch, capsys):
    """Its return falls wherever the step is not the one it learned with."""

    def evaluate(agent, env_id, kwargs, episodes, seed):
        cheats = "step" not in kwargs
        returns = np.random.default_rng(0).normal(0.9 if cheats else 0.8, 0.01, episodes)
        return Evaluation(agent, seed, returns.tolist(), [500] * episodes, [cheats] * episodes, {})

    monkeypatch.setattr(audit, "evaluate", evaluate)
    assert audit.main(["noop", "--env", "SpringTop-v0", "--episodes", "20"]) == 1
    said = capsys.readouterr().out
    assert "+11.13 ± 0.00 %  DOES NOT SURVIVE" in said
    assert said.count("DOES NOT SURVIVE") == 3


@pytest.mark.parametrize("scale", [1.0, 0.002, 500.0, -0.002])
@pytest.mark.parametrize(
    ("lost", "error", "said"),
    [
        (0.0, 0.0, "survives"),
        (0.0, 0.011, "survives"),
        (0.0, 0.013, "undecided"),
        (0.019, 0.002, "undecided"),
        (0.021, 0.002, "undecided"),
        (0.03, 0.002, "does not survive"),
        (1.0, 0.01, "does not survive"),
        (-1.0, 0.1, "survives"),
    ],
)
def test_the_margin_is_a_share_of_what_is_earned(scale, lost, error, said):
    """Whatever the size of rewards: an agent that loses all it earns does not survive."""
    assert audit.verdict(scale, abs(scale) * lost, abs(scale) * error) == said


def test_of_nothing_nothing_is_known():
    assert audit.verdict(0.0, 0.0, 0.0) == "undecided"
    assert audit.verdict(1.0, float("nan"), 0.0) == "undecided"


@pytest.mark.parametrize(
    ("said", "survives"),
    [
        (["survives"], True),
        (["survives", "not played"], True),
        (["survives", "does not survive"], False),
        (["survives", "undecided"], False),
        (["not played", "not played"], False),
        ([], False),
    ],
)
def test_an_agent_survives_what_is_played(said, survives):
    """What is refused counts as nothing."""
    own = audit.Finding("own", 0.5, 1.0, 0.0, 0.0, "survives")
    others = [audit.Finding("", 0.5, 1.0, 0.0, 0.0, one) for one in said]
    assert audit.survives([own, *others]) == survives
    assert audit.Finding("rigid twin", refused="ropes have none").verdict == "not played"


def test_too_few_episodes_are_told(monkeypatch, capsys):
    def evaluate(agent, env_id, kwargs, episodes, seed):
        returns = np.random.default_rng(len(kwargs)).normal(0.002, 0.001, episodes)
        return Evaluation(agent, seed, returns.tolist(), [500] * episodes, None, {})

    monkeypatch.setattr(audit, "evaluate", evaluate)
    assert audit.main(["noop", "--env", "SpringTop-v0", "--episodes", "20"]) == 1
    assert "undecided: it takes more episodes to tell" in capsys.readouterr().out


@pytest.mark.slow
def test_what_there_is_no_twin_of_is_told(capsys):
    assert audit.main(["noop", "--env", "SpringRope-v0", "--episodes", "2"]) == 0
    assert "has no rigid twin" in capsys.readouterr().out
    assert "rebound otherwise" in dict(audit.simulations("SpringJuggle-v0", {}))["rigid twin"]
