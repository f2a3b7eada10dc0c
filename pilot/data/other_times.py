"""What a network sees and predicts of other times than that of its newest frame, as columns of time steps."""

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from pilot.arrays import Floats
from pilot.data.segments import segment_numbers
from pilot.signature import SPEED_AHEAD, Signature
from pilot.vehicle import CAMERAS

SPEED_COLUMN = "speed ahead"
TOLERANCE = 1e-6  # s, for times that are equal but for rounding


def image_columns(signature: Signature, newest: str = "image") -> list[str]:
    """Return the names of the columns of the images that a network sees, the newest first."""
    return [newest, *(f"{newest} -{seconds:g} s" for seconds in signature.history)]


def steering_columns(signature: Signature) -> list[str]:
    """Return the names of the columns of the labels of its steering, that of now first."""
    return ["steering", *(f"steering +{seconds:g} s" for seconds in signature.horizons[1:])]


def label_columns(signature: Signature) -> list[str]:
    """Return the names of the columns of the labels of all its outputs."""
    return steering_columns(signature) + [SPEED_COLUMN] * signature.speed


def with_other_times(moments: pd.DataFrame, signature: Signature) -> pd.DataFrame:
    """Add the earlier images of each camera, the later steering and the speed ahead to time steps.

    The speed of a drive in which somebody corrects a model is not to be learned.
    """
    added: dict[str, Floats | pd.Series[str]] = {}
    for name, seconds in zip(steering_columns(signature)[1:], signature.horizons[1:], strict=True):
        added[name] = later(moments, moments["steering"], seconds)
    if signature.speed:
        added[SPEED_COLUMN] = later(moments, moments["speed"].where(~moments["correction"]), SPEED_AHEAD)
    for number, seconds in enumerate(signature.history, 1):
        before = earlier(moments, seconds)
        for camera in CAMERAS:
            images = moments[camera].iloc[before].set_axis(moments.index)
            added[image_columns(signature, camera)[number]] = images.where(images != "", moments[camera])
    return moments.assign(**added)


def require_labels(samples: pd.DataFrame, signature: Signature) -> None:
    """Check that each output of a network can be learned.

    Raises:
        ValueError: an output has no label, as in the built-in training data, whose rows are 2.5 s apart.
    """
    for name in label_columns(signature):
        if samples[name].isna().all():
            raise ValueError(
                f"no row is followed by others closely enough to know its {name!r}, which the network predicts: use "
                "recordings of whole drives. Without --data and own recordings, model.py makes them"
            )


def later(rows: pd.DataFrame, values: "pd.Series[float]", seconds: float) -> Floats:
    """Return the values (n) `seconds` after each of n rows, interpolated; NaN after the end of its segment."""
    found = np.full(len(rows), np.nan)
    for index, time in _segments(rows):
        own = values.to_numpy(float)[index]
        wanted = np.minimum(time + seconds, time[-1] + TOLERANCE)
        inside = time + seconds <= time[-1] + TOLERANCE
        found[index] = np.where(inside, np.interp(wanted, time, own), np.nan)
    return found


def earlier(rows: pd.DataFrame, seconds: float) -> NDArray[np.int64]:
    """Return for each of n rows the position of the one nearest to `seconds` before it.

    It is the row itself if there is none within half of this time: at the beginning of a segment, and where rows are
    missing.
    """
    found = np.arange(len(rows))
    for index, time in _segments(rows):
        middles = (time[1:] + time[:-1]) / 2
        nearest = np.searchsorted(middles, time - seconds - TOLERANCE)
        near = np.abs(time - time[nearest] - seconds) <= seconds / 2 + TOLERANCE
        found[index] = index[np.where(near, nearest, np.arange(len(index)))]
    return found


def _segments(rows: pd.DataFrame) -> list[tuple[NDArray[np.int64], Floats]]:
    """Return the positions and times (s) of the rows of each segment."""
    time = rows["time"].to_numpy(float)
    groups = pd.Series(np.arange(len(rows))).groupby(segment_numbers(rows).to_numpy())
    return [(index.to_numpy(), time[index.to_numpy()]) for _, index in groups]
