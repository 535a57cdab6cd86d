"""Training: what a run leaves, and that a stopped run goes on as if it had never stopped."""

import csv
import errno
import io
import json
import os
import pickle
import shutil
import signal
import subprocess
import sys
import zipfile
from pathlib import Path
from types import SimpleNamespace

import agent
import config
import evaluate
import learner
import numpy as np
import pytest
import recorder
import results
import runs
import toy_env
import train
from conftest import AGENTS, HERE
from stable_baselines3 import PPO
from tensorboard.backend.event_processing.event_accumulator import EventAccumulator

PYTHONPATH = os.pathsep.join([str(HERE), str(AGENTS.parent)])


def start(folder, *options, algo="ppo", env_id="toy_env:Toy-v0"):
    config = ["--config", str(HERE / f"toy_{algo}.yaml")]
    return [env_id, "--algo", algo, "--out", str(folder), *config, *options]


def rows(folder, name="metrics.csv"):
    """A table of a run without the clock."""
    with open(folder / name, newline="") as file:
        return [{k: v for k, v in row.items() if k != "seconds"} for row in csv.DictReader(file)]


def weights(folder):
    """Timesteps, and the weights and the second moments of every optimiser of a checkpoint."""
    run = runs.open_run(folder)
    model = agent.ALGORITHMS[run.algo].load(run.model, device="cpu")
    values = {}
    for part, parameters in model.get_parameters().items():
        if part.endswith("optimizer"):
            moments = {i: state["exp_avg_sq"] for i, state in parameters["state"].items()}
            values |= {f"{part}.{i}": moment.numpy() for i, moment in moments.items()}
        else:
            values |= {f"{part}.{k}": value.numpy() for k, value in parameters.items()}
    return model.num_timesteps, values


def assert_same_run(folder, reference):
    assert rows(folder) == rows(reference)
    progress = rows(folder, "progress.csv")  # which has a row at each end, too
    assert all(row in progress for row in rows(reference, "progress.csv"))
    steps, ours = weights(folder)
    steps2, theirs = weights(reference)
    assert steps == steps2
    assert ours.keys() == theirs.keys()
    for key in ours:
        np.testing.assert_array_equal(ours[key], theirs[key], err_msg=key)


def test_runs_of_neighbouring_seeds_share_no_start(tmp_path):
    starts = []
    for seed in (0, 1):
        settings = config.load_config("ppo", "toy_env:Toy-v0", [], HERE / "toy_ppo.yaml")
        run = runs.Run(tmp_path, "ppo", "toy_env:Toy-v0", seed, settings)
        env = learner.make_training_env(run)
        starts.append(learner.new_model(run, env).get_env().reset())
        starts.append(env.reset())  # the episodes after
    starts = np.concatenate(starts)
    assert len(np.unique(starts, axis=0)) == len(starts) > 20


@pytest.fixture(scope="module")
def finished(tmp_path_factory):
    """A whole run, from the command line to the video."""
    folder = tmp_path_factory.mktemp("runs") / "finished"
    assert train.main(start(folder)) == 0
    return folder


def test_a_run_learns_and_leaves_everything(finished):
    first, *_, last = rows(finished)
    assert float(first["reward_per_step"]) < 0.6 < 0.85 < float(last["reward_per_step"])
    assert int(last["timesteps"]) == 12288
    trained, noop, random = json.loads((finished / "evaluation.json").read_text())
    assert [e["agent"] for e in (trained, noop, random)] == [str(finished), "noop", "random"]
    assert trained["success_rate"] > 0.9 > 0.5 > max(noop["success_rate"], random["success_rate"])
    assert trained["return_per_step"] > 0.9
    assert (finished / "learning_curve.png").read_bytes().startswith(b"\x89PNG")
    assert (finished / "episode.gif").read_bytes().startswith(b"GIF8")
    assert json.loads((finished / "versions.json").read_text())["packages"]["stable-baselines3"]
    run = runs.open_run(finished)
    assert (run.algo, run.env_id, run.seed) == ("ppo", "toy_env:Toy-v0", 0)
    assert run.config.learning_rate == 3e-3
    assert PPO.load(finished / "model.zip").num_timesteps == 12288
    assert not list(finished.glob(".*"))


