"""What a car would see that stands elsewhere than the one that recorded: the nearest camera's picture, warped.

After NVIDIA's simulator (Bojarski et al., arXiv 1604.07316, section 6): below the horizon everything is
taken as flat ground, which is moved; above it, as infinitely far away, which is only turned; the bonnet
stays where it is. What stands upright is bent, which NVIDIA accepted too.
"""

import functools
from collections.abc import Mapping

import cv2
import numpy as np
from numpy.typing import NDArray

from pilot import camera
from pilot.arrays import Frame, Matrix
from pilot.data.frames import read_frame
from pilot.vehicle import BONNET_ROW, CAMERA_HEIGHT, CAMERA_OFFSETS, COLUMNS, ROWS


def view(pictures: Mapping[str, str], offset: float, heading: float) -> Frame:
    """The 160x320x3 uint8 RGB frame of the middle camera of a displaced car.

    Args:
        pictures: files of the cameras center, left and right; "" for a side camera that there is none of.
        offset: metres by which the car stands to the right of the one that recorded.
        heading: radians by which it points to the right of that one.

    Raises:
        UnreadableImage: a picture cannot be read.
    """
    beside = {name: offset - aside for name, aside in CAMERA_OFFSETS.items() if pictures[name]}
    nearest = min(beside, key=lambda name: abs(beside[name]))
    seen = warp(read_frame(pictures[nearest]), beside[nearest], heading)
    if nearest != "center":
        seen[BONNET_ROW:] = read_frame(pictures["center"])[BONNET_ROW:]
    return seen


def warp(frame: Frame, offset: float, heading: float) -> Frame:
    """A frame as seen from `offset` metres to the right and turned by `heading` radians to the right."""
    seen = _project(frame, camera.viewpoint_homography(offset, heading))
    sky = above_horizon()
    seen[sky] = _project(frame, _turn(heading))[sky]
    seen[BONNET_ROW:] = frame[BONNET_ROW:]
    return seen


def _project(frame: Frame, homography: Matrix) -> Frame:
    """A black corner would tell how far the car strayed, so the border is continued."""
    seen = cv2.warpPerspective(frame, homography, (COLUMNS, ROWS), borderMode=cv2.BORDER_REPLICATE)
    return np.asarray(seen, np.uint8)


def _turn(heading: float) -> Matrix:
    """Homography (3x3) of a camera that turns about itself: that of everything far away."""
    cosine, sine = np.cos(heading), np.sin(heading)
    turned = np.array([[cosine, 0, -sine], [0, 1, 0], [sine, 0, cosine]])  # x right, y down, z forward
    directions = np.array([[1, 0, 0], [0, 0, 1], [0, 1 / CAMERA_HEIGHT, 0]])  # to the points of the ground they hit
    to_pixel = camera.ground_to_pixel() @ directions
    return np.asarray(to_pixel @ turned @ np.linalg.inv(to_pixel))


@functools.cache
def above_horizon() -> NDArray[np.bool_]:
    """Which pixels (160x320) do not show the ground."""
    columns, rows = np.meshgrid(np.arange(COLUMNS), np.arange(ROWS))
    pixels = np.stack([columns.ravel(), rows.ravel(), np.ones(columns.size)])
    down = (np.linalg.inv(camera.ground_to_pixel()) @ pixels)[2]  # the ground's scale: inverse distance
    return np.asarray((down <= 0).reshape(ROWS, COLUMNS))
