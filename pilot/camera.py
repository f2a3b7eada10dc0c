"""Geometry of the simulator's car and camera: projection of the road, and homographies between poses of the car.

Car coordinates are x right, z forward, in metres; headings are in radians, positive to the right. The road is assumed
to be flat, so that images of it from two poses are related by a homography. The constants are defined in vehicle.py.
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
    """Return the 3x3 matrix of nine entries in row-major order; n x 3 x 3 if some entries are arrays of length n."""
    stacked = np.stack(np.broadcast_arrays(*entries), -1)
    return stacked.reshape(*stacked.shape[:-1], 3, 3).astype(float)


@functools.cache
def ground_to_pixel() -> Matrix:
    """Return the homography (3x3) from ground coordinates (x, z, 1), relative to the camera, to pixels (u, v, 1)."""
    intrinsics = np.array([[FOCAL_LENGTH, 0, COLUMNS / 2], [0, FOCAL_LENGTH, ROWS / 2], [0, 0, 1]])
    road_in_camera = np.array([[1, 0, 0], [0, 0, CAMERA_HEIGHT], [0, 1, 0]])  # camera axes: y points down
    return np.asarray(intrinsics @ camera_rotation() @ road_in_camera)


def viewpoint_homography(offset: float | Floats, heading: float | Floats) -> Matrix:
    """Return the homography from a frame's pixels to those seen from a displaced car; valid below the horizon.

    Args:
        offset: lateral displacement of the car's rear axle in metres, positive to the right.
        heading: rotation of the car in radians, positive to the right.

    Returns:
        3x3; n x 3 x 3 if the arguments are arrays of length n.
    """
    sine, cosine = np.sin(heading), np.cos(heading)
    move = matrices(cosine, -sine, -cosine * offset, sine, cosine, -sine * offset, 0, 0, 1)
    from_axle, to_axle = _axle_to_pixel()
    return np.asarray(from_axle @ move @ to_axle)


@functools.cache
def _axle_to_pixel() -> tuple[Matrix, Matrix]:
    """Return the homography from ground coordinates relative to the rear axle to pixels, and its inverse."""
    from_axle = ground_to_pixel() @ matrices(1, 0, 0, 0, 1, -CAMERA_AHEAD_OF_REAR_AXLE, 0, 0, 1)
    return from_axle, np.asarray(np.linalg.inv(from_axle), float)


def path_pixels(steering: float, length: float = 25.0, lateral: float = 0.0) -> Matrix:
    """Return the car's path for a constant steering as it appears in the frame: n x 2 pixels (column, row).

    Args:
        steering: -1..1; constant, so that the path is an arc.
        length: length of the path in metres, from the rear axle.
        lateral: distance in metres from the car's longitudinal axis, positive to the right, for the path of a wheel.
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
    """Return the rotation (3x3) from level axes (x right, y down, z forward) to those of the tilted camera."""
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
