"""Films: the file asked for, at most 25 frames a second in a GIF, and the agent's own episode."""

import subprocess
import sys

import controllers
import gymnasium as gym
import imageio_ffmpeg
import numpy as np
import pytest
import toy_env
import watch
from PIL import Image, ImageSequence

from tests.envs.cases import KINDS
from tests.params import slow_but


@pytest.fixture
def right(monkeypatch):
    act = lambda task, seen: np.ones((len(seen), 1), np.float32)  # noqa: E731
    monkeypatch.setitem(controllers.CLASSICAL, "Toy-v0", {"push": act})


def test_gif(right, tmp_path, capsys):
    path = tmp_path / "toy.gif"
    arguments = ["classical", "--env", "Toy-v0", "--seed", "5", "--out", str(path)]
    assert watch.main([*arguments, "--set", "push=0.3"]) == 0
    assert f"wrote {path}" in capsys.readouterr().out
    env = gym.make("Toy-v0", render_mode="rgb_array", push=0.3)
    frames = list(watch.play_episode(env, lambda o: np.ones((1, 1), np.float32), 5))
    with Image.open(path) as film:
        assert film.n_frames == len(frames) < toy_env.LIMIT
        film.seek(film.n_frames - 1)
        difference = np.asarray(film.convert("RGB")).astype(int) - frames[-1]
        assert abs(difference).max() < 16
        assert film.info["duration"] == 40
    assert not np.array_equal(frames[0], frames[-1])


@pytest.mark.usefixtures("small_pictures")
@pytest.mark.parametrize(
    ("env_id", "suffix"),
    slow_but([("SpringRope-v0", ".mp4"), *((env_id, ".gif") for env_id in KINDS)], ("SpringTop-v0", ".gif")),
)
def test_films_play_in_real_time(env_id, suffix, tmp_path):
    """At the environment's own rate; a picture of a GIF stays for as long as browsers can keep to."""
    steps = 6
    path = tmp_path / f"film{suffix}"
    watch.record("random", env_id, {"max_episode_steps": steps}, path, seed=0)  # that no two are alike
    period = gym.make(env_id).unwrapped.episodes.task.period
    if suffix == ".mp4":
        pictures, seconds = imageio_ffmpeg.count_frames_and_secs(path)
        assert pictures == steps + 1
        every = 1
    else:
        with Image.open(path) as film:
            shown = [frame.info["duration"] for frame in ImageSequence.Iterator(film)]
        seconds = sum(shown) / 1000
        every = -(-(steps + 1) // len(shown))
        assert min(shown) >= 40
    assert seconds == pytest.approx(-(-(steps + 1) // every) * every * period, abs=0.011)


def test_window_is_drawn_once_a_step_until_it_is_closed(monkeypatch):
    pygame = pytest.importorskip("pygame")
    drawn = []
    acted = []

    class Clock:
        def tick(self, fps):
            drawn.append(fps)
            if len(drawn) == 30:
                pygame.event.post(pygame.event.Event(pygame.QUIT))

    def counted(*arguments):
        noop = controllers.make_controller(*arguments)
        return lambda observations: acted.append(1) or noop(observations)

    monkeypatch.setattr(pygame.time, "Clock", Clock)
    monkeypatch.setattr(watch, "make_controller", counted)
    assert watch.main(["noop", "--env", "SpringTop-v0"]) == 0
    assert len(drawn) == 30 == len(acted) + 1
    assert not pygame.display.get_init()


def test_without_a_display_it_says_so(monkeypatch, capsys):
    """SDL draws to nowhere then, and would do so for ever."""
    pytest.importorskip("pygame")
    monkeypatch.setenv("SDL_VIDEODRIVER", "offscreen")
    assert watch.main(["noop", "--env", "SpringTop-v0"]) == 2
    assert "no display available; write a film with --out" in capsys.readouterr().err


def test_a_page_of_classical_control(tmp_path, capsys):
    """The same episode as in a film."""
    pytest.importorskip("viser")
    path = tmp_path / "top.html"
    short = ["--set", "max_episode_steps=12"]
    assert watch.main(["classical", "--env", "SpringTop-v0", "--out", str(path), *short]) == 0
    assert f"wrote {path}" in capsys.readouterr().out
    assert "__VISER_EMBED_DATA__" in path.read_text(encoding="utf-8")
    options = {"max_episode_steps": 12}
    motion = watch.played(watch.watched("classical", "SpringTop-v0", options), 5)
    assert motion.title == "SpringTop-v0: classical control"
    env, policy = watch.make_watched("classical", "SpringTop-v0", options, "rgb_array")
    assert len(list(watch.play_episode(env, policy, 5))) - 1 == round(motion.times[-1] / 0.02) == 12
    np.testing.assert_array_equal(env.unwrapped.episodes.particles[0][0], motion.positions[-1])


def test_the_browser_shows_episodes_of_the_agent(right, monkeypatch, capsys):
    shown = []
    monkeypatch.setattr(watch.view, "show", shown.append)
    arguments = ["noop", "--env", "SpringTop-v0", "--set", "max_episode_steps=5"]
    assert watch.main([*arguments, "--seed", "7", "--browser"]) == 0
    (subject,) = shown
    assert subject.names[0] == "seed 7"
    assert subject.make("seed 7", {}).title == "SpringTop-v0: no action"
    assert watch.main(["classical", "--env", "Toy-v0", "--out", "toy.html"]) == 2
    assert "Toy-v0 is not a springgym environment" in capsys.readouterr().err


def command_without(modules, *arguments):
    """Run ``springgym`` in a Python that lacks some modules."""
    code = (
        f"import sys; sys.modules.update(dict.fromkeys({modules}));"
        "from springgym.cli import main; sys.exit(main(sys.argv[1:]))"
    )
    return subprocess.run([sys.executable, "-c", code, *arguments], capture_output=True, text=True)


@pytest.mark.slow
def test_a_published_agent_is_watched_without_stable_baselines3_and_pytorch(tmp_path):
    path = tmp_path / "top.gif"
    lacks = ["stable_baselines3", "sb3_contrib", "torch"]
    arguments = ["SpringTop-v0", "--out", str(path), "--set", "max_episode_steps=5"]
    done = command_without(lacks, "watch", *arguments)
    assert done.returncode == 0, done.stderr
    assert path.exists()
