"""Meshes of the road as adjacent strips: asphalt, paint, kerbs, shoulders and bridges."""

import math
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from pilot.arrays import Floats
from pilot.simulator.course import DIRT, Colour, Course, Light, Roadside
from pilot.simulator.rendering.mesh import Mesh
from pilot.simulator.rendering.textures import MEAN
from pilot.simulator.track import CLEARANCE, STEP

Rows = NDArray[np.bool_]
Value = TypeVar("Value", bound=np.generic)

POINTS_PER_ROW = 3  # points of the track per row of quads: 1.5 m
TILE = {"asphalt": 4.0, "tarmac": 4.0, "cobbles": 3.0, "concrete": 3.0, "ground": 6.0, "paint": 3.0, "kerb": 0.6}
"""Metres per tile of a texture."""
KERB_RADIUS = 60.0  # metres, maximum radius of bends with kerbs
KERB_WIDTH = 1.2  # metres; kerbs lie between the edge line and the road's edge if there is room, else beside the road
BANK_WIDTH, BANK_RISE = 0.8, 0.25  # metres, of shoulders, which rise away from the road
COBBLES, WALL, WALL_TOP = (178, 156, 138), (22, 22, 26), (60, 60, 66)
DECK_SIDE, DECK_THICKNESS = (120, 118, 112), 1.2  # RGB, metres
SLOPE_ENDS = 4.5  # metres from the road's edge, where the slope down to the terrain ends
OWN_GROUND = 10.0  # metres along the road within which the nearest point of the road is still the same part of it


def road_meshes(course: Course, light: Light) -> tuple[list[Mesh], list[Mesh]]:
    """Create the meshes of the road and of what borders on it: those on the ground, and those of its bridges."""
    strips = _Strips(course, light)
    _asphalt(strips)
    for side in (-1, 1):
        _edge(strips, side)
        _beside(strips, side)
        _bridge(strips, side)
    _underside(strips)
    on_ground, on_bridges = ([mesh for mesh in meshes if len(mesh.corners)] for meshes in (strips.meshes, strips.decks))
    return on_ground, on_bridges


class _Strips:
    """Builds strips of quads along a road.

    Attributes:
        count: number of rows of quads per lap.
        bridge: mask of the rows on a bridge.
        cobbles: mask of the rows that are cobbled.
        meshes: the strips on the ground built so far.
        decks: the strips on bridges built so far.
    """

    def __init__(self, course: Course, light: Light) -> None:
        self.course, self.track, self.look, self._light = course, course.track, course.look, light
        self.count = len(self.track.points) // POINTS_PER_ROW
        self._points = (np.arange(self.count + 1) * len(self.track.points) / self.count).astype(int)
        self.bridge = self.rows(course.on_bridge())
        self.cobbles = self.bridge & (self.look.deck == "cobbles")
        self._room = {side: free_ground(course, side) for side in (-1, 1)}
        self.meshes: list[Mesh] = []
        self.decks: list[Mesh] = []

    def rows(self, values: NDArray[Value]) -> NDArray[Value]:
        """Select the values of the rows from values at the track's points."""
        return np.asarray(values[self._points[:-1]])

    def weight(self, kind: Roadside, side: int) -> Rows:
        """Return a mask of the rows with a kind of roadside on a side (-1, 1)."""
        return np.asarray(self.rows(self.course.weight(kind, side)) > 0.5)

    @property
    def kerbs_inside(self) -> bool:
        """Whether there is room for kerbs between the edge lines and the road's edges."""
        return self.look.edge_line is not None and self.look.paint_inside > KERB_WIDTH / 2

    def kerb(self, side: int) -> Rows:
        """Return a mask of the rows with a kerb on a side (-1, 1): those in tight bends."""
        tight = np.abs(self.rows(self.track.curvatures)) > 1 / KERB_RADIUS
        return np.asarray(tight & self.look.kerbs & ~self.bridge & ~self.weight("dirt", side))

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
        colours = np.broadcast_to(np.asarray(colour, float) / MEAN[texture], (self.count, 3))
        texels = np.stack([across, along], axis=2) / TILE[texture]
        for meshes, part in ((self.meshes, where & ~self.bridge), (self.decks, where & self.bridge)):
            meshes.append(Mesh(texture, corners[part], np.repeat(colours[part, None], 4, axis=1), texels[part]))

    def banked(self, side: int, colour: Floats | Colour) -> Floats:
        """Return the colours (RGB, one per row) of a bank on a side, lighter if it faces the sun than level ground."""
        east, north, up = self._light.direction
        headings = self.rows(self.track.headings)
        outwards = side * (np.cos(headings) * east - np.sin(headings) * north)
        slope = BANK_RISE / BANK_WIDTH
        facing = ((up - slope * outwards) / math.hypot(1, slope) / up).clip(0)[:, None]
        sun, ambient = np.array(self._light.sun), np.array(self._light.ambient)
        return np.asarray(np.asarray(colour, float) * (sun * facing + ambient) / (sun + ambient))

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
        """Add a strip on a side (-1, 1), from `inner` to `outer` metres outside the road's edge; `lift` likewise.

        It ends earlier where another part of the road, or the centre of a bend, is closer.
        """
        room = self._room[side]
        near, far = (side * (self.track.half_widths + np.minimum(end, room)) for end in (inner, outer))
        if side > 0:
            self.lay(texture, near, far, colour=colour, where=where, lift=lift)
        else:
            self.lay(texture, far, near, colour=colour, where=where, lift=lift[::-1])

    def _border(self, offset: Floats, lift: float) -> Floats:
        border = self.track.beside(offset) + np.array([0, 0, lift])
        return np.asarray(border[self._points % len(border)])


