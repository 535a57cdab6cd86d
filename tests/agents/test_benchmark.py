"""The benchmark: a row for every run, none run twice, none lost by a kill."""

import argparse
import itertools
import json
import os
import shutil
import signal
import subprocess
import sys
import time

import benchmark
import pytest
import results
import runs
import train
from conftest import AGENTS, HERE
from stable_baselines3 import PPO
from test_train import PYTHONPATH, assert_same_run, rows

TOY = "toy_env:Toy-v0"


@pytest.fixture(scope="module")
def configs(tmp_path_factory):
    folder = tmp_path_factory.mktemp("configs")
    for algo in ("ppo", "linear"):
        shutil.copy(HERE / f"toy_{algo}.yaml", folder / f"{algo}.yaml")
    return folder


def command(folder, configs, *options, algorithms=("noop", "linear", "ppo")):
    tasks = ["--tasks", TOY, "--algorithms", *algorithms]
    asked = ["--runs", str(folder), "--configs", str(configs), "--episodes", "20", "--seconds", "0"]
    return [*tasks, *asked, "--local", "--jobs", "2", *options]


@pytest.fixture(autouse=True)
def found_by_new_processes(monkeypatch):
    monkeypatch.setenv("PYTHONPATH", os.pathsep.join([PYTHONPATH, str(AGENTS)]))


@pytest.fixture(scope="module")
def done(tmp_path_factory, configs):
    folder = tmp_path_factory.mktemp("runs") / "done"
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("PYTHONPATH", os.pathsep.join([PYTHONPATH, str(AGENTS)]))
        assert benchmark.main(command(folder, configs, "--seeds", "1")) == 0
    return folder


def table(folder):
    found = json.loads((folder / "baselines.json").read_text())
    return {(row["algorithm"], row["seed"]): row for row in found}


def test_rows(done):
    found = table(done)
    assert set(found) == {("noop", 0), ("linear", 0), ("ppo", 0)}
    assert all(list(row) == list(results.FORM) for row in found.values())
    assert all(
        isinstance(value, results.FORM[name]) for row in found.values() for name, value in row.items()
    )  # as JSON has them
    noop, linear, ppo = (found[name, 0] for name in ("noop", "linear", "ppo"))
    assert noop["steps"] == noop["seconds"] == 0
    assert linear["success_rate"] > 0.8 > 0.3 > noop["success_rate"]
    assert (ppo["steps"], ppo["success_rate"]) == (12288, 1.0)
    assert 0 < ppo["seconds"] < 60
    assert ppo["mean_return"] > 0.9 > noop["mean_return"]
    assert ppo["config"] != linear["config"]
    assert ppo["probe"] == linear["probe"]
    assert noop["curve"] == []
    for row in (linear, ppo):
        assert len(row["returns"]) == len(row["successes"]) == 20
        assert row["curve"][-1][0] == row["steps"]
        assert 0 <= row["curve"][0][1] <= row["curve"][-1][1] <= row["seconds"]
        assert row["curve"][0][2] < row["curve"][-1][2]


def test_what_has_a_row_is_left_alone(done, configs, capsys):
    before = (done / "baselines.json").read_bytes()
    assert benchmark.main(command(done, configs, "--seeds", "1")) == 0
    assert "3 runs, 0 of them to do" in capsys.readouterr().out
    assert (done / "baselines.json").read_bytes() == before


@pytest.mark.slow
def test_a_run_is_the_one_of_train(done, tmp_path):
    config = ["--config", str(HERE / "toy_ppo.yaml"), "--episodes", "0"]
    assert train.main([TOY, "--out", str(tmp_path / "run"), *config]) == 0
    assert_same_run(done / "Toy-v0-ppo-0", tmp_path / "run")


def test_linear_control_goes_on_from_its_checkpoint(done, tmp_path, monkeypatch):
    """To the bit, whichever generation it was stopped in."""
    import toy_env

    config = ["--config", str(HERE / "toy_linear.yaml"), "--episodes", "0"]
    monkeypatch.setattr(toy_env, "interrupt_at", 100)
    assert train.main([TOY, "--algo", "linear", "--out", str(tmp_path / "run"), *config]) == 130
    monkeypatch.setattr(toy_env, "interrupt_at", None)
    assert 0 < len(rows(tmp_path / "run")) < len(rows(done / "Toy-v0-linear-0"))
    assert train.main(["--resume", str(tmp_path / "run"), "--episodes", "0"]) == 0
    assert rows(tmp_path / "run") == rows(done / "Toy-v0-linear-0")
    names = [folder / "agent.npz" for folder in (tmp_path / "run", done / "Toy-v0-linear-0")]
    assert names[0].read_bytes() == names[1].read_bytes()


