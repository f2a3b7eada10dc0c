"""Who steered in a recording: the file steered_by.csv beside the log, with a line for each image of the centre camera.

Only recordings of corrections have this file. Their rows by the model show what led to a correction, and are no example
to learn from; those by a person or by the expert correct it.
"""

import csv
from pathlib import Path
from typing import Literal

STEERED_BY = "steered_by.csv"
Steerer = Literal["model", "person", "expert"]
CORRECTING = {"person", "expert"}


def read_steered_by(folder: Path) -> dict[str, str]:
    """Return who steered, by the names of the centre camera's images in lower case; empty if the file is missing.

    A line that is cut off, as the last one may be after a power failure, or damaged is ignored.

    Raises:
        OSError: the file cannot be read.
    """
    path = folder / STEERED_BY
    if not path.is_file():
        return {}
    with path.open(encoding="utf-8", errors="replace", newline="") as lines:
        return {line[0].lower(): line[1] for line in csv.reader(lines) if len(line) == 2 and line[1] in _KNOWN}


_KNOWN = {"model", *CORRECTING}


def format_steered_by(image: str, steerer: Steerer) -> str:
    """Return the line of an image of the centre camera."""
    return f"{image},{steerer}\n"
