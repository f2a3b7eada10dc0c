"""Level of detail of the terrain: away from the road, squares of several cells are drawn instead of single ones."""

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import zoom

from pilot.arrays import Floats

Sizes = NDArray[np.int64]

SIZES = (2, 4, 8)  # cells per side of the larger squares
LARGEST = SIZES[-1]
AWAY = 10.0  # metres between the road and the nearest square, per cell of its side: all look about equally large


def square_sizes(away: Floats) -> Sizes:
    """Choose for each cell of a grid the size of the square that it belongs to, in cells per side: 1, 2, 4 or 8.

    Args:
        away: distance of the grid's points from the road, metres, rows x columns; both are a multiple of 8, plus 1.
    """
    nearest = np.minimum.reduce([away[:-1, :-1], away[:-1, 1:], away[1:, :-1], away[1:, 1:]])
    sizes = np.ones(nearest.shape, np.int64)
    for size in SIZES:
        far = _blocks(nearest, size).min(axis=(1, 3)) > AWAY * size
        sizes[_repeated(far, size)] = size
    return sizes


def flattened(heights: Floats, sizes: Sizes) -> Floats:
    """Return the heights (rows x columns) with all points of a larger square on the surface between its corners.

    This closes the gaps between a square and smaller neighbours.
    """
    flat = heights
    for size in reversed(SIZES):
        corners = flat[::size, ::size]
        between = zoom(corners, np.array(flat.shape) / corners.shape, order=1)
        large = np.pad(sizes == size, 1)
        inside = large[:-1, :-1] | large[:-1, 1:] | large[1:, :-1] | large[1:, 1:]
        flat = np.where(inside, between, flat)
    return flat


def corners_of_squares(grid: Floats, sizes: Sizes, size: int) -> Floats:
    """Return the values of a grid (rows x columns x k) at the corners of all squares of a size: n x 4 x k."""
    coarse = grid[::size, ::size]
    cells = [coarse[:-1, :-1], coarse[:-1, 1:], coarse[1:, 1:], coarse[1:, :-1]]
    return np.stack([values[sizes[::size, ::size] == size] for values in cells], axis=1)


def _blocks(cells: Floats, size: int) -> Floats:
    """Return cells (rows x columns) by squares: rows of squares x size x columns of squares x size."""
    rows, columns = cells.shape
    return cells.reshape(rows // size, size, columns // size, size)


def _repeated(values: NDArray[np.bool_], size: int) -> NDArray[np.bool_]:
    return values.repeat(size, axis=0).repeat(size, axis=1)
