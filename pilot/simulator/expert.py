"""The driver who shows how: keeps the lane, slow in bends; like a person on request.

Steering is the road's curvature a moment ahead, plus pure pursuit of the lane for what the car is off it: J. M. Snider,
Automatic Steering Methods for Autonomous Automobile Path Tracking (2009), CMU-RI-TR-09-08. Thus it does not cut bends,
as plain pure pursuit does, and its steering is as smooth as the road.
"""

import math
from dataclasses import dataclass

import numpy as np

from pilot.camera import curvature_to_steering
from pilot.simulator.car import GRAVITY, MPH, TICK
from pilot.simulator.drive import Drive
from pilot.simulator.track import STEP

LOOKAHEAD = 15.0  # metres ahead, where it is back in its lane; training labels shifted viewpoints likewise
STEEPEST = 0.3  # radians at most, that the lane is returned to
PREVIEW_SECONDS = 0.15  # how far ahead the road's bend is steered for
SIDEWAYS = 0.45 * GRAVITY  # m/s², that a bend is taken with at most
BRAKING = 3.5  # m/s², that the expert reckons with
REACTION = 0.15  # s between seeing and doing, where it is like a person
KEPT_CLEAR = 0.4  # metres to the road's edge that a person leaves at least
WANDER_SECONDS = 4.0  # how slowly a person's place in the lane changes


@dataclass
class Expert:
    """Steers and accelerates from what it knows of the road.

    Attributes:
        drive: the car it drives.
        speed: mph, that it wants where the road allows it.
        wander: metres, typical distance that it strays from the middle of the lane; 0 is none.
        seed: of the straying.
    """

    drive: Drive
    speed: float = 25.0
    wander: float = 0.0
    seed: int = 0

    def __post_init__(self) -> None:
        self._random = np.random.default_rng(self.seed)
        self._aside = self.wander * float(self._random.normal())
        self._steering = 0.0

    def command(self) -> tuple[float, float]:
        """Steering and throttle (-1..1 each) for the next 20 ms; call it once per tick."""
        self._stray()
        return self._steer(), self._accelerate()

    def _stray(self) -> None:
        """An Ornstein-Uhlenbeck walk: wanders, and comes back."""
        if self.wander:
            step = TICK / WANDER_SECONDS
            kick = self.wander * math.sqrt(2 * step) * float(self._random.normal())
            room = max(float(self.drive.track.margins.min()) - KEPT_CLEAR, 0.0)
            self._aside = min(max(self._aside * (1 - step) + kick, -room), room)

    def _steer(self) -> float:
        track, state = self.drive.track, self.drive.state
        ahead = self.drive.where.progress + PREVIEW_SECONDS * max(self.drive.car.speed, 0.0)
        bend = float(track.curvature_ahead(ahead, STEP)[0])
        askew = state.heading_error + min(max((state.offset - self._aside) / LOOKAHEAD, -STEEPEST), STEEPEST)
        wanted = curvature_to_steering(bend - 2 / LOOKAHEAD * askew)
        if self.wander:  # a person's hands take their time
            wanted = self._steering + (wanted - self._steering) * TICK / REACTION
        self._steering = min(max(wanted, -1.0), 1.0)
        return self._steering

    def _accelerate(self) -> float:
        """Full throttle below the speed that the road ahead allows, brake above."""
        too_slow = self.allowed_speed() - self.drive.car.speed
        if too_slow < -1.0:
            return max(0.5 * (too_slow + 1.0), -1.0)
        return min(max(0.5 * too_slow + 0.2, 0.0), 1.0)

    def allowed_speed(self) -> float:
        """m/s, from which the car can still brake for each bend ahead."""
        speed = self.drive.car.speed
        distance = np.arange(0, 10.0 + speed * speed / (2 * BRAKING), 0.5)
        curvatures = np.abs(self.drive.track.curvature_ahead(self.drive.where.progress, len(distance) * 0.5))
        in_bend = SIDEWAYS / np.maximum(curvatures, 1e-6)
        return min(math.sqrt(float((in_bend + 2 * BRAKING * distance[: len(in_bend)]).min())), self.speed * MPH)
