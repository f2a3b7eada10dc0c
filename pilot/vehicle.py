"""The real simulator's car and cameras as figures: the one place where each of them stands.

Read from the simulator's published source and scene, or measured on its client and on real recordings.
Lengths in metres, angles in radians unless a name says degrees; steering is -1..1, positive to the right.
"""

import math
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

Number = TypeVar("Number", float, NDArray[np.float64])

# Clock and units
TICK = 0.02  # s; the simulator's physics run at 50 Hz
MPH = 0.44704  # m/s in a mile per hour

# The car
WHEELBASE = 2.87
HALF_TRACK = 1.0  # from the middle of the car to its wheels
FULL_LOCK_DEGREES = 25.0
FULL_LOCK = math.radians(FULL_LOCK_DEGREES)  # angle of the front wheels at a steering of 1
TOP_SPEED_MPH = 30.0  # a hard cap
REVERSE_BELOW_MPH = 5.0  # a negative throttle brakes above this speed, and drives backwards below
PLAUSIBLE_SPEED_MPH = 200.0  # a larger value in a log or a telemetry message is not a speed

# The cameras
ROWS, COLUMNS = 160, 320  # pixels of a frame
FOCAL_LENGTH = 138.6  # pixels: 60 degrees of vertical field of view
CAMERA_HEIGHT = 1.3  # above the road
PITCH, ROLL, YAW = math.radians(8.5), math.radians(-1.2), math.radians(1.2)  # pitch: downwards
CAMERA_AHEAD_OF_REAR_AXLE = 2.6
SIDE_CAMERA_OFFSET = 0.82  # left and right camera from the centre one
CAMERA_OFFSETS = {"center": 0.0, "left": -SIDE_CAMERA_OFFSET, "right": SIDE_CAMERA_OFFSET}  # to the right
CAMERAS = tuple(CAMERA_OFFSETS)
BONNET_ROW = 136  # first row of a frame in which the bonnet is visible


def steering_to_curvature(steering: Number) -> Number:
    """Curvature of the car's path (1/m, positive to the right) for a steering of -1..1: kinematic bicycle model."""
    return np.tan(steering * FULL_LOCK) / WHEELBASE  # type: ignore[no-any-return]


def curvature_to_steering(curvature: Number) -> Number:
    """Steering (-1..1, beyond where the car cannot turn so tightly) for a path's curvature in 1/m."""
    return np.arctan(curvature * WHEELBASE) / FULL_LOCK  # type: ignore[no-any-return]
