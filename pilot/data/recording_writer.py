"""Writing of recordings as the Unity simulator does: the images of three cameras and driving_log.csv."""

import math
from datetime import datetime, timedelta
from pathlib import Path

from pilot.arrays import Frame
from pilot.data.frames import encode_frame
from pilot.data.log_format import LOG_NAME, format_line, time_stamp
from pilot.vehicle import CAMERAS, TICK

RECORDING_RATE = 15.0  # rows per second, as the Unity simulator records


class RecordingWriter:
    """Appends rows to a recording: images of three cameras and lines of driving_log.csv.

    Attributes:
        rows: number of rows written so far.
    """

    def __init__(self, folder: Path, listed_as: Path | None = None) -> None:
        """Open a recording; rows are appended to an existing one.

        Args:
            folder: folder of the recording; created if necessary.
            listed_as: folder to which the recording will be moved, used for the paths in the log; None: `folder`.

        Raises:
            OSError: the folder cannot be created or written to.
        """
        self.folder, self.listed_as = folder, (listed_as or folder).resolve()
        self.start = datetime.now()
        self.rows = 0
        (self.folder / "IMG").mkdir(parents=True, exist_ok=True)
        # line by line: a program that is killed leaves no images without their row
        self._log = (self.folder / LOG_NAME).open("a", encoding="utf-8", newline="", buffering=1)

    def write(self, frames: dict[str, Frame], seconds: float, command: tuple[float, float], speed: float) -> None:
        """Write the row of one time step.

        Args:
            frames: frames of the three cameras by camera name: 160x320x3, uint8 RGB.
            seconds: time since the recording was opened; determines the time in the images' names.
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
    """Return whether a row is due at a tick (of 20 ms, from 0) of a recording with `rate` rows per second."""
    ticks = round(1 / TICK)
    return math.floor(tick * rate / ticks) != math.floor((tick - 1) * rate / ticks)
