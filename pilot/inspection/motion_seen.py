"""Motion that the images themselves show, independently of the log: turns of the car, and how much changes."""

from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np

from pilot.arrays import Floats
from pilot.data.frames import read_frame
from pilot.progress import ProgressBar, no_bar
from pilot.vehicle import COLUMNS, FOCAL_LENGTH

FAR = slice(30, 70)  # rows with the horizon, where a turn shifts everything alike; nearer things also come closer
SMALL = (80, 40)  # columns and rows to which images are reduced before they are compared


@dataclass(frozen=True)
class MotionSeen:
    """What n images show; each array has one entry per row.

    Attributes:
        turns: angle by which the car turned to the right since the row before, radians; 0 in the first row.
        changes: mean absolute difference from the image before, 0..255; infinite in the first row.
    """

    turns: Floats
    changes: Floats


def see_motion(images: Sequence[str], progress: ProgressBar[str] = no_bar) -> MotionSeen:
    """Look at the images of the centre camera, in the order of recording.

    The turn is the horizontal shift of the horizon, found by phase correlation (C. D. Kuglin and D. C. Hines, The Phase
    Correlation Image Alignment Method, 1975).

    Raises:
        UnreadableImage: an image cannot be read.
    """
    window = cv2.createHanningWindow((COLUMNS, FAR.stop - FAR.start), cv2.CV_64F)
    turns, changes = np.zeros(len(images)), np.full(len(images), np.inf)
    far_before: Floats = np.empty(0)
    small_before: Floats = np.empty(0)
    for row, path in enumerate(progress(images, len(images), "looking at the images")):
        grey = cv2.cvtColor(read_frame(path), cv2.COLOR_RGB2GRAY)
        far: Floats = grey[FAR].astype(float)
        small: Floats = cv2.resize(grey, SMALL, interpolation=cv2.INTER_AREA).astype(float)
        if row:
            (shift, _), _ = cv2.phaseCorrelate(far_before, far, window)
            turns[row] = -shift / FOCAL_LENGTH
            changes[row] = np.abs(small - small_before).mean()
        far_before, small_before = far, small
    return MotionSeen(turns, changes)
