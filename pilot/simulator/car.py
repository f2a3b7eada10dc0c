"""Kinematic bicycle model of the car with the Unity simulator's parameters, in ticks of 20 ms.

Deterministic: the same commands give a bit-identical path. World axes as in track.py; the car's position is
the middle of its rear axle, on the ground.
"""

import math
from dataclasses import dataclass

from pilot.vehicle import (
    GRAVITY,
    GRIP,
    HALF_TRACK,
    MPH,
    REVERSE_BELOW_MPH,
    TICK,
    TOP_SPEED_MPH,
    WHEEL_RADIUS,
    WHEELBASE,
    path_curvature,
)

TOP_SPEED = TOP_SPEED_MPH * MPH
MASS = 1080.0  # kg, including the wheels
FULL_DRIVE = 2000 / WHEEL_RADIUS / MASS  # m/s²: a total torque of 2000 N·m
FULL_REVERSE = 500 / WHEEL_RADIUS / MASS  # m/s²: 500 N·m
ENGINE_RAMP = 1.0  # s from zero to full torque
DRAG = 0.1  # 1/s, relative loss of speed
OFF_ROAD_DRAG = 0.6  # 1/s, added to DRAG
REVERSE_BELOW = REVERSE_BELOW_MPH * MPH


@dataclass
class Car:
    """State and motion of the car.

    Attributes:
        x, y: position of the rear axle's middle, metres.
        heading: compass heading, radians.
        speed: m/s, negative in reverse.
        engine: current torque of the engine as a share of the full one, 0..1.
        curvature: current curvature of the path, 1/m; positive to the right.
    """

    x: float
    y: float
    heading: float
    speed: float = 0.0
    engine: float = 0.0
    curvature: float = 0.0

    def advance(self, steering: float, throttle: float, *, on_road: bool = True, slope: float = 0.0) -> None:
        """Advance the car by one tick of 20 ms.

        Args:
            steering: -1..1, positive to the right; 1 is a wheel angle of 25 degrees. Clipped.
            throttle: -1..1; a negative one brakes, and reverses below 5 mph. Clipped.
            on_road: whether all wheels are on the road; off it there is less grip and more drag.
            slope: of the ground in the direction of the heading, rise over run.
        """
        steering, throttle = min(max(steering, -1.0), 1.0), min(max(throttle, -1.0), 1.0)
        before = self.speed
        self._change_speed(throttle, on_road, slope)
        mean = (before + self.speed) / 2
        self.curvature = path_curvature(steering, mean, on_road=on_road)
        turn = mean * self.curvature * TICK
        self.x += mean * math.sin(self.heading + turn / 2) * TICK
        self.y += mean * math.cos(self.heading + turn / 2) * TICK
        self.heading += turn

    def _change_speed(self, throttle: float, on_road: bool, slope: float) -> None:
        self.engine = min(max(throttle, 0.0), self.engine + TICK / ENGINE_RAMP)
        drag = DRAG + (0.0 if on_road else OFF_ROAD_DRAG)
        push = self.engine * FULL_DRIVE - drag * self.speed - GRAVITY * slope
        if throttle < 0 and self.speed > REVERSE_BELOW:
            self.speed = max(self.speed + (push + throttle * GRIP[on_road] * GRAVITY) * TICK, 0.0)
        else:
            self.speed += (push + min(throttle, 0.0) * FULL_REVERSE) * TICK
        if throttle == 0 and abs(self.speed) < 0.3:  # static friction holds a car that stands on a slope
            self.speed = 0.0
        self.speed = min(max(self.speed, -TOP_SPEED), TOP_SPEED)

    def wheels(self) -> list[tuple[float, float]]:
        """Return the wheels' contact points (x, y in metres): rear left, rear right, front left, front right."""
        sine, cosine = math.sin(self.heading), math.cos(self.heading)
        return [
            (self.x + ahead * sine + side * cosine, self.y + ahead * cosine - side * sine)
            for ahead in (0.0, WHEELBASE)
            for side in (-HALF_TRACK, HALF_TRACK)
        ]
