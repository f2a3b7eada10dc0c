"""Real time in whole ticks of the physics."""

from pilot.vehicle import TICK

LONGEST_FRAME = 1 / 3  # s that a slow frame moves the car on at most, as in Unity


class TickClock:
    """Counts the ticks of 20 ms in the time that passes, whatever the frame rate."""

    def __init__(self) -> None:
        self._ahead = 0.0  # s that have passed and are no whole tick yet

    def ticks(self, seconds: float) -> int:
        """How many are due, `seconds` after the last call."""
        self._ahead += min(seconds, LONGEST_FRAME)
        due = int(self._ahead / TICK + 1e-9)  # 1e-9: many short frames must add up to whole ticks
        self._ahead -= due * TICK
        return due
