"""What commands share: errors in a line, and files that are whole or not there."""

import os
import re
import stat
import subprocess
import sys

import pytest

import springgym
from springgym.cli import check_new, guarded, main, whole_file
from springgym.core import extras
from springgym.core.extras import install


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
    with pytest.raises(OSError, match=rf"{path}: nothing was written"), whole_file(path):
        pass
    assert list(tmp_path.iterdir()) == []


def test_files_of_others_beside_it_stay(tmp_path):
    """Whatever they are called; also if writing fails, or another one writes the file at the time."""
    path = tmp_path / "fall.csv"
    others = {tmp_path / name: name for name in ("fall.tmp.csv", ".fall.csv", "fall.csv.tmp", "fall.tmp")}
    for other, text in others.items():
        other.write_text(text)
    with whole_file(path) as first:
        first.write_text("AAAAA")
        with whole_file(path) as second:
            second.write_text("BBBBB")
            first.write_text("AAAAAAAA")
        assert path.read_text() == "BBBBB"
    with pytest.raises(ValueError, match="half"):
        write_half(path, ValueError("half"))
    assert path.read_text() == "AAAAAAAA"
    assert {other: other.read_text() for other in tmp_path.iterdir() if other != path} == others


WRITER = """
import sys
from pathlib import Path
from springgym.cli import whole_file

letter, path = sys.argv[1], Path(sys.argv[2])
for _ in range(200):
    with whole_file(path) as temporary, temporary.open("w") as file:
        for _ in range(50):
            file.write(letter * 1000)
            file.flush()
"""


def test_two_writers_of_a_file_never_mix_in_it(tmp_path):
    path = tmp_path / "a.txt"
    writers = [subprocess.Popen([sys.executable, "-c", WRITER, letter, str(path)]) for letter in "AB"]
    seen = set()
    while any(writer.poll() is None for writer in writers):
        if path.exists():
            seen.add(path.read_text())
    assert [writer.returncode for writer in writers] == [0, 0]
    assert seen <= {"A" * 50_000, "B" * 50_000}
    assert seen
    assert list(tmp_path.iterdir()) == [path]


@pytest.mark.skipif(sys.platform == "win32", reason="Windows has other modes")
@pytest.mark.parametrize("mode", [0o600, 0o640, 0o444])
def test_a_file_keeps_its_mode(tmp_path, mode):
    path = tmp_path / "a.txt"
    path.write_text("one")
    path.chmod(mode)
    with whole_file(path) as other:
        other.write_text("two")
        assert stat.S_IMODE(other.stat().st_mode) & 0o077 == 0  # nobody else reads it meanwhile
    assert stat.S_IMODE(path.stat().st_mode) == mode
    with whole_file(tmp_path / "new.txt") as other:
        other.write_text("one")
    (tmp_path / "usual.txt").touch()
    new, usual = ((tmp_path / name).stat().st_mode for name in ("new.txt", "usual.txt"))
    assert new == usual


@pytest.mark.parametrize("name", ["a" * 251 + ".txt", "a" * 255, "a." + "b" * 253])
def test_a_name_may_be_as_long_as_the_system_takes(tmp_path, name):
    path = tmp_path / name
    check_new(path)
    with whole_file(path) as other:
        other.write_text("one")
    assert [one.name for one in tmp_path.iterdir()] == [name]


@pytest.mark.skipif(not os.path.isdir("/proc"), reason="there is no such folder")
@pytest.mark.parametrize(
    ("name", "says"),
    [
        ("a.csv", "a.csv: the name must end in .txt"),
        ("folder.txt", "folder.txt: it is a folder"),
        ("absent/a.txt", "absent/a.txt: there is no folder "),
        ("a" * 300 + ".txt", ".txt: it cannot be written: File name too long"),
        ("/proc/a.txt", "/proc/a.txt: it cannot be written: "),
    ],
)
def test_a_place_that_takes_no_file_is_told_before_any_work(tmp_path, name, says):
    (tmp_path / "folder.txt").mkdir()
    with pytest.raises(ValueError, match=re.escape(says)):
        check_new(tmp_path / name, (".txt",))
    assert [path.name for path in tmp_path.iterdir()] == ["folder.txt"]


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


def test_a_link_that_leads_nowhere_comes_to_lead_to_the_file(tmp_path):
    """One that leads to itself cannot, and is refused."""
    link = tmp_path / "link.txt"
    circle = tmp_path / "circle.txt"
    link.symlink_to(tmp_path / "target.txt")
    circle.symlink_to(circle)
    check_new(link)
    with whole_file(link) as other:
        other.write_text("one")
    assert link.is_symlink()
    assert (tmp_path / "target.txt").read_text() == "one"
    with pytest.raises(ValueError, match="it cannot be written"):
        check_new(circle)
    with pytest.raises(OSError, match=f"{circle}: "), whole_file(circle) as other:
        other.write_text("one")
    assert circle.is_symlink()


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
        main([command, "--xyz"])
    assert ended.value.code == 2
    expected = f"springgym: error: unrecognized arguments: --xyz; see springgym {command} --help\n"
    assert capsys.readouterr().err == expected


