"""Train and evaluate every task with every algorithm from several seeds, unattended.

    python agents/benchmark.py                                    # all, on all cores of this machine
    python agents/benchmark.py --tasks SpringTop-v0 --algorithms ppo linear --seeds 5
    python agents/benchmark.py --local --jobs 1                   # without Ray
    python agents/benchmark.py --address auto                     # on the Ray cluster that runs here

Each run equals one of ``agents/train.py`` with the same arguments, on one core and one thread. It has a
folder under ``--runs``, with its output in ``log.txt``. At the end, its agent plays 100 held-out episodes,
and a row is added to ``--json``. If the benchmark was stopped, start the same command again. Runs that have
a row are skipped, and other runs continue from their newest checkpoint. A run is repeated if its
configuration or its task has changed since its row was written. docs/benchmark.md holds the protocol and
describes the rows; rows of others are checked by

    python agents/benchmark.py --check rows.json --agents FOLDER

The same works on a cluster, if all its nodes see this checkout under this path. If they also see the run
folders, another node continues the runs of a node that fails. Otherwise these runs start again.
"""

from __future__ import annotations

import argparse
import dataclasses
import json
import multiprocessing
import os
import sys
import threading
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, redirect_stderr, redirect_stdout
from dataclasses import Field, asdict, dataclass, fields
from functools import partial
from hashlib import sha256
from importlib.util import find_spec
from multiprocessing.connection import Connection, wait
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

from config import CONFIG_FOLDER, MENDABLE, ONLINE, Config, ConfigError, load_config, whole
from controllers import UNTRAINED, controller_env_kwargs, controllers_of, make_controller
from rows import PROTOCOL, curve, folder_name, used
from runs import locked, open_run, versions, write_atomically, write_rows
from tqdm import tqdm

from springgym.cli import INTERRUPTED, guarded
from springgym.extras import install
from springgym.registration import ENVIRONMENTS, VARIANTS
from springgym.strict_yaml import read_yaml

if TYPE_CHECKING:
    from evaluate import Evaluation

ROOT = Path(__file__).resolve().parent.parent
ALGORITHMS = (*UNTRAINED, *ONLINE)
EPISODES = 100
THREADS = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS")
TRIES = 5
"""Number of node failures that a run survives."""


class Cell(NamedTuple):
    """One run of the benchmark."""

    task: str
    algorithm: str
    seed: int

    def __str__(self) -> str:
        return f"{self.task} {self.algorithm} {self.seed}"


@dataclass(frozen=True)
class Plan:
    """The plan by which every cell is run."""

    runs: Path
    episodes: int
    overrides: tuple[str, ...]
    configs: Path | None
    """a folder other than ``configs``"""

    def folder(self, cell: Cell) -> Path:
        return self.runs / folder_name(cell.task, cell.algorithm, (), cell.seed)

    def config(self, algorithm: str) -> Path | None:
        return self.configs / f"{algorithm}.yaml" if self.configs else None


# --- One cell, in a process of its own -----------------------------------------------------------------


def measured(cell: Cell, plan: Plan) -> dict[str, Any]:
    """Run a cell, from where it stands, and return its row."""
    import torch
    import train
    from evaluate import evaluate, find_task
    from recorder import Recorder

    torch.set_num_threads(1)
    Recorder.clock = staticmethod(time.process_time)
    folder = plan.folder(cell)
    folder.mkdir(parents=True, exist_ok=True)
    with open(folder / "log.txt", "a", encoding="utf-8") as log, redirect_stdout(log), redirect_stderr(log):
        steps, seconds = 0, 0.0
        if cell.algorithm in UNTRAINED:
            agent = cell.algorithm
            env_id, kwargs = find_task([], cell.task, [])
        else:
            agent = str(folder)
            if train.main(training(cell, plan)):
                told = (folder / "log.txt").read_text(encoding="utf-8").splitlines()
                raise ConfigError(told[-1] if told else f"{folder}: it wrote no error message")
            steps, seconds = last_row(folder)
            env_id, kwargs = find_task([agent], cell.task, [])
        found = evaluate(agent, env_id, kwargs, plan.episodes)
    config = asked(cell, plan)
    points = [] if config is None else curve(folder)
    row = row_of(cell, config, digest(cell, plan), steps, seconds, points, found)
    if config is not None and (begun := begun_at(folder)) != row["commit"]:
        row["commit"] = f"{begun}, {row['commit']}"  # which --check refuses
    return row


