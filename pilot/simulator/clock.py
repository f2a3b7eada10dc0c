"""Conversion of real time to ticks of the physics."""

from pilot.vehicle import TICK

LONGEST_FRAME = 1 / 3  # s; longer intervals are cut to this, as in Unity


class TickClock:
    """Converts the time between frames to ticks of 20 ms, independently of the frame rate."""

    def __init__(self) -> None:
        self._ahead = 0.0  # s that have passed since the last whole tick

    def ticks(self, seconds: float) -> int:
        """Return the number of ticks that are due, `seconds` after the previous call."""
        self._ahead += min(seconds, LONGEST_FRAME)
        due = int(self._ahead / TICK + 1e-9)  # 1e-9: rounding errors of many short frames must not lose a tick
        self._ahead -= due * TICK
        return due
