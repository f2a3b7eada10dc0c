"""Type aliases for the arrays that modules exchange, and arithmetic that several of them need."""

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]
Matrix = NDArray[np.float64]  # 3x3, or n x 3 x 3
Frame = NDArray[np.uint8]  # 160x320x3 RGB as the simulator sends it, or a range of its rows


def sums_before(amounts: Floats) -> Floats:
    """Return the exclusive cumulative sum: for each of n entries the sum of those before it (n)."""
    return np.concatenate([[0.0], np.cumsum(amounts)[:-1]])
