"""Independent numerics the closed forms are held against."""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
import pytest
from scipy.integrate import solve_ivp


class Reference(NamedTuple):
    omega_body: np.ndarray
    frame: np.ndarray
    error: float


@pytest.fixture(scope="session")
def rigid_reference() -> Callable[..., Reference]:
    """Euler's equations in the body frame with a nine-number frame, by DOP853: no Euler angles.

    `error` is the change of the solution from rtol 1e-11 to 1e-13, plus round-off of 1e-15 a
    radian turned with room for 100 roundings: it bounds the error of the tighter one, sensitivity
    of the motion included.
    """

    def integrate(inertia, torque, omega, frame, times) -> Reference:
        inertia = np.asarray(inertia, float)

        def slope(_, y):
            w = y[:3]
            r = y[3:].reshape(3, 3)
            spin = np.array([[0, -w[2], w[1]], [w[2], 0, -w[0]], [-w[1], w[0], 0]])
            rates = np.empty(12)
            rates[:3] = (r.T @ torque(r) - spin @ (inertia * w)) / inertia
            rates[3:] = (r @ spin).ravel()
            return rates

        start = np.concatenate([omega, np.ravel(frame)])
        span = (0.0, times[-1])
        coarse, fine = (
            solve_ivp(slope, span, start, method="DOP853", rtol=rtol, atol=rtol, t_eval=times).y.T
            for rtol in (1e-11, 1e-13)
        )
        turned = times[-1] * np.linalg.norm(fine[:, :3], axis=1).max()
        error = np.abs(coarse - fine).max() + 1e-13 * turned
        return Reference(fine[:, :3], fine[:, 3:].reshape(-1, 3, 3), error)

    return integrate
