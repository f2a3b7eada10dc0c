"""Geometry of closed roads, and location of points relative to them.

World axes: x east, y north, z up, in metres. Headings are compass headings in radians: 0 is north, and
right is positive, as for steering, curvature and lateral offset.
"""

import functools
import math
from dataclasses import dataclass, replace

import numpy as np
from scipy.interpolate import CubicSpline
from scipy.spatial import KDTree

from pilot.arrays import Floats
from pilot.vehicle import HALF_TRACK

REVERSED = " reversed"  # suffix of a track's name for the opposite direction
STEP = 0.5  # metres between consecutive points of a track
MIN_RADIUS = 6.5  # metres, minimum radius of bends; the car's minimum is 6.2
INNER_RADIUS = 1.5  # metres, minimum radius of a bend's inner edge
CLEARANCE = 7.0  # metres of height between a road and the one that passes above it
VERGE = 0.5  # metres between the edges of parts of the road that run side by side
EMBANKMENT = 0.3  # metres added to that for each metre of height between them
COARSE = 4  # points per point at which the distance to other parts of the road is checked


@dataclass(frozen=True)
class TrackPosition:
    """Position relative to a track.

    Attributes:
        progress: metres along the centre line from the start, within 0..length.
        lateral_offset: metres from the centre line, positive to the right.
        heading: of the road at this progress, radians.
        half_width: distance from the centre line to the road's edge, metres.
        height: of the road at this progress, metres.
    """

    progress: float
    lateral_offset: float
    heading: float
    half_width: float
    height: float


@dataclass(frozen=True, eq=False)
class Track:
    """A closed road, sampled every half metre along its centre line in the direction of driving.

    Attributes:
        name: such as lake or random:7; with the suffix " reversed" in the opposite direction.
        points: of the centre line, n x 3, metres.
        headings: n, radians, unwrapped.
        curvatures: n, 1/m, positive to the right.
        half_widths: distances from the centre line to the road's edge, n, metres.
        lane: lateral offset of the middle of the car's lane, metres, positive to the right.
    """

    name: str
    points: Floats
    headings: Floats
    curvatures: Floats
    half_widths: Floats
    lane: float = 0.0

    @property
    def length(self) -> float:
        """Length of the centre line, metres."""
        return STEP * len(self.points)

    @functools.cached_property
    def tree(self) -> KDTree:
        """KD-tree of the centre line's points (x, y)."""
        return KDTree(self.points[:, :2])

    @functools.cached_property
    def largest_offset(self) -> float:
        """Largest lateral offset (metres, to either side) at which the wheels are on the road everywhere."""
        return float(self.half_widths.min()) - HALF_TRACK

    def beside(self, offsets: Floats | float) -> Floats:
        """Return the points (n x 3, metres) at lateral offsets (one or n, metres) from the centre line."""
        right = np.column_stack([np.cos(self.headings), -np.sin(self.headings), np.zeros(len(self.headings))])
        return np.asarray(self.points + right * np.broadcast_to(offsets, len(self.points))[:, None])

    def reversed(self) -> "Track":
        """Return the same road in the opposite direction."""
        name = self.name.removesuffix(REVERSED) if self.name.endswith(REVERSED) else self.name + REVERSED
        return replace(
            self,
            name=name,
            points=self.points[::-1],
            headings=self.headings[::-1] + math.pi,
            curvatures=-self.curvatures[::-1],
            half_widths=self.half_widths[::-1],
        )

    def locate(self, x: float, y: float, near: float | None = None) -> TrackPosition:
        """Locate a point relative to the track.

        Args:
            x, y: metres.
            near: previous progress (metres) of the point, from which the search starts, so that another part of the
                road close by is not confused with this one; None: the whole road is searched.
        """
        index = int(self.tree.query((x, y))[1]) if near is None else self._downhill(x, y, int(near / STEP))
        point_x, point_y, height, heading, curvature, half_width, slope = self._rows[index]
        east, north = x - point_x, y - point_y
        along = east * math.sin(heading) + north * math.cos(heading)
        offset = east * math.cos(heading) - north * math.sin(heading)
        return TrackPosition(
            (index * STEP + along) % self.length,
            offset,
            heading + along * curvature,
            half_width,
            height + slope * along,
        )

    def _downhill(self, x: float, y: float, index: int) -> int:
        """Return the index of the point nearest to x, y, found by descent along the road from `index`."""
        rows, count = self._rows, len(self._rows)
        distance = math.dist(rows[index % count][:2], (x, y))
        for step in (1, -1):
            while (following := math.dist(rows[(index + step) % count][:2], (x, y))) < distance:
                index, distance = index + step, following
        return index % count

    @functools.cached_property
    def _rows(self) -> list[list[float]]:
        """x, y, z, heading, curvature, half width, slope of each point; as lists, which are faster to index."""
        slopes = (np.roll(self.points[:, 2], -1) - np.roll(self.points[:, 2], 1)) / (2 * STEP)
        table = np.column_stack([self.points, self.headings, self.curvatures, self.half_widths, slopes])
        rows: list[list[float]] = table.tolist()
        return rows

    def at(self, progress: float, offset: float = 0.0) -> tuple[float, float, float]:
        """Return x, y (metres) and the road's heading (radians) at a progress and a lateral offset (metres)."""
        number, part = divmod(progress / STEP, 1)
        x, y, _, heading, curvature, *_ = self._rows[int(number) % len(self._rows)]
        next_x, next_y = self._rows[int(number + 1) % len(self._rows)][:2]
        heading += part * STEP * curvature
        x, y = (1 - part) * x + part * next_x, (1 - part) * y + part * next_y
        return x + offset * math.cos(heading), y - offset * math.sin(heading), heading

    def curvature_ahead(self, progress: float, distance: float) -> Floats:
        """Return the curvatures (1/m), one per STEP, of the next `distance` metres after a progress (metres)."""
        indices = (int(progress / STEP) + np.arange(max(int(distance / STEP), 1))) % len(self.points)
        return np.asarray(self.curvatures[indices])


