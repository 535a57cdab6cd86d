"""Speed and error on this machine, beside other programs: ``python -m benchmarks.speed``.

Sections are functions that measure and return rows. A step is one of the integrator, unless a row says
otherwise. `benchmarks.environments`, `benchmarks.contact_tasks`, `benchmarks.errors` and `benchmarks.curves`
hold those of environments.
"""

from __future__ import annotations

import argparse
import inspect
import json
import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from statistics import median
from typing import Any, NamedTuple

import numpy as np

from benchmarks import peers
from benchmarks.conditions import conditions
from benchmarks.contact_tasks import contact_tasks
from benchmarks.curves import curves
from benchmarks.environments import environments
from benchmarks.errors import errors
from benchmarks.paper_top import error, exact_positions, paper_top, rounding, stepping
from benchmarks.ratios import ratios
from benchmarks.timing import Case, Row, measured
from springgym.cli import check_new, guarded, write_text
from springgym.core.language.blocks import block_array
from springgym.model.bodies import Body, cube, start
from springgym.model.bodies.distances import rms_distance
from springgym.model.scene import DriveActuator, Placed, Scene, ThrustActuator, WrenchActuator
from springgym.model.surfaces import Bowl, Contact, floor
from springgym.simulator import PAPER_STEP

FIGURES = (".svg", ".png", ".pdf")
"""The file name endings of the formats in which the figure can be drawn."""

PRECISIONS = ("float64", "float32")


def kernel(rounds: int) -> list[Row]:
    """Steps a second of the paper's top, undamped: RK4 at the paper's step, verlet at its automatic one.

    Error: root mean square distance of the particles from the exact motion of the springs after 1 s, over
    the body's size; the same for any number of copies and threads. Rounding: float32 from float64.
    """
    scene = paper_top()
    cases = []
    for method, step in (("rk4", PAPER_STEP), ("verlet", None)):
        for precision in PRECISIONS:
            options: dict[str, Any] = {"integrator": method, "step": step}
            facts = error(scene, dtype=precision, **options)
            if precision == "float32":
                facts |= rounding(scene, **options)
            options["dtype"] = precision
            for copies in (1, 8, 16, 64, 1024, 4096):
                for threads in (1, 2) if copies >= 1024 else (1,):
                    number = {"copies": copies, "threads": threads}
                    what = {"method": method, "precision": precision} | number
                    cases.append(stepping(what, scene, facts=facts, **options, **number))
    return measured(cases, rounds, "steps/s")


class Feature(NamedTuple):
    """A scene without something and with it; the options are of the simulator that has it."""

    off: Scene
    on: Scene
    options: Mapping[str, Any] = {}


HALF_REACH = 0.005
"""Way between bodies that touch [m]."""


def two_bodies(body: Body, way: tuple[float, float, float]) -> Feature:
    """Return scenes of two bodies at rest side by side, which do not collide and which do.

    What pushes them is so weak that they stay where they are.
    """
    other = Placed(body, body.positions + np.array(way), name="other")
    scene = Scene(bodies=(Placed(body, name="one"), other), collisions=None)
    return Feature(scene, scene.with_(collisions=Contact(strength=1e-8, reach=2 * HALF_REACH)))