def test_the_words_of_a_script_are_its_own(capsys):
    for words, says in (
        (["train", "--help"], "usage: springgym train "),
        (["--help"], "evaluate  evaluate ag"),
    ):
        with pytest.raises(SystemExit) as ended:
            main(words)
        assert ended.value.code == 0
        assert says in capsys.readouterr().out


@pytest.mark.parametrize(
    ("words", "says"),
    [
        (["simulat"], "argument command: invalid choice: 'simulat'; did you mean 'simulate'?"),
        (["nonsense"], "choose from: train, evaluate, watch, simulate, view, compile; see springgym --help"),
        (["simulate", "nosuch"], "there is no scene 'nosuch'; springgym simulate --list shows all"),
        (["simulate", "tpo"], "there is no scene 'tpo'; did you mean 'top'?"),
        (["simulate", "top", "--integratr", "rk4"], "--integratr rk4; did you mean '--integrator'?"),
        (["simulate", "top", "--preset", "papr"], "invalid choice: 'papr'; did you mean 'paper'?"),
        (["simulate", "."], "'.' is a folder; give the name of a scene, or of a YAML file"),
        (["view", "tpo"], "there is no scene 'tpo'; did you mean 'top'?"),
        (["compile", "--cpu", "hst"], "invalid choice: 'hst'; did you mean 'host'?"),
        (["train"], "missing environment id (or --resume RUN); see springgym train --help"),
        (["train", "A-v0", "--algo", "ppoo"], "invalid choice: 'ppoo'; did you mean 'ppo'?"),
        (["evaluate", "noop", "--episods", "3"], "--episods 3; did you mean '--episodes'?"),
        (["evaluate", "noop", "--env", "Absent-v0"], "Absent-v0"),
        (["evaluate"], "the following arguments are required: agents; see springgym evaluate --help"),
        (
            ["watch", "noop", "--out", "a.txt"],
            "must end in .gif or .mp4 or .html; see springgym watch --help",
        ),
    ],
)
def test_every_error_of_every_command_is_a_short_line_of_one_form(words, says, capsys):
    """The usage is no part of it; a similar word is suggested where there is one."""
    try:
        status = main(words)
    except SystemExit as ended:
        status = ended.code
    printed, said = capsys.readouterr()
    assert (status, printed) == (2, "")
    assert said.startswith("springgym: error: ")
    assert says in said
    assert said.count("\n") == 1
    assert len(said) < 250


ESCAPES = "\x1b]0;owned\x07\x1b[31m\x9b31m\u202e\r\b"
"""What sets the title of a terminal, its colour and its direction of writing, and moves back in its line."""


def is_text(said):
    """Whether a terminal would only show it."""
    return all(char.isprintable() or char == "\n" for char in said) and r"\x1b]0;owned\x07" in said


def test_a_terminal_obeys_no_error(capsys):
    assert guarded("name", raising(ValueError(ESCAPES))) == 2
    assert is_text(capsys.readouterr().err)
    with pytest.raises(SystemExit):
        main(["compile", f"--{ESCAPES}"])
    assert is_text(capsys.readouterr().err)


@pytest.mark.parametrize("closed", ["stdout", "stderr"])
def test_who_has_no_output_is_served_all_the_same(closed, monkeypatch):
    """As a daemon, or Python without a console on Windows."""
    monkeypatch.setattr(sys, closed, None)

    def action():
        print("a")
        print("b", file=sys.stderr)
        return 7 + sys.stdout.isatty() + sys.stderr.isatty()

    assert guarded("name", action) == 7
    assert guarded("name", raising(ValueError("a"))) == 2
    assert guarded("name", raising(BrokenPipeError())) == 141
    getattr(sys, closed).close()


@pytest.mark.skipif(os.name != "posix", reason="the shell is POSIX's")
@pytest.mark.parametrize("closed", [">&-", "2>&-", "<&- >&- 2>&-"])
def test_a_simulation_needs_no_output(closed, tmp_path):
    words = ["simulate", "cube-pendulum", "--duration", "0.02", "--trace", "a.csv"]
    shell = ["sh", "-c", f'exec "$@" {closed}', "sh", sys.executable, "-m", "springgym", *words]
    done = subprocess.run(shell, cwd=tmp_path, capture_output=True, text=True, check=False)
    assert (done.returncode, "rror" in done.stderr) == (0, False)
    assert (tmp_path / "a.csv").read_text().startswith("time,x0,")


@pytest.mark.parametrize("name", ["train", "evaluate"])
def test_a_script_says_which_extra_it_needs(name, monkeypatch, capsys):
    monkeypatch.setitem(sys.modules, "stable_baselines3", None)
    assert main([name, "SpringTop-v0"]) == 2
    told = f"springgym: error: springgym {name} needs Stable-Baselines3: {install('agents')}\n"
    assert capsys.readouterr().err == told
