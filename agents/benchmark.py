"""Compare algorithms on a suite of tasks, by what they reach in the same time on one core, unattended.

    nice -n 19 python agents/benchmark.py                         # the suite, on all cores of this machine
    python agents/benchmark.py --tasks SpringTop-v0 --algorithms ppo linear --seeds 5
    python agents/benchmark.py --local --jobs 1                   # without Ray
    python agents/benchmark.py --address auto                     # on the Ray cluster that runs here

Each run is one of ``agents/train.py`` with the same arguments, on one core and one thread, in a folder under
``--runs`` with its output in ``log.txt``. It learns for ``--seconds`` of processor time, in which evaluations
do not count; with 0, for the steps that its configuration says. At the end, its agent plays 100 held-out
episodes, and a result (a row) is added to ``--json``. The same command continues a stopped benchmark: it
skips runs with a result and continues others from their newest checkpoint. A run is repeated if its
configuration, its task or the protocol has changed; one that was stopped begins anew if the commit has
changed. docs/benchmark.md holds the protocol and describes the results. Check those of others by

    python agents/benchmark.py --check rows.json --agents FOLDER

On a cluster, all nodes must see this checkout under this path. If they also share the run folders, another
node continues the runs of a node that fails; otherwise these runs start again.
"""

from __future__ import annotations

import argparse
import json
import multiprocessing
import os
import sys
import threading
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, redirect_stderr, redirect_stdout
from dataclasses import dataclass
from functools import partial
from importlib.util import find_spec
from multiprocessing.connection import Connection, wait
from pathlib import Path
from typing import Any

from config import (
    MENDABLE,
    ONLINE,
    Config,
    ConfigError,
    add_overrides,
    check_result,
    command_line,
    config_path,
    load_config,
    new_file,
    number,
    whole,
)
from controllers import UNTRAINED, controllers_of
from evaluate import evaluate, find_task, percent, score
from results import (
    COMPARED,
    EPISODES,
    PROTOCOL,
    SECONDS,
    SUITE,
    Cell,
    Row,
    add_row,
    check,
    curve_of,
    digest_of,
    folder_name,
    identity,
    is_clean,
    probe,
    read_rows,
    row_of,
    same_probe,
)
from runs import locked, open_run, versions
from tqdm import tqdm

from springgym.cli import INTERRUPTED, guarded, write_text
from springgym.core.extras import install
from springgym.envs.registration import spec_of
from springgym.scenes.strict_yaml import read_json, read_yaml

ROOT = Path(__file__).resolve().parent.parent
THREADS = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS")
TRIES = 5
"""Number of node failures that a run survives."""


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

    def config(self, algorithm: Any) -> Path:
        return config_path(algorithm, self.configs)


# --- One cell, in a process of its own -----------------------------------------------------------------


def run_cell(cell: Cell, plan: Plan) -> dict[str, Any]:
    """Run a cell, from where it stands, and return its row."""
    import torch
    import train

    torch.set_num_threads(1)
    folder = plan.folder(cell)
    folder.mkdir(parents=True, exist_ok=True)
    arguments = [] if cell.algorithm in UNTRAINED else training(cell, plan)
    with open(folder / "log.txt", "a", encoding="utf-8") as log, redirect_stdout(log), redirect_stderr(log):
        steps = 0
        seconds = 0.0
        if cell.algorithm in UNTRAINED:
            agent = cell.algorithm
            env_id, kwargs = find_task([], cell.task, [])
        else:
            agent = str(folder)
            if train.main(arguments):
                lines = (folder / "log.txt").read_text(encoding="utf-8").splitlines()
                raise ConfigError(lines[-1] if lines else f"{folder}: (no error output)")
            steps, seconds = last_row(folder)
            env_id, kwargs = find_task([agent], cell.task, [])
        played = evaluate(agent, env_id, kwargs, plan.episodes)
    config = config_of(cell, plan)
    row = row_of(cell, config, steps, seconds, curve_of(folder) if config else [], played)
    if config is not None and (begun := commit_of(folder)) != row["commit"]:
        row["commit"] = f"{begun}, {row['commit']}"  # which --check refuses
    return row


