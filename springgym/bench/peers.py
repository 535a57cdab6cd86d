"""Other programs that step the paper's top: C++ by hand, MuJoCo, JAX, SciPy. Those that are there."""

from __future__ import annotations

import ctypes
import importlib.util
import shutil
import subprocess
import tempfile
from pathlib import Path
from typing import Any

import numpy as np

from springgym.accuracy.peers import derivative, mujoco_model
from springgym.bench.timing import Piece
from springgym.scene import Scene


def compiled_cpp(scene: Scene, step: float, copies: int, dtype: Any) -> Piece | None:
    """RK4 steps of the hand-written reference, compiled with -O3 -march=native -ffast-math."""
    compiler = shutil.which("c++") or shutil.which("g++")
    if compiler is None:
        return None
    width = 1 if copies == 1 else {np.float64: 8, np.float32: 16}[dtype]
    real, number = {np.float64: ("double", ctypes.c_double), np.float32: ("float", ctypes.c_float)}[dtype]
    with tempfile.TemporaryDirectory() as folder:
        library, compiled = Path(folder) / "reference.so", Path(folder) / "reference.o"
        source = Path(__file__).with_name("reference.cpp")
        flags = ["-O3", "-march=native", "-ffast-math", f"-DREAL={real}", f"-DWIDTH={width}", "-fPIC"]
        subprocess.run([compiler, *flags, "-c", str(source), "-o", str(compiled)], check=True)
        # Linked apart: linking with -ffast-math would switch off subnormal numbers in this whole process.
        subprocess.run([compiler, "-shared", str(compiled), "-o", str(library)], check=True)
        advance = ctypes.CDLL(str(library)).advance
    body, blocks = scene.body, -(-copies // width)
    shape = (blocks, *body.positions.shape, width)
    inverse = scene.free / body.masses
    arrays = [np.array(np.broadcast_to(a[..., None], shape), dtype, order="C") for a in start_of(scene)]
    fixed = [np.array(a, np.int32) for a in body.springs.T]
    fixed += [np.array(a, dtype) for a in (body.lengths, body.stiffness, inverse)]
    steps = 2000 if copies == 1 else max(20, 4000 // blocks)
    pointers = [ctypes.c_void_p(a.ctypes.data) for a in (*arrays, *fixed)]
    sizes = (len(body.masses), len(body.springs))

    def run(kept: Any = (arrays, fixed)) -> None:
        advance(*pointers[:2], blocks, steps, number(step), *sizes, *pointers[2:])

    return run, steps * copies


def start_of(scene: Scene) -> tuple[np.ndarray, np.ndarray]:
    """Positions and velocities (N, 3) a scene starts with."""
    return scene.positions, scene.velocities


def mujoco_springs(scene: Scene, integrator: str, step: float) -> Piece | None:
    """Steps of MuJoCo with the particles on slide joints and the springs as tendons."""
    if importlib.util.find_spec("mujoco") is None:
        return None
    import mujoco

    model = mujoco_model(scene, integrator, step)
    data = mujoco.MjData(model)
    steps = 400

    def run() -> None:
        mujoco.mj_resetData(model, data)
        data.qvel[:] = scene.velocities[scene.free].ravel()
        mujoco.mj_step(model, data, steps)

    return run, steps


def mujoco_axes(
    scene: Scene, integrator: str, step: float, seconds: float, samples: int
) -> np.ndarray | None:
    """The body's third axis as MuJoCo has it, at times over ``seconds``, (samples, 3)."""
    if importlib.util.find_spec("mujoco") is None:
        return None
    import mujoco

    model = mujoco_model(scene, integrator, step)
    data = mujoco.MjData(model)
    data.qvel[:] = scene.velocities[scene.free].ravel()
    tail, head, _ = scene.body.frame
    axes = []
    for _ in range(samples):
        mujoco.mj_step(model, data, round(seconds / samples / step))
        x = scene.positions.copy()
        x[scene.free] += data.qpos.reshape(-1, 3)
        axes.append((x[head] - x[tail]) / np.linalg.norm(x[head] - x[tail]))
    return np.array(axes)


def mujoco_rigid(integrator: str) -> Piece | None:
    """Steps of MuJoCo with the top as one rigid body on a ball joint."""
    if importlib.util.find_spec("mujoco") is None:
        return None
    import mujoco

    model = mujoco.MjModel.from_xml_string(
        f'<mujoco><option timestep="0.001" integrator="{integrator}"/><worldbody>'
        '<body euler="0 20 0"><joint type="ball"/>'
        '<inertial pos="0 0 .75" mass="12" diaginertia="3 3 1.5"/></body></worldbody></mujoco>'
    )
    data = mujoco.MjData(model)
    data.qvel[2] = 50.0
    steps = 1000
    return lambda: mujoco.mj_step(model, data, steps), steps


def jax_batch(scene: Scene, step: float, copies: int) -> Piece | None:
    """RK4 steps of the same equations in JAX on the CPU, mapped over copies."""
    if importlib.util.find_spec("jax") is None:
        return None
    import jax

    jax.config.update("jax_enable_x64", True)  # type: ignore[no-untyped-call, unused-ignore]
    import jax.numpy as jnp

    body = scene.body
    first, second = body.springs.T
    inverse = jnp.array(scene.free / body.masses)[:, None]
    pull = jnp.array(np.where(scene.free[:, None], scene.gravity or (0, 0, 0), 0.0))

    def slope(x: Any, v: Any) -> Any:
        apart = x[second] - x[first]
        force = (body.stiffness * (1 - body.lengths / jnp.linalg.norm(apart, axis=1)))[:, None] * apart
        total = jnp.zeros_like(x).at[first].add(force).at[second].add(-force)
        return v, total * inverse + pull

    def rk4(_: int, state: Any) -> Any:
        x, v = state
        a = slope(x, v)
        b = slope(x + step / 2 * a[0], v + step / 2 * a[1])
        c = slope(x + step / 2 * b[0], v + step / 2 * b[1])
        d = slope(x + step * c[0], v + step * c[1])
        return tuple(
            s + step / 6 * (p + 2 * q + 2 * r + t) for s, p, q, r, t in zip(state, a, b, c, d, strict=True)
        )

    steps = 100
    advance = jax.jit(jax.vmap(lambda x, v: jax.lax.fori_loop(0, steps, rk4, (x, v))))
    start = tuple(jnp.broadcast_to(jnp.array(a), (copies, *a.shape)) for a in start_of(scene))
    return lambda: jax.block_until_ready(advance(*start)), steps * copies  # type: ignore[no-untyped-call, unused-ignore]


def scipy_rk45(scene: Scene, step: float) -> Piece | None:
    """Steps of SciPy's RK45 over equations in NumPy, its step held at ``step``."""
    if importlib.util.find_spec("scipy") is None:
        return None
    from scipy.integrate import solve_ivp

    slope, steps = derivative(scene), 20
    state = np.concatenate([a.ravel() for a in start_of(scene)])

    def run() -> None:
        solve_ivp(slope, (0.0, steps * step), state, max_step=step, first_step=step, rtol=1e9, atol=1e9)

    return run, steps
