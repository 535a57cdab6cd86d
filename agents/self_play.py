"""Self-play in SpringDuel: PPO learns against its earlier versions, and an Elo table rates them.

    python agents/self_play.py runs/duel                      # train, and rate the players
    python agents/self_play.py runs/duel --timesteps 5_000_000
    python agents/self_play.py runs/duel --rate               # only rate

PPO plays the first top, a league the second one: its newest agent in half of the environments, its earlier
agents and the scripts in turn in the others. Every --every steps, the agent joins the league, in RUN/league.
The same command continues a stopped training from the last agent of the league. This unpickles
RUN/model.zip, so do it with your own runs only.

Then up to ten of these agents, spread over the training, and all scripts play each other with
`springgym.envs.parallel`, PettingZoo's environment of two agents, with the same number of duels on either
side. Ratings are the maximum-likelihood ones of Elo's model: 400 points for odds of ten to one, and a duel
without a winner counts as half won. "script" has 1000. RUN/elo.csv holds the ratings, with standard errors by
a bootstrap over duels.
"""

from __future__ import annotations

import argparse
import csv
import itertools
import sys
from collections.abc import Callable, Mapping, Sequence
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
import torch
from agent import ALGORITHMS, save_agent
from config import MENDABLE, PPOConfig, command_line, load_config, whole
from learner import new_model
from runs import HELD_OUT_SEED, Run, create_run, locked, open_run, policy_in
from stable_baselines3.common.callbacks import BaseCallback
from tqdm import tqdm

from springgym.cli import INTERRUPTED, guarded, whole_file
from springgym.envs import parallel
from springgym.envs.sb3 import make_sb3
from springgym.envs.tasks.duel import OPPONENTS

if TYPE_CHECKING:
    from springgym.envs.players import ParallelDuel, ParallelOptions

ID = "SpringDuel-v0"
SEEN: ParallelOptions = {"observation": "features"}
"""Opponents get the features of the duel."""
MOST_RATED = 10
ANCHOR = ("script", 1000.0)
POINTS = 400.0 / np.log(10.0)
RESAMPLES = 200

Player = Callable[[np.ndarray], np.ndarray]
"""A function from observations (n, D) to actions (n, 2)."""


class League:
    """The opponents of all copies: the newest agent for half of them, all players in turn for the others."""

    def __init__(self) -> None:
        self.players: list[Player] = list(OPPONENTS.values())

    def __call__(self, observations: np.ndarray) -> np.ndarray:
        """Return the actions of each copy's opponent."""
        actions = np.zeros((len(observations), 2))
        copies = np.arange(len(observations))
        count = len(self.players)
        played = np.where(2 * copies < len(copies), count - 1, copies % count)
        for n in np.unique(played):
            actions[played == n] = self.players[n](observations[played == n])
        return actions


class Keeper(BaseCallback):
    """Keeps the agent every so many steps, and has it join the league; moves the progress bar."""

    def __init__(self, run: Run, league: League, every: int, bar: tqdm) -> None:
        super().__init__()
        self.run = run
        self.league = league
        self.every = every
        self.bar = bar
        self.kept = 0

    def _on_training_start(self) -> None:
        self.kept = self.num_timesteps

    def _on_step(self) -> bool:
        self.bar.update(len(self.locals["dones"]))
        return True

    def _on_rollout_start(self) -> None:
        if self.num_timesteps - self.kept >= self.every:
            self.keep()

    def _on_training_end(self) -> None:
        if self.num_timesteps > self.kept:
            self.keep()

    def keep(self) -> None:
        """Write the agent down, and let it join."""
        save_agent(self.run.agent, self.model)
        path = self.run.folder / "league" / f"{self.num_timesteps:09d}.npz"
        path.parent.mkdir(exist_ok=True)
        with whole_file(self.run.model) as temporary:
            self.model.save(temporary)
        save_agent(path, self.model)
        self.league.players.append(player(self.run, path))
        self.kept = self.num_timesteps
        if self.model.ep_success_buffer:
            self.bar.set_postfix(won=f"{100 * np.mean(self.model.ep_success_buffer):.0f} %", refresh=False)


