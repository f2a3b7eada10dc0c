"""Records what is driven in the window."""

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
    """Records a drive while it goes on, from `start` to `stop`.

    Attributes:
        folder: it goes to.
        message: what became of the last recording.
    """

    def __init__(self, folder: Path, look: Callable[[], dict[str, Frame]]) -> None:
        """Prepare; nothing is written yet.

        Args:
            folder: where recordings go.
            look: what left, center and right camera see now: 160x320x3 uint8 RGB each.
        """
        self.folder, self.message = folder, ""
        self._look = look
        self._writer: RecordingWriter | None = None
        self._open = contextlib.ExitStack()
        self._began: float | None = None

    @property
    def rows(self) -> int | None:
        """Of the recording that is being made; None while there is none."""
        return self._writer.rows if self._writer else None

    def toggle(self) -> None:
        """Start, or stop."""
        if self._writer:
            self.stop()
        else:
            self.start()

    def start(self) -> None:
        """Begin with the next tick."""
        self.message, self._began = "", None
        try:
            self._writer = self._open.enter_context(RecordingWriter(self.folder))
        except OSError as error:
            self._say(f"cannot record: {error}")

    def stop(self) -> None:
        """End the recording, if there is one."""
        if self._writer:
            rows, self._writer = self._writer.rows, None
            try:
                self._open.close()
                self._say(f"{rows} moments recorded into {self.folder}")
            except OSError as error:  # what was held back for writing has no room
                self._say(f"the recording's end is lost: {error}")

    def add(self, state: CarState) -> None:
        """Once per tick: write a row if one is due."""
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
