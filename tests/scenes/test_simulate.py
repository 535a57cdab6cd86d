"""The command line, plots and films."""

import csv
import errno
import io
import itertools
import math
import os
import re
import subprocess
import sys
from dataclasses import replace
from functools import cache
from importlib import resources
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from matplotlib.colors import to_hex

from springgym import cli
from springgym.cli import main, simulate
from springgym.core.extras import install, missing
from springgym.dynamics.contact.totals import PairReadings
from springgym.model.bodies import Body, cube
from springgym.model.scene import MOST_LISTED, Placed, Scene
from springgym.rendering.look import INK
from springgym.scenes import load, names, plots
from springgym.scenes.checks import Check
from springgym.scenes.checks.basis import CHECKS, within
from springgym.scenes.film import (
    camera,
    frames,
    look,
    poses,
    round_up,
    scenery,
    strain_scale,
    turning,
    visible_speed,
    way,
)
from springgym.scenes.plan import LEAST
from springgym.scenes.plots import PLOTS, draw
from springgym.scenes.reading import document
from springgym.scenes.recording import record
from tests.params import slow_but
from tests.scenes.conftest import marked, recorded
from tests.test_docs import page_writer

SHORT = ["simulate", "cube-pendulum", "--duration", "0.1"]


# --- The command line -------------------------------------------------------------------------------


def test_list_shows_every_scene(capsys, monkeypatch):
    """It builds none: some need packages that may be missing."""
    monkeypatch.setattr("springgym.cli.simulate.load", None)
    assert main(["simulate", "--list"]) == 0
    printed = capsys.readouterr().out
    assert max(map(len, printed.splitlines())) <= 80
    entries = [" ".join(entry.split()) for entry in re.split(r"\n(?! )", printed.strip())]
    assert entries == [f"{name} {document(name).value['title']}" for name in names()]


def test_summary(capsys):
    assert main(SHORT) == 0
    out = capsys.readouterr().out
    for word in (
        "cube-pendulum: the paper's cube",
        "\n8 particles, 28 springs, verlet, step 0.556 ms\n",
        "\n0.1 s simulated, largest strain ",
        "energy error ",
        " J (shadow energy drift ",
    ):
        assert word in out
    assert "Simulator(" not in out
    assert max(map(len, out.splitlines())) < 110


def test_settings_of_the_simulator_are_shown_if_asked_for(capsys):
    assert main([*SHORT, "-v"]) == 0
    assert "\nSimulator(1 × Scene(" in capsys.readouterr().out


def test_the_tutorial_shows_the_first_lines_of_the_output(capsys, monkeypatch, tmp_path):
    """In its words; the last digits of the energies may differ from machine to machine."""
    page = (Path(__file__).parents[2] / "docs" / "tutorials" / "scene.md").read_text(encoding="utf-8")
    file, shown = (
        re.search(f"^```{begin}.*?)```$", page, re.M | re.S)[1] for begin in ("yaml\n(", "\n(mine: ")
    )
    (tmp_path / "mine.yaml").write_text(file)
    monkeypatch.chdir(tmp_path)
    assert main(["simulate", "mine.yaml", "--check"]) == 0
    first = capsys.readouterr().out.splitlines(keepends=True)[:4]
    assert "".join(first[:3]) == "".join(shown.splitlines(keepends=True)[:3])
    number = r"-?[\d.]+(e-\d+)?"
    assert re.sub(number, "0", "".join(first)) == re.sub(number, "0", shown)


def test_pairs_of_bodies_are_told_one_by_one_or_together():
    body = cube()
    apart = np.array([2.0, 0.0, 0.0])
    bodies = [Placed(body, body.positions + n * apart, name=f"c{n}") for n in range(8)]
    made = Scene(bodies=bodies)
    values = np.ones((2, len(made.meetings)))
    values[:, MOST_LISTED:] = 0.0
    of = PairReadings(*(values.copy() for _ in PairReadings._fields))
    recording = SimpleNamespace(plan=SimpleNamespace(scene=made), pairs=of)
    lines = list(simulate._between(recording))
    assert len(lines) == MOST_LISTED
    assert lines[0] == "c0 and c1: impulse 1 N·s, lost 2 J, 1 found too late, 1 coarse, 1 left out"
    of.impulse[-1] = 1.0
    assert list(simulate._between(recording)) == [
        f"28 pairs of bodies: impulse 28 N·s, lost {2 * MOST_LISTED} J, {MOST_LISTED} found too late, "
        f"{MOST_LISTED} coarse, {MOST_LISTED} left out"
    ]


