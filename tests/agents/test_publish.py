"""Agents of the repository: each is what its card says, and nobody's but its author's."""

import json
import re
import shutil

import audit
import evaluate
import numpy as np
import publish
import pytest
import results
import runs
import watch

import springgym
from springgym.envs import trained
from springgym.envs.trained import PUBLISHED

CARDS = sorted(PUBLISHED.glob("*/card.json"))
USUAL = ("SpringTop-v0", "SpringTumble-v0")
"""One on a pin, one among surfaces; slow runs play the agents of all others."""


@pytest.mark.own_kernels
@pytest.mark.parametrize(
    "path",
    [pytest.param(path, marks=() if path.parent.name == USUAL[0] else pytest.mark.slow) for path in CARDS],
    ids=lambda path: path.parent.name,
)
def test_it_does_what_its_card_says(path, tmp_path):
    card = json.loads(path.read_text())
    assert path.parent.name == card["task"]
    if isinstance(card["probe"], list):  # the number of older cards is of an earlier protocol
        assert results.same_probe(card["probe"], card["task"]), "the task has changed"
    found = tmp_path / "found.json"
    first = card.get("first_seed", runs.HELD_OUT_SEED)  # older ones were chosen where they are reported
    asked = [card["task"], "--episodes", str(card["episodes"]), "--seed", str(first), "--json", str(found)]
    assert evaluate.main(asked) == 0
    (result,) = json.loads(found.read_text())
    low, high = card["interval"]
    assert low <= result["return_per_step"] <= high
    assert result["success_rate"] == pytest.approx(card["success_rate"], abs=0.03)
    findings = [audit.Finding(**finding) for finding in card["audit"]]
    if card["success_rate"] > 0.1:
        assert audit.survives(findings)
    else:  # it earns too little for the audit to decide
        assert all(finding.verdict != "does not survive" for finding in findings)
    run = runs.open_run(path.parent)
    assert card["command"] == publish.command(run)


def test_there_are_some():
    assert CARDS


@pytest.fixture
def copied(tmp_path, monkeypatch):
    """The repository's agents, to do harm to."""
    shutil.copytree(PUBLISHED, tmp_path / "trained")
    monkeypatch.setattr(trained.published, "__defaults__", (tmp_path / "trained",))
    return tmp_path / "trained"


@pytest.mark.usefixtures("small_pictures")
@pytest.mark.slow
def test_a_film_of_one(copied, tmp_path):
    film = ["--out", str(tmp_path / "rope.gif"), "--set", "max_episode_steps=5"]
    assert watch.main(["SpringRope-v0", *film]) == 0
    assert (tmp_path / "rope.gif").read_bytes().startswith(b"GIF8")


@pytest.mark.parametrize("name", ["agent.npz", "config.yaml"])
def test_one_that_was_changed_is_refused(copied, name, capsys):
    with open(copied / "SpringTop-v0" / name, "ab") as file:
        file.write(b"\n")
    assert evaluate.main(["SpringTop-v0"]) == 2
    assert f"{name}: the file differs from the published one" in capsys.readouterr().err


@pytest.mark.parametrize("text", ["", "[]", "{}", '{"sha256": 3}'])
def test_a_damaged_card(copied, text, capsys):
    (copied / "SpringTop-v0" / "card.json").write_text(text)
    assert evaluate.main(["SpringTop-v0"]) == 2
    assert re.search(r"card\.json: the file is not (JSON|the card of an agent)", capsys.readouterr().err)


@pytest.mark.parametrize("name", ["Absent-v0", "../trained/SpringTop-v0", ""])
def test_there_is_no_such_agent(name):
    with pytest.raises(runs.ConfigError, match="nor a published agent; published agents are Spring"):
        trained.published(name)


def test_it_acts_without_the_scripts():
    """What `springgym.load_agent` gives is what the scripts play, a batch or one at a time."""
    agent = springgym.load_agent("SpringTop-v0")
    assert (agent.name, agent.env_id) == ("SpringTop-v0", "SpringTop-v0")
    env = agent.make(max_episode_steps=50)
    own = runs.open_run(PUBLISHED / "SpringTop-v0")
    policy = agent.policy(env)
    theirs = runs.load_policy(own, env.observation_space, env.action_space)
    observation, _ = env.reset(seed=runs.HELD_OUT_SEED)
    total = 0.0
    over = False
    while not over:
        action = policy(observation)
        np.testing.assert_array_equal(action, theirs(observation[None])[0], strict=True)
        observation, reward, terminated, truncated, _ = env.step(action)
        total = total + reward
        over = terminated or truncated
    played = evaluate.evaluate(str(PUBLISHED / "SpringTop-v0"), "SpringTop-v0", {"max_episode_steps": 50}, 1)
    assert total / 50 == pytest.approx(played.return_per_step, rel=1e-6)