@cache
def spaces() -> tuple[Any, Any]:
    """Return the spaces of what a player observes and does."""
    env = parallel(ID, **SEEN)
    env.close()
    return env.observation_space("first"), env.action_space("first")


def player(run: Run, path: Path) -> Player:
    """Load an agent that was kept."""
    return policy_in(path, run.config, *spaces())


FROM_NOTHING = ("bc_steps=0", "log_std_init=-0.5", "learning_rate=1e-3", "normalize=false")
"""Differences from ``configs/ppo.yaml``: agents do not imitate a controller, and explore more. Observations
are not normalised, because training could not continue without the scales, which are not in the model."""


def members(run: Run) -> dict[str, Path]:
    """Return the agents that were kept, by the steps that they had learned for."""
    return {f"{int(path.stem):,} steps": path for path in sorted((run.folder / "league").glob("*.npz"))}


def learn(run: Run, every: int) -> None:
    """Train, from the last agent that was kept if there is one."""
    assert isinstance(run.config, PPOConfig)
    league = League()
    league.players += [player(run, path) for path in members(run).values()]
    env = make_sb3(ID, run.config.n_envs, run.seed, stagger=True, opponent=league, **SEEN)
    torch.manual_seed(run.seed)
    if run.model.exists():
        model = ALGORITHMS["ppo"].load(run.model, env=env, device="cpu")
    else:
        model = new_model(run, env)
    steps = run.config.total_timesteps - model.num_timesteps
    if steps > 0:
        total = run.config.total_timesteps
        done = model.num_timesteps
        with tqdm(total=total, initial=done, unit="step", unit_scale=True, desc=ID) as bar:
            model.learn(steps, callback=Keeper(run, league, every, bar), reset_num_timesteps=False)
    env.close()


# ---------------------------------------------------------------- ratings


class Duels(NamedTuple):
    """The score of two players against each other: a point a duel won, half of one without a winner."""

    first: int
    second: int
    points: np.ndarray
    """of the first, in each duel"""


def tournament(players: Sequence[Player], duels: int) -> list[Duels]:
    """Play each against every other one, ``duels`` on either side, all pairs from the same seeds."""
    env = parallel(ID, **SEEN)
    pairs = list(itertools.combinations(range(len(players)), 2))
    played = []
    for i, j in tqdm(pairs, unit="pair", desc="duels", leave=False, disable=not sys.stderr.isatty()):
        points = []
        for seed in range(HELD_OUT_SEED, HELD_OUT_SEED + duels):
            points.append(duel(env, players[i], players[j], seed))
            points.append(1.0 - duel(env, players[j], players[i], seed))
        played.append(Duels(i, j, np.array(points)))
    env.close()
    return played


def duel(env: ParallelDuel, first: Player, second: Player, seed: int) -> float:
    """Return the points of the first player."""
    seen, _ = env.reset(seed=seed)
    infos: dict[str, Any] = {}
    while env.agents:
        actions = {name: who(seen[name][None])[0] for name, who in (("first", first), ("second", second))}
        seen, _, _, _, infos = env.step(actions)
    won = infos["first"]["is_success"]
    lost = infos["second"]["is_success"]
    return 1.0 if won and not lost else 0.0 if lost and not won else 0.5


def ratings(played: Sequence[Duels], count: int, points: Sequence[np.ndarray] | None = None) -> np.ndarray:
    """Return Elo's ratings (count,), the likeliest ones; each pair counts as having drawn once more.

    The likeliest are found as Hunter (2004), MM algorithms for generalized Bradley-Terry models, has it.
    """
    won = np.zeros((count, count))
    met = np.zeros((count, count))
    for n, (i, j, own) in enumerate(played):
        got = own if points is None else points[n]
        won[i, j] += got.sum() + 0.5
        won[j, i] += (1.0 - got).sum() + 0.5
        met[i, j] = met[j, i] = len(got) + 1
    strength = np.ones(count)
    for _ in range(2000):
        strength = won.sum(axis=1) / (met / (strength[:, None] + strength)).sum(axis=1)
        strength /= np.exp(np.log(strength).mean())
    return np.asarray(POINTS * np.log(strength))


