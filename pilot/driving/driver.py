"""Low-latency CPU inference of a trained model: one frame to steering."""

from collections.abc import Callable, Iterator, Sequence
from pathlib import Path

import numpy as np
import pandas as pd
import torch

from pilot.arrays import Frame
from pilot.data.frames import read_frame
from pilot.driving.plan import FrameHistory, Plan, SteeringPolicy, as_plan, signature_of
from pilot.model.checkpoint import Model
from pilot.model.inference import fast_steps
from pilot.model.side_by_side import SideBySide
from pilot.model.steering_network import SteeringNetwork
from pilot.portable.loading import load
from pilot.portable.onnx_model import OnnxModel
from pilot.signature import SPEED_UNIT, Signature
from pilot.vehicle import COLUMNS, ROWS, WHOLE_FRAME, Rows

DrivingCheck = Callable[[SteeringPolicy], tuple[int, float]]  # to interventions and mean cross-track error in metres

WARM_UP = 5  # forward passes on construction, because the first ones allocate memory and are slow


class Driver:
    """A loaded model that steers; it is a steering policy.

    Attributes:
        model: the loaded model.
        signature: what it sees and answers.
    """

    def __init__(self, model: Model | OnnxModel) -> None:
        """Prepare the network for fast inference and warm it up."""
        self.model = model
        self.signature: Signature = model.signature if isinstance(model, OnnxModel) else model.network.signature
        self._predict = _one_by_one(model) if isinstance(model, OnnxModel) else _side_by_side(model)
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

    def __call__(self, frame: Frame) -> Plan:
        """Return the plan for a frame (160x320x3, uint8 RGB; with a history: K x 160 x 320 x 3, the newest first)."""
        return self.plan_together([frame])[0]

    def steer(self, frame: Frame) -> float:
        """Return the steering (-1..1, right is positive) for one frame, as if the car had stood before it."""
        return self(self.signature.standing(frame)).steering[0]

    def predict(self, frame: Frame) -> list[float]:
        """Return the outputs for a frame, or a history, not clipped: see `SteeringNetwork.predict`."""
        return self._predict([frame])[0]

    def plan_together(self, frames: Sequence[Frame]) -> list[Plan]:
        """Return the plan for each of the frames, to the bit what a call for each returns, in less time."""
        return [plan_of(outputs, self.signature) for outputs in self._predict(frames)]


class NetworkPolicy:
    """Steering policy of a network that is still being trained; slower than a `Driver`.

    Attributes:
        signature: what it sees and answers.
    """

    def __init__(self, network: SteeringNetwork, device: torch.device) -> None:
        """Create the policy; it sets the network to evaluation mode at each frame."""
        self.signature, self._network, self._device = network.signature, network, device

    def __call__(self, frame: Frame) -> Plan:
        """Return the plan for a frame, as `Driver` does."""
        with torch.inference_mode():
            outputs = self._network.eval().predict(torch.from_numpy(frame)[None].to(self._device))
        return plan_of(outputs[0].tolist(), self.signature)


def steering_on(policy: SteeringPolicy, rows: pd.DataFrame) -> Iterator[float]:
    """Yield a policy's steering (-1..1) for each row of a recording, with the frames of the rows before as its history.

    Raises:
        UnreadableImage: an image cannot be read.
    """
    history = FrameHistory(signature_of(policy))
    for time, image in zip(rows["time"], rows["center"], strict=True):
        yield as_plan(policy(history.add(time, read_frame(image)))).steering[0]


def plan_of(outputs: Sequence[float], signature: Signature) -> Plan:
    """Return a network's outputs, see `SteeringNetwork.predict`, as a plan."""
    steering = tuple(min(max(value, -1.0), 1.0) for value in outputs[: len(signature.horizons)])
    speed = max(outputs[-1], 0.0) * SPEED_UNIT if signature.speed else None
    return Plan(steering, signature.horizons, speed)


def _side_by_side(model: Model) -> Callable[[Sequence[Frame]], list[list[float]]]:
    network = SideBySide(fast_steps(model.network))

    def predict(frames: Sequence[Frame]) -> list[list[float]]:
        with torch.inference_mode():
            outputs: list[list[float]] = network(torch.from_numpy(np.stack(frames))).tolist()
        return outputs

    return predict


def _one_by_one(model: OnnxModel) -> Callable[[Sequence[Frame]], list[list[float]]]:
    return lambda frames: [model.predict(frame) for frame in frames]
