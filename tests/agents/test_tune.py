"""The search of hyperparameters: what it tries, that it goes on, and what it leaves."""

import json
import shutil

import pytest
import toy_env
from conftest import HERE

pytest.importorskip("optuna")
import tune
from config import CONFIG_OF, ONLINE, load_config

TOY = "toy_env:Toy-v0"
NETS = ["[16]", "[128, 128]"]


@pytest.fixture
def command(tmp_path):
    configs = tmp_path / "configs"
    configs.mkdir()
    shutil.copy(HERE / "toy_ppo.yaml", configs / "ppo.yaml")

    def command(*options):
        asked = ["--runs", str(tmp_path / "tune"), "--configs", str(configs), "--seeds", "1"]
        asked += ["--out", str(tmp_path / "trials"), "--seconds", "0"]
        return [TOY, *asked, *options, "--set", "total_timesteps=2048", "n_envs=64"]

    return command


def study(tmp_path):
    return json.loads((tmp_path / "trials" / "Toy-v0-ppo.json").read_text())


@pytest.fixture
def narrow(monkeypatch):
    monkeypatch.setitem(tune.SPACES, "ppo", {"learning_rate": (1e-3, 1e-2), "net_arch": NETS})


def test_a_search_and_its_continuation(command, narrow, tmp_path, capsys):
    assert [tune.main(command("--trials", trials)) for trials in "23"] == [0, 0]
    found = study(tmp_path)
    assert found["searched"] == {"learning_rate": [1e-3, 1e-2], "net_arch": NETS}
    assert (found["seeds"], found["set"]) == (1, ["total_timesteps=2048", "n_envs=64"])
    tried = [(trial["state"], trial["learning_rate"], trial["net_arch"]) for trial in found["trials"]]
    assert [*tried[:2], tried[2][0]] == [*(("COMPLETE", 3e-3, net) for net in NETS), "COMPLETE"]
    best = max(found["trials"], key=lambda trial: trial["value"])
    config = load_config("ppo", TOY, path=tmp_path / "tune" / "Toy-v0-ppo" / "best.yaml")
    assert (str(config.net_arch), config.total_timesteps) == (best["net_arch"], 2048)
    assert tune.main(command("--trials", "3", "--seeds", "2")) == 2
    told = capsys.readouterr()
    assert f"best: trial {best['number']}" in told.out
    assert "has trials of {'task': 'toy_env:Toy-v0', 'algo': 'ppo', 'seeds': 1, " in told.err


def test_an_interrupted_trial_goes_on(command, narrow, tmp_path, monkeypatch, capsys):
    """The search tries its parameters again, after those that wait, and continues its run."""
    monkeypatch.setattr(toy_env, "interrupt_at", 20)
    assert tune.main(command("--trials", "2")) == 130
    monkeypatch.setattr(toy_env, "interrupt_at", None)
    assert tune.main(command("--trials", "2")) == 0
    tried = [(trial["state"], trial["net_arch"]) for trial in study(tmp_path)["trials"]]
    assert tried == [("FAIL", NETS[0]), ("COMPLETE", NETS[1]), ("COMPLETE", NETS[0])]
    assert len(list((tmp_path / "tune" / "Toy-v0-ppo").glob("*/Toy-v0-ppo-0"))) == 2


def test_what_cannot_be_trained_is_given_up(command, monkeypatch, tmp_path):
    monkeypatch.setitem(tune.SPACES, "ppo", {"batch_size": [7]})
    assert tune.main(command("--trials", "1")) == 0
    assert [trial["state"] for trial in study(tmp_path)["trials"]] == ["PRUNED"]


@pytest.mark.parametrize("algo", ONLINE)
def test_what_is_searched_is_there(algo):
    assert set(tune.SPACES[algo]) <= set(CONFIG_OF[algo].__dataclass_fields__)
