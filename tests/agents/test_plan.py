"""The planner: what its model foretells comes true, and plans get better."""

import json
from dataclasses import replace

import gymnasium as gym
import numpy as np
import plan
import pytest
import results

import springgym

TASK = "SpringTop-v0"
SMALL = ["--samples", "8", "--horizon", "0.1", "--spacing", "0.04", "--iterations", "1"]


def batch(copies, **arguments):
    return gym.make_vec(TASK, copies, vectorization_mode="vector_entry_point", **arguments)


@pytest.mark.parametrize("arguments", [{}, {"sparse": True}])
def test_what_sequences_earn_is_what_the_environment_pays(arguments):
    """Until the top falls, which costs 1 a period; of the sparse variant, what shapes the reward."""
    env = gym.make(TASK, **arguments)
    shaped = gym.make(TASK)
    model = batch(3, max_episode_steps=-1, **arguments)
    env.reset(seed=3, options={"spin": 5.0})
    shaped.reset(seed=3, options={"spin": 5.0})
    tried = np.zeros((3, 120, 3), np.float32)
    tried[0, :, 0] = 1.0
    tried[1] = 0.1
    springgym.set_state(model, springgym.get_state(env), range(3))
    found = plan.returns(model, tried)
    start = springgym.get_state(shaped)
    falls = 0
    for actions, total in zip(tried, found, strict=True):
        springgym.set_state(shaped, start)
        earned = 0.0
        ended = False
        for action in actions:
            if not ended:
                _, reward, ended, _, _ = shaped.step(action)
                earned += reward
        assert total == pytest.approx(earned - 120 * ended, rel=1e-12)
        falls += ended
    assert falls


def test_who_wins_does_not_fail():
    """An episode that ends by success costs nothing."""

    class Won:
        def step(self, actions):
            infos = {"reward_all": np.ones(2), "is_success": np.array([True, False])}
            return None, None, np.ones(2, bool), None, infos

    assert plan.returns(Won(), np.zeros((2, 5, 1))).tolist() == [1.0, -4.0]


def test_actions_lie_on_straight_lines():
    plans = np.array([[[0.0], [1.0], [-1.0]]])
    assert plan.taken(plans, 2)[0, :, 0].tolist() == [0.0, 0.5, 1.0, 0.0, -1.0, -1.0]
    np.testing.assert_array_equal(plan.taken(plans[0], 1), plans[0])


@pytest.mark.parametrize("period", [0.01, 0.02, 0.04, 0.05, 0.3])
def test_a_plan_reaches_as_far_as_asked(period):
    planner = plan.Planner()
    length, between = planner.periods(period)
    assert length * between * period == pytest.approx(planner.horizon, rel=0.1)
    assert abs(between * period - planner.spacing) <= max(period / 2, period - planner.spacing) + 1e-12


@pytest.mark.parametrize("temperature", [None, 0.3])
def test_plans_come_to_what_is_best(temperature):
    planner = plan.Planner(samples=64, iterations=8, temperature=temperature)
    best = np.linspace(-0.8, 0.8, 10)[:, None] * [1.0, -1.0]

    def judge(tried):
        return -np.square(tried - best).sum(axis=(1, 2))

    search = plan.Search(planner, best.shape, 0)
    before = after = judge(search.best[None])
    for _ in range(8):
        plan.improve([search], judge, planner)
        if temperature is None:
            assert judge(search.best[None]) >= after  # what was found is not lost
        after = judge(search.best[None])
    assert after > 0.2 * before


def test_a_plan_is_shifted_with_time():
    search = plan.Search(plan.Planner(), (3, 1), 0)
    search.best = np.array([[1.0], [2.0], [3.0]])
    search.shift()
    assert search.best[:, 0].tolist() == [2.0, 3.0, 3.0]


@pytest.mark.parametrize("colour", [0.0, 1.0])
def test_noise_is_of_unit_variance_and_its_colour(colour):
    made = plan.noise(np.random.default_rng(0), (4000, 30, 2), colour)
    assert made.shape == (4000, 30, 2)
    assert made.std() == pytest.approx(1.0)
    neighbours = (made[:, 1:] * made[:, :-1]).mean()
    assert abs(neighbours) < 0.02 if colour == 0 else neighbours > 0.4


