"""Writes recordings as the real simulator does: three cameras' pictures and driving_log.csv."""

import math
from datetime import datetime, timedelta
from pathlib import Path

from pilot.arrays import Frame
from pilot.data.frames import encode_frame
from pilot.data.log_format import LOG_NAME, format_line, time_stamp
from pilot.vehicle import CAMERAS, TICK

RECORDING_RATE = 15.0  # rows a second that the real simulator records


class RecordingWriter:
    """Appends to a recording: pictures of three cameras and lines of driving_log.csv.

    Attributes:
        rows: lines written so far.
    """

    def __init__(self, folder: Path, listed_as: Path | None = None) -> None:
        """Open the recording; one that is already there goes on.

        Args:
            folder: it lies in; made if need be.
            listed_as: folder that the log names as the pictures' place, where this one is to be moved there.

        Raises:
            OSError: the folder cannot be written to.
        """
        self.folder, self.listed_as = folder, (listed_as or folder).resolve()
        self.start = datetime.now()
        self.rows = 0
        (self.folder / "IMG").mkdir(parents=True, exist_ok=True)
        self._log = (self.folder / LOG_NAME).open("a", encoding="utf-8", newline="")

    def write(self, frames: dict[str, Frame], seconds: float, command: tuple[float, float], speed: float) -> None:
        """Add a moment.

        Args:
            frames: of the three cameras, 160x320x3 uint8 RGB.
            seconds: since the start.
            command: steering and throttle, -1..1 each; a negative throttle is written as brake.
            speed: mph.
        """
        stamp = time_stamp(self.start + timedelta(seconds=seconds))
        names = [f"{camera}_{stamp}.jpg" for camera in CAMERAS]
        for camera, name in zip(CAMERAS, names, strict=True):
            (self.folder / "IMG" / name).write_bytes(encode_frame(frames[camera]))
        steering, throttle = command
        listed = [str(self.listed_as / "IMG" / name) for name in names]
        self._log.write(format_line(listed, steering, throttle, speed))
        self.rows += 1

    def __enter__(self) -> "RecordingWriter":
        return self

    def __exit__(self, *_error: object) -> None:
        self._log.close()


def is_due(tick: int, rate: float) -> bool:
    """Whether a row is to be written at a tick of a recording (its first is 0), at `rate` rows a second."""
    ticks = round(1 / TICK)
    return math.floor(tick * rate / ticks) != math.floor((tick - 1) * rate / ticks)
