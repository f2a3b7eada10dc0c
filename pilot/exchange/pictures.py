"""Images of other projects as frames."""

from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from pilot.arrays import Frame
from pilot.vehicle import COLUMNS, ROWS


def as_frame(image: NDArray[Any]) -> Frame:
    """Return an RGB image (uint8) as a frame of 160x320: cropped to 2:1 about its middle, and resized."""
    rows, columns = image.shape[:2]
    height, width = min(rows, columns // 2), min(columns, 2 * rows)
    top, left = (rows - height) // 2, (columns - width) // 2
    cropped = image[top : top + height, left : left + width]
    if cropped.shape[:2] == (ROWS, COLUMNS):
        return np.ascontiguousarray(cropped, np.uint8)
    return np.asarray(cv2.resize(cropped, (COLUMNS, ROWS), interpolation=cv2.INTER_AREA), np.uint8)