def test_summary_where_there_are_no_greek_letters(monkeypatch):
    """As when the output goes to a file on Windows."""
    written = io.BytesIO()
    monkeypatch.setattr(sys, "stdout", io.TextIOWrapper(written, encoding="cp1252"))
    assert main(SHORT) == 0
    sys.stdout.flush()
    assert "-8.46345 ? -8.46345 J" in written.getvalue().decode("cp1252")


def test_check_prints_theory_beside_measurement(capsys):
    assert main(["simulate", "cube-pendulum", "--check"]) == 0
    out = capsys.readouterr().out
    row = next(line for line in out.splitlines() if line.startswith("period at 5°"))
    theory, measured = map(float, row.split()[3:5])
    assert theory == 2.41126
    assert measured == pytest.approx(theory, rel=1e-4)
    assert row.endswith("ok")


def test_check_that_fails_is_told_by_the_status(capsys, monkeypatch):
    false = Check("a length", 1.0, 2.0, 0.1, "m")
    monkeypatch.setattr(simulate, "check", lambda recording: [false, replace(false, measured=math.nan)])
    monkeypatch.setattr(simulate, "load", lambda name: replace(load(name), duration=0.1))
    assert main(["simulate", "cube-pendulum", "--check"]) == 1
    *_, seen, unseen, told, hint = capsys.readouterr().out.splitlines()
    assert seen.split()[2:4] == ["1", "2"]
    assert "not seen" in unseen
    assert seen.endswith("FAILED")
    assert unseen.endswith("FAILED")
    assert told == "2 of 2 checks failed"
    assert hint.startswith("1 of them: nothing to measure in 0.1 s; a longer run may show it")


def test_check_that_is_not_covered_is_no_pass(capsys, monkeypatch):
    """A status of its own, unless another check fails; and the row says by how much theory may be off."""
    doubtful = Check("a length", 1.0, 1.0, 0.1, "m", 0.25)
    fine = replace(doubtful, doubt=0.0)
    monkeypatch.setattr(simulate, "load", lambda name: replace(load(name), duration=0.1))
    for checks, status in (
        ([fine], 0),
        ([fine, doubtful], 3),
        ([fine, doubtful, replace(fine, measured=2.0)], 1),
        ([fine, replace(doubtful, measured=math.nan)], 1),
    ):
        monkeypatch.setattr(simulate, "check", lambda recording, checks=checks: checks)
        assert main(["simulate", "cube-pendulum", "--check"]) == status
        out = capsys.readouterr().out
        assert ("no theory applies to 1 of 2 checks" in out) == (status == 3)
        assert ("not covered, theory leaves out 25 %" in out) == (doubtful in checks)


@pytest.mark.parametrize("name", marked(["cube-pendulum", "top", "steady-top", "cube-drop", "rope-hanging"]))
def test_a_run_too_short_for_its_checks_is_called_so(capsys, name):
    """Not failed: nothing that the scene says of its whole duration is contradicted."""
    assert main(["simulate", name, "--check", "--duration", "0.02"]) == 1
    out = capsys.readouterr().out
    assert "nan" not in out
    assert "FAILED" not in out
    whole = f"{load(name).duration:g}"
    assert re.search(rf"the run is too short for \d of \d checks: 0.02 s of {whole} s\n$", out)


def test_checks_that_do_not_fit_are_told_before_the_run(capsys, tmp_path, monkeypatch):
    """A copy of the top, unbalanced, is neither simulated nor drawn."""
    monkeypatch.setattr(simulate, "record", None)
    text = (resources.files("springgym.scenes") / "top.yaml").read_text(encoding="utf-8")
    path = tmp_path / "mine.yaml"
    path.write_text(text.replace("{kind: top}", "{kind: top, scaled: {0: 1.5}}"), encoding="utf-8")
    assert main(["simulate", str(path), "--check", "--plot", str(tmp_path / "plot.png")]) == 2
    message = "check 'nutation' does not fit scene 'mine': body 'top' is not a heavy top: it is not symmetric"
    assert message in capsys.readouterr().err
    assert list(tmp_path.iterdir()) == [path]


