"""Ranges of a recording that its user leaves out: the file left_out.csv beside the log, which itself is never changed.

A line names the images of the centre camera in the first and the last row of a range, and a reason.
"""

import csv
import io
import os
from collections.abc import Iterable, Sequence
from dataclasses import astuple, dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from pilot.files import write_atomically

LEFT_OUT = "left_out.csv"
HEADER = ("first image", "last image", "reason")


@dataclass(frozen=True)
class LeftOut:
    """A range of rows, both ends included.

    Attributes:
        first, last: names of the centre camera's images.
        reason: of the user, for display.
    """

    first: str
    last: str
    reason: str = ""


def read_left_out(folder: Path) -> list[LeftOut]:
    """Return the ranges that are left out of a recording; lines that are damaged are ignored.

    Raises:
        OSError: the file cannot be read.
    """
    path = folder / LEFT_OUT
    if not path.is_file():
        return []
    with path.open(encoding="utf-8", errors="replace", newline="") as lines:
        records = [record for record in csv.reader(lines) if len(record) == 3 and tuple(record) != HEADER]
    return [LeftOut(*record) for record in records]


def write_left_out(folder: Path, ranges: Iterable[LeftOut]) -> None:
    """Replace the ranges that are left out of a recording.

    Raises:
        OSError: the file cannot be written; it keeps its content then.
    """
    text = io.StringIO()
    csv.writer(text, lineterminator="\n").writerows([HEADER, *map(astuple, ranges)])
    write_atomically(folder / LEFT_OUT, lambda file: file.write(text.getvalue().encode()))


def is_left_out(images: Sequence[str], ranges: Sequence[LeftOut]) -> NDArray[np.bool_]:
    """Mark the rows that lie in a range; a range one of whose images does not exist has no effect.

    Args:
        images: of the centre camera, one per row of the recording, in its order.
        ranges: that are left out.
    """
    marked = np.zeros(len(images), bool)
    if ranges:
        places = {os.path.basename(image).lower(): row for row, image in enumerate(images)}
        for each in ranges:
            first, last = places.get(each.first.lower()), places.get(each.last.lower())
            if first is not None and last is not None:
                marked[min(first, last) : max(first, last) + 1] = True
    return marked
