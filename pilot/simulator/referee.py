"""Watches a drive: records it, puts the car back onto the road, and says when the drive is over."""

import math
from collections.abc import Callable
from dataclasses import dataclass

from pilot.simulator.episode import CarState, Episode
from pilot.simulator.trajectory import Intervention, Reason, Trajectory, TrajectoryRecorder
from pilot.vehicle import TICK

MIN_PROGRESS = 1.0  # metres; a car that does not get on by as much is standing


@dataclass(frozen=True)
class PutBackRule:
    """When the car is put back into the middle of its lane.

    Attributes:
        off_road_seconds: after more than so long with a wheel off the road.
        off_road_metres: farther than this beyond the road's edge.
        standing_seconds: after so long without a metre of progress.
    """

    off_road_seconds: float
    off_road_metres: float
    standing_seconds: float


AT_ONCE = PutBackRule(0.0, 0.0, 10.0)  # for evaluation: each wheel off the road is an intervention
WHEN_LOST = PutBackRule(2.0, 8.0, math.inf)  # as long as the car may come back by itself, it is left alone
NEVER = PutBackRule(math.inf, math.inf, math.inf)


class Referee:
    """Watches the car of an episode.

    Attributes:
        episode: the car on its track.
        interventions: so far.
        departures: times that a wheel left the road.
        ticks: observed so far.
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
        """Begin where the car stands.

        Args:
            episode: the car on its track.
            laps, seconds: after which the drive is over, whichever comes first; None: never.
            rule: when the car is put back.
            on_put_back: called when it was.
        """
        self.episode, self.laps, self.seconds, self.rule = episode, laps, seconds, rule
        self.on_put_back = on_put_back
        self.interventions: list[Intervention] = []
        self.departures = self.ticks = 0
        self._ticks_off = 0 if episode.on_road else 1  # since a wheel left the road
        self._moved = episode.state  # when the car last got on by a metre
        self._first_lap = episode.laps
        self._recorder = TrajectoryRecorder()
        self._recorder.add(episode.state)

    def observe(self, state: CarState) -> None:
        """One tick."""
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
        """Whether the laps are driven, or the time is up."""
        laps, seconds = self.episode.laps - self._first_lap, self.ticks * TICK
        by_laps = self.laps is not None and laps >= self.laps
        return by_laps or (self.seconds is not None and seconds >= self.seconds - TICK / 2)

    @property
    def trajectory(self) -> Trajectory:
        """The drive so far."""
        return self._recorder.trajectory(self.interventions, self.episode.track.length)
