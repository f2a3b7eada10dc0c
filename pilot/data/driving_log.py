"""Reading of recordings into one table of usable rows, with counts of the rows and images left out.

A recording is a folder with a driving_log.csv and a folder IMG/ with its images.
"""

import math
import os
from array import array
from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pandas as pd

from pilot.data.frame_cache import FrameCache
from pilot.data.left_out import is_left_out, read_left_out
from pilot.data.log_format import LOG_NAME, NUMBERS, LogLine, read_log, time_of
from pilot.data.steered_by import CORRECTING, read_steered_by
from pilot.progress import ProgressBar, no_bar
from pilot.vehicle import CAMERAS

FOREIGN = "/"  # no image has this path
SECONDS_PER_ROW = 0.1  # assumed where the names of the images contain no time


class NoUsableData(ValueError):
    """The recordings contain no usable rows; the message names the file and what to do."""


@dataclass(frozen=True)
class DrivingLog:
    """The usable rows of one or more recordings, and counts of those left out.

    Attributes:
        rows: one row per time step, in the order of recording. Columns: recording (index in `recordings`), line
            (number in the file), time (seconds), center, left, right (path of the image, or "" if there is none),
            steering (-1..1, right is positive), throttle and brake (0..1), speed (mph), correction (whether a person
            or the expert corrects a model in it). Throttle, brake and speed are NaN where the log does not contain
            them.
        recordings: folders of the recordings.
        left_out: for each recording, the number of rows (or side images) left out, by reason.
    """

    rows: pd.DataFrame
    recordings: tuple[Path, ...]
    left_out: tuple[Counter[str], ...]

    def table(self) -> str:
        """Return the counts of used and left out rows as a text table, one line per recording."""
        used = self.rows["recording"].value_counts()
        lines = [
            {"recording": str(folder), "rows used": int(used.get(number, 0)), **left_out}
            for number, (folder, left_out) in enumerate(zip(self.recordings, self.left_out, strict=True))
        ]
        return str(pd.DataFrame(lines).fillna(0).to_string(index=False, float_format="%d"))


def find_recordings(folders: Sequence[Path]) -> list[Path]:
    """Return the driving_log.csv files in the folders and their subfolders, without duplicates.

    Args:
        folders: folders to search; paths of log files are also accepted.

    Raises:
        NoUsableData: a folder does not exist, or none of them contains a log.
    """
    logs: list[Path] = []
    for folder in folders:
        if not folder.exists():
            raise NoUsableData(f"{folder}: no such folder. Name the folder of a recording")
        logs += [folder] if folder.is_file() else sorted(folder.rglob(LOG_NAME))
    if not logs:
        raise NoUsableData(
            f"{', '.join(map(str, folders))}: no {LOG_NAME} in it or below. Record laps with the simulator "
            f"into that folder, or name the folder of a recording"
        )
    return list({log.resolve(): log for log in logs}.values())


def read_driving_logs(
    folders: Sequence[Path],
    progress: ProgressBar[str] = no_bar,
    cache: FrameCache | None = None,
    *,
    annotated: bool = True,
) -> DrivingLog:
    """Read one or more recordings; unusable rows and images are left out and counted by reason.

    Args:
        folders: recordings, or folders that contain recordings.
        progress: progress bar over the images being checked.
        cache: cache that checks the images and stores their frames; None: the frames are not stored.
        annotated: leave out what the files beside the log say: the user's left_out.csv, and the model's driving in
            recordings of corrections.

    Raises:
        NoUsableData: no row can be used; the message names the files, the reasons and what to do.
    """
    logs = find_recordings(folders)
    parts = [_read_log(log, number, annotated=annotated) for number, log in enumerate(logs)]
    rows = pd.concat([rows for rows, _ in parts], ignore_index=True)
    left_out = tuple(counts for _, counts in parts)
    paths = [path for camera in CAMERAS for path in rows[camera] if path]
    rows = _without_bad_images(rows, left_out, (cache or FrameCache()).check(paths, progress))
    recordings = tuple(log.parent if log.name == LOG_NAME else log for log in logs)
    if rows.empty:
        raise NoUsableData(_nothing_usable(logs, left_out))
    return DrivingLog(rows, recordings, left_out)


def share_of_each(rows: pd.DataFrame, begin: float, end: float) -> pd.DataFrame:
    """Return the rows of each recording from the share `begin` up to the share `end` (0..1) of its rows."""
    recording = rows.groupby("recording")["recording"]
    share = recording.cumcount() / recording.transform("size")
    return rows[(share >= begin) & (share < end)].reset_index(drop=True)


def _nothing_usable(logs: Sequence[Path], left_out: Sequence[Counter[str]]) -> str:
    reasons = "; ".join(
        f"{log}: " + (", ".join(f"{reason} ({count})" for reason, count in counts.items()) or "no rows")
        for log, counts in zip(logs, left_out, strict=True)
    )
    cure = "The images must be in the folder IMG next to the log; if they are lost, record again"
    return f"no row can be used. {reasons}. {cure}"


