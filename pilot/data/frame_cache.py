"""Cache of decoded frames on disk, kept between trainings, so that each image is decoded only once.

Each folder of images has one cache file, named by a digest of the images. It contains the frame rows that training can
show, with a checksum of each. It is renamed to its final name when complete and never changed afterwards, so that
processes can share it and a crash loses only the unfinished file. Reading takes a tenth of the time of decoding and,
unlike a memory-mapped file, no memory.
"""

import hashlib
import logging
import os
import time
from collections.abc import Iterable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from itertools import groupby
from pathlib import Path

import numpy as np
from platformdirs import user_cache_path

from pilot.arrays import Frame
from pilot.data.cache_file import CacheFile, CacheWriter
from pilot.data.frames import UnreadableImage, read_frame
from pilot.files import move_when_done
from pilot.progress import ProgressBar, no_bar
from pilot.vehicle import COLUMNS, ROWS

log = logging.getLogger("pilot")

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
        self._files: dict[str, CacheFile] = {}  # by the folder of the images
        self._numbers: dict[str, int] = {}  # image → number of its frame in the file of its folder
        self._size = (rows[1] - rows[0]) * COLUMNS * 3
        self._in_use: set[Path] = set()

    def read(self, path: str) -> Frame:
        """Return the `rows` of an image file's frame: height x 320 x 3, uint8 RGB.

        Raises:
            UnreadableImage: the file is missing, empty, truncated or not an image.
        """
        file = self._files.get(os.path.dirname(path))
        if file is not None and path in self._numbers:
            kept = np.empty((self.rows[1] - self.rows[0], COLUMNS, 3), np.uint8)
            try:
                if file.read(self._numbers[path], kept):
                    return kept  # else the cache folder was cleared
            except ValueError as error:
                self._discard(file, error)
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
            kept = _load(file, len(paths), self._size) or self._fill(file, paths, threads, shown)
        except OSError as error:  # a full disk, a folder that cannot be written to
            self.error = str(error)
            kept = None
        if kept is None:
            return self._decode_all(paths, threads, shown)
        list(zip(paths, shown, strict=False))  # completes the bar's part
        self._files[os.path.dirname(paths[0])] = kept
        self._numbers |= {path: number for number, path in enumerate(paths)}
        return kept.faults

    def _fill(
        self, file: Path, paths: list[str], threads: ThreadPoolExecutor, shown: Iterator[str]
    ) -> CacheFile | None:
        """Decode the images of a folder and store them if the limit permits."""
        if not self._make_room(len(paths) * self._size):
            return None
        with move_when_done(file) as temporary, temporary.open("wb") as output:
            writer = CacheWriter(output, self._size)
            writer.finish(self._decode_all(paths, threads, shown, writer))
        return CacheFile(file, len(paths), self._size)

    def _discard(self, file: CacheFile, error: ValueError) -> None:
        """Remove a damaged file: its images are decoded at every read, and stored again by the next training."""
        log.warning("cached frames are discarded, their images are decoded again: %s", error)
        self._files = {folder: kept for folder, kept in self._files.items() if kept is not file}
        try:
            file.path.unlink(missing_ok=True)
        except OSError as failure:  # on Windows, if another process has it open
            log.warning("%s; delete the file yourself", failure)

    def _decode_all(
        self,
        paths: list[str],
        threads: ThreadPoolExecutor,
        shown: Iterator[str],
        writer: CacheWriter | None = None,
    ) -> dict[str, str]:
        faults = {}
        for start in range(0, len(paths), DECODE_AHEAD):
            part = paths[start : start + DECODE_AHEAD]
            for path, frame in zip(part, threads.map(self._try, part), strict=True):
                next(shown, None)
                if isinstance(frame, str):
                    faults[path] = frame
                if writer:
                    writer.add(None if isinstance(frame, str) else frame)
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


def _load(file: Path, count: int, size: int) -> CacheFile | None:
    """Return a cache file and mark it as used; None if there is none, or it is damaged."""
    try:
        kept = CacheFile(file, count, size)
        os.utime(file)  # `_make_room` removes the least recently used first
    except (FileNotFoundError, ValueError):
        return None
    return kept


def _digest(paths: Iterable[str], rows: tuple[int, int]) -> str:
    """Return a digest of the images (path, size, times of last change) and of the rows stored."""
    digest = hashlib.sha256(repr(rows).encode())
    for path in paths:
        try:
            stat = os.stat(path)
            # a program can set the modification time, but not the change time (on Windows: time of creation)
            times = f"{stat.st_mtime_ns}|{stat.st_ctime_ns}"
            digest.update(f"{os.path.abspath(path)}|{stat.st_size}|{times}\n".encode())
        except OSError:
            digest.update(f"{path}|missing\n".encode())
    return digest.hexdigest()[:24]
