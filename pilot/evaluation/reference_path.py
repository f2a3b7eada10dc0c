"""A smooth line along the road, fitted to the motion of a recorded car.

The fit is a linear least-squares problem with three kinds of equations: the line's curvature changes slowly; the car
moves by a bicycle model with the recorded steering and speed, apart from a little slip; and its offset from the line
equals the measured one. Units are metres and radians, positive to the right, as in camera.py; angles between the car
and the line are assumed to be small.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
import pandas as pd
from numpy.typing import NDArray
from scipy import sparse
from scipy.sparse.linalg import spsolve

from pilot.arrays import Floats
from pilot.data.motion import Motion, motion_breaks

SHORTEST_SEGMENT = 5.0  # s; shorter ones are not replayed
SLOWEST_RATE = 4.0  # rows per second; at 30 mph the car moves 3.4 m between two rows
MIN_STEP = 0.01  # metres; lower bound of the distance between two rows, so that no deviation is 0

# Standard deviations of the equations
BEND_CHANGES = 0.004  # 1/m per square root of a metre driven: changes of the road's curvature, if it was not seen
TURN_SLIPS = 0.003  # rad per square root of a metre driven: changes of heading that steering does not explain
TURN_SHARE = 0.05  # the same, as a share of the steered change of heading
SIDE_SLIPS = (0.005, 0.01)  # lateral slip in metres per row, and in metres per metre driven


class UnusableRecording(ValueError):
    """The recording cannot be replayed; the message states the reason and what to do."""


@dataclass(frozen=True)
class Line:
    """A smooth line along a road, and the recorded car's pose relative to it; each array has one entry per row.

    Attributes:
        offsets: metres by which the car's rear axle is to the right of the line.
        headings: radians by which the car is turned to the right relative to the line.
        curvatures: curvature of the line in 1/m.
    """

    offsets: Floats
    headings: Floats
    curvatures: Floats


def continuous_segments(rows: pd.DataFrame) -> Iterator[pd.DataFrame]:
    """Yield the segments of a log that are long enough for a replay.

    Segments also end at repeated times, and at changes of speed that are physically impossible, because the car was
    moved there.

    Args:
        rows: rows of a driving log, as in `DrivingLog.rows`.

    Raises:
        UnusableRecording: the log contains no speed, or too few rows per second.
    """
    if rows["speed"].isna().any():
        raise UnusableRecording("the log holds no speed, without which the driven path is unknown: record again")
    pause, broken = rows["time"].diff(), motion_breaks(rows)
    if pause[~broken].median() > 1 / SLOWEST_RATE:
        raise UnusableRecording(
            f"{1 / pause[~broken].median():.1f} rows a second are too few for a replay: "
            f"record at least {SLOWEST_RATE:g}, better 10"
        )
    for _, segment in rows.groupby(broken.cumsum(), sort=False):
        if segment["time"].iloc[-1] - segment["time"].iloc[0] >= SHORTEST_SEGMENT:
            yield segment.reset_index(drop=True)


def fit_line(motion: Motion, seen: Floats, spread: Floats, bend_changes: float = BEND_CHANGES) -> Line:
    """Fit a line to the motion of the car and to measurements of its offset.

    Args:
        motion: motion of the recorded car; n rows.
        seen: n, measured offset of the car in metres to the right of the line.
        spread: n, standard deviation of `seen` in metres.
        bend_changes: standard deviation of the changes of the line's curvature in 1/m per square root of a metre.
    """
    count = len(seen)
    offset, heading, bend = np.arange(3 * count).reshape(3, count)  # indices of the unknowns
    now, then = np.s_[:-1], np.s_[1:]
    step, turn = np.maximum(motion.steps[now], MIN_STEP), (motion.curvatures * motion.steps)[now]
    ones = np.ones_like(step)
    equations = (
        _equations(
            [(offset[then], ones), (offset[now], -ones), (heading[now], -step), (bend[now], step**2 / 2)],
            turn * step / 2,
            SIDE_SLIPS[0] + SIDE_SLIPS[1] * step,
        ),
        _equations(
            [(heading[then], ones), (heading[now], -ones), (bend[now], step)],
            turn,
            np.hypot(TURN_SLIPS * np.sqrt(step), TURN_SHARE * turn),
        ),
        _equations([(bend[then], ones), (bend[now], -ones)], 0 * ones, bend_changes * np.sqrt(step)),
        _equations([(offset, np.ones(count))], seen, spread),
    )
    matrix = sparse.vstack([left for left, _ in equations], format="csc")
    wanted = np.concatenate([right for _, right in equations])
    solution = spsolve((matrix.T @ matrix).tocsc(), matrix.T @ wanted)
    return Line(*solution.reshape(3, count))


Terms = Sequence[tuple[NDArray[np.int64], Floats]]


def _equations(terms: Terms, wanted: Floats, deviation: Floats) -> tuple[sparse.coo_matrix, Floats]:
    """Return the equations `sum of coefficient * unknown = wanted`, each divided by its standard deviation."""
    count = len(wanted)
    columns = np.concatenate([unknowns for unknowns, _ in terms])
    values = np.concatenate([coefficients / deviation for _, coefficients in terms])
    rows = np.tile(np.arange(count), len(terms))
    width = 3 * (count + (1 if len(terms) > 1 else 0))  # n rows have n - 1 equations between them
    return sparse.coo_matrix((values, (rows, columns)), (count, width)), wanted / deviation
