"""What the header of an encoded image says, read before anything is decoded.

A file of a kilobyte can claim to hold gigabytes of pixels, or a million passes over them, and OpenCV would believe it.
"""

import struct

JPEG_START, JPEG_END = b"\xff\xd8", b"\xff\xd9"
PNG_START = b"\x89PNG\r\n\x1a\n"
# markers of JPEG segments (ITU-T T.81, table B.1)
FRAMES = {*range(0xC0, 0xD0)} - {0xC4, 0xC8, 0xCC}
SEQUENTIAL_FRAMES = {0xC0, 0xC1}
SCAN = 0xDA

MOST_PIXELS = 1 << 22  # 80 simulator frames, or a photograph of four megapixels: decoded in about 50 ms
MOST_SCANS = 32  # of a JPEG, each a pass over all pixels; progressive encoders write about ten
MOST_SEGMENTS = 200  # before the first scan


def is_decodable(data: bytes) -> bool:
    """Return whether an image is a complete JPEG or PNG that can be decoded in a short time and little memory."""
    if data.startswith(JPEG_START):
        # OpenCV would fill the missing part of a truncated image with grey
        return JPEG_END in data[-64:] and _is_small_jpeg(data)
    if data.startswith(PNG_START) and data[12:16] == b"IHDR" and len(data) >= 24:
        columns, rows = struct.unpack(">II", data[16:24])
        return bool(0 < rows * columns <= MOST_PIXELS)
    return False


def _is_small_jpeg(data: bytes) -> bool:
    at, frame = len(JPEG_START), -1
    for _ in range(MOST_SEGMENTS):
        if at + 10 > len(data) or data[at] != 0xFF:
            return False
        marker = data[at + 1]
        if marker == SCAN:
            return frame >= 0 and _has_few_scans(data, frame, at)
        if marker in FRAMES:
            frame = at
            rows, columns = struct.unpack(">HH", data[at + 5 : at + 9])
            if not 0 < rows * columns <= MOST_PIXELS:
                return False
        # a marker may be preceded by any number of fill bytes 0xFF
        at += 1 if marker == 0xFF else 2 + (data[at + 2] << 8 | data[at + 3])
    return False


def _has_few_scans(data: bytes, frame: int, scan: int) -> bool:
    """Return whether a JPEG is decoded in few passes; `frame` and `scan` are the places of these segments."""
    # a sequential image whose first scan holds all components ends with it: libjpeg reads no other (and usually it is)
    if data[frame + 1] in SEQUENTIAL_FRAMES and data[scan + 4] == data[frame + 9]:
        return True
    return data.count(bytes([0xFF, SCAN])) <= MOST_SCANS