def free_ground(course: Course, side: int, most: float = SLOPE_ENDS) -> Floats:
    """Return the width (n, 0..`most` metres) of the ground on a side (-1, 1) that is nearest to each track point.

    It is limited by other parts of the road at about the same height, and by the centres of bends.
    """
    track = course.track
    room, is_free = np.zeros(len(track.points)), np.ones(len(track.points), bool)
    for beyond in np.arange(0.25, most + 0.01, 0.25):
        nearest = track.tree.query(track.beside(side * (track.half_widths + beyond))[:, :2])[1]
        along = np.abs(nearest - np.arange(len(track.points)))
        along = np.minimum(along, len(track.points) - along) * STEP
        level = np.abs(track.points[nearest, 2] - track.points[:, 2]) < CLEARANCE
        is_free &= ~((along > OWN_GROUND) & level)
        room[is_free] = beyond
    return room


def _asphalt(strips: _Strips) -> None:
    """Add the lanes with the dashed line between them, and the cobbles of bridges."""
    look, half = strips.look, strips.track.half_widths
    lanes = half - (look.paint_inside + look.paint_width if look.edge_line else 0)
    line = np.full(len(half), look.paint_width / 2)
    dashed = (np.arange(strips.count) % sum(look.dash) < look.dash[0]) & (look.middle_line is not None)
    for texture, colour, where in (("paint", look.middle_line, dashed), (look.grain, look.asphalt, ~dashed)):
        strips.lay(texture, -line, line, colour=colour or look.asphalt, where=where & ~strips.cobbles)
    strips.lay(look.grain, -lanes, -line, colour=look.asphalt, where=~strips.cobbles)
    strips.lay(look.grain, line, lanes, colour=look.asphalt, where=~strips.cobbles)
    strips.lay("cobbles", -half, half, colour=COBBLES, where=strips.cobbles)


def _edge(strips: _Strips, side: int) -> None:
    """Add the edge line, which is absent where the roadside is dirt, and the asphalt or kerb outside it."""
    look = strips.look
    if look.edge_line:
        inner, outer = -look.paint_inside - look.paint_width, -look.paint_inside
        dirt, kerb = strips.weight("dirt", side), strips.kerb(side) & strips.kerbs_inside
        for texture, colour, where in (("paint", look.edge_line, ~dirt), (look.grain, look.asphalt, dirt)):
            strips.lay_beside(side, texture, inner, outer, colour=colour, where=where & ~strips.cobbles)
        strips.lay_beside(side, "kerb", outer + 0.2, 0, colour=(255, 255, 255), where=kerb)
        strips.lay_beside(side, look.grain, outer, outer + 0.2, colour=look.asphalt, where=kerb)
        strips.lay_beside(side, look.grain, outer, 0, colour=look.asphalt, where=~kerb & ~strips.cobbles)


def _beside(strips: _Strips, side: int) -> None:
    """Add the kerb, shoulder, dirt or grass at the road's edge, and the slope down to the terrain."""
    look, land = strips.look, ~strips.bridge
    dirt = strips.weight("dirt", side) & land
    kerb = strips.kerb(side) & (not strips.kerbs_inside)
    shoulder = land & ~dirt & ~kerb & (look.shoulder is not None)
    ground = np.where(dirt[:, None], DIRT, look.grass)
    strips.lay_beside(side, "kerb", 0, BANK_WIDTH, colour=(255, 255, 255), where=kerb)
    bank = strips.banked(side, look.shoulder or look.grass)
    strips.lay_beside(side, "concrete", 0, BANK_WIDTH, colour=bank, where=shoulder, lift=(0.0, BANK_RISE))
    strips.lay_beside(side, "ground", 0, BANK_WIDTH, colour=ground, where=land & ~kerb & ~shoulder)
    for raised, height in ((shoulder, BANK_RISE), (land & ~shoulder, 0.0)):
        strips.lay_beside(side, "ground", BANK_WIDTH, SLOPE_ENDS, colour=ground, where=raised, lift=(height, -0.4))


def _bridge(strips: _Strips, side: int) -> None:
    """Add a bridge's wall (its inner side, top and outer side), or the side of its deck."""
    if strips.look.deck == "cobbles":
        faces = [
            (0.0, 0.001, WALL, (0.0, 0.8)),
            (0.0, 0.4, WALL_TOP, (0.8, 0.8)),
            (0.4, 0.401, WALL, (0.8, -2.5)),
        ]
    else:
        faces = [
            (0.0, 0.3, DECK_SIDE, (0.0, 0.0)),
            (0.3, 0.301, DECK_SIDE, (0.0, -DECK_THICKNESS)),
        ]
    for inner, outer, colour, lift in faces:
        strips.lay_beside(side, "concrete", inner, outer, colour=colour, where=strips.bridge, lift=lift)


def _underside(strips: _Strips) -> None:
    """Add the lower face of bridges, which faces down."""
    edge = strips.track.half_widths + 0.3
    depth = (-DECK_THICKNESS, -DECK_THICKNESS)
    strips.lay("concrete", edge, -edge, colour=WALL, where=strips.bridge, lift=depth)
