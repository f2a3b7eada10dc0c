"""Smooth random fields for terrain and textures."""

import cv2
import numpy as np
from numpy.typing import NDArray


def smooth_noise(
    random: np.random.Generator, rows: int, columns: int, cells: int, octaves: int = 4
) -> NDArray[np.float64]:
    """Generate a periodic random field (rows x columns) with values of about -1..1.

    Args:
        random: source of randomness.
        rows, columns: size of the field.
        cells: random values along the longer side in the coarsest octave.
        octaves: number of octaves; each has half the wavelength and half the amplitude of the previous one.
    """
    field = np.zeros((rows, columns))
    for octave in range(octaves):
        down = max(cells * 2**octave * rows // max(rows, columns), 1)
        across = max(cells * 2**octave * columns // max(rows, columns), 1)
        coarse = np.pad(random.uniform(-1, 1, (down, across)), 2, mode="wrap")
        map_y = (np.arange(rows, dtype=np.float32) + 0.5) * down / rows + 1.5
        map_x = (np.arange(columns, dtype=np.float32) + 0.5) * across / columns + 1.5
        grid_x, grid_y = np.meshgrid(map_x, map_y)
        field += 0.5**octave * cv2.remap(coarse.astype(np.float32), grid_x, grid_y, cv2.INTER_CUBIC)
    return field