def test_a_run_of_seconds(tmp_path, monkeypatch):
    """It learns for so long whatever its steps, without evaluations, and goes on where it was stopped."""
    import toy_env
    from recorder import Recorder

    ticks = itertools.count()
    folder = tmp_path / "run"
    monkeypatch.setattr(Recorder, "clock", staticmethod(lambda: 0.1 * next(ticks)))  # of which learning calls
    monkeypatch.setattr(toy_env, "interrupt_at", 2000)
    config = ["--config", str(HERE / "toy_ppo.yaml"), "--set", "seconds=5", "anneal=true"]
    assert train.main([TOY, "--out", str(folder), *config]) == 130
    assert 1.5 < results.curve_of(folder)[-1][1] < 4.0
    monkeypatch.setattr(toy_env, "interrupt_at", None)
    assert train.main(["--resume", str(folder), "--episodes", "0"]) == 0
    steps, seconds = benchmark.last_row(folder)
    assert seconds == pytest.approx(5.0, abs=0.3)
    assert steps == pytest.approx(512 * 50, rel=0.1)  # a rollout each time the clock is read
    assert 5 <= len(results.curve_of(folder)) <= 10
    assert PPO.load(folder / "model.zip").learning_rate.left < 0.05
    assert train.main(["--resume", str(folder), "--episodes", "0"]) == 0
    assert benchmark.last_row(folder)[0] == steps


def start(arguments, **environment):
    return subprocess.Popen(
        [sys.executable, str(AGENTS / "benchmark.py"), *arguments],
        env=os.environ | environment, stdout=subprocess.PIPE, stderr=subprocess.STDOUT,
    )  # fmt: skip


def until(condition, seconds=400.0):
    end = time.monotonic() + seconds
    while not condition():
        assert time.monotonic() < end
        time.sleep(0.02)


@pytest.mark.slow
def test_killed_benchmark_goes_on(done, configs, tmp_path):
    """Its runs end with it, and lose what came after their checkpoints only."""
    folder = tmp_path / "killed"
    asked = command(folder, configs, "--seeds", "1", algorithms=["ppo"])
    process = start(asked)
    model = folder / "Toy-v0-ppo-0" / "model.zip"
    until(model.exists)
    process.kill()
    process.communicate()
    assert not (folder / "baselines.json").exists()
    assert int(rows(folder / "Toy-v0-ppo-0")[-1]["timesteps"]) < 12288

    def let_go():
        try:
            with runs.locked(folder / "Toy-v0-ppo-0"):
                return True
        except runs.ConfigError:
            return False

    until(let_go)
    assert benchmark.main(asked) == 0
    assert_same_run(folder / "Toy-v0-ppo-0", done / "Toy-v0-ppo-0")
    differs = {"seconds", "commit", "curve"}
    again = table(folder)["ppo", 0]
    once = table(done)["ppo", 0]
    assert [point[:1] + point[2:] for point in again["curve"]] == [
        point[:1] + point[2:] for point in once["curve"]
    ]
    assert {k: v for k, v in again.items() if k not in differs} == {
        k: v for k, v in once.items() if k not in differs
    }


@pytest.mark.slow
def test_killed_run_does_not_end_the_others(done, configs, tmp_path):
    folder = tmp_path / "killed"
    asked = command(folder, configs, "--seeds", "1", algorithms=["noop", "ppo"])
    process = start(asked, TOY_KILL_AT="300")
    said = process.communicate()[0].decode()
    assert process.returncode == 1, said
    assert f"{TOY} ppo 0 failed: its process ended with status {-signal.SIGKILL}" in said
    assert set(table(folder)) == {("noop", 0)}
    assert benchmark.main(asked) == 0
    assert_same_run(folder / "Toy-v0-ppo-0", done / "Toy-v0-ppo-0")