def test_an_output_that_is_read_no_further_is_no_error():
    """As by ``springgym simulate --list | head -1``."""
    command = [sys.executable, "-m", "springgym", "simulate", "--list"]
    with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE) as process:
        process.stdout.close()
        assert process.stderr.read() == b""
    assert process.returncode == 141


@pytest.mark.skipif(not os.path.exists("/dev/full"), reason="there is no full device")
def test_an_output_that_cannot_be_written_is_one_line():
    with open("/dev/full", "w") as full:
        command = [sys.executable, "-m", "springgym", "simulate", "--list"]
        run = subprocess.run(command, stdout=full, stderr=subprocess.PIPE, text=True, check=False)
    assert run.returncode == 2
    assert run.stderr == "springgym: error: [Errno 28] No space left on device\n"


@pytest.mark.parametrize("option", ["--trace", "--plot", "--video"])
def test_a_file_that_cannot_be_written_leaves_the_old_one(capsys, monkeypatch, tmp_path, option):
    def fails(*arguments, **options):
        Path(arguments[-1]).write_text("half")
        raise OSError(errno.ENOSPC, "No space left on device")

    path = tmp_path / {"--trace": "a.npz", "--plot": "a.png", "--video": "a.gif"}[option]
    path.write_text("old")
    monkeypatch.setattr(simulate, "save_trace", fails)
    monkeypatch.setattr("matplotlib.figure.Figure.savefig", fails)
    monkeypatch.setattr("springgym.scenes.film.save_film", fails)
    assert main([*SHORT, option, str(path)]) == 2
    assert f"error: {path}: No space left on device" in capsys.readouterr().err
    assert [p.read_text() for p in tmp_path.iterdir()] == ["old"]


def test_what_cannot_be_written_is_told_before_the_simulation(capsys, monkeypatch, tmp_path):
    """Each of the files; a name in /proc stands for every place that takes none."""
    monkeypatch.setattr(simulate, "record", None)
    (tmp_path / "a.gif").mkdir()
    for option, name in (("--trace", "/proc/a.npz"), ("--plot", "/proc/a.png"), ("--video", "a.gif")):
        path = tmp_path / name
        assert main([*SHORT, "--trace", str(tmp_path / "a.npz"), option, str(path)]) == 2
        assert f"springgym: error: {path}: it " in capsys.readouterr().err
    assert [path.name for path in tmp_path.iterdir()] == ["a.gif"]


def test_a_file_that_cannot_be_written_keeps_no_other_from_being_so(capsys, monkeypatch, tmp_path):
    def fails(*arguments):
        raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr(simulate, "save_trace", fails)
    trace = tmp_path / "a.npz"
    plot = tmp_path / "a.png"
    assert main([*SHORT, "--trace", str(trace), "--plot", str(plot), "--check"]) == 2
    printed, said = capsys.readouterr()
    assert said == f"springgym: error: {trace}: No space left on device\n"
    assert f"wrote {plot}\n" in printed
    assert "period at 5°" in printed
    assert [path.name for path in tmp_path.iterdir()] == ["a.png"]


HOSTILE = "\\e]0;owned\\a \\e[31m $x^$ _{"
"""What a terminal would obey, and what Matplotlib would set as a formula, as YAML writes it."""


def test_names_and_titles_of_a_file_are_shown_and_not_obeyed(capsys, tmp_path):
    """Wherever they are printed or drawn: in a summary, of pairs of bodies, beside checks, in errors."""
    path = tmp_path / "a\x1b[31m.yaml"
    each = "{{body: {{kind: cube}}, start: {{position: [0, 0, {}]}}, checks: [momentum]}}"
    bodies = "".join(f'  "{name} {HOSTILE}": {each.format(z)}\n' for name, z in (("a", 0), ("b", 1.02)))
    path.write_text(f'title: "{HOSTILE}"\nduration: 0.1\ngravity: 0\nbodies:\n{bodies}')
    words = ["simulate", str(path), "--trace", str(tmp_path / "b\x1b[31m.npz"), "--check"]
    assert main([*words, "-v", "--plot", str(tmp_path / "a.png")]) in (0, 1)
    printed, said = capsys.readouterr()
    assert printed.count(r"\x1b]0;owned\x07") > 3
    assert main([*words, "--step", "1"]) == 2
    said += capsys.readouterr().err
    assert all(char.isprintable() or char == "\n" for char in printed + said)


