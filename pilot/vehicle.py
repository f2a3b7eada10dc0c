"""Constants of the Unity simulator's car and cameras; each is defined only here.

They are taken from the simulator's published source and scene, or measured on its client and on real recordings.
Lengths are in metres, angles in radians unless a name says degrees; steering is -1..1, positive to the right.
"""

import math
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

Number = TypeVar("Number", float, NDArray[np.float64])

# Clock and units
TICK = 0.02  # s; the simulator's physics runs at 50 Hz
MPH = 0.44704  # m/s in 1 mph
GRAVITY = 9.81  # m/s²

# The car
WHEELBASE = 2.87
WHEEL_RADIUS = 0.35
HALF_TRACK = 1.0  # half of the distance between left and right wheels
FULL_LOCK_DEGREES = 25.0
FULL_LOCK = math.radians(FULL_LOCK_DEGREES)  # angle of the front wheels for a steering of 1
GRIP = {True: 0.95, False: 0.5}  # friction coefficient of the tyres, on and off the road
TOP_SPEED_MPH = 30.0  # hard limit in the simulator
REVERSE_BELOW_MPH = 5.0  # a negative throttle brakes above this speed and reverses below it
PLAUSIBLE_SPEED_MPH = 200.0  # larger values in a log or telemetry are not speeds

# The cameras
Rows = tuple[int, int]  # first row of a frame, and the one after the last
ROWS, COLUMNS = 160, 320  # pixels of a frame
WHOLE_FRAME: Rows = (0, ROWS)
NO_ROWS: Rows = (0, 0)
FOCAL_LENGTH = 138.6  # pixels; gives a vertical field of view of 60 degrees
CAMERA_HEIGHT = 1.3  # above the ground
PITCH, ROLL, YAW = math.radians(8.5), math.radians(-1.2), math.radians(1.2)  # pitch is downwards
CAMERA_AHEAD_OF_REAR_AXLE = 2.6
SIDE_CAMERA_OFFSET = 0.82  # distance of the left and right cameras from the centre camera
CAMERA_OFFSETS = {"center": 0.0, "left": -SIDE_CAMERA_OFFSET, "right": SIDE_CAMERA_OFFSET}  # positive to the right
CAMERAS = tuple(CAMERA_OFFSETS)
BONNET_ROW = 136  # first row of a frame in which the bonnet is visible


def steering_to_curvature(steering: Number) -> Number:
    """Return the path's curvature (1/m, positive to the right) for a steering of -1..1: kinematic bicycle model."""
    return np.tan(steering * FULL_LOCK) / WHEELBASE  # type: ignore[no-any-return]


def curvature_to_steering(curvature: Number) -> Number:
    """Return the steering for a path's curvature in 1/m; beyond -1..1 for curves tighter than the car can turn."""
    return np.arctan(curvature * WHEELBASE) / FULL_LOCK  # type: ignore[no-any-return]


def path_curvature(steering: float, speed: float, *, on_road: bool = True) -> float:
    """Return the path's curvature (1/m) for a steering of -1..1 at a speed in m/s, limited by the tyres' grip."""
    tightest = GRIP[on_road] * GRAVITY / max(speed * speed, 1e-9)
    return min(max(steering_to_curvature(steering), -tightest), tightest)
