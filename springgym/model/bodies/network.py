"""Masses and springs that give a network of particles the properties of an elastic solid.

Everything is of unit density and Young's modulus, in any unit of length.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from springgym.checks import instance, refusing_unknown
from springgym.model.bodies.body import Body, rigid_ways, rigidity_matrix
from springgym.theory.solid import Rule

REACHED = 1e-6
"""Relative error of frequency and growths at which a calibration ends."""

ITERATIONS = 80
"""Largest number of steps of a calibration."""


class Network(NamedTuple):
    """Particles and springs of a body, of unit density and in any unit of length."""

    positions: np.ndarray
    """(N, 3) positions of the particles"""
    masses: np.ndarray
    """(N,) masses of the particles"""
    springs: np.ndarray
    """(S, 2) the particles at the ends of each spring"""


# --- Masses -----------------------------------------------------------------------------------------


def moment_masses(positions: np.ndarray, rule: Rule) -> np.ndarray | None:
    """Return positive masses (N,) with a solid's volume, centre and second moments; None if there are none.

    Of all such masses, those with the largest product, the most even ones, are chosen. With the ten
    conditions A m = b the maximum of Σ ln m is m = 1/(Aᵀλ), where λ minimises the convex function bᵀλ − Σ ln
    Aᵀλ, found by Newton's method with the damping 1/(1 + decrement) of Nesterov & Nemirovskii.
    """
    volume = float(rule.weights.sum())
    centre = rule.weights @ rule.points / volume
    arm = rule.points - centre
    second = (rule.weights * arm.T) @ arm / volume
    size = float(np.abs(positions - centre).max())
    r = (positions - centre) / size
    upper = np.triu_indices(3)
    conditions = np.vstack([np.ones(len(r)), r.T, (r[:, upper[0]] * r[:, upper[1]]).T])
    wanted = np.array([1.0, 0.0, 0.0, 0.0, *second[upper] / size**2])
    multipliers = np.zeros(10)
    multipliers[0] = len(r)
    for _ in range(100):
        slack = multipliers @ conditions
        gradient = wanted - conditions @ (1 / slack)
        curvature = (conditions / slack**2) @ conditions.T
        step = np.linalg.lstsq(curvature, gradient, rcond=1e-13)[0]
        decrement = math.sqrt(max(0.0, float(gradient @ step)))
        multipliers = multipliers - step / (1 + decrement if decrement > 0.25 else 1.0)
        if decrement < 1e-13:
            break
    masses = 1 / (multipliers @ conditions)
    met = np.abs(conditions @ masses - wanted).max() < 1e-12
    return volume * masses if met and masses.min() > 1e-3 / len(masses) else None


def second_moments(network: Network) -> np.ndarray:
    arm = network.positions - network.masses @ network.positions / network.masses.sum()
    return np.asarray((network.masses * arm.T) @ arm)


# --- Springs ----------------------------------------------------------------------------------------


def orbits(network: Network, symmetries: Sequence[np.ndarray]) -> np.ndarray:
    """Return numbers (S,) of groups of springs that symmetries of the body map onto one another.

    Orthogonal matrices that do not map particles to particles and springs to springs are left out.
    """
    arm = network.positions - network.masses @ network.positions / network.masses.sum()
    tiny = 1e-9 * np.abs(arm).max()
    index = {pair: n for n, pair in enumerate(map(tuple, np.sort(network.springs).tolist()))}
    lowest = np.arange(len(network.springs))
    for symmetry in symmetries:
        apart = np.linalg.norm((arm @ symmetry.T)[:, None] - arm, axis=2)
        image = apart.argmin(axis=1)
        if apart.min(axis=1).max() > tiny:
            continue
        mapped = [index.get((min(p), max(p)), -1) for p in image[network.springs].tolist()]
        if -1 in mapped:
            continue
        while True:
            lower = np.minimum(lowest, lowest[mapped])
            np.minimum.at(lower, mapped, lowest)
            if (lower == lowest).all():
                break
            lowest = lower
    return np.unique(lowest, return_inverse=True)[1]


class Response(NamedTuple):
    """The response of a network: its free vibrations, and its growth under spin."""

    squares: np.ndarray
    """(3N − 6,) ω², ascending"""
    elongation: np.ndarray
    """(S, 3N − 6) elongation of each spring in each vibration, of unit ½ Σ m v² at unit frequency"""
    stretch: np.ndarray
    """(3,) s"""
    spun: np.ndarray
    """(3, S) 2 e²/I, e the elongation under unit ω: −∂s/∂k"""
    moved: np.ndarray
    """(3, N, 3) displacements of the particles by the centrifugal force of a spin ω = 1 about each axis,
    relative to the centre of mass"""


def response(network: Network, stiffness: np.ndarray, axes: np.ndarray) -> Response:
    """Return vibrations of a network, and its growth under spin about some axes, columns (3, 3)."""
    positions, masses, springs = network
    root = np.sqrt(np.repeat(masses, 3))
    squares, modes, elongation = _modes(network, stiffness, 6)
    arm = positions - masses @ positions / masses.sum()
    stretch = np.zeros(3)
    spun = np.zeros((3, len(springs)))
    moved = np.zeros((3, *positions.shape))
    for n, axis in enumerate(axes.T):
        across = arm - np.outer(arm @ axis, axis)
        load = modes.T @ (root * across.ravel())
        inertia = np.sum(masses[:, None] * across**2)
        stretch[n] = 2 * np.sum(load**2 / squares) / inertia
        spun[n] = 2 * (elongation @ (load / squares)) ** 2 / inertia
        moved[n] = (modes @ (load / squares) / root).reshape(positions.shape)
    return Response(squares, elongation, stretch, spun, moved)


def _modes(network: Network, stiffness: np.ndarray, rigid: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return ω² (q,), ascending, modes √m u (3N, q) of unit length, and elongations of springs (S, q).

    The first ``rigid`` modes are left out: they are the rigid motions, with ω = 0.
    """
    positions, masses, springs = network
    root = np.sqrt(np.repeat(masses, 3))
    rigidity = rigidity_matrix(positions, springs).reshape(len(springs), len(root)) / root
    squares, modes = np.linalg.eigh(rigidity.T @ (stiffness[:, None] * rigidity))
    squares = squares[rigid:]
    modes = modes[:, rigid:]
    return squares, modes, rigidity @ modes


