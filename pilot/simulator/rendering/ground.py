"""Meshes of the ground and the water."""

import numpy as np

from pilot.arrays import Floats
from pilot.simulator.course import Course
from pilot.simulator.rendering.mesh import Mesh
from pilot.simulator.rendering.terrain import Terrain
from pilot.simulator.rendering.textures import MEAN

TILE = 9.0  # metres that a tile of the ground's texture covers
WATER = (190, 206, 212)  # RGB


def ground_meshes(course: Course, terrain: Terrain) -> list[Mesh]:
    """Create the meshes of the ground and, if the course has a lake, of the water."""
    points = np.dstack([terrain.grid, terrain.heights])
    # quads completely below the road are never visible
    seen = _quads(terrain.beyond[..., None]).max(axis=(1, 2)) > -2.5
    corners = _quads(points)[seen]
    colours = _quads(terrain.colours / MEAN["ground"])[seen]
    ground = Mesh("ground", corners, colours, corners[:, :, :2] / TILE)
    return [ground] if course.water is None else [ground, _water(course.water, terrain)]


def _quads(grid: Floats) -> Floats:
    """Return the values of a grid (rows x columns x k) at the four corners of each cell: n x 4 x k."""
    cells = np.stack([grid[:-1, :-1], grid[:-1, 1:], grid[1:, 1:], grid[1:, :-1]], axis=2)
    return np.asarray(cells.reshape(-1, 4, grid.shape[2]))


def _water(level: float, terrain: Terrain) -> Mesh:
    low = _quads(terrain.heights[..., None]).min(axis=(1, 2)) < level
    corners = _quads(np.dstack([terrain.grid, np.full(terrain.heights.shape, level)]))[low]
    colours = np.broadcast_to(np.array(WATER, float) / MEAN["concrete"], corners.shape)
    return Mesh("concrete", corners, colours, corners[:, :, :2] / 40.0)
