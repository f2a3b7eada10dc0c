"""How suspicious each moment of a recording is, and why.

Each test gives every row a score; 1 is the limit from which it counts as suspicious. The scores of tests that measure a
disagreement are relative to what is usual in the recording, so that a jerky driver is not suspicious everywhere.
"""

from dataclasses import dataclass

import numpy as np
import pandas as pd
from numpy.typing import NDArray
from scipy.ndimage import maximum_filter1d, median_filter, uniform_filter1d

from pilot.arrays import Floats
from pilot.data.motion import MAX_ACCELERATION, motion_breaks
from pilot.data.samples import smooth_steering
from pilot.data.segments import LONGEST_GAP, breaks
from pilot.inspection.motion_seen import MotionSeen
from pilot.inspection.place_seen import PlaceSeen
from pilot.vehicle import HALF_TRACK, MPH, path_curvature

STANDING_MPH = 1.0
FROZEN = 0.4  # mean difference of two images (0..255) below which nothing moves
AROUND_SECONDS = 1.0  # around a break of the drive that is suspicious too
DISAGREEMENT_SECONDS = 2.0  # over which disagreements are averaged
USUAL = 5.0  # times the usual disagreement (median) is the limit
LATE_SECONDS = (0.35, 1.3)  # shortest and longest delay, or lead, of the steering that is looked for
LATE_WINDOW = 3.0  # s over which turns and steering are compared
BETTER = 0.5  # improvement of the mean squared difference, as a share of the remaining and the usual one
OFF_ROAD_METRES = 1.0  # by which a wheel is over the edge; the network errs by some decimetres
SWAPPED_METRES = 0.4  # by which the right camera's image lies left of the left one's; it is 1.64 m right of it
SWAPPED_ROWS = 7  # over which the median is taken: single images are misread

REASONS = {
    "standing": "the car stands",
    "pause": "time jumps",
    "reset": "the speed jumps: crash or reset",
    "frozen": "the picture is frozen while the car moves",
    "turn": "the steering contradicts where the car went",
    "late": "the steering comes early or late",
    "crash": "the car stopped at once and stands",
    "networks": "networks trained on the rest steer otherwise",
    "cameras": "left and right camera are swapped",
    "off road": "off the road",
    "duplicate": "near duplicate of the picture before",
}


@dataclass(frozen=True)
class Moment:
    """A suspicious range of rows, both ends included.

    Attributes:
        first, last: indices of the rows.
        reason: a key of REASONS.
        score: highest score of the range.
    """

    first: int
    last: int
    reason: str
    score: float


def scores_of_log(rows: pd.DataFrame) -> dict[str, Floats]:
    """Return the scores of the tests that need no image (each n), for the n rows of a recording."""
    pause, speed = rows["time"].diff().to_numpy(float), rows["speed"].to_numpy(float)
    leap = np.abs(np.diff(speed, prepend=speed[:1])) * MPH / np.maximum(MAX_ACCELERATION * pause + 0.5, 0.5)
    with np.errstate(invalid="ignore"):
        return {
            "standing": np.where(speed < STANDING_MPH, 1.2, 0.0),
            "crash": _crashes(speed < STANDING_MPH, leap > 1),
            "pause": _around(np.where((pause > LONGEST_GAP) | (pause < 0), 1.1, 0.0), rows, AROUND_SECONDS / 4),
            "reset": np.maximum(np.where(leap > 1, np.clip(leap, 1, 2), 0.0), _around(leap > 1, rows, AROUND_SECONDS)),
        }


def _crashes(stands: NDArray[np.bool_], leaps: NDArray[np.bool_]) -> Floats:
    """Return 2.5 where the car stands since its speed leapt to 0, otherwise 0 (n)."""
    begins = stands & ~np.concatenate([[False], stands[:-1]])
    stretch = np.cumsum(begins)
    crashed = np.isin(stretch, stretch[begins & leaps])
    return np.where(stands & crashed, 2.5, 0.0)


def scores_of_images(rows: pd.DataFrame, seen: MotionSeen) -> dict[str, Floats]:
    """Return the scores of the tests of the car's motion (each n), for the n rows of a recording."""
    moving = (rows["speed"] > STANDING_MPH).to_numpy()
    still = np.where(breaks(rows), np.inf, seen.changes) < FROZEN
    return {
        "frozen": _around(np.where(still & moving, 4.0, 0.0), rows, 0.1),
        "duplicate": np.where(still & ~moving, 1.1, 0.0),
        "turn": _disagreement(rows, seen.turns - _fitted(seen.turns, _steered_turns(rows))),
        "late": _lateness(rows, seen.turns, _fitted(seen.turns, _steered_turns(rows))),
    }


