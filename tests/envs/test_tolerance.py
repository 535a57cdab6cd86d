"""The step that a wanted error asks for: episodes that were not tried meet it; what cannot be is refused."""

from __future__ import annotations

from typing import Any

import gymnasium as gym
import numpy as np
import pytest

from springgym.envs import tolerance
from springgym.envs.tolerance import EPISODES, SAFETY
from tests.envs.cases import make_vec
from tests.params import slow_but


def batch(copies: int = EPISODES, **options: Any) -> Any:
    """Return a batch of SpringTop-v0. With this many copies, all episodes of a trial are played at once."""
    return make_vec("SpringTop-v0", copies, "native", "NextStep", **options)


def errors_of(copies: int, periods: int, **options: Any) -> tuple[Any, np.ndarray]:
    """Return a batch, and errors of its control periods from seeds that were not tried."""
    envs = batch(copies, error=True, **options)
    envs.reset(seed=1000)
    rng = np.random.default_rng(1000)
    errors = []
    for _ in range(periods):
        *_, info = envs.step(rng.uniform(-1, 1, envs.action_space.shape).astype(np.float32))
        assert (info["error_bound"] == SAFETY * envs.unwrapped.chosen.error).all()
        errors.append(info["step_error"])
    return envs.unwrapped, np.array(errors)


@pytest.mark.parametrize("tolerance", slow_but([2e-4, 1e-6], 2e-4))
def test_errors_stay_below_it(tolerance: float) -> None:
    """They do so without waste: at half of the steps they would not."""
    env, errors = errors_of(32, 40, tolerance=tolerance)
    assert 0 < errors.max() <= env.chosen.error * SAFETY <= tolerance
    assert errors.max() > tolerance / 2**env.episodes.simulator.integrator.order / SAFETY
    assert env.episodes.steps == env.chosen.steps
    assert env.episodes.simulator.integrator == env.chosen.plan.method


@pytest.mark.slow
def test_a_looser_one_costs_less() -> None:
    loose, usual, strict = (batch(tolerance=tolerance).unwrapped.chosen for tolerance in (1e-3, 1e-4, 1e-6))
    assert loose.cost < usual.cost < strict.cost
    assert loose.error > usual.error > strict.error


@pytest.mark.slow
def test_one_copy_and_many_choose_alike(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(tolerance, "PERIODS", 5)
    single = gym.make("SpringTop-v0", tolerance=1e-5)
    assert single.unwrapped.chosen == batch(5, tolerance=1e-5).unwrapped.chosen
    single.reset(seed=0)
    *_, info = single.step(single.action_space.sample())
    assert info["error_bound"] == SAFETY * single.unwrapped.chosen.error
    assert type(info["error_bound"]) is float
    assert "error_bound" not in gym.make("SpringTop-v0").reset(seed=0)[1]


@pytest.mark.slow
def test_it_is_met_at_the_ends_of_ranges() -> None:
    """A lighter and stiffer body needs finer steps."""
    plain = batch(tolerance=1e-5).unwrapped.chosen
    ranges = {"stiffness": (0.5, 2.0), "masses": (0.5, 2.0)}
    env, errors = errors_of(16, 20, tolerance=1e-5, randomize=ranges)
    assert errors.max() <= 1e-5
    assert env.chosen.steps != plain.steps


@pytest.mark.slow
def test_a_given_method_is_kept() -> None:
    env = batch(tolerance=1e-6, integrator="verlet").unwrapped
    assert env.chosen.plan.method.name == env.episodes.simulator.integrator.name == "verlet"


@pytest.mark.parametrize(
    ("tolerance", "options", "error", "says"),
    [
        (0.0, {}, ValueError, "tolerance"),
        (-1e-6, {}, ValueError, "tolerance"),
        (float("nan"), {}, ValueError, "tolerance"),
        (True, {}, TypeError, "tolerance"),
        ("1e-6", {}, TypeError, "tolerance"),
        pytest.param(1e-14, {}, ValueError, "the smallest possible one is", marks=pytest.mark.slow),
        (1e-5, {"step": 5e-4}, ValueError, "step and tolerance"),
        (1e-5, {"integrator": "dopri5"}, ValueError, "'dopri5', which chooses its own steps"),
    ],
)
def test_what_makes_no_sense_is_refused(
    tolerance: Any, options: dict[str, Any], error: type[Exception], says: str
) -> None:
    with pytest.raises(error, match=says):
        gym.make("SpringTop-v0", tolerance=tolerance, **options)
