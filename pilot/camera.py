"""The simulator's camera and car as geometry: what the road looks like from another pose.

Car axes: x right, z forward, metres; headings in radians, positive to the right. The road is taken
as flat, so a picture of it from one pose maps onto that from another by a homography.
The figures of the car and its cameras stand in vehicle.py.
"""

import functools
import math
from typing import TypeVar

import numpy as np

from pilot.arrays import Floats, Matrix
from pilot.vehicle import (
    CAMERA_AHEAD_OF_REAR_AXLE,
    CAMERA_HEIGHT,
    COLUMNS,
    FOCAL_LENGTH,
    PITCH,
    ROLL,
    ROWS,
    YAW,
    steering_to_curvature,
)

Number = TypeVar("Number", float, Floats)


def matrices(*entries: float | Floats) -> Matrix:
    """A 3x3 matrix of nine numbers, row by row; n x 3 x 3 where some of them are arrays of n."""
    stacked = np.stack(np.broadcast_arrays(*entries), -1)
    return stacked.reshape(*stacked.shape[:-1], 3, 3).astype(float)


@functools.cache
def ground_to_pixel() -> Matrix:
    """Homography (3x3) from road coordinates (x right, z forward of the camera, 1) to pixels (u, v, 1)."""
    intrinsics = np.array([[FOCAL_LENGTH, 0, COLUMNS / 2], [0, FOCAL_LENGTH, ROWS / 2], [0, 0, 1]])
    road_in_camera = np.array([[1, 0, 0], [0, 0, CAMERA_HEIGHT], [0, 1, 0]])  # camera axes: y points down
    return np.asarray(intrinsics @ camera_rotation() @ road_in_camera)


def viewpoint_homography(offset: float | Floats, heading: float | Floats) -> Matrix:
    """Homography (3x3) from a frame's pixels to those seen by a displaced car; valid below the horizon.

    Args:
        offset: metres by which the car (its rear axle) stands to the right of where it was.
        heading: radians by which it points to the right of where it pointed. Of arrays of n: n x 3 x 3.
    """
    sine, cosine = np.sin(heading), np.cos(heading)
    move = matrices(cosine, -sine, -cosine * offset, sine, cosine, -sine * offset, 0, 0, 1)
    from_axle, to_axle = _axle_to_pixel()
    return np.asarray(from_axle @ move @ to_axle)


@functools.cache
def _axle_to_pixel() -> tuple[Matrix, Matrix]:
    """Homography from road coordinates at the rear axle to pixels, and back."""
    from_axle = ground_to_pixel() @ matrices(1, 0, 0, 0, 1, -CAMERA_AHEAD_OF_REAR_AXLE, 0, 0, 1)
    return from_axle, np.asarray(np.linalg.inv(from_axle), float)


def path_pixels(steering: float, length: float = 25.0, lateral: float = 0.0) -> Matrix:
    """Where the car's path for a steering (-1..1) lies in its own frame: n x 2 pixels (column, row).

    Args:
        steering: held for the whole path, which is then an arc.
        length: metres, from the rear axle.
        lateral: metres to the right of the middle of the car, for the path of a wheel.
    """
    curvature = steering_to_curvature(steering)
    distance = np.linspace(CAMERA_AHEAD_OF_REAR_AXLE + 2.0, length, 40)
    angle = distance * curvature
    turn = np.sinc(angle / np.pi) * distance  # sin(angle) / curvature, also for a curvature of 0
    aside = np.sinc(angle / 2 / np.pi) * np.sin(angle / 2) * distance  # (1 - cos(angle)) / curvature
    ground = np.stack([aside + lateral * np.cos(angle), turn - lateral * np.sin(angle) - CAMERA_AHEAD_OF_REAR_AXLE])
    pixels = ground_to_pixel() @ np.vstack([ground, np.ones_like(distance)])
    ahead = pixels[2] > 0.5
    return np.asarray((pixels[:2, ahead] / pixels[2, ahead]).T)


def camera_rotation() -> Matrix:
    """Rotation (3x3) from level axes (x right, y down, z forward) to the tilted camera's."""
    pitch = _rotation(0, PITCH)
    yaw = _rotation(1, -YAW)
    roll = _rotation(2, -ROLL)
    return roll @ pitch @ yaw


def _rotation(axis: int, angle: float) -> Matrix:
    first, second = (axis + 1) % 3, (axis + 2) % 3
    matrix = np.eye(3)
    matrix[first, first] = matrix[second, second] = math.cos(angle)
    matrix[first, second], matrix[second, first] = -math.sin(angle), math.sin(angle)
    return matrix
