"""Jacobi elliptic functions by the complementary parameter m1 = 1 - m, and the integrals needed.

Motions near a separatrix have m1 as small as 1e-12, where m itself has lost it; so every function
here takes m1. Parameters follow Abramowitz & Stegun: m = k^2.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from springgym.theory.frames import Floats


class Jacobi(NamedTuple):
    """sn, cn and dn of an argument u = 2 K turns + r with |r| <= K, all of u's shape."""

    sn: Floats
    cn: Floats
    dn: Floats
    turns: Floats


def complete_k(m1: float) -> float:
    """Return the complete elliptic integral K; infinite at m1 = 0."""
    from scipy.special import ellipkm1

    return float(ellipkm1(m1))


def incomplete_f(sine: float, cosine: float, m1: float) -> float:
    """Return F(x | m) of tan x = sine / cosine, cosine >= 0, by Carlson's R_F (DLMF 19.25.5)."""
    from scipy.special import elliprf

    size = math.hypot(sine, cosine)
    s = sine / size
    c = cosine / size
    return float(s * elliprf(c * c, c * c + m1 * s * s, 1.0))


def jacobi(u: Floats, m1: float) -> Jacobi:
    """Return sn, cn, dn of u, first reduced to |r| <= K so that turns do not cost accuracy.

    For m1 >= 0.1 by SciPy; below it as sums over poles, dn = (pi/2K') sum sech(pi (r - 2nK)/2K')
    and likewise cn and sn with alternating signs of sech and tanh (DLMF 22.12 through Jacobi's
    imaginary transformation, DLMF 22.6), which keep cn and dn to relative accuracy where they are
    small.
    """
    from scipy.special import ellipj

    quarter = complete_k(m1)
    turns = np.rint(u / (2 * quarter))
    r = u - 2 * quarter * turns if m1 > 0 else u
    parity = 1 - 2 * np.mod(turns, 2)
    if m1 >= 0.1:
        sn, cn, dn, _ = ellipj(r, 1 - m1)
        return Jacobi(parity * sn, parity * cn, dn, turns)
    scale = math.pi / 2 / complete_k(1 - m1)
    n = np.arange(-8, 9) if m1 > 0 else np.zeros(1)
    x = scale * (r[..., None] - (2 * quarter * n if m1 > 0 else n))
    sign = 1 - 2 * np.mod(n, 2)
    poles = 1 / np.cosh(np.clip(x, -700, 700))
    factor = scale / math.sqrt(1 - m1)
    sn = factor * (np.tanh(x) @ sign)
    cn = factor * (poles @ sign)
    return Jacobi(parity * sn, parity * cn, scale * poles.sum(axis=-1), turns)


def third_kind(functions: Jacobi, m1: float, p: float, q: float) -> Floats:
    """Return the integral from 0 to u of du / (p cn^2 u + q sn^2 u), for p, q > 0.

    It is Pi(n; am u | m) / p with n = 1 - q/p, by Carlson's R_F and R_J (DLMF 19.25.14). For
    p < q it is taken from the other end, K - u, where sn -> cn/dn and cn -> sqrt(m1) sn/dn, so
    that no terms cancel however small p is.
    """
    from scipy.special import elliprf, elliprj

    def carlson(s: Floats, c2: Floats, ratio: float, weight: float) -> Floats:
        d2 = c2 + m1 * s**2
        third = elliprj(c2, d2, 1.0, c2 + ratio * s**2)
        return np.asarray(s * (elliprf(c2, d2, 1.0) + weight / 3 * s**2 * third))

    parity = 1 - 2 * np.mod(functions.turns, 2)
    s = parity * functions.sn
    c2 = functions.cn**2
    end = np.ones(()), np.zeros(())
    if p >= q or m1 == 0:
        part = carlson(s, c2, q / p, 1 - q / p) / p
        whole = carlson(*end, q / p, 1 - q / p) / p if functions.turns.any() else 0.0
    else:
        ratio = m1 * p / q
        weight = m1 * (1 - p / q)
        whole = carlson(*end, ratio, weight) / q
        other = np.abs(functions.cn) / functions.dn, m1 * (s / functions.dn) ** 2
        part = np.sign(s) * (whole - carlson(*other, ratio, weight) / q)
    return np.asarray(part + 2 * functions.turns * whole)
