"""Which moments of a drive belong to the recording of its corrections."""

from collections import deque
from typing import Generic, TypeVar

from pilot.data.steered_by import Steerer

LEAD_SECONDS = 3.0  # of the model's driving before a correction, which are recorded too

Moment = TypeVar("Moment")


class CorrectionBuffer(Generic[Moment]):
    """Keeps the last seconds of the model's driving until a person corrects it.

    Attributes:
        number: of corrections so far.
    """

    def __init__(self) -> None:
        """Begin a drive, in which the model steers."""
        self.number = 0
        self._kept: deque[tuple[float, Moment]] = deque()
        self._corrects = False

    def add(self, moment: Moment, seconds: float, steerer: Steerer) -> list[Moment]:
        """Add the moment at a time in s.

        Returns:
            the moments to be recorded now, the oldest first: none while the model steers.
        """
        corrects, self._corrects = self._corrects, steerer == "person"
        self._kept.append((seconds, moment))
        if not self._corrects:
            while not seconds - LEAD_SECONDS <= self._kept[0][0] <= seconds:  # later ones: the clock was put back
                self._kept.popleft()
            return []
        self.number += not corrects
        due = [kept for _, kept in self._kept]
        self._kept.clear()
        return due