def row_of(
    cell: Cell,
    config: Config | None,
    letters: str,
    steps: int,
    seconds: float,
    points: list[list[float | None]],
    found: Evaluation,
) -> dict[str, Any]:
    """Return the row of a run: what it asked for, the digest of that, what it spent, and what it reached."""
    returns = [round(earned, 5) for earned in found.returns_per_step]
    return {
        "protocol": PROTOCOL,
        **cell._asdict(),
        "used": used(cell.algorithm, config),
        "steps": steps,
        "seconds": seconds,
        "success_rate": found.success_rate,
        "mean_return": round(sum(returns) / len(returns), 6),
        "first_seed": found.first_seed,
        "episodes": len(returns),
        "returns": returns,
        "successes": None if found.successes is None else [int(one) for one in found.successes],
        "curve": points,
        "configuration": {} if config is None else asdict(config),
        "config": letters,
        "probe": probe(cell.task),
        **made_with(),
    }


def begun_at(folder: Path) -> str | None:
    """Return the commit at which a run began; None if it is not known."""
    try:
        found: str | None = json.loads((folder / "versions.json").read_text(encoding="utf-8"))["git_revision"]
        return found
    except (OSError, ValueError, KeyError):
        return None


def training(cell: Cell, plan: Plan) -> list[str]:
    """Return the arguments of ``agents/train.py`` that begin or continue a run."""
    folder = plan.folder(cell)
    if (folder / "config.yaml").exists():
        if asked(cell, plan) == open_run(folder).config and trained_for(folder) == probe(cell.task):
            return ["--resume", str(folder), "--episodes", "0"]
        put_away(folder)
    write_atomically(folder / "probe.txt", f"{probe(cell.task)}\n")
    arguments = [cell.task, "--algo", cell.algorithm, "--seed", str(cell.seed), "--run", str(folder)]
    if config := plan.config(cell.algorithm):
        arguments += ["--config", str(config)]
    return [*arguments, "--episodes", "0", *(["--set", *plan.overrides] if plan.overrides else [])]


def trained_for(folder: Path) -> float:
    """Return the result of `probe` for the task at the beginning of a run."""
    try:
        return float((folder / "probe.txt").read_text(encoding="utf-8"))
    except (OSError, ValueError):
        return float("nan")


def put_away(folder: Path) -> None:
    """Keep a run of another configuration beside the new one."""
    n = 1
    while (old := folder.with_name(f"{folder.name}.old-{n}")).exists():
        n += 1
    with locked(folder):
        folder.rename(old)
    folder.mkdir()


def last_row(folder: Path) -> tuple[int, float]:
    """Return the progress of a run: steps, and seconds of processor time."""
    try:
        lines = (folder / "metrics.csv").read_text(encoding="utf-8").splitlines()
        cells = dict(zip(lines[0].split(","), lines[-1].split(","), strict=True))
        return int(cells["timesteps"]), float(cells["seconds"])
    except (OSError, ValueError, KeyError, IndexError):  # none yet, or one half written
        return 0, 0.0


def asked(cell: Cell, plan: Plan) -> Config | None:
    """Return the configuration of a cell; None for controllers that are not trained."""
    if cell.algorithm in UNTRAINED:
        return None
    algorithm: Any = cell.algorithm
    return load_config(algorithm, cell.task, plan.overrides, plan.config(algorithm))


def digest(cell: Cell, plan: Plan) -> str:
    """Return letters that change with the configuration of a cell, see `digest_of`.

    Of classical control, a number that changes with what it does.
    """
    if cell.algorithm == "classical":
        return f"{answers(cell.task):.5f}"
    return digest_of(asked(cell, plan))


def digest_of(config: Config | None) -> str:
    """Return letters that change with fields of a configuration that have not their default, in any order."""
    known = () if config is None else fields(config)
    told = {own.name: value for own in known if (value := getattr(config, own.name)) != usual(own)}
    return sha256(repr(dict(sorted(told.items()))).encode()).hexdigest()[:8]


def usual(field: Field[Any]) -> object:
    """Return the value of a field that is not given; `dataclasses.MISSING` if it has to be.

    Ray copies what this module holds, and a copy of that constant is another object.
    """
    return field.default if field.default_factory is dataclasses.MISSING else field.default_factory()