def test_the_figure_of_a_run_shows_what_counts(tmp_path, monkeypatch):
    """The evaluation is the thickest line; colours are those of the site, and each line has a name."""
    counted = [{"timesteps": n, "return_per_step": r, "success_rate": r} for n, r in ((0, 0.1), (9000, 0.5))]
    with open(tmp_path / "metrics.csv", "w") as file:
        file.write("timesteps,reward_per_step,return_per_step,success_rate\n0,0.2,,\n9000,0.7,0.5,0.4\n")
    with open(tmp_path / "progress.csv", "w") as file:
        writer = csv.DictWriter(file, counted[0])
        writer.writeheader()
        writer.writerows(counted)
    drawn = []
    monkeypatch.setattr(recorder.plt, "close", drawn.append)
    ends = [
        SimpleNamespace(agent=name, return_per_step=0.1 * n, success_rate=0.1 * n)
        for n, name in enumerate(("ppo", "noop", "random", "classical"))
    ]
    run = SimpleNamespace(folder=tmp_path, env_id="Toy-v0", algo="ppo", seed=0)
    recorder.plot_learning_curve(run, 9000, ends)
    (figure,) = drawn
    for axes in figure.axes:
        thickest = max(axes.get_lines(), key=lambda line: line.get_linewidth())
        assert thickest.get_label() == "evaluation, without exploration"
        assert thickest.get_color() == results.COLORS["ppo"]
    lines = {line.get_label(): line for line in figure.axes[0].get_lines()}
    assert len(lines) == len(figure.axes[0].get_lines()) == len(figure.legends[0].get_texts()) == 7
    assert {lines[end.agent].get_linestyle() for end in ends[2:]} == {"-.", "--"}


def test_a_run_tells_what_its_agent_reaches_without_noise(finished):
    """At every checkpoint and at the end, on episodes that neither training nor evaluation has."""
    first, *_, last = rows(finished, "progress.csv")
    assert int(last["timesteps"]) == 12288
    assert float(last["success_rate"]) > 0.9 > float(first["success_rate"])
    again = evaluate.evaluate(str(finished), "toy_env:Toy-v0", {}, recorder.PLAYED, recorder.PROGRESS_SEED)
    assert again.return_per_step == float(last["return_per_step"])


def test_tensorboard_has_each_row_once(finished):
    log = EventAccumulator(str(finished / "tensorboard"))
    log.Reload()
    logged = [(e.step, e.value) for e in log.Scalars("rollout/reward_per_step")]
    expected = [(int(r["timesteps"]), float(r["reward_per_step"])) for r in rows(finished)]
    np.testing.assert_allclose(logged, expected, rtol=1e-6)


@pytest.mark.slow
def test_killed_and_resumed_run_equals_one_in_one_go(finished, tmp_path):
    """kill -9 in the middle of a rollout, after rows that the newest checkpoint does not know."""
    folder = tmp_path / "killed"
    process = subprocess.run(
        [sys.executable, str(AGENTS / "train.py"), *start(folder)],
        env=os.environ | {"PYTHONPATH": PYTHONPATH, "TOY_KILL_AT": "600"},
        capture_output=True, check=False,
    )  # fmt: skip
    assert process.returncode == -signal.SIGKILL, process.stderr.decode()
    assert weights(folder)[0] == 4096
    assert int(rows(folder)[-1]["timesteps"]) == 4608  # 600 steps of 8 copies are 4800
    with open(folder / "metrics.csv", "a") as file:
        file.write("4700,0.5")  # a row cut short
    assert train.main(["--resume", str(folder), "--episodes", "4"]) == 0
    assert_same_run(folder, finished)
    test_tensorboard_has_each_row_once(folder)


@pytest.mark.parametrize("algo", ["ppo", "sac"])
@pytest.mark.slow
def test_interrupted_run_with_normalisation(algo, tmp_path, monkeypatch, capsys):
    """Ctrl-C; running statistics, a learning rate that falls; of SAC a replay buffer, several optimisers."""
    options = ["--set", "normalize=true", "anneal=true", f"total_timesteps={4096 if algo == 'ppo' else 1600}",
               "--episodes", "4", "--seed", "3"]  # fmt: skip
    assert train.main(start(tmp_path / "one", *options, algo=algo)) == 0
    monkeypatch.setattr(toy_env, "interrupt_at", 300 if algo == "ppo" else 130)
    folder = tmp_path / "two"
    assert train.main(start(folder, *options, algo=algo)) == 130
    assert f"--resume {folder}" in capsys.readouterr().out
    monkeypatch.setattr(toy_env, "interrupt_at", None)
    assert weights(folder)[0] < weights(tmp_path / "one")[0]
    assert train.main(["--resume", str(folder), "--episodes", "4"]) == 0
    assert_same_run(folder, tmp_path / "one")


