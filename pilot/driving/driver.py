"""Low-latency CPU inference of a trained model: one frame to steering."""

from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np
import torch

from pilot.arrays import Frame
from pilot.model.checkpoint import Model
from pilot.model.inference import fast_steps
from pilot.model.side_by_side import SideBySide
from pilot.portable.loading import load
from pilot.portable.onnx_model import OnnxModel
from pilot.vehicle import COLUMNS, ROWS, WHOLE_FRAME, Rows

SteeringPolicy = Callable[[Frame], float]  # a 160x320x3 uint8 RGB frame to steering, -1..1
DrivingCheck = Callable[[SteeringPolicy], tuple[int, float]]  # to interventions and mean cross-track error in metres

WARM_UP = 5  # forward passes on construction, because the first ones allocate memory and are slow


class Driver:
    """A loaded model that steers; its method `steer` is a steering policy.

    Attributes:
        model: the loaded model.
    """

    def __init__(self, model: Model | OnnxModel) -> None:
        """Prepare the network for fast inference and warm it up."""
        self.model = model
        self._steer = _one_by_one(model) if isinstance(model, OnnxModel) else _side_by_side(model)
        for _ in range(WARM_UP):
            self.steer(np.zeros((ROWS, COLUMNS, 3), np.uint8))

    @classmethod
    def load(cls, path: Path) -> "Driver":
        """Load a model file or an ONNX file.

        Raises:
            UnusableModel: the file is missing, damaged, or not a model of this program.
        """
        return cls(load(path))

    @property
    def seen_rows(self) -> Rows:
        """Rows of a frame on which the steering depends; of an ONNX file, that is not known."""
        return self.model.network.seen_rows if isinstance(self.model, Model) else WHOLE_FRAME

    def steer(self, frame: Frame) -> float:
        """Return the steering (-1..1, right is positive) for a frame (160x320x3, uint8 RGB)."""
        return self.steer_together([frame])[0]

    def steer_together(self, frames: Sequence[Frame]) -> list[float]:
        """Return what `steer` returns for each of the frames, to the bit, in less time."""
        return [min(max(value, -1.0), 1.0) for value in self._steer(frames)]


def _side_by_side(model: Model) -> Callable[[Sequence[Frame]], list[float]]:
    network = SideBySide(fast_steps(model.network))

    def steer(frames: Sequence[Frame]) -> list[float]:
        with torch.inference_mode():
            steering: list[float] = network(torch.from_numpy(np.stack(frames))).tolist()
        return steering

    return steer


def _one_by_one(model: OnnxModel) -> Callable[[Sequence[Frame]], list[float]]:
    return lambda frames: [model.steer(frame) for frame in frames]
