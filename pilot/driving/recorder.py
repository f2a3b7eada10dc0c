"""Recording of what `drive.py` does, in the simulator's format, for training, replay and clips."""

import contextlib
import errno
import logging
import queue
import re
import threading
import time
from collections.abc import Callable
from datetime import datetime
from io import FileIO
from pathlib import Path

from pilot.data.log_format import LOG_NAME, TIME_STAMP, format_line, time_stamp
from pilot.data.steered_by import STEERED_BY, format_steered_by
from pilot.driving.autopilot import Answer

log = logging.getLogger("pilot")

QUEUE_SIZE = 200  # frames in the queue; if the disk is too slow, frames are dropped so that driving is not delayed
CLOSE_SECONDS = 0.7  # in which the frames in the queue are written at the end: Ctrl-C ends drive.py within a second
FRAME_NAME = re.compile(TIME_STAMP.pattern + r"\.jpg")  # as by the simulator's original drive.py
OWN_LINE = re.compile(FRAME_NAME.pattern + r",,,")  # beginning of a line of the log that this module writes
STOP = None


class FolderInUseError(ValueError):
    """The folder already contains a recording or other pictures, or is a file."""


class Recorder:
    """Writes each frame with its command to a folder, in a separate thread.

    Attributes:
        frames: number of frames written so far.
        failed: reason why the recording stopped; None if it did not.
    """

    def __init__(
        self,
        folder: Path,
        *,
        overwrite: bool = False,
        steered_by: bool = False,
        now: Callable[[], datetime] = datetime.now,
    ) -> None:
        """Create the folder if necessary, open the log and start the thread.

        Args:
            folder: of the recording.
            overwrite: delete the recording that the folder contains.
            steered_by: also write who steered, see `pilot.data.steered_by`.
            now: returns the time for the frames' names.

        Raises:
            FolderInUseError: `folder` is a file, contains a recording and `overwrite` is not set, or contains pictures
                or a log that were not recorded by drive.py.
            OSError: the folder or the log cannot be created.
        """
        self.folder, self.now = folder, now
        self.frames = 0
        self.failed: str | None = None
        self._rows = _prepare(folder, overwrite=overwrite)
        self._steerers = (folder / STEERED_BY).open("ab", buffering=0) if steered_by else None
        self._ends_at: float | None = None  # monotonic time in s after which no frame is written
        self._queue: queue.Queue[tuple[datetime, Answer] | None] = queue.Queue(QUEUE_SIZE)
        self._thread = threading.Thread(target=self._write_all, name="recorder", daemon=True)
        self._thread.start()

    def observe(self, answer: Answer, at: datetime | None = None) -> None:
        """Queue an answer and its frame, now or of the time `at`, for writing; does not block."""
        if answer.telemetry is None or self.failed:
            return
        try:
            self._queue.put_nowait((at or self.now(), answer))
        except queue.Full:
            log.warning("the disk is too slow: a frame was not recorded")

    def close(self) -> None:
        """Write the queued frames, for at most `CLOSE_SECONDS`, and end the thread."""
        self._ends_at = time.monotonic() + CLOSE_SECONDS
        with contextlib.suppress(queue.Full):
            self._queue.put(STOP, timeout=CLOSE_SECONDS)
        self._thread.join(max(self._ends_at - time.monotonic(), 0))
        if missing := sum(item is not STOP for item in list(self._queue.queue)):
            log.warning("the disk is too slow: the last %d frames were not recorded", missing)

    def _write_all(self) -> None:
        last = ""
        with self._rows, self._steerers or contextlib.nullcontext():
            while not self._is_over() and (item := self._queue.get()) is not STOP:
                stamp = time_stamp(item[0])
                if self.failed or stamp == last:  # names have a resolution of 1 ms
                    continue
                last = stamp
                self._write(stamp, item[1])

    def _is_over(self) -> bool:
        return self._ends_at is not None and time.monotonic() > self._ends_at

    def _write(self, stamp: str, answer: Answer) -> None:
        """Write an image and its line of the log: both, or neither if the disk is full."""
        assert answer.telemetry is not None
        path, end = self.folder / f"{stamp}.jpg", self._rows.tell()
        try:
            path.write_bytes(answer.telemetry.jpeg)
            if self._steerers:  # before the row: whoever reads a row then knows who steered
                self._steerers.write(format_steered_by(path.name, answer.steerer).encode())
            row = format_line([path.name, "", ""], answer.steering, answer.throttle, answer.telemetry.speed).encode()
            if self._rows.write(row) < len(row):
                raise OSError(errno.ENOSPC, "No space left on device")
            self.frames += 1
        except OSError as error:
            with contextlib.suppress(OSError):
                path.unlink(missing_ok=True)
                self._rows.truncate(end)
            self._fail(error)

    def _fail(self, error: OSError) -> None:
        full = error.errno in (errno.ENOSPC, errno.EDQUOT)
        self.failed = "the disk is full" if full else str(error)
        log.error("recording stopped after %d frames: %s. The car drives on", self.frames, self.failed)


def _prepare(folder: Path, *, overwrite: bool) -> FileIO:
    """Delete the recording in the folder if asked to, and return its new log, opened for writing."""
    if folder.exists() and not folder.is_dir():
        raise FolderInUseError(f"{folder}: is a file; name another folder for the recording")
    old = [*folder.glob("*.jpg"), *folder.glob(LOG_NAME)]
    if foreign := [path for path in old if not _is_own(path)]:
        raise FolderInUseError(
            f"{folder}: holds files that drive.py did not record ({len(foreign)}, such as {foreign[0].name}); name "
            "another folder for the recording"
        )
    if old and not overwrite:
        raise FolderInUseError(f"{folder}: holds a recording ({len(old)} files); name another, or add --overwrite")
    try:
        for path in old:
            path.unlink()
        folder.mkdir(parents=True, exist_ok=True)
        return (folder / LOG_NAME).open("xb", buffering=0)  # no buffer: a failed write is not repeated on closing
    except OSError as error:
        raise OSError(f"{folder}: cannot record there ({error.strerror or error}); name another folder") from error


def _is_own(path: Path) -> bool:
    """Whether a file was written by this module (or a frame by the original drive.py), and may be overwritten."""
    if path.name != LOG_NAME:
        return FRAME_NAME.fullmatch(path.name) is not None
    with path.open(encoding="utf-8", errors="replace") as lines:
        return all(OWN_LINE.match(line) for line in lines)
