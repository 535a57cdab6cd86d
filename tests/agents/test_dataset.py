"""Data sets of episodes: what is in them is what the environment does."""

import dataset
import gymnasium as gym
import numpy as np
import plan
import pytest

TASK = "SpringTop-v0"


@pytest.fixture
def minari(tmp_path, monkeypatch):
    monkeypatch.setenv("MINARI_DATASETS_PATH", str(tmp_path))
    return pytest.importorskip("minari")


@pytest.mark.filterwarnings("ignore::UserWarning:minari")
def test_recorded_episodes_can_be_played_again(minari, monkeypatch, capsys):
    """By seed and actions, in the environment that the data set makes, to the bit; also of an agent that
    plans."""
    monkeypatch.setitem(plan.SETTINGS, TASK, {"samples": 4, "horizon": 0.2, "iterations": 1, "elites": 2})
    agents = ["noop", "classical", "planner"]
    asked = [TASK, *agents, "--episodes", "2", "--set", "max_episode_steps=20", "hard=true"]
    for _ in range(2):  # the second ones take the place of the first
        assert dataset.main(asked) == 0
    assert dataset.main([*asked, "--noise", "0.3"]) == 0
    assert "springgym/SpringTop/classical-v0: 2 episodes" in capsys.readouterr().out
    noisy = [f"{agent}-noisy" for agent in agents]
    for agent in [*agents, *noisy]:
        data = minari.load_dataset(f"springgym/SpringTop/{agent}-v0")
        assert data.total_episodes == 2
        assert data.storage.metadata["algorithm_name"] == agent
        env = data.recover_environment()
        assert env.spec.kwargs.get("observation") == ("features" if "classical" in agent else None)
        for n, episode in enumerate(data.iterate_episodes()):
            seen, _ = env.reset(seed=dataset.DATASET_SEED + n)
            for k, action in enumerate(episode.actions):
                np.testing.assert_array_equal(seen, episode.observations[k])
                seen, reward, terminated, truncated, _ = env.step(action)
                assert reward == episode.rewards[k]
                assert (terminated, truncated) == (episode.terminations[k], episode.truncations[k])
            assert terminated or truncated
            np.testing.assert_array_equal(seen, episode.observations[-1])
            assert len(episode.observations) == len(episode.actions) + 1


def test_noise_is_of_the_size_asked_for():
    """Actions of this task go from −1 to 1: little of a noise of 0.2 is cut off there."""
    envs = dataset.Recorded(gym.make_vec(TASK, 2, vectorization_mode="vector_entry_point"), noise=0.2)
    envs.reset(seed=[7, 8])
    for _ in range(200):
        envs.step(np.zeros(envs.action_space.shape, np.float32))
    played = np.array([actions for actions, *_ in envs.steps])
    assert abs(played.std() - 0.2) < 0.2 * 4 / np.sqrt(2 * played.size)  # four standard errors
    assert abs(played.mean()) < 0.2 * 4 / np.sqrt(played.size)


def test_only_the_first_episode_of_a_copy_is_recorded():
    envs = dataset.Recorded(
        gym.make_vec("SpringRope-v0", 2, vectorization_mode="vector_entry_point", max_episode_steps=3)
    )
    envs.reset(seed=[7, 8])
    for _ in range(5):
        envs.step(np.zeros(envs.action_space.shape, np.float32))
    first, second = envs.episodes()
    assert (first["seed"], second["seed"]) == (7, 8)
    assert (len(first["actions"]), len(first["observations"])) == (3, 4)
    assert first["truncations"] == [False, False, True]
    assert not np.array_equal(first["observations"], second["observations"])


def test_without_minari_it_says_how_to_get_it(monkeypatch, capsys):
    monkeypatch.setattr(dataset, "find_spec", lambda name: None)
    assert dataset.main([TASK, "noop"]) == 2
    assert "dataset.py needs Minari: pip install" in capsys.readouterr().err
