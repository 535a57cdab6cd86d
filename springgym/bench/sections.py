"""What `springgym bench` measures, a function each. A step is the integrator's unless it says otherwise."""

from __future__ import annotations

import os
import subprocess
import sys
import tempfile
from typing import Any

import gymnasium as gym
import numpy as np

from springgym.bench import peers
from springgym.bench.timing import Piece, Rate, rates
from springgym.bodies import start, top
from springgym.registration import ENVIRONMENTS
from springgym.scene import Scene, WrenchActuator
from springgym.simulator import Simulator
from springgym.surfaces import floor

PAPER = (14_000, 18_000)
"""Steps a second the paper reports, on processors of 800 MHz."""
H = 5e-4
"""Step of the paper [s]."""


def top_scene(damping: float = 0.0, ring: int = 12, **options: Any) -> Scene:
    """The paper's top, tilted and spinning at 50 rad/s."""
    body = top(ring=ring, damping=damping)
    tip = body.parts["tip"]
    return Scene(body, *start(body, tilt=0.3, spin=50.0, pinned=tip), pinned=tip, **options)


def advance(scene: Scene, copies: int = 1, steps: int | None = None, **options: Any) -> Piece:
    """Steps of a simulator without a ledger: (run, number of steps of all copies)."""
    simulator = Simulator(scene, copies=copies, **({"step": H, "ledger": False} | options))
    count = steps or max(100, 4000 // copies)
    start = simulator.state()

    def run() -> None:
        simulator.restore(start)
        simulator.advance(count, check=False)

    return run, count * copies


def kernel(rounds: int) -> dict[str, Rate]:
    """Steps a second of the top's 37 undamped springs: method × copies × precision × threads."""
    pieces = {}
    scene = top_scene()
    for method in ("rk4", "verlet"):
        for dtype in (np.float64, np.float32):
            for copies in (1, 8, 16, 64, 1024, 4096):
                for threads in (1, 2) if copies >= 1024 else (1,):
                    name = f"{method} {dtype.__name__} {copies} copies {threads} threads"
                    pieces[name] = advance(scene, copies, integrator=method, dtype=dtype, threads=threads)
    return rates(pieces, rounds)


def environments(rounds: int) -> dict[str, Rate]:
    """Environment steps a second; one is 40 integrator steps for SpringTop-v0."""
    pieces = {}
    for row in ENVIRONMENTS:
        pieces[f"{row.id} single"] = _env_piece(row.id, None)
        pieces[f"{row.id} native 1024"] = _env_piece(row.id, 1024, vectorization_mode="vector_entry_point")
    for copies in (64, 1024):
        native = {"vectorization_mode": "vector_entry_point"}
        pieces[f"SpringTop-v0 native {copies} of 1 thread"] = _env_piece("SpringTop-v0", copies, **native)
        two = native | {"threads": 2}
        pieces[f"SpringTop-v0 native {copies} of 2 threads"] = _env_piece("SpringTop-v0", copies, **two)
    pieces["SpringTop-v0 SyncVectorEnv 64"] = _env_piece("SpringTop-v0", 64, vectorization_mode="sync")
    for copies in (1, 64, 1024):
        pieces[f"SpringTop-v0 kernel alone {copies}"] = _control_kernel(copies)
    pieces |= _sb3_pieces(64)
    return rates(pieces, rounds)


def _env_piece(env_id: str, copies: int | None, **options: Any) -> Piece:
    env: Any = gym.make(env_id).unwrapped
    if copies is not None:
        env = gym.make_vec(env_id, num_envs=copies, **options)
    action, count = np.zeros(env.action_space.shape, np.float32), 20 if copies is None else 2
    env.reset(seed=0)

    def run() -> None:
        for _ in range(count):
            env.step(action)

    return run, count * (copies or 1)


def _control_kernel(copies: int) -> Piece:
    """The compiled control step of SpringTop-v0 alone."""
    env: Any = gym.make_vec("SpringTop-v0", num_envs=copies, vectorization_mode="vector_entry_point")
    env.reset(seed=0)
    episodes = env.unwrapped.episodes
    simulator, steps = episodes.simulator, episodes.steps
    start = simulator.state()
    count = 20 if copies == 1 else 2

    def run() -> None:
        simulator.restore(start)
        for _ in range(count):
            simulator.advance(steps, check=False)

    return run, count * copies


def _sb3_pieces(copies: int) -> dict[str, Piece]:
    """Steps through Stable-Baselines3's interface, and what its PPO collects; none if it is not installed."""
    try:
        from stable_baselines3 import PPO

        from springgym.envs.sb3 import make_sb3
    except ImportError:
        return {}
    envs = make_sb3("SpringTop-v0", num_envs=copies, seed=0)
    envs.reset()
    action, count = np.zeros((copies, 3), np.float32), 32

    def run() -> None:
        for _ in range(2):
            envs.step(action)

    learner = PPO("MlpPolicy", make_sb3("SpringTop-v0", num_envs=copies, seed=0), n_steps=count, device="cpu")
    _, callback = learner._setup_learn(total_timesteps=10**9)

    def collect() -> None:
        assert learner.env is not None
        learner.collect_rollouts(learner.env, callback, learner.rollout_buffer, count)

    return {
        f"SpringTop-v0 SB3 adapter {copies}": (run, 2 * copies),
        f"SpringTop-v0 PPO collects {copies}": (collect, count * copies),
    }


def features(rounds: int) -> dict[str, Rate]:
    """Steps a second of 64 tops by the default method as features are added one at a time."""
    plain, damped = top_scene(), top_scene(100.0)
    acted = damped.with_(wrench=WrenchActuator(axial=False))
    high = (floor(-10.0),)
    pieces = {
        "springs and gravity": advance(plain, 64),
        "− gravity": advance(plain.with_(gravity=None), 64),
        "+ damping": advance(damped, 64),
        "+ damping, ledger": advance(damped, 64, ledger=True),
        "+ damping, ledger, torque": advance(acted, 64, ledger=True),
        "+ a floor out of reach": advance(plain.with_(surfaces=high), 64),
    }
    return rates(pieces, rounds)


def startup(rounds: int) -> dict[str, dict[str, float]]:
    """Seconds to import, and to the first step of SpringTop-v0 with an empty and a filled cache."""
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

    imports, cold, warm = [], [], []
    for _ in range(min(rounds, 3)):
        with tempfile.TemporaryDirectory() as folder:
            cold.append(seconds(folder)[1])
            imported, stepped = seconds(folder)
            imports.append(imported)
            warm.append(stepped)
    named = {"import springgym": imports, "cold first step": cold, "warm first step": warm}
    return {name: {"median": float(np.median(v)), "low": min(v), "high": max(v)} for name, v in named.items()}


def against_peers(rounds: int) -> dict[str, Rate]:
    """Steps a second of the same 37 springs, by springgym and by others."""
    scene = top_scene()
    found: dict[str, Piece | None] = {}
    for dtype in (np.float64, np.float32):
        for copies in (1, 8, 16, 1024):
            name = f"rk4 {dtype.__name__} {copies}"
            found[f"springgym {name}"] = advance(scene, copies, integrator="rk4", dtype=dtype)
            found[f"C++ {name}"] = peers.compiled_cpp(scene, H, copies, dtype)
    for method in ("RK4", "Euler", "implicitfast"):
        found[f"MuJoCo {method}, springs"] = peers.mujoco_springs(scene, method, H)
    for method in ("RK4", "Euler"):
        found[f"MuJoCo {method}, rigid"] = peers.mujoco_rigid(method)
    found["springgym verlet float64 1"] = advance(scene)
    found["springgym verlet float64 1024"] = advance(scene, 1024)
    found["springgym rigid float64 1"] = advance(scene, dynamics="rigid", step=1e-3)
    found["springgym rigid float64 1024"] = advance(scene, 1024, dynamics="rigid", step=1e-3)
    found["JAX rk4 float64 1024"] = peers.jax_batch(scene, H, 1024)
    found["SciPy RK45 1"] = peers.scipy_rk45(scene, H)
    return rates({name: piece for name, piece in found.items() if piece is not None}, rounds)


def equal_error(rounds: int) -> dict[str, Rate]:
    """Simulated seconds a second, with the step at which the axis errs as the default's does at 0.5 ms."""
    scene = top_scene()
    wanted = _axis_error(scene, _axes(scene, integrator="verlet"))
    pieces: dict[str, Piece] = {}
    for copies in (1, 1024):
        run, steps = advance(scene, copies)
        pieces[f"springgym verlet {copies}"] = (run, H * steps)
    for method in ("RK4", "Euler", "implicitfast"):
        for halvings in range(-1, 12):
            step = H / 2**halvings
            axes = peers.mujoco_axes(scene, method, step, SECONDS, SAMPLES)
            if axes is None or _axis_error(scene, axes) <= wanted:
                break
        if axes is not None and (piece := peers.mujoco_springs(scene, method, step)) is not None:
            run, steps = piece
            pieces[f"MuJoCo {method}, {1e3 * step:.2g} ms"] = (run, step * steps)
    return rates(pieces, rounds)


SECONDS, SAMPLES = 0.5, 10


def _axes(scene: Scene, step: float = H, **options: Any) -> np.ndarray:
    """The top's axis at `SAMPLES` times over `SECONDS`, (samples, 3)."""
    simulator = Simulator(scene, step=step, ledger=False, **options)
    axes = []
    for _ in range(SAMPLES):
        simulator.advance(round(SECONDS / SAMPLES / step))
        axes.append(simulator.measure().axis[0])
    return np.array(axes)


def _axis_error(scene: Scene, axes: np.ndarray) -> float:
    """Largest distance from the axis of a method of fourth order with a sixteenth of the step."""
    return float(np.abs(axes - _axes(scene, H / 16, integrator="blanes_moan")).max())


def sizes(rounds: int) -> dict[str, Rate]:
    """Spring steps a second (steps × springs) by the default method against ring size and copies."""
    pieces = {}
    for ring in (6, 12, 24, 48, 96, 192, 384):
        scene = top_scene(ring=ring)
        run, steps = advance(scene, 64, steps=max(2, 600 // ring), step=None)
        pieces[f"ring {ring}, 64 copies"] = (run, steps * len(scene.body.springs))
    scene = top_scene()
    for copies in (1, 2, 4, 8, 16, 64, 256, 1024, 4096, 16384):
        run, steps = advance(scene, copies)
        pieces[f"ring 12, {copies} copies"] = (run, steps * len(scene.body.springs))
    return rates(pieces, rounds)


SECTIONS = {
    "kernel": kernel,
    "environments": environments,
    "features": features,
    "startup": startup,
    "peers": against_peers,
    "equal-error": equal_error,
    "sizes": sizes,
}


def ratios(results: dict[str, Any]) -> dict[str, float]:
    """The comparisons that matter, from what was measured."""

    def rate(section: str, name: str) -> float | None:
        found = results.get(section, {}).get(name)
        return None if found is None else found[0]

    wanted: dict[str, tuple[tuple[str, str], tuple[str, str]]] = {}
    for dtype in ("float64", "float32"):
        for copies in (1, 8, 16, 1024):
            name = f"rk4 {dtype} {copies}"
            wanted[f"{name}: springgym / C++"] = (("peers", f"springgym {name}"), ("peers", f"C++ {name}"))
    single = ("peers", "springgym rk4 float64 1")
    wanted["single rk4 / MuJoCo RK4, same springs"] = (single, ("peers", "MuJoCo RK4, springs"))
    batch = ("peers", "springgym verlet float64 1024")
    wanted["batch verlet / MuJoCo Euler, same springs and step"] = (batch, ("peers", "MuJoCo Euler, springs"))
    wanted["batch rk4 / JAX"] = (("peers", "springgym rk4 float64 1024"), ("peers", "JAX rk4 float64 1024"))
    for method in ("rk4", "verlet"):
        name = f"{method} float64 1024 copies"
        wanted[f"{method} 1024, 2 threads / 1"] = (
            ("kernel", f"{name} 2 threads"),
            ("kernel", f"{name} 1 threads"),
        )
    native = ("environments", "SpringTop-v0 native 64 of 1 thread")
    wanted["native / SyncVectorEnv, 64 copies"] = (native, ("environments", "SpringTop-v0 SyncVectorEnv 64"))
    found = {}
    for name, (above, below) in wanted.items():
        a, b = rate(*above), rate(*below)
        if a and b:
            found[name] = a / b
    simulated = results.get("equal-error", {})
    if others := [found[0] for name, found in simulated.items() if name.startswith("MuJoCo")]:
        best = max(others)
        for copies in (1, 1024):
            ratio = simulated[f"springgym verlet {copies}"][0] / best
            found[f"verlet {copies} / MuJoCo's best, same springs and error"] = ratio
    alone, whole = (
        rate("environments", "SpringTop-v0 kernel alone 1024"),
        rate(*(native[0], "SpringTop-v0 native 1024 of 1 thread")),
    )
    if alone and whole:
        found["native 1024: share of time outside the kernel"] = 1 - whole / alone
    alone, whole = (
        rate("environments", "SpringTop-v0 kernel alone 1"),
        rate("environments", "SpringTop-v0 single"),
    )
    if alone and whole:
        found["single env.step: µs outside the kernel"] = 1e6 / whole - 1e6 / alone
    return found


__all__ = ["SECTIONS", "ratios"]