@pytest.mark.parametrize(
    ("error", "status", "says"),
    [(MemoryError, 2, "error: not enough memory"), (KeyboardInterrupt, 130, "interrupted")],
)
def test_too_little_memory_and_an_interrupt_are_one_line(error, status, says, capsys, monkeypatch):
    def breaks_off(scene):
        raise error

    monkeypatch.setattr(simulate, "load", breaks_off)
    assert main(SHORT) == status
    assert capsys.readouterr().err == f"springgym: {says}\n"


@pytest.mark.slow
def test_options_change_the_plan(tmp_path):
    path = tmp_path / "trace.npz"
    assert main([*SHORT, "--integrator", "rk4", "--step", "1e-3", "--trace", str(path)]) == 0
    trace = np.load(path)
    assert len(trace["times"]) == 11
    plan = load("cube-pendulum")
    expected = record(replace(plan, integrator="rk4", step=1e-3, duration=0.1))
    assert trace["positions"].tolist() == expected.positions.tolist()
    assert trace["kinetic"].tolist() == expected.measures.kinetic.tolist()
    assert trace["masses"].tolist() == plan.scene.body.masses.tolist()


def test_trace_as_text(tmp_path):
    path = tmp_path / "trace.csv"
    assert main([*SHORT, "--trace", str(path)]) == 0
    with path.open() as file:
        rows = list(csv.DictReader(file))
    assert len(rows) == 11
    assert float(rows[3]["time"]) == pytest.approx(0.03)
    columns = {"x0", "z7", "vx0", "vz7", "kinetic", "gravity", "elastic", "contact", "work", "damping_loss"}
    assert columns <= set(rows[0])
    assert float(rows[0]["y6"]) == load("cube-pendulum").scene.positions[6, 1]


@pytest.mark.slow
def test_papers_method_is_one_switch(monkeypatch, capsys):
    seen = []
    monkeypatch.setattr(simulate, "record", lambda plan, **_: seen.append(plan) or record(plan))
    assert main(["simulate", "block-holds", "--preset", "paper", "--duration", "0.1"]) == 0
    plan = seen[0]
    assert (plan.integrator, plan.step) == ("rk4", 5e-4)
    assert plan.scene.contact == plan.paper
    assert "rk4, step 0.5 ms" in capsys.readouterr().out


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["simulate"], "no scene given: pass a scene name"),
        (["simulate", "tops"], "there is no scene 'tops'; did you mean 'top'"),
        (["simulate", "no.yaml"], "no.yaml: cannot read it"),
        ([*SHORT, "--step", "1"], "a step of 1 s is unstable"),
        ([*SHORT, "--duration", "-1"], "--duration -1: it must be at least 1e-07 s, and finite"),
        ([*SHORT, "--duration", "1e-300"], "--duration 1e-300: it must be at least 1e-07 s, and finite"),
        ([*SHORT, "--duration", "nan"], "--duration nan: it must be at least 1e-07 s, and finite"),
        ([*SHORT, "--duration", "1e9"], "at intervals of 0.01 s are 1e+11 states of 6.4e+04 GB"),
        ([*SHORT, "--step", "1e-300"], "--step 1e-300: it must be at least 1e-09 s, and finite"),
        (["simulate", "bouncing-ball", "--duration", "0.1", "--step", "1"], "a step of 1 s is longer than"),
        ([*SHORT, "--trace", "trace.txt"], "trace.txt: the name must end in .npz or .csv"),
        ([*SHORT, "--video", "film.avi"], "film.avi: the name must end in .mp4 or .gif"),
        ([*SHORT, "--plot", "nowhere/plot.png"], "there is no folder"),
        ([*SHORT, "--preset", "paper", "--integrator", "verlet"], "the paper's settings have rk4"),
    ],
)
def test_error_is_one_line_and_status_2(capsys, arguments, message):
    assert main(arguments) == 2
    captured = capsys.readouterr()
    assert captured.out == ""
    assert captured.err.startswith("springgym: error: ")
    assert message in captured.err
    assert captured.err.count("\n") == 1


