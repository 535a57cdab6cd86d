"""Every measured number of the readme and of the pages, from one source, ``docs/numbers.json``.

python docs/measured.py                   # write the numbers and tables of the source into the pages
python docs/measured.py --check           # say which pages differ, and which numbers are older than the code
python docs/measured.py --write           # measure what is older, a section at a time; then the pages
python docs/measured.py --write kernel    # these sections, however old
python docs/measured.py --write --here "AMD EPYC (Zen 5)"   # what to call this processor

In a page, ``<!--n:NAME-->39 M<!--/n-->`` is a number of `NUMBERS`, and what stands between
``<!--table:NAME-->`` and ``<!--/table-->`` a table of `TABLES`. A section is written as soon as it is
measured, so what was stopped goes on where it was. All but those of `LONG` take less than ten minutes on
two slow cores, once compiled. What other commands measure stays in their own files, see `OTHERS`.
"""

from __future__ import annotations

import argparse
import json
import re
import sys
import time
from collections.abc import Callable, Mapping, Sequence
from itertools import zip_longest
from pathlib import Path
from typing import Any

import numpy as np

HERE = Path(__file__).parent
ROOT = HERE.parent
sys.path[:0] = [str(ROOT), str(HERE), str(ROOT / "agents")]

import environments  # noqa: E402

from benchmarks import speed as bench  # noqa: E402
from benchmarks.accuracy import table as cheapest_methods  # noqa: E402
from benchmarks.conditions import changed_since, conditions  # noqa: E402
from benchmarks.contact_tasks import TASKS  # noqa: E402
from benchmarks.ratios import like, ratios, speed  # noqa: E402
from benchmarks.work_precision import cheapest  # noqa: E402
from springgym.cli import guarded, significant, write_text  # noqa: E402

ENVIRONMENTS = environments.MEASURED
SOURCE = HERE / "numbers.json"
OTHERS = {
    "accuracy": HERE / "figures" / "accuracy.json",  # python -m benchmarks.accuracy --out docs/figures
    "baselines": HERE / "baselines.json",  # agents/benchmark.py
    "learning": HERE / "learning_time.json",  # agents/studies/learning_time.py
}
PAGES = (ROOT / "README.md", ROOT / "CONTRIBUTING.md", *sorted(HERE.glob("*.md")))
ROUNDS = 5
LONG = ("variants", "suite")
"""Sections that are measured only when they are named."""

Report = Mapping[str, Any]


# --- The source ---------------------------------------------------------------------------------------


def read() -> dict[str, Any]:
    """All that was measured, by section; of other files, under their names."""
    report: dict[str, Any] = json.loads(SOURCE.read_text(encoding="utf-8"))
    return report | {name: json.loads(path.read_text(encoding="utf-8")) for name, path in OTHERS.items()}


def write(report: Report) -> None:
    """Write the sections, a row a line."""
    sections = []
    for name, section in report.items():
        if name in OTHERS:
            continue
        fields = [f"  {json.dumps(key)}: {_lines(value)}" for key, value in section.items()]
        sections.append(f" {json.dumps(name)}: {{\n" + ",\n".join(fields) + "\n }")
    write_text(SOURCE, "{\n" + ",\n".join(sections) + "\n}\n")


def _lines(value: object) -> str:
    if not isinstance(value, list):
        return json.dumps(value, ensure_ascii=False)
    return "[\n" + ",\n".join(f"   {json.dumps(row, ensure_ascii=False)}" for row in value) + "\n  ]"


def older(report: Report) -> list[str]:
    """The sections measured before springgym/ has changed, or at a commit that nobody knows."""
    measured = [
        (name, section["measured"]) for name, section in report.items() if name not in (*OTHERS, "suite")
    ]
    measured += [("accuracy", found["measured"]) for found in report["accuracy"].values()]
    measured += [("learning", own["measured"]) for own in report["learning"]]
    commits = {own.get("commit") for _, own in measured}
    changed = {commit for commit in commits if changed_since(commit)}
    return list(dict.fromkeys(name for name, own in measured if own.get("commit") in changed))


# --- Measuring ----------------------------------------------------------------------------------------


def measure(name: str) -> dict[str, Any]:
    """Measure a section again."""
    if name in bench.SECTIONS:
        return bench.measure(name, ROUNDS)
    return MEASURES[name]()


