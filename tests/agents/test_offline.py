"""Learning from data sets alone: what it learns, what it writes, and what it refuses."""

import json

import benchmark
import config
import dataset
import evaluate
import numpy as np
import offline
import pytest
import results
import runs

TASK = "SpringRope-v0"
OTHER = "SpringTop-v0"
RANDOM = "springgym/SpringRope/random-v0"
COMMIT = "0123456789abcdef" * 2 + "01234567"

pytestmark = pytest.mark.filterwarnings("ignore::UserWarning:minari")


@pytest.fixture(scope="module")
def data(tmp_path_factory):
    """Short episodes, in a folder of Minari's of its own."""
    pytest.importorskip("minari")
    pytest.importorskip("torchrl")
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("MINARI_DATASETS_PATH", str(tmp_path_factory.mktemp("minari")))
        short = ["--episodes", "4", "--set", "max_episode_steps=20"]
        assert dataset.main([TASK, "random", "classical", *short]) == 0
        assert dataset.main([OTHER, "random", *short]) == 0
        assert dataset.main([TASK, "noop", *short[:2], "--seed", str(runs.HELD_OUT_SEED + 7)]) == 0
        yield


def learned(folder, *options, name=RANDOM):
    """The run of 50 updates, and its row."""
    rows = folder.with_name("rows.json")
    asked = [TASK, "--data", name, "--steps", "50", "--out", str(folder), "--rows", str(rows), *options]
    assert offline.main(asked) == 0
    return runs.open_run(folder), json.loads(rows.read_text())


@pytest.mark.slow
def test_a_run_is_evaluated_and_checked_like_others(data, tmp_path, capsys):
    run, rows = learned(tmp_path / "SpringRope-v0-iql-random-v0-0")
    (row,) = rows
    assert (run.config.total_timesteps, run.config.data) == (50, [RANDOM])
    assert row["used"] == ["data"]
    (own,) = row["data"]
    assert (own["id"], own["agent"], own["episodes"]) == (RANDOM, "random", 4)
    assert 4 <= own["transitions"] <= 80
    again = evaluate.evaluate(str(run.folder), TASK, evaluate.task_kwargs(run.config))
    assert np.allclose(again.returns_per_step, row["returns"], atol=1e-5)
    (tmp_path / "rows.json").write_text(json.dumps([row | {"commit": COMMIT}]))
    asked = ["--check", str(tmp_path / "rows.json"), "--agents", str(tmp_path)]
    assert benchmark.main(asked) == 0
    assert "1 rows, 0 refused, 0 not played again" in capsys.readouterr().out
    unnamed = {key: value for key, value in row.items() if key != "data"}
    for wrong in (unnamed, row | {"used": []}):
        assert "'data' only with data" in results.refusal(wrong)


@pytest.mark.slow
def test_same_data_and_seed_same_agent(data, tmp_path):
    """Rows of other seeds and data are added; the row of the same run takes the place of the old one."""
    found = {}
    for name, options in {"a": [], "b": [], "c": ["--seed", "1"]}.items():
        run, rows = learned(tmp_path / name, *options)
        found[name] = run.agent.read_bytes()
    assert found["a"] == found["b"] != found["c"]
    assert [row["seed"] for row in rows] == [0, 1]


def test_transitions_are_those_of_the_episodes(data):
    import minari

    found = offline.read_data([RANDOM], TASK)
    at = 0
    for episode in minari.load_dataset(RANDOM).iterate_episodes():
        part = slice(at, at + len(episode))
        np.testing.assert_array_equal(found.observations[part], episode.observations[:-1])
        np.testing.assert_array_equal(found.following[part], episode.observations[1:])
        np.testing.assert_allclose(found.actions[part], episode.actions, atol=1e-6)
        np.testing.assert_allclose(found.rewards[part], episode.rewards, rtol=1e-6)
        np.testing.assert_array_equal(found.terminated[part], episode.terminations)
        at += len(episode)
    assert at == len(found.rewards) == found.sources[0]["transitions"]


def settings(**changes):
    values = {"total_timesteps": 150, "net_arch": "[32, 32]", "learning_rate": 1e-2, **changes}
    return config.load_config("iql", TASK, [f"{key}={value}" for key, value in values.items()])


@pytest.mark.slow
def test_it_prefers_what_was_rewarded():
    """Episodes of one step, with random actions, of which those near half the observation are rewarded."""
    pytest.importorskip("torchrl")
    rng = np.random.default_rng(0)
    seen, done = rng.uniform(-1, 1, (2, 4000, 1)).astype(np.float32)
    rewards = (-4 * (done - 0.5 * seen) ** 2)[:, 0]
    given = offline.Data(seen, done, rewards, seen, np.ones(4000, np.float32), {}, [])

    def error(temperature):
        arrays = offline.fit(given, settings(temperature=temperature), 0)
        mean = arrays["observations.mean"]
        variance = arrays["observations.variance"]
        x = ((seen - mean) / np.sqrt(variance)).astype(np.float32)
        for name in ("actor.latent_pi.0", "actor.latent_pi.2", "actor.mu"):
            x = x @ arrays[f"{name}.weight"].T + arrays[f"{name}.bias"]
            x = np.tanh(x) if name == "actor.mu" else np.maximum(x, 0)
        return float(np.abs(x - 0.5 * seen).mean())

    assert error(temperature=3) < 0.5 * error(temperature=0)


@pytest.mark.parametrize(
    ("asked", "says"),
    [
        (["springgym/SpringRope/absent-v0"], "absent-v0: there is no such data set; Minari's folder has"),
        (["springgym/SpringTop/random-v0"], "its episodes are of SpringTop-v0, not of SpringRope-v0"),
        ([RANDOM, RANDOM], "names a data set twice"),
        ([RANDOM, "springgym/SpringRope/classical-v0"], "its environment has"),
        (["springgym/SpringRope/noop-v0"], "belong to the evaluation"),
        ([RANDOM, "--set", "env_kwargs.observation=features"], "cannot be changed"),
        ([RANDOM, "--set", "expectile=1.5"], "expectile: must lie between 0.0 and 1.0, got 1.5"),
        ([RANDOM, "--set", "updates=3"], "unknown key 'updates'"),
    ],
)
def test_what_is_wrong_is_told_before_anything_is_learned(data, asked, says, tmp_path, capsys):
    assert offline.main([TASK, "--out", str(tmp_path / "run"), "--steps", "1", "--data", *asked]) == 2
    assert says in capsys.readouterr().err
    assert not (tmp_path / "run").exists()


def test_a_folder_or_file_that_holds_something_else(data, tmp_path, capsys):
    asked = [TASK, "--data", RANDOM, "--out", str(tmp_path)]
    (tmp_path / "rows.json").write_text("[{}]")
    assert offline.main([*asked, "--rows", str(tmp_path / "rows.json")]) == 2
    assert "does not hold rows of results" in capsys.readouterr().err
    (tmp_path / "config.yaml").write_text("")
    assert offline.main(asked) == 2
    assert "holds a run already" in capsys.readouterr().err


@pytest.mark.parametrize(("package", "name"), [("minari", "Minari"), ("torchrl", "TorchRL")])
def test_without_its_packages_it_says_how_to_get_them(package, name, monkeypatch, capsys):
    monkeypatch.setattr(offline, "find_spec", lambda asked: None if asked == package else asked)
    assert offline.main([TASK, "--data", RANDOM]) == 2
    told = capsys.readouterr().err
    assert f"offline.py needs {name}: pip install" in told
    assert "[offline]" in told
