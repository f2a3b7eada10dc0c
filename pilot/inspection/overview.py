"""A recording at a glance: length, shares of steering values, track, and the path that was driven."""

from dataclasses import dataclass
from typing import Any

import numpy as np
import pandas as pd

from pilot.arrays import Floats, sums_before
from pilot.data.motion import Motion, motion_breaks, motion_of
from pilot.evaluation.map_matching import match_track
from pilot.simulator.catalogue import both_ways, load_track, track_names
from pilot.simulator.track import Track
from pilot.vehicle import CAMERAS

RECOGNISED = 0.6  # correlation of curvatures from which a track counts as recognised
SHORTEST_MATCH = 150.0  # metres of driving without a pause by which a track can be recognised
FULL_LOCK = 0.99
BINS = 41  # of the steering's histogram, over -1..1


@dataclass(frozen=True, eq=False)
class Place:
    """Where a recording was driven.

    Attributes:
        track: name of the track, such as "lake reversed"; "" if it was not recognised.
        correlation: of the driven curvature with the track's; NaN if nothing could be compared.
        path: x and y per row, metres: on the track's map, or by dead reckoning from the origin.
    """

    track: str
    correlation: float
    path: Floats


def summary(rows: pd.DataFrame) -> dict[str, Any]:
    """Return the figures of a recording of n rows, as JSON-serialisable values."""
    pauses = rows["time"].diff()[~motion_breaks(rows)]
    steering = rows["steering"].to_numpy(float)
    counts, _ = np.histogram(steering, BINS, (-1, 1))
    return {
        "rows": len(rows),
        "minutes": round(float(pauses.sum()) / 60, 2),
        "hz": round(1 / float(pauses.median()), 1) if len(pauses) else 0.0,
        "cameras": [camera for camera in CAMERAS if (rows[camera] != "").any()],
        "mph": round(float(rows["speed"].mean()), 1) if rows["speed"].notna().any() else None,
        "zeros": round(float((steering == 0).mean()), 3),
        "full_lock": round(float((np.abs(steering) >= FULL_LOCK).mean()), 3),
        "histogram": counts.tolist(),
    }


def find_place(rows: pd.DataFrame) -> Place:
    """Recognise the track and the direction by the curvature of the driven path."""
    reckoned = np.zeros((len(rows), 2))
    if rows["speed"].isna().any():
        return Place("", float("nan"), reckoned)
    parts = [part for _, part in rows.groupby(motion_breaks(rows).cumsum()) if len(part) > 1]
    for part in parts:
        reckoned[rows.index.get_indexer(part.index)] = dead_reckoning(motion_of(part))
    longest = max(parts, key=lambda part: float(motion_of(part).steps.sum()), default=None)
    if longest is None or float(motion_of(longest).steps.sum()) < SHORTEST_MATCH:
        return Place("", float("nan"), reckoned)
    match = match_track(motion_of(longest), [load_track(name) for name in both_ways(track_names())])
    if match.correlation < RECOGNISED:
        return Place("", match.correlation, reckoned)
    return Place(match.track.name, match.correlation, _on_map(rows, parts, match.track))


def _on_map(rows: pd.DataFrame, parts: list[pd.DataFrame], track: Track) -> Floats:
    path = np.full((len(rows), 2), np.nan)
    for part in parts:
        motion = motion_of(part)
        if float(motion.steps.sum()) > SHORTEST_MATCH / 3:
            places = match_track(motion, [track]).progress
            path[rows.index.get_indexer(part.index)] = [track.at(float(place), 0.0)[:2] for place in places]
    return path


def dead_reckoning(motion: Motion) -> Floats:
    """Return the positions (n x 2, metres) that follow from speed and steering, from the origin northwards."""
    turns = motion.curvatures * motion.steps
    heading = sums_before(turns) + turns / 2
    return np.column_stack([sums_before(np.sin(heading) * motion.steps), sums_before(np.cos(heading) * motion.steps)])
