"""Recording of what `drive.py` does, in the simulator's format, for training, replay and clips."""

import errno
import logging
import queue
import threading
from collections.abc import Callable
from datetime import datetime
from pathlib import Path

from pilot.data.log_format import LOG_NAME, format_line, time_stamp
from pilot.driving.autopilot import Answer

log = logging.getLogger("pilot")

QUEUE_SIZE = 200  # frames in the queue; if the disk is too slow, frames are dropped so that driving is not delayed
STOP = None


class FolderInUseError(ValueError):
    """The folder already contains a recording, or is a file."""


class Recorder:
    """Writes each frame with its command to a folder, in a separate thread.

    Attributes:
        frames: number of frames written so far.
        failed: reason why the recording stopped; None if it did not.
    """

    def __init__(self, folder: Path, *, overwrite: bool = False, now: Callable[[], datetime] = datetime.now) -> None:
        """Create the folder if necessary and start the thread.

        Args:
            folder: of the recording.
            overwrite: delete the recording that the folder contains.
            now: returns the time for the frames' names.

        Raises:
            FolderInUseError: `folder` is a file, or contains a recording and `overwrite` is not set.
            OSError: the folder cannot be created.
        """
        self.folder, self.now = folder, now
        self.frames = 0
        self.failed: str | None = None
        _prepare(folder, overwrite=overwrite)
        self._queue: queue.Queue[tuple[datetime, Answer] | None] = queue.Queue(QUEUE_SIZE)
        self._thread = threading.Thread(target=self._write_all, name="recorder", daemon=True)
        self._thread.start()

    def observe(self, answer: Answer) -> None:
        """Queue an answer and its frame for writing; does not block."""
        if answer.telemetry is None or self.failed:
            return
        try:
            self._queue.put_nowait((self.now(), answer))
        except queue.Full:
            log.warning("the disk is too slow: a frame was not recorded")

    def close(self) -> None:
        """Write the queued frames and end the thread."""
        self._queue.put(STOP)
        self._thread.join()

    def _write_all(self) -> None:
        last = ""
        with (self.folder / LOG_NAME).open("a", encoding="utf-8") as rows:
            while (item := self._queue.get()) is not STOP:
                stamp = time_stamp(item[0])
                if self.failed or stamp == last:  # names have a resolution of 1 ms
                    continue
                last = stamp
                try:
                    rows.write(self._write(stamp, item[1]))
                    rows.flush()
                except OSError as error:
                    self._fail(error)

    def _write(self, stamp: str, answer: Answer) -> str:
        """Write the image and return its line of the log."""
        assert answer.telemetry is not None
        path = self.folder / f"{stamp}.jpg"  # named as by the simulator's original drive.py
        path.write_bytes(answer.telemetry.jpeg)
        self.frames += 1
        return format_line([path.name, "", ""], answer.steering, answer.throttle, answer.telemetry.speed)

    def _fail(self, error: OSError) -> None:
        full = error.errno in (errno.ENOSPC, errno.EDQUOT)
        self.failed = "the disk is full" if full else str(error)
        log.error("recording stopped after %d frames: %s. The car drives on", self.frames, self.failed)


def _prepare(folder: Path, *, overwrite: bool) -> None:
    if folder.exists() and not folder.is_dir():
        raise FolderInUseError(f"{folder}: is a file; name another folder for the recording")
    old = [*folder.glob("*.jpg"), *folder.glob(LOG_NAME)]
    if old and not overwrite:
        raise FolderInUseError(f"{folder}: holds a recording ({len(old)} files); name another, or add --overwrite")
    for path in old:
        path.unlink()
    folder.mkdir(parents=True, exist_ok=True)