def _read_log(log: Path, recording: int, *, annotated: bool) -> tuple[pd.DataFrame, Counter[str]]:
    """Return the usable rows of a log, judged without reading the images, and counts of what is left out."""
    images = _images_beside(log)
    columns = _Columns()
    try:
        for line in read_log(log):
            columns.add(line, images)
    except ValueError as error:
        names = ",".join((*CAMERAS, *NUMBERS))
        raise NoUsableData(f"{log}: {error}. Give the columns their usual names: {names}") from error
    table = columns.table(recording)
    steered_by = table["center"].map(_steerers(log))
    table["correction"] = steered_by.isin(CORRECTING)
    faults = _faults(table)
    if annotated:
        by_hand = is_left_out(table["center"].tolist(), read_left_out(log.parent))
        faults = faults.mask((steered_by == "model") & (faults == ""), "steered by the model")
        faults = faults.mask(by_hand & (faults == ""), "left out by hand")
    left_out = Counter(faults[faults != ""].tolist())
    rows = table[faults == ""].reset_index(drop=True)
    left_out += Counter({"side image missing": int(rows["missing"].sum())})
    rows["time"] = _fill_times(rows["time"])
    for camera in CAMERAS:
        rows[camera] = rows[camera].replace(FOREIGN, "")
    return rows.drop(columns=["values", "missing"]), left_out


def _steerers(log: Path) -> Callable[[str], str]:
    """Return a function from the path of an image to who steered; "" if that is unknown."""
    steerers = read_steered_by(log.parent)
    return (lambda path: steerers.get(os.path.basename(path).lower(), "")) if steerers else (lambda _path: "")


class _Columns:
    """Columns of a log, with 8 bytes per number: a log may have a million rows."""

    def __init__(self) -> None:
        self.whole = {name: array("q") for name in ("line", "values", "missing")}
        self.numbers = {name: array("d") for name in ("time", *NUMBERS)}
        self.paths: dict[str, list[str]] = {camera: [] for camera in CAMERAS}

    def add(self, line: LogLine, images: dict[str, str]) -> None:
        """Add a line; `images` are the paths by names in lower case."""
        found = {camera: images.get(name.lower()) for camera, name in line.images.items()}
        self.whole["line"].append(line.number)
        self.whole["values"].append(len(line.values))
        self.whole["missing"].append(list(found.values()).count(None) if found else -1)
        self.numbers["time"].append(time_of(line.images.get("center", "")))
        for name in NUMBERS:
            self.numbers[name].append(_number(line.values.get(name, "")))
        for camera in CAMERAS:
            self.paths[camera].append(found.get(camera) or "")

    def table(self, recording: int) -> pd.DataFrame:
        """Return the columns of `DrivingLog.rows`, the number of values, and of images missing (-1: none is named)."""
        columns = {
            "recording": np.full(len(self.whole["line"]), recording),
            "line": np.frombuffer(self.whole["line"], np.int64),
            "time": np.frombuffer(self.numbers["time"]),
            **{camera: np.array(self.paths[camera], object) for camera in CAMERAS},
            **{name: np.frombuffer(self.numbers[name]) for name in NUMBERS},
            **{name: np.frombuffer(self.whole[name], np.int64) for name in ("values", "missing")},
        }
        return pd.DataFrame(columns, copy=False)


def _faults(table: pd.DataFrame) -> "pd.Series[str]":
    """Return why each row cannot be used; "" if no fault is found."""
    usual = Counter(table["values"].tolist()).most_common(1)
    expected = min(usual[0][0], len(NUMBERS)) if usual else 0
    steering, center = table["steering"], table["center"]
    faults = {
        "row incomplete": (table["values"] < expected) | (table["missing"] < 0),
        "steering not a number": steering.isna(),
        "steering outside -1..1": steering.abs() > 1,
        "image missing": center == "",
        "image linked from elsewhere": center == FOREIGN,
    }
    return pd.Series(np.select(list(faults.values()), list(faults), ""), index=table.index, dtype=object)


def _images_beside(log: Path) -> dict[str, str]:
    """Return the paths of the files in IMG/ and in the log's own folder, by their names in lower case.

    Recordings may come from strangers: a link to a file outside the recording is replaced by `FOREIGN`.
    """
    folders = [log.parent, *(entry for entry in log.parent.iterdir() if entry.is_dir() and entry.name.lower() == "img")]
    root = os.path.realpath(log.parent)
    images = {}
    for folder in folders:
        linked = not _is_within(folder, root)
        with os.scandir(folder) as entries:
            for entry in entries:
                foreign = linked or (entry.is_symlink() and not _is_within(entry.path, root))
                images[entry.name.lower()] = FOREIGN if foreign else entry.path
    return images


def _is_within(path: Path | str, root: str) -> bool:
    real = os.path.realpath(path)
    return real == root or real.startswith(root + os.sep)


def _number(text: str) -> float:
    try:
        return float(text)
    except ValueError:
        return math.nan


def _fill_times(times: "pd.Series[float]") -> "pd.Series[float]":
    if times.isna().any():
        return pd.Series(range(len(times)), dtype=float) * SECONDS_PER_ROW
    return times


def _without_bad_images(rows: pd.DataFrame, left_out: Sequence[Counter[str]], bad: dict[str, str]) -> pd.DataFrame:
    """Remove rows with an unusable centre image, and unusable side images from the others."""
    for camera in CAMERAS:
        damaged = rows[rows[camera].isin(list(bad))]
        what = "" if camera == "center" else "side "
        for recording, path in zip(damaged["recording"], damaged[camera], strict=True):
            left_out[recording][what + bad[path]] += 1
    for camera in ("left", "right"):
        rows[camera] = rows[camera].where(~rows[camera].isin(list(bad)), "")
    return rows[~rows["center"].isin(list(bad))].reset_index(drop=True)
