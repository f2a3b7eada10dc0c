"""Forms of one model side by side: how long they take, and how much their steering differs."""

import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from pilot.arrays import Frame
from pilot.progress import ProgressBar, no_bar
from pilot.signature import Signature

Predict = Callable[[Frame], Sequence[float]]

WARM_UP = 5  # first calls, which allocate memory


@dataclass(frozen=True)
class Measured:
    """Figures of one form of a model.

    Attributes:
        form: its name.
        median_ms, percentile_99_ms: time from frame to steering.
        largest_difference, mean_difference: of the outputs (-1..1) from those of the first form.
    """

    form: str
    median_ms: float
    percentile_99_ms: float
    largest_difference: float
    mean_difference: float


def compare(
    forms: Mapping[str, Predict], frames: Sequence[Frame], progress: ProgressBar[Frame] = no_bar
) -> list[Measured]:
    """Measure forms of a model.

    The forms take turns, frame by frame, so that other programs disturb all of them alike.

    Args:
        forms: functions from a frame (160x320x3, uint8 RGB), or a history, to the network's outputs, by name.
        frames: typical inputs of them.
        progress: progress bar.
    """
    for predict in forms.values():
        for frame in frames[:WARM_UP]:
            predict(frame)
    times: dict[str, list[float]] = {name: [] for name in forms}
    outputs: dict[str, list[Sequence[float]]] = {name: [] for name in forms}
    for frame in progress(frames, len(frames), "comparing"):
        for name, predict in forms.items():
            began = time.perf_counter()
            outputs[name].append(predict(frame))
            times[name].append(1000 * (time.perf_counter() - began))
    clipped = {name: np.clip(each, -1.0, 1.0) for name, each in outputs.items()}  # as drive.py
    reference = next(iter(clipped.values()))
    return [
        Measured(
            name,
            float(np.percentile(times[name], 50)),
            float(np.percentile(times[name], 99)),
            float(np.abs(clipped[name] - reference).max()),
            float(np.abs(clipped[name] - reference).mean()),
        )
        for name in forms
    ]


def inputs_of(frames: Sequence[Frame], signature: Signature) -> list[Frame]:
    """Return a network's input for each frame: with a history, the frames before it stand for the earlier ones."""
    if not signature.history:
        return list(frames)
    ages = range(signature.frames)
    return [np.stack([frames[max(number - age, 0)] for age in ages]) for number in range(len(frames))]