def bars(network: Network) -> np.ndarray:
    """Return stiffnesses (S,) of bars of equal section, k ~ 1/L, with Σ k L² = 6 E V, as a first guess."""
    ends = network.positions[network.springs]
    lengths = np.linalg.norm(ends[:, 1] - ends[:, 0], axis=1)
    return np.asarray(6 * network.masses.sum() / lengths.sum() / lengths)


def calibrated(
    network: Network,
    axes: np.ndarray,
    frequency: float,
    stretch: np.ndarray,
    groups: np.ndarray,
    begin: np.ndarray,
    reluctance: np.ndarray | float = 1.0,
) -> np.ndarray:
    """Return stiffnesses (S,) that give a network the lowest frequency and the growth under spin of a solid.

    In each step, groups of springs change by the smallest fractions that meet the linearised conditions: ln
    ω_q = ln ω₁ for the lowest mode and for all below ω₁, with ∂ ln ω_q²/∂ ln k = k e²/ω_q², and ln s = that
    of the solid for three axes, with ∂ ln s/∂ ln k = −2 k e²/(I s), e being elongations. Stiffnesses stay
    positive.

    Parameters
    ----------
    network
        The network, of unit density and Young's modulus.
    axes
        (3, 3) axes of spin, columns.
    frequency, stretch
        ω₁ and s (3,) of the solid.
    groups
        (S,) numbers, from 0, of springs that keep the ratio of their stiffnesses.
    begin
        (S,) initial stiffnesses.
    reluctance
        (S,) weights of the squares of their changes.

    Returns
    -------
    stiffness
        The best stiffnesses found; the caller has to check their error.
    """
    weights = np.bincount(groups, np.broadcast_to(reluctance, groups.shape))
    stiffness = best = begin
    least = math.inf
    for iteration in range(ITERATIONS):
        now = response(network, stiffness, axes)
        ratios = now.stretch / stretch
        gap = missed(math.sqrt(now.squares[0]) / frequency, ratios)
        if gap < 0.98 * least:  # a smaller gain is not worth stiffer springs, and so smaller steps
            best = stiffness
            least = gap
        if least < REACHED:
            break
        lowest = max(frequency**2, now.squares[0] * (1 + 1e-6))  # with all of a degenerate lowest mode
        modes = np.flatnonzero(now.squares < lowest)
        share = stiffness[:, None] * now.elongation[:, modes] ** 2 / now.squares[modes]
        rows = np.vstack([share.T / 2, -stiffness * now.spun / now.stretch[:, None]])
        gaps = np.concatenate([np.log(frequency**2 / now.squares[modes]) / 2, -np.log(ratios)])
        jacobian = np.array([np.bincount(groups, row) for row in rows]) / np.sqrt(weights)
        normal = jacobian @ jacobian.T
        ridge = max(0.03 * 0.8**iteration, 1e-3) * np.trace(normal) / len(normal)
        change = jacobian.T @ np.linalg.solve(normal + ridge * np.eye(len(normal)), gaps) / np.sqrt(weights)
        change *= min(1.0, 0.5 / np.abs(change).max(initial=1e-300))
        stiffness = stiffness * np.exp(change[groups])
    return best


def missed(frequency_ratio: float, stretch_ratios: np.ndarray) -> float:
    """Return the error of a network: |ln| of its frequency ratio, plus the mean |ln| of the growths."""
    return float(abs(math.log(frequency_ratio)) + np.abs(np.log(stretch_ratios)).mean())


@refusing_unknown
def vibrations(body: Body) -> tuple[np.ndarray, np.ndarray]:
    """Return the free vibrations of a body about its unstretched shape, without rigid motion.

    Returns
    -------
    frequencies
        (q,) [rad/s], ascending: q = 3N − 6 or, of a pair of particles, 1, and of a single one 0.
    modes
        (q, N, 3) displacements with Σ m u² = 1 kg·m².

    Raises
    ------
    TypeError
        If it is not a body.
    ValueError
        If the body is floppy.
    """
    if instance("body", body, Body).floppy:
        raise ValueError(f"body {body.name!r} is floppy: it does not vibrate about its shape")
    rigid = rigid_ways(body.positions)
    network = Network(body.positions, body.masses, body.springs)
    squares, modes, _ = _modes(network, body.stiffness, rigid)
    shapes = (modes / np.sqrt(np.repeat(body.masses, 3))[:, None]).T.reshape(-1, *body.positions.shape)
    return np.sqrt(squares), shapes