def variants() -> dict[str, Any]:
    """Measure success and return a step of controllers without learning in every variant."""
    return {"rows": list(environments.measured_variants())}


def duels() -> dict[str, Any]:
    """Count how often the agent of the repository wins SpringDuel, by opponent, of 100 held-out duels."""
    from evaluate import evaluate, task_kwargs  # type: ignore[import-not-found]
    from runs import open_run  # type: ignore[import-not-found]

    from springgym.envs.trained import published

    folder = published("SpringDuel-v0")
    kwargs = task_kwargs(open_run(folder).config)
    rows = []
    for opponent in ("script", "guard", "strong"):
        found = evaluate(str(folder), "SpringDuel-v0", kwargs | {"opponent": opponent}, 100)
        rows.append({"opponent": opponent, "success_rate": found.success_rate, "episodes": 100})
    return {"rows": rows}


def suite() -> dict[str, Any]:
    """Minutes that the tests take, compilation included: with an empty cache, on all cores."""
    import os
    import subprocess
    import tempfile

    with tempfile.TemporaryDirectory() as folder:
        began = time.perf_counter()
        environment = os.environ | {"SPRINGGYM_CACHE_DIR": folder}
        subprocess.run([sys.executable, "-m", "pytest", "-q"], cwd=ROOT, env=environment, check=True)
        return {"rows": [{"minutes": (time.perf_counter() - began) / 60}]}


MEASURES: dict[str, Callable[[], dict[str, Any]]] = {"variants": variants, "duels": duels, "suite": suite}


# --- As text ------------------------------------------------------------------------------------------


def grouped(number: float) -> str:
    """Write a number in two figures, or in three from 100,000 on, such as 26,000 or 642,000."""
    return f"{_rounded(number, 3 if number >= 1e5 else 2):,.0f}"


def millions(number: float, unit: str = " M") -> str:
    """Write a number in millions, such as 39 M, 5.4 M or 1.27 M."""
    return f"{_rounded(number / 1e6, 3 if 1e6 <= number < 2e6 else 2):g}{unit}"


def power(number: float, digits: int = 2) -> str:
    """Write a number as a power of ten, such as 3.3e-5."""
    return re.sub(r"e([-+])0", r"e\1", f"{number:.{digits - 1}e}").replace("e+", "e")


def times(number: float) -> str:
    """Write a ratio in two figures, such as 190, 27 or 0.91."""
    return f"{_rounded(number, 2):g}" if number >= 1 else f"{number:.2f}"


def percent(share: float) -> str:
    return f"{100 * share:.0f}"


def _rounded(number: float, figures: int) -> float:
    return float(f"{number:.{figures - 1}e}")


def conditions_of(section: Report) -> str:
    """Write the date, processor and versions with which a section was measured."""
    measured = section["measured"]
    versions = measured["versions"]
    named = (("python", "Python"), ("numpy", "NumPy"), ("numba", "Numba"))
    told = ", ".join(f"{name} {versions[key]}" for key, name in named if key in versions)
    return f"{measured['date']} on {measured['cores']} cores of {measured['cpu']}, {told}"


# --- Numbers ------------------------------------------------------------------------------------------

TOP = "SpringTop-v0"
Number = Callable[[Report], str]


def _of(section: str, told: Callable[[float], str], field: str = "median", **which: Any) -> Number:
    """Make a function that writes one field of one row of a report."""
    return lambda report: told(row(report, section, **which)[field])


def row(report: Report, section: str, **which: Any) -> Report:
    """The one row of a section that is ``which``; of environments, as they are unless it says otherwise."""
    rows = [
        own for own in report[section]["rows"] if all(own.get(key) == value for key, value in which.items())
    ]
    if not rows:
        raise KeyError(f"{SOURCE.name} has no row of {section} with {which}: measure it anew")
    return rows[0]


def _ratio(name: str) -> Number:
    return lambda report: times(ratios(report)[name])


def _env(copies: int, threads: int, field: str, how: str = "native") -> Number:
    return _of("environments", grouped, field, environment=TOP, how=how, copies=copies, threads=threads)


def _peer(program: str, told: Callable[[float], str], copies: int = 1, precision: str = "float64") -> Number:
    return _of("peers", told, program=program, copies=copies, precision=precision)


def _collects(how: str) -> Number:
    return _of("environments", grouped, how=f"PPO collects, {how}")


