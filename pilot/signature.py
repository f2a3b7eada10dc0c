"""What a network takes and returns besides the usual: one frame in, the steering for it out."""

from dataclasses import dataclass
from typing import Any

import numpy as np

from pilot.arrays import Frame
from pilot.vehicle import TOP_SPEED_MPH

SPEED_AHEAD = (
    1.0  # s; the speed that is predicted is the one to be reached by then, so that the car brakes before bends
)
SPEED_UNIT = TOP_SPEED_MPH  # mph; networks predict the speed as a share of it, so that it is of the steering's size


@dataclass(frozen=True)
class Signature:
    """Inputs and outputs of a network.

    Attributes:
        history: for each earlier frame that the network sees, its time before the newest one in seconds, ascending.
        horizons: for each steering that it predicts, its time after the newest frame in seconds, ascending from 0. A
            steering of later takes effect in time if the simulator answers late.
        speed: whether it also predicts the speed to drive.
    """

    history: tuple[float, ...] = ()
    horizons: tuple[float, ...] = (0.0,)
    speed: bool = False

    @property
    def frames(self) -> int:
        """Number of frames that the network sees."""
        return 1 + len(self.history)

    def standing(self, frame: Frame) -> Frame:
        """Return the input for one frame (160x320x3): with a history, as if the car had stood before it."""
        return np.stack([frame] * self.frames) if self.history else frame

    @property
    def outputs(self) -> int:
        """Number of values that it predicts: the steering for each horizon, and the speed."""
        return len(self.horizons) + self.speed


STEERING_ONLY = Signature()


def signature_from(values: Any) -> Signature:
    """Restore a signature from plain values, as of a file.

    Raises:
        ValueError: they are no signature.
    """
    try:
        history, horizons = (tuple(map(float, values.get(name, []))) for name in ("history", "horizons"))
        return Signature(history, horizons or STEERING_ONLY.horizons, bool(values.get("speed", False)))
    except (AttributeError, TypeError) as error:
        raise ValueError("no signature of a network") from error
