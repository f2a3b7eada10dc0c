"""The referee: records an episode, puts the car back onto the road, and decides when the episode ends."""

import math
from collections.abc import Callable
from dataclasses import dataclass

from pilot.simulator.episode import CarState, Episode
from pilot.simulator.track import Track
from pilot.simulator.trajectory import Intervention, Reason, Trajectory, TrajectoryRecorder
from pilot.vehicle import MPH, TICK

MIN_PROGRESS = 1.0  # metres; with less progress than this a car counts as standing
SLOWEST = 0.25  # share of the target speed; a car that is slower on average does not complete its laps in time


@dataclass(frozen=True)
class PutBackRule:
    """Limits beyond which the car is put back into the middle of its lane.

    Attributes:
        off_road_seconds: maximum time with a wheel off the road.
        off_road_metres: maximum distance of the car's position from the road's edge, outside the road.
        standing_seconds: maximum time without MIN_PROGRESS.
    """

    off_road_seconds: float
    off_road_metres: float
    standing_seconds: float


AT_ONCE = PutBackRule(0.0, 0.0, 10.0)  # for evaluation: the first wheel off the road is an intervention
WHEN_LOST = PutBackRule(2.0, 8.0, math.inf)  # only if the car is unlikely to return by itself
NEVER = PutBackRule(math.inf, math.inf, math.inf)


def time_limit(track: Track, laps: float, set_speed: float) -> float:
    """Return the longest duration of an episode in seconds; `set_speed` is the target speed in mph."""
    return laps * track.length / (SLOWEST * set_speed * MPH)


class Referee:
    """Observes the car of an episode.

    Attributes:
        episode: the car on its track.
        interventions: so far.
        departures: number of times that the car left the road with at least one wheel.
        ticks: number of ticks observed.
    """

    def __init__(
        self,
        episode: Episode,
        *,
        laps: float | None = None,
        seconds: float | None = None,
        rule: PutBackRule = AT_ONCE,
        on_put_back: Callable[[], None] = lambda: None,
    ) -> None:
        """Start observing at the car's current position.

        Args:
            episode: the car on its track.
            laps, seconds: limits after which the episode is over, whichever is reached first; None: no limit.
            rule: when the car is put back.
            on_put_back: called after the car was put back.
        """
        self.episode, self.laps, self.seconds, self.rule = episode, laps, seconds, rule
        self.on_put_back = on_put_back
        self.interventions: list[Intervention] = []
        self.departures = self.ticks = 0
        self._ticks_off = 0 if episode.on_road else 1  # ticks since a wheel left the road; 0: on the road
        self._moved = episode.state  # state at the last progress of MIN_PROGRESS
        self._first_lap = episode.laps
        self._recorder = TrajectoryRecorder()
        self._recorder.add(episode.state)

    def observe(self, state: CarState) -> None:
        """Record the state after a tick, and put the car back if the rule requires it."""
        self.ticks += 1
        self._recorder.add(state)
        self.departures += not state.on_road and self._ticks_off == 0
        self._ticks_off = 0 if state.on_road else self._ticks_off + 1
        if state.progress >= self._moved.progress + MIN_PROGRESS:
            self._moved = state
        if self._is_off_road():
            self._put_back(state, "off the road")
        elif state.time - self._moved.time >= self.rule.standing_seconds:
            self._put_back(state, "no progress")

    def _is_off_road(self) -> bool:
        position = self.episode.where
        beyond = abs(position.lateral_offset) - position.half_width
        return self._ticks_off * TICK > self.rule.off_road_seconds or beyond > self.rule.off_road_metres

    def _put_back(self, state: CarState, reason: Reason) -> None:
        self.interventions.append(Intervention(state.time, state.x, state.y, state.progress, reason))
        self.episode.put_back()
        self._moved, self._ticks_off = self.episode.state, 0
        self.on_put_back()

    @property
    def over(self) -> bool:
        """Whether the limit of laps or seconds is reached."""
        laps, seconds = self.episode.laps - self._first_lap, self.ticks * TICK
        by_laps = self.laps is not None and laps >= self.laps
        return by_laps or (self.seconds is not None and seconds >= self.seconds - TICK / 2)

    @property
    def trajectory(self) -> Trajectory:
        """Trajectory recorded so far."""
        return self._recorder.trajectory(self.interventions, self.episode.track.length)
