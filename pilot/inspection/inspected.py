"""A recording under inspection: its rows, what was found in them, and the ranges that are left out."""

from collections import Counter
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pilot.arrays import Floats
from pilot.data.driving_log import read_driving_logs
from pilot.data.left_out import LeftOut, is_left_out, read_left_out, write_left_out
from pilot.data.samples import smooth_steering
from pilot.data.steered_by import read_steered_by
from pilot.inspection.overview import find_place, summary
from pilot.inspection.suspicion import REASONS, find_moments, row_scores, scores_of_log
from pilot.simulator.catalogue import load_track

LABEL_SECONDS = 0.5  # over which the shown label is averaged
MAP_METRES = 4.0  # between the points of the track's line on the map


@dataclass(frozen=True)
class WrongRange(ValueError):
    """The rows to leave out do not exist."""

    first: int
    last: int

    def __str__(self) -> str:
        return f"rows {self.first} to {self.last}: there are no such rows"


class InspectedRecording:
    """One recording.

    Attributes:
        folder: of the recording.
        rows: all rows with readable images, also those that are left out.
        unusable: rows that cannot be used, by reason.
        summary: figures of the recording.
        place: the track, and the path on its map.
        scores: n by reason, see `suspicion`.
        predicted: steering by a model, n; None: there is no model, or not yet.
        state: what is being done, for display; empty at the end.
    """

    def __init__(self, folder: Path) -> None:
        """Read a recording.

        Raises:
            NoUsableData: it contains no usable rows.
        """
        log = read_driving_logs([folder], annotated=False)
        self.folder = folder if folder.is_dir() else folder.parent
        self.rows = log.rows
        self.unusable: Counter[str] = log.left_out[0]
        self.summary, self.place = summary(self.rows), find_place(self.rows)
        self.scores: dict[str, Floats] = scores_of_log(self.rows)
        self.predicted: Floats | None = None
        self.state = "waiting"
        steerers = read_steered_by(self.folder)
        self._by_model = np.array([steerers.get(Path(image).name.lower()) == "model" for image in self.rows["center"]])

    # Ranges that are left out

    @property
    def left_out(self) -> NDArray[np.bool_]:
        """Whether each row is left out by the user (n)."""
        return is_left_out(self.rows["center"].tolist(), read_left_out(self.folder))

    def leave_out(self, first: int, last: int, reason: str) -> None:
        """Leave a range of rows out of the training, both ends included.

        Raises:
            WrongRange: there are no such rows.
            OSError: left_out.csv cannot be written.
        """
        self._check(first, last)
        begin, end = (Path(self.rows["center"].iloc[row]).name for row in (first, last))
        write_left_out(self.folder, [*read_left_out(self.folder), LeftOut(begin, end, reason)])

    def restore(self, first: int, last: int) -> None:
        """Remove all ranges that overlap with one from left_out.csv.

        Raises:
            WrongRange: there are no such rows.
            OSError: left_out.csv cannot be written.
        """
        self._check(first, last)
        images, kept = self.rows["center"].tolist(), []
        for each in read_left_out(self.folder):
            if not is_left_out(images, [each])[first : last + 1].any():
                kept.append(each)
        write_left_out(self.folder, kept)

    def _check(self, first: int, last: int) -> None:
        if not 0 <= first <= last < len(self.rows):
            raise WrongRange(first, last)

    # What the page shows

    def overview(self) -> dict[str, Any]:
        """Return what is shown of each recording in the list, as JSON-serialisable values."""
        left_out = int(self.left_out.sum())
        return {
            "name": self.folder.name,
            "folder": str(self.folder),
            **self.summary,
            "track": self.place.track,
            "correlation": None if np.isnan(self.place.correlation) else round(self.place.correlation, 2),
            "left_out": {**self.unusable, **({"left out by hand": left_out} if left_out else {})},
            "moments": len(find_moments(self.scores)),
            "state": self.state,
        }

    def series(self) -> dict[str, Any]:
        """Return the values of all rows, as JSON-serialisable lists."""
        return {
            "time": _numbers(self.rows["time"] - self.rows["time"].iloc[0], 3),
            "steering": _numbers(self.rows["steering"], 4),
            "label": _numbers(smooth_steering(self.rows, LABEL_SECONDS), 4),
            "speed": _numbers(self.rows["speed"], 2),
            "path": [_numbers(axis, 2) for axis in self.place.path.T],
            "track": self._track_line(),
            "predicted": None if self.predicted is None else _numbers(self.predicted, 4),
            "score": _numbers(row_scores(self.scores), 2),
            "left_out": self.left_out.tolist(),
            "by_model": self._by_model.tolist(),
            "cameras": self.summary["cameras"],
        }

    def _track_line(self) -> list[list[float | None]]:
        if not self.place.track:
            return [[], []]
        track = load_track(self.place.track)
        points = [track.at(progress, 0.0)[:2] for progress in np.arange(0, track.length, MAP_METRES)]
        return [_numbers(axis, 1) for axis in np.array([*points, points[0]]).T]

    def moments(self) -> list[dict[str, Any]]:
        """Return the suspicious moments, the most suspicious first, as JSON-serialisable values."""
        begin = float(self.rows["time"].iloc[0])
        return [
            {
                "first": moment.first,
                "last": moment.last,
                "seconds": round(float(self.rows["time"].iloc[moment.first]) - begin, 1),
                "reason": REASONS[moment.reason],
                "score": round(moment.score, 2),
            }
            for moment in find_moments(self.scores)
        ]


def _numbers(values: Any, digits: int) -> list[float | None]:
    """Return rounded numbers; None, which JSON knows, instead of NaN."""
    return [round(float(value), digits) if np.isfinite(value) else None for value in np.asarray(values, float)]
