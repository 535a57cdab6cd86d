"""Rows that somebody hands in: what contradicts itself, its task, its version or its agent is refused."""

import copy
import json
import shutil
from dataclasses import asdict
from itertools import pairwise

import benchmark
import evaluate
import numpy as np
import pytest
import rows
import runs

from springgym.envs.trained import PUBLISHED

TASK = "SpringRope-v0"
COMMIT = "0123456789abcdef" * 2 + "01234567"


@pytest.fixture(scope="module")
def zero(tmp_path_factory):
    plan = benchmark.Plan(tmp_path_factory.mktemp("zero"), benchmark.EPISODES, (), None)
    return benchmark.measured(benchmark.Cell(TASK, "zero", 0), plan) | {"commit": COMMIT}


@pytest.fixture(scope="module")
def agents(tmp_path_factory):
    """A folder of run folders, of the published agent of the crane."""
    folder, run = tmp_path_factory.mktemp("agents"), runs.open_run(PUBLISHED / TASK)
    shutil.copytree(PUBLISHED / TASK, folder / f"{TASK}-ppo-{run.seed}")
    return folder


@pytest.fixture(scope="module")
def trained(zero):
    """The row of that agent, with what its run folder would have told."""
    run = runs.open_run(PUBLISHED / TASK)
    found = evaluate.evaluate(str(run.folder), TASK, evaluate.task_kwargs(run.config))
    returns = [round(one, 5) for one in found.returns_per_step]
    return zero | {
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
        "config": benchmark.digest_of(run.config),
    }


def told(path, given, *options):
    path.write_text(json.dumps(given))
    return benchmark.main(["--check", str(path), *options])


def test_true_rows_pass(zero, trained, agents, tmp_path, capsys):
    plan = benchmark.Plan(tmp_path, benchmark.EPISODES, (), None)
    drawn = benchmark.measured(benchmark.Cell(TASK, "random", 0), plan) | {"commit": COMMIT}
    assert told(tmp_path / "rows.json", [zero, drawn, trained], "--agents", str(agents)) == 0
    assert "3 rows, 0 refused, 0 consistent but not played again" in capsys.readouterr().out


def test_without_agents_it_says_what_it_does_not_know(trained, tmp_path, capsys):
    assert told(tmp_path / "rows.json", [trained]) == 0
    out = capsys.readouterr().out
    assert "1 consistent but not played again" in out
    assert "may have been made up consistently" in out


def changed(**values):
    return lambda row: row | values


def without(name):
    return lambda row: {key: value for key, value in row.items() if key != name}


def better(row):
    """A row made up by hand: all that it says of its episodes agrees with its summary."""
    returns = [round(0.9 + 0.001 * (n % 7), 5) for n in range(row["episodes"])]
    mean = round(sum(returns) / len(returns), 6)
    return row | {"returns": returns, "mean_return": mean, "successes": [1] * 100, "success_rate": 1.0}


def with_configuration(**values):
    return lambda row: row | {"configuration": row["configuration"] | values}


def curve_of(*points):
    return changed(curve=[list(point) for point in points])


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
        (changed(mean_return=float("nan")), "mean_return is nan"),
        (changed(seconds=float("inf")), "seconds is inf"),
        (changed(springgym="0.0.1"), "it was made with springgym 0.0.1"),
        (changed(task="SpringRope-v9"), "no task 'SpringRope-v9'"),
        (changed(task="os:Rope-v0"), "no task 'os:Rope-v0'"),
        (changed(probe=0.5), "its task was another one: the probe is 0.5"),
        (changed(task="SpringDetumble-v0"), "its task was another one"),
        (changed(commit=f"{COMMIT}-dirty"), "the tree must not differ"),
        (changed(commit="unknown"), "its commit is 'unknown'"),
        (changed(algorithm="My PPO"), "write it in lower case"),
        (changed(configuration={}), "it has no configuration"),
        (with_configuration(learning_rate=1e-3), "the digest of its configuration is"),
        (with_configuration(lr=1e-3), "unknown key 'lr'"),
        (changed(config="00000000"), "and the row says '00000000'"),
        (with_configuration(imitate=1000), "the digest of its configuration is"),
        (changed(used=["luck"]), "used is ['luck']"),
        (changed(used=["imitation"]), "by its configuration it used []"),
        (changed(steps=400_000), "it took 400000 steps, and its configuration asks for 800000"),
        (changed(seed=1_000_000), "its seed is 1000000"),
        (changed(first_seed=0), "from seed 0"),
        (changed(episodes=50), "it is of 50 episodes"),
        (changed(episodes=101), "returns must be 101 numbers"),
        (changed(returns=["1"] * 100), "returns must be 100 numbers"),
        (changed(returns=[2.0] * 100), "returns must be 100 numbers from -1 to 1"),
        (changed(mean_return=0.9), "its mean return is 0.9, and that of its episodes"),
        (changed(returns=[0.9] * 100, mean_return=0.9), "all its episodes return 0.9"),
        (changed(success_rate=0.5), "its success rate is 0.5, and that of its episodes"),
        (changed(successes=None), "must both be there"),
        (changed(successes=[1.0] * 100), "successes must be 100 of 0 and 1"),
        (changed(curve=[]), "it has no learning curve"),
        (curve_of((1, 1, 1)), "a point of its curve"),
        (curve_of((1, 1, None, 1)), "a point of its curve"),
        (curve_of((9, 1, 0.1, None), (8, 2, 0.1, None)), "goes back"),
        (curve_of((8, 2, 0.1, None), (9, 1, 0.1, None)), "goes back"),
        (curve_of((900_000, 1, 0.1, None)), "its curve reaches 900000 steps"),
        (better, "return otherwise when they are played again"),
    ],
)
def test_what_is_wrong_is_refused(change, says, trained, agents, tmp_path, capsys):
    wrong = change(copy.deepcopy(trained))
    assert told(tmp_path / "rows.json", [wrong], "--agents", str(agents)) == 1
    assert says in capsys.readouterr().err