def rate(run: Run, duels: int) -> list[dict[str, str]]:
    """Return the rows of elo.csv, the best first."""
    kept = members(run)
    chosen = {round(n) for n in np.linspace(0, len(kept) - 1, min(MOST_RATED, len(kept)))}
    players: Mapping[str, Player] = {
        **OPPONENTS,
        **{name: player(run, path) for n, (name, path) in enumerate(kept.items()) if n in chosen},
    }
    names = list(players)
    played = tournament(list(players.values()), duels)
    anchor = names.index(ANCHOR[0])
    rng = np.random.default_rng(0)

    def anchored(found: np.ndarray) -> np.ndarray:
        return found - found[anchor] + ANCHOR[1]

    rating = anchored(ratings(played, len(names)))
    again = [
        anchored(ratings(played, len(names), [rng.choice(one.points, len(one.points)) for one in played]))
        for _ in range(RESAMPLES)
    ]
    error = np.std(again, axis=0)
    strong = names.index("strong")
    rows = []
    for n in np.argsort(-rating):
        against = [one for one in played if {one.first, one.second} == {n, strong}]
        share = [np.mean(one.points if one.first == n else 1.0 - one.points) for one in against]
        rows.append(
            {
                "player": names[n],
                "rating": f"{rating[n]:.0f}",
                "error": f"{error[n]:.0f}",
                "against_strong": f"{100 * share[0]:.0f} %" if share else "",
            }
        )
    return rows


def main(given: Sequence[str] | None = None) -> int:
    """Run the command line."""
    parser = command_line(__doc__)
    parser.add_argument("run", type=Path, help="run folder")
    parser.add_argument(
        "--seed", type=whole(0, HELD_OUT_SEED - 1), default=0, help="seed of a new run (default: 0)"
    )
    parser.add_argument(
        "--timesteps",
        type=whole(1, 10**12),
        default=3_000_000,
        help="steps of a new run (default: 3 million)",
    )
    parser.add_argument(
        "--every",
        type=whole(1, 10**9),
        default=200_000,
        help="steps between agents that join the league (default: 200,000)",
    )
    parser.add_argument(
        "--duels", type=whole(1, 10_000), default=25, help="duels of each pair on either side (default: 25)"
    )
    parser.add_argument("--rate", action="store_true", help="only rate the players, without training")
    options = parser.parse_args(given)
    torch.set_num_threads(1)
    return guarded("self_play.py", lambda: play(options), MENDABLE)


def play(options: argparse.Namespace) -> int:
    """Train and rate."""
    if (options.run / "config.yaml").exists() or options.rate:
        run = open_run(options.run)
    else:
        overrides = [*FROM_NOTHING, f"total_timesteps={options.timesteps}"]
        run = create_run(Run(options.run, "ppo", ID, options.seed, load_config("ppo", ID, overrides)))
    with locked(run.folder):
        if not options.rate:
            try:
                learn(run, options.every)
            except KeyboardInterrupt:
                print(f"\nthe same command continues: {run.folder}", file=sys.stderr)
                return INTERRUPTED
        rows = rate(run, options.duels)
        with whole_file(run.folder / "elo.csv") as path, path.open("w", newline="", encoding="utf-8") as file:
            writer = csv.DictWriter(file, list(rows[0]), lineterminator="\n")
            writer.writeheader()
            writer.writerows(rows)
    print(f"{'player':<18} {'rating':>14} {'against strong':>15}")
    for row in rows:
        told = f"{row['rating']} ± {row['error']}"
        print(f"{row['player']:<18} {told:>14} {row['against_strong']:>15}")
    return 0


if __name__ == "__main__":
    sys.exit(main())
