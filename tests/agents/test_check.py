"""Rows that somebody hands in: what contradicts itself, its task, its version or its agent is refused."""

import copy
import json
import os
import shutil
import subprocess
import sys
from dataclasses import asdict
from itertools import pairwise

import benchmark
import evaluate
import numpy as np
import pytest
import results
import runs

from springgym.envs.trained import PUBLISHED
from tests.test_docs import page_writer

TASK = "SpringRope-v0"
COMMIT = "0123456789abcdef" * 2 + "01234567"


@pytest.fixture(scope="module")
def noop(tmp_path_factory):
    plan = benchmark.Plan(tmp_path_factory.mktemp("noop"), results.EPISODES, (), None)
    return benchmark.run_cell(results.Cell(TASK, "noop", 0), plan) | {"commit": COMMIT}


@pytest.fixture(scope="module")
def agents(tmp_path_factory):
    """A folder of run folders, of the published agent of the crane."""
    folder = tmp_path_factory.mktemp("agents")
    run = runs.open_run(PUBLISHED / TASK)
    shutil.copytree(PUBLISHED / TASK, folder / f"{TASK}-ppo-{run.seed}")
    return folder


@pytest.fixture(scope="module")
def trained(noop):
    """The row of that agent, with what its run folder would have told."""
    run = runs.open_run(PUBLISHED / TASK)
    found = evaluate.evaluate(str(run.folder), TASK, evaluate.task_kwargs(run.config))
    returns = [round(one, 5) for one in found.returns_per_step]
    return noop | {
        "algorithm": "ppo",
        "seed": run.seed,
        "steps": 802816,
        "seconds": 30.0,
        "success_rate": found.success_rate,
        "mean_return": round(float(np.mean(returns)), 6),
        "returns": returns,
        "successes": [int(one) for one in found.successes],
        "curve": [[409600, 14.0, 0.4, 0.5], [802816, 29.0, 0.7, 1.0]],
        "configuration": asdict(run.config),
        "config": results.digest_of(run.config),
    }


def check_rows(path, given, *options):
    path.write_text(json.dumps(given))
    return benchmark.main(["--check", str(path), *options])


def test_true_rows_pass(noop, trained, agents, tmp_path, capsys):
    plan = benchmark.Plan(tmp_path, results.EPISODES, (), None)
    drawn = benchmark.run_cell(results.Cell(TASK, "random", 0), plan) | {"commit": COMMIT}
    assert check_rows(tmp_path / "rows.json", [noop, drawn, trained], "--agents", str(agents)) == 0
    assert "3 rows, 0 refused, 0 not played again" in capsys.readouterr().out


def test_without_agents_it_says_what_it_does_not_know(trained, tmp_path, capsys):
    assert check_rows(tmp_path / "rows.json", [trained]) == 0
    assert "0 refused, 1 not played again, as there is no agent" in capsys.readouterr().out


def changed(**values):
    return lambda row: row | values


def without(name):
    return lambda row: {key: value for key, value in row.items() if key != name}


def better(row):
    """A row made up by hand: all that it says of its episodes agrees with its summary."""
    returns = [round(0.9 + 0.001 * (n % 7), 5) for n in range(row["episodes"])]
    mean = round(sum(returns) / len(returns), 6)
    return row | {"returns": returns, "mean_return": mean, "successes": [1] * 100, "success_rate": 1.0}


@pytest.mark.parametrize(
    ("change", "says"),
    [
        (lambda row: [], "a row is a mapping, got list"),
        (changed(protocol=None), "its protocol is None"),
        (without("protocol"), "its protocol is None"),
        (without("returns"), "it has no returns"),
        (without("configuration"), "it has no configuration"),
        (changed(note=""), "it has note, which is unknown"),
        (changed(seed=True), "seed is True"),
        (changed(mean_return=float("nan")), "its mean_return is nan"),
        (changed(config="00000000"), "a run of another task, algorithm, seed or configuration"),
        (changed(task="SpringRope-v9"), "no task 'SpringRope-v9'"),
        (changed(task="os:Rope-v0"), "no task 'os:Rope-v0'"),
        (changed(protocol=1, probe=0.5), "its protocol is 1; this version knows 3"),
        (changed(probe=[0.5]), "its task was another one: the probe is [0.5]"),
        (changed(task="SpringDetumble-v0"), "its task was another one"),
        (changed(commit=f"{COMMIT}-dirty"), "the tree must not differ"),
        (changed(commit="unknown"), "its commit is 'unknown'"),
        (changed(used=["luck"]), "used is ['luck']"),
        (changed(used=["data"]), "used is ['data']"),
        (changed(data=[]), "'data' only with data"),
        (changed(data=[1], used=["data"]), "data is [1]; it must be a list of data sets with their ids"),
        (changed(data=[{"id": []}], used=["data"]), "it must be a list of data sets with their ids"),
        (changed(**{"\x1b[31m": 0}), r"it has \x1b[31m, which is unknown"),
        (changed(seed=1_000_000), "its seed is 1000000"),
        (changed(first_seed=0), "from seed 0"),
        (changed(episodes=50), "it is of 50 episodes"),
        (changed(episodes=101), "returns must be 101 numbers"),
        (changed(returns=["1"] * 100), "returns must be 100 numbers"),
        (changed(returns=[2.0] * 100), "returns must be 100 numbers from -1 to 1"),
        (changed(mean_return=0.9), "its mean_return is 0.9, and that of its episodes"),
        (changed(success_rate=0.5), "its success_rate is 0.5, and that of its episodes"),
        (changed(successes=None), "successes must be 100 numbers"),
        (changed(successes=[-1] * 100), "successes must be 100 numbers from 0 to 1"),
        (better, "played again, its episodes return otherwise"),
    ],
)
def test_what_is_wrong_is_refused(change, says, trained, agents, tmp_path, capsys):
    wrong = change(copy.deepcopy(trained))
    assert check_rows(tmp_path / "rows.json", [wrong], "--agents", str(agents)) == 1
    assert says in capsys.readouterr().err


