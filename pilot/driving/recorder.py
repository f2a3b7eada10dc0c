"""Records a drive in the simulator's own format, so that it can be trained on, replayed, or made a clip of."""

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

WAITING_AT_MOST = 200  # frames; a disk that is slower than the camera loses frames, never the car
STOP = None


class FolderInUseError(ValueError):
    """The folder already holds a drive."""


class Recorder:
    """Writes each answered frame and its command to a folder, in a thread of its own.

    Attributes:
        frames: frames written so far.
        failed: why the recording stopped, or None.
    """

    def __init__(self, folder: Path, *, overwrite: bool = False, now: Callable[[], datetime] = datetime.now) -> None:
        """Prepare the folder.

        Raises:
            FolderInUseError: it holds frames, and `overwrite` is not set.
            OSError: it cannot be made.
        """
        self.folder, self.now = folder, now
        self.frames = 0
        self.failed: str | None = None
        _prepare(folder, overwrite=overwrite)
        self._queue: queue.Queue[tuple[datetime, Answer] | None] = queue.Queue(WAITING_AT_MOST)
        self._thread = threading.Thread(target=self._write_all, name="recorder", daemon=True)
        self._thread.start()

    def observe(self, answer: Answer) -> None:
        """Record an answer and its frame; returns at once."""
        if answer.telemetry is None or self.failed:
            return
        try:
            self._queue.put_nowait((self.now(), answer))
        except queue.Full:
            log.warning("the disk is too slow: a frame was not recorded")

    def close(self) -> None:
        """Write what is waiting, and end."""
        self._queue.put(STOP)
        self._thread.join()

    def _write_all(self) -> None:
        last = ""
        with (self.folder / LOG_NAME).open("a", encoding="utf-8") as rows:
            while (item := self._queue.get()) is not STOP:
                stamp = time_stamp(item[0])
                if self.failed or stamp == last:  # two frames in a millisecond: there is one name only
                    continue
                last = stamp
                try:
                    rows.write(self._write(stamp, item[1]))
                    rows.flush()
                except OSError as error:
                    self._fail(error)

    def _write(self, stamp: str, answer: Answer) -> str:
        """Write the picture; returns its line of the log."""
        assert answer.telemetry is not None
        path = self.folder / f"{stamp}.jpg"  # as the simulator's original server names it
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
