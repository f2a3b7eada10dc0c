"""Measurement of the time from a frame until its command is in effect, by the steering that the car reports."""

import math
from collections import deque

import numpy as np

WINDOW = 3.0  # s of commands and reports that are compared
LONGEST = 0.8  # s; larger delays are not looked for
STEP = 0.01  # s, resolution
LEAST_MOVEMENT = 0.02  # standard deviation of the reported steering; without movement there is nothing to see
INTERVAL = 0.5  # s between two measurements


class LoopDelay:
    """Finds the delay at which the steering that the car reports is the steering that was commanded before.

    Each command stays in effect until the next one; the delay is that to the middle of this time.

    Attributes:
        seconds: the delay; 0 until it is known.
    """

    def __init__(self) -> None:
        """Create it for a new drive."""
        self.seconds = 0.0
        self.reset()

    def reset(self) -> None:
        """Forget the commands and reports of a drive; the delay remains known."""
        self._sent: deque[tuple[float, float]] = deque()
        self._seen: deque[tuple[float, float]] = deque()
        self._measured = -math.inf

    def send(self, time: float, steering: float) -> None:
        """Note a command (-1..1) that answers the frame of a time (s)."""
        self._sent.append((time, steering))

    def see(self, time: float, steering: float) -> None:
        """Note the steering (-1..1) that the car reports with the frame of a time (s)."""
        self._seen.append((time, steering))
        for kept in (self._sent, self._seen):
            while kept and kept[0][0] < time - WINDOW:
                kept.popleft()
        if time - self._measured > INTERVAL and len(self._sent) > 10:
            self._measured = time
            self._measure()

    def _measure(self) -> None:
        (times, reported), (sent_times, sent) = np.array(self._seen).T, np.array(self._sent).T
        known = times > sent_times[0] + LONGEST
        if known.sum() < 10 or reported[known].std() < LEAST_MOVEMENT:
            return
        delays = np.arange(STEP, LONGEST, STEP)
        number = np.searchsorted(sent_times, times[known] - delays[:, None], side="right") - 1
        errors = np.square(sent[number] - reported[known]).mean(1)
        best = errors <= errors.min() + 1e-6
        self.seconds = float(delays[best].mean())
