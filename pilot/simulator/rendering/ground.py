"""Meshes of the ground and the water."""

import numpy as np

from pilot.simulator.course import Course
from pilot.simulator.rendering.detail import SIZES, corners_of_squares
from pilot.simulator.rendering.mesh import Mesh
from pilot.simulator.rendering.terrain import Terrain
from pilot.simulator.rendering.textures import MEAN

TILE = 9.0  # metres that a tile of the ground's texture covers
WATER = (190, 206, 212)  # RGB


def ground_meshes(course: Course, terrain: Terrain) -> list[Mesh]:
    """Create the meshes of the ground and, if the course has a lake, of the water."""
    meshes = []
    for size in (1, *SIZES):
        meshes.append(_ground(terrain, size))
        if course.water is not None:
            meshes.append(_water(course.water, terrain, size))
    return meshes


def _ground(terrain: Terrain, size: int) -> Mesh:
    """Create the mesh of the ground's squares of a size."""
    points = corners_of_squares(np.dstack([terrain.grid, terrain.heights]), terrain.square_sizes, size)
    colours = corners_of_squares(terrain.colours / MEAN["ground"], terrain.square_sizes, size)
    beyond = corners_of_squares(terrain.beyond[..., None], terrain.square_sizes, size)
    seen = beyond.max(axis=(1, 2)) > -2.5  # squares completely below the road are never visible
    return Mesh("ground", points[seen], colours[seen], points[seen][:, :, :2] / TILE)


def _water(level: float, terrain: Terrain, size: int) -> Mesh:
    """Create the mesh of the water's squares of a size."""
    points = corners_of_squares(np.dstack([terrain.grid, terrain.heights]), terrain.square_sizes, size)
    corners = points[points[..., 2].min(axis=1) < level]
    corners[..., 2] = level
    colours = np.broadcast_to(np.array(WATER, float) / MEAN["concrete"], corners.shape)
    return Mesh("concrete", corners, colours, corners[:, :, :2] / 40.0)
