"""Decoding, checking and encoding of camera frames."""

import os
import stat
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from pilot.arrays import Frame
from pilot.data.image_header import is_decodable
from pilot.vehicle import COLUMNS, ROWS, Rows

LARGEST_FILE = 1 << 25  # bytes of an image file; the simulator's have 20,000
SMALLEST = 16  # pixels; a smaller image shows no road
QUALITY = 75  # of JPEG images: Unity's default
BLOCK = 16  # rows that JPEG encodes together: 8x8 blocks, with colours of half the resolution


class UnreadableImage(ValueError):
    """The image cannot be used.

    Attributes:
        path: of the image.
        reason: short, for counting.
    """

    def __init__(self, path: Path | str, reason: str) -> None:
        super().__init__(f"{path}: {reason}")
        self.path, self.reason = str(path), reason


def read_frame(path: Path | str) -> Frame:
    """Read an image file as a 160x320x3 uint8 RGB frame; images of other sizes are scaled.

    Raises:
        UnreadableImage: the file is missing, empty, truncated, too small or large, or not a JPEG or PNG image.
    """
    return _to_size(read_frame_as_is(path))


def read_frame_as_is(path: Path | str) -> Frame:
    """Read an image file as rows x columns x 3 uint8 RGB, without scaling.

    Raises:
        UnreadableImage: the file is missing, empty, truncated, too small or large, or not a JPEG or PNG image.
    """
    try:
        status = os.stat(path)
        if not stat.S_ISREG(status.st_mode):  # reading a pipe would wait for ever
            raise UnreadableImage(path, "image is not a regular file")
        if status.st_size > LARGEST_FILE:
            raise UnreadableImage(path, "image too large")
        data = np.fromfile(path, np.uint8)  # not cv2.imread: it fails on non-ASCII paths on Windows
    except OSError as error:
        raise UnreadableImage(path, "image missing") from error
    if data.size == 0:
        raise UnreadableImage(path, "image empty")
    frame = _decode(data)
    if frame is None:
        raise UnreadableImage(path, "image corrupt")
    if min(frame.shape[:2]) < SMALLEST:
        raise UnreadableImage(path, "image too small")
    return frame


def decode_frame(data: NDArray[np.uint8]) -> Frame | None:
    """Decode an encoded image (1-D uint8) to a 160x320x3 uint8 RGB frame; return None if it is damaged."""
    frame = _decode(data)
    return None if frame is None else _to_size(frame)


def _decode(data: NDArray[np.uint8]) -> Frame | None:
    if not is_decodable(data.tobytes()):
        return None
    try:
        image = cv2.imdecode(data, cv2.IMREAD_COLOR_RGB)
    except cv2.error:
        return None
    return None if image is None else np.asarray(image, np.uint8)


def _to_size(frame: Frame) -> Frame:
    if frame.shape[:2] == (ROWS, COLUMNS):
        return frame
    return np.asarray(cv2.resize(frame, (COLUMNS, ROWS), interpolation=cv2.INTER_AREA), np.uint8)


def encode_frame(frame: Frame, quality: int = QUALITY) -> bytes:
    """Encode a 160x320x3 uint8 RGB frame as JPEG, as the simulator does."""
    blue_first = cv2.cvtColor(frame, cv2.COLOR_RGB2BGR)  # ten times as fast as with NumPy
    return cv2.imencode(".jpg", blue_first, [cv2.IMWRITE_JPEG_QUALITY, quality])[1].tobytes()


def encoded_with(rows: Rows) -> Rows:
    """Return the rows of a frame on which `rows` of it depend once it was encoded as JPEG and decoded again.

    The decoder interpolates the colours, which have half the resolution, between neighbouring blocks.
    """
    first, last = rows
    if first >= last:
        return rows
    return max((first - 2) // BLOCK * BLOCK, 0), min(-(-(last + 2) // BLOCK) * BLOCK, ROWS)
