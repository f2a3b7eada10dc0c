"""Driving metrics: autonomy, cross-track error, heading error, smoothness and speed.

Autonomy as defined by NVIDIA (Bojarski et al., End to End Learning for Self-Driving Cars, arXiv 1604.07316): each
intervention counts as six seconds driven by a person. Confidence intervals are Wilson's score intervals (E. B. Wilson,
Probable Inference, JASA 1927); for autonomy, every six seconds of driving are one Bernoulli trial.
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

INTERVENTION_SECONDS = 6.0  # assumed time to take over, bring the car back into its lane, and hand over again
NORMAL_QUANTILE = 1.96  # for a two-sided 95 % interval


@dataclass(frozen=True)
class Scores:
    """Metrics of one trajectory, or of several together.

    Attributes:
        title: of what was driven, such as the track's name.
        drives: number of trajectories.
        clean: number of trajectories without an intervention.
        seconds: driven time, without the time that interventions are counted as.
        distance: progress along the road, metres.
        laps: number of laps driven, including fractions; None: there are no laps.
        lap_time: mean time of the complete laps, s; None: there are none.
        interventions: number of interventions.
        cross_track_mean, cross_track_p95, cross_track_max: mean, 95th percentile and maximum of the absolute
            cross-track error, metres.
        heading_error: mean absolute heading error, degrees.
        steering_rate: mean absolute rate of change of the steering (-1..1), sampled every 0.1 s, in 1/s.
        steering_jerk: mean absolute rate of change of the steering rate, in 1/s².
        speed: mean speed, mph.
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
        """Autonomy as defined by NVIDIA, per cent; negative with more than one intervention per six seconds."""
        return (1 - self.interventions * INTERVENTION_SECONDS / self.seconds) * 100 if self.seconds else 0.0

    @property
    def autonomy_interval(self) -> Interval:
        """95 % confidence interval of the autonomy, per cent, within 0..100.

        Assumes independent failures; it is too narrow if they recur at the same place in each lap.
        """
        trials = self.seconds / INTERVENTION_SECONDS
        low, high = wilson(min(self.interventions, trials), trials)
        return (1 - high) * 100, (1 - low) * 100

    @property
    def clean_interval(self) -> Interval:
        """95 % confidence interval of the share (0..1) of trajectories without an intervention."""
        return wilson(self.clean, self.drives)

    def to_jsonable(self) -> dict[str, Any]:
        """Convert to JSON types; properties derived from the fields are included."""
        derived = {
            "autonomy": self.autonomy,
            "autonomy_interval": list(self.autonomy_interval),
            "clean_interval": list(self.clean_interval),
        }
        return dataclasses.asdict(self) | derived

    @classmethod
    def from_jsonable(cls, values: dict[str, Any]) -> "Scores":
        """Restore scores from the values that `to_jsonable` returned."""
        return cls(**{field.name: values[field.name] for field in dataclasses.fields(cls)})


def score(title: str, trajectories: Sequence[Trajectory]) -> Scores:
    """Compute the scores of one trajectory, or of several together (start positions, tracks).

    In the means, all states of all trajectories have the same weight.

    Raises:
        ValueError: there is no trajectory.
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
    """Return Wilson's 95 % score interval of the share `lost / trials`; 0..1 if there are no trials."""
    if trials <= 0:
        return 0.0, 1.0
    share, square = lost / trials, NORMAL_QUANTILE**2
    middle = (share + square / (2 * trials)) / (1 + square / trials)
    root = math.sqrt(share * (1 - share) / trials + square / (4 * trials**2))
    half = NORMAL_QUANTILE * root / (1 + square / trials)
    return max(middle - half, 0.0), min(middle + half, 1.0)
