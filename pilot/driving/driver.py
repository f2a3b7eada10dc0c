"""model.pt → steering for one camera frame, as fast as the CPU gives it."""

from collections.abc import Callable
from pathlib import Path

import numpy as np
import torch

from pilot.arrays import Frame
from pilot.model.checkpoint import Model, load_model
from pilot.model.inference import fast_forward
from pilot.vehicle import COLUMNS, ROWS

SteeringPolicy = Callable[[Frame], float]  # a 160x320x3 uint8 RGB frame to steering, -1..1
DrivingCheck = Callable[[SteeringPolicy], tuple[int, float]]  # drives: interventions, mean cross-track error in metres

WARM_UP = 5  # the first runs of a network allocate memory, which must not happen while the car drives


class Driver:
    """Steers by a trained model. The whole interface: `steer(frame)`.

    Attributes:
        model: the loaded model.
    """

    def __init__(self, model: Model) -> None:
        """Freeze the network and warm it up, so that the first car waits no longer than any other."""
        self.model = model
        self._network = fast_forward(model.network)
        for _ in range(WARM_UP):
            self.steer(np.zeros((ROWS, COLUMNS, 3), np.uint8))

    @classmethod
    def load(cls, path: Path) -> "Driver":
        """Load a model file.

        Raises:
            UnusableModel: the file is missing, damaged, or no model of this program.
        """
        return cls(load_model(path))

    def steer(self, frame: Frame) -> float:
        """Steering (-1..1, right is positive) for a 160x320x3 uint8 RGB frame."""
        with torch.inference_mode():
            steering = self._network(torch.from_numpy(np.ascontiguousarray(frame)[None]))
        return min(max(float(steering), -1.0), 1.0)
