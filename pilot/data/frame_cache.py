"""Decoded frames on disk, kept between trainings: a picture is decoded once, however often it is looked at.

Each folder of pictures has a file of its own, named by a digest of what is in the folder. It holds the rows of the
frames that a training may show, one frame after the other, then as JSON what is wrong with which pictures. It is
complete before it gets its name and never changed afterwards: processes share it, and a crash half-way costs nothing
but the work. Reading it takes a tenth of the time of decoding, and, unlike a mapped file, no memory.
"""

import contextlib
import hashlib
import json
import os
import time
from collections.abc import Iterable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from itertools import groupby
from pathlib import Path
from typing import IO

import numpy as np
from platformdirs import user_cache_path

from pilot.arrays import Frame
from pilot.data.frames import UnreadableImage, read_frame
from pilot.files import move_when_done
from pilot.progress import ProgressBar, no_bar
from pilot.vehicle import COLUMNS, ROWS

AT_ONCE = 256  # pictures decoded ahead of being written
DAY = 86400.0  # seconds; unfinished files older than this were left by a crash


class FrameCache:
    """The rows of frames that a training looks at.

    Attributes:
        rows: first row, and the one after the last, of what is read of each frame.
        trouble: why frames could not be kept, or "".
    """

    def __init__(self, rows: tuple[int, int] = (0, ROWS), *, limit: int = 0, folder: Path | None = None) -> None:
        """Keep up to `limit` bytes in `folder` (default: the user's cache folder); with 0, decode each time."""
        self.rows, self.limit = rows, limit
        self.folder = folder or user_cache_path("behavioral-cloning-pilot") / "frames"
        self.trouble = ""
        self._places: dict[str, tuple[Path, int]] = {}  # picture → file of its folder, offset there
        self._size = (rows[1] - rows[0]) * COLUMNS * 3
        self._in_use: set[Path] = set()

    def read(self, path: str) -> Frame:
        """The rows of a picture file's frame, uint8 RGB.

        Raises:
            UnreadableImage: as `read_frame`.
        """
        if path in self._places:
            file, offset = self._places[path]
            kept = np.empty((self.rows[1] - self.rows[0], COLUMNS, 3), np.uint8)
            with contextlib.suppress(OSError), open(file, "rb", buffering=0) as source:  # noqa: PTH123 - half the time
                source.seek(offset)
                if source.readinto(kept.data) == self._size:  # else somebody cleared the cache folder
                    return kept
        return self._decode(path)

    def check(self, paths: Sequence[str], progress: ProgressBar[str] = no_bar) -> dict[str, str]:
        """Why which pictures cannot be used; decodes all that are not known yet, and keeps them.

        Args:
            paths: picture files.
            progress: wraps the pictures while they are checked (called with them and their number).
        """
        ordered = sorted(set(paths), key=os.path.split)
        shown = iter(progress(ordered, len(ordered), "checking pictures"))
        faults: dict[str, str] = {}
        with ThreadPoolExecutor(os.cpu_count()) as threads:
            try:
                for _, group in groupby(ordered, key=os.path.dirname):
                    faults |= self._check_folder(list(group), threads, shown)
                list(shown)  # a bar that is complete
            finally:  # Ctrl-C: don't read the rest
                threads.shutdown(cancel_futures=True)
        return faults

    def _check_folder(self, paths: list[str], threads: ThreadPoolExecutor, shown: Iterator[str]) -> dict[str, str]:
        if not self.limit:
            return self._decode_all(paths, threads, shown)
        file = self.folder / f"{_digest(paths, self.rows)}.frames"
        self._in_use.add(file)
        try:
            faults = _kept_faults(file, len(paths) * self._size)
            if faults is None:
                return self._fill(file, paths, threads, shown)
        except OSError as error:  # a full disk, a folder that cannot be written to
            self.trouble = str(error)
            return self._decode_all(paths, threads, shown)
        list(zip(paths, shown, strict=False))
        self._find_in(file, paths)
        return faults

    def _fill(self, file: Path, paths: list[str], threads: ThreadPoolExecutor, shown: Iterator[str]) -> dict[str, str]:
        """Decode the pictures of a folder and, if there is room, keep them."""
        if not self._make_room(len(paths) * self._size):
            return self._decode_all(paths, threads, shown)
        with move_when_done(file) as temporary, temporary.open("wb") as output:
            faults = self._decode_all(paths, threads, shown, output)
            output.write(json.dumps(faults).encode())
            output.flush()
            os.fsync(output.fileno())
        self._find_in(file, paths)
        return faults

    def _find_in(self, file: Path, paths: list[str]) -> None:
        self._places |= {path: (file, number * self._size) for number, path in enumerate(paths)}

    def _decode_all(
        self, paths: list[str], threads: ThreadPoolExecutor, shown: Iterator[str], output: IO[bytes] | None = None
    ) -> dict[str, str]:
        faults = {}
        for start in range(0, len(paths), AT_ONCE):
            part = paths[start : start + AT_ONCE]
            for path, frame in zip(part, threads.map(self._try, part), strict=True):
                next(shown, None)
                if isinstance(frame, str):
                    faults[path] = frame
                if output:
                    output.write(bytes(self._size) if isinstance(frame, str) else frame.data)
        return faults

    def _try(self, path: str) -> Frame | str:
        """The rows of a picture, or why it cannot be used."""
        try:
            return self._decode(path)
        except UnreadableImage as error:
            return error.reason

    def _decode(self, path: str) -> Frame:
        return read_frame(path)[slice(*self.rows)]

    def _make_room(self, size: int) -> bool:
        """Remove what is kept of other recordings, the longest unused first, until `size` more bytes may be kept."""
        self.folder.mkdir(parents=True, exist_ok=True)
        kept = {file: file.stat() for file in self.folder.iterdir()}
        left = self.limit - size - sum(stat.st_size for stat in kept.values())
        for file in sorted(kept.keys() - self._in_use, key=lambda file: kept[file].st_mtime):
            abandoned = file.suffix == ".part" and kept[file].st_mtime < time.time() - DAY
            if abandoned or (left < 0 and file.suffix != ".part"):
                file.unlink(missing_ok=True)
                left += kept[file].st_size
        return left >= 0


def _kept_faults(file: Path, end: int) -> dict[str, str] | None:
    """What an earlier check found, which stands behind the frames' `end` bytes; None if nothing is kept."""
    try:
        with file.open("rb") as kept:
            kept.seek(end)
            faults: dict[str, str] = json.loads(kept.read())
        os.utime(file)  # the longest unused is removed first
    except (FileNotFoundError, ValueError):
        return None
    return faults


def _digest(paths: Iterable[str], rows: tuple[int, int]) -> str:
    """A short text that changes with the pictures (name, size, time of the last change) and the rows kept."""
    digest = hashlib.sha256(repr(rows).encode())
    for path in paths:
        try:
            stat = Path(path).stat()
            digest.update(f"{Path(path).absolute()}|{stat.st_size}|{stat.st_mtime_ns}\n".encode())
        except OSError:
            digest.update(f"{path}|missing\n".encode())
    return digest.hexdigest()[:24]
