"""Position of a recorded car on the road, told by a network from the images.

The network (road_edge.pt beside this file; benchmarks/road_edge.py trains and checks it) tells the distance of the car
from the road's left edge; the mirrored image gives that from the right edge. It has seen only frames of the built-in
simulator, where the truth is known. The line fit combines what is seen with the motion of the car.
"""

import functools
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import torch
from scipy.ndimage import median_filter

from pilot.arrays import Floats, Frame
from pilot.data.frames import read_frame
from pilot.data.motion import Motion
from pilot.evaluation.reference_path import Line, fit_line
from pilot.evaluation.replay_view import warp
from pilot.model.checkpoint import load_model

NETWORK_FILE = Path(__file__).with_name("road_edge.pt")
BATCH = 64
MIDDLE_DISTANCE, DISTANCE_RANGE = 5.0, 6.0  # metres; a distance of 5 m is the network's output 0, one of 11 m is 1

PATH_SPREAD = 1.5  # metres; prior standard deviation of a car's lateral offset
SIGHT_SPREAD = 1.0  # metres; standard deviation of the offset told by the network; neighbouring rows err alike
DOUBT = 5.0  # the same per metre by which the width told differs from the road's: one of the edges was misread
BEND_CHANGES = 0.02  # 1/m per square root of a metre: hairpins of 10 m radius begin and end at once
WIDTH_ROWS = 101  # rows over which the median of the width is taken
TRIAL_SHIFT = 0.8  # metres by which frames are displaced for the clarity
TRIALS = 50  # frames tried for the clarity of a segment

EdgeDistances = Callable[[Sequence[Frame]], Floats]


@dataclass(frozen=True)
class Road:
    """The road of a segment of n rows.

    Attributes:
        line: the road's middle, with the recorded car's position relative to it.
        half_widths: n, metres from the middle to the edges.
        clarity: how far the offset moves if the frames are displaced, as a share of the displacement: about 1 where the
            road is clearly visible, 0 where it is not.
    """

    line: Line
    half_widths: Floats
    clarity: float


def distance_label(metres: float) -> float:
    """Return the network's output (-1..1) for a distance of the rear axle from the road's left edge."""
    return (metres - MIDDLE_DISTANCE) / DISTANCE_RANGE


@functools.cache
def edge_network() -> EdgeDistances:
    """Return the function from n frames (160x320x3, uint8 RGB) to the distances from the left edge in metres (n).

    Raises:
        UnusableModel: the network's file is missing or damaged.
    """
    network = load_model(NETWORK_FILE).network

    def distances(frames: Sequence[Frame]) -> Floats:
        with torch.inference_mode():
            output = network(torch.from_numpy(np.stack(frames)))
        return np.asarray(output.double().numpy() * DISTANCE_RANGE + MIDDLE_DISTANCE)

    return distances


def find_road(pictures: Sequence[str], motion: Motion) -> Road:
    """Find the road in a segment.

    Args:
        pictures: n, image files of the centre camera.
        motion: motion of the recorded car; n rows.

    Raises:
        UnreadableImage: an image cannot be read.
        UnusableModel: the network's file is missing or damaged.
    """
    parts = [pictures[start : start + BATCH] for start in range(0, len(pictures), BATCH)]
    offsets, told = np.hstack([_sight([read_frame(path) for path in part]) for part in parts])
    half_widths = median_filter(told, WIDTH_ROWS, mode="nearest")
    spread = np.hypot(SIGHT_SPREAD, DOUBT * (told - half_widths))
    return Road(_robust_fit(motion, offsets, spread), half_widths, _clarity(pictures))


def _sight(frames: Sequence[Frame]) -> Floats:
    """Return the offsets from the road's middle and the road's half widths in metres (2 x n)."""
    left = edge_network()(frames)
    right = edge_network()([frame[:, ::-1] for frame in frames])
    return np.stack([left - right, left + right]) / 2


def _clarity(pictures: Sequence[str]) -> float:
    numbers = np.linspace(0, len(pictures) - 1, min(TRIALS, len(pictures))).astype(int)
    frames = [read_frame(pictures[number]) for number in numbers]
    here, aside = (_sight([warp(frame, shift, 0.0) for frame in frames])[0] for shift in (-TRIAL_SHIFT, TRIAL_SHIFT))
    return float(np.clip(np.median(aside - here) / (2 * TRIAL_SHIFT), 0, 1))


def _robust_fit(motion: Motion, seen: Floats, spread: Floats) -> Line:
    """Fit a line robustly, by iteratively reweighted least squares with Cauchy weights."""
    weighed = spread
    for _ in range(4):
        line = fit_line(motion, seen, weighed, BEND_CHANGES)
        weighed = spread * np.sqrt(1 + ((line.offsets - seen) / spread) ** 2)
    return line