def all_features() -> dict[str, Feature]:
    """Return the optional features of a scene, each on the paper's top, loose where there are surfaces; and
    bodies that collide."""
    plain = paper_top()
    damped = paper_top(damping=100.0)
    crown, tip = (plain.body.particle(name) for name in ("crown", "tip"))
    body = plain.body
    x, v = start(body, tilt=0.3, spin=50.0)
    aloft = Scene(body, x + np.array([0.0, 0.0, 0.01 - x[:, 2].min()]), v)
    floating = aloft.with_(gravity=None)
    bowl = Bowl((0.0, 0.0, 10.0), 10.0)
    standing = aloft.with_(surfaces=(floor(),))
    four = ("masses", "stiffness", "lengths", "gravity")
    return {
        "gravity": Feature(plain.with_(gravity=None), plain),
        "damping": Feature(plain, damped),
        "wrench": Feature(plain, plain.with_(wrench=WrenchActuator(perpendicular=True))),
        "thrust": Feature(plain, plain.with_(thrust=ThrustActuator((crown,), turns=True))),
        "drive": Feature(plain, plain.with_(drive=DriveActuator(tip, speed=3.0))),
        "ledger": Feature(damped, damped, {"ledger": True}),
        "plane out of reach": Feature(floating, floating.with_(surfaces=(floor(-10.0),))),
        "plane": Feature(aloft, standing),
        "bowl": Feature(aloft, aloft.with_(surfaces=(bowl,))),
        "friction": Feature(standing, standing.with_(contact=Contact(friction=0.3))),
        "restitution": Feature(standing, standing.with_(contact=Contact(restitution=0.5))),
        "bodies that may meet, apart": two_bodies(body, (2.0, 0.0, 0.0)),
        "tops rim to rim": two_bodies(body, (float(np.ptp(body.positions[:, 0])) + HALF_REACH, 0.0, 0.0)),
        "a cube's face on another's": two_bodies(cube(damping=0.0), (0.0, 0.0, 1.0 + HALF_REACH)),
        "varying stiffness": Feature(plain, plain, {"varying": four[1:2]}),
        "varying four parameters": Feature(plain, plain, {"varying": four}),
    }


def features(rounds: int) -> list[Row]:
    """Measure steps a second, and µs a step of one copy, with and without each feature of a scene.

    The scene is the paper's top, simulated by verlet at 0.5 ms. It is undamped, and has no ledger, unless a
    row says otherwise. Rows state no error, since the scenes differ and method and step are the same.
    """
    cases = []
    for name, feature in all_features().items():
        for copies in (1, 64):
            for state, scene, options in (("off", feature.off, {}), ("on", feature.on, feature.options)):
                what = {"feature": name, "is": state, "copies": copies}
                cases.append(stepping(what, scene, copies=copies, step=PAPER_STEP, **options))
    rows = measured(cases, rounds, "steps/s")
    return [row._replace(facts={"µs_a_step": 1e6 / row.median}) for row in rows]


def startup(rounds: int) -> list[Row]:
    """Seconds from the start of Python's work to `import springgym`, and to the first step of SpringTop-v0.

    Cold is with an empty cache of compiled code. There is no error to state.
    """
    program = (
        "import time; t = time.perf_counter(); import springgym; i = time.perf_counter() - t\n"
        "import gymnasium; e = gymnasium.make('SpringTop-v0'); e.reset(seed=0)\n"
        "e.step(e.action_space.sample()); print(i, time.perf_counter() - t)"
    )

    def seconds(folder: str) -> tuple[float, float]:
        environment = os.environ | {"SPRINGGYM_CACHE_DIR": folder}
        run = subprocess.run(
            [sys.executable, "-c", program], check=True, capture_output=True, text=True, env=environment
        )
        imported, stepped = map(float, run.stdout.split())
        return imported, stepped

    seen: dict[str, list[float]] = {"import": [], "cold first step": [], "warm first step": []}
    for _ in range(min(rounds, 3)):
        with tempfile.TemporaryDirectory() as folder:
            seen["cold first step"].append(seconds(folder)[1])
            for _ in range(3):
                imported, stepped = seconds(folder)
                seen["import"].append(imported)
                seen["warm first step"].append(stepped)
    return [Row({"start": name}, median(own), min(own), max(own), "s", {}) for name, own in seen.items()]


