"""PPO that begins by imitating classical control."""

import numpy as np
import pytest
import runs
import train
from controllers import make_controller

from springgym.envs.sb3 import make_sb3

TASK = "SpringTop-v0"
FEATURES = "env_kwargs.observation=features"


def trained(folder, *overrides, seed=0):
    """The deterministic policy of a short run that imitates for 16,384 steps."""
    arguments = [TASK, "--seed", str(seed), "--out", str(folder), "--episodes", "0", "--set", FEATURES]
    arguments += ["bc_steps=16_384", "total_timesteps=20_480", *overrides]
    assert train.main(arguments) == 0
    run = runs.open_run(folder)
    env = make_sb3(TASK, 1, 7, **run.config.env_kwargs)
    acts = runs.policy_in(run.agent, run.config, env.observation_space, env.action_space)
    teacher = make_controller("classical", TASK, run.config.env_kwargs, env.action_space)
    observations = np.concatenate([env.reset() for _ in range(20)])
    env.close()
    return acts(observations), teacher(observations), run


@pytest.mark.parametrize("normalize", ["false", "true"])
@pytest.mark.slow
def test_it_does_what_classical_control_does(tmp_path, normalize):
    """Nearly, after one iteration of its own; an agent that imitated nothing does something else."""
    did, wanted, run = trained(tmp_path / "run", f"normalize={normalize}", "learning_rate=1e-5")
    rows = (run.folder / "metrics.csv").read_text().splitlines()
    assert rows[-1].startswith("20480,")  # what was imitated counts
    plain, _, _ = trained(tmp_path / "plain", f"normalize={normalize}", "bc_steps=0")
    assert np.abs(did - wanted).mean() < 0.5 * np.abs(plain - wanted).mean()


@pytest.mark.slow
def test_same_seed_same_agent(tmp_path):
    brief = ("bc_steps=2_048", "total_timesteps=6_144")
    one, other, third = (
        trained(tmp_path / name, *brief, seed=seed)[0] for name, seed in zip("abc", (1, 1, 2), strict=True)
    )
    assert one.tobytes() == other.tobytes()
    assert np.abs(one - third).max() > 1e-4
