"""Other programs that step the paper's top: C++ by hand, MuJoCo, JAX, SciPy. Those that are there."""

from __future__ import annotations

import ctypes
import importlib.util
import shutil
import subprocess
import tempfile
import time
from collections.abc import Callable, Iterable, Sequence
from functools import cache
from itertools import product
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from springgym.accuracy.peers import derivative, mujoco_model
from springgym.bodies.body import inertia
from springgym.core.blocks import aligned_zeros
from springgym.forces.springs import interleaved
from springgym.scene import Scene
from springgym.simulator import Simulator

if TYPE_CHECKING:
    from scipy.optimize import OptimizeResult


class Peer(NamedTuple):
    """Another program: what it runs, how many steps of all copies that is, and where it has the particles."""

    run: Callable[[], object]
    steps: int
    positions: np.ndarray
    """(N, 3) [m] after 1 s from the scene's start, of one copy"""
    note: str = ""


CPP = ("rk4", "verlet", "verlet, dampers swept", "verlet, dampers in the force")
"""Methods of the hand-written reference, in its order."""

WAYS = tuple(product((1, 2, 3, 4, 6, 8), (False, True)))
"""Ways in which the reference steps a batch: the number of vector registers that a block of copies fills, and
whether it divides to find 1/√d. Otherwise it refines an estimate."""

SINGLE = (0, True)
"""The way in which it steps a single copy, whose x, y and z lie in one register."""

FLAGS = ("-std=c++17", "-O3", "-march=native", "-ffast-math", "-mprefer-vector-width=512", "-fPIC")


@cache
def _reference(
    compiler: str, precision: str, way: tuple[int, bool], particles: int, springs: int
) -> ctypes.CDLL:
    """Compile the hand-written reference for one of the `WAYS`, or for `SINGLE`."""
    registers, divide = way
    real = "double" if precision == "float64" else "float"
    sizes = {"REAL": real, "REGISTERS": registers, "DIVIDE": int(divide)}
    sizes |= {"PARTICLES": particles, "SPRINGS": springs}
    with tempfile.TemporaryDirectory() as folder:
        library, compiled = Path(folder) / "reference.so", Path(folder) / "reference.o"
        source = Path(__file__).with_name("reference.cpp")
        defined = [f"-D{name}={value}" for name, value in sizes.items()]
        subprocess.run([compiler, *FLAGS, *defined, "-c", str(source), "-o", str(compiled)], check=True)
        # Linked apart: linking with -ffast-math would switch off subnormal numbers in this whole process.
        subprocess.run([compiler, "-shared", str(compiled), "-o", str(library)], check=True)
        return ctypes.CDLL(str(library))


def cpp(
    scene: Scene,
    step: float,
    copies: int,
    precision: str,
    method: str = "rk4",
    ways: Sequence[tuple[int, bool]] = WAYS,
) -> Peer | None:
    """Return the hand-written reference with one of the methods `CPP`, in the fastest of the ``ways``."""
    compiler = shutil.which("c++") or shutil.which("g++")
    if compiler is None:
        return None
    tried = (SINGLE,) if copies == 1 else ways
    found = [_cpp(compiler, scene, step, copies, precision, method, way) for way in tried]
    if len(found) == 1:
        return found[0]
    speeds = [0.0] * len(found)
    for _ in range(30):
        for n, peer in enumerate(found):
            began = time.perf_counter()
            peer.run()
            speeds[n] = max(speeds[n], peer.steps / (time.perf_counter() - began))
    return found[int(np.argmax(speeds))]


