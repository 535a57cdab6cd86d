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
    assert all(abs(other["lost"]) < 1e-3 and other["survives"] for other in others)
    assert len({other["return_per_step"] for other in [own, *others]}) == 4  # they are other simulations


def test_an_agent_that_needs_the_error_does_not(monkeypatch, capsys):
    """Its return falls wherever the step is not the one it learned with."""

    def evaluate(agent, env_id, kwargs, episodes, seed):
        cheats = "step" not in kwargs
        returns = np.random.default_rng(0).normal(0.9 if cheats else 0.8, 0.01, episodes)
        return Evaluation(agent, seed, returns.tolist(), [500] * episodes, [cheats] * episodes, {})

    monkeypatch.setattr(audit, "evaluate", evaluate)
    assert audit.main(["zero", "--env", "SpringTop-v0", "--episodes", "20"]) == 1
    said = capsys.readouterr().out
    assert "+0.1000 ± 0.0000  DOES NOT SURVIVE" in said
    assert said.count("DOES NOT SURVIVE") == 3


@pytest.mark.parametrize(
    ("lost", "error", "survives"),
    [(0.0, 0.005, True), (0.0, 0.02, False), (0.019, 0.001, False), (-1, 0.1, True)],
)
def test_what_is_not_certain_does_not_survive(lost, error, survives):
    assert audit.Finding("", 0.5, 1.0, lost, error).survives == survives


def test_what_there_is_no_twin_of_is_told(capsys):
    assert audit.main(["zero", "--env", "SpringRope-v0", "--episodes", "2"]) == 0
    assert "has no rigid twin" in capsys.readouterr().out


@pytest.mark.parametrize(
    ("arguments", "says"),
    [
        (["zero"], "name the environment with --env"),
        (["zero", "--env", "CartPole-v1"], "CartPole-v1 is no environment of springgym's"),
        (["nobody", "--env", "SpringTop-v0"], "unknown controller 'nobody'"),
    ],
)
def test_errors(arguments, says, capsys):
    assert audit.main(arguments) == 2
    assert says in capsys.readouterr().err
