"""A car on a road, without pictures: what moves, and where it stands."""

import math
from dataclasses import dataclass

from pilot.simulator.car import Car
from pilot.simulator.track import Track, TrackPosition
from pilot.vehicle import MPH, TICK, WHEELBASE


@dataclass(frozen=True)
class CarState:
    """What is known about the car.

    Attributes:
        time: s since the start.
        x, y: metres, of the rear axle; heading: radians, compass.
        speed: mph, negative backwards.
        steering, throttle: -1..1, the last command.
        progress: metres along the road since the start; grows over laps, falls when driving back.
        cross_track_error: metres to the right of the lane that the car should keep.
        heading_error: radians by which it points to the right of the road.
        on_road: whether all four wheels touch the road.
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
    """Moves the car along a road by commands; deterministic.

    Attributes:
        track: the road. car: the car. where: its place.
        progress: metres along the road since the start.
        on_road: whether all four wheels touch the road.
        slope: rise over run of the ground under the car.
    """

    def __init__(self, track: Track, start: float = 0.0) -> None:
        """Put the car into its lane.

        Args:
            track: the road, in the direction of driving.
            start: metres along it.
        """
        self.track = track
        self.ticks, self.progress, self.command = 0, 0.0, (0.0, 0.0)
        self.place(start % track.length)

    def place(self, start: float, offset: float = 0.0, heading_error: float = 0.0, speed: float = 0.0) -> None:
        """Put the car somewhere: metres along the road and right of its lane, radians to the right, mph."""
        x, y, heading = self.track.at(start, self.track.lane + offset)
        self.car = Car(x, y, heading + heading_error, speed * MPH)
        self._find(start)

    def put_back(self) -> None:
        """Put the car into the middle of its lane where it is, at the speed it has."""
        self.place(self.where.progress, speed=self.car.speed / MPH)

    def advance(self, steering: float, throttle: float) -> CarState:
        """Drive 20 ms by a command, each -1..1."""
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
        """What is known about the car now."""
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
        """Laps driven since the start."""
        return self.progress / self.track.length