def test_what_is_wrong_with_a_row_without_training_is_played(noop, tmp_path, capsys):
    assert check_rows(tmp_path / "rows.json", [better(noop)]) == 1
    assert "played again, its episodes return otherwise" in capsys.readouterr().err


def test_a_row_that_is_there_twice(noop, tmp_path, capsys):
    assert check_rows(tmp_path / "rows.json", [noop, noop]) == 1
    assert "several rows of this task, algorithm and seed" in capsys.readouterr().err


def test_the_agent_of_another_configuration(trained, agents, tmp_path, capsys):
    shutil.copytree(agents, tmp_path / "agents")
    (file,) = (tmp_path / "agents").glob("*/config.yaml")
    file.write_text(file.read_text().replace("gamma: 0.99", "gamma: 0.98"))
    assert check_rows(tmp_path / "rows.json", [trained], "--agents", str(tmp_path / "agents")) == 1
    assert "a run of another task, algorithm, seed or configuration" in capsys.readouterr().err


DAMAGED = ("", "{", "{}", "3", "null", "[" * 100_000)


@pytest.mark.parametrize("text", [*DAMAGED, "a pipe", "a folder", "nothing"])
def test_a_damaged_file(text, tmp_path, capsys):
    """Nothing hangs, or ends with a traceback, in any of the readers of rows."""
    path = tmp_path / "rows.json"
    if text in DAMAGED:
        path.write_text(text)
    if text == "a pipe":
        os.mkfifo(path)
    if text == "a folder":
        path.mkdir()
    assert benchmark.main(["--check", str(path)]) == 2
    assert "rows.json: " in capsys.readouterr().err
    if text not in ("nothing", "{}"):
        with pytest.raises(results.ConfigError, match=r"rows\.json: "):
            results.read_rows(path)
    with pytest.raises(results.ConfigError, match=r"rows\.json: "):
        page_writer("baselines").read(path)


ADDER = """
import sys
from pathlib import Path
import results

path, seeds = Path(sys.argv[1]), range(*map(int, sys.argv[2:]))
print("ready", flush=True)
input()
for seed in seeds:
    results.add_row(path, {"task": "a", "algorithm": "b", "seed": seed})
"""


def test_two_processes_that_add_rows_at_once_lose_none(tmp_path):
    path = tmp_path / "rows.json"
    places = os.pathsep.join([os.path.dirname(results.__file__), os.environ.get("PYTHONPATH", "")])
    adding = [
        subprocess.Popen(
            [sys.executable, "-c", ADDER, str(path), str(first), str(first + 100)],
            env=os.environ | {"PYTHONPATH": places},
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            text=True,
        )
        for first in (0, 100)
    ]
    for process in adding:
        assert process.stdout.readline() == "ready\n"
    for process in adding:
        process.stdin.write("\n")
        process.stdin.flush()
    for process in adding:
        process.communicate()
        assert process.returncode == 0
    assert [row["seed"] for row in results.read_rows(path).values()] == list(range(200))


def test_ranges_of_seeds_do_not_meet():
    """Training, selection, curves, reports of runs and of chosen agents share no episode."""
    first = [runs.HELD_OUT_SEED, runs.SELECTION_SEED, runs.PROGRESS_SEED, runs.PUBLISHED_SEED]
    first += [runs.DATASET_SEED]
    assert np.diff([0, *first]).min() >= evaluate.MOST_EPISODES
    assert first[-1] + evaluate.MOST_EPISODES < evaluate.LAST_SEED


def test_a_curve_is_thinned_and_keeps_its_end(tmp_path):
    lines = ["timesteps,seconds,return_per_step,success_rate"]
    lines += [f"{100 * n},{n},{n / 1000},{'' if n % 2 else 0.5}" for n in range(1, 100)]
    (tmp_path / "progress.csv").write_text("\n".join(lines) + "\n")
    found = results.curve_of(tmp_path)
    assert len(found) == 50
    assert found[-1] == [9900, 99.0, 0.099, None]
    assert {b[0] - a[0] for a, b in pairwise(found)} == {200}
    (tmp_path / "progress.csv").write_text("\n".join(lines[:1]) + "\n")
    assert results.curve_of(tmp_path) == []
