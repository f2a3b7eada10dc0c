"""Recordings as donkeycar's data sets, tub v2 (https://docs.donkeycar.com): writing and reading.

A tub is a folder with manifest.json, of five lines of JSON (names of the values, their types, metadata of the user, of
the manifest, and of the catalogs), files catalog_N.catalog with a record per line, and the images. Steering has the
same scale and sign. Rows that are left out become deleted records, and the other way round. A tub has one camera.
"""

import json
import shutil
from collections.abc import Iterator
from dataclasses import dataclass
from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pandas as pd

from pilot.arrays import Frame
from pilot.data.driving_log import NoUsableData
from pilot.data.frames import encode_frame
from pilot.data.left_out import LeftOut, is_left_out, read_left_out, write_left_out
from pilot.data.log_format import LOG_NAME, format_line, time_stamp
from pilot.exchange.pictures import as_frame
from pilot.files import move_when_done, refuse_existing
from pilot.progress import ProgressBar, no_bar
from pilot.vehicle import MPH, PLAUSIBLE_SPEED_MPH

MANIFEST, IMAGES = "manifest.json", "images"
INPUTS = {
    "cam/image_array": "image_array",
    "user/angle": "float",
    "user/throttle": "float",
    "user/mode": "str",
    "enc/speed": "float",  # m/s
}
RECORDS_PER_CATALOG = 1000
SPEEDS = ("enc/speed", "pos/speed")  # m/s: of an encoder, of donkeycar's simulator
PAUSE = 0.05  # s between two records without a time: donkeycar's rate is 20 per second


@dataclass(frozen=True)
class Tub:
    """A tub that was read.

    Attributes:
        folder: of the tub.
        records: in the order of recording.
        deleted: numbers of the records that are marked as deleted.
    """

    folder: Path
    records: list[dict[str, Any]]
    deleted: set[int]


# Writing


def write_tub(rows: pd.DataFrame, recording: Path, tub: Path, progress: ProgressBar[int] = no_bar) -> None:
    """Write a recording as a tub: the images of the centre camera, steering, throttle and speed.

    Args:
        rows: all rows of the recording, also those that are left out.
        recording: its folder, for what is left out.
        tub: folder to write; must not exist.
        progress: progress bar over the rows.

    Raises:
        FileExistsError: the folder exists.
        OSError: it cannot be written.
    """
    refuse_existing(tub)
    with move_when_done(tub) as unfinished:
        (unfinished / IMAGES).mkdir(parents=True)
        lines = [
            _write_record(rows.iloc[number], number, unfinished)
            for number in progress(range(len(rows)), len(rows), "writing")
        ]
        _write_catalogs(unfinished, lines, is_left_out(rows["center"].tolist(), read_left_out(recording)))


def _write_record(row: "pd.Series[Any]", number: int, tub: Path) -> str:
    """Copy an image, and return the line of its record."""
    name = f"{number}_cam_image_array_.jpg"
    shutil.copyfile(row["center"], tub / IMAGES / name)
    brake = 0.0 if np.isnan(row["brake"]) else float(row["brake"])
    values = {
        "_index": number,
        "_session_id": f"recording_{int(row['recording'])}",
        "_timestamp_ms": round(1000 * float(row["time"])),
        "cam/image_array": name,
        "user/angle": float(row["steering"]),
        "user/throttle": (0.0 if np.isnan(row["throttle"]) else float(row["throttle"])) - brake,
        "user/mode": "user",
        **({} if np.isnan(row["speed"]) else {"enc/speed": float(row["speed"]) * MPH}),
    }
    return json.dumps(values, sort_keys=True, allow_nan=False) + "\n"


def _write_catalogs(tub: Path, lines: list[str], deleted: Any) -> None:
    created = datetime.now(UTC).timestamp()
    names: list[str] = []
    for start in range(0, len(lines), RECORDS_PER_CATALOG):
        part, stem = lines[start : start + RECORDS_PER_CATALOG], f"catalog_{len(names)}"
        names.append(f"{stem}.catalog")
        (tub / names[-1]).write_text("".join(part), encoding="utf-8", newline="")
        manifest = {
            "created_at": created,
            "line_lengths": list(map(len, part)),
            "path": names[-1],
            "start_index": start,
        }
        (tub / f"{stem}.catalog_manifest").write_text(json.dumps(manifest) + "\n", newline="")
    state = {
        "paths": names,
        "current_index": len(lines),
        "max_len": RECORDS_PER_CATALOG,
        "deleted_indexes": np.flatnonzero(deleted).tolist(),
    }
    content = [list(INPUTS), list(INPUTS.values()), {}, {"created_at": created}, state]
    (tub / MANIFEST).write_text("".join(json.dumps(each) + "\n" for each in content), newline="")