@pytest.mark.slow
def test_another_configuration_is_another_run(done, configs, tmp_path):
    folder = tmp_path / "runs"
    shutil.copytree(done, folder)
    asked = command(folder, configs, "--seeds", "1", "--set", "total_timesteps=2048", algorithms=["ppo"])
    assert benchmark.main(asked) == 0
    row = table(folder)["ppo", 0]
    assert row["steps"] == 2048
    assert row["config"] != table(done)["ppo", 0]["config"]
    assert len(rows(folder / "Toy-v0-ppo-0.old-1")) == 24


@pytest.mark.parametrize("what", ["task", "commit"])
@pytest.mark.slow
def test_a_changed_task_or_commit_is_another_run(what, done, configs, tmp_path, capsys):
    """A probe that differs from that of the task: its agent was trained on something else."""
    folder = tmp_path / "runs"
    shutil.copytree(done, folder)
    run = folder / "Toy-v0-linear-0"
    found = folder / "baselines.json"
    if what == "task":
        found.write_text(found.read_text().replace('"probe": [0.', '"probe": [1.'))
        (run / "probe.json").write_text("[0.5, 40.0]\n")
    else:  # stopped, and continued at another
        found.write_text("[]")
        made = json.loads((run / "versions.json").read_text())
        (run / "versions.json").write_text(json.dumps(made | {"git_revision": "0" * 40}))
    assert benchmark.main(command(folder, configs, "--seeds", "1", algorithms=["linear"])) == 0
    assert "1 runs, 1 of them to do" in capsys.readouterr().out
    assert (folder / "Toy-v0-linear-0.old-1").is_dir()
    row = table(folder)["linear", 0]
    assert (row["probe"], row["commit"]) == (results.probe(TOY), benchmark.versions()["git_revision"])


def test_rows_are_of_the_commit_at_which_the_process_began(monkeypatch):
    """Writing a row changes the tree, but later rows name the same commit, as the process runs its code."""
    began = benchmark.versions()
    monkeypatch.setattr("runs.subprocess.run", None)
    assert benchmark.versions() == began


def test_a_damaged_table(tmp_path, configs, capsys):
    (tmp_path / "baselines.json").write_text("[{}]")
    assert benchmark.main(command(tmp_path, configs)) == 2
    assert "does not hold rows of results" in capsys.readouterr().err


@pytest.mark.slow
def test_ray_on_the_cores_of_this_machine(done, configs, tmp_path):
    pytest.importorskip("ray")
    asked = [word for word in command(tmp_path, configs, "--seeds", "1") if word != "--local"]
    process = start(asked)
    said = process.communicate()[0].decode()
    assert process.returncode == 0, said
    assert_same_run(tmp_path / "Toy-v0-ppo-0", done / "Toy-v0-ppo-0")
    assert {cell: row["mean_return"] for cell, row in table(tmp_path).items()} == {
        cell: row["mean_return"] for cell, row in table(done).items()
    }


@pytest.mark.slow
def test_a_cluster_that_loses_a_node(tmp_path):
    """Two nodes, of which one is killed while both train: the other goes on, to the rows of a local run.

    Of two tasks and two seeds, with all that is not trained. Only processor time may differ.
    """
    pytest.importorskip("ray")
    from ray.cluster_utils import Cluster

    text = (HERE / "toy_ppo.yaml").read_text()
    (tmp_path / "ppo.yaml").write_text(f"{text}SpringTop-v0: *toy\n")
    algorithms = ["ppo", "noop", "classical"]  # so the first two runs train at once
    asked = ["--tasks", TOY, "SpringTop-v0", "--algorithms", *algorithms, "--seeds", "2", "--episodes", "20"]
    asked += ["--seconds", "0", "--configs", str(tmp_path), "--set", "total_timesteps=65536"]
    local = tmp_path / "local"
    shared = tmp_path / "cluster"
    assert benchmark.main([*asked, "--runs", str(local), "--local", "--jobs", "1"]) == 0

    folders = [shared / f"{task}-ppo-{seed}" for task in ("Toy-v0", "SpringTop-v0") for seed in range(2)]
    whole = len(rows(local / folders[0].name))

    def under_way():
        return [one for one in folders if (one / "model.zip").exists() and len(rows(one)) < whole]

    cluster = Cluster(initialize_head=True, head_node_args={"num_cpus": 1})
    try:
        other = cluster.add_node(num_cpus=1)
        cluster.wait_for_nodes()
        process = start([*asked, "--runs", str(shared), "--address", cluster.address])
        until(lambda: len(under_way()) == 2)
        cluster.remove_node(other, allow_graceful=False)
        cut = under_way()
        said = process.communicate()[0].decode()
        assert process.returncode == 0, said
    finally:
        cluster.shutdown()
    assert len(cut) == 2
    begun = [len(list((one / "tensorboard").iterdir())) for one in cut]
    assert sorted(begun) == [1, 2]  # the killed node's was begun twice
    assert len(json.loads((shared / "baselines.json").read_text())) == 2 * 2 + 2 + 1
    assert without_seconds(shared) == without_seconds(local)
    for folder in folders:
        assert_same_run(folder, local / folder.name)