def wandering(task: str, **kwargs: Any) -> Iterator[tuple[Any, Any, Any]]:
    """Return an environment of a task, what its copies observe at given actions, and what they then earn.

    Rounding does not grow in so few control periods.
    """
    import numpy as np

    from springgym.envs.sb3 import make_sb3

    copies = 8
    env: Any = make_sb3(task, copies, **kwargs)
    env.seed(range(copies))
    rng = np.random.default_rng(0)
    try:
        seen = env.reset()
        space: Any = env.action_space
        for _ in range(20):
            actions = rng.uniform(space.low, space.high, (copies, *space.shape))
            before = seen
            seen, rewards, _, _ = env.step(actions.astype(np.float32))
            yield env, before, rewards
    finally:
        env.close()


def probe(task: str) -> float:
    """Return a number that changes with the task: the mean reward of given actions from given starts."""
    rewards = [reward.mean(dtype=float) for _, _, reward in wandering(task)]
    return float(round(sum(rewards) / len(rewards), 7))


def answers(task: str) -> float:
    """Return a number that changes with classical control: a weighted sum of its actions."""
    import numpy as np

    total, count = 0.0, 0
    for env, seen, _ in wandering(task, **controller_env_kwargs("classical", task, {})):
        actions = make_controller("classical", task, {}, env.action_space)(seen).ravel()
        total += float(np.cos(count + np.arange(actions.size)) @ actions.astype(float))
        count += actions.size
    return total


def made_with() -> dict[str, Any]:
    """Describe with what a row was made."""
    found: Any = versions()
    return {
        "springgym": found["packages"]["springgym"],
        "commit": found["git_revision"],
        "python": found["python"].split()[0],
        "packages": {name: found["packages"][name] for name in ("numpy", "numba", "torch")},
        "cpu": found["cpu"],
    }


# --- All cells -----------------------------------------------------------------------------------------

Outcome = tuple[Cell, dict[str, Any] | str]
"""A cell, and its row or what went wrong."""


def in_processes(cells: Sequence[Cell], plan: Plan, jobs: int) -> Iterator[Outcome | None]:
    """Run cells on this machine, each in a process of its own; None whenever a second has passed."""
    spawn = multiprocessing.get_context("spawn")
    waiting = list(reversed(cells))
    running: dict[Connection, tuple[Cell, Any]] = {}
    try:
        while waiting or running:
            while waiting and len(running) < jobs:
                cell = waiting.pop()
                ours, theirs = spawn.Pipe(duplex=False)
                process = spawn.Process(target=tell, args=(theirs, cell, plan), daemon=True)
                with one_thread():
                    process.start()
                theirs.close()
                running[ours] = cell, process
            for pipe in wait(list(running), 1.0):
                assert isinstance(pipe, Connection)
                cell, process = running.pop(pipe)
                try:
                    result = pipe.recv()
                except EOFError:
                    process.join()
                    result = f"its process ended with status {process.exitcode}"
                yield cell, result
            yield None
    finally:
        for _, process in running.values():
            process.terminate()


def tell(pipe: Connection, cell: Cell, plan: Plan) -> None:
    """Run a cell and send what came of it."""
    end_with_parent()
    pipe.send(outcome(lambda: measured(cell, plan)))


def end_with_parent() -> None:
    """Do not go on when the benchmark is killed: the next one would find the folder locked."""
    parent = multiprocessing.parent_process()
    assert parent is not None

    def watch() -> None:
        wait([parent.sentinel])
        os._exit(1)

    threading.Thread(target=watch, daemon=True).start()


@contextmanager
def one_thread() -> Iterator[None]:
    """Let what is started in here compute on one thread."""
    before = {name: os.environ.get(name) for name in THREADS}
    os.environ |= dict.fromkeys(THREADS, "1")
    try:
        yield
    finally:
        for name, value in before.items():
            os.environ.pop(name) if value is None else os.environ.update({name: value})