HER = """
SpringRopeSparse-v0:
  {total_timesteps: 200, n_envs: 4, batch_size: 16, learning_rate: 1e-3, gamma: 0.9, tau: 0.01,
  buffer_size: 400, learning_starts: 100, gradient_steps: 1, net_arch: [8], activation: relu, normalize: true,
  env_kwargs: {goals: true, max_episode_steps: 10}}
"""


def test_resumed_run_with_hindsight(tmp_path, capsys):
    """Goals as observations, a buffer that relabels them: goes on as if it had not stopped, and plays."""
    (settings := tmp_path / "her.yaml").write_text(HER)
    asked = ["SpringRopeSparse-v0", "--algo", "her", "--config", str(settings), "--episodes", "0"]
    one = tmp_path / "one"
    two = tmp_path / "two"
    assert train.main([*asked, "--out", str(one), "--timesteps", "400"]) == 0
    assert train.main([*asked, "--out", str(two)]) == 0
    halfway = dict(np.load(two / "agent.npz"))
    assert train.main(["--resume", str(two), "--timesteps", "400", "--episodes", "0"]) == 0
    agents = [dict(np.load(folder / "agent.npz")) for folder in (one, two)]
    for name, array in agents[0].items():
        np.testing.assert_array_equal(array, agents[1][name])
    assert not np.array_equal(agents[0]["actor.mu.weight"], halfway["actor.mu.weight"])
    assert len(agents[0]["observations.mean"]) == 4 + 4 + 52
    assert len((two / "progress.csv").read_text().splitlines()) == 3  # it played after each part
    assert train.main([*asked, "--out", str(tmp_path / "bad"), "--set", "env_kwargs.goals=false"]) == 2
    assert "hindsight needs observations that tell goals apart" in capsys.readouterr().err
    assert not (tmp_path / "bad").exists()


def test_stop_before_the_first_checkpoint(tmp_path, monkeypatch):
    folder = tmp_path / "run"
    monkeypatch.setattr(toy_env, "interrupt_at", 100)
    options = ["--timesteps", "1024", "--episodes", "4"]
    assert train.main(start(folder, *options)) == 130
    assert len(rows(folder)) == 1
    monkeypatch.setattr(toy_env, "interrupt_at", None)
    assert train.main(["--resume", str(folder), "--episodes", "4"]) == 0
    assert [row["timesteps"] for row in rows(folder)] == ["512", "1024"]


def test_a_learning_rate_falls_to_nothing(tmp_path):
    options = ["--set", "anneal=true", "--timesteps", "2048", "--episodes", "0"]
    assert train.main(start(tmp_path / "run", *options)) == 0
    log = EventAccumulator(str(tmp_path / "run" / "tensorboard"))
    log.Reload()
    rates = [event.value for event in log.Scalars("train/learning_rate")]
    np.testing.assert_allclose(rates, 3e-3 * (1 - np.arange(1, len(rates) + 1) / 4), rtol=1e-6)


@pytest.mark.slow
def test_environment_without_state_resumes_with_new_episodes(tmp_path, monkeypatch, capsys):
    folder = tmp_path / "run"
    options = ["--timesteps", "3072", "--episodes", "4"]
    monkeypatch.setattr(toy_env, "interrupt_at", 200)
    assert train.main(start(folder, *options, env_id="toy_env:ToyForgetful-v0")) == 130
    monkeypatch.setattr(toy_env, "interrupt_at", None)
    assert train.main(["--resume", str(folder), "--episodes", "4"]) == 0
    assert "cannot save its state: the episodes under way start anew" in capsys.readouterr().out
    assert [int(row["timesteps"]) for row in rows(folder)] == [512 * i for i in range(1, 7)]


@pytest.fixture
def copied(finished, tmp_path):
    """A run of one's own to damage."""
    return Path(shutil.copytree(finished, tmp_path / "run", ignore=shutil.ignore_patterns("tensorboard")))


def refused(folder, capsys, *options):
    """Return what is said in a line, where a run cannot go on; the folder stays as it is."""
    before = {path.name: path.read_bytes() for path in folder.iterdir() if path.is_file()}
    assert train.main(["--resume", str(folder), *options]) == 2
    assert {path.name: path.read_bytes() for path in folder.iterdir() if path.is_file()} == before
    error = capsys.readouterr().err
    assert error.startswith("train.py: error: ")
    assert error.count("\n") == 1
    return error


