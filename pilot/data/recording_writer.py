"""Writing of recordings as the Unity simulator does: the images of its cameras and driving_log.csv."""

import errno
import math
import os
from contextlib import suppress
from datetime import datetime, timedelta
from io import FileIO
from pathlib import Path

from pilot.arrays import Frame
from pilot.data.frames import QUALITY, encode_frame
from pilot.data.log_format import LOG_NAME, format_line, time_stamp
from pilot.data.steered_by import STEERED_BY, Steerer, format_steered_by
from pilot.files import unwritable
from pilot.vehicle import CAMERAS, TICK

RECORDING_RATE = 15.0  # rows per second, as the Unity simulator records


class RecordingWriter:
    """Appends rows to a recording: images of the cameras and lines of driving_log.csv.

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
        try:
            (self.folder / "IMG").mkdir(parents=True, exist_ok=True)
            # unbuffered: each row is in the file as soon as its images are, should the program be killed
            self._log = (self.folder / LOG_NAME).open("ab", buffering=0)
            self._steerers: FileIO | None = None
        except OSError as error:
            raise unwritable(folder, error) from error

    def write(
        self,
        frames: dict[str, Frame],
        seconds: float,
        command: tuple[float, float],
        speed: float,
        *,
        quality: int = QUALITY,
        steerer: Steerer | None = None,
    ) -> None:
        """Write the row of one time step.

        Args:
            frames: frames by camera name, 160x320x3 uint8 RGB each; in the log, the names of images of left and right
                cameras that are not given remain empty.
            seconds: time since the recording was opened; determines the time in the images' names.
            command: steering and throttle, -1..1 each; a negative throttle is written as brake.
            speed: mph.
            quality: of the JPEG images.
            steerer: who steers, for recordings of corrections; None: it is not written.

        Raises:
            OSError: the row cannot be written, as on a full disk; the rows before it remain, and nothing of this one.
        """
        stamp = time_stamp(self.start + timedelta(seconds=seconds))
        names = {camera: f"{camera}_{stamp}.jpg" for camera in CAMERAS if camera in frames}
        images = [self.folder / "IMG" / name for name in names.values()]
        listed = [str(self.listed_as / "IMG" / names[camera]) if camera in names else "" for camera in CAMERAS]
        end = os.fstat(self._log.fileno()).st_size
        try:
            for camera, image in zip(names, images, strict=True):
                image.write_bytes(encode_frame(frames[camera], quality))
            if steerer:  # before the row: whoever reads a row then knows who steered
                self._write_steerer(format_steered_by(names["center"], steerer))
            self._append(format_line(listed, *command, speed).encode())
        except OSError as error:
            self._take_back(images, end)
            raise unwritable(self.folder, error) from error
        self.rows += 1

    def _write_steerer(self, line: str) -> None:
        if self._steerers is None:
            self._steerers = (self.folder / STEERED_BY).open("ab", buffering=0)
        self._steerers.write(line.encode())

    def _append(self, line: bytes) -> None:
        if self._log.write(line) < len(line):  # what an unbuffered file does when the disk becomes full
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    def _take_back(self, images: list[Path], end: int) -> None:
        with suppress(OSError):
            self._log.truncate(end)
        for image in images:
            with suppress(OSError):
                image.unlink(missing_ok=True)

    def close(self) -> None:
        """Close the files."""
        if self._steerers:
            self._steerers.close()
        self._log.close()

    def __enter__(self) -> "RecordingWriter":
        return self

    def __exit__(self, *_error: object) -> None:
        self.close()


def is_due(tick: int, rate: float) -> bool:
    """Return whether a row is due at a tick (of 20 ms, from 0) of a recording with `rate` rows per second."""
    ticks = round(1 / TICK)
    return math.floor(tick * rate / ticks) != math.floor((tick - 1) * rate / ticks)
