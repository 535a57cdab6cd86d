"""Dormand and Prince's embedded Runge–Kutta pair 5(4): steps chosen from an estimate of the error."""

from __future__ import annotations

import numpy as np

from springgym.core.compiler.decorators import compiled
from springgym.core.language.kinds import Ledger, Mask, Number, Numbers, Rows
from springgym.core.language.lanes import any_lane, select, sqrt
from springgym.core.language.memory import load, store
from springgym.core.language.vectors import choose, dot, row, set_row
from springgym.dynamics.forces import derivative
from springgym.dynamics.forces.ledger import LEDGER_ENTRIES
from springgym.dynamics.forces.springs import longest_spring
from springgym.dynamics.methods.record import Control, Integrator, StepCount
from springgym.dynamics.methods.step_control import LEAST, next_step
from springgym.dynamics.terms import Terms

RECORD = Integrator(
    name="dopri5",
    order=5,
    evaluations=6,
    imaginary_limit=0.99718,
    real_limit=3.3065,
    symplectic=False,
    negative_substeps=False,
    workspace=27,
    citation="Dormand, Prince 1980, doi:10.1016/0771-050X(80)90013-3; PI control: Gustafsson 1991, "
    "doi:10.1145/210232.210242",
    adaptive=True,
)

STAGES = 7
A = np.array(
    [
        [0, 0, 0, 0, 0, 0],
        [1 / 5, 0, 0, 0, 0, 0],
        [3 / 40, 9 / 40, 0, 0, 0, 0],
        [44 / 45, -56 / 15, 32 / 9, 0, 0, 0],
        [19372 / 6561, -25360 / 2187, 64448 / 6561, -212 / 729, 0, 0],
        [9017 / 3168, -355 / 33, 46732 / 5247, 49 / 176, -5103 / 18656, 0],
        [35 / 384, 0, 500 / 1113, 125 / 192, -2187 / 6784, 11 / 84],
    ]
)
"""The last row has the weights of the fifth-order solution: the last stage is the next step's first."""

ERROR = np.array([71 / 57600, 0, -71 / 16695, 71 / 1920, -17253 / 339200, 22 / 525, -1 / 40])
"""Weights of the difference between the two solutions."""

SMALLEST = 1e-10
"""Least step as a fraction of h: a copy that needs shorter steps has failed."""


@compiled
def integrate(
    x: Rows, v: Rows, ledger: Ledger, workspace: np.ndarray, h: Control, steps: int, terms: Terms
) -> None:
    """Advance by ``steps`` × h in steps of at most h, with step sizes of each copy's own.

    Powers are integrated for the ledger with the same weights. `springgym.dynamics.methods.step_control`
    chooses the steps. The positions of a copy whose steps fall below `SMALLEST` h are set to NaN."""
    if ledger is None:
        advance(x, v, None, None, workspace, h, steps, terms)
    else:
        # behind the stages: the powers of all stages, as one row of numbers
        accounts = workspace[17:]
        power = accounts.reshape(accounts.shape[0] * accounts.shape[1] * 3)
        advance(x, v, ledger, power, workspace, h, steps, terms)