def training(cell: Cell, plan: Plan) -> list[str]:
    """Return the arguments of ``agents/train.py`` that continue a run of this commit, or begin one."""
    folder = plan.folder(cell)
    if (folder / "config.yaml").exists():
        probed = recorded(folder / "probe.json")
        same = config_of(cell, plan) == open_run(folder).config and same_probe(probed, cell.task)
        if same and commit_of(folder) == versions()["git_revision"]:
            return ["--resume", str(folder), "--episodes", "0"]
        put_away(folder)
    write_text(folder / "probe.json", json.dumps(probe(cell.task)) + "\n")
    arguments = [cell.task, "--algo", cell.algorithm, "--seed", str(cell.seed), "--out", str(folder)]
    arguments += ["--config", str(plan.config(cell.algorithm))]
    return [*arguments, "--episodes", "0", *(["--set", *plan.overrides] if plan.overrides else [])]


def recorded(path: Path) -> Any:
    """Read a JSON file of a run folder; return None if it is missing or damaged."""
    try:
        return read_json(path)
    except ConfigError:
        return None


def commit_of(folder: Path) -> str | None:
    """Return the commit at which a run was begun; None if ``versions.json`` is missing or damaged."""
    return (recorded(folder / "versions.json") or {}).get("git_revision")


def put_away(folder: Path) -> None:
    """Keep a run of another configuration or commit beside the new one."""
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


def config_of(cell: Cell, plan: Plan) -> Config | None:
    """Return the configuration of a cell; None for controllers that are not trained."""
    if cell.algorithm in UNTRAINED:
        return None
    algorithm: Any = cell.algorithm
    return load_config(algorithm, cell.task, plan.overrides, plan.config(algorithm))


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
                process = spawn.Process(target=send_outcome, args=(theirs, cell, plan), daemon=True)
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


def send_outcome(pipe: Connection, cell: Cell, plan: Plan) -> None:
    """Run a cell and send its outcome."""
    end_with_parent()
    pipe.send(outcome(lambda: run_cell(cell, plan)))


def end_with_parent() -> None:
    """End this process when the benchmark is killed: the next one would find the folder locked."""
    parent = multiprocessing.parent_process()
    assert parent is not None

    def watch() -> None:
        wait([parent.sentinel])
        os._exit(1)

    threading.Thread(target=watch, daemon=True).start()


@contextmanager
def one_thread() -> Iterator[None]:
    """Limit processes that are started within this context to one thread."""
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
        task = ray.remote(num_cpus=1, max_retries=TRIES, max_calls=1)(run_cell)
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


def planned(tasks: Sequence[str], algorithms: Sequence[str], seeds: int, plan: Plan) -> list[Cell]:
    """Order the cells, one seed of all before the next, so that an unfinished run is a whole table."""
    goals = read_yaml(plan.config("her")).value if "her" in algorithms else ()
    return [
        Cell(task, algorithm, seed)
        for seed in range(seeds)
        for algorithm in algorithms
        for task in tasks
        if seed == 0 or algorithm not in UNTRAINED
        if algorithm != "classical" or controllers_of(task)
        if algorithm != "her" or task in goals
    ]


def is_current(row: Row, cell: Cell, plan: Plan) -> bool:
    """Return whether a row has the current protocol, configuration, number of episodes and task.

    A row made with uncommitted changes is so only while the tree has some.
    """
    now = PROTOCOL, digest_of(config_of(cell, plan)), plan.episodes
    same = tuple(map(row.get, ("protocol", "config", "episodes"))) == now
    final = is_clean(row.get("commit")) or not is_clean(versions()["git_revision"])
    return same and final and same_probe(row["probe"], cell.task)