def closed_road(
    name: str, corners: Floats, half_width: float | Floats, *, lane: float = 0.0, start: float = 0.0
) -> Track:
    """Create a track from a periodic cubic spline through points.

    Args:
        name: of the track.
        corners: interpolated points (x, y, z), n x 3, metres.
        half_width: distance from the centre line to the road's edge, metres; one value or one per corner.
        lane: lateral offset of the middle of the car's lane, metres.
        start: distance from the first corner to the start line, metres.
    """
    corners = np.asarray(corners, float)
    closed = np.vstack([corners, corners[:1]])
    chords = np.linalg.norm(np.diff(closed[:, :2], axis=0), axis=1) ** 0.5  # centripetal parametrisation avoids loops
    parameter = np.concatenate([[0], np.cumsum(chords)])
    spline = CubicSpline(parameter, closed, bc_type="periodic")
    fine = np.linspace(0, parameter[-1], 40 * len(corners) * 8)
    travelled = np.concatenate([[0], np.cumsum(np.linalg.norm(np.diff(spline(fine)[:, :2], axis=0), axis=1))])
    count = round(travelled[-1] / STEP)
    even = np.interp(np.arange(count) * travelled[-1] / count, travelled, fine)
    speed, bend = spline(even, 1), spline(even, 2)
    curvatures = (bend[:, 0] * speed[:, 1] - bend[:, 1] * speed[:, 0]) / (speed[:, :2] ** 2).sum(1) ** 1.5
    headings = np.unwrap(np.arctan2(speed[:, 0], speed[:, 1]))
    widths = np.broadcast_to(half_width, len(corners))
    half_widths = np.interp(even, parameter, np.append(widths, widths[0]))
    track = Track(name, spline(even), headings, curvatures, half_widths, lane)
    return _starting_at(track, start)


def resampled(name: str, curve: Floats, half_width: float, *, lane: float = 0.0, start: float = 0.0) -> Track:
    """Create a track from a finely sampled closed curve.

    Args:
        name: of the track.
        curve: n x 5: x, y, z (metres), heading (radians, unwrapped) and curvature (1/m); the last point is the first.
        half_width: distance from the centre line to the road's edge, metres.
        lane: lateral offset of the middle of the car's lane, metres.
        start: distance from the curve's first point to the start line, metres.
    """
    travelled = np.concatenate([[0], np.cumsum(np.linalg.norm(np.diff(curve[:, :2], axis=0), axis=1))])
    count = round(travelled[-1] / STEP)
    even = np.arange(count) * travelled[-1] / count
    x, y, z, headings, curvatures = (np.interp(even, travelled, column) for column in curve.T)
    track = Track(name, np.column_stack([x, y, z]), headings, curvatures, np.full(count, half_width), lane)
    return _starting_at(track, start)


def _starting_at(track: Track, start: float) -> Track:
    """Return the same track with the start line moved ahead by `start` metres."""
    count = round(start / STEP)
    arrays = {name: np.roll(getattr(track, name), -count, axis=0) for name in ("points", "curvatures", "half_widths")}
    return replace(track, headings=np.unwrap(np.roll(track.headings, -count)), **arrays)


def validated(track: Track) -> Track:
    """Return the track if a car can drive on it and its surface does not overlap.

    Raises:
        ValueError: a bend is too tight for the car or the road's width, or the road comes too close to itself.
    """
    radius = 1 / np.abs(track.curvatures).max()
    if radius < max(track.half_widths.max() + INNER_RADIUS, MIN_RADIUS):
        raise ValueError(f"{track.name}: a bend of {radius:.1f} m radius is too tight")
    distances, heights = separations(track)
    too_close = (distances - EMBANKMENT * heights < 2 * track.half_widths.max() + VERGE) & (heights < CLEARANCE)
    if too_close.any():
        raise ValueError(f"{track.name}: comes within {distances[too_close].min():.1f} m of itself")
    return track


def separations(track: Track, apart: float = 50.0) -> tuple[Floats, Floats]:
    """Return the distances on the map and in height (n each, metres) between parts of the road.

    Args:
        track: the road.
        apart: distance along the road from which two points belong to different parts, metres.
    """
    points = track.points[::COARSE]
    first, second = np.triu_indices(len(points), round(apart / STEP / COARSE))
    different = len(points) - (second - first) >= apart / STEP / COARSE
    between = points[second[different]] - points[first[different]]
    return np.hypot(between[:, 0], between[:, 1]), np.abs(between[:, 2])


def crossings(track: Track, apart: float = 50.0) -> list[tuple[int, int]]:
    """Return the pairs of points at which the road crosses itself on the map, at least `apart` metres along it."""
    pairs = track.tree.query_pairs(STEP, output_type="ndarray")
    count, least = len(track.points), apart / STEP
    found: list[tuple[int, int]] = []
    for first, second in sorted(map(tuple, pairs)):
        between = second - first
        if min(between, count - between) >= least and all(abs(first - other) > least for other, _ in found):
            found.append((int(first), int(second)))
    return found
