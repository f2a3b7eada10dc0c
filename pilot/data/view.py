"""Views of recorded frames: a homography of the pixels and the corresponding label."""

from dataclasses import dataclass, field

import cv2
import numpy as np
from numpy.typing import NDArray

from pilot.arrays import Floats, Frame, Matrix
from pilot.vehicle import COLUMNS

# Rows that report 004's networks use: the mean of its random crops (40 % of the height at the top, 12.5 % below).
CROP_TOP, CROP_BOTTOM = 64, 140
IDENTITY: Matrix = np.eye(3)
MIRROR: Matrix = np.array([[-1.0, 0, COLUMNS - 1], [0, 1, 0], [0, 0, 1]])


@dataclass(frozen=True)
class View:
    """A view of one frame, or views of n frames.

    Attributes:
        steering: the label (-1..1): a number, or an array of n.
        homography: maps the recorded frame's pixels to those of the view: 3x3, or n x 3 x 3.
        metres: way along the driver's path from the place for which displacements are drawn to that of the frame, or
            of the label: not 0 for earlier frames (then negative) and for the steering of later.
    """

    steering: float | Floats
    homography: Matrix = field(default_factory=lambda: IDENTITY)
    metres: float | Floats = 0.0

    def transformed(self, homography: Matrix, steering: float | Floats) -> "View":
        """Return the view after another homography, with a new label."""
        return View(steering, homography @ self.homography, self.metres)

    def where(self, chosen: NDArray[np.bool_], other: "View") -> "View":
        """Return these views where `chosen` (n booleans) is true, and those of `other` elsewhere."""
        homography = np.where(chosen[:, None, None], self.homography, other.homography)
        return View(np.where(chosen, self.steering, other.steering), homography, self.metres)


def render(frame: Frame, homography: Matrix, rows: tuple[int, int], first_row: int = 0) -> Frame:
    """Render rows of a view: (rows[1] - rows[0]) x 320 x 3, uint8 RGB; always a copy.

    Args:
        frame: 160x320x3, uint8 RGB, or the range of its rows given by `rows_needed`.
        homography: homography of the view, 3x3.
        rows: first row to render, and the one after the last, counted in the whole frame.
        first_row: row of the whole frame with which `frame` begins.
    """
    top, bottom = rows
    if np.array_equal(homography, IDENTITY):
        return frame[top - first_row : bottom - first_row].copy()
    if np.array_equal(homography, MIRROR):  # the most frequent homography, faster without a warp
        return np.asarray(cv2.flip(frame[top - first_row : bottom - first_row], 1), np.uint8)
    size = (COLUMNS, bottom - top)
    matrix = from_rows(homography, first_row, top)
    if np.array_equal(matrix[2], [0, 0, 1]):  # a little faster than the perspective warp
        return np.asarray(cv2.warpAffine(frame, matrix[:2], size), np.uint8)
    # the border is replicated, because black corners would reveal to the network how far the viewpoint was shifted
    return np.asarray(cv2.warpPerspective(frame, matrix, size, borderMode=cv2.BORDER_REPLICATE), np.uint8)


def from_rows(homographies: Matrix, first_row: int, top: int) -> Matrix:
    """Convert whole frames' homographies to map from images that begin at `first_row` to ones that begin at `top`."""
    lift, lower = np.eye(3), np.eye(3)
    lift[1, 2], lower[1, 2] = -top, first_row
    return np.asarray(lift @ homographies @ lower)
