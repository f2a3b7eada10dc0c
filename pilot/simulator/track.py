"""A closed road as geometry: where it goes, how wide it is, and where on it a car stands.

World axes: x east, y north, z up, metres. Headings are compass headings in radians: 0 to the north,
positive to the right, so that steering, curvature, offset and heading all count to the right.
"""

import functools
import math
from dataclasses import dataclass, replace

import numpy as np
from scipy.interpolate import CubicSpline
from scipy.spatial import KDTree

from pilot.arrays import Floats
from pilot.vehicle import HALF_TRACK

REVERSED = " reversed"  # behind the name of a road that is driven the other way
STEP = 0.5  # metres between the points that a road is kept as
TIGHTEST = 12.0  # metres, radius of a bend; the car's own least is 6.2


@dataclass(frozen=True)
class TrackPosition:
    """Where on a road something stands.

    Attributes:
        progress: metres along the middle line from the start, within 0..length.
        lateral_offset: metres to the right of the middle line.
        heading: radians, of the road there.
        half_width: metres from the middle line to the road's edge.
        height: metres, of the road there.
    """

    progress: float
    lateral_offset: float
    heading: float
    half_width: float
    height: float


@dataclass(frozen=True, eq=False)
class Track:
    """A closed road, sampled every half metre along its middle line in the direction of driving.

    Attributes:
        name: such as lake, or random:7; with " reversed" behind where it is driven the other way.
        points: n x 3, metres.
        headings: n, radians, unwrapped.
        curvatures: n, 1/m, positive to the right.
        half_widths: n, metres.
        lane: metres to the right of the middle line, where the car belongs.
    """

    name: str
    points: Floats
    headings: Floats
    curvatures: Floats
    half_widths: Floats
    lane: float = 0.0

    @property
    def length(self) -> float:
        """Metres along the middle line."""
        return STEP * len(self.points)

    @functools.cached_property
    def tree(self) -> KDTree:
        """The middle line for nearest-point searches, in x and y."""
        return KDTree(self.points[:, :2])

    @functools.cached_property
    def margins(self) -> Floats:
        """Metres that a car in the middle of its lane has between its wheels and the road's edge, at each point."""
        return np.asarray(self.half_widths - abs(self.lane) - HALF_TRACK)

    def beside(self, offsets: Floats | float) -> Floats:
        """Points (n x 3, metres) beside the middle line; offsets in metres to the right of it."""
        right = np.column_stack([np.cos(self.headings), -np.sin(self.headings), np.zeros(len(self.headings))])
        return np.asarray(self.points + right * np.broadcast_to(offsets, len(self.points))[:, None])

    def reversed(self) -> "Track":
        """The same road driven the other way."""
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
        """The place of a point.

        Args:
            x, y: metres.
            near: progress where it was last, so that a road that comes close to itself is no trap;
                None searches the whole road.
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
        """The nearest point to x, y that is reached by coming ever nearer, point by point, from one close by."""
        rows, count = self._rows, len(self._rows)
        distance = math.dist(rows[index % count][:2], (x, y))
        for step in (1, -1):
            while (following := math.dist(rows[(index + step) % count][:2], (x, y))) < distance:
                index, distance = index + step, following
        return index % count

    @functools.cached_property
    def _rows(self) -> list[list[float]]:
        """For each point x, y, z, heading, curvature, half width, slope: plain numbers, fastest for single lookups."""
        slopes = (np.roll(self.points[:, 2], -1) - np.roll(self.points[:, 2], 1)) / (2 * STEP)
        table = np.column_stack([self.points, self.headings, self.curvatures, self.half_widths, slopes])
        rows: list[list[float]] = table.tolist()
        return rows

    def at(self, progress: float, offset: float = 0.0) -> tuple[float, float, float]:
        """Position x, y (metres) and the road's heading (radians) at a progress and offset (metres)."""
        number, part = divmod(progress / STEP, 1)
        x, y, _, heading, curvature, *_ = self._rows[int(number) % len(self._rows)]
        next_x, next_y = self._rows[int(number + 1) % len(self._rows)][:2]
        heading += part * STEP * curvature
        x, y = (1 - part) * x + part * next_x, (1 - part) * y + part * next_y
        return x + offset * math.cos(heading), y - offset * math.sin(heading), heading

    def curvature_ahead(self, progress: float, distance: float) -> Floats:
        """Curvatures (1/m) of the next metres."""
        indices = (int(progress / STEP) + np.arange(max(int(distance / STEP), 1))) % len(self.points)
        return np.asarray(self.curvatures[indices])


def closed_road(name: str, corners: Floats, half_width: float | Floats, *, lane: float = 0.0) -> Track:
    """A smooth closed road through points.

    Args:
        name: its name.
        corners: n x 3 (x, y, z) that a periodic spline is laid through.
        half_width: metres, the same everywhere or one per corner.
        lane: metres to the right of the middle where the car belongs.

    Raises:
        ValueError: it crosses or comes too close to itself, or turns too tightly for its width.
    """
    corners = np.asarray(corners, float)
    closed = np.vstack([corners, corners[:1]])
    chords = np.linalg.norm(np.diff(closed[:, :2], axis=0), axis=1) ** 0.5  # centripetal: no loops
    parameter = np.concatenate([[0], np.cumsum(chords)])
    spline = CubicSpline(parameter, closed, bc_type="periodic")
    fine = np.linspace(0, parameter[-1], 40 * len(corners) * 8)
    travelled = np.concatenate([[0], np.cumsum(np.linalg.norm(np.diff(spline(fine)[:, :2], axis=0), axis=1))])
    count = round(travelled[-1] / STEP)
    even = np.interp(np.arange(count) * travelled[-1] / count, travelled, fine)
    speed, bend = spline(even, 1), spline(even, 2)
    squared = (speed[:, :2] ** 2).sum(1)
    curvatures = (bend[:, 0] * speed[:, 1] - bend[:, 1] * speed[:, 0]) / squared**1.5
    headings = np.unwrap(np.arctan2(speed[:, 0], speed[:, 1]))
    widths = np.broadcast_to(half_width, len(corners))
    half_widths = np.interp(even, parameter, np.append(widths, widths[0]))
    track = Track(name, spline(even), headings, curvatures, half_widths, lane)
    _check(track)
    return track


def _check(track: Track) -> None:
    radius = 1 / np.abs(track.curvatures).max()
    if radius < max(2 * track.half_widths.max(), TIGHTEST):
        raise ValueError(f"{track.name}: a bend of {radius:.1f} m radius is too tight")
    if (closest := separation(track)) < 4 * track.half_widths.max():
        raise ValueError(f"{track.name}: comes within {closest:.1f} m of itself")


def separation(track: Track, apart: float = 70.0) -> float:
    """Least distance (metres) between two points of the road that are at least `apart` along it."""
    every = 4
    points = track.points[::every, :2]
    steps = np.arange(len(points))
    along = np.abs(steps[:, None] - steps[None])
    along = np.minimum(along, len(points) - along) * STEP * every
    distances = np.linalg.norm(points[:, None] - points[None], axis=2)
    return float(distances[along >= apart].min())
