"""From a drive to points, from points to a model's score, and comparisons of models with their uncertainty.

A drive has 0 to 100 points, the weighted mean of five parts (0 to 100 each):

- autonomy (weight 40): NVIDIA's, 6 seconds for each intervention (arXiv 1604.07316), at least 0;
- completion (30): 100 if the drive has no intervention;
- centring (10): 100 in the middle of the lane, 0 at a mean cross-track error at which a wheel leaves the road;
- calmness (10): 100 without steering movements, 50 at 0.5 per second (of -1..1);
- pace (10): mean speed along the road as a share of the suite's 30 mph.

Interventions decide; the other parts tell models apart that have none.
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.stats import kendalltau

from pilot.arrays import Floats
from pilot.board.suite import SPEED
from pilot.simulator.scores import Interval, score
from pilot.simulator.track import Track
from pilot.simulator.trajectory import Trajectory
from pilot.vehicle import HALF_TRACK, MPH

WEIGHTS = {"autonomy": 0.4, "completion": 0.3, "centring": 0.1, "calmness": 0.1, "pace": 0.1}
RESTLESS = 0.5  # 1/s, of the steering; halves the calmness
RESAMPLES = 10_000


@dataclass(frozen=True)
class DrivePoints:
    """Figures of one drive.

    Attributes:
        title: of the drive.
        parts: points of each part, 0 to 100.
        interventions: number of them.
        seconds: duration.
        cross_track: mean absolute cross-track error, metres.
        speed: mean speed along the road, mph.
    """

    title: str
    parts: Mapping[str, float]
    interventions: int
    seconds: float
    cross_track: float
    speed: float

    @property
    def points(self) -> float:
        """Points of the drive, 0 to 100."""
        return sum(weight * self.parts[part] for part, weight in WEIGHTS.items())


def judge(title: str, track: Track, trajectory: Trajectory) -> DrivePoints:
    """Return the figures of a drive on a track."""
    scores = score(title, [trajectory])
    room = float(np.mean(track.half_widths)) - HALF_TRACK
    speed = trajectory.distance / trajectory.seconds / MPH
    parts = {
        "autonomy": max(scores.autonomy, 0.0),
        "completion": 100.0 * (scores.interventions == 0),
        "centring": 100 * max(1 - scores.cross_track_mean / room, 0.0),
        "calmness": 100 / (1 + scores.steering_rate / RESTLESS),
        "pace": 100 * min(max(speed / SPEED, 0.0), 1.0),
    }
    return DrivePoints(title, parts, scores.interventions, scores.seconds, scores.cross_track_mean, speed)


def mean_points(drives: Sequence[DrivePoints]) -> float:
    """Return a model's score: the mean of its drives' points."""
    return float(np.mean([drive.points for drive in drives]))


def bootstrap(drives: Sequence[DrivePoints]) -> Interval:
    """Return the 95 % bootstrap interval of a model's score over the drives (percentiles)."""
    points = np.array([drive.points for drive in drives])
    chosen = np.random.default_rng(0).integers(0, len(points), (RESAMPLES, len(points)))
    low, high = np.percentile(points[chosen].mean(1), [2.5, 97.5])
    return float(low), float(high)


def paired_p_value(first: Sequence[DrivePoints], second: Sequence[DrivePoints]) -> float:
    """Return the two-sided p-value of a permutation test: are two models equally good on the same drives?

    If they are, each difference could as well have the other sign (R. A. Fisher, The Design of Experiments, 1935).
    """
    differences = np.array([one.points - other.points for one, other in zip(first, second, strict=True)])
    signs = np.random.default_rng(0).choice([-1.0, 1.0], (RESAMPLES, len(differences)))
    permuted = np.abs((signs * differences).mean(1))
    at_least = permuted >= abs(float(differences.mean())) - 1e-12
    return float((1 + at_least.sum()) / (1 + RESAMPLES))


def rank_agreement(models: Sequence[Sequence[DrivePoints]], halves: Sequence[int]) -> float:
    """Return Kendall's tau between the models' scores in the two halves of a suite; nan with fewer than two models.

    Args:
        models: the drives of each model, or those of several trainings of it, one training after the other.
        halves: to which half each drive of the suite belongs, 0 or 1.
    """
    if len(models) < 2:
        return math.nan
    points = np.array([_by_drive(drives, len(halves)) for drives in models])
    chosen = np.array(halves)
    return float(kendalltau(points[:, chosen == 0].mean(1), points[:, chosen == 1].mean(1)).statistic)


def _by_drive(drives: Sequence[DrivePoints], count: int) -> Floats:
    """Return the points of each drive of a suite of `count` drives, the means of several trainings."""
    return np.mean(np.reshape([drive.points for drive in drives], (-1, count)), axis=0)  # type: ignore[no-any-return]
