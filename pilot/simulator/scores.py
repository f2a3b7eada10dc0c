"""How well a car was driven, in figures: autonomy, place in the lane, smoothness, speed.

Autonomy is NVIDIA's (Bojarski et al., End to End Learning for Self-Driving Cars, arXiv 1604.07316): each
intervention counts as six seconds that a person would have driven. Its interval is Wilson's (E. B. Wilson,
Probable Inference, JASA 1927), with every six seconds of driving as one trial that is lost or not.
"""

import dataclasses
import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from pilot.arrays import Floats
from pilot.simulator.trajectory import SAMPLED_SECONDS, Trajectory

Interval = tuple[float, float]

INTERVENTION_SECONDS = 6.0  # that a person needs to take over, bring the car back, and hand it over again
NORMAL_QUANTILE = 1.96  # of a 95 % interval


@dataclass(frozen=True)
class Scores:
    """How well one drive went, or several together.

    Attributes:
        title: what was driven, such as a track.
        drives: number of drives; clean: those of them without an intervention.
        seconds: s driven, without what an intervention would cost.
        distance: metres made good along the road.
        laps: laps driven; lap_time: s, mean of the whole ones. None where there are none.
        interventions: times that the car had to be put back.
        cross_track_mean, cross_track_p95, cross_track_max: absolute cross-track error, metres: mean, 95th percentile,
            maximum.
        heading_error: degrees to either side of where it should point, mean.
        steering_rate: mean absolute change of the steering (-1..1) per second, looked at each 0.1 s.
        steering_jerk: mean absolute change of that rate per second, in 1/s².
        speed: mph, mean.
    """

    title: str
    drives: int
    clean: int
    seconds: float
    distance: float
    laps: float | None
    lap_time: float | None
    interventions: int
    cross_track_mean: float
    cross_track_p95: float
    cross_track_max: float
    heading_error: float
    steering_rate: float
    steering_jerk: float
    speed: float

    @property
    def autonomy(self) -> float:
        """Per cent of the time that the car drove by itself.

        As NVIDIA defines it: below 0 where there is more than one intervention each six seconds.
        """
        return (1 - self.interventions * INTERVENTION_SECONDS / self.seconds) * 100 if self.seconds else 0.0

    @property
    def autonomy_interval(self) -> Interval:
        """Per cent between which the autonomy lies with a confidence of 95 %, within 0..100.

        Holds for more driving of the same kind, where one failure says nothing about the next; failures that
        come back at the same place of each lap make it too narrow.
        """
        trials = self.seconds / INTERVENTION_SECONDS
        low, high = wilson(min(self.interventions, trials), trials)
        return (1 - high) * 100, (1 - low) * 100

    @property
    def clean_interval(self) -> Interval:
        """Share of drives (0..1) without an intervention, with a confidence of 95 %."""
        return wilson(self.clean, self.drives)

    def to_jsonable(self) -> dict[str, Any]:
        """As JSON knows it, with what follows from the fields."""
        derived = {
            "autonomy": self.autonomy,
            "autonomy_interval": list(self.autonomy_interval),
            "clean_interval": list(self.clean_interval),
        }
        return dataclasses.asdict(self) | derived

    @classmethod
    def from_jsonable(cls, values: dict[str, Any]) -> "Scores":
        """The scores that `to_jsonable` made values of."""
        return cls(**{field.name: values[field.name] for field in dataclasses.fields(cls)})


def score(title: str, trajectories: Sequence[Trajectory]) -> Scores:
    """The scores of one drive, or of several together (start places, tracks): every moment counts the same.

    Raises:
        ValueError: there is no drive.
    """
    if not trajectories:
        raise ValueError(f"{title}: nothing was driven")
    offsets = np.abs(np.concatenate([trajectory.cross_track_errors for trajectory in trajectories]))
    headings = np.abs(np.concatenate([trajectory.heading_errors for trajectory in trajectories]))
    lap_times = [seconds for trajectory in trajectories for seconds in trajectory.lap_times]
    laps = [trajectory.distance / trajectory.lap for trajectory in trajectories if trajectory.lap is not None]
    rates = [trajectory.steering_rates for trajectory in trajectories]
    return Scores(
        title=title,
        drives=len(trajectories),
        clean=sum(not trajectory.interventions for trajectory in trajectories),
        seconds=sum(trajectory.seconds for trajectory in trajectories),
        distance=sum(trajectory.distance for trajectory in trajectories),
        laps=sum(laps) if laps else None,
        lap_time=_mean(lap_times) if lap_times else None,
        interventions=sum(len(trajectory.interventions) for trajectory in trajectories),
        cross_track_mean=_mean(offsets),
        cross_track_p95=float(np.percentile(offsets, 95)),
        cross_track_max=float(offsets.max()),
        heading_error=math.degrees(_mean(headings)),
        steering_rate=_mean(np.abs(np.concatenate(rates))),
        steering_jerk=_mean(np.abs(np.concatenate([np.diff(rate) for rate in rates])) / SAMPLED_SECONDS),
        speed=_mean(np.concatenate([trajectory.speeds for trajectory in trajectories])),
    )


def _mean(values: Sequence[float] | Floats) -> float:
    return float(np.mean(values)) if len(values) else 0.0


def wilson(lost: float, trials: float) -> Interval:
    """Wilson's score interval (95 %) of a share, of which `lost` in `trials` trials were seen; 0..1 without any."""
    if trials <= 0:
        return 0.0, 1.0
    share, square = lost / trials, NORMAL_QUANTILE**2
    middle = (share + square / (2 * trials)) / (1 + square / trials)
    root = math.sqrt(share * (1 - share) / trials + square / (4 * trials**2))
    half = NORMAL_QUANTILE * root / (1 + square / trials)
    return max(middle - half, 0.0), min(middle + half, 1.0)