def _runs(report: Report, task: str, algorithm: str) -> list[Report]:
    return [own for own in report["baselines"] if (own["task"], own["algorithm"]) == (task, algorithm)]


def _baseline(task: str, algorithm: str, told: Callable[[list[Report]], str]) -> Number:
    return lambda report: told(_runs(report, task, algorithm))


def _success(runs: list[Report]) -> str:
    return percent(np.mean([own["success_rate"] for own in runs]))


def _span(values: Sequence[float], told: Callable[[float], str]) -> str:
    """Write the least and the largest of some numbers, or the only one."""
    ends = dict.fromkeys((told(min(values)), told(max(values))))
    return "–".join(ends)


def _seconds(runs: list[Report]) -> str:
    return _span([own["seconds"] for own in runs], "{:.0f}".format)


def _learning(task: str, told: Callable[[Report], str]) -> Number:
    return lambda report: told(next(own for own in report["learning"] if own["task"] == task))


def _rounding(method: str, seconds: int) -> Number:
    field = f"rounding_after_{seconds}_s"
    return _of(
        "kernel", lambda x: power(x, 1 if seconds == 1 else 2), field, method=method, precision="float32"
    )


def _longer(report: Report) -> str:
    """Return how many times as long a step of MuJoCo's RK4 may be as one of its Euler."""
    rk4, euler = (
        row(report, "equal-error", program=f"MuJoCo {name}")["step_ms"] for name in ("RK4", "Euler")
    )
    return times(rk4 / euler)


def _faster(report: Report) -> str:
    """Return the speed of a rigid top over that of MuJoCo's ball joint with RK4, both in steps per second."""
    own, other = (
        row(report, "peers", program=f"{who} rigid{how}", copies=1)["median"]
        for who, how in (("springgym", ""), ("MuJoCo", " RK4"))
    )
    return times(own / other)


CONTACT_TASKS = "contact-tasks"


def ratio_to_mujoco(report: Report, env_id: str, program: str) -> Report | None:
    """Return the row that compares a program with MuJoCo's fastest solver; None if it was not measured."""
    for own in report.get(CONTACT_TASKS, {}).get("rows", ()):
        if own["environment"] == env_id and own["program"].startswith(f"{program} / MuJoCo"):
            return dict(own)
    return None


def _beside_mujoco(report: Report, program: str) -> str:
    """Write the least and the largest speed of a program over MuJoCo's, of all tasks with contact."""
    rows = [ratio_to_mujoco(report, env_id, program) for env_id in TASKS]
    return _span([own["median"] for own in rows if own], times) if any(rows) else "not yet"


def _accuracy(problem: str, told: Callable[[float], str], field: str, method: str, step: float) -> Number:
    """A field of the row of a method whose step is nearest."""

    def number(report: Report) -> str:
        rows = [own for own in report["accuracy"][problem]["rows"] if own["method"] == method]
        nearest = min(rows, key=lambda own: abs(own["step"] / step - 1))
        if abs(nearest["step"] / step - 1) > 0.02:
            raise KeyError(f"{problem}: {method} has no row at {step:g} s, but {nearest['step']:g} s")
        return told(nearest[field])

    return number


def _dearer(problem: str, tolerance: float) -> Number:
    """Return a number: how many times the cost of the cheapest method verlet's is, at the same error."""

    def number(report: Report) -> str:
        best, own = (cheapest(report["accuracy"][problem], tolerance, among) for among in ("", "verlet"))
        return times(own["cost"] / best["cost"])

    return number


def _model_errors(report: Report) -> list[float]:
    return [
        found["model"]["errors"][0] for name, found in report["accuracy"].items() if name.endswith("-top")
    ]


def _agreements(report: Report, friction: bool) -> list[float]:
    return [
        found["agreement"]
        for name, found in report["accuracy"].items()
        if "agreement" in found and (name == "sliding-stop") == friction
    ]


def _spin_kept(method: str) -> Number:
    """The share of its spin, in %, that a cube keeps for a second of steps of 10 ms."""

    def number(report: Report) -> str:
        curves = report["accuracy"]["spin-down"]["curves"]
        (own,) = (curve for curve in curves if (curve["method"], curve["step"]) == (method, 0.01))
        return percent(own["spins"][24])

    return number


def _crossover(problem: str) -> Number:
    return lambda report: power(report["accuracy"]["crossover"]["bodies"][problem]["crossover"], 1)


