"""The transfer function of sRGB, between colours as they are stored and amounts of light, both from 0 to 1.

See IEC 61966-2-1, or https://www.w3.org/TR/css-color-4/#color-conversion-code.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray


def to_light(stored: ArrayLike) -> NDArray[np.float64]:
    """Return the amounts of light of stored values."""
    values = np.asarray(stored, float)
    return np.where(values <= 0.04045, values / 12.92, ((values + 0.055) / 1.055) ** 2.4)


def from_light(light: ArrayLike) -> NDArray[np.float64]:
    """Return the stored values of amounts of light."""
    amounts = np.asarray(light, float)
    return np.where(amounts <= 0.0031308, 12.92 * amounts, 1.055 * amounts ** (1 / 2.4) - 0.055)
