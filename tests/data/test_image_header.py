"""Images that would take much time or memory are refused before they are decoded."""

import io
import struct
import zlib

import cv2
import numpy as np
import pytest
from conftest import picture
from hypothesis import given, settings
from hypothesis import strategies as st
from PIL import Image

from pilot.data.frames import decode_frame, encode_frame
from pilot.data.image_header import MOST_PIXELS, is_decodable


def encoded(kind: str, rows: int = 160, columns: int = 320, **options: object) -> bytes:
    target = io.BytesIO()
    Image.new("RGB", (columns, rows), (90, 120, 160)).save(target, kind, **options)
    return target.getvalue()


def jpeg_of(rows: int, columns: int) -> bytes:
    """A JPEG whose header has been edited."""
    data = bytearray(encode_frame(picture(0)))
    at = data.index(b"\xff\xc0") + 5
    data[at : at + 4] = struct.pack(">HH", rows, columns)
    return bytes(data)


def png_of(rows: int, columns: int) -> bytes:
    """A PNG of a kilobyte that unpacks to any size."""
    header = b"IHDR" + struct.pack(">IIBBBBB", columns, rows, 8, 2, 0, 0, 0)
    chunks = [header, b"IDAT" + zlib.compress(bytes(3 * 320 * 160)), b"IEND"]
    return b"\x89PNG\r\n\x1a\n" + b"".join(
        struct.pack(">I", len(chunk) - 4) + chunk + struct.pack(">I", zlib.crc32(chunk)) for chunk in chunks
    )


@pytest.mark.parametrize(
    "data",
    [
        encoded("JPEG"),
        encoded("JPEG", progressive=True),
        encoded("JPEG", comment=b"x" * 3000),
        encoded("PNG"),
        encoded("JPEG", 2048, 2048),
        encode_frame(picture(0.3)),
    ],
    ids=["jpeg", "progressive", "with a comment", "png", "four megapixels", "frame"],
)
def test_ordinary_images_are_decoded(data: bytes) -> None:
    assert is_decodable(data)
    assert decode_frame(np.frombuffer(data, np.uint8)).shape == (160, 320, 3)


PROGRESSIVE = encoded("JPEG", progressive=True)
LAST_SCAN = PROGRESSIVE[PROGRESSIVE.rindex(b"\xff\xda") : -2]


@pytest.mark.parametrize(
    "data",
    [
        png_of(30_000, 30_000),
        jpeg_of(60_000, 60_000),
        jpeg_of(0, 320),
        jpeg_of(1 << 11, (1 << 11) + 1),
        PROGRESSIVE[:-2] + LAST_SCAN * 5000 + b"\xff\xd9",
        encoded("JPEG")[:-2],
        encoded("BMP"),
        encoded("GIF"),
        encoded("TIFF"),
        b"\xff\xd8" + b"\xff" * 1_000_000 + b"\xff\xd9",
        b"\xff\xd8" + b"\xff\xe0\x00\x02" * 250_000 + b"\xff\xd9",
        b"\x89PNG\r\n\x1a\nIHDR",
        b"",
    ],
    ids=[
        "png of 900 megapixels",
        "jpeg of 3600 megapixels",
        "no rows",
        "just above the bound",
        "5000 scans",
        "truncated",
        "bmp",
        "gif",
        "tiff",
        "fill bytes",
        "segments",
        "short png",
        "empty",
    ],
)
def test_others_are_refused_without_decoding(data: bytes, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(cv2, "imdecode", lambda *_: pytest.fail("decoded"))
    assert decode_frame(np.frombuffer(data, np.uint8)) is None


IMAGES = [encoded("JPEG", 12, 20), encoded("JPEG", 12, 20, progressive=True), encoded("PNG", 12, 20)]


@settings(max_examples=300, deadline=None)
@given(
    image=st.sampled_from(IMAGES),
    changes=st.lists(st.tuples(st.integers(0, 1 << 16), st.integers(0, 255)), min_size=1, max_size=4),
)
def test_the_header_is_read_as_opencv_reads_it(image: bytes, changes: list[tuple[int, int]]) -> None:
    """Whatever is changed: what is let through is decoded to no more pixels than allowed."""
    data = bytearray(image)
    for place, value in changes:
        data[place % len(data)] = value
    if is_decodable(bytes(data)):
        decoded = cv2.imdecode(np.frombuffer(bytes(data), np.uint8), cv2.IMREAD_COLOR)
        assert decoded is None or decoded.shape[0] * decoded.shape[1] <= MOST_PIXELS
