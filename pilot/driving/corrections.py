"""Recording of corrections: what a person steers in place of the model, and the seconds before."""

import logging
from collections.abc import Callable
from datetime import datetime
from pathlib import Path

from pilot.driving.autopilot import Answer
from pilot.driving.correction_buffer import CorrectionBuffer
from pilot.driving.recorder import Recorder

log = logging.getLogger("pilot")


class Corrections:
    """Observer of a drive, which records its corrections into a new folder, from the first correction on.

    Attributes:
        folder: of this drive's corrections; None before the first one.
    """

    def __init__(self, parent: Path, now: Callable[[], datetime] = datetime.now) -> None:
        """Create an observer; nothing is written before the first correction.

        Args:
            parent: folder in which the folder of this drive is created.
            now: returns the time.
        """
        self.parent, self.now = parent, now
        self.folder: Path | None = None
        self._recorder: Recorder | None = None
        self._buffer: CorrectionBuffer[tuple[datetime, Answer]] = CorrectionBuffer()

    def observe(self, answer: Answer) -> None:
        """Record an answer with a person's steering, and what was before it; keep one of the model's for later."""
        if answer.telemetry is None:
            return
        at = self.now()
        for due, moment in self._buffer.add((at, answer), at.timestamp(), answer.steerer):
            if recorder := self._opened():
                recorder.observe(moment, due)

    def _opened(self) -> Recorder | None:
        """Return the recorder of this drive; None if the disk cannot be written to."""
        if self.folder is None:
            self.folder = self.parent / f"{self.now():%Y-%m-%d_%H-%M-%S}"
            try:
                self._recorder = Recorder(self.folder, steered_by=True)
            except (OSError, ValueError) as error:
                log.error("the corrections are not recorded: %s. The car drives on", error)
        return self._recorder

    @property
    def number(self) -> int:
        """Number of corrections so far."""
        return self._buffer.number

    @property
    def frames(self) -> int:
        """Number of frames recorded so far."""
        return self._recorder.frames if self._recorder else 0

    def close(self) -> None:
        """Write what is left to write."""
        if self._recorder:
            self._recorder.close()