def _cpp(
    compiler: str,
    scene: Scene,
    step: float,
    copies: int,
    precision: str,
    method: str,
    way: tuple[int, bool],
) -> Peer:
    """Return the reference in one of the `WAYS`, or in `SINGLE`."""
    body, dtype, (registers, _) = scene.body, np.dtype(precision), way
    particles, springs = len(body.masses), len(body.springs)
    library = _reference(compiler, precision, way, particles, springs)
    width = max(1, registers * library.register_bytes() // dtype.itemsize)
    blocks = -(-copies // width)
    state = []
    for start in (scene.positions, scene.velocities):
        array = aligned_zeros((blocks, particles, 3, width) if registers else (1, particles, 4), dtype)
        if registers:
            array[:] = start[..., None]
        else:
            array[0, :, :3] = start
        state.append(array)
    order = interleaved(body.springs, particles)
    fixed = [np.array(ends, np.int32) for ends in body.springs[order].T]
    fixed += [np.array(own[order], float) for own in (body.lengths, body.stiffness, body.damping)]
    fixed.append(np.array(scene.free / body.masses, float))
    gravity = -(scene.gravity or (0.0, 0.0, 0.0))[2]

    def advance(blocks: int, steps: int) -> None:
        x, v, *rest = (ctypes.c_void_p(array.ctypes.data) for array in (*state, *fixed))
        library.advance(
            CPP.index(method), x, v, blocks, steps, ctypes.c_double(step), *rest, ctypes.c_double(gravity)
        )

    advance(1, round(1 / step))
    positions = (state[0][0, ..., 0] if registers else state[0][0, :, :3]).astype(float)
    steps = 4000 if copies == 1 else max(20, 4000 // blocks)
    return Peer(lambda: advance(blocks, steps), steps * copies, positions, f"{width} copies a block")


def mujoco_springs(scene: Scene, integrator: str, step: float) -> Peer | None:
    """Steps of MuJoCo with the particles on slide joints and the springs as tendons."""
    if importlib.util.find_spec("mujoco") is None:
        return None
    import mujoco

    mujoco.set_mju_user_warning(lambda message: None)  # a step too long shows in the error
    model = mujoco_model(scene, integrator, step)
    model.opt.disableflags |= mujoco.mjtDisableBit.mjDSBL_CONSTRAINT  # there are none, and it is faster so
    data = mujoco.MjData(model)
    data.qvel[:] = scene.velocities[scene.free].ravel()
    mujoco.mj_step(model, data, round(1 / step))
    positions = scene.positions.copy()
    positions[scene.free] += data.qpos.reshape(-1, 3)
    return Peer(lambda: mujoco.mj_step(model, data, 400), 400, positions)


def mujoco_rigid(scene: Scene, integrator: str, step: float) -> Peer | None:
    """Steps of MuJoCo with the particles as one rigid body on a ball joint at the pin."""
    if importlib.util.find_spec("mujoco") is None:
        return None
    import mujoco

    start = Simulator(scene, dynamics="rigid")
    x, masses = start.positions[0] - scene.positions[scene.pivot], scene.body.masses
    centre = masses @ x / masses.sum()
    turn = inertia(x, masses)
    about = inertia(x - centre, masses)[[0, 1, 2, 0, 0, 1], [0, 1, 2, 1, 2, 2]]

    def text(values: Iterable[float]) -> str:
        return " ".join(repr(float(value)) for value in values)

    model = mujoco.MjModel.from_xml_string(
        f'<mujoco><option timestep="{step!r}" integrator="{integrator}" '
        f'gravity="{text(scene.gravity or (0, 0, 0))}">'
        '<flag constraint="disable"/></option><worldbody><body><joint type="ball"/>'
        f'<inertial pos="{text(centre)}" mass="{float(masses.sum())!r}" fullinertia="{text(about)}"/>'
        "</body></worldbody></mujoco>"
    )
    data = mujoco.MjData(model)
    data.qvel[:] = np.linalg.solve(turn, masses @ np.cross(x, start.velocities[0]))
    mujoco.mj_step(model, data, round(1 / step))
    matrix = np.zeros(9)
    mujoco.mju_quat2Mat(matrix, data.qpos)
    positions = scene.positions[scene.pivot] + x @ matrix.reshape(3, 3).T
    return Peer(lambda: mujoco.mj_step(model, data, 1000), 1000, positions)


def jax_batch(scene: Scene, step: float, copies: int) -> Peer | None:
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

    def slope(x: jax.Array, v: jax.Array) -> tuple[jax.Array, jax.Array]:
        apart = x[second] - x[first]
        force = (body.stiffness * (1 - body.lengths / jnp.linalg.norm(apart, axis=1)))[:, None] * apart
        total = jnp.zeros_like(x).at[first].add(force).at[second].add(-force)
        return v, total * inverse + pull

    def rk4(_: int, state: tuple[jax.Array, ...]) -> tuple[jax.Array, ...]:
        x, v = state
        a = slope(x, v)
        b = slope(x + step / 2 * a[0], v + step / 2 * a[1])
        c = slope(x + step / 2 * b[0], v + step / 2 * b[1])
        d = slope(x + step * c[0], v + step * c[1])
        return tuple(
            s + step / 6 * (p + 2 * q + 2 * r + t) for s, p, q, r, t in zip(state, a, b, c, d, strict=True)
        )

    def advance(copies: int, steps: int) -> Callable[[], Any]:
        mapped = jax.jit(jax.vmap(lambda x, v: jax.lax.fori_loop(0, steps, rk4, (x, v))))
        start = [
            jnp.broadcast_to(jnp.array(a), (copies, *a.shape)) for a in (scene.positions, scene.velocities)
        ]
        return lambda: jax.block_until_ready(mapped(*start))  # type: ignore[no-untyped-call, unused-ignore]

    positions = np.array(advance(1, round(1 / step))()[0][0])
    return Peer(advance(copies, 100), 100 * copies, positions)


def scipy_rk45(scene: Scene, step: float) -> Peer | None:
    """Steps of SciPy's RK45 over equations in NumPy, its step held at ``step``."""
    if importlib.util.find_spec("scipy") is None:
        return None
    from scipy.integrate import solve_ivp

    slope = derivative(scene)
    state = np.concatenate([scene.positions.ravel(), scene.velocities.ravel()])

    def advance(steps: int) -> OptimizeResult:
        span = (0.0, steps * step)
        return solve_ivp(slope, span, state, max_step=step, first_step=step, rtol=1e9, atol=1e9)

    positions = advance(round(1 / step)).y[: scene.positions.size, -1].reshape(-1, 3)
    return Peer(lambda: advance(20), 20, positions)
