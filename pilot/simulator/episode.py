"""Episodes: the motion of a car on a track, without rendering."""

import math
from dataclasses import dataclass

from pilot.simulator.car import Car
from pilot.simulator.track import Track, TrackPosition
from pilot.vehicle import MPH, TICK, WHEELBASE


@dataclass(frozen=True)
class CarState:
    """State of the car at one tick.

    Attributes:
        time: seconds since the start.
        x, y: position of the rear axle's middle, metres.
        heading: compass heading, radians.
        speed: mph, negative in reverse.
        steering, throttle: the last command, -1..1.
        progress: metres along the road since the start; accumulates over laps, decreases when driving backwards.
        cross_track_error: metres, positive to the right of the lane's middle.
        heading_error: radians, positive to the right of the road's direction.
        on_road: whether all four wheels are on the road.
    """

    time: float
    x: float
    y: float
    heading: float
    speed: float
    steering: float
    throttle: float
    progress: float
    cross_track_error: float
    heading_error: float
    on_road: bool


class Episode:
    """One drive of the car on a track; deterministic.

    Attributes:
        track: in the direction of driving.
        car: the car.
        where: its position relative to the track.
        ticks: number of ticks since the start.
        command: the last steering and throttle, -1..1.
        progress: metres along the road since the start.
        on_road: whether all four wheels are on the road.
        slope: of the road under the car, rise over run.
    """

    def __init__(self, track: Track, start: float = 0.0) -> None:
        """Place the car in the middle of its lane, at rest.

        Args:
            track: in the direction of driving.
            start: start position, metres along the track; taken modulo its length.
        """
        self.track = track
        self.ticks, self.progress, self.command = 0, 0.0, (0.0, 0.0)
        self.place(start % track.length)

    def place(self, start: float, offset: float = 0.0, heading_error: float = 0.0, speed: float = 0.0) -> None:
        """Place the car at a position; its progress is not changed.

        Args:
            start: metres along the track.
            offset: cross-track error, metres.
            heading_error: radians, positive to the right.
            speed: mph.
        """
        x, y, heading = self.track.at(start, self.track.lane + offset)
        self.car = Car(x, y, heading + heading_error, speed * MPH)
        self._find(start)

    def put_back(self) -> None:
        """Put the car back into the middle of its lane at its current progress and speed, aligned with the road."""
        self.place(self.where.progress, speed=self.car.speed / MPH)

    def start_again(self) -> None:
        """Put the car back like `put_back`, but standing: whoever lost it in a bend would lose it again at speed."""
        self.place(self.where.progress)

    def advance(self, steering: float, throttle: float) -> CarState:
        """Apply a command (-1..1 each) for one tick of 20 ms; returns the new state."""
        before = self.where
        self.car.advance(steering, throttle, on_road=self.on_road, slope=self.slope)
        self.ticks, self.command = self.ticks + 1, (steering, throttle)
        self._find(before.progress)
        half = self.track.length / 2
        self.progress += (self.where.progress - before.progress + half) % self.track.length - half
        return self.state

    def _find(self, near: float) -> None:
        self.where: TrackPosition = self.track.locate(self.car.x, self.car.y, near)
        places = [self.track.locate(x, y, self.where.progress) for x, y in self.car.wheels()]
        self.on_road = all(abs(place.lateral_offset) <= place.half_width for place in places)
        self.slope = (places[2].height + places[3].height - places[0].height - places[1].height) / 2 / WHEELBASE

    @property
    def state(self) -> CarState:
        """Current state of the car."""
        error = (self.car.heading - self.where.heading + math.pi) % (2 * math.pi) - math.pi
        steering, throttle = self.command
        return CarState(
            self.ticks * TICK,
            self.car.x,
            self.car.y,
            self.car.heading,
            self.car.speed / MPH,
            steering,
            throttle,
            self.progress,
            self.where.lateral_offset - self.track.lane,
            error,
            self.on_road,
        )

    @property
    def laps(self) -> float:
        """Number of laps driven since the start."""
        return self.progress / self.track.length