def test_episodes_at_once_are_those_one_by_one():
    """Of lengths that differ: what is played to its end leaves the others as they are."""
    planner = plan.Planner(samples=4, horizon=0.2, iterations=1)

    def played(*seeds):
        model = batch(len(seeds) * 4, max_episode_steps=-1)
        model.reset(seed=0)
        return plan.play(batch(len(seeds), max_episode_steps=12), model, seeds, planner)

    together = played(1, 2, 3)
    alone = [one for seed in (1, 2, 3) for one in played(seed)]
    for first, second in zip(together, alone, strict=True):
        assert first.pop("seconds") > 0
        second.pop("seconds")
        assert first == second
    assert together[0]["steps"] == 12
    assert len({one["return"] for one in together}) == 3


def test_intervals_of_success():
    """Of 5 in 5 and 0 in 10 (Wilson, 95 %)."""
    assert results.wilson(5, 5) == pytest.approx((0.5655, 1.0), abs=1e-4)
    assert results.wilson(0, 10) == pytest.approx((0.0, 0.2775), abs=1e-4)


def test_settings_are_of_environments():
    from springgym.envs.registration import ENVIRONMENTS

    ids = [row.id for row in ENVIRONMENTS]
    assert set(plan.SETTINGS) <= set(ids)
    for task in ids:
        plan.planner_of(task)  # its settings are known
    assert plan.planner_of("SpringTopSparse-v0") == plan.planner_of(TASK)


def test_rows_are_made_once_and_go_on(tmp_path, capsys, monkeypatch):
    """A row is skipped while nothing has changed; a stopped one goes on after the episodes that were kept."""
    monkeypatch.setattr(plan, "AT_ONCE", 1)
    monkeypatch.setattr(plan, "probe", lambda task: [0.5])
    monkeypatch.setattr(plan, "same_probe", lambda probe, task: probe == [0.5])
    path = tmp_path / "rows.json"
    counted = []

    def play(task, planner, seeds):
        if len(counted) == 1 and not stopped:
            stopped.append(True)
            raise KeyboardInterrupt
        counted.extend(seeds)
        return [{"seed": s, "return": 0.25, "success": True, "steps": 10, "seconds": 0.5} for s in seeds]

    stopped = []
    monkeypatch.setattr(plan, "play_episodes", play)
    asked = ["--json", str(path), "--tasks", TASK, "--episodes", "2"]
    assert plan.main(asked) == plan.INTERRUPTED
    assert not path.exists()
    assert plan.main(asked) == plan.main(asked) == 0
    assert counted == [plan.HELD_OUT_SEED, plan.HELD_OUT_SEED + 1]
    (row,) = json.loads(path.read_text())
    assert (row["task"], row["algorithm"], row["episodes"]) == (TASK, "planner", 2)
    assert (row["mean_return"], row["success_rate"], row["seconds"]) == (0.25, 1.0, 1.0)
    assert row["real_time_factor"] == pytest.approx(1.0 / (20 * 0.02))
    assert row["planner"]["samples"] == 64
    for old in ({"config": "0"}, {"protocol": 1}, {"probe": [0.6]}):
        path.write_text(json.dumps([row | old]))
        path.with_suffix(".parts.json").unlink()
        assert plan.main(asked) == 0
        assert (counted[-2:], json.loads(path.read_text())) == (counted[:2], [row])
    assert len(counted) == 8
    assert "s of one core a simulated second" in capsys.readouterr().out
    path.write_text("[{}]")
    assert plan.main(asked) == 2
    assert "does not hold rows of results" in capsys.readouterr().err


def test_episodes_of_a_task_are_played_ten_at_a_time(monkeypatch, capsys):
    """What an environment reports no success of has a dash."""
    counted = []

    def play(task, planner, seeds):
        counted.append((planner.samples, planner.elites, list(seeds)))
        return [{"return": 0.25, "success": None, "steps": 10, "seconds": 0.5} for _ in seeds]

    monkeypatch.setattr(plan, "play_episodes", play)
    assert plan.main(["--tasks", TASK, "--episodes", "12", "--seed", "3", "--samples", "4"]) == 0
    assert counted == [(4, 2, [*range(3, 13)]), (4, 2, [13, 14])]
    said = capsys.readouterr().out
    assert f"{TASK}: return 0.250 (0.250–0.250) per step, success – of 12 episodes, 2.50 s" in said


def test_the_digest_tells_planners_apart():
    planner = plan.Planner()
    assert plan.digest(planner) == plan.digest(plan.Planner())
    assert plan.digest(planner) != plan.digest(replace(planner, colour=0.5))