DEARER = (
    ("rope", "1e-3"),
    ("stiff-chain", "1e-3"),
    ("rope", "1e-5"),
    ("cusp-top", "1e-5"),
    ("damped-top", "1e-5"),
)
F32 = "native, float32"
NUMBERS: dict[str, Number] = {
    "measured": lambda report: conditions_of(report["kernel"]),
    "commit": lambda report: report["kernel"]["measured"]["commit"],
    "processor of environments": lambda report: report["environments"]["measured"]["cpu"],
    "processor of tops": lambda report: report["kernel"]["measured"]["cpu"],
    "measured environments": lambda report: conditions_of(report["environments"]),
    "measured errors": lambda report: conditions_of(report["errors"]),
    "measured curves": lambda report: conditions_of(report["curves"]),
    "rounds": lambda report: str(report["kernel"]["rounds"]),
    "top steps": _of("environments", str, "substeps", environment=TOP, how="single"),
    "top error": _of("errors", power, environment=TOP),
    "top error, largest": _of("errors", power, "high", environment=TOP),
    "error, largest": lambda report: power(
        max(row(report, "errors", environment=env.id)["high"] for env in ENVIRONMENTS)
    ),
    "top float32": _env(4096, 1, "median", F32),
    "top float32, 2 threads": _env(4096, 2, "median", F32),
    "top float32, 2 threads at most": _of(
        "environments", lambda x: millions(x, " million"), "high", how=F32, copies=4096, threads=2
    ),
    "top": _env(1024, 1, "median"),
    "top, 2 threads": _env(1024, 2, "median"),
    "top, 2 threads at most": _env(1024, 2, "high"),
    "PPO collects": _collects("adapter"),
    "PPO collects, DummyVecEnv": _collects("DummyVecEnv"),
    "outside, single": _ratio("single env.step: µs outside of the control period"),
    "outside, batch": lambda report: percent(
        ratios(report)["native 1024: share of time outside of the control period"]
    ),
    "import": _of("startup", "{:.1f}".format, start="import"),
    "first step, cold": _of("startup", "{:.1f}".format, start="cold first step"),
    "first step, warm": _of("startup", "{:.1f}".format, start="warm first step"),
    "damped / C++": _ratio("damped verlet float64, 1024 copies: springgym / C++"),
    "MuJoCo RK4": _peer("MuJoCo RK4", grouped),
    "MuJoCo Euler": _peer("MuJoCo Euler", grouped),
    "MuJoCo version": lambda report: report["peers"]["measured"]["versions"]["mujoco"].rsplit(".", 1)[0],
    "SciPy": _peer("SciPy RK45", grouped),
    "rigid": _peer("springgym rigid", millions),
    "rigid batch": _peer("springgym rigid", millions, 1024),
    "MuJoCo rigid RK4": _peer("MuJoCo rigid RK4", grouped),
    "rigid error": _of("peers", power, "error", program="springgym rigid"),
    "rigid / MuJoCo rigid RK4": _faster,
    "MuJoCo rigid RK4 error": _of("peers", power, "error", program="MuJoCo rigid RK4"),
    "one / one MuJoCo": _ratio(
        "default float64, 1 copies, 1 threads / MuJoCo's best, same springs and error"
    ),
    "MuJoCo RK4 step / Euler step": _longer,
    "contact tasks / MuJoCo": lambda report: _beside_mujoco(report, "springgym"),
    "single contact tasks / MuJoCo": lambda report: _beside_mujoco(report, "springgym, single"),
    "measured contact tasks": lambda report: (
        conditions_of(report[CONTACT_TASKS]) if CONTACT_TASKS in report else "not yet"
    ),
    "RK4 error": _of("kernel", power, "error", method="rk4", precision="float64"),
    "Verlet error": _of("kernel", power, "error", method="verlet", precision="float64"),
    "Verlet error, one figure": _of(
        "kernel", lambda x: power(x, 1), "error", method="verlet", precision="float64"
    ),
    "RK4 rounding, 1 s": _rounding("rk4", 1),
    "RK4 rounding, 10 s": _rounding("rk4", 10),
    "Verlet rounding, 1 s": _rounding("verlet", 1),
    "Verlet rounding, 10 s": _rounding("verlet", 10),
    "top model error": lambda report: power(report["accuracy"]["cusp-top"]["model"]["errors"][0]),
    "top model error, one figure": lambda report: power(
        report["accuracy"]["cusp-top"]["model"]["errors"][0], 1
    ),
    "top model errors": lambda report: "–".join(power(f(_model_errors(report))) for f in (min, max)),
    "accuracy measured": lambda report: conditions_of(report["accuracy"]["cusp-top"]),
    "agreement": lambda report: power(max(_agreements(report, friction=False))),
    "agreement, friction": lambda report: power(max(_agreements(report, friction=True)), 1),
    **{f"dearer {problem} {tolerance}": _dearer(problem, float(tolerance)) for problem, tolerance in DEARER},
    "tumble, 1.4 ms": _accuracy("tumble", lambda x: power(x, 1), "error", "verlet", 1.43e-3),
    "tumble, 45 µs": _accuracy("tumble", lambda x: power(x, 1), "error", "verlet", 4.46e-5),
    "spin-down, 0.5 ms": lambda report: power(report["accuracy"]["spin-down"]["theory_errors"][0]),
    "spin-down, 10 ms": lambda report: f"{100 * report['accuracy']['spin-down']['theory_errors'][1]:.1f}",
    "spin kept, implicit_euler": _spin_kept("implicit_euler"),
    "spin kept, tr_bdf2": _spin_kept("tr_bdf2"),
    "crossover, cube": _crossover("cube-swing"),
    "crossover, top": _crossover("cusp-top"),
    "suzuki error": _accuracy("rigid-twin", lambda x: power(x, 1), "error", "rigid suzuki", 5e-3),
    "suzuki cost": _accuracy("rigid-twin", times, "cost", "rigid suzuki", 5e-3),
    "MuJoCo ball joint, error": _accuracy("rigid-twin", power, "error", "MuJoCo RK4", 1.25e-3),
    "MuJoCo ball joint, cost": _accuracy("rigid-twin", times, "cost", "MuJoCo RK4", 1.25e-3),
    "cusp-top cost": _accuracy("cusp-top", times, "cost", "verlet", 5.123e-4),
    "cusp-top error": _accuracy("cusp-top", power, "error", "verlet", 5.123e-4),
    "top learns, seconds": _learning(TOP, lambda own: f"{own['seconds']:.0f}"),
    "learning processor": _learning(TOP, lambda own: own["measured"]["cpu"]),
    "top, PPO seconds": _baseline(TOP, "ppo", _seconds),
    "duel, PPO success": _baseline("SpringDuel-v0", "ppo", _success),
    "duel, agent against script": _of("duels", percent, "success_rate", opponent="script"),
    "duel, agent against guard": _of("duels", percent, "success_rate", opponent="guard"),
    "duel, agent against strong": _of("duels", percent, "success_rate", opponent="strong"),
    "suite": _of("suite", "{:.0f}".format, "minutes"),
}
"""By name: a number of the report, as text."""

