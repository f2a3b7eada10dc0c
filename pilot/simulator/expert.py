"""The expert: follows the middle of the lane or another line along the road, and slows down for bends.

Pure pursuit: R. C. Coulter, Implementation of the Pure Pursuit Path Tracking Algorithm (1992), CMU-RI-TR-92-01.
The point it steers for is always visible to the cameras, so that a network can learn the steering from images.
Steering by the road's curvature at the car's own position tracks the lane better, but the bonnet hides that position.
"""

import math
from dataclasses import dataclass

import numpy as np

from pilot.pursuit import LOOKAHEAD, OFFSET_LEFT
from pilot.simulator.episode import Episode
from pilot.vehicle import GRAVITY, MPH, TICK, curvature_to_steering

MAX_LATERAL_ACCELERATION = 0.45 * GRAVITY  # m/s², maximum lateral acceleration in bends
DECELERATION = 3.5  # m/s², assumed deceleration
REACTION = 0.15  # s, time constant of the steering if it wanders
EDGE_CLEARANCE = 0.4  # metres, minimum distance of the wheels from the road's edge when wandering
WANDER_SECONDS = 4.0  # s, time constant of the wandering


@dataclass
class Expert:
    """Driver with perfect knowledge of the track and of the car's state.

    Attributes:
        episode: the car on its track.
        speed: target speed, mph; bends are taken more slowly.
        line: lateral offset from the road's middle to keep, metres, positive to the right; None: the lane's middle.
        wander: standard deviation of a random deviation from the line, metres; 0: none.
        seed: of the wandering.
    """

    episode: Episode
    speed: float = 25.0
    line: float | None = None
    wander: float = 0.0
    seed: int = 0

    def __post_init__(self) -> None:
        self._line = self.episode.track.lane if self.line is None else self.line
        self._random = np.random.default_rng(self.seed)
        self._target_offset = self.wander * float(self._random.normal())
        self._steering = 0.0

    def command(self) -> tuple[float, float]:
        """Return steering and throttle (-1..1 each) for the next tick of 20 ms; to be called once per tick."""
        self._wander()
        return self._steer(), self._accelerate()

    def follow(self, line: float) -> None:
        """Keep to another line from now on: lateral offset from the road's middle, metres, positive to the right."""
        self._line = line

    @property
    def error(self) -> float:
        """The car's lateral offset from the line, metres, positive to the right."""
        return self.episode.where.lateral_offset - self._line

    def _wander(self) -> None:
        """Update the target offset by an Ornstein-Uhlenbeck process."""
        if self.wander:
            step = TICK / WANDER_SECONDS
            kick = self.wander * math.sqrt(2 * step) * float(self._random.normal())
            room = max(self.episode.track.largest_offset - abs(self._line) - EDGE_CLEARANCE, 0.0)
            self._target_offset = min(max(self._target_offset * (1 - step) + kick, -room), room)

    def _steer(self) -> float:
        track, car, where = self.episode.track, self.episode.car, self.episode.where
        target = self._line + self._target_offset
        ahead = target + (where.lateral_offset - target) * OFFSET_LEFT
        x, y, _ = track.at(where.progress + LOOKAHEAD, ahead)
        east, north = x - car.x, y - car.y
        right = east * math.cos(car.heading) - north * math.sin(car.heading)
        wanted = curvature_to_steering(2 * right / (east * east + north * north))
        if self.wander:  # low-pass filter: a person's reaction is delayed
            wanted = self._steering + (wanted - self._steering) * TICK / REACTION
        self._steering = min(max(wanted, -1.0), 1.0)
        return self._steering

    def _accelerate(self) -> float:
        """Return the throttle that keeps the allowed speed; brakes if it is exceeded by more than 1 m/s."""
        too_slow = self.allowed_speed() - self.episode.car.speed
        if too_slow < -1.0:
            return max(0.5 * (too_slow + 1.0), -1.0)
        return min(max(0.5 * too_slow + 0.2, 0.0), 1.0)

    def allowed_speed(self) -> float:
        """Return the highest speed (m/s) up to the target from which the car can still brake for every bend ahead."""
        speed = self.episode.car.speed
        distance = np.arange(0, 10.0 + speed * speed / (2 * DECELERATION), 0.5)
        curvatures = np.abs(self.episode.track.curvature_ahead(self.episode.where.progress, len(distance) * 0.5))
        in_bend = MAX_LATERAL_ACCELERATION / np.maximum(curvatures, 1e-6)
        return min(math.sqrt(float((in_bend + 2 * DECELERATION * distance).min())), self.speed * MPH)