def test_unknown_options_are_refused(capsys):
    with pytest.raises(SystemExit) as stop:
        main(["simulate", "top", "--integrator", "euler"])
    assert stop.value.code == 2
    assert capsys.readouterr().err == (
        "springgym: error: argument --integrator: invalid choice: 'euler'; did you mean 'symplectic_euler'?\n"
    )


def test_missing_package_is_one_line(capsys, monkeypatch, tmp_path):
    monkeypatch.setitem(sys.modules, "matplotlib", None)
    monkeypatch.delitem(sys.modules, "springgym.scenes.plots")
    assert main([*SHORT, "--plot", str(tmp_path / "a.png")]) == 2
    assert missing("a plot", "matplotlib", "plot") in capsys.readouterr().err


def test_missing_package_names_the_extra_of_the_command(capsys, monkeypatch):
    monkeypatch.setitem(sys.modules, "scipy.optimize", None)
    assert main(["simulate", "bungee"]) == 2
    assert "scipy.optimize" in (error := capsys.readouterr().err)
    assert error.endswith(f": {install('scenes')}\n")


def test_interrupt_keeps_what_was_computed(capsys, monkeypatch, tmp_path):
    def bar(name):
        def wrap(items):
            for n in items:
                if n == 5:
                    raise KeyboardInterrupt
                yield n

        return wrap

    monkeypatch.setattr(simulate, "_bar", bar)
    path = tmp_path / "trace.npz"
    assert main([*SHORT, "--trace", str(path)]) == 130
    assert len(np.load(path)["times"]) == 5
    assert "interrupted; the results end at t = 0.04 s" in capsys.readouterr().err


@pytest.mark.parametrize("name", cli.COMMANDS)
def test_every_command_has_help(capsys, name):
    with pytest.raises(SystemExit) as stop:
        main([name, "--help"])
    assert stop.value.code == 0
    assert f"usage: springgym {name}" in capsys.readouterr().out


def test_help_imports_no_command():
    code = "import sys; from springgym.cli import main\ntry: main(['--help'])\nfinally: print(*sys.modules)"
    run = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    for name, (module, *_) in cli.COMMANDS.items():
        assert name in run.stdout
        assert f" {module} " not in run.stdout.splitlines()[-1]


def test_table_shows_relative_and_absolute_differences():
    checks = [
        Check("a period", 2.0, 2.02, 0.04, "s"),
        Check("a drift", 0.0, 3e-5, 1e-5, "m"),
        Check("b", 1, float("nan"), 1, ""),
        *(within(0.015, "c", theory, theory, "m") for theory in (0.7, 1.0, 3.1)),
    ]
    lines = simulate.table(checks).splitlines()
    assert lines[1].split() == ["a", "period", "2", "2.02", "s", "+1", "%", "2", "%", "ok"]
    assert lines[2].split() == ["a", "drift", "0", "3e-05", "m", "+3e-05", "m", "1e-05", "m", "FAILED"]
    assert lines[3].split() == ["b", "1", "not", "seen", "100", "%", "FAILED"]
    assert all(line.split()[-3:] == ["1.5", "%", "ok"] for line in lines[4:])
    on_the_site = page_writer("media").rows(checks)
    assert [row[6] for row in on_the_site[1:]] == ["2 %", "1e-05", "100 %", *["1.5 %"] * 3]


# --- Plots and films --------------------------------------------------------------------------------


@pytest.mark.parametrize(
    "name", slow_but(["top", "rope-swing", "sliding-block", "flipping-box", "bouncing-ball"], "top")
)
def test_plot_shows_the_recording(name, tmp_path):
    figure = draw(recorded(name))
    path = tmp_path / "plot.png"
    figure.savefig(path)
    assert path.stat().st_size > 20_000
    pictures = [axes for axes in figure.axes if axes.get_images()]
    assert len(pictures) == 1
    for axes in figure.axes:
        assert axes in pictures or [line for line in axes.get_lines() if len(line.get_xdata()) > 100]
    energies = next(axes for axes in figure.axes if axes.get_title(loc="left").startswith("energy"))
    total = next(line for line in energies.get_lines() if line.get_label() == "sum").get_ydata()
    parts = [line.get_ydata() for line in energies.get_lines() if line.get_label() != "sum"]
    # the flipping box only vibrates, and steps of two thirds of the limit keep that energy to 3 %
    assert np.ptp(total) < 0.04 * max(np.abs(part).max() for part in parts)


