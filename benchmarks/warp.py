"""Accuracy of the replay's warping: centre frames warped to the side cameras' positions, compared with the side frames.

python benchmarks/warp.py RECORDING... [--sheet sheet.png]
"""

import argparse
import sys
from collections.abc import Iterator
from pathlib import Path

import cv2
import numpy as np
import pandas as pd

sys.path.insert(0, str(Path(__file__).parents[1]))

from pilot.arrays import Frame
from pilot.data.driving_log import read_driving_logs
from pilot.data.frames import read_frame
from pilot.evaluation.replay_view import warp
from pilot.vehicle import CAMERA_OFFSETS

ROAD = np.s_[75:132, 60:260]  # region that shows flat ground and no pixels beyond the border of the frame
LOOKED_AT = 100  # time steps compared per recording


def triples(rows: pd.DataFrame) -> Iterator[tuple[Frame, Frame, Frame]]:
    """Yield the centre frame, the same warped to a side camera's position, and that camera's frame."""
    for _, row in rows.iloc[:: max(len(rows) // LOOKED_AT, 1)].iterrows():
        centre = read_frame(row["center"])
        for side in ("left", "right"):
            if row[side]:
                yield centre, warp(centre, CAMERA_OFFSETS[side], 0.0), read_frame(row[side])


def difference(first: Frame, second: Frame) -> float:
    """Return the mean absolute difference of two frames in the region of the road, in grey levels (0..255)."""
    return float(np.abs(first[ROAD].astype(float) - second[ROAD]).mean())


def main() -> None:
    """Print the mean differences of each recording, without and with warping."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("recordings", type=Path, nargs="+")
    parser.add_argument("--sheet", type=Path, help="also put every 40th triple into a picture")
    options = parser.parse_args()
    sheet: list[Frame] = []
    for folder in options.recordings:
        found = list(triples(read_driving_logs([folder]).rows))
        errors = np.mean([(difference(centre, side), difference(moved, side)) for centre, moved, side in found], axis=0)
        print(f"{folder.name}: {errors[0]:.1f} grey levels as it is, {errors[1]:.1f} moved ({len(found)} pictures)")
        sheet += [np.hstack(each) for each in found[::40]]
    if options.sheet:
        cv2.imwrite(str(options.sheet), np.vstack(sheet)[..., ::-1])


if __name__ == "__main__":
    main()