def test_one_process_trains_in_a_folder(copied, capsys):
    with runs.locked(copied):
        assert f"{copied}: another process is training in this folder" in refused(copied, capsys)
        assert train.main(start(copied)) == 2
        assert "another process is training in this folder" in capsys.readouterr().err
    with runs.locked(copied):
        pass


def test_a_process_that_is_killed_lets_the_folder_go(tmp_path):
    code = "import os, runs, pathlib, signal; runs.locked(pathlib.Path('.')).__enter__(); "
    code += "print('locked', flush=True); os.kill(os.getpid(), signal.SIGKILL)"
    run = subprocess.run(
        [sys.executable, "-c", code], cwd=tmp_path, env=os.environ | {"PYTHONPATH": f"{AGENTS}:{PYTHONPATH}"},
        capture_output=True, check=False, text=True,
    )  # fmt: skip
    assert (run.stdout, run.returncode) == ("locked\n", -signal.SIGKILL)
    with runs.locked(tmp_path):
        pass


def zipped(**members):
    file = io.BytesIO()
    with zipfile.ZipFile(file, "w", zipfile.ZIP_DEFLATED) as archive:
        for name, content in members.items():
            archive.writestr(name.replace("__", "."), content)
    return file.getvalue()


def flipped(content):
    """One bit in the middle, of weights or of what is pickled."""
    middle = len(content) // 2
    return bytes([*content[:middle], content[middle] ^ 1, *content[middle + 1 :]])


def without(content, *names):
    """A zip file without some of its members."""
    with zipfile.ZipFile(io.BytesIO(content)) as archive:
        return zipped(**{name: archive.read(name) for name in archive.namelist() if name not in names})


def replaced(content, **members):
    """A zip file with other members in place of some."""
    with zipfile.ZipFile(io.BytesIO(content)) as archive:
        return zipped(
            **{name: archive.read(name) for name in archive.namelist()}
            | {name.replace("__", "."): member for name, member in members.items()}
        )