# --- Tables -------------------------------------------------------------------------------------------


def table(head: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    lines = [f"| {' | '.join(head)} |", "|---" * len(head) + "|"]
    return "\n".join(lines + [f"| {' | '.join(cells)} |" for cells in rows])


COLUMNS = [(method, precision) for method in ("rk4", "verlet") for precision in ("float64", "float32")]
HEADS = ["RK4, float64", "RK4, float32", "Verlet, float64", "Verlet, float32"]


def table_of_the_top(report: Report) -> str:
    """The paper's top beside C++."""
    found = ratios(report)

    def cell(method: str, precision: str, copies: int) -> str:
        number = speed(report, "peers", program=f"springgym {method}", precision=precision, copies=copies)
        if number is None:
            return ""
        share = found[f"{method} {precision}, {copies} copies: springgym / C++"]
        return f"{millions(number)} ({times(share)} × C++)"

    def accuracy(method: str, precision: str) -> str:
        own = row(report, "peers", program=f"springgym {method}", precision=precision)
        return f"{own['step_ms']:.2g} ms; {power(own['error'])}"

    def threads(method: str, precision: str) -> str:
        one, two = (
            row(report, "kernel", method=method, precision=precision, copies=1024, threads=n) for n in (1, 2)
        )
        return f"{two['median'] / one['median']:.2f}; {two['high'] / one['median']:.2f}"

    rows = [["step; error after 1 s, share of the size", *(accuracy(*column) for column in COLUMNS)]]
    for copies, what in ((1, "one copy"), (16, "16 copies"), (1024, "1024 copies")):
        rows.append([what, *(cell(*column, copies) for column in COLUMNS)])
    rows.append(["1024 copies: 2 threads for 1; at most", *(threads(*column) for column in COLUMNS)])
    return table(["", *HEADS], rows)


def table_of_environments(report: Report) -> str:
    """Environment steps per second, with the error of each."""
    hows = (
        {"how": "single"},
        {"how": "SyncVectorEnv"},
        {"how": "native", "copies": 64, "threads": 1},
        {"how": "native", "copies": 1024, "threads": 1},
    )
    rows = []
    for env in ENVIRONMENTS:
        speeds = [speed(report, "environments", environment=env.id, **how) for how in hows]
        error = row(report, "errors", environment=env.id)
        told = ("not yet" if n is None else grouped(n) for n in speeds)
        rows.append([f"`{env.id}`", *told, power(error["median"]), power(error["high"])])
    head = [
        "environment steps per second",
        "single",
        "`SyncVectorEnv`, 64",
        "native, 64",
        "native, 1024",
        "median error of a step",
        "largest error of a step",
    ]
    return table(head, rows)


def table_of_curves(report: Report) -> str:
    """What a step costs, what a tenth of its error costs, and what ten times of it would save."""
    rows = []
    for env in ENVIRONMENTS:
        found = environments.trade(env.id, report)
        if found is None:
            rows.append([f"`{env.id}`", *["not yet"] * 5])
            continue
        finer = "not reached" if found.finer is None else f"× {found.finer:.1f}"
        error = row(report, "errors", environment=env.id)
        rows.append(
            [
                f"`{env.id}`",
                power(error["median"]),
                power(error["high"]),
                f"{significant(found.usual, 2)} µs",
                finer,
                f"{percent(found.saved)} %",
            ]
        )
    told = ["a tenth of the error costs", "ten times the error saves"]
    head = ["environment", "median error", "largest error", "a step costs", *told]
    return table(head, rows)


def table_of_equal_error(report: Report) -> str:
    """Simulated seconds per second at equal error, where as many copies of MuJoCo ran on as many threads."""
    rows = report["equal-error"]["rows"]
    lines = []
    for copies, threads in dict.fromkeys(map(like, rows)):
        same = [own for own in rows if like(own) == (copies, threads)]
        others = [own for own in same if own["program"].startswith("MuJoCo")]
        if others:
            best = max(others, key=lambda own: own["median"])
            ours = {own["precision"]: own["median"] for own in same if own["program"].startswith("springgym")}
            what = f"{copies} top{'s' * (copies > 1)}, {threads} core{'s' * (threads > 1)}"
            cells = (ours["float64"], ours["float32"], best["median"])
            method = best["program"].removeprefix("MuJoCo ")
            ratio = times(ours["float64"] / best["median"])
            lines.append([what, *(grouped(cell) for cell in cells), method, f"× {ratio}"])
    head = ["simulated seconds per second", "springgym", "in float32", "MuJoCo", "by", "springgym / MuJoCo"]
    return table(head, lines)


def table_of_contact_tasks(report: Report) -> str:
    """Environment steps per second of tasks with contact beside MuJoCo's, and the errors of both."""
    lines = []
    for env_id in TASKS:
        ratio = ratio_to_mujoco(report, env_id, "springgym")
        if ratio is None:
            lines.append([f"`{env_id}`", *["not yet"] * 7])
            continue
        best = ratio["program"].removeprefix("springgym / ")
        mujoco = row(report, CONTACT_TASKS, environment=env_id, program=best)
        ours = (
            row(report, CONTACT_TASKS, environment=env_id, program=program)["median"]
            for program in ("springgym", "springgym, single")
        )
        error = row(report, "errors", environment=env_id)
        spread = f"{times(ratio['low'])}–{times(ratio['high'])}"
        lines.append(
            [
                f"`{env_id}`",
                *(grouped(speed) for speed in ours),
                grouped(mujoco["median"]),
                best.removeprefix("MuJoCo "),
                f"× {times(ratio['median'])} ({spread})",
                f"{power(error['median'])}; {power(error['high'])}",
                f"{power(mujoco['error'])}; {power(mujoco['largest'])}",
            ]
        )
    head = [
        "environment steps per second, one core",
        "springgym, 1024",
        "single",
        "MuJoCo",
        "by",
        "1024 / MuJoCo (rounds)",
        "error of springgym; largest",
        "error of MuJoCo; largest",
    ]
    return table(head, lines)


COLLIDING = ("bodies that may meet, apart", "tops rim to rim", "a cube's face on another's")


def table_of_collisions(report: Report) -> str:
    def cost(feature: str, copies: int) -> str:
        off, on = (
            row(report, "features", feature=feature, copies=copies, **{"is": state})["median"]
            for state in ("off", "on")
        )
        return times(off / on)

    rows = [[feature, *(cost(feature, copies) for copies in (64, 1))] for feature in COLLIDING]
    return table(["a step costs, times the springs'", "64 copies", "one copy"], rows)


TABLES: dict[str, Callable[[Report], str]] = {
    "the paper's top": table_of_the_top,
    "environments": table_of_environments,
    "contact tasks": table_of_contact_tasks,
    "curves": table_of_curves,
    "equal error": table_of_equal_error,
    "collisions": table_of_collisions,
    "cheapest methods": lambda report: cheapest_methods(report["accuracy"]),
}


# --- Pages --------------------------------------------------------------------------------------------

NUMBER = re.compile(r"<!--n:(.*?)-->(.*?)<!--/n-->", re.DOTALL)
BEGINS = re.compile(r"^ *<!--n:.*$", re.MULTILINE)
"""What Markdown takes for a block of HTML."""
TABLE = re.compile(r"<!--table:(.*?)-->\n(.*?)<!--/table-->", re.DOTALL)


def filled(text: str, report: Report) -> str:
    """A page with the numbers and tables of a report.

    Raises
    ------
    KeyError
        If the page asks for a number or table that there is not.
    """
    text = NUMBER.sub(lambda found: f"<!--n:{found[1]}-->{NUMBERS[found[1]](report)}<!--/n-->", text)
    return TABLE.sub(
        lambda found: f"<!--table:{found[1]}-->\n\n{TABLES[found[1]](report)}\n\n<!--/table-->", text
    )


def differences(text: str, report: Report) -> list[str]:
    """List where a page says something else than it should."""
    found = []
    for pattern, made in ((NUMBER, NUMBERS), (TABLE, TABLES)):
        for name, told in pattern.findall(text):
            lines = zip_longest(told.strip().split("\n"), made[name](report).split("\n"))
            found += [f"{name}: {said!r} should be {right!r}" for said, right in lines if said != right]
    found += [f"a line begins with a number: {line!r}" for line in BEGINS.findall(text)]
    return found


def fill_pages(report: Report) -> None:
    for page in PAGES:
        text = page.read_text(encoding="utf-8")
        if (new := filled(text, report)) != text:
            write_text(page, new)
    environments.write()


def main() -> int:
    """Command line."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument(
        "--check", action="store_true", help="write nothing: say what differs and what is older"
    )
    known = (*bench.SECTIONS, *MEASURES)
    parser.add_argument(
        "--write", nargs="*", choices=known, metavar="SECTION", help=f"measure: {', '.join(known)}"
    )
    parser.add_argument("--here", metavar="PROCESSOR", help="what to call the processor of this machine")
    options = parser.parse_args()
    report = read()
    if options.check:
        return check(report)
    if options.write is not None:
        for name in options.write or [name for name in older(report) if name in known and name not in LONG]:
            began = time.perf_counter()
            measured = conditions() | ({"cpu": options.here} if options.here else {})
            section = {"measured": measured} | measure(name)
            report = read() | {name: section}
            write(report)
            print(f"{name}: {time.perf_counter() - began:.0f} s", flush=True)
        from benchmarks.figures import draw_curves, draw_speed

        draw_speed(report, HERE / "figures" / "speed.svg")
        draw_curves(report["curves"]["rows"], HERE / "figures" / "curves.svg")
    fill_pages(report)
    return 0


def check(report: Report) -> int:
    """Print what differs and what is older; the status is 1 if anything does or is."""
    status = 0
    for page in PAGES:
        for difference in differences(page.read_text(encoding="utf-8"), report):
            print(f"{page.relative_to(ROOT)}: {difference}")
            status = 1
    for name in older(report):
        print(f"{name}: measured before springgym has changed")
        status = 1
    return status


if __name__ == "__main__":
    sys.exit(guarded(Path(__file__).name, main))
