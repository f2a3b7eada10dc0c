"""The simulator's car: a bicycle model with the real one's figures, in steps of 20 ms.

Deterministic: the same commands give the same path to the last bit. World axes as in track.py; the
car's position is that of its rear axle, on the ground.
"""

import math
from dataclasses import dataclass

from pilot.vehicle import HALF_TRACK, MPH, REVERSE_BELOW_MPH, TICK, TOP_SPEED_MPH, WHEELBASE, steering_to_curvature

TOP_SPEED = TOP_SPEED_MPH * MPH
MASS = 1080.0  # kg: body and wheels
FULL_DRIVE = 2000 / 0.35 / MASS  # m/s²: 2000 N·m in all on wheels of 0.35 m
FULL_REVERSE = 500 / 0.35 / MASS
ENGINE_RAMP = 1.0  # s from no to full torque
DRAG = 0.1  # 1/s, share of the speed that is lost
GRAVITY = 9.81
GRIP = {True: 0.95, False: 0.5}  # tyre force over weight, on the road and off it
OFF_ROAD_DRAG = 0.6  # 1/s, on top
REVERSE_BELOW = REVERSE_BELOW_MPH * MPH


def path_curvature(steering: float, speed: float, *, on_road: bool = True) -> float:
    """Curvature (1/m) of the path for a steering of -1..1 at a speed in m/s: no tighter than the tyres hold."""
    tightest = GRIP[on_road] * GRAVITY / max(speed * speed, 1e-9)
    return min(max(steering_to_curvature(steering), -tightest), tightest)


@dataclass
class Car:
    """The car's motion.

    Attributes:
        x, y: metres, of the rear axle.
        heading: radians, compass.
        speed: m/s, negative backwards.
        engine: 0..1, torque that the engine gives now.
        curvature: 1/m, of the path now; positive to the right.
    """

    x: float
    y: float
    heading: float
    speed: float = 0.0
    engine: float = 0.0
    curvature: float = 0.0

    def advance(self, steering: float, throttle: float, *, on_road: bool = True, slope: float = 0.0) -> None:
        """One tick of 20 ms.

        Args:
            steering: -1..1, positive to the right; at 1 the wheels stand at 25 degrees.
            throttle: -1..1; negative brakes, and reverses at walking pace.
            on_road: whether all wheels stand on the road: grass is slippery and slow.
            slope: rise over run of the ground ahead.
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
        if throttle == 0 and abs(self.speed) < 0.3:  # standing on a slope: friction holds it
            self.speed = 0.0
        self.speed = min(max(self.speed, -TOP_SPEED), TOP_SPEED)

    def wheels(self) -> list[tuple[float, float]]:
        """Where the four wheels touch the ground, metres: rear left and right, front left and right."""
        sine, cosine = math.sin(self.heading), math.cos(self.heading)
        return [
            (self.x + ahead * sine + side * cosine, self.y + ahead * cosine - side * sine)
            for ahead in (0.0, WHEELBASE)
            for side in (-HALF_TRACK, HALF_TRACK)
        ]
