"""Trajectories: the car's states over time, and the interventions."""

import dataclasses
import itertools
from array import array
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np

from pilot.arrays import Floats
from pilot.simulator.episode import CarState

Reason = Literal["off the road", "no progress"]

SAMPLED_SECONDS = 0.1  # sampling interval of `steering_rates`, so that trajectories of any rate are comparable
CSV_COLUMNS = ("time", "x", "y", "speed", "steering", "progress", "cross_track_error", "heading_error")


@dataclass(frozen=True)
class Intervention:
    """An intervention: the car was put back onto the lane.

    Attributes:
        time: seconds since the start.
        x, y: position of the car before it was put back, metres.
        progress: metres along the road since the start.
        reason: for the intervention.
    """

    time: float
    x: float
    y: float
    progress: float
    reason: Reason


@dataclass(frozen=True, eq=False)
class Trajectory:
    """States of the car over a drive, and its interventions.

    Attributes:
        times: n, s.
        positions: n x 2, metres.
        speeds: n, mph.
        steering: n, -1..1.
        progress: n, metres along the road.
        cross_track_errors: n, metres, positive to the right.
        heading_errors: n, radians, positive to the right.
        interventions: in chronological order.
        lap: length of a lap, metres; None: there are no laps.
    """

    times: Floats
    positions: Floats
    speeds: Floats
    steering: Floats
    progress: Floats
    cross_track_errors: Floats
    heading_errors: Floats
    interventions: tuple[Intervention, ...] = ()
    lap: float | None = None

    def shifted(self, x: float, y: float) -> "Trajectory":
        """Return a copy with all positions translated by x, y (metres)."""
        interventions = tuple(dataclasses.replace(each, x=each.x + x, y=each.y + y) for each in self.interventions)
        return dataclasses.replace(self, positions=self.positions + np.array([x, y]), interventions=interventions)

    @property
    def seconds(self) -> float:
        """Duration, s."""
        return float(self.times[-1] - self.times[0])

    @property
    def distance(self) -> float:
        """Progress from the first to the last state, metres."""
        return float(self.progress[-1] - self.progress[0])

    @property
    def lap_times(self) -> list[float]:
        """Duration of each complete lap, s; laps are counted from the trajectory's start."""
        if self.lap is None:
            return []
        laps = int((self.distance + 1e-6) // self.lap)
        ends = [int(np.argmax(self.progress - self.progress[0] >= lap * self.lap - 1e-6)) for lap in range(laps + 1)]
        return [float(self.times[after] - self.times[before]) for before, after in itertools.pairwise(ends)]

    @property
    def steering_rates(self) -> Floats:
        """Rates of change of the steering (1/s) between consecutive samples, one every SAMPLED_SECONDS."""
        looks = np.arange(self.times[0], self.times[-1], SAMPLED_SECONDS)
        seen = self.steering[np.searchsorted(self.times, looks + 1e-9, side="right") - 1]
        return np.asarray(np.diff(seen) / SAMPLED_SECONDS)


class TrajectoryRecorder:
    """Collects a car's states in a compact array, so that hours of driving fit into memory."""

    def __init__(self) -> None:
        self._rows = array("d")

    def add(self, state: CarState) -> None:
        """Append the state after a tick."""
        self._rows.extend(getattr(state, name) for name in CSV_COLUMNS)

    def trajectory(self, interventions: Sequence[Intervention], lap: float) -> Trajectory:
        """Return the trajectory recorded so far; `lap` is the track's length in metres."""
        table = np.array(self._rows).reshape(-1, len(CSV_COLUMNS))
        times, _, _, speeds, steering, progress, errors, headings = table.T
        return Trajectory(times, table[:, 1:3], speeds, steering, progress, errors, headings, tuple(interventions), lap)
