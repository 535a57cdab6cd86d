"""The command line of the view."""

import pytest

from springgym import view
from springgym.cli import main

pytest.importorskip("viser")


def test_a_page_is_saved_and_holds_what_it_needs(tmp_path, capsys):
    path = tmp_path / "page.html"
    assert main(["view", "top", "--save", str(path)]) == 0
    printed, warned = capsys.readouterr()
    assert printed == f"wrote {path}\n"
    assert not warned
    text = path.read_text(encoding="utf-8")
    assert "__VISER_EMBED_DATA__" in text
    assert 'src="http' not in text
    assert "ω, angular velocity" in text


def test_an_episode_is_saved(tmp_path):
    path = tmp_path / "page.viser"
    assert main(["view", "SpringTop-v0", "--agent", "random", "--save", str(path)]) == 0
    assert 10_000 < path.stat().st_size < 1e6


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["tpo"], "did you mean 'top'?"),
        (["top", "--save", "page.gif"], "page.gif: the name must end in .html or .viser"),
        (["top", "--save", "nowhere/page.html"], "there is no folder"),
        (["SpringTop-v0", "--agent", "nobody"], "'nobody' is neither a run folder nor a published agent"),
        (["SpringTop-v0", "--agent", "classical"], "springgym watch classical --env SpringTop-v0 --browser"),
        (["CartPole-v1"], "CartPole-v1 is not a springgym environment"),
        (["SpringTpo-v0"], "SpringTop"),
        (["./mine.py:Foo-v0"], "Unknown environment './mine.py:Foo-v0'"),
        *(
            (["top", "--port", str(port)], f"port is {port}; it must be a whole number from 0 to 65535")
            for port in (-1, 65536, 10**30)
        ),
        *(
            (["top", "--address", address], "must be an IPv4 address")
            for address in ("", "localhost", "::", "192.168.0.1:80")
        ),
        (["top", "--address", "192.0.2.1"], "this machine has no such address"),
    ],
)
def test_what_cannot_be_shown_is_told(arguments, message, capsys, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    assert main(["view", *arguments, "--no-browser"]) == 2
    assert message in capsys.readouterr().err


def test_a_path_is_told_from_an_environment(tmp_path, monkeypatch, capsys):
    """Only what ends as the id of an environment does is one, if it is no file."""
    monkeypatch.chdir(tmp_path)
    for path in ("my-v2.yaml", "tops-v0/a.yaml", "a-verse.yml", "top-v1.0", "top-v", "two-tops"):
        assert not view._is_environment(path)
    (tmp_path / "tops-v0").mkdir()
    for path in ("my-v2.yaml", "tops-v0/scene-v1"):  # files
        (tmp_path / path).write_text("title: a top\nbody: {kind: top}\npinned: [tip]\nduration: 0.1\n")
        assert not view._is_environment(path)
    for env_id in ("SpringTop-v0", "tops-v0", "module:Name-v12", "space/Name-v3"):
        assert view._is_environment(env_id)
    assert main(["view", "my-v2.yaml", "--port", "-1"]) == 2
    assert "port is -1" in capsys.readouterr().err  # so far it comes


def test_steps_of_a_file_give_way_to_stiffer_bodies():
    """The bungee's file has a step that springs ten times as stiff would not bear."""
    soft = view.simulated("bungee", {("body", "end_mass"): 60.0})
    stiff = view.simulated("bungee", {("body", "stiffness"): 2e5})
    assert soft.times[-1] > 1
    assert stiff.strain.max() < 0.2