CHECKPOINTS = {
    "empty": (lambda good: b"", "not a zip file"),
    "cut short": (lambda good: good[: len(good) // 2], "not a checkpoint of this run"),
    "flipped": (flipped, "damaged"),
    "foreign": (lambda good: zipped(a__txt="b"), "run.json"),
    "no training": (lambda good: without(good, "training_state.pkl"), "training_state.pkl"),
    "no model": (lambda good: without(good, "policy.pth", "data"), "not a checkpoint of this run"),
    "another run": (lambda good: zipped(run__json='{"algo": "sac"}'), "algo is 'ppo', but"),
    "another thing": (lambda good: zipped(run__json="[]"), "not a checkpoint of this run"),
    "not pickled": (lambda good: replaced(good, training_state__pkl=b"x"), "not a checkpoint of this run"),
    "nothing in it": (
        lambda good: replaced(good, training_state__pkl=pickle.dumps(None)),
        "not a checkpoint of this run",
    ),
}
"""What may stand in a checkpoint, and what is said of it."""


@pytest.mark.parametrize("what", CHECKPOINTS)
def test_a_wrong_checkpoint_is_told_in_a_line(what, copied, capsys):
    spoil, says = CHECKPOINTS[what]
    model = copied / "model.zip"
    model.write_bytes(spoil(model.read_bytes()))
    error = refused(copied, capsys)
    assert says in error
    assert ("config.yaml" if what == "another run" else str(model)) in error


def test_a_folder_in_place_of_a_checkpoint(copied, capsys):
    (copied / "model.zip").unlink()
    (copied / "model.zip").mkdir()
    assert "Is a directory" in refused(copied, capsys)


@pytest.mark.parametrize(
    ("old", "new"), [("n_envs: 8", "n_envs: 16"), ("seed: 0", "seed: 1"), ("gamma: 0.95", "gamma: 0.9")]
)
def test_a_run_keeps_its_configuration(copied, capsys, old, new):
    config = copied / "config.yaml"
    assert config.read_text().count(old) == 1
    config.write_text(config.read_text().replace(old, new))
    key, _, value = new.partition(": ")
    error = refused(copied, capsys)
    assert f"{config}: {key} is {value}, but the checkpoint was made with {old.partition(': ')[2]}" in error


def test_fewer_steps_than_there_are_cannot_be_asked_for(copied, capsys):
    assert "the run has 12288 steps already" in refused(copied, capsys, "--timesteps", "100")


def test_a_full_disk_is_told_in_a_line_and_leaves_the_old_checkpoint(tmp_path, monkeypatch, capsys):
    folder = tmp_path / "run"
    save = PPO.save
    saved = []

    def full_at_the_second(model, path):
        if saved:
            Path(path).write_bytes(b"half")
            raise OSError(errno.ENOSPC, "No space left on device")
        saved.append(model.num_timesteps)
        save(model, path)

    monkeypatch.setattr(PPO, "save", full_at_the_second)
    assert train.main(start(folder, "--timesteps", "4096")) == 2
    error = capsys.readouterr().err.splitlines()[-1]
    assert error == f"train.py: error: {folder / 'model.zip'}: No space left on device"
    assert weights(folder)[0] == saved[0] == 1024
    assert not list(folder.glob(".*"))


def test_a_log_that_cannot_be_written_is_told_in_a_line(tmp_path, monkeypatch, capsys):
    """Where PyTorch's writer has a thread that dies of it."""

    class Full(recorder.RecordWriter):
        def write(self, data):
            if b"rollout/" in data:
                raise OSError(errno.ENOSPC, "No space left on device")
            super().write(data)

    monkeypatch.setattr(recorder, "RecordWriter", Full)
    folder = tmp_path / "run"
    assert train.main(start(folder, "--timesteps", "1024")) == 2
    assert capsys.readouterr().err.splitlines()[-1] == f"train.py: error: {folder}: No space left on device"


def test_stopped_while_it_is_evaluated(copied, monkeypatch, capsys):
    def interrupted(*arguments):
        raise KeyboardInterrupt

    monkeypatch.setattr(train, "evaluate", interrupted)
    assert train.main(["--resume", str(copied)]) == 130
    told = f"stopped, with the agent trained; to see it: springgym train --resume {copied}"
    assert told in capsys.readouterr().out
    monkeypatch.setattr(recorder.Recorder, "play", interrupted)  # before the checkpoint is written
    assert train.main(start(copied.parent / "new")) == 130
    assert "continue from step 0 with: springgym train --resume" in capsys.readouterr().out


def test_learning_that_diverges_is_told_in_a_line(tmp_path, monkeypatch, capsys):
    def spoil(recorder):
        for tensor in recorder.model.policy.parameters():
            tensor.data.fill_(np.nan)

    monkeypatch.setattr(recorder.Recorder, "write_row", spoil)
    assert train.main(start(tmp_path / "run", "--timesteps", "2048")) == 2
    assert "learning diverged. Start a new run, with a smaller learning_rate" in capsys.readouterr().err


def test_a_run_without_an_agent_is_told_in_a_line(copied, capsys):
    (copied / "agent.npz").unlink()
    assert evaluate.main([str(copied), "--env", "toy_env:Toy-v0"]) == 2
    assert (
        f"has no agent.npz; if the run is your own, springgym train --resume {copied}"
        in capsys.readouterr().err
    )
    assert train.main(["--resume", str(copied), "--episodes", "4"]) == 0
    assert evaluate.main([str(copied), "--env", "toy_env:Toy-v0", "--episodes", "4"]) == 0


def test_a_run_is_not_overwritten(finished, capsys):
    before = (finished / "model.zip").read_bytes()
    assert train.main(start(finished)) == 2
    assert f"continue it with --resume {finished}" in capsys.readouterr().err
    assert (finished / "model.zip").read_bytes() == before


@pytest.mark.parametrize(
    ("old", "new", "says"),
    [
        ("algo: ppo", "algo: a2c", "algo: expected one of ppo, sac, tqc, her, linear, iql"),
        ("seed: 0", "sed: 0", "unknown key 'sed'; did you mean 'seed'"),
        ("gamma: 0.95", "gamma: 95", "gamma: must lie between"),
    ],
)
def test_damaged_run_configuration(finished, tmp_path, old, new, says):
    text = (finished / "config.yaml").read_text()
    assert text.count(old) == 1
    (tmp_path / "config.yaml").write_text(text.replace(old, new))
    line = 1 + text[: text.index(old)].count("\n")
    with pytest.raises(config.ConfigError, match=f"config.yaml:{line}: {says}"):
        runs.open_run(tmp_path)
