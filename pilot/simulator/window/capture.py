"""Recording of manual driving in the window."""

import contextlib
import logging
from collections.abc import Callable
from pathlib import Path
from typing import Any, Self

from pilot.arrays import Frame
from pilot.data.recording_writer import RECORDING_RATE, RecordingWriter, is_due
from pilot.simulator.episode import CarState
from pilot.vehicle import TICK

log = logging.getLogger("pilot")


class Capture:
    """Writes rows to a recording between `start` and `stop`.

    Attributes:
        folder: of the recording.
        message: outcome of the last recording, for display; empty while recording.
    """

    def __init__(self, folder: Path, look: Callable[[], dict[str, Frame]]) -> None:
        """Create a capture; nothing is written before `start`.

        Args:
            folder: of the recording; further recordings are appended.
            look: returns the current frames (160x320x3, uint8 RGB) by camera: left, center, right.
        """
        self.folder, self.message = folder, ""
        self._look = look
        self._writer: RecordingWriter | None = None
        self._open = contextlib.ExitStack()
        self._began: float | None = None

    @property
    def rows(self) -> int | None:
        """Number of rows written since `start`; None while not recording."""
        return self._writer.rows if self._writer else None

    def toggle(self) -> None:
        """Start recording, or stop it."""
        if self._writer:
            self.stop()
        else:
            self.start()

    def start(self) -> None:
        """Start recording with the next tick."""
        self.message, self._began = "", None
        try:
            self._writer = self._open.enter_context(RecordingWriter(self.folder))
        except OSError as error:
            self._say(f"cannot record: {error}")

    def stop(self) -> None:
        """Stop recording; has no effect while not recording."""
        if self._writer:
            rows, self._writer = self._writer.rows, None
            try:
                self._open.close()
                self._say(f"{rows} rows recorded in {self.folder}")
            except OSError as error:  # some network drives write only now
                self._say(f"the last rows could not be written: {error}")

    def add(self, state: CarState) -> None:
        """Write a row if one is due; to be called after each tick."""
        if not self._writer:
            return
        self._began = state.time if self._began is None else self._began
        seconds = state.time - self._began
        if not is_due(round(seconds / TICK), RECORDING_RATE):
            return
        try:
            self._writer.write(self._look(), seconds, (state.steering, state.throttle), state.speed)
        except OSError as error:  # a full disk ends the recording, not the drive
            self.stop()
            self._say(f"the recording has ended: {error}")

    def _say(self, message: str) -> None:
        self.message = message
        log.info("%s", message)

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_error: Any) -> None:
        self.stop()
