"""How a recorded frame is seen: a homography of its pixels, and the steering that goes with what is then seen."""

from dataclasses import dataclass, field

import cv2
import numpy as np
from numpy.typing import NDArray

from pilot.arrays import Floats, Frame, Matrix
from pilot.vehicle import COLUMNS

# Report 004's crops in the mean: its networks look at these rows (40 % cut off above, 12.5 % below).
CROP_TOP, CROP_BOTTOM = 64, 140
IDENTITY: Matrix = np.eye(3)
MIRROR: Matrix = np.array([[-1.0, 0, COLUMNS - 1], [0, 1, 0], [0, 0, 1]])


@dataclass(frozen=True)
class View:
    """How a frame is seen, or n frames are.

    Attributes:
        steering: to learn (-1..1): a number, or n.
        homography: from the recorded frame's pixels to those seen: 3x3, or n x 3 x 3.
    """

    steering: float | Floats
    homography: Matrix = field(default_factory=lambda: IDENTITY)

    def transformed(self, homography: Matrix, steering: float | Floats) -> "View":
        """This view after one more homography, with a new label."""
        return View(steering, homography @ self.homography)

    def where(self, chosen: NDArray[np.bool_], other: "View") -> "View":
        """This view of the chosen frames, another one of the rest."""
        homography = np.where(chosen[:, None, None], self.homography, other.homography)
        return View(np.where(chosen, self.steering, other.steering), homography)


def render(frame: Frame, homography: Matrix, rows: tuple[int, int], first_row: int = 0) -> Frame:
    """The rows `rows[0]..rows[1]-1` of a 160x320x3 frame as a view shows it: a copy, same width.

    Args:
        frame: the frame, or its rows from `first_row` on, of which `rows_needed` says how many are enough.
        homography: 3x3, the view's.
        rows: of the whole frame.
        first_row: of the whole frame.
    """
    top, bottom = rows
    if np.array_equal(homography, IDENTITY):
        return frame[top - first_row : bottom - first_row].copy()
    if np.array_equal(homography, MIRROR):  # the most frequent one, without a warp
        return np.asarray(cv2.flip(frame[top - first_row : bottom - first_row], 1), np.uint8)
    size = (COLUMNS, bottom - top)
    matrix = from_rows(homography, first_row, top)
    if np.array_equal(matrix[2], [0, 0, 1]):  # the same pixels, a little faster
        return np.asarray(cv2.warpAffine(frame, matrix[:2], size), np.uint8)
    # a black corner would tell the network how far the viewpoint was shifted, so the border is continued
    return np.asarray(cv2.warpPerspective(frame, matrix, size, borderMode=cv2.BORDER_REPLICATE), np.uint8)


def from_rows(homographies: Matrix, first_row: int, top: int) -> Matrix:
    """Homographies of whole frames as such from pictures that begin at `first_row` to ones that begin at `top`."""
    lift, lower = np.eye(3), np.eye(3)
    lift[1, 2], lower[1, 2] = -top, first_row
    return np.asarray(lift @ homographies @ lower)
