"""Low-latency CPU inference of a trained model: one frame to steering."""

from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np
import torch

from pilot.arrays import Frame
from pilot.model.checkpoint import Model, load_model
from pilot.model.inference import fast_steps
from pilot.model.side_by_side import SideBySide
from pilot.vehicle import COLUMNS, ROWS

SteeringPolicy = Callable[[Frame], float]  # a 160x320x3 uint8 RGB frame to steering, -1..1
DrivingCheck = Callable[[SteeringPolicy], tuple[int, float]]  # to interventions and mean cross-track error in metres

WARM_UP = 5  # forward passes on construction, because the first ones allocate memory and are slow


class Driver:
    """A loaded model that steers; its method `steer` is a steering policy.

    Attributes:
        model: the loaded model.
    """

    def __init__(self, model: Model) -> None:
        """Prepare the network for fast inference and warm it up."""
        self.model = model
        self._network = SideBySide(fast_steps(model.network))
        for _ in range(WARM_UP):
            self.steer(np.zeros((ROWS, COLUMNS, 3), np.uint8))

    @classmethod
    def load(cls, path: Path) -> "Driver":
        """Load a model file.

        Raises:
            UnusableModel: the file is missing, damaged, or not a model of this program.
        """
        return cls(load_model(path))

    def steer(self, frame: Frame) -> float:
        """Return the steering (-1..1, right is positive) for a frame (160x320x3, uint8 RGB)."""
        with torch.inference_mode():
            steering = self._network(torch.from_numpy(np.ascontiguousarray(frame)[None]))
        return min(max(float(steering), -1.0), 1.0)

    def steer_together(self, frames: Sequence[Frame]) -> list[float]:
        """Return what `steer` returns for each of the frames, to the bit, in less time."""
        with torch.inference_mode():
            steering = self._network(torch.from_numpy(np.stack(frames)))
        return [min(max(value, -1.0), 1.0) for value in steering.tolist()]