def scores_of_places(rows: pd.DataFrame, seen: PlaceSeen) -> dict[str, Floats]:
    """Return the scores of the tests of the car's place (each n), for the n rows of a recording."""
    usual_width = float(np.nanmedian(seen.half_widths))
    beyond = np.abs(seen.offsets) + HALF_TRACK - usual_width
    sides = pd.Series(seen.sides).interpolate(limit_direction="both").to_numpy(float)
    steady = median_filter(np.nan_to_num(sides, nan=1.64), SWAPPED_ROWS)
    with np.errstate(invalid="ignore"):
        return {
            "off road": np.clip(_mean(beyond, rows, 0.5) / OFF_ROAD_METRES, 0, 3),
            "cameras": np.where(steady < -SWAPPED_METRES, 3.0, 0.0),
        }


def scores_of_predictions(rows: pd.DataFrame, predicted: Floats) -> dict[str, Floats]:
    """Return the score of the networks' disagreement with the label (n); 0 where nothing is predicted."""
    label = smooth_steering(rows, 0.5).to_numpy(float)
    return {"networks": _disagreement(rows, np.nan_to_num(predicted - label))}


def _steered_turns(rows: pd.DataFrame) -> Floats:
    """Return by how much (radians) steering and speed turned the car since the row before."""
    pause = np.clip(np.nan_to_num(rows["time"].diff().to_numpy(float)), 0, LONGEST_GAP)
    speeds = np.nan_to_num(rows["speed"].to_numpy(float) * MPH)
    curvatures = np.array([path_curvature(*each) for each in zip(rows["steering"], speeds, strict=True)])
    return np.concatenate([[0.0], (curvatures * speeds)[:-1] * pause[1:]])


def _fitted(seen: Floats, steered: Floats) -> Floats:
    """Return the steered turns, scaled to those that the images show: near things turn more than the horizon."""
    product = float((steered * steered).sum())
    slope = float(np.clip((seen * steered).sum() / product, 0.5, 2.0)) if product else 1.0
    return slope * steered


def _lateness(rows: pd.DataFrame, seen: Floats, steered: Floats) -> Floats:
    """Return how much better the turns seen fit to earlier or later steering, relative to `BETTER`, at most 3 (n)."""
    apart = motion_breaks(rows).to_numpy()
    lags = [lag for lag in range(_count(rows, LATE_SECONDS[1]) + 1) if lag >= _count(rows, LATE_SECONDS[0])]
    errors = {
        lag: _mean(np.where(apart, 0, (seen - np.roll(steered, -lag)) ** 2), rows, LATE_WINDOW)
        for lag in [0, *lags, *(-lag for lag in lags)]
    }
    now = errors.pop(0)
    best = np.min(list(errors.values()), axis=0)
    return np.asarray(np.clip((now - best) / (best + np.median(now) + 1e-9) / BETTER, 0, 3))


def _disagreement(rows: pd.DataFrame, differences: Floats) -> Floats:
    """Return the mean absolute difference around each row, relative to `USUAL` times what is usual."""
    differences = np.where(motion_breaks(rows), 0.0, differences)
    mean = _mean(np.abs(differences), rows, DISAGREEMENT_SECONDS)
    usual = max(float(np.median(mean)), 1e-6)
    return np.asarray(mean / (USUAL * usual))


def _mean(values: Floats, rows: pd.DataFrame, seconds: float) -> Floats:
    return np.asarray(uniform_filter1d(values, _count(rows, seconds), mode="nearest"))


def _around(values: Floats | NDArray[np.bool_], rows: pd.DataFrame, seconds: float) -> Floats:
    return np.asarray(maximum_filter1d(np.asarray(values, float), 2 * _count(rows, seconds) + 1))


def _count(rows: pd.DataFrame, seconds: float) -> int:
    """Return the number of rows in a time, at least 1."""
    usual = float(rows["time"].diff().median())
    return max(round(seconds / usual), 1) if usual > 0 else 1


def row_scores(scores: dict[str, Floats]) -> Floats:
    """Return the highest score of each row (n)."""
    return np.asarray(np.max(list(scores.values()), axis=0))


def find_moments(scores: dict[str, Floats], gap: int = 10) -> list[Moment]:
    """Return the suspicious moments, the most suspicious first.

    Args:
        scores: n by reason.
        gap: number of unsuspicious rows between two ranges up to which they are one moment.
    """
    moments = []
    for reason, values in scores.items():
        places = np.flatnonzero(values >= 1)
        for part in np.split(places, np.flatnonzero(np.diff(places) > gap) + 1):
            if len(part):
                moments.append(Moment(int(part[0]), int(part[-1]), reason, float(values[part].max())))
    return sorted(moments, key=lambda moment: -moment.score)
