"""What a car did in a drive: its states at even times, and when it had to be put back."""

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

SAMPLED_SECONDS = 0.1  # between two looks at the steering: recordings and simulators of any rate compare
CSV_COLUMNS = ("time", "x", "y", "speed", "steering", "progress", "cross_track_error", "heading_error")


@dataclass(frozen=True)
class Intervention:
    """A moment when the car had to be put back.

    Attributes:
        time: s since the start.
        x, y: metres, where the car was then.
        progress: metres along the road since the start.
        reason: what was wrong.
    """

    time: float
    x: float
    y: float
    progress: float
    reason: Reason


@dataclass(frozen=True, eq=False)
class Trajectory:
    """One drive: what the car did at even times, and when it had to be put back.

    Attributes:
        times: n, s.
        positions: n x 2, metres.
        speeds: n, mph.
        steering: n, -1..1.
        progress: n, metres along the road.
        cross_track_errors: n, metres to the right of where the car should be.
        heading_errors: n, radians to the right of where it should point.
        interventions: in order of time.
        lap: metres of a lap; None where there are no laps.
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
        """The same drive elsewhere on the map, by so many metres."""
        interventions = tuple(dataclasses.replace(each, x=each.x + x, y=each.y + y) for each in self.interventions)
        return dataclasses.replace(self, positions=self.positions + np.array([x, y]), interventions=interventions)

    @property
    def seconds(self) -> float:
        """How long it lasted."""
        return float(self.times[-1] - self.times[0])

    @property
    def distance(self) -> float:
        """Metres made good along the road."""
        return float(self.progress[-1] - self.progress[0])

    @property
    def lap_times(self) -> list[float]:
        """Seconds of each whole lap; the first begins where the drive does."""
        if self.lap is None:
            return []
        laps = int((self.distance + 1e-6) // self.lap)
        ends = [int(np.argmax(self.progress - self.progress[0] >= lap * self.lap - 1e-6)) for lap in range(laps + 1)]
        return [float(self.times[after] - self.times[before]) for before, after in itertools.pairwise(ends)]

    @property
    def steering_rates(self) -> Floats:
        """Changes of the steering per second, from one look at it to the next."""
        looks = np.arange(self.times[0], self.times[-1], SAMPLED_SECONDS)
        seen = self.steering[np.searchsorted(self.times, looks + 1e-9, side="right") - 1]
        return np.asarray(np.diff(seen) / SAMPLED_SECONDS)


class TrajectoryRecorder:
    """Collects a car's states, compactly: a drive of hours fits into memory."""

    def __init__(self) -> None:
        self._rows = array("d")

    def add(self, state: CarState) -> None:
        """The state after one more tick."""
        self._rows.extend(getattr(state, name) for name in CSV_COLUMNS)

    def trajectory(self, interventions: Sequence[Intervention], lap: float) -> Trajectory:
        """The drive so far; `lap` is the length of the track in metres."""
        table = np.array(self._rows).reshape(-1, len(CSV_COLUMNS))
        times, _, _, speeds, steering, progress, errors, headings = table.T
        return Trajectory(times, table[:, 1:3], speeds, steering, progress, errors, headings, tuple(interventions), lap)
