"""What a model answers to a frame, and the earlier frames that some models want to see with it."""

from collections import deque
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from pilot.arrays import Frame
from pilot.signature import STEERING_ONLY, Signature


@dataclass(frozen=True)
class Plan:
    """What a model wants to do from a frame on.

    Attributes:
        steering: for each horizon, -1..1, right is positive.
        horizons: times after the frame in s, ascending from 0.
        speed: mph; None: the model only steers.
    """

    steering: tuple[float, ...]
    horizons: tuple[float, ...] = (0.0,)
    speed: float | None = None

    def at(self, seconds: float) -> float:
        """Return the steering for a time after the frame, that of the last horizon if it is later."""
        if len(self.steering) == 1:
            return self.steering[0]
        return float(np.interp(seconds, self.horizons, self.steering))


# From a 160x320x3 uint8 RGB frame to steering (-1..1) or a plan. A policy with an attribute `signature` that asks for a
# history gets K x 160 x 320 x 3, the newest frame first.
SteeringPolicy = Callable[[Frame], float | Plan]


def as_plan(answer: float | Plan) -> Plan:
    """Return a policy's answer as a plan."""
    return answer if isinstance(answer, Plan) else Plan((answer,))


def signature_of(policy: SteeringPolicy) -> Signature:
    """Return what a policy sees and answers; a function without the attribute `signature` steers by one frame."""
    signature: Signature = getattr(policy, "signature", STEERING_ONLY)
    return signature


class FrameHistory:
    """The last frames of a drive, for policies that see earlier ones."""

    def __init__(self, signature: Signature) -> None:
        """Create an empty history for a policy's signature."""
        self._ages = np.array(signature.history)
        self._kept: deque[tuple[float, Frame]] = deque()

    def clear(self) -> None:
        """Forget all frames, because the car was moved."""
        self._kept.clear()

    def add(self, time: float, frame: Frame) -> Frame:
        """Add a frame (160x320x3, uint8 RGB) at a time in s, and return what the policy sees.

        It is the frame, or, with the earlier ones nearest to the wanted times, K x 160 x 320 x 3. At the beginning of a
        drive, the first frame stands for those before it.
        """
        if not len(self._ages):
            return frame
        if self._kept and self._kept[-1][0] >= time:  # the clock was set back: another drive
            self.clear()
        self._kept.append((time, frame))
        while len(self._kept) > 2 and self._kept[1][0] < time - self._ages[-1]:
            self._kept.popleft()
        times = np.array([kept for kept, _ in self._kept])
        nearest = np.abs(times - (time - self._ages)[:, None]).argmin(1)
        return np.stack([frame, *(self._kept[number][1] for number in nearest)])
