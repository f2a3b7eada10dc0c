"""The path of a recorded car, from its steering and speed, beside a smooth line along the road.

The line is that which best explains three things at once, by least squares: roads bend smoothly; the
car moved as its steering and speed say (bicycle model), but for a little slip; and it stood beside the
line where it was seen to stand. Everything counts to the right, in metres and radians, as in camera.py;
angles between car and line are taken as small.
"""

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
import pandas as pd
from numpy.typing import NDArray
from scipy import sparse
from scipy.sparse.linalg import spsolve

from pilot.arrays import Floats
from pilot.data.segments import breaks
from pilot.simulator.car import path_curvature
from pilot.vehicle import MPH

HARDEST = 12.0  # m/s², more than tyres can do: the car was put somewhere else
SHORTEST_SEGMENT = 5.0  # s
SLOWEST_RATE = 4.0  # rows a second; at 30 mph the car moves by 3.4 m from one to the next
STANDING = 0.01  # metres between two rows, at least, that the equations are given

# What the least squares hold to be likely, as standard deviations.
BEND_CHANGES = 0.004  # 1/m per square root of a metre driven: how quickly roads begin to bend
TURN_SLIPS = 0.003  # rad per square root of a metre: turns that steering does not explain
TURN_SHARE = 0.05  # the same as a share of the turn that was steered
SIDE_SLIPS = (0.005, 0.01)  # metres from row to row, and metres per metre driven


class UnusableRecording(ValueError):
    """A recording that cannot be replayed; the message says why and what to do."""


@dataclass(frozen=True)
class Motion:
    """How a recorded car moved; an entry a row.

    Attributes:
        seconds: to the next row.
        steps: metres driven until the next row.
        speeds: m/s.
        curvatures: 1/m, of the path that it steered.
    """

    seconds: Floats
    steps: Floats
    speeds: Floats
    curvatures: Floats


@dataclass(frozen=True)
class Line:
    """A smooth line along a road, and where the recorded car stood beside it; an entry a row.

    Attributes:
        offsets: metres, of the car's rear axle to the right of the line.
        headings: radians, by which the car pointed to the right of the line.
        curvatures: 1/m, of the line.
    """

    offsets: Floats
    headings: Floats
    curvatures: Floats


def continuous_segments(rows: pd.DataFrame) -> Iterator[pd.DataFrame]:
    """The stretches of a log (as of `DrivingLog.rows`) that were driven without a break, if long enough.

    A break is a pause, another recording, or a change of speed that no car can do: after it the car
    stands somewhere else.

    Raises:
        UnusableRecording: the log has no speed, or too few rows a second.
    """
    if rows["speed"].isna().any():
        raise UnusableRecording("the log holds no speed, without which the driven path is unknown: record anew")
    pause = rows["time"].diff()
    leap = rows["speed"].diff().abs() * MPH > HARDEST * pause + 0.5
    broken = breaks(rows) | (pause == 0) | leap
    if pause[~broken].median() > 1 / SLOWEST_RATE:
        raise UnusableRecording(
            f"{1 / pause[~broken].median():.1f} rows a second are too few to replay: "
            f"record at least {SLOWEST_RATE:g}, better 10"
        )
    for _, segment in rows.groupby(broken.cumsum(), sort=False):
        if segment["time"].iloc[-1] - segment["time"].iloc[0] >= SHORTEST_SEGMENT:
            yield segment.reset_index(drop=True)


def motion_of(segment: pd.DataFrame) -> Motion:
    """How the car moved in a drive, by its log."""
    seconds = np.diff(segment["time"].to_numpy(float), append=math.nan)
    seconds[-1] = np.median(seconds[:-1])
    speeds = segment["speed"].to_numpy(float) * MPH
    curvatures = [path_curvature(*moment) for moment in zip(segment["steering"], speeds, strict=True)]
    return Motion(seconds, speeds * seconds, speeds, np.array(curvatures))


def fit_line(motion: Motion, seen: Floats, spread: Floats) -> Line:
    """The line that best explains how the car moved and where it was seen.

    Args:
        motion: of the recorded car; n rows.
        seen: n, metres to the right of the line at which the car was seen to stand.
        spread: n, metres, standard deviation of that.
    """
    count = len(seen)
    offset, heading, bend = np.arange(3 * count).reshape(3, count)  # where each is among the unknowns
    now, then = np.s_[:-1], np.s_[1:]
    step, turn = np.maximum(motion.steps[now], STANDING), (motion.curvatures * motion.steps)[now]
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
        _equations([(bend[then], ones), (bend[now], -ones)], 0 * ones, BEND_CHANGES * np.sqrt(step)),
        _equations([(offset, np.ones(count))], seen, spread),
    )
    matrix = sparse.vstack([left for left, _ in equations], format="csc")
    wanted = np.concatenate([right for _, right in equations])
    solution = spsolve((matrix.T @ matrix).tocsc(), matrix.T @ wanted)
    return Line(*solution.reshape(3, count))


Terms = Sequence[tuple[NDArray[np.int64], Floats]]


def _equations(terms: Terms, wanted: Floats, deviation: Floats) -> tuple[sparse.coo_matrix, Floats]:
    """Rows `sum of coefficient * unknown = wanted`, each divided by its standard deviation."""
    count = len(wanted)
    columns = np.concatenate([unknowns for unknowns, _ in terms])
    values = np.concatenate([coefficients / deviation for _, coefficients in terms])
    rows = np.tile(np.arange(count), len(terms))
    width = 3 * (count + (1 if len(terms) > 1 else 0))  # dynamics have an equation less than there are rows
    return sparse.coo_matrix((values, (rows, columns)), (count, width)), wanted / deviation
