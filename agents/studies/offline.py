"""Train an agent from Minari data sets alone. It plays nothing while it learns.

    python agents/studies/offline.py SpringTop-v0 --data springgym/SpringTop/random-v0
    python agents/studies/offline.py SpringTop-v0 --data springgym/SpringTop/random-v0 \\
        springgym/SpringTop/published-v0 --seed 1 --steps 20_000 --rows runs/offline.json

``agents/studies/dataset.py`` records such data sets. The agent observes what their agents observed. It learns
by implicit Q-learning (Kostrikov et al. 2021, arXiv:2110.06169) with the losses of TorchRL and the
hyperparameters of configs/iql.yaml. The run folder holds config.yaml and agent.npz, which
``springgym evaluate`` and ``springgym watch`` accept. At the end, the agent plays the 100 held-out episodes
of the benchmark. ``--rows`` adds the row of this run to a file.
"""

from __future__ import annotations

import json
import sys
import time
from collections.abc import Sequence
from hashlib import sha256
from importlib.util import find_spec
from itertools import pairwise
from pathlib import Path
from typing import Any, NamedTuple

import _path  # noqa: F401  (first)
import numpy as np
import torch
from agent import ACTIVATIONS
from config import MENDABLE, ConfigError, IQLConfig, add_overrides, command_line, load_config, new_file, whole
from evaluate import evaluate, table, task_kwargs
from gymnasium import spaces
from results import EPISODES, Cell, add_row, folder_name, read_rows, row_of
from runs import HELD_OUT_SEED, SELECTION_SEED, Run, create_run, locked, time_limit, versions
from torch import nn
from tqdm import trange

import springgym  # noqa: F401  (registers the environments)
from springgym.cli import guarded, whole_file
from springgym.core.extras import missing
from springgym.envs.agent import LAYERS, STATISTICS
from springgym.envs.registration import spec_of

LOG_STD = (-5.0, 2.0)
"""Bounds of the logarithm of the policy's standard deviation, as in the paper."""
LIMITS = (1e-6, 10.0)
"""Constant that is added to the variance of observations, and bound of normalised observations."""


class Data(NamedTuple):
    """The transitions of data sets of one environment (n of them)."""

    observations: np.ndarray
    actions: np.ndarray
    """in (−1, 1), which is where the lowest and the highest of the environment lie"""
    rewards: np.ndarray
    following: np.ndarray
    """observations after the actions"""
    terminated: np.ndarray
    env_kwargs: dict[str, Any]
    sources: list[dict[str, Any]]
    """what a row says of each data set"""


def read_data(names: Sequence[str], env_id: str) -> Data:
    """Read data sets of an environment.

    Raises
    ------
    ConfigError
        If one is absent, or belongs to another task, or if they differ in what agents observe and do.
    """
    import minari

    there = minari.list_local_datasets()
    if len(set(names)) < len(names):
        raise ConfigError("--data names a data set twice")
    columns: list[list[np.ndarray]] = [[], [], [], [], []]
    sources = []
    kwargs = None
    for name in names:
        if name not in there:
            known = ", ".join(there) or "none"
            raise ConfigError(f"{name}: there is no such data set; Minari's folder has {known}")
        data = minari.load_dataset(name)
        spec = data.env_spec
        seen = data.observation_space
        done = data.action_space
        if spec is None or spec.id != env_id.rpartition(":")[2]:
            raise ConfigError(f"{name}: its episodes are of {spec and spec.id}, not of {env_id}")
        if kwargs not in (None, spec.kwargs):
            raise ConfigError(f"{name}: its environment has {spec.kwargs}, that of {names[0]} {kwargs}")
        kwargs = dict(spec.kwargs)
        if not isinstance(seen, spaces.Box) or not isinstance(done, spaces.Box) or len(seen.shape) != 1:
            raise ConfigError(f"{name}: IQL maps numbers to numbers, not {seen} to {done}")
        indices = data.episode_indices
        seeds = [own.get("seed") for own in data.storage.get_episode_metadata(indices)]
        if any(seed is not None and HELD_OUT_SEED <= seed < SELECTION_SEED for seed in seeds):
            raise ConfigError(
                f"{name}: seeds {HELD_OUT_SEED} to {SELECTION_SEED - 1} belong to the evaluation; "
                "record other episodes"
            )
        letters = sha256()
        returns = []
        for episode in data.iterate_episodes():
            actions = 2 * (episode.actions - done.low) / (done.high - done.low) - 1
            found = (
                episode.observations[:-1],
                actions.reshape(len(actions), -1),
                episode.rewards,
                episode.observations[1:],
                episode.terminations,
            )
            for column, values in zip(columns, found, strict=True):
                column.append(np.asarray(values, np.float32))
                letters.update(column[-1].tobytes())
            returns.append(float(np.sum(episode.rewards)) / time_limit(spec))
        sources.append(
            {
                "id": name,
                "agent": str(data.storage.metadata.get("algorithm_name", "")),
                "episodes": len(returns),
                "transitions": sum(len(rewards) for rewards in columns[2][-len(returns) :]),
                "mean_return": round(float(np.mean(returns)), 6),
                "digest": letters.hexdigest()[:8],
            }
        )
    assert kwargs is not None
    seen, acted, rewards, following, terminated = map(np.concatenate, columns)
    return Data(seen, acted, rewards, following, terminated, kwargs, sources)