def on_ray(cells: Sequence[Cell], plan: Plan, address: str | None, jobs: int) -> Iterator[Outcome | None]:
    """Run cells on a Ray cluster, or on one made of this machine's cores."""
    os.environ.setdefault("RAY_USAGE_STATS_ENABLED", "0")  # tells nobody
    import ray

    path = os.pathsep.join([str(ROOT / "agents"), str(ROOT), os.environ.get("PYTHONPATH", "")])
    environment = {"env_vars": dict.fromkeys(THREADS, "1") | {"PYTHONPATH": path}}
    cores: dict[str, Any] = {} if address else {"num_cpus": jobs, "include_dashboard": False}
    try:
        ray.init(
            address or "local", runtime_env=environment, log_to_driver=False, configure_logging=False, **cores
        )
    except (ConnectionError, ValueError) as error:
        raise ConfigError(f"--address {address}: {error}") from error

    def received(future: Any) -> dict[str, Any]:
        row: dict[str, Any] = ray.get(future)
        return row

    try:
        task = ray.remote(num_cpus=1, max_retries=TRIES, max_calls=1)(measured)
        running = {task.remote(cell, plan): cell for cell in cells}
        while running:
            done, _ = ray.wait(list(running), timeout=1.0)
            for future in done:
                yield running.pop(future), outcome(partial(received, future))
            yield None
    finally:
        ray.shutdown()


def outcome(result: Callable[[], dict[str, Any]]) -> dict[str, Any] | str:
    """Return a row, or a line that says what went wrong."""
    try:
        return result()
    except Exception as error:  # of one run of many: the others go on
        cause = getattr(error, "cause", None) or error
        return " ".join(f"{type(cause).__name__}: {cause}".split())[:300]


def planned(tasks: Sequence[str], algorithms: Sequence[str], seeds: int) -> list[Cell]:
    """Order the cells, one seed of all before the next, so that an unfinished run is a whole table."""
    return [
        Cell(task, algorithm, seed)
        for seed in range(seeds)
        for algorithm in algorithms
        for task in tasks
        if seed == 0 or algorithm not in UNTRAINED
        if algorithm != "classical" or controllers_of(task)
        if algorithm != "her" or task in read_yaml(CONFIG_FOLDER / "her.yaml").value
    ]


class Table:
    """The rows of ``--json``, which is rewritten whenever there is a new one."""

    def __init__(self, path: Path) -> None:
        self.path = path
        self.rows: dict[Cell, dict[str, Any]] = {}
        if not path.exists():
            return
        try:
            for row in json.loads(path.read_text(encoding="utf-8")):
                self.rows[Cell(row["task"], row["algorithm"], int(row["seed"]))] = row
        except (ValueError, KeyError, TypeError, OSError) as error:
            raise ConfigError(f"{path}: the file does not hold the rows of a benchmark: {error!r}") from error

    def current(self, cell: Cell, plan: Plan, probes: dict[str, float]) -> bool:
        """Return whether there is a row for the cell as it is now."""
        row = self.rows.get(cell)
        names = ("protocol", "config", "probe", "episodes")
        now = PROTOCOL, digest(cell, plan), probes[cell.task], plan.episodes
        return row is not None and tuple(map(row.get, names)) == now

    def add(self, row: dict[str, Any]) -> None:
        self.rows[Cell(row["task"], row["algorithm"], row["seed"])] = row
        write_rows(self.path, (self.rows[cell] for cell in sorted(self.rows)))


