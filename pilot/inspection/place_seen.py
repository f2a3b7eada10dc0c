"""Where the images show the car on the road: off it, or cameras that were swapped."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import pandas as pd

from pilot.arrays import Floats
from pilot.data.frames import read_frame
from pilot.evaluation.replay_road import BATCH, edge_network
from pilot.progress import ProgressBar, no_bar

SIDE_STRIDE = 2  # rows between those whose side cameras are looked at


@dataclass(frozen=True)
class PlaceSeen:
    """Each array has one entry per row, in metres; NaN where nothing was looked at.

    Attributes:
        offsets: of the centre camera's car to the right of the road's middle.
        half_widths: of the road.
        sides: offset that the right camera's image shows, less the left one's; 1.64 m if nothing is wrong.
    """

    offsets: Floats
    half_widths: Floats
    sides: Floats


def see_place(rows: pd.DataFrame, progress: ProgressBar[int] = no_bar) -> PlaceSeen:
    """Look at the images of n rows with the network that finds the road in replays.

    Raises:
        UnreadableImage: an image cannot be read.
        UnusableModel: the network's file is damaged.
    """
    offsets, half_widths, sides = (np.full(len(rows), np.nan) for _ in range(3))
    with_sides = (rows["left"] != "") & (rows["right"] != "")
    for start in progress(range(0, len(rows), BATCH), len(rows), "looking at the road"):
        part = rows.iloc[start : start + BATCH]
        offsets[start : start + BATCH], half_widths[start : start + BATCH] = _sight(part["center"].tolist())
        beside = np.flatnonzero(with_sides.iloc[start : start + BATCH])[::SIDE_STRIDE]
        if len(beside):
            left, right = (_sight(part[camera].iloc[beside].tolist())[0] for camera in ("left", "right"))
            sides[start + beside] = right - left
    return PlaceSeen(offsets, half_widths, sides)


def _sight(paths: Sequence[str]) -> tuple[Floats, Floats]:
    """Return the offsets from the road's middle, and the road's half widths, in metres."""
    frames = [read_frame(path) for path in paths]
    left, right = edge_network()(frames), edge_network()([frame[:, ::-1] for frame in frames])
    return (left - right) / 2, (left + right) / 2