@pytest.mark.parametrize(
    ("change", "says"),
    [
        (better, "return otherwise when they are played again"),
        (changed(steps=5), "nothing is trained"),
        (changed(algorithm="random", config="00000000"), "and the row says '00000000'"),
        (changed(algorithm="classical"), "the digest of its configuration is"),
    ],
)
def test_what_is_wrong_with_rows_without_training(change, says, zero, tmp_path, capsys):
    assert told(tmp_path / "rows.json", [change(zero)]) == 1
    assert says in capsys.readouterr().err


def test_algorithms_of_others_are_known_by_their_configuration(trained, tmp_path, capsys):
    own = {"width": 3}
    row = trained | {"algorithm": "dreamer", "configuration": own, "used": ["planning"]}
    assert told(tmp_path / "rows.json", [row]) == 1
    digest = capsys.readouterr().err.partition("configuration is ")[2].partition(",")[0]
    assert told(tmp_path / "rows.json", [row | {"config": digest}]) == 0


def test_a_row_that_is_there_twice(zero, tmp_path, capsys):
    assert told(tmp_path / "rows.json", [zero, zero]) == 1
    assert "several rows of this task, algorithm and seed" in capsys.readouterr().err


def test_the_agent_of_another_configuration(trained, agents, tmp_path, capsys):
    shutil.copytree(agents, tmp_path / "agents")
    (file,) = (tmp_path / "agents").glob("*/config.yaml")
    file.write_text(file.read_text().replace("gamma: 0.99", "gamma: 0.98"))
    assert told(tmp_path / "rows.json", [trained], "--agents", str(tmp_path / "agents")) == 1
    assert "a run of another task, algorithm, seed or configuration" in capsys.readouterr().err


@pytest.mark.parametrize("text", ["", "{", "{}", "3", "null"])
def test_a_damaged_file(text, tmp_path, capsys):
    (tmp_path / "rows.json").write_text(text)
    assert benchmark.main(["--check", str(tmp_path / "rows.json")]) == 2
    assert "rows.json: the file" in capsys.readouterr().err


def test_there_is_no_such_file(tmp_path, capsys):
    assert benchmark.main(["--check", str(tmp_path / "absent.json")]) == 2
    assert "absent.json" in capsys.readouterr().err


def test_agents_belong_to_the_check(capsys):
    with pytest.raises(SystemExit):
        benchmark.main(["--agents", "runs", "--local"])
    assert "--agents belongs to --check" in capsys.readouterr().err


def test_ranges_of_seeds_do_not_meet():
    """Training, selection, curves, reports of runs and of chosen agents share no episode."""
    first = [runs.HELD_OUT_SEED, runs.SELECTION_SEED, runs.PROGRESS_SEED, runs.PUBLISHED_SEED]
    assert np.diff([0, *first]).min() >= runs.MOST_REPORTED
    assert first[-1] + runs.MOST_REPORTED < evaluate.LAST_SEED


def test_a_curve_is_thinned_and_keeps_its_end(tmp_path):
    lines = ["timesteps,seconds,return_per_step,success_rate"]
    lines += [f"{100 * n},{n},{n / 1000},{'' if n % 2 else 0.5}" for n in range(1, 100)]
    (tmp_path / "progress.csv").write_text("\n".join(lines) + "\n")
    found = rows.curve(tmp_path)
    assert len(found) == 33
    assert found[-1] == [9900, 99.0, 0.099, None]
    assert {b[0] - a[0] for a, b in pairwise(found)} == {300}
    (tmp_path / "progress.csv").write_text("\n".join(lines[:1]) + "\n")
    assert rows.curve(tmp_path) == []
