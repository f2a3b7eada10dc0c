"""View synthesis for replays: the frame of a displaced car, warped from the nearest camera's image.

As in NVIDIA's simulator (Bojarski et al., arXiv 1604.07316, section 6), everything below the horizon is assumed to be
flat ground, which is shifted and rotated; everything above it to be infinitely far away, which is only rotated. The
bonnet is not changed. Upright objects are distorted, as in NVIDIA's simulator.
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
    """Return the frame (160x320x3 uint8 RGB) of a displaced car's centre camera.

    Args:
        pictures: image files by camera (center, left, right); "" for a side camera without an image.
        offset: metres by which the car is to the right of the recorded car.
        heading: radians by which it is turned to the right relative to the recorded car.

    Raises:
        UnreadableImage: an image cannot be read.
    """
    beside = {name: offset - aside for name, aside in CAMERA_OFFSETS.items() if pictures[name]}
    nearest = min(beside, key=lambda name: abs(beside[name]))
    seen = warp(read_frame(pictures[nearest]), beside[nearest], heading)
    if nearest != "center":
        seen[BONNET_ROW:] = read_frame(pictures["center"])[BONNET_ROW:]
    return seen


def warp(frame: Frame, offset: float, heading: float) -> Frame:
    """Warp a frame to a car that is shifted by `offset` metres and turned by `heading` radians, both to the right."""
    seen = _project(frame, camera.viewpoint_homography(offset, heading))
    sky = above_horizon()
    seen[sky] = _project(frame, _turn(heading))[sky]
    seen[BONNET_ROW:] = frame[BONNET_ROW:]
    return seen


def _project(frame: Frame, homography: Matrix) -> Frame:
    """Apply a homography; the border is replicated, because black corners would reveal the displacement."""
    seen = cv2.warpPerspective(frame, homography, (COLUMNS, ROWS), borderMode=cv2.BORDER_REPLICATE)
    return np.asarray(seen, np.uint8)


def _turn(heading: float) -> Matrix:
    """Return the homography (3x3) of a camera that rotates about its centre: exact for distant points."""
    cosine, sine = np.cos(heading), np.sin(heading)
    turned = np.array([[cosine, 0, -sine], [0, 1, 0], [sine, 0, cosine]])  # x right, y down, z forward
    directions = np.array([[1, 0, 0], [0, 0, 1], [0, 1 / CAMERA_HEIGHT, 0]])  # to ground coordinates, up to scale
    to_pixel = camera.ground_to_pixel() @ directions
    return np.asarray(to_pixel @ turned @ np.linalg.inv(to_pixel))


@functools.cache
def above_horizon() -> NDArray[np.bool_]:
    """Return a mask (160x320) of the pixels that do not show the ground."""
    columns, rows = np.meshgrid(np.arange(COLUMNS), np.arange(ROWS))
    pixels = np.stack([columns.ravel(), rows.ravel(), np.ones(columns.size)])
    down = (np.linalg.inv(camera.ground_to_pixel()) @ pixels)[2]  # proportional to the inverse distance
    return np.asarray((down <= 0).reshape(ROWS, COLUMNS))
