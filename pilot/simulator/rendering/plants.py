"""Placement and meshes of plants and of sign posts beside the road."""

from dataclasses import dataclass

import numpy as np

from pilot.arrays import Floats
from pilot.simulator.course import Course, Plant
from pilot.simulator.rendering.mesh import Mesh
from pilot.simulator.rendering.terrain import CELL, Nearest, Terrain, below_bridges

BUSHES_WITHIN = 40.0  # metres from the road's edge; farther away they are too small to be seen
CLEAR = 2.0  # metres, minimum distance of plants from the road's edge
TALLEST = 1.5  # approximate largest height of a plant, as a multiple of its kind's
# texture coordinates of a plant: not up to the borders, where interpolation would mix in the opposite border
INSIDE = np.array([[0.01, 0.01], [0.99, 0.01], [0.99, 0.98], [0.01, 0.98]])
SIZES: dict[Plant, tuple[float, float, float]] = {
    "pine": (4.0, 5.5, 11.0),
    "palm": (4.5, 6.0, 9.0),
    "boulder": (1.2, 2.5, 2.2),
    "bush": (3.0, 1.6, 0.9),
}
"""Minimum distance from the road's edge, width and height, metres; width and height vary by about a third."""


@dataclass(frozen=True, eq=False)
class Plants:
    """Plants or boulders of one kind.

    Attributes:
        kind: of the plants.
        points: positions, n x 3, metres.
        widths, heights: n, metres.
        angles: rotations about the vertical axis, n, radians.
        shades: brightness factors, n.
    """

    kind: Plant
    points: Floats
    widths: Floats
    heights: Floats
    angles: Floats
    shades: Floats


def grow_plants(course: Course, terrain: Terrain) -> list[Plants]:
    """Place trees or boulders, and bushes, at random: denser near the road and in groves, none on it or in water."""
    trees = _grow(course, terrain, course.look.tree, course.look.trees, stream=3)
    return [trees, _grow(course, terrain, "bush", course.look.bushes, stream=4)] if course.look.bushes else [trees]


def _grow(course: Course, terrain: Terrain, kind: Plant, per_hectare: float, stream: int) -> Plants:
    random = np.random.default_rng([course.seed, stream])
    margin, width, height = SIZES[kind]
    area = terrain.heights.size * CELL**2
    trials = terrain.corner + terrain.size * random.uniform(0, 1, (int(4 * per_hectare * area / 1e4), 2))
    near = Nearest(course, trials, ~course.on_bridge())
    beyond = terrain.sample(terrain.beyond, trials)
    chance = np.where(beyond < 14, 0.6, 0.28) + 0.6 * near.weight("grove") * (near.distance < 60) * (beyond < 40)
    stands = (beyond > max(margin - course.look.verge, CLEAR)) & (random.uniform(size=len(trials)) < chance)
    ground = terrain.sample(terrain.heights, trials)
    stands &= below_bridges(course, trials) - ground > TALLEST * height
    if kind == "bush":
        stands &= beyond < BUSHES_WITHIN
    if course.water is not None:
        stands &= ground > course.water + 0.6
    places = trials[stands]
    count = len(places)
    points = np.column_stack([places, ground[stands] - 0.15])
    scale = random.uniform(0.67, 1.33, count)
    return Plants(
        kind,
        points,
        width * scale,
        height * scale * random.uniform(0.85, 1.15, count),
        random.uniform(0, np.pi, count),
        random.uniform(0.7, 1.0, count),
    )


def plant_mesh(plants: Plants, shine: Floats) -> Mesh:
    """Create the mesh of the plants: two crossed vertical quads per plant.

    Args:
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
    return Mesh(plants.kind, corners, np.concatenate([colours, colours]), texels)
