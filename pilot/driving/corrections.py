"""Recording of corrections: what a person steers in place of the model, and the seconds before."""

import logging
from collections import deque
from collections.abc import Callable
from datetime import datetime, timedelta
from pathlib import Path

from pilot.driving.autopilot import Answer
from pilot.driving.recorder import Recorder

log = logging.getLogger("pilot")

LEAD = timedelta(seconds=3)  # of the model's driving before a correction, which is recorded too


class Corrections:
    """Observer of a drive, which records its corrections into a new folder, from the first correction on.

    Attributes:
        folder: of this drive's corrections; None before the first one.
        number: of corrections so far.
    """

    def __init__(self, parent: Path, now: Callable[[], datetime] = datetime.now) -> None:
        """Create an observer; nothing is written before the first correction.

        Args:
            parent: folder in which the folder of this drive is created.
            now: returns the time.
        """
        self.parent, self.now = parent, now
        self.folder: Path | None = None
        self.number = 0
        self._recorder: Recorder | None = None
        self._before: deque[tuple[datetime, Answer]] = deque()  # the model's driving of the last seconds
        self._corrects = False

    def observe(self, answer: Answer) -> None:
        """Record an answer with a person's steering, and what was before it; keep one of the model's for later."""
        if answer.telemetry is None:
            return
        corrects, self._corrects = self._corrects, answer.steerer == "person"
        self._before.append((self.now(), answer))
        if not self._corrects:
            self._forget()
            return
        self.number += not corrects
        while self._before and (recorder := self._opened()):
            at, queued = self._before.popleft()
            recorder.observe(queued, at)

    def _forget(self) -> None:
        while self._before[0][0] < self._before[-1][0] - LEAD:
            self._before.popleft()

    def _opened(self) -> Recorder | None:
        """Return the recorder of this drive; None if the disk cannot be written to."""
        if self.folder is None:
            self.folder = self.parent / f"{self.now():%Y-%m-%d_%H-%M-%S}"
            try:
                self._recorder = Recorder(self.folder, steered_by=True)
            except (OSError, ValueError) as error:
                log.error("the corrections are not recorded: %s. The car drives on", error)
        if self._recorder is None:
            self._before.clear()
        return self._recorder

    @property
    def frames(self) -> int:
        """Number of frames recorded so far."""
        return self._recorder.frames if self._recorder else 0

    def close(self) -> None:
        """Write what is left to write."""
        if self._recorder:
            self._recorder.close()
