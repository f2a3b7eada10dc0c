"""Forms of one model side by side: how long they take, and how much their steering differs."""

import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from pilot.arrays import Frame
from pilot.progress import ProgressBar, no_bar

WARM_UP = 5  # first calls, which allocate memory


@dataclass(frozen=True)
class Measured:
    """Figures of one form of a model.

    Attributes:
        form: its name.
        median_ms, percentile_99_ms: time from frame to steering.
        largest_difference, mean_difference: of the steering (-1..1) from that of the first form.
    """

    form: str
    median_ms: float
    percentile_99_ms: float
    largest_difference: float
    mean_difference: float


def compare(
    forms: Mapping[str, Callable[[Frame], float]], frames: Sequence[Frame], progress: ProgressBar[Frame] = no_bar
) -> list[Measured]:
    """Measure forms of a model.

    The forms take turns, frame by frame, so that other programs disturb all of them alike.

    Args:
        forms: functions from a frame (160x320x3, uint8 RGB) to steering, by name.
        frames: typical frames.
        progress: progress bar.
    """
    for steer in forms.values():
        for frame in frames[:WARM_UP]:
            steer(frame)
    times: dict[str, list[float]] = {name: [] for name in forms}
    steering: dict[str, list[float]] = {name: [] for name in forms}
    for frame in progress(frames, len(frames), "comparing"):
        for name, steer in forms.items():
            began = time.perf_counter()
            steering[name].append(min(max(steer(frame), -1.0), 1.0))  # as drive.py
            times[name].append(1000 * (time.perf_counter() - began))
    reference = np.array(next(iter(steering.values())))
    return [
        Measured(
            name,
            float(np.percentile(times[name], 50)),
            float(np.percentile(times[name], 99)),
            float(np.abs(np.array(steering[name]) - reference).max()),
            float(np.abs(np.array(steering[name]) - reference).mean()),
        )
        for name in forms
    ]
