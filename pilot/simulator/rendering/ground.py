"""Meshes of the ground, the water and the plants, and the placement of the plants."""

from dataclasses import dataclass

import numpy as np

from pilot.arrays import Floats
from pilot.simulator.course import Course
from pilot.simulator.rendering.mesh import Mesh
from pilot.simulator.rendering.terrain import CELL, Nearest, Terrain
from pilot.simulator.rendering.textures import MEAN

TILE = 9.0  # metres that a tile of the ground's texture covers
CLEAR = 2.0  # metres, minimum distance of plants from the road's edge
WATER = (92, 116, 150)  # RGB
# texture coordinates of a plant: not up to the borders, where interpolation would mix in the opposite border
INSIDE = np.array([[0.01, 0.01], [0.99, 0.01], [0.99, 0.98], [0.01, 0.98]])
SIZES = {"pine": (4.0, 5.5, 11.0), "palm": (4.5, 6.0, 9.0), "boulder": (1.2, 2.5, 2.2)}
"""Minimum distance from the road's edge, width and height, metres; width and height vary by about a third."""


@dataclass(frozen=True, eq=False)
class Plants:
    """Trees or boulders.

    Attributes:
        points: positions, n x 3, metres.
        widths, heights: n, metres.
        angles: rotations about the vertical axis, n, radians.
        shades: brightness factors, n.
    """

    points: Floats
    widths: Floats
    heights: Floats
    angles: Floats
    shades: Floats


def ground_meshes(course: Course, terrain: Terrain) -> list[Mesh]:
    """Create the meshes of the ground and, if the course has a lake, of the water."""
    points = np.dstack([terrain.grid, terrain.heights])
    # quads completely below the road are never visible
    seen = _quads(terrain.beyond[..., None]).max(axis=(1, 2)) > -3.0
    corners = _quads(points)[seen]
    colours = _quads(terrain.colours / MEAN)[seen]
    ground = Mesh("ground", corners, colours, corners[:, :, :2] / TILE)
    return [ground] if course.water is None else [ground, _water(course.water, terrain)]


def _quads(grid: Floats) -> Floats:
    """Return the values of a grid (rows x columns x k) at the four corners of each cell: n x 4 x k."""
    cells = np.stack([grid[:-1, :-1], grid[:-1, 1:], grid[1:, 1:], grid[1:, :-1]], axis=2)
    return np.asarray(cells.reshape(-1, 4, grid.shape[2]))


def _water(level: float, terrain: Terrain) -> Mesh:
    low = _quads(terrain.heights[..., None]).min(axis=(1, 2)) < level
    corners = _quads(np.dstack([terrain.grid, np.full(terrain.heights.shape, level)]))[low]
    colours = np.broadcast_to(np.array(WATER, float) / MEAN, corners.shape)
    return Mesh("concrete", corners, colours, corners[:, :, :2] / 40.0)


def grow_plants(course: Course, terrain: Terrain) -> Plants:
    """Place trees or boulders at random: denser near the road and in groves, none close to the road or in the water."""
    random = np.random.default_rng([course.seed, 3])
    margin, width, height = SIZES[course.look.tree]
    area = terrain.heights.size * CELL**2
    trials = terrain.corner + terrain.size * random.uniform(0, 1, (int(4 * course.look.trees * area / 1e4), 2))
    near = Nearest(course, trials)
    beyond = terrain.sample(terrain.beyond, trials)
    chance = np.where(beyond < 14, 0.6, 0.28) + 0.6 * near.weight("grove") * (near.distance < 60) * (beyond < 40)
    stands = (beyond > max(margin - course.look.verge, CLEAR)) & (random.uniform(size=len(trials)) < chance)
    if course.water is not None:
        stands &= terrain.sample(terrain.heights, trials) > course.water + 0.6
    places = trials[stands]
    count = len(places)
    points = np.column_stack([places, terrain.sample(terrain.heights, places) - 0.15])
    scale = random.uniform(0.67, 1.33, count)
    return Plants(
        points,
        width * scale,
        height * scale * random.uniform(0.85, 1.15, count),
        random.uniform(0, np.pi, count),
        random.uniform(0.7, 1.0, count),
    )


def plant_mesh(course: Course, plants: Plants, shine: Floats) -> Mesh:
    """Create the mesh of the plants: two crossed vertical quads per plant.

    Args:
        course: of the plants.
        plants: to be drawn.
        shine: light on each plant, n x 3, 0..1.
    """
    crossed = []
    for turn in (0.0, np.pi / 2):
        aside = np.column_stack([np.cos(plants.angles + turn), np.sin(plants.angles + turn), 0 * plants.angles])
        aside *= plants.widths[:, None] / 2
        top = np.array([0, 0, 1]) * plants.heights[:, None]
        crossed.append(
            np.stack(
                [
                    plants.points - aside,
                    plants.points + aside,
                    plants.points + aside + top,
                    plants.points - aside + top,
                ],
                axis=1,
            )
        )
    corners = np.concatenate(crossed)
    colours = np.repeat(255 * (shine * plants.shades[:, None])[:, None], 4, axis=1)
    texels = np.broadcast_to(INSIDE, (len(corners), 4, 2))
    return Mesh(course.look.tree, corners, np.concatenate([colours, colours]), texels)
