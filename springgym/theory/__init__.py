"""Analytical and reference solutions against which the simulator is tested.

Every module is plain functions of floats and arrays in SI units, z up, with the equation, the
units and the source in each docstring. Arguments are checked by `springgym.checks`; nothing else of springgym
is imported here. Importing it needs only NumPy; functions that need SciPy import it when called.

=============  ==================================================================================
`top`          heavy symmetric (Lagrange) top with one point fixed
`free_body`    Euler's torque-free asymmetric body
`pendulum`     physical pendulum at any amplitude; the cube hung from a vertex
`rope`         hanging chain of beads and springs: statics, swing, bounce, catenary
`contact`      inverse-square floor, restitution, Coulomb friction
`impact`       a body of springs that hits a floor
`dominoes`     the wave in a row of falling dominoes
`oscillation`  damped oscillator, spin-stretched pair, spin-down of implicit Euler
`rolling`      balls, a tippe-top, a rattleback and Euler's disk that roll
`solid`        elastic solids: inertia, free vibration, growth under spin (Rayleigh-Ritz)
`frames`       Euler angles to frames, and particles carried by a frame
=============  ==================================================================================
"""

from springgym.theory import (
    contact,
    dominoes,
    frames,
    free_body,
    impact,
    oscillation,
    pendulum,
    rolling,
    rope,
    solid,
    top,
)

__all__ = [
    "contact",
    "dominoes",
    "frames",
    "free_body",
    "impact",
    "oscillation",
    "pendulum",
    "rolling",
    "rope",
    "solid",
    "top",
]
