"""Meshes of the road as adjacent strips: asphalt, paint, kerbs, shoulders and bridges."""

from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from pilot.arrays import Floats
from pilot.simulator.course import DIRT, Colour, Course, Roadside
from pilot.simulator.rendering.mesh import Mesh
from pilot.simulator.rendering.textures import MEAN
from pilot.simulator.track import STEP

Rows = NDArray[np.bool_]
Value = TypeVar("Value", bound=np.generic)

POINTS_PER_ROW = 3  # points of the track per row of quads: 1.5 m, the length of a kerb's stripe
DASH, DASH_PERIOD = 2, 6  # rows
TILE = {"asphalt": 4.0, "tarmac": 4.0, "cobbles": 3.0, "concrete": 3.0, "ground": 6.0}  # metres per tile of a texture
KERB_RADIUS = 50.0  # metres, maximum radius of bends with kerbs
PAINT_WIDTH = 0.16  # metres
RED, WHITE = (196, 60, 52), (226, 222, 214)
COBBLES, WALL, WALL_TOP = (158, 120, 108), (40, 40, 44), (70, 70, 76)


def road_meshes(course: Course) -> list[Mesh]:
    """Create the meshes of the road and of what borders on it."""
    strips = _Strips(course)
    _asphalt(strips)
    for side in (-1, 1):
        _edge(strips, side)
        _beside(strips, side)
        _wall(strips, side)
    return [mesh for mesh in strips.meshes if len(mesh.corners)]


class _Strips:
    """Builds strips of quads along a road.

    Attributes:
        count: number of rows of quads per lap.
        bridge: mask of the rows on a bridge.
        meshes: the strips built so far.
    """

    def __init__(self, course: Course) -> None:
        self.course, self.track, self.look = course, course.track, course.look
        self.count = len(self.track.points) // POINTS_PER_ROW
        self._points = (np.arange(self.count + 1) * len(self.track.points) / self.count).astype(int)
        self.bridge = self.rows(course.on_bridge())
        self.meshes: list[Mesh] = []

    def rows(self, values: NDArray[Value]) -> NDArray[Value]:
        """Select the values of the rows from values at the track's points."""
        return np.asarray(values[self._points[:-1]])

    def weight(self, kind: Roadside, side: int) -> Rows:
        """Return a mask of the rows with a kind of roadside on a side (-1, 1)."""
        return np.asarray(self.rows(self.course.weight(kind, side)) > 0.5)

    def lay(
        self,
        texture: str,
        left: Floats,
        right: Floats,
        *,
        colour: Floats | Colour,
        where: Rows,
        lift: tuple[float, float] = (0.0, 0.0),
    ) -> None:
        """Add a strip.

        Args:
            texture: of the surface, a key of TILE.
            left, right: lateral offsets of its borders at the track's points, metres.
            colour: RGB, 0..255; one, or one per row.
            where: mask of the rows that have the strip.
            lift: heights of the left and the right border above the road, metres.
        """
        first, last = self._border(left, lift[0]), self._border(right, lift[1])
        corners = np.stack([first[:-1], last[:-1], last[1:], first[1:]], axis=1)
        along = STEP * np.stack([self._points[:-1], self._points[:-1], self._points[1:], self._points[1:]], axis=1)
        ends = (left + lift[0])[self._points[:-1]], (right + lift[1])[self._points[:-1]]
        across = np.stack([ends[0], ends[1], ends[1], ends[0]], axis=1)
        colours = np.broadcast_to(np.asarray(colour, float) / MEAN, (self.count, 3))
        texels = np.stack([across, along], axis=2) / TILE[texture]
        self.meshes.append(Mesh(texture, corners[where], np.repeat(colours[where, None], 4, axis=1), texels[where]))

    def lay_beside(
        self,
        side: int,
        texture: str,
        inner: float,
        outer: float,
        *,
        colour: Floats | Colour,
        where: Rows,
        lift: tuple[float, float] = (0.0, 0.0),
    ) -> None:
        """Add a strip on a side (-1, 1), from `inner` to `outer` metres outside the road's edge; `lift` likewise."""
        near, far = side * (self.track.half_widths + inner), side * (self.track.half_widths + outer)
        if side > 0:
            self.lay(texture, near, far, colour=colour, where=where, lift=lift)
        else:
            self.lay(texture, far, near, colour=colour, where=where, lift=lift[::-1])

    def _border(self, offset: Floats, lift: float) -> Floats:
        border = self.track.beside(offset) + np.array([0, 0, lift])
        return np.asarray(border[self._points % len(border)])


def _asphalt(strips: _Strips) -> None:
    """Add the lanes with the dashed line between them, and the cobbles of bridges."""
    look, half = strips.look, strips.track.half_widths
    lanes = half - (look.paint_inside + PAINT_WIDTH if look.edge_line else 0)
    line = np.full(len(half), PAINT_WIDTH / 2)
    dashed = (np.arange(strips.count) % DASH_PERIOD < DASH)[:, None]
    middle = np.where(dashed, look.middle_line, look.asphalt) if look.middle_line else look.asphalt
    strips.lay(look.grain, -lanes, -line, colour=look.asphalt, where=~strips.bridge)
    strips.lay(look.grain, -line, line, colour=middle, where=~strips.bridge)
    strips.lay(look.grain, line, lanes, colour=look.asphalt, where=~strips.bridge)
    strips.lay("cobbles", -half, half, colour=COBBLES, where=strips.bridge)


def _edge(strips: _Strips, side: int) -> None:
    """Add the edge line, which is absent where the roadside is dirt."""
    look = strips.look
    if look.edge_line:
        paint = np.where(strips.weight("dirt", side)[:, None], look.asphalt, look.edge_line)
        inner, outer = -look.paint_inside - PAINT_WIDTH, -look.paint_inside
        strips.lay_beside(side, look.grain, inner, outer, colour=paint, where=~strips.bridge)
        strips.lay_beside(side, look.grain, outer, 0, colour=look.asphalt, where=~strips.bridge)


def _beside(strips: _Strips, side: int) -> None:
    """Add the kerb (in tight bends), shoulder, dirt or grass at the road's edge, and the slope down to the terrain."""
    look, land = strips.look, ~strips.bridge
    dirt = strips.weight("dirt", side) & land
    tight = np.abs(strips.rows(strips.track.curvatures)) > 1 / KERB_RADIUS
    kerb = tight & land & ~dirt & look.kerbs
    shoulder = land & ~dirt & ~kerb & (look.shoulder is not None)
    stripes = np.where((np.arange(strips.count) % 2 == 0)[:, None], RED, WHITE)
    ground = np.where(dirt[:, None], DIRT, look.grass)
    strips.lay_beside(side, "concrete", 0, 1.2, colour=stripes, where=kerb, lift=(0.0, 0.06))
    strips.lay_beside(side, "concrete", 0, 1.4, colour=look.shoulder or look.grass, where=shoulder)
    strips.lay_beside(side, "ground", 0, 1.4, colour=ground, where=land & ~kerb & ~shoulder)
    strips.lay_beside(side, "ground", 1.2, 4.5, colour=ground, where=land, lift=(0.0, -0.4))


def _wall(strips: _Strips, side: int) -> None:
    """Add the bridge's wall: its inner side, top and outer side."""
    for inner, outer, colour, lift in (
        (0.0, 0.001, WALL, (0.0, 0.8)),
        (0.0, 0.4, WALL_TOP, (0.8, 0.8)),
        (0.4, 0.401, WALL, (0.8, -2.5)),
    ):
        strips.lay_beside(side, "concrete", inner, outer, colour=colour, where=strips.bridge, lift=lift)