def against_peers(rounds: int) -> list[Row]:
    """Steps a second of the paper's top on one core, by springgym and by others.

    At 0.5 ms, rigid bodies at 1 ms; undamped, or with dampers of 100 kg/s that act in every step, as those of
    the others do. Error as for the kernel, of damped tops from their own exact motion, of rigid bodies from
    the exact rigid motion.
    """
    plain = paper_top()
    damped = paper_top(damping=100.0)
    cases = []

    def own(
        program: str,
        dtype: str = "float64",
        copies: int = 1,
        step: float = PAPER_STEP,
        scene: Scene = plain,
        **how: str,
    ) -> None:
        options: dict[str, Any] = {"step": step, "dtype": dtype, "damping_every": 1} | how
        what = {"program": f"springgym {program}", "precision": dtype, "copies": copies}
        facts: dict[str, Any] = {**error(scene, **options)}
        if scene is damped:
            facts["note"] = "dampers act in every step"
        cases.append(stepping(what, scene, facts=facts, copies=copies, **options))

    def other(
        program: str,
        peer: peers.Peer | None,
        copies: int = 1,
        precision: str = "float64",
        dynamics: str = "springs",
        scene: Scene = plain,
        **facts: object,
    ) -> None:
        if peer is not None:
            facts["error"] = rms_distance(peer.positions, exact_positions(scene, 1.0, dynamics), scene.sizes)
            what = {"program": program, "precision": precision, "copies": copies}
            cases.append(
                Case(what, peer.run, peer.steps, facts=facts | ({"note": peer.note} if peer.note else {}))
            )

    def both(
        method: str, dtype: str, copies: int, scene: Scene = plain, variants: Sequence[str] = ("",)
    ) -> None:
        program = "damped verlet" if scene is damped else method
        own(program, dtype, copies, scene=scene, integrator=method)
        for variant in variants:
            peer = peers.cpp(scene, PAPER_STEP, copies, dtype, f"{method}{variant}")
            other(f"C++ {method}{variant}", peer, copies, dtype, scene=scene)

    for dtype in PRECISIONS:
        for copies in (1, 8, 16, 1024):
            both("rk4", dtype, copies)
        for copies in (1, 16, 1024):
            both("verlet", dtype, copies)
        for copies in (1, 1024):
            both("verlet", dtype, copies, damped, (", dampers swept", ", dampers in the force"))
    other("JAX", peers.jax_batch(plain, PAPER_STEP, 1024), 1024, note="may use all cores")
    other("SciPy RK45", peers.scipy_rk45(plain, PAPER_STEP))
    for method in peers.MUJOCO if peers.has("mujoco") else ():
        other(f"MuJoCo {method}", peers.MuJoCo(plain, method, PAPER_STEP).peer())
    for copies in (1, 1024):
        own("rigid", copies=copies, dynamics="rigid", step=1e-3)
    for method in ("RK4", "Euler") if peers.has("mujoco") else ():
        rigid = peers.MuJoCo(plain, method, 1e-3, rigid=True).peer(1000)
        other(f"MuJoCo rigid {method}", rigid, dynamics="rigid")
    return measured(cases, rounds, "steps/s")


def equal_error(rounds: int) -> list[Row]:
    """Simulated seconds a second at the error of the default method at its automatic step.

    MuJoCo steps the same springs, by each of its integrators at the longest step, to 4 %, whose error is
    no larger: one top on one core, and as many as springgym's batch by its `Rollout`, on as many
    threads.
    """
    scene = paper_top()
    wanted = error(scene)
    step = 1e-3 * wanted["step_ms"]
    cases = []
    batches = [(1, 1), *((1024, threads) for threads in (1, os.cpu_count() or 1))]
    for precision in PRECISIONS:
        facts = error(scene, dtype=precision)
        for copies, threads in dict.fromkeys(batches):
            own = {"copies": copies, "threads": threads}
            what = {"program": "springgym default", "precision": precision} | own
            cases.append(stepping(what, scene, per_step=step, facts=facts, dtype=precision, **own))
    for method in (*peers.MUJOCO, "implicit") if peers.has("mujoco") else ():
        for step in (1 / round(1000 * 2 ** (n / 16)) for n in range(160)):
            program = peers.MuJoCo(scene, method, step)
            peer = program.peer()
            found = rms_distance(peer.positions, exact_positions(scene, 1.0), scene.sizes)
            if found > wanted["error"]:
                continue
            facts = {"step_ms": 1e3 * step, "error": found}
            for copies, threads in dict.fromkeys(batches):
                peer = peer if copies == 1 else program.batch(copies, threads)
                what = {"program": f"MuJoCo {method}", "precision": "float64"}
                what |= {"copies": copies, "threads": threads}
                cases.append(Case(what, peer.run, peer.steps * step, facts=facts))
            break
    return measured(cases, rounds, "simulated s/s")