def without_seconds(folder):
    """The rows of a benchmark, but for processor time."""
    found = json.loads((folder / "baselines.json").read_text())
    for row in found:
        row["seconds"] = 0.0
        row["curve"] = [point[:1] + point[2:] for point in row["curve"]]
    return found


@pytest.mark.parametrize("protocol", [2, None])
def test_rows_of_an_older_protocol_are_made_again(protocol, done, configs, monkeypatch):
    row = table(done)["noop", 0]
    cell = results.Cell(TOY, "noop", 0)
    plan = benchmark.Plan(done, 20, (), configs)
    assert benchmark.is_current(row, cell, plan)
    assert not benchmark.is_current(row | {"protocol": protocol}, cell, plan)
    assert not benchmark.is_current(row | {"probe": [0.5, 40.0]}, cell, plan)
    monkeypatch.setattr(benchmark, "versions", lambda: {"git_revision": 40 * "0"})
    assert not benchmark.is_current(row | {"commit": f"{40 * '0'}-dirty"}, cell, plan)


def test_a_probe_knows_of_controllers_and_of_whole_episodes(monkeypatch):
    """Classical control plays whole episodes in it, so another gain shows."""
    before = results.probe.__wrapped__("SpringTop-v0")
    assert before == results.probe.__wrapped__("SpringTop-v0")
    assert results.same_probe(before, "SpringTop-v0")
    assert before[3] == 500
    steer = benchmark.controllers_of("SpringTop-v0")["torque"]
    changed = {"torque": lambda task, seen: 1.01 * steer(task, seen)}
    monkeypatch.setattr("controllers.CLASSICAL", {"SpringTop-v0": changed})
    after = results.probe.__wrapped__("SpringTop-v0")
    assert after[:2] == before[:2]
    assert after[2] != before[2]
    assert not any(results.same_probe(wrong, "SpringTop-v0") for wrong in (after, before[:2], 0.5))


def test_set_may_be_given_several_times():
    parser = argparse.ArgumentParser()
    benchmark.add_hyperparameters(parser)
    assert parser.parse_args(["--set", "a=1", "b=2", "--set", "c=3"]).overrides == ["a=1", "b=2", "c=3"]


def test_digests_know_of_defaults():
    """What is said and is so by default changes none: nor does a field that is new."""

    def digest(*overrides):
        return results.digest_of(benchmark.load_config("ppo", "SpringTop-v0", overrides))

    assert digest() == digest("anneal=false") == digest("eval_env_kwargs={}")
    assert len({digest(), digest("anneal=true"), digest("gamma=0.9"), digest("env_kwargs.hard=true")}) == 4


def test_a_place_that_takes_no_rows_is_told_before_any_run(tmp_path, capsys, monkeypatch):
    """Also the usual one, which is not an argument."""
    monkeypatch.setattr(benchmark, "run_cells", None)
    (tmp_path / "baselines.json").mkdir()
    asked = ["--tasks", "SpringTop-v0", "--algorithms", "noop", "--local", "--runs", str(tmp_path)]
    assert benchmark.main(asked) == 2
    assert f"benchmark.py: error: {tmp_path / 'baselines.json'}: it is a folder\n" in capsys.readouterr().err