def add_hyperparameters(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments that say how agents are trained."""
    parser.add_argument("--configs", type=Path, help="folder of hyperparameters (default: configs)")
    parser.add_argument(
        "--set", dest="overrides", nargs="+", default=[], metavar="KEY=VALUE", help="change hyperparameters"
    )


def parsed(parser: argparse.ArgumentParser, arguments: Sequence[str] | None) -> argparse.Namespace:
    """Parse the arguments, with those that say where cells are run."""
    parser.add_argument(
        "--jobs", type=whole(1, 10_000), help="parallel runs on this machine (default: its cores)"
    )
    where = parser.add_mutually_exclusive_group()
    where.add_argument("--local", action="store_true", help="use this machine, without Ray")
    where.add_argument("--address", help="address of a Ray cluster; auto for the one on this machine")
    options = parser.parse_args(arguments)
    if getattr(options, "check", None):
        return options
    if options.address and options.jobs:
        parser.error("--jobs works on this machine only; a cluster runs as many jobs as it has cores")
    if not options.local and find_spec("ray") is None:
        parser.error(f"Ray is not installed: {install('ray')}, or give --local")
    return options


def run_cells(cells: Sequence[Cell], plan: Plan, options: argparse.Namespace) -> Iterator[Outcome | None]:
    """Run cells where the arguments say."""
    jobs = options.jobs or os.cpu_count() or 1
    if options.local:
        return in_processes(cells, plan, jobs)
    return on_ray(cells, plan, options.address, jobs)


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command line."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    tasks = [task.id for task in (*ENVIRONMENTS, *VARIANTS)]
    parser.add_argument(
        "--tasks", nargs="+", default=tasks, metavar="ID", help="environment ids (default: all)"
    )
    parser.add_argument(
        "--algorithms", nargs="+", default=ALGORITHMS, choices=ALGORITHMS, help="algorithms (default: all)"
    )
    parser.add_argument(
        "--seeds", type=whole(1, 1000), default=5, help="number of seeds, from 0 on (default: 5)"
    )
    parser.add_argument(
        "--episodes",
        type=whole(1, 100_000),
        default=EPISODES,
        help="episodes of the evaluation (default: 100)",
    )
    parser.add_argument(
        "--runs", type=Path, default=Path("runs/benchmark"), help="folder for the run folders"
    )
    parser.add_argument("--json", type=Path, help="file for the rows (default: RUNS/baselines.json)")
    parser.add_argument("--check", type=Path, metavar="FILE", help="run nothing: check the rows of this file")
    parser.add_argument(
        "--agents",
        type=Path,
        metavar="FOLDER",
        help="with --check: folder of run folders ID-ALGORITHM-SEED; their agents play a few episodes again",
    )
    add_hyperparameters(parser)
    options = parsed(parser, arguments)
    if options.agents and not options.check:
        parser.error("--agents belongs to --check")
    if options.check:
        from check import check

        return guarded("benchmark.py", lambda: check(options.check, options.agents), MENDABLE)
    return guarded("benchmark.py", lambda: benchmark(options), MENDABLE)


def benchmark(options: argparse.Namespace) -> int:
    """Run what has no row yet."""
    runs = options.runs.absolute()
    runs.mkdir(parents=True, exist_ok=True)
    plan = Plan(
        runs, options.episodes, tuple(options.overrides), options.configs and options.configs.absolute()
    )
    cells = planned(options.tasks, options.algorithms, options.seeds)
    for cell in cells:
        asked(cell, plan)  # what is wrong is told before anything runs
    with locked(runs):
        table = Table(options.json or runs / "baselines.json")
        probes = {task: probe(task) for task in options.tasks}
        left = [cell for cell in cells if not table.current(cell, plan, probes)]
        print(f"{len(cells)} runs, {len(left)} of them to do; rows in {table.path}")
        if (revision := versions()["git_revision"]) and str(revision).endswith("-dirty"):
            print("files of the source tree differ from its commit: --check will refuse these rows")
        if not left:
            return 0
        try:
            failed = collected(left, plan, run_cells(left, plan, options), table)
        except KeyboardInterrupt:
            print("\nstopped; the same command continues")
            return INTERRUPTED
    for cell, why in failed:
        print(f"{cell} failed: {why}", file=sys.stderr)
    return 1 if failed else 0


def collected(
    cells: Sequence[Cell], plan: Plan, results: Iterator[Outcome | None], table: Table
) -> list[tuple[Cell, str]]:
    """Write rows as they come, show how far all has come, and return what failed."""
    failed, open_cells = [], {cell: steps_of(cell, plan) for cell in cells}
    total, finished = sum(open_cells.values()), 0
    with tqdm(total=total, unit="step", unit_scale=True, mininterval=1.0, smoothing=0.02) as bar:
        bar.update(0)
        for result in results:
            if result is not None:
                cell, row = result
                finished += open_cells.pop(cell)
                if isinstance(row, str):
                    failed.append((cell, row))
                    tqdm.write(f"{cell}: failed: {row}")
                else:
                    table.add(row)
                    success = "-" if row["success_rate"] is None else f"{100 * row['success_rate']:.0f} %"
                    told = f"{success}, {row['mean_return']:.3f}, {row['seconds']:.0f} s of processor time"
                    tqdm.write(f"{cell}: {told}")
            under_way = sum(
                min(last_row(plan.folder(c))[0], steps) for c, steps in open_cells.items() if steps
            )
            bar.n = finished + under_way
            bar.set_postfix({"runs left": len(open_cells)}, refresh=False)
            bar.update(0)
    return failed


def steps_of(cell: Cell, plan: Plan) -> int:
    config = asked(cell, plan)
    return 0 if config is None else int(config.total_timesteps)


if __name__ == "__main__":
    sys.exit(main())