@compiled
def advance(
    x: Numbers,
    v: Rows,
    ledger: Ledger,
    power: Numbers,
    workspace: np.ndarray,
    control: Control,
    steps: int,
    terms: Terms,
) -> None:
    """`integrate` with the ``power`` of each stage, entry by entry, None if there is no ledger."""
    xs = workspace[14]
    vs = workspace[15]
    b = workspace[16]
    length = longest_spring(x, terms.springs)
    nothing = 0.0 * length
    remaining = nothing + steps * control.step
    trial = nothing + control.step
    last_error = nothing + 1.0
    after_rejection = nothing
    evaluate(x, v, 0, workspace, b, power, terms)
    while any_lane(remaining > 0.0):
        tau = select(trial < remaining, select(2.0 * trial > remaining, 0.5 * remaining, trial), remaining)
        for stage in range(1, STAGES):
            for i in range(x.shape[0]):
                dx = A[stage, 0] * row(workspace[7], i)
                dv = A[stage, 0] * row(workspace[0], i)
                for j in range(1, stage):
                    dx = dx + A[stage, j] * row(workspace[7 + j], i)
                    dv = dv + A[stage, j] * row(workspace[j], i)
                set_row(xs, i, row(x, i) + tau * dx)
                set_row(vs, i, row(v, i) + tau * dv)
            evaluate(xs, vs, stage, workspace, b, power, terms)
        error = error_norm(v, vs, tau, length, workspace, control)
        active = remaining > 0.0
        # a copy that has arrived accepts no step, and stays bit-identical
        accepted = select(active, error, 2.0) <= 1.0
        finish(accepted, x, v, tau, workspace, ledger, power)
        taken = select(accepted, 1.0 + nothing, nothing)
        rejected = select(active, 1.0 - taken, nothing)
        store(control.counts, StepCount.STEPS, load(control.counts, StepCount.STEPS) + taken)
        store(control.counts, StepCount.REJECTIONS, load(control.counts, StepCount.REJECTIONS) + rejected)
        remaining = select(accepted, remaining - tau, remaining)
        error = select(error < LEAST, LEAST, error)
        trial = next_step(tau, error, last_error, after_rejection + rejected)
        trial = select(trial < control.step, trial, control.step)
        last_error = select(accepted, error, last_error)
        after_rejection = rejected
        lost = rejected * (SMALLEST * control.step - trial) > 0.0
        if any_lane(lost):
            remaining = select(lost, nothing, remaining)
            for i in range(x.shape[0]):
                for axis in range(3):
                    store(x, (i, axis), select(lost, np.nan, load(x, (i, axis))))


@compiled
def evaluate(
    x: Rows, v: Rows, stage: Number, workspace: np.ndarray, b: Rows, power: Numbers, terms: Terms
) -> None:
    """Set the derivatives of v, ``workspace[stage]``, and x, ``workspace[7 + stage]``, and the power."""
    if power is None:
        derivative(x, v, workspace[stage], b, 1.0, None, terms)
    else:
        for entry in range(LEDGER_ENTRIES):
            store(power, LEDGER_ENTRIES * stage + entry, 0.0)
        derivative(x, v, workspace[stage], b, 1.0, power[LEDGER_ENTRIES * stage :], terms)
    for i in range(x.shape[0]):
        set_row(workspace[7 + stage], i, row(v, i))


@compiled
def error_norm(
    v: Rows, vs: Rows, tau: Number, length: Number, workspace: np.ndarray, control: Control
) -> Number:
    """Return the sum of the root mean square errors of positions and velocities, in tolerances."""
    squares = 0.0 * tau
    speed = squares
    in_x = squares
    in_v = squares
    for i in range(v.shape[0]):
        speed = speed + 0.5 * (dot(row(v, i), row(v, i)) + dot(row(vs, i), row(vs, i)))
        ex = ERROR[0] * row(workspace[7], i)
        ev = ERROR[0] * row(workspace[0], i)
        for j in range(1, STAGES):
            ex = ex + ERROR[j] * row(workspace[7 + j], i)
            ev = ev + ERROR[j] * row(workspace[j], i)
        in_x = in_x + dot(ex, ex)
        in_v = in_v + dot(ev, ev)
    share = 1.0 / v.shape[0]
    in_x = tau * sqrt(share * in_x) / (control.absolute + control.relative * length)
    in_v = tau * sqrt(share * in_v) / (control.absolute + control.relative * sqrt(share * speed))
    return in_x + in_v


@compiled
def finish(
    accepted: Mask, x: Rows, v: Rows, tau: Number, workspace: np.ndarray, ledger: Ledger, power: Numbers
) -> None:
    """Take the step in the copies that accept it; its last stage is the first of the next step."""
    xs = workspace[14]
    vs = workspace[15]
    for i in range(x.shape[0]):
        set_row(x, i, choose(accepted, row(xs, i), row(x, i)))
        set_row(v, i, choose(accepted, row(vs, i), row(v, i)))
        for first in (0, STAGES):
            ahead = row(workspace[first + STAGES - 1], i)
            set_row(workspace[first], i, choose(accepted, ahead, row(workspace[first], i)))
    if ledger is not None:
        for entry in range(LEDGER_ENTRIES):
            total = load(ledger, entry)
            for j in range(STAGES - 1):
                total = total + tau * A[STAGES - 1, j] * load(power, LEDGER_ENTRIES * j + entry)
            store(ledger, entry, select(accepted, total, load(ledger, entry)))
            ahead = load(power, LEDGER_ENTRIES * (STAGES - 1) + entry)
            store(power, entry, select(accepted, ahead, load(power, entry)))