# Reading


def read_tub(folder: Path) -> Tub:
    """Read the records of a tub.

    Raises:
        NoUsableData: the folder is no tub, or is damaged; the message names the file and what to do.
    """
    path = folder / MANIFEST
    try:
        state = json.loads(path.read_text(encoding="utf-8").splitlines()[4])
        records = [record for name in state["paths"] for record in _records(folder / Path(name).name)]
        return Tub(folder, records, set(map(int, state["deleted_indexes"])))
    except (OSError, ValueError, LookupError, TypeError) as error:
        raise NoUsableData(
            f"{path}: cannot be read as a tub of donkeycar, version 2 ({error}): name the folder with {MANIFEST}"
        ) from error


def _records(catalog: Path) -> Iterator[dict[str, Any]]:
    for line in catalog.read_text(encoding="utf-8").splitlines():
        if line:
            yield json.loads(line)


def import_tub(tub: Tub, recording: Path, progress: ProgressBar[dict[str, Any]] = no_bar) -> int:
    """Write a tub as a recording, and return the number of rows.

    Images of another shape are cropped to 2:1 about their middle and resized to 320x160. Records without an image or
    steering are left out.

    Raises:
        FileExistsError: the recording exists.
        NoUsableData: no record can be used.
        OSError: the recording cannot be written.
    """
    refuse_existing(recording)
    with move_when_done(recording) as unfinished:
        (unfinished / "IMG").mkdir(parents=True)
        names, lines = _write_images(tub, unfinished / "IMG", progress)
        if not lines:
            raise NoUsableData(f"{tub.folder}: no record has an image and user/angle")
        (unfinished / LOG_NAME).write_text("".join(lines), encoding="utf-8", newline="")
        deleted = sorted(tub.deleted & set(names))
        if deleted:
            write_left_out(unfinished, [LeftOut(names[index], names[index], "deleted in the tub") for index in deleted])
    return len(lines)


def _write_images(tub: Tub, folder: Path, progress: ProgressBar[dict[str, Any]]) -> tuple[dict[int, str], list[str]]:
    """Write the usable records' images; returns their names by the record's number, and the lines of the log."""
    names: dict[int, str] = {}
    lines: list[str] = []
    for number, record in enumerate(progress(tub.records, len(tub.records), "reading")):
        frame = _frame(tub.folder, record.get("cam/image_array"))
        steering = record.get("user/angle")
        if frame is None or not isinstance(steering, int | float) or not -1 <= steering <= 1:
            continue
        name = f"center_{time_stamp(_time(record, number))}.jpg"
        (folder / name).write_bytes(encode_frame(frame))
        lines.append(format_line([f"IMG/{name}", "", ""], float(steering), _throttle(record), _mph(record)))
        names[int(record.get("_index", number))] = name
    return names, lines


def _frame(tub: Path, name: Any) -> Frame | None:
    """Return an image as a frame; None if it is missing or damaged."""
    image = cv2.imread(str(tub / IMAGES / Path(str(name)).name), cv2.IMREAD_COLOR_RGB)
    return None if image is None else as_frame(image)


def _time(record: dict[str, Any], number: int) -> datetime:
    """Return the time of a record; without one, records are `PAUSE` apart."""
    milliseconds = record.get("_timestamp_ms")
    if isinstance(milliseconds, int | float):
        return datetime.fromtimestamp(0, UTC) + timedelta(milliseconds=round(milliseconds))
    return datetime(2000, 1, 1, tzinfo=UTC) + timedelta(seconds=number * PAUSE)


def _throttle(record: dict[str, Any]) -> float:
    value = record.get("user/throttle")
    return float(np.clip(value, -1, 1)) if isinstance(value, int | float) else 0.0


def _mph(record: dict[str, Any]) -> float:
    speeds = [float(record[name]) / MPH for name in SPEEDS if isinstance(record.get(name), int | float)]
    return min(max(speeds[0], 0.0), PLAUSIBLE_SPEED_MPH) if speeds else float("nan")