def layers(inputs: int, outputs: int, config: IQLConfig) -> nn.Sequential:
    """Return fully connected layers with activations between them."""
    sizes = [inputs, *config.net_arch, outputs]
    found = []
    for before, after in pairwise(sizes):
        found += [nn.Linear(before, after), ACTIVATIONS[config.activation]()]
    return nn.Sequential(*found[:-1])


class Actor(nn.Module):
    """A policy that draws actions from a normal distribution; the saved agent takes its mean, in (−1, 1)."""

    def __init__(self, inputs: int, outputs: int, config: IQLConfig) -> None:
        super().__init__()
        self.layers = layers(inputs, outputs, config)
        self.log_std = nn.Parameter(torch.zeros(outputs))

    def forward(self, observations: torch.Tensor) -> tuple[torch.Tensor, torch.Tensor]:
        mean = torch.tanh(self.layers(observations))
        return mean, self.log_std.clamp(*LOG_STD).exp().expand_as(mean)


class Critic(nn.Module):
    """A network that estimates the value of an action in a state."""

    def __init__(self, inputs: int, config: IQLConfig) -> None:
        super().__init__()
        self.layers = layers(inputs, 1, config)

    def forward(self, observations: torch.Tensor, actions: torch.Tensor) -> torch.Tensor:
        value: torch.Tensor = self.layers(torch.cat([observations, actions], -1))
        return value


def fit(data: Data, config: IQLConfig, seed: int) -> dict[str, np.ndarray]:
    """Train an agent on data, and return its arrays in the format of `springgym.envs.agent`."""
    from tensordict import TensorDict
    from tensordict.nn import TensorDictModule
    from torchrl.modules import IndependentNormal, ProbabilisticActor, ValueOperator
    from torchrl.objectives import IQLLoss, SoftUpdate

    torch.manual_seed(seed)
    arrays: dict[str, np.ndarray] = {}
    seen = data.observations
    following = data.following
    if config.normalize:
        mean = seen.mean(axis=0, dtype=float)
        variance = seen.var(axis=0, dtype=float)
        arrays = dict(zip(STATISTICS, (mean, variance, np.array(LIMITS)), strict=True))
        scale = np.sqrt(variance + LIMITS[0])
        largest = LIMITS[1]
        seen, following = (np.clip((own - mean) / scale, -largest, largest) for own in (seen, following))
    count = len(seen)
    inputs = seen.shape[1]
    outputs = data.actions.shape[1]
    ended = torch.as_tensor(data.terminated[:, None] > 0)
    after = {
        "observation": torch.as_tensor(following, dtype=torch.float32),
        "reward": torch.as_tensor(data.rewards[:, None]),
        "terminated": ended,
        "done": ended,
    }
    transitions = TensorDict(
        {
            "observation": torch.as_tensor(seen, dtype=torch.float32),
            "action": torch.as_tensor(data.actions),
            "next": after,
        },
        [count],
    )
    actor = Actor(inputs, outputs, config)
    value = ValueOperator(layers(inputs, 1, config), in_keys=["observation"])
    critic = ValueOperator(Critic(inputs + outputs, config), in_keys=["observation", "action"])
    normal = ["loc", "scale"]
    policy = ProbabilisticActor(
        TensorDictModule(actor, in_keys=["observation"], out_keys=normal),
        in_keys=normal,
        distribution_class=IndependentNormal,
    )
    chosen: dict[str, Any] = {"temperature": config.temperature, "expectile": config.expectile}
    loss = IQLLoss(policy, critic, value, loss_function="l2", **chosen)
    loss.make_value_estimator(gamma=config.gamma)
    target = SoftUpdate(loss, tau=config.tau)
    acting = list(loss.actor_network_params.flatten_keys().values())
    judging = [
        parameter
        for network in (loss.qvalue_network_params, loss.value_network_params)
        for parameter in network.flatten_keys().values()
    ]
    groups = [{"params": acting}, {"params": judging}]
    optimizer = torch.optim.Adam(groups, config.learning_rate, fused=True)
    # as in the paper, the rate of the actor falls to 0 as half a cosine, and that of the critics is constant
    updates = config.total_timesteps
    falls = torch.optim.lr_scheduler.LambdaLR(
        optimizer, [lambda n: 0.5 * (1 + np.cos(np.pi * n / updates)), lambda n: 1.0]
    )
    for _ in trange(updates, unit="update", mininterval=1.0):
        batch = transitions[torch.randint(count, (config.batch_size,))]
        losses = loss(batch)
        optimizer.zero_grad()
        (losses["loss_actor"] + losses["loss_qvalue"] + losses["loss_value"]).backward()
        optimizer.step()
        falls.step()
        target.step()
    hidden, last = LAYERS["iql"]
    learned = loss.actor_network_params.flatten_keys(".")
    for n in range(len(config.net_arch) + 1):
        name = f"{hidden}.{2 * n}" if n < len(config.net_arch) else last
        for of in ("weight", "bias"):
            arrays[f"{name}.{of}"] = learned[f"module.0.module.layers.{2 * n}.{of}"].detach().numpy()
    return arrays