def test_plot_of_the_top_has_the_cusps_and_the_rigid_twin():
    figure = draw(recorded("top"))
    trace = next(axes for axes in figure.axes if axes.get_title(loc="left") == "trace from above")
    springs, rigid = (
        np.column_stack(line.get_data())
        for line in trace.get_lines()
        if line.get_label() in ("springs", "rigid twin")
    )
    assert len(springs) == len(rigid)
    assert np.abs(springs - rigid).max() < 0.05
    # a cusp: the speed all but vanishes
    speed = np.linalg.norm(np.diff(springs, axis=0), axis=1)
    assert speed.min() < 0.02 * speed.max()


def panel(figure, title):
    return next(axes for axes in figure.axes if axes.get_title(loc="left").startswith(title))


@pytest.mark.slow
def test_plot_of_a_plucked_rope_shows_the_pluck():
    side = panel(draw(recorded("rope-pluck")), "the rope, x stretched")
    shown = np.ptp(side.get_xlim())
    assert shown < 0.01  # m, beside 5 m of rope
    assert max(np.ptp(line.get_xdata()) for line in side.get_lines()) > 0.2 * shown


@pytest.mark.parametrize("name", marked(["sliding-block", "cube-drop", "rope-swing", "bowl-ball"]))
def test_poses_are_apart_wherever_the_body_is_slow_or_comes_again(name):
    recording = recorded(name)
    moments = poses(recording, 0.3, 8)
    assert 3 <= len(moments) <= 9
    assert moments == sorted(set(moments))
    assert moments[-1] == len(recording.times) - 1
    places = recording.measures.centre[moments]
    apart = np.linalg.norm(places[:, None] - places, axis=2) + np.eye(len(places))
    far = np.linalg.norm(np.ptp(recording.measures.centre, axis=0))
    assert apart.min() > 0.04 * far


def test_a_body_that_stays_has_one_pose():
    recording = recorded("block-holds")
    assert poses(recording) == [len(recording.times) - 1]


def test_paths_lie_on_the_body_in_its_picture():
    """Picture and paths are seen by the same camera: the weight's path ends in the weight."""
    figure = draw(recorded("rope-swing"))
    side = panel(figure, "the rope")
    path = next(line for line in side.get_lines() if line.get_label() == "weight")
    right, down = (round(float(values[-1])) for values in path.get_data())
    blue = side.get_images()[0].get_array()[down, right]
    assert int(blue[2]) > int(blue[0]) + 40


def test_a_colour_means_the_same_in_every_panel():
    figure = draw(recorded("cube-drop"))
    by_name: dict[str, set[str]] = {}
    for axes in figure.axes:
        for line in axes.get_lines():
            if not line.get_label().startswith("_"):
                by_name.setdefault(line.get_label(), set()).add(to_hex(line.get_color()))
    assert len(by_name["centre of mass"]) == 1
    colors = [color for used in by_name.values() for color in used]
    assert len(colors) == len(set(colors))


def test_plot_of_a_block_that_holds_shows_no_speed():
    figure = draw(recorded("block-holds"))
    fast = panel(figure, "how fast it is")
    assert fast.get_ylabel() in ("[µm/s]", "[nm/s]")
    assert fast.get_lines()[0].get_ydata()[-1] < 1e-2


@cache
def brief(name):
    """Return a short recording of a box or of a single particle."""
    plan = replace(load("flipping-box"), duration=0.1)
    if name != "flipping-box":
        ball = Body("ball", np.zeros((1, 3)), 1.0, np.zeros((0, 2), int), 1.0, 0.0)
        plan = replace(plan, scene=Scene(ball, gravity=None), trace=None)
    return record(plan)


BODIES = ("flipping-box", "one particle at rest")


