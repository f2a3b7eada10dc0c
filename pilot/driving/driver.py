"""Low-latency CPU inference of a trained model: one frame to steering."""

from collections.abc import Callable
from pathlib import Path

import numpy as np
import torch

from pilot.arrays import Frame
from pilot.model.checkpoint import Model
from pilot.model.inference import fast_forward
from pilot.portable.loading import load
from pilot.portable.onnx_model import OnnxModel
from pilot.vehicle import COLUMNS, ROWS

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
        self._steer = model.steer if isinstance(model, OnnxModel) else _fast(model)
        for _ in range(WARM_UP):
            self.steer(np.zeros((ROWS, COLUMNS, 3), np.uint8))

    @classmethod
    def load(cls, path: Path) -> "Driver":
        """Load a model file or an ONNX file.

        Raises:
            UnusableModel: the file is missing, damaged, or not a model of this program.
        """
        return cls(load(path))

    def steer(self, frame: Frame) -> float:
        """Return the steering (-1..1, right is positive) for a frame (160x320x3, uint8 RGB)."""
        return min(max(self._steer(np.ascontiguousarray(frame)), -1.0), 1.0)


def _fast(model: Model) -> SteeringPolicy:
    """Return the steering policy of a network, not clipped."""
    network = fast_forward(model.network)

    def steer(frame: Frame) -> float:
        with torch.inference_mode():
            return float(network(torch.from_numpy(frame[None])))

    return steer