def add_hyperparameters(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments that say how agents are trained."""
    parser.add_argument(
        "--seconds",
        type=number(0.0, 1e9),
        default=SECONDS,
        help=f"processor time of learning of a run (default: {SECONDS:g}); 0: the configuration's steps",
    )
    parser.add_argument("--configs", type=absolute, help="folder of hyperparameters (default: configs)")
    add_overrides(parser, "change hyperparameters")


def absolute(path: str) -> Path:
    return Path(path).absolute()


def overrides_of(options: argparse.Namespace) -> tuple[str, ...]:
    """Return the changes of hyperparameters that `add_hyperparameters` has declared."""
    return (f"seconds={options.seconds}", *options.overrides) if options.seconds else tuple(options.overrides)


def parsed(parser: argparse.ArgumentParser, arguments: Sequence[str] | None) -> argparse.Namespace:
    """Parse the arguments, with those that say where cells are run."""
    parser.add_argument(
        "--jobs", type=whole(1, 10_000), help="parallel runs on this machine (default: number of cores)"
    )
    where = parser.add_mutually_exclusive_group()
    where.add_argument("--local", action="store_true", help="use this machine, without Ray")
    where.add_argument("--address", help="address of a Ray cluster (auto: this machine's)")
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
    parser = command_line(__doc__)
    parser.add_argument(
        "--tasks", nargs="+", default=SUITE, metavar="ID", help="environment ids (default: the suite)"
    )
    parser.add_argument(
        "--algorithms",
        nargs="+",
        default=(*UNTRAINED, *COMPARED),
        choices=(*UNTRAINED, *ONLINE),
        help=f"algorithms (default: controllers, {', '.join(COMPARED)})",
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
    parser.add_argument("--runs", type=Path, default=Path("runs/benchmark"), help="parent of the run folders")
    parser.add_argument(
        "--json", type=new_file(), metavar="FILE", help="results file (default: RUNS/baselines.json)"
    )
    parser.add_argument("--check", type=Path, metavar="FILE", help="only check the results of this file")
    parser.add_argument(
        "--agents",
        type=Path,
        metavar="FOLDER",
        help="with --check: parent of run folders ID-ALGORITHM-SEED, whose agents replay the episodes",
    )
    add_hyperparameters(parser)
    options = parsed(parser, arguments)
    if options.agents and not options.check:
        parser.error("--agents belongs to --check")
    if options.check:
        return guarded("benchmark.py", lambda: check(options.check, options.agents), MENDABLE)
    return guarded("benchmark.py", lambda: benchmark(options), MENDABLE)


def benchmark(options: argparse.Namespace) -> int:
    """Run what has no row yet."""
    runs = options.runs.absolute()
    runs.mkdir(parents=True, exist_ok=True)
    plan = Plan(runs, options.episodes, overrides_of(options), options.configs)
    for task in options.tasks:
        spec_of(task)
    cells = planned(options.tasks, options.algorithms, options.seeds, plan)
    if not cells:
        raise ConfigError(f"none of {', '.join(options.algorithms)} has settings for these tasks")
    for cell in cells:
        config_of(cell, plan)  # what is wrong is told before anything runs
    with locked(runs):
        path = options.json or runs / "baselines.json"
        check_result(path)
        rows = read_rows(path)
        left = [cell for cell in cells if not is_current(rows.get(identity(cell._asdict()), {}), cell, plan)]
        print(f"{len(cells)} runs, {len(left)} of them to do; rows in {path}")
        if not is_clean(versions()["git_revision"]):
            print("files of the source tree differ from its commit: --check will refuse these rows")
        if not left:
            return 0
        try:
            failed = collected(left, plan, run_cells(left, plan, options), path)
        except KeyboardInterrupt:
            print("\nstopped; the same command continues")
            return INTERRUPTED
    for cell, why in failed:
        print(f"{cell} failed: {why}", file=sys.stderr)
    return 1 if failed else 0


def collected(
    cells: Sequence[Cell], plan: Plan, results: Iterator[Outcome | None], path: Path
) -> list[tuple[Cell, str]]:
    """Write rows as they come, show how far all has come, and return what failed."""
    failed = []
    left = {cell: config_of(cell, plan) for cell in cells}
    with tqdm(total=len(cells), unit="run", mininterval=1.0, smoothing=0.02) as bar:
        for result in results:
            if result is not None:
                cell, row = result
                del left[cell]
                if isinstance(row, str):
                    failed.append((cell, row))
                    tqdm.write(f"{cell}: failed: {row}")
                else:
                    add_row(path, row)
                    success = percent(row["success_rate"])
                    scale, unit = score(cell.task)
                    tqdm.write(
                        f"{cell}: success {success}, return {scale * row['mean_return']:.3f} per {unit}, "
                        f"{row['seconds']:.0f} s of processor time"
                    )
            begun = [(config, plan.folder(cell)) for cell, config in left.items() if config is not None]
            done = sum(config.share_done(*last_row(folder)) for config, folder in begun)
            bar.n = round(len(cells) - len(left) + done, 2)
            bar.update(0)
    return failed


if __name__ == "__main__":
    sys.exit(main())