@pytest.mark.parametrize("kind", slow_but(PLOTS, "top", "bodies"))
def test_every_kind_of_plot_of_any_body(kind, monkeypatch):
    monkeypatch.setattr(plots, "FINER", 0.2)
    for name in BODIES:
        recording = brief(name)
        draw(replace(recording, plan=replace(recording.plan, plot=kind))).draw_without_rendering()


@pytest.mark.parametrize("size", [1e-3, 0.02, 0.1, 0.3, 1.0, 37.0])
@pytest.mark.parametrize("kind", ["top", "pendulum"])
def test_labels_of_ticks_do_not_collide(kind, size, monkeypatch):
    """Whatever the size of what is drawn: the labels of an axis are apart by half a digit at least."""
    monkeypatch.setattr(plots, "FINER", 0.2)
    recording = whirled()
    moved = recording.measures._replace(centre=size * recording.measures.centre)
    plan = replace(recording.plan, plot=kind)
    figure = draw(replace(recording, positions=size * recording.positions, measures=moved, plan=plan))
    figure.draw_without_rendering()
    for axis in (axis for axes in figure.axes if axes.axison for axis in (axes.xaxis, axes.yaxis)):
        low, high = sorted(axis.get_view_interval())
        ticks = zip(axis.get_majorticklabels(), axis.get_majorticklocs(), strict=True)
        boxes = [label.get_window_extent() for label, place in ticks if low <= place <= high]
        assert len(boxes) >= 2
        for box, other in itertools.pairwise(boxes):
            assert max(other.x0 - box.x1, other.y0 - box.y1) > 6, axis.axes.get_title("left")


@cache
def whirled():
    """Return a short recording of the paper's top."""
    return record(replace(load("top"), duration=2.0, checks=()))


@pytest.mark.parametrize("name", BODIES)
def test_a_film_of_any_body(name):
    assert len(list(frames(brief(name), fps=20.0))) == 3


@pytest.mark.slow
def test_plot_of_a_line_shows_it_turn_as_theory_says():
    recording = recorded("spun-pair")
    lines = panel(draw(recording), "angular velocity in the world's axes").get_lines()
    expected = CHECKS["spun_length"](recording)[1].theory
    assert [float(line.get_ydata()[-1]) for line in lines] == pytest.approx([0, 0, expected], abs=1e-3)


def test_the_shortest_run_can_be_drawn():
    recording = record(replace(load("top"), duration=LEAST["duration"], step=None))
    draw(recording).draw_without_rendering()
    assert len(list(frames(recording))) == 1


@pytest.mark.parametrize(
    "name", slow_but(["rope-swing", "gyroscope", "cube-drop", "bouncing-ball", "top-in-bowl"], "rope-swing")
)
def test_film_shows_the_body_in_the_picture(name):
    recording = recorded(name)
    pictures = list(frames(recording, fps=1.0, speed=1.0))
    assert len(pictures) == 1 + int(recording.times[-1] + 1e-9)
    assert pictures[0].shape == (640, 640, 3)
    changed = np.abs(pictures[-1].astype(int) - pictures[0]).max(axis=2) > 20
    assert 50 < changed.sum() < changed.size / 2
    pixels, depth = camera(recording).project(recording.positions, (640, 640))
    assert np.isfinite(depth).all()
    assert pixels.min() > 0
    assert pixels.max() < 640


def test_film_shows_vibrations_that_nobody_could_see():
    """The rim of a struck steel top moves by micrometres: its springs are coloured by their strain."""
    recording = record(replace(load("ringing-top"), duration=2e-3, checks=()))
    middle = np.s_[60:540, 60:580]
    plain = replace(recording.plan.view, strain=False)
    still = list(frames(replace(recording, plan=replace(recording.plan, view=plain))))
    shown = list(frames(recording))
    assert len(shown) == len(still) > 4

    def change(pictures):
        first, *others = (picture[middle].astype(int) for picture in pictures)
        return max(int((np.abs(other - first).max(axis=2) > 30).sum()) for other in others)

    assert change(shown) > 10 * change(still)  # of these, edges that move by less than a pixel


