"""Evaluation: exactly one episode per seed, every agent on its own observations."""

import json

import controllers
import evaluate
import gymnasium as gym
import numpy as np
import pytest
import toy_env
from runs import HELD_OUT_SEED


def push_home(observations):
    position, speed = observations.T
    return np.clip(-3 * position - 4 * speed, -1, 1)[:, None].astype(np.float32)


@pytest.fixture
def classical(monkeypatch):
    monkeypatch.setitem(controllers.CLASSICAL, "Toy-v0", {"push": lambda task, seen: push_home(seen)})


def single_episode(seed, act, **kwargs):
    env = gym.make("Toy-v0", **kwargs)
    observation, _ = env.reset(seed=seed)
    total = 0.0
    length = 0
    over = False
    while not over:
        observation, reward, terminated, truncated, _ = env.step(act(observation[None])[0])
        total = total + reward
        length = length + 1
        over = terminated or truncated
    return total, length


def run_away_to_the_right(observations):
    return np.where(observations[:, :1] > 0, 1, push_home(observations)).astype(np.float32)


@pytest.mark.parametrize(("act", "ends_early"), [(push_home, False), (run_away_to_the_right, True)])
def test_one_episode_per_seed(act, ends_early, monkeypatch):
    """Copies that end early start again; that must not count, nor lift the return per step."""
    monkeypatch.setitem(controllers.CLASSICAL, "Toy-v0", {"push": lambda task, seen: act(seen)})
    e = evaluate.evaluate("classical", "Toy-v0", {"push": 0.6}, episodes=12, first_seed=7)
    expected = [single_episode(7 + i, act, push=0.6) for i in range(12)]
    assert e.lengths == [length for _, length in expected]
    per_step = [total / toy_env.LIMIT for total, _ in expected]
    np.testing.assert_allclose(e.returns_per_step, per_step, rtol=1e-6)
    assert (2 * min(e.lengths) < max(e.lengths) < toy_env.LIMIT) == ends_early
    assert len(set(per_step)) == 12


def test_classical_beats_zero_and_random(classical):
    results = {
        name: evaluate.evaluate(name, "Toy-v0", {}, episodes=50) for name in ("noop", "random", "classical")
    }
    assert results["classical"].success_rate == 1.0
    assert results["noop"].success_rate < 0.3
    assert results["random"].success_rate < 0.3
    assert results["random"].return_per_step != results["noop"].return_per_step


def test_command_line(classical, tmp_path, capsys):
    path = tmp_path / "evaluation.json"
    arguments = ["noop", "classical", "--env", "Toy-v0", "--episodes", "5", "--json", str(path)]
    assert evaluate.main([*arguments, "--set", "push=0.3"]) == 0
    out = capsys.readouterr().out
    assert f"Toy-v0: 5 episodes, seeds from {HELD_OUT_SEED}" in out
    header, noop, classical_line = out.splitlines()[1:]
    assert header.split() == ["agent", "return/step", "±", "SD", "success", "steps", "distance"]
    assert noop.startswith("noop")
    assert classical_line.split()[4:6] == ["100", "%"]
    written = json.loads(path.read_text())
    assert [e["agent"] for e in written] == ["noop", "classical"]
    assert len(written[0]["returns_per_step"]) == 5


@pytest.mark.parametrize(
    ("task", "unit", "score"),
    [
        ("SpringDuel-v0", "episode", "0.500 ± 0.500"),
        ("SpringDuelStrong-v0", "episode", "0.500 ± 0.500"),
        ("SpringTop-v0", "step", "0.001 ± 0.001"),
        ("Toy-v0", "step", "0.001 ± 0.001"),
    ],
)
@pytest.mark.parametrize(
    ("successes", "told"), [(None, "–"), ([False, False], "0 %"), ([True, False], "50 %")]
)
def test_a_table_is_in_what_its_task_is_scored_by(task, unit, score, successes, told):
    """A duel is won or lost in one step, so its score is of an episode; no success is a dash."""
    found = evaluate.Evaluation("noop", 0, [0.002, 0.0], [500, 500], successes, {})
    header, line = evaluate.table([found], task).splitlines()
    assert header.split() == ["agent", f"return/{unit}", "±", "SD", "success", "steps"]
    assert line.split() == ["noop", *score.split(), *told.split(), "500"]
