"""The planner: what its model foretells comes true, and plans get better."""

import json

import gymnasium as gym
import numpy as np
import plan
import pytest

import springgym

TASK = "SpringTop-v0"


@pytest.mark.parametrize("arguments", [{}, {"sparse": True}])
def test_what_sequences_earn_is_what_the_environment_pays(arguments):
    """Until the top falls; of the sparse variant, what shapes the reward."""
    env, shaped = gym.make(TASK, **arguments), gym.make(TASK)
    model = gym.make_vec(TASK, 3, vectorization_mode="vector_entry_point", max_episode_steps=-1, **arguments)
    env.reset(seed=3)
    shaped.reset(seed=3)
    tried = np.zeros((3, 120, 3), np.float32)
    tried[0, :, 0], tried[1] = 1.0, 0.1
    found = plan.returns(model, springgym.get_state(env), tried)
    start = springgym.get_state(shaped)
    for actions, total in zip(tried, found, strict=True):
        springgym.set_state(shaped, start)
        earned, ended = 0.0, False
        for action in actions:
            if not ended:
                _, reward, ended, _, _ = shaped.step(action)
                earned += reward
        assert total == pytest.approx(earned, rel=1e-12)
    assert found.min() < 0.9 * found.max()  # one falls


def test_plans_come_to_what_is_best():
    planner = plan.Planner(samples=64, horizon=10, iterations=8)
    best = np.linspace(-0.8, 0.8, 10)[:, None] * [1.0, -1.0]

    def judge(tried):
        return -np.square(tried - best).sum(axis=(1, 2))

    rng, found = np.random.default_rng(0), np.zeros((10, 2))
    before = judge(found[None])
    for _ in range(5):
        better = plan.improved(found, judge, planner, rng)
        assert judge(better[None]) >= judge(found[None])  # what was found is not lost
        found = better
    assert judge(found[None]) > 0.05 * before


@pytest.mark.parametrize("colour", [0.0, 1.0])
def test_noise_is_of_unit_variance_and_its_colour(colour):
    planner = plan.Planner(samples=4000, horizon=30, colour=colour)
    made = plan.noise(np.random.default_rng(0), planner, 2)
    assert made.shape == (4000, 30, 2)
    assert made.std() == pytest.approx(1.0)
    neighbours = (made[:, 1:] * made[:, :-1]).mean()
    assert abs(neighbours) < 0.02 if colour == 0 else neighbours > 0.4


def test_intervals_of_success():
    """Of 5 in 5 and 0 in 10 (Wilson, 95 %)."""
    assert plan.wilson(5, 5) == pytest.approx((0.5655, 1.0), abs=1e-4)
    assert plan.wilson(0, 10) == pytest.approx((0.0, 0.2775), abs=1e-4)


def test_a_row_is_written_in_place_of_the_one_before(tmp_path, capsys):
    path = tmp_path / "rows.json"
    asked = ["--id", TASK, "--episodes", "1", "--samples", "8", "--horizon", "2", "--iterations", "1"]
    for _ in range(2):
        assert plan.main([*asked, "--json", str(path)]) == 0
    (row,) = json.loads(path.read_text())
    assert (row["task"], row["episodes"], row["planner"]["samples"]) == (TASK, 1, 8)
    assert 0 <= row["mean_return"] <= 1
    assert row["real_time_factor"] > 0
    assert "s of one core a simulated second" in capsys.readouterr().out