def sizes(rounds: int) -> list[Row]:
    """Spring steps a second (steps × springs) of tops by the default method, against ring size and copies.

    Beside it the memory of a block's positions, velocities and accelerations. No error is stated: for a
    ring of 12 it is that of the kernel; the automatic step follows the stiffest vibration of the others.
    """
    cases = []
    rings = [(ring, copies) for copies in (1, 64) for ring in (6, 12, 24, 48, 96, 192, 384)]
    for ring, copies in rings + [(12, 2**n) for n in range(1, 15) if n != 6]:
        scene = paper_top(ring=ring)
        block = block_array(copies, scene.positions.shape, np.float64)[0]
        what = {"ring": ring, "copies": copies}
        springs = len(scene.body.springs)
        facts = {"kB_a_block": 3 * block.nbytes / 1024}
        cases.append(stepping(what, scene, per_step=springs, facts=facts, copies=copies))
    rows = measured(cases, rounds, "spring steps/s")
    return [row._replace(facts={"ns_a_spring": 1e9 / row.median} | dict(row.facts)) for row in rows]


SECTIONS: dict[str, Callable[[int], list[Row]]] = {
    "kernel": kernel,
    "environments": environments,
    "contact-tasks": contact_tasks,
    "errors": errors,
    "curves": curves,
    "features": features,
    "startup": startup,
    "peers": against_peers,
    "equal-error": equal_error,
    "sizes": sizes,
}
"""The sections by name."""


# --- Command ------------------------------------------------------------------------------------------


def measure(name: str, rounds: int) -> dict[str, Any]:
    """Measure a section, print its rows, and give them for JSON."""
    what = inspect.cleandoc(SECTIONS[name].__doc__ or "")
    print(f"\n{name}: {what}\n", flush=True)
    started = time.perf_counter()
    rows = SECTIONS[name](rounds)
    print("\n".join(f"  {row}" for row in rows))
    took = time.perf_counter() - started
    print(f"  (took {took:.0f} s)", flush=True)
    return {"what": what, "rounds": rounds, "took": took, "rows": [row.flat() for row in rows]}


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command, and return its exit status."""
    parser = argparse.ArgumentParser("benchmarks.speed", description="Measure the speed on this machine.")
    parser.add_argument(
        "--only",
        nargs="+",
        choices=SECTIONS,
        metavar="SECTION",
        help=f"sections to measure (default: all), out of {', '.join(SECTIONS)}",
    )
    parser.add_argument("--rounds", type=int, default=21, help="rounds for each median (default: 21)")
    parser.add_argument("--quick", action="store_true", help="3 rounds")
    parser.add_argument("--out", type=Path, help="write the results to this JSON file, see docs/speed.md")
    parser.add_argument(
        "--figure", type=Path, help="draw peers and sizes to this file, .svg, .png or .pdf (needs matplotlib)"
    )
    args = parser.parse_args(arguments)
    return guarded(parser.prog, lambda: run(args), extra="bench")


def run(args: argparse.Namespace) -> int:
    """Measure, print, and write JSON."""
    if args.rounds < 1:
        raise ValueError(f"--rounds {args.rounds}: it must be at least 1")
    _check_files(args)
    report: dict[str, Any] = {"conditions": conditions()}
    print(json.dumps(report["conditions"]))
    for name in args.only or SECTIONS:
        report[name] = measure(name, 3 if args.quick else args.rounds)
    report["ratios"] = ratios(report)
    print("\nratios\n")
    for what, ratio in report["ratios"].items():
        print(f"  {what:76}{ratio:8.3g}")
    if args.out:
        write_text(args.out, json.dumps(report, indent=1, ensure_ascii=False) + "\n")
    if args.figure:
        from benchmarks.figures import draw_speed

        draw_speed(report, args.figure)
    return 0


def _check_files(args: argparse.Namespace) -> None:
    """Make the folders of files, and refuse what cannot be written, before the work is done."""
    for option in ("out", "figure"):
        path: Path | None = getattr(args, option)
        if path is not None and path.is_dir():
            raise ValueError(f"--{option} {path}: it is a folder; it must be a file")
        if path is not None:
            path.parent.mkdir(parents=True, exist_ok=True)
            check_new(path, FIGURES if option == "figure" else ())


if __name__ == "__main__":
    sys.exit(main())
