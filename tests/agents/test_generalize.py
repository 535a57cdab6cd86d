"""Test which agents play in which worlds, what a row holds, and which rows are kept."""

import json

import generalize
import pytest
from evaluate import Evaluation

from springgym.envs.registration import ENVIRONMENTS
from springgym.envs.trained import PUBLISHED
from tests.params import slow_but


@pytest.fixture
def plays(monkeypatch):
    """Replace `evaluate`: episodes return .9, or .3 where masses vary, and no task has a rigid twin."""
    played = []

    def evaluate(agent, env_id, kwargs, episodes, first_seed=1_000_000):
        if kwargs.get("dynamics") == "rigid":
            raise generalize.ConfigError("it has no rigid twin")
        played.append((env_id, agent.rpartition("/")[2], kwargs))
        returned = 0.3 if "masses" in kwargs.get("randomize", {}) else 0.9
        return Evaluation(agent, first_seed, [returned] * episodes, [1] * episodes, [True] * episodes, {})

    monkeypatch.setattr(generalize, "evaluate", evaluate)
    return played


@pytest.mark.slow
def test_every_agent_plays_in_every_world(plays, tmp_path, capsys):
    path = tmp_path / "rows.json"
    command = ["SpringTop-v0", "--episodes", "4", "--rows", str(path)]
    assert generalize.main(command) == 0
    rows = json.loads(path.read_text())
    assert [(row["agent"], row["world"]) for row in rows] == [
        (agent, world) for agent in ("ppo", "classical") for world in generalize.WORLDS
    ]
    said = capsys.readouterr().out
    assert "| `SpringTop-v0` | classical | 100 %, 1.00 |  | 100 %, 1.00 | 100 %, 0.33 |" in said
    assert "SpringTop-v0, rigid: it has no rigid twin" in said
    assert rows[1]["refused"] == "it has no rigid twin"
    assert "mean_return" not in rows[1]
    assert {row["commit"] for row in rows} == {rows[0]["commit"]}
    assert len(plays) == 2 * (len(generalize.WORLDS) - 1)

    assert generalize.main(command) == 0  # all rows are kept
    assert json.loads(path.read_text()) == rows
    assert len(plays) == 2 * (len(generalize.WORLDS) - 1)

    rows[0]["probe"][0] += 1  # this one is of another task
    path.write_text(json.dumps(rows))
    assert generalize.main(command) == 0
    assert len(plays) == 2 * (len(generalize.WORLDS) - 1) + 1


def test_every_task_has_agents():
    for row in ENVIRONMENTS:
        agents = [agent for agent, _ in generalize.agents_of(row.id)]
        assert agents[-1] == "classical"
        assert len(agents) == 1 + (PUBLISHED / row.id).is_dir()


@pytest.mark.parametrize("task", slow_but(["SpringTop-v0", "SpringRope-v0"], "SpringRope-v0"))
def test_worlds_are_played(task):
    """The first world is that of the task, another differs, and a rope has no rigid twin."""
    own = generalize.played(task, "classical", "as it is", 4)
    other = generalize.played(task, "classical", "varied", 4)
    assert own["mean_return"] > 0.3
    assert own["mean_return"] != other["mean_return"]
    assert ("refused" in generalize.played(task, "classical", "rigid", 4)) == (task == "SpringRope-v0")
