"""The terrain leaves the road visible."""

import pytest
from scipy.spatial import KDTree

from pilot.simulator.catalogue import load_course
from pilot.simulator.rendering.plants import grow_plants
from pilot.simulator.rendering.terrain import make_terrain

WITH_BRIDGES = ("lake", "jungle", "random:3000", "random:3014")


@pytest.mark.parametrize("name", WITH_BRIDGES)
def test_neither_terrain_nor_plants_cover_a_bridge(name: str) -> None:
    course = load_course(name)
    terrain = make_terrain(course)
    track, on_bridge = course.track, course.on_bridge()
    decks = track.points[on_bridge]
    assert len(decks)
    assert (terrain.sample(terrain.heights, decks[:, :2]) < decks[:, 2]).all()
    for plants in grow_plants(course, terrain):
        distances, nearest = KDTree(decks[:, :2]).query(plants.points[:, :2])
        over = distances < track.half_widths[on_bridge][nearest]
        assert (plants.points[over, 2] + plants.heights[over] < decks[nearest[over], 2]).all()
