"""Cache of decoded frames on disk, kept between trainings, so that each image is decoded only once.

Each folder of images has one cache file, named by a digest of the images. It contains the frame rows that training can
show, one frame after another, followed by the unusable images and their faults as JSON. It is renamed to its final name
when complete and never changed afterwards, so that processes can share it and a crash loses only the unfinished file.
Reading takes a tenth of the time of decoding and, unlike a memory-mapped file, no memory.
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

DECODE_AHEAD = 256  # images decoded in parallel before they are written
DAY = 86400.0  # seconds; older unfinished files were left by a crash


class FrameCache:
    """Reads images as frames and stores the decoded rows on disk.

    Attributes:
        rows: first row that is read of each frame, and the one after the last.
        error: message of the last error that prevented storing frames, or "".
    """

    def __init__(self, rows: tuple[int, int] = (0, ROWS), *, limit: int = 0, folder: Path | None = None) -> None:
        """Create a cache.

        Args:
            rows: first row to be read of each frame, and the one after the last.
            limit: size of all cache files together in bytes; 0: no cache, images are decoded at every read.
            folder: folder of the cache files; None: a folder in the user's cache folder.
        """
        self.rows, self.limit = rows, limit
        self.folder = folder or user_cache_path("behavioral-cloning-pilot") / "frames"
        self.error = ""
        self._places: dict[str, tuple[Path, int]] = {}  # image → cache file, offset in bytes
        self._size = (rows[1] - rows[0]) * COLUMNS * 3
        self._in_use: set[Path] = set()

    def read(self, path: str) -> Frame:
        """Return the `rows` of an image file's frame: height x 320 x 3, uint8 RGB.

        Raises:
            UnreadableImage: the file is missing, empty, truncated or not an image.
        """
        if path in self._places:
            file, offset = self._places[path]
            kept = np.empty((self.rows[1] - self.rows[0], COLUMNS, 3), np.uint8)
            with contextlib.suppress(OSError), open(file, "rb", buffering=0) as source:  # noqa: PTH123 - twice as fast
                source.seek(offset)
                if source.readinto(kept.data) == self._size:  # else the cache folder was cleared
                    return kept
        return self._decode(path)

    def check(self, paths: Sequence[str], progress: ProgressBar[str] = no_bar) -> dict[str, str]:
        """Check images; those that are not in the cache are decoded and stored.

        Args:
            paths: image files.
            progress: progress bar over the images.

        Returns:
            The faults of unusable images by their paths.
        """
        ordered = sorted(set(paths), key=os.path.split)
        shown = iter(progress(ordered, len(ordered), "checking images"))
        faults: dict[str, str] = {}
        with ThreadPoolExecutor(os.cpu_count()) as threads:
            try:
                for _, group in groupby(ordered, key=os.path.dirname):
                    faults |= self._check_folder(list(group), threads, shown)
                list(shown)  # completes the bar
            finally:  # after Ctrl-C, the remaining images are not needed
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
            self.error = str(error)
            return self._decode_all(paths, threads, shown)
        list(zip(paths, shown, strict=False))
        self._find_in(file, paths)
        return faults

    def _fill(self, file: Path, paths: list[str], threads: ThreadPoolExecutor, shown: Iterator[str]) -> dict[str, str]:
        """Decode the images of a folder and, if the limit permits, store them."""
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
        for start in range(0, len(paths), DECODE_AHEAD):
            part = paths[start : start + DECODE_AHEAD]
            for path, frame in zip(part, threads.map(self._try, part), strict=True):
                next(shown, None)
                if isinstance(frame, str):
                    faults[path] = frame
                if output:
                    output.write(bytes(self._size) if isinstance(frame, str) else frame.data)
        return faults

    def _try(self, path: str) -> Frame | str:
        """Return the rows of an image's frame, or the fault that makes it unusable."""
        try:
            return self._decode(path)
        except UnreadableImage as error:
            return error.reason

    def _decode(self, path: str) -> Frame:
        return read_frame(path)[slice(*self.rows)]

    def _make_room(self, size: int) -> bool:
        """Remove abandoned files, and the least recently used ones until `size` bytes fit; return whether they do."""
        self.folder.mkdir(parents=True, exist_ok=True)
        if size > self.limit:
            return False
        kept = {file: file.stat() for file in self.folder.iterdir()}
        left = self.limit - size - sum(stat.st_size for stat in kept.values())
        for file in sorted(kept.keys() - self._in_use, key=lambda file: kept[file].st_mtime):
            abandoned = file.suffix == ".part" and kept[file].st_mtime < time.time() - DAY
            if abandoned or (left < 0 and file.suffix != ".part"):
                file.unlink(missing_ok=True)
                left += kept[file].st_size
        return left >= 0


def _kept_faults(file: Path, end: int) -> dict[str, str] | None:
    """Return the faults stored in a cache file after the `end` bytes of its frames; None if there is no such file."""
    try:
        with file.open("rb") as kept:
            kept.seek(end)
            faults: dict[str, str] = json.loads(kept.read())
        os.utime(file)  # `_make_room` removes the least recently used first
    except (FileNotFoundError, ValueError):
        return None
    return faults


def _digest(paths: Iterable[str], rows: tuple[int, int]) -> str:
    """Return a digest of the images (path, size, time of last change) and of the rows stored."""
    digest = hashlib.sha256(repr(rows).encode())
    for path in paths:
        try:
            stat = Path(path).stat()
            digest.update(f"{Path(path).absolute()}|{stat.st_size}|{stat.st_mtime_ns}\n".encode())
        except OSError:
            digest.update(f"{path}|missing\n".encode())
    return digest.hexdigest()[:24]
