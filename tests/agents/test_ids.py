"""Commands and functions that take an environment id suggest an id for one that is mistyped."""

import importlib
import re
from importlib.util import find_spec

import pytest
from conftest import AGENTS

import springgym
from springgym import cli

SAYS = "Unknown environment 'SpringTop'. Did you mean 'SpringTop-v0'?"

SCRIPTS = {
    "audit": (["SpringTop"], ["noop", "--env", "SpringTop"]),
    "benchmark": (["--tasks", "SpringTop", "--algorithms", "noop", "--local"],),
    "dataset": (["SpringTop", "noop"],),
    "evaluate": (
        ["SpringTop"],
        ["noop", "SpringTop", "--env", "SpringTop-v0"],
        ["noop", "--env", "SpringTop"],
    ),
    "generalize": (["SpringTop"],),
    "learning_time": (["SpringTop"],),
    "offline": (["SpringTop", "--data", "a"],),
    "plan": (["--tasks", "SpringTop"],),
    "rllib_ppo": (["SpringTop"],),
    "train": (["SpringTop"], ["SpringTop", "--algo", "linear"]),
    "transfer": (["SpringTop", "--local"],),
    "tune": (["SpringTop"],),
    "watch": (["SpringTop", "--out", "top.gif"], ["noop", "--env", "SpringTop"]),
}
"""Arguments of each script with a mistyped id."""
COMMANDS = [
    ["view", "SpringTop"],
    ["view", "SpringTop", "--agent", "noop"],
    ["view", "SpringTop-v0", "--agent", "SpringTop"],
    ["compile", "SpringTop"],
]


def test_no_script_that_takes_an_id_is_left_out():
    texts = {path.stem: path.read_text(encoding="utf-8") for path in AGENTS.rglob("*.py")}
    taking = {name for name, text in texts.items() if "def main(" in text and "environment id" in text}
    assert taking == SCRIPTS.keys()


@pytest.mark.parametrize(
    ("name", "arguments"), [(name, words) for name, several in SCRIPTS.items() for words in several]
)
def test_scripts(name, arguments, tmp_path, monkeypatch, capsys):
    if name == "tune" and find_spec("optuna") is None:
        pytest.skip("Optuna is not installed")
    monkeypatch.chdir(tmp_path)
    assert importlib.import_module(name).main(arguments) == 2
    assert capsys.readouterr().err.endswith(f": error: {SAYS}\n")
    assert not [path for path in tmp_path.rglob("*") if path.is_file()]


@pytest.mark.parametrize("arguments", COMMANDS)
def test_commands(arguments, capsys):
    if arguments[0] == "view":
        pytest.importorskip("viser")
    assert cli.main(arguments) == 2
    assert capsys.readouterr().err == f"springgym: error: {SAYS}\n"


def test_functions():
    with pytest.raises(ValueError, match=re.escape(SAYS)):
        springgym.load_agent("SpringTop")
