"""The terrain around a road: a grid of heights and ground colours, level with the road near its edges."""

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.spatial import KDTree

from pilot.arrays import Floats
from pilot.simulator.course import DIRT, Course, Roadside, RoadsideSection
from pilot.simulator.rendering.detail import LARGEST, Sizes, flattened, square_sizes
from pilot.simulator.rendering.noise import smooth_noise

CELL = 3.0  # metres between neighbouring points of the grid
MARGIN = 110.0  # metres of terrain around the road's bounding box
LEVEL_BESIDE = 2.0  # metres from the road's edge within which the terrain is level with the road
CUTTING = 1.5  # steepest slope of the terrain beside a bridge, so that no cliff at its end covers its deck
BELOW_ROAD = 0.3  # metres between the road and the terrain below it, because the road is a separate mesh


@dataclass(frozen=True, eq=False)
class Terrain:
    """Heights and ground colours on a grid.

    Attributes:
        west, south: x and y of the first point, metres.
        heights: rows x columns, metres; rows run from south to north, columns from west to east.
        colours: rows x columns x 3, RGB, 0..255.
        beyond: distance from the road's edge, rows x columns, metres; negative on the road.
        square_sizes: of the square of cells that each cell is drawn with, see `detail`; rows - 1 x columns - 1.
    """

    west: float
    south: float
    heights: Floats
    colours: Floats
    beyond: Floats
    square_sizes: Sizes

    @property
    def grid(self) -> Floats:
        """Positions (x, y) of the points: rows x columns x 2, metres."""
        rows, columns = self.heights.shape
        return np.dstack(np.meshgrid(self.west + CELL * np.arange(columns), self.south + CELL * np.arange(rows)))

    @property
    def corner(self) -> Floats:
        """Southwestern corner (x, y), metres."""
        return np.array([self.west, self.south])

    @property
    def size(self) -> Floats:
        """Extent (east, north), metres."""
        rows, columns = self.heights.shape
        return CELL * np.array([columns - 1, rows - 1])

    def sample(self, field: Floats, points: Floats) -> Floats:
        """Interpolate a field (rows x columns) bilinearly at points (n x 2, metres)."""
        columns = ((points[:, 0] - self.west) / CELL).astype(np.float32)
        rows = ((points[:, 1] - self.south) / CELL).astype(np.float32)
        sampled = cv2.remap(
            field.astype(np.float32), columns[None], rows[None], cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE
        )
        return np.asarray(sampled[0], float)


def make_terrain(course: Course) -> Terrain:
    """Generate the terrain of a course; deterministic."""
    low = course.track.points[:, :2].min(0) - MARGIN
    extent = course.track.points[:, :2].max(0) + MARGIN - low
    shape = LARGEST * np.ceil(extent / CELL / LARGEST).astype(int) + 1
    east, north = np.meshgrid(low[0] + CELL * np.arange(shape[0]), low[1] + CELL * np.arange(shape[1]))
    random = np.random.default_rng([course.seed, 1])
    points = np.stack([east, north], axis=-1)
    near = Nearest(course, points, ~course.on_bridge())
    sizes = square_sizes(_distance_from_road(course, low, near.beyond.shape))
    heights = flattened(np.minimum(_heights(course, near, random), below_bridges(course, points)), sizes)
    colours = _colours(course, near, heights, random)
    return Terrain(float(low[0]), float(low[1]), heights, colours, near.beyond, sizes)


