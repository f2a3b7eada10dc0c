"""Map matching: where on a known track a recording was driven, found by the curvature of the driven path.

The curvature that steering and speed give is compared with that of the track's centre line at every start position
and for slightly wrong speeds (normalised cross-correlation); then small errors that grow along the way are corrected
by dynamic programming (Viterbi), which shifts pieces of the path against the track.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from pilot.arrays import Floats, sums_before
from pilot.data.motion import Motion
from pilot.simulator.track import STEP, Track

SCALES = np.arange(0.93, 1.07, 0.01)  # of the recorded distances
SMOOTHED = 8.0  # metres over which curvatures are averaged before they are compared
PIECE = 4.0  # metres that are shifted as a whole
LARGEST_SHIFT = 24.0  # metres
CURVATURE_DEVIATION = 0.04  # 1/m, standard deviation of the driven curvature from the centre line's
SHIFT_DEVIATION = 0.6  # metres, standard deviation of the change of the shift from one piece to the next


@dataclass(frozen=True, eq=False)
class MapMatch:
    """The track on which a recording was driven.

    Attributes:
        track: in the direction of driving.
        correlation: of the driven curvature with the centre line's, -1..1, before pieces are shifted.
        scale: factor of the recorded distances, about 1.
        progress: metres along the track, one value per row of the recording.
    """

    track: Track
    correlation: float
    scale: float
    progress: Floats


def match_track(motion: Motion, tracks: Sequence[Track]) -> MapMatch:
    """Find the track, the start position and the scale at which the driven curvature fits best.

    Args:
        motion: of the recorded car, at least about 100 m.
        tracks: to choose from; a direction of driving is a track of its own.
    """
    candidates = [(*_best_start(motion, track, float(scale)), scale, track) for track in tracks for scale in SCALES]
    correlation, start, scale, track = max(candidates, key=lambda candidate: candidate[0])
    return MapMatch(track, correlation, float(scale), _refined(motion, track, start, float(scale)))


def _driven(motion: Motion, scale: float) -> Floats:
    """Return the distance (metres) from the first row to each row."""
    return scale * sums_before(motion.steps)


def _driven_curvatures(motion: Motion, scale: float) -> Floats:
    """Return the smoothed curvature (1/m) of the driven path, one value per STEP."""
    distances = _driven(motion, scale)
    even = np.arange(0, distances[-1], STEP)
    return _smoothed(np.interp(even, distances, motion.curvatures))


def _road_curvatures(track: Track) -> Floats:
    """Return the smoothed curvature (1/m) of a track's centre line at its points."""
    width = round(SMOOTHED / STEP)
    around = np.concatenate([track.curvatures[-width:], track.curvatures, track.curvatures[:width]])
    return _smoothed(around)[width:-width]


def _smoothed(values: Floats) -> Floats:
    width = round(SMOOTHED / STEP) + 1
    return np.convolve(values, np.full(width, 1 / width), "same")


def _best_start(motion: Motion, track: Track, scale: float) -> tuple[float, float]:
    """Return the highest correlation over all start positions, and that position in metres along the track."""
    driven, road = _driven_curvatures(motion, scale), _road_curvatures(track)
    length, points = len(driven), len(road)
    road = np.tile(road, -(-length // points) + 1)
    deviations = driven - driven.mean()
    size = len(road) + length
    sums = np.fft.irfft(np.fft.rfft(road, size) * np.conj(np.fft.rfft(deviations, size)), size)[:points]
    mean, square = (_window_means(values, length)[:points] for values in (road, road**2))
    spread = np.sqrt(np.maximum(square - mean**2, 1e-12)) * max(float(driven.std()), 1e-9)
    correlations = sums / length / spread
    return float(correlations.max()), STEP * int(correlations.argmax())


def _window_means(values: Floats, length: int) -> Floats:
    sums = np.concatenate([[0.0], np.cumsum(values)])
    return np.asarray((sums[length:] - sums[:-length]) / length)


def _refined(motion: Motion, track: Track, start: float, scale: float) -> Floats:
    """Return the progress (metres, per row) along a track after shifting pieces of the driven path."""
    driven, road = _driven_curvatures(motion, scale), _road_curvatures(track)
    width, shifts = round(PIECE / STEP), np.arange(-round(LARGEST_SHIFT / STEP), round(LARGEST_SHIFT / STEP) + 1)
    pieces = max(len(driven) // width, 1)
    points = round(start / STEP) + np.arange(pieces * width)[:, None] + shifts
    squares = (road[points % len(road)] - np.resize(driven, pieces * width)[:, None]) ** 2
    costs = squares.reshape(pieces, width, -1).mean(1) / CURVATURE_DEVIATION**2
    path = STEP * shifts[_cheapest_path(costs)]
    distances = _driven(motion, scale)
    middles = PIECE * (np.arange(pieces) + 0.5)
    return np.asarray((start + distances + np.interp(distances, middles, path)) % track.length)


def _cheapest_path(costs: Floats) -> "np.ndarray[tuple[int], np.dtype[np.int64]]":
    """Return the column for each row of costs (rows x columns), which changes by 1 at most from row to row."""
    change = 0.5 * (STEP / SHIFT_DEVIATION) ** 2
    total, choices = costs[0], []
    for row in costs[1:]:
        padded = np.pad(total, 1, constant_values=np.inf)
        options = np.stack([padded[:-2] + change, total, padded[2:] + change])
        choices.append(options.argmin(0) - 1)
        total = options.min(0) + row
    column = int(total.argmin())
    path = [column]
    for choice in reversed(choices):
        column += int(choice[column])
        path.append(column)
    return np.array(path[::-1])