def train(run: Run, data: Data) -> dict[str, Any]:
    """Train the agent of a run on data, write it into the run's folder, and return the row of the run."""
    config = run.config
    assert isinstance(config, IQLConfig)
    torch.set_num_threads(1)
    began = time.process_time()
    arrays = fit(data, config, run.seed)
    seconds = round(time.process_time() - began, 2)
    with whole_file(run.agent) as temporary:
        np.savez(temporary, **arrays)  # type: ignore[arg-type]
    found = evaluate(str(run.folder), run.env_id, task_kwargs(config), EPISODES)
    print(f"{run.env_id}: {EPISODES} held-out episodes\n{table([found], run.env_id)}")
    steps = config.total_timesteps
    success = found.success_rate
    # to judge the agent on the way would take episodes, so its curve has one point
    points = [[steps, seconds, round(found.return_per_step, 4), success and round(success, 4)]]
    cell = Cell(run.env_id, run.algo, run.seed)
    row = row_of(cell, config, steps, seconds, points, found)
    installed: Any = versions()["packages"]
    row["packages"] |= {name: installed[name] for name in ("torchrl", "minari")}
    return row | {"data": data.sources}


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command line."""
    parser = command_line(__doc__)
    parser.add_argument("env_id", help="environment id")
    parser.add_argument("--data", nargs="+", required=True, metavar="NAME", help="names of Minari data sets")
    parser.add_argument("--seed", type=whole(0, HELD_OUT_SEED - 1), default=0, help="seed (default: 0)")
    parser.add_argument("--steps", type=whole(1, 10**12), help="updates: same as --set total_timesteps=...")
    parser.add_argument("--config", type=Path, help="file of hyperparameters (default: configs/iql.yaml)")
    add_overrides(parser, "change hyperparameters")
    parser.add_argument("--out", type=Path, help="run folder (default: in runs/offline, named after the run)")
    parser.add_argument("--rows", type=new_file(), help="file to which the row of this run is added")
    options = parser.parse_args(arguments)

    def run() -> int:
        spec_of(options.env_id)
        for package, name in (("minari", "Minari"), ("torchrl", "TorchRL")):
            if find_spec(package) is None:
                raise ConfigError(missing("offline.py", name, "offline"))
        if options.rows:
            read_rows(options.rows)  # what is wrong with it is told before anything is learned
        data = read_data(options.data, options.env_id)
        given = [f"data={json.dumps(options.data)}", f"env_kwargs={json.dumps(data.env_kwargs)}"]
        given += options.overrides
        if options.steps is not None:
            given.append(f"total_timesteps={options.steps}")
        config = load_config("iql", options.env_id, given, options.config)
        assert isinstance(config, IQLConfig)
        if (config.data, config.env_kwargs) != (options.data, data.env_kwargs):
            raise ConfigError("--set: data and env_kwargs are those of --data, and cannot be changed")
        folder = options.out or Path("runs/offline") / folder_name(
            options.env_id, "iql", options.data, options.seed
        )
        if (folder / "config.yaml").exists():
            raise ConfigError(f"{folder} holds a run already: name another folder with --out")
        one = Run(folder, "iql", options.env_id, options.seed, config)
        folder.mkdir(parents=True, exist_ok=True)
        with locked(folder):
            row = train(create_run(one), data)
        if options.rows:
            add_row(options.rows, row)
        return 0

    return guarded("offline.py", run, MENDABLE)


if __name__ == "__main__":
    sys.exit(main())