@pytest.mark.parametrize("wrong", [None, 3, True, b"SpringTop-v0"])
def test_what_names_no_agent_is_refused(wrong):
    with pytest.raises(TypeError, match="it must be an environment id or a run folder"):
        springgym.load_agent(wrong)


def test_the_folder_of_an_agent_may_be_incomplete(tmp_path):
    with pytest.raises(ValueError, match="is neither a run folder nor a published agent"):
        springgym.load_agent(tmp_path)
    shutil.copy(PUBLISHED / "SpringTop-v0" / "config.yaml", tmp_path)
    agent = springgym.load_agent(tmp_path)
    with pytest.raises(ValueError, match=r"has no agent\.npz yet"):
        agent.policy(agent.make())
    text = (tmp_path / "config.yaml").read_text()
    (tmp_path / "config.yaml").write_text(
        text.replace("env_kwargs: {observation: features}", "env_kwargs: 5")
    )
    with pytest.raises(ValueError, match="env_kwargs is 5; it must be a mapping"):
        springgym.load_agent(tmp_path)


@pytest.mark.slow
def test_publishing_keeps_the_better_one(copied, tmp_path, capsys, monkeypatch):
    """The same agent again does not replace itself; a better one replaces a worse one, if it is honest."""
    run = PUBLISHED / "SpringTop-v0"
    shutil.copytree(run, tmp_path / "run")
    card = json.loads((run / "card.json").read_text())
    (tmp_path / "run" / "versions.json").write_text(json.dumps(card["versions"]))
    command = [str(tmp_path / "run"), "--into", str(copied), "--audited", "20"]
    assert publish.main(command) == 0
    assert "stays" in capsys.readouterr().out
    with np.load(copied / "SpringTop-v0" / "agent.npz") as file:
        idle = {name: np.zeros_like(values) for name, values in file.items()}
    np.savez(copied / "SpringTop-v0" / "agent.npz", **idle)
    assert publish.main(command) == 0
    found = json.loads((copied / "SpringTop-v0" / "card.json").read_text())
    assert found["mean_return"] == pytest.approx(card["mean_return"], abs=0.05)
    assert found["mean_return"] != found["selection_return"] > 0.5
    is_there = (found["first_seed"], trained.published("SpringTop-v0"))
    assert is_there == (runs.PUBLISHED_SEED, copied / "SpringTop-v0")
    monkeypatch.setattr(publish, "card", lambda *_: {"audit": [{"verdict": "does not survive"}]})
    assert publish.main([*command[:2], str(tmp_path / "empty")]) == 0
    assert "run does not survive the audit" in capsys.readouterr().out


@pytest.mark.slow
def test_a_published_agent_is_evaluated_anew(copied):
    """On episodes that had no part in its choice; how it was made stays, and for which task."""
    path = copied / "SpringTop-v0" / "card.json"
    card = json.loads(path.read_text())
    path.write_text(json.dumps(card | {"mean_return": 0.1, "interval": [0.1, 0.1], "first_seed": 3}))
    command = ["--again", str(path.parent), "--audited", "20"]
    assert publish.main(command) == 0
    found = json.loads(path.read_text())
    assert found["first_seed"] == runs.PUBLISHED_SEED
    assert found["interval"][0] < found["mean_return"] < found["interval"][1]
    same = ("versions", "sha256", "command")
    assert {name: found[name] for name in same} == {name: card[name] for name in same}
    assert found["probe"] == card["probe"] == results.probe("SpringTop-v0")
    assert (found["audited"], "trained_probe" in found) == (20, False)
    path.write_text(json.dumps(card | {"probe": 0.5}))
    for _ in range(2):
        assert publish.main([*command, "--episodes", "10"]) == 0
        found = json.loads(path.read_text())
        assert (found["probe"], found["trained_probe"]) == (card["probe"], 0.5)


def test_what_nobody_could_train_again_is_not_published(copied, tmp_path, capsys):
    shutil.copytree(PUBLISHED / "SpringTop-v0", tmp_path / "run")
    text = (tmp_path / "run" / "config.yaml").read_text()
    (tmp_path / "run" / "config.yaml").write_text(
        text.replace("total_timesteps: 500000", "total_timesteps: 8")
    )
    (tmp_path / "run" / "versions.json").write_text("{}")
    assert publish.main([str(tmp_path / "run"), "--into", str(copied)]) == 2
    assert "was trained with a configuration that differs from configs/ppo.yaml" in capsys.readouterr().err