class Nearest:
    """The nearest point of a part of the road, such as that on the ground, for each of an array of points.

    Attributes:
        distance: from the road's centre line, metres.
        beyond: distance from the road's edge, metres; negative on the road.
        road: height of the road at its nearest point, metres.
    """

    def __init__(self, course: Course, points: Floats, part: NDArray[np.bool_]) -> None:
        """Find the nearest points of a part of the road (mask of the track's points) for points (... x 2, metres)."""
        self._course, track = course, course.track
        indices = np.flatnonzero(part)
        self.distance, nearest = KDTree(track.points[indices, :2]).query(points)
        self._index = indices[nearest]
        heading = track.headings[self._index]
        away = points - track.points[self._index, :2]
        self._right: NDArray[np.bool_] = away[..., 0] * np.cos(heading) - away[..., 1] * np.sin(heading) > 0
        self.beyond = self.distance - track.half_widths[self._index]
        self.road = track.points[self._index, 2]

    def weight(self, kind: Roadside) -> Floats:
        """Return the weight (0..1) of a kind of roadside at each point."""
        left, right = self._course.weight(kind, -1), self._course.weight(kind, 1)
        return np.asarray(np.where(self._right, right[self._index], left[self._index]))

    def section_weight(self, section: RoadsideSection) -> Floats:
        """Return the weight (0..1) of a section of the roadside at each point."""
        own_side = True if section.side == 0 else self._right == (section.side > 0)
        return np.asarray(self._course.section_weight(section)[self._index] * own_side)


def _heights(course: Course, near: Nearest, random: np.random.Generator) -> Floats:
    rows, columns = near.beyond.shape
    rolling = smooth_noise(random, rows, columns, 5) + 0.5
    heights = near.road + course.look.relief * rolling * _smoothstep(near.beyond, 8, 60)
    uneven = 1 + 0.35 * smooth_noise(random, rows, columns, 14, 2)
    for section in course.roadside:
        if shape := section.terrain:
            start = max(shape.distance, LEVEL_BESIDE)
            rise = shape.rise * _smoothstep(near.beyond, start, start + shape.width)
            heights += near.section_weight(section) * uneven * rise
    # smooths the step halfway between two parts of the road, where the nearest one changes
    soft = cv2.GaussianBlur(heights, (0, 0), 3.0)
    heights += (soft - heights) * _smoothstep(near.beyond, 6, 25)
    return np.asarray(np.where(near.beyond < LEVEL_BESIDE, np.minimum(heights, near.road) - BELOW_ROAD, heights))


def _distance_from_road(course: Course, low: Floats, shape: tuple[int, ...]) -> Floats:
    """Return the distance (metres, to about a cell) of the grid's points from the road, on the ground or on bridges."""
    free = np.ones(shape, np.uint8)
    columns, rows = np.round((course.track.points[:, :2] - low) / CELL).astype(int).T
    free[rows, columns] = 0
    return np.asarray(CELL * cv2.distanceTransform(free, cv2.DIST_L2, 5), float)


def below_bridges(course: Course, points: Floats) -> Floats:
    """Return the greatest height at points (... x 2, metres) that leaves the decks of bridges clear."""
    bridges = course.on_bridge()
    if not bridges.any():
        return np.full(points.shape[:-1], np.inf)
    near = Nearest(course, points, bridges)
    return np.asarray(near.road - BELOW_ROAD + CUTTING * np.maximum(near.beyond - LEVEL_BESIDE, 0.0))


def _colours(course: Course, near: Nearest, heights: Floats, random: np.random.Generator) -> Floats:
    rows, columns = heights.shape
    look = course.look
    grass, dry, rock = (np.array(colour, float) for colour in (look.grass, look.dry, look.rock))
    patches = _smoothstep(smooth_noise(random, rows, columns, 24), -0.2, 0.8)[..., None]
    colours = grass + (dry - grass) * patches
    bare = near.weight("dirt") * _smoothstep(-near.beyond, -26, -14)
    colours += (np.array(DIRT) - colours) * bare[..., None]
    down, across = np.gradient(heights, CELL)
    steep = _smoothstep(np.hypot(down, across), 0.35, 0.8)
    colours += (rock - colours) * steep[..., None]
    if course.water is not None:
        shore = _smoothstep(-heights, -course.water - 1.2, -course.water)
        colours += (np.array([196, 178, 136]) - colours) * shore[..., None]
    return np.asarray((colours * (1 + 0.12 * smooth_noise(random, rows, columns, 50, 2))[..., None]).clip(0, 255))


def _smoothstep(value: Floats, start: float, end: float) -> Floats:
    part = ((value - start) / (end - start)).clip(0, 1)
    return np.asarray(part * part * (3 - 2 * part))