def test_strain_of_the_full_colour_is_round():
    assert [round_up(x) for x in (1.0, 1.01, 2e-5, 4.2e-3, 7e2, 0.0)] == pytest.approx(
        [1.0, 2.0, 2e-5, 5e-3, 1e3, 1.0]
    )
    strain = np.zeros((10, 100))
    strain[3, 7] = -0.3  # one of a thousand does not count
    assert strain_scale(strain) == 1.0
    strain[:, :10] = 3e-4
    assert strain_scale(strain) == pytest.approx(5e-4)


def test_the_light_end_of_an_uneven_ball_is_dark():
    """A tippe-top is dark where its centre of mass is not; what is even, or no ball, has no cap."""
    scene = load("tippe-top").scene
    drawn = look(scene, None)
    body = scene.body
    dark = (np.asarray(drawn.triangle_colors) == INK).all(axis=1)
    skin = drawn.points(body.positions)
    middles = skin[np.asarray(drawn.triangles)].mean(axis=1) - body.rounds[0].centre
    up = middles @ (body.rounds[0].centre - body.masses @ body.positions / body.masses.sum())
    assert 0.02 < dark.mean() < 0.3
    assert up[dark].min() > up[~dark].max()
    for name in ("ball-rolls", "rattleback", "euler-disk"):
        even = look(load(name).scene, None)
        assert not (np.asarray(even.triangle_colors) == INK).all(axis=1).any()


@pytest.mark.slow
def test_film_is_written_in_real_time(tmp_path, monkeypatch):
    imageio = pytest.importorskip("imageio.v3")
    path = tmp_path / "film.gif"
    shown = {}
    monkeypatch.setattr(simulate, "_bar", lambda name: lambda items: shown.setdefault(name, list(items)))
    assert main(["simulate", "cube-pendulum", "--duration", "0.5", "--video", str(path)]) == 0
    assert {name: len(items) for name, items in shown.items()} == {"cube-pendulum": 51, "film": 13}
    film = imageio.imread(path, index=None)
    assert len(film) == 13  # 25 frames a second
    assert film[0].shape == (640, 640, 3)
    assert (film[0] != film[-1]).any()


def test_surfaces_are_the_scenery():
    assert scenery(recorded("block-holds")).planes == (
        ((0, 0, 0), load("block-holds").scene.surfaces[0].normal),
    )
    assert scenery(recorded("top")).floor == pytest.approx(0.0, abs=0.1)
    assert scenery(recorded("top")).vertical is not None
    assert scenery(recorded("rope-swing")).floor < -5


@pytest.mark.parametrize(
    "name", ["top", "unbalanced-top", "gyroscope", "rope-swing", "cube-drop", "irregular-fall"]
)
def test_look_fits_the_body(name):
    body = load(name).scene.body
    drawn = look(Scene(body), 1)
    assert drawn.particles <= len(body.masses)
    assert len(np.asarray(drawn.triangles)) == len(body.triangles)
    heavy = np.flatnonzero(np.asarray(drawn.radii) > 0.03)
    if name == "unbalanced-top":
        assert 0 in heavy


def test_a_spin_that_would_be_seen_backwards_is_slowed_down():
    """50 rad/s: a radian from frame to frame at 50 a second, but two at 25."""
    recording = recorded("top")
    fastest = turning(recording.plan.scene, recording.bodies)
    assert fastest == pytest.approx(50, rel=0.02)
    assert visible_speed(fastest, 50.0) == 1.0
    assert visible_speed(fastest, 25.0) == 0.5
    assert visible_speed(0.0, 25.0) == 1.0
    short = record(replace(load("top"), duration=0.2))
    assert len(list(frames(short, fps=25.0))) == 11


def test_a_camera_follows_what_goes_far():
    plan = load("sliding-block")
    far = replace(plan.scene, velocities=10 * plan.scene.velocities)
    recording = record(replace(plan, scene=far, duration=2.0))
    along = way(recording)
    assert np.linalg.norm(along[-1]) > 8 * 0.4
    seen = camera(recording)
    for n in range(0, len(along), 50):
        pixels, _ = seen.moved(along[n]).project(recording.positions[n], (640, 640))
        assert pixels.min() > 0
        assert pixels.max() < 640
    assert way(recorded("sliding-block")) is None
    assert way(recorded("top")) is None
