"""Environments of one's own, registered outside of the package, train by the scripts."""

import json
import re
import shlex
import sys
from pathlib import Path

import config
import controllers
import gymnasium as gym
import numpy as np
import pytest
import train
from toy_env import LIMIT, ToyEnv

from springgym import cli
from tests.params import slow_but

TUTORIAL = Path(__file__).parents[2] / "docs" / "tutorials" / "environment.md"
BRIEF = ["n_envs=4", "n_steps=64", "batch_size=64", "checkpoint_every=256", "total_timesteps=512"]

gym.register("ToyAlone-v0", entry_point=ToyEnv, max_episode_steps=LIMIT)


def blocks(page):
    """The blocks of a page that are Python or commands, and none of any other kind that is run."""
    found = re.findall(r"^```(\S*)\n(.*?)^```", page, re.M | re.S)
    assert {language for language, _ in found} <= {"python", "sh", "text"}
    return [block for block in found if block[0] != "text"]


def saved(name, code, tmp_path, monkeypatch):
    """Save a module of one's own in the current folder."""
    (tmp_path / name).write_text(code, encoding="utf-8")
    monkeypatch.chdir(tmp_path)
    monkeypatch.syspath_prepend(tmp_path)
    monkeypatch.delitem(sys.modules, name.removesuffix(".py"), raising=False)


@pytest.fixture
def hover(tmp_path, monkeypatch, own_ids):
    """The file that the tutorial tells to save, and the commands that it gives."""
    found = blocks(TUTORIAL.read_text(encoding="utf-8"))
    code = [text for language, text in found if language == "python"]
    (named,) = (text for text in code if "gym.register(" in text)
    saved("hover.py", code[0] + named, tmp_path, monkeypatch)
    return [text for language, text in found if language == "sh"]


@pytest.fixture
def escort(tmp_path, monkeypatch, own_ids):
    """The rest of the page on a task from beginning to end, its file in the current folder."""
    head, rest = (TUTORIAL.parent / "task.md").read_text(encoding="utf-8").split("## Try it\n")
    assert {language for language, _ in blocks(head)} == {"python"}
    saved("escort.py", "".join(text for _, text in blocks(head)), tmp_path, monkeypatch)
    return blocks(rest)


def run(commands):
    """Run commands of a page and return their names."""
    done = []
    for line in commands.splitlines():
        program, command, *words = shlex.split(line)
        assert program == "springgym"
        if command == "evaluate":
            words += ["--json", "compared.json"]
        assert cli.main([command, *words]) == 0
        done.append(command)
    return done


@pytest.mark.usefixtures("small_pictures")
@pytest.mark.slow
def test_the_environment_of_the_tutorial_trains_by_its_commands(hover, tmp_path, capsys):
    (commands,) = hover
    assert run(commands) == ["train", "train", "evaluate", "watch"]
    assert "hover:HoverCube-v0 trains with the default hyperparameters of ppo" in capsys.readouterr().out
    at = tmp_path / "runs" / "HoverCube-v0-ppo-0"
    assert len(json.loads((at / "evaluation.json").read_text())) == 3
    assert (at / "episode.gif").read_bytes().startswith(b"GIF8")
    assert (tmp_path / "runs" / "HoverCube-v0-linear-0" / "agent.npz").exists()
    assert (tmp_path / "hover.gif").read_bytes().startswith(b"GIF8")
    trained, *others = json.loads((tmp_path / "compared.json").read_text())
    assert all(trained["return_per_step"] > other["return_per_step"] for other in others)


@pytest.mark.usefixtures("small_pictures")
@pytest.mark.slow
def test_a_task_from_beginning_to_end_is_followed_word_for_word(escort, tmp_path):
    """Commands and code in their order."""
    namespace = {}
    done = []
    for language, text in escort:
        if language == "python":
            exec("from escort import *\n" + text, namespace)
        else:
            done += run(text)
    assert done == ["train", "evaluate", "watch"]
    assert (tmp_path / "escort.gif").read_bytes().startswith(b"GIF8")
    trained, controller, *others = json.loads((tmp_path / "compared.json").read_text())
    assert controller["agent"] == "escort:controller"
    assert controller["success_rate"] == 1.0
    assert [other["success_rate"] for other in others] == [0.0, 0.0]
    assert trained["success_rate"] > 0.9


@pytest.mark.parametrize(
    ("name", "says"),
    [
        ("absent:act", "no controller 'absent:act': No module named 'absent'"),
        (":act", "no controller ':act': Empty module name"),
        ("math:act", "no controller 'math:act': module 'math' has no attribute 'act'"),
        ("math:pi", "math:pi is 3.14"),
        (
            "builtins:len",
            r"builtins:len gave int64 of shape \(\); it must give finite actions of shape \(2, 3\)",
        ),
        ("numpy:log", r"numpy:log gave float64 of shape \(2, 9\); it must give"),
    ],
)
@pytest.mark.filterwarnings("ignore:divide by zero")
def test_a_controller_of_one_s_own_is_checked(name, says):
    space = gym.spaces.Box(-1, 1, (3,))
    with pytest.raises(config.ConfigError, match=says):
        controllers.make_controller(name, "ToyAlone-v0", {}, space)(np.zeros((2, 9)))


@pytest.mark.parametrize("algo", slow_but(["ppo", "linear"], "linear"))
def test_one_without_a_batch_trains_one_after_the_other(algo, tmp_path):
    """It reports no success either."""
    settings = BRIEF if algo == "ppo" else ["population=4", "elites=2", "total_timesteps=512"]
    with pytest.warns(UserWarning, match="ToyAlone-v0 was registered without a vector_entry_point"):
        assert train.main(["ToyAlone-v0", "--algo", algo, "--out", str(tmp_path), "--set", *settings]) == 0
    trained, *_ = json.loads((tmp_path / "evaluation.json").read_text())
    assert trained["successes"] is None
    assert 0 < trained["return_per_step"] <= 1


@pytest.mark.parametrize(
    ("env_id", "says"),
    [
        ("SpringTpo-v0", r"Unknown environment 'SpringTpo-v0'\. Did you mean 'SpringTop-v0'\?$"),
        (
            "Absent-v0",
            r"Unknown environment 'Absent-v0'\. If a module of yours registers it, write MODULE:Absent-v0$",
        ),
        ("absent:Own-v0", r"Unknown environment 'absent:Own-v0'\. No module named 'absent'$"),
        ("toy_env:Toyy-v0", r"Unknown environment 'toy_env:Toyy-v0'\. Did you mean 'toy_env:Toy-v0'\?$"),
        ("math:Own-v0", r"Unknown environment 'math:Own-v0'\. The module math does not register it$"),
    ],
)
def test_an_id_that_is_mistyped_is_named(env_id, says):
    with pytest.raises(config.UnknownEnvironment, match=says):
        config.load_config("ppo", env_id)


def test_a_file_without_defaults_refuses_other_ids(tmp_path):
    (tmp_path / "own.yaml").write_text("{}")
    with pytest.raises(config.ConfigError, match=r"own.yaml: no entry for 'ToyAlone-v0'"):
        config.load_config("ppo", "ToyAlone-v0", path=tmp_path / "own.yaml")
