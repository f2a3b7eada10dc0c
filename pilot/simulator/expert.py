"""The driver who shows how: keeps the lane, slow in bends; like a person on request.

Pure pursuit of the lane's middle: R. C. Coulter, Implementation of the Pure Pursuit Path Tracking Algorithm (1992),
CMU-RI-TR-92-01. The point that it steers for is always within the cameras' view, so that a network can learn it;
steering by the road's curvature at the car's own place keeps the lane better, but that place lies under the bonnet.
"""

import math
from dataclasses import dataclass

import numpy as np

from pilot.simulator.car import GRAVITY
from pilot.simulator.episode import Episode
from pilot.vehicle import MPH, TICK, curvature_to_steering

LOOKAHEAD = 10.0  # metres from the rear axle to the point steered for; training labels shifted viewpoints likewise
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

    episode: Episode
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
            room = max(float(self.episode.track.margins.min()) - KEPT_CLEAR, 0.0)
            self._aside = min(max(self._aside * (1 - step) + kick, -room), room)

    def _steer(self) -> float:
        track, car = self.episode.track, self.episode.car
        x, y, _ = track.at(self.episode.where.progress + LOOKAHEAD, track.lane + self._aside)
        east, north = x - car.x, y - car.y
        right = east * math.cos(car.heading) - north * math.sin(car.heading)
        wanted = curvature_to_steering(2 * right / (east * east + north * north))
        if self.wander:  # a person's hands take their time
            wanted = self._steering + (wanted - self._steering) * TICK / REACTION
        self._steering = min(max(wanted, -1.0), 1.0)
        return self._steering

    def _accelerate(self) -> float:
        """Full throttle below the speed that the road ahead allows, brake above."""
        too_slow = self.allowed_speed() - self.episode.car.speed
        if too_slow < -1.0:
            return max(0.5 * (too_slow + 1.0), -1.0)
        return min(max(0.5 * too_slow + 0.2, 0.0), 1.0)

    def allowed_speed(self) -> float:
        """m/s, from which the car can still brake for each bend ahead."""
        speed = self.episode.car.speed
        distance = np.arange(0, 10.0 + speed * speed / (2 * BRAKING), 0.5)
        curvatures = np.abs(self.episode.track.curvature_ahead(self.episode.where.progress, len(distance) * 0.5))
        in_bend = SIDEWAYS / np.maximum(curvatures, 1e-6)
        return min(math.sqrt(float((in_bend + 2 * BRAKING * distance).min())), self.speed * MPH)
