"""What commands share: errors in a line, and files that are whole or not there."""

import os
import stat
import subprocess
import sys

import pytest

import springgym
from springgym import extras
from springgym.cli import guarded, main, whole_file
from springgym.extras import install


def write_half(path, error):
    with whole_file(path) as other:
        other.write_text("half")
        raise error


def test_a_file_is_whole_or_stays_as_it_was(tmp_path):
    path = tmp_path / "a.txt"
    with whole_file(path) as other:
        other.write_text("one")
        assert not path.exists()
    assert path.read_text() == "one"
    for error in (KeyboardInterrupt, ValueError, OSError):
        with pytest.raises(error):
            write_half(path, error)
    assert path.read_text() == "one"
    assert list(tmp_path.iterdir()) == [path]


def test_a_file_that_nobody_wrote_is_named(tmp_path):
    path = tmp_path / "a.txt"
    with pytest.raises(OSError, match=rf"{path}: No such file"), whole_file(path):
        pass


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="there are no pipes with names")
def test_what_is_no_file_is_written_to_and_not_replaced(tmp_path):
    """As /dev/stdout."""
    pipe = tmp_path / "pipe"
    os.mkfifo(pipe)
    reader = os.open(pipe, os.O_RDWR)
    with whole_file(pipe) as other:
        other.write_text("one")
    assert os.read(reader, 10) == b"one"
    os.close(reader)
    assert stat.S_ISFIFO(pipe.stat().st_mode)


def test_a_link_stays_one(tmp_path):
    (tmp_path / "folder").mkdir()
    (tmp_path / "link.txt").symlink_to(tmp_path / "folder" / "a.txt")
    with whole_file(tmp_path / "link.txt") as other:
        other.write_text("one")
    assert (tmp_path / "link.txt").is_symlink()
    assert [path.read_text() for path in (tmp_path / "folder").iterdir()] == ["one"]


def raising(error):
    def action():
        raise error

    return action


@pytest.mark.parametrize(
    ("error", "says"),
    [
        (ValueError("a\n  b"), "a b"),
        (KeyError("a"), "a"),
        (KeyError(), "KeyError"),
        (OSError(), "OSError"),
        (MemoryError(), "not enough memory"),
        (ModuleNotFoundError("No module named 'a'"), f"No module named 'a': {install('plot')}"),
    ],
)
def test_what_can_be_mended_is_a_line(capsys, error, says):
    assert guarded("name", raising(error), extra="plot") == 2
    assert capsys.readouterr().err == f"name: error: {says}\n"


def test_what_cannot_be_mended_is_raised():
    with pytest.raises(AssertionError):
        guarded("name", raising(AssertionError()))
    with pytest.raises(ValueError, match="a"):
        guarded("name", raising(ValueError("a")), mendable=(OSError,))


def test_interrupts_and_closed_pipes_have_their_status(capsys):
    assert guarded("name", raising(KeyboardInterrupt())) == 130
    assert capsys.readouterr().err == "name: interrupted\n"
    assert guarded("name", raising(BrokenPipeError())) == 141
    assert capsys.readouterr().err == ""


def test_how_to_install_is_of_the_package_or_of_the_clone(monkeypatch, tmp_path):
    monkeypatch.setattr(extras, "SOURCE", tmp_path)
    assert install("view") == 'pip install "springgym[view]"'
    (tmp_path / "pyproject.toml").touch()
    assert install("view") == f'pip install -e "{tmp_path}[view]"'


def test_the_module_is_the_command():
    asked = [sys.executable, "-m", "springgym", "simulate", "--list"]
    told = subprocess.run(asked, capture_output=True, text=True, check=True).stdout
    assert "newtons-cradle" in told


@pytest.mark.slow
def test_scripts_are_commands(tmp_path):
    """`springgym evaluate` runs the script, which also finds environments in the current folder."""
    (tmp_path / "own.py").write_text(
        "import gymnasium as gym\n"
        "from gymnasium.envs.classic_control import PendulumEnv\n"
        "gym.register('Own-v0', entry_point=PendulumEnv, max_episode_steps=3)\n"
    )
    words = ["evaluate", "noop", "--env", "own:Own-v0", "--episodes", "2"]
    code = f"import sys; from springgym.cli import main; sys.exit(main({words!r}))"
    command = [sys.executable, "-P", "-W", "ignore", "-c", code]  # -P: the current folder is not searched yet
    done = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, check=False)
    assert (done.returncode, done.stderr) == (0, "")
    assert done.stdout.startswith("own:Own-v0: 2 episodes")


def test_without_a_command_it_shows_the_help(capsys):
    assert main([]) == 2
    assert "evaluate  evaluate ag" in capsys.readouterr().err


def test_version(capsys):
    with pytest.raises(SystemExit):
        main(["--version"])
    assert capsys.readouterr().out == f"springgym {springgym.__version__}\n"


@pytest.mark.parametrize("command", ["simulate", "compile"])
def test_an_unknown_option_is_answered_by_its_command(command, capsys):
    with pytest.raises(SystemExit) as ended:
        main([command, "--absent"])
    assert ended.value.code == 2
    said = capsys.readouterr().err
    assert said.startswith(f"usage: springgym {command} ")
    assert said.endswith(f"springgym {command}: error: unrecognized arguments: --absent\n")


def test_the_words_of_a_script_are_its_own(capsys):
    for words, says in (
        (["train", "--help"], "usage: springgym train "),
        (["--help"], "evaluate  evaluate ag"),
    ):
        with pytest.raises(SystemExit) as ended:
            main(words)
        assert ended.value.code == 0
        assert says in capsys.readouterr().out
    with pytest.raises(SystemExit):
        main(["evaluate", "noop", "--episods", "3"])
    assert "springgym evaluate: error: unrecognized arguments: --episods 3" in capsys.readouterr().err
    assert main(["evaluate", "noop", "--env", "Absent-v0"]) == 2
    assert capsys.readouterr().err.startswith("springgym evaluate: error: ")


@pytest.mark.parametrize("name", ["train", "evaluate"])
def test_a_script_says_which_extra_it_needs(name, monkeypatch, capsys):
    monkeypatch.setitem(sys.modules, "stable_baselines3", None)
    assert main([name, "SpringTop-v0"]) == 2
    told = f"springgym: error: springgym {name} needs Stable-Baselines3: {install('agents')}\n"
    assert capsys.readouterr().err == told
