"""Blanes and Moan's sixth-order Runge–Kutta–Nyström splitting: the most accurate, for undamped scenes.

Within 0.0007 of ω h = 6.3486, an oscillator grows by up to 6.5e-4 per step, and the fastest vibration of a
turning body with it (energy 1e-2 in 8 s). Though steps are stable again up to 9.0735, the limit lies before
this resonance. A narrower one, within 0.0004 of 3.1419, is harmless: a body soon leaves it (1e-6 in 8 s).
The order is six for forces that depend on positions only; the actuators' work, whose power depends on
velocities, too, is recorded to fourth order.
"""

from __future__ import annotations

from springgym.dynamics.methods.record import Integrator
from springgym.dynamics.methods.splitting import splitting

RECORD = Integrator(
    name="blanes_moan",
    order=6,
    evaluations=11,
    imaginary_limit=6.34,
    real_limit=0.0,
    symplectic=True,
    negative_substeps=True,
    workspace=3,
    citation="Blanes, Moan 2002, doi:10.1016/S0377-0427(01)00492-7, SRKN 11 stages, order 6 (type b)",
)

B = (0.0414649985182624, 0.198128671918067, -0.0400061921041533, 0.0752539843015807, -0.0115113874206879)
A = (0.123229775946271, 0.290553797799558, -0.127049212625417, -0.246331761062075, 0.357208872795928)

integrate = splitting(drifts=(*A, 1 - 2 * sum(A), *A[::-1]), kicks=(*B, 0.5 - sum(B), 0.5 - sum(B), *B[::-1]))
