"""Motion of a recorded car, from its steering and speed, and the steering that leads along the driven path."""

from dataclasses import dataclass

import numpy as np
import pandas as pd

from pilot.arrays import Floats, sums_before
from pilot.data.segments import breaks
from pilot.vehicle import MPH, curvature_to_steering, path_curvature

MAX_ACCELERATION = 12.0  # m/s²; more than tyres allow: the car was moved to another place
SHORTEST_PATH = 1.0  # metres; what a driver steers for cannot be told from less


@dataclass(frozen=True)
class Motion:
    """Motion of a recorded car; each array has one entry per row.

    Attributes:
        seconds: time to the next row in s.
        steps: distance driven to the next row in metres.
        speeds: speed in m/s.
        curvatures: curvature of the steered path in 1/m.
    """

    seconds: Floats
    steps: Floats
    speeds: Floats
    curvatures: Floats


def motion_breaks(rows: pd.DataFrame) -> "pd.Series[bool]":
    """Mark the rows that begin a new motion: those of `breaks`, repeated times, and impossible changes of speed.

    The car was moved to another place there, as after a crash.
    """
    pause = rows["time"].diff()
    leap = rows["speed"].diff().abs() * MPH > MAX_ACCELERATION * pause + 0.5
    return breaks(rows) | (pause == 0) | leap


def motion_of(segment: pd.DataFrame) -> Motion:
    """Return the motion of the car in rows without `motion_breaks`, at least two."""
    seconds = np.diff(segment["time"].to_numpy(float), append=np.nan)
    seconds[-1] = np.median(seconds[:-1])
    speeds = segment["speed"].to_numpy(float) * MPH
    curvatures = [path_curvature(*moment) for moment in zip(segment["steering"], speeds, strict=True)]
    return Motion(seconds, speeds * seconds, speeds, np.array(curvatures))


def path_steering(rows: pd.DataFrame, metres: float) -> "pd.Series[float]":
    """Return the steering that leads each row's car to the point of the driven path `metres` ahead (pure pursuit).

    A keyboard driver steers in pulses, but the car's path is smooth: it shows where the driver steered for. Rows whose
    path is unknown keep the recorded steering: without a speed, and at the end of a motion.

    Args:
        rows: rows of driving logs, as in `DrivingLog.rows`.
        metres: distance along the path, from the rear axle.
    """
    steering = rows["steering"].astype(float)
    for _, part in rows.groupby(motion_breaks(rows).cumsum()):
        if len(part) > 1 and not part["speed"].isna().any():
            steering[part.index] = _pursuit(motion_of(part), part["steering"].to_numpy(float), metres)
    return steering


def _pursuit(motion: Motion, recorded: Floats, metres: float) -> Floats:
    turns = motion.curvatures * motion.steps
    driven, heading = sums_before(motion.steps), sums_before(turns)
    east = sums_before(np.sin(heading + turns / 2) * motion.steps)
    north = sums_before(np.cos(heading + turns / 2) * motion.steps)
    target = np.minimum(driven + metres, driven[-1])
    aside, ahead = np.interp(target, driven, east) - east, np.interp(target, driven, north) - north
    right = aside * np.cos(heading) - ahead * np.sin(heading)
    known = target - driven > SHORTEST_PATH
    curvature = 2 * right / np.where(known, aside**2 + ahead**2, 1)
    return np.where(known, np.clip(curvature_to_steering(curvature), -1, 1), recorded)
