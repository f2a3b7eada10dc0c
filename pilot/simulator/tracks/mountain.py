"""The track `mountain`, modelled loosely on the mountain track of an older version of the Unity simulator."""

import numpy as np

from pilot.simulator.course import Course, Look, RoadsideSection
from pilot.simulator.track import closed_road

NUMBER = 3
CORNERS = [
    (-20, -100, 0),
    (40, -108, 4),
    (96, -88, 10),
    (110, -40, 15),
    (76, -4, 18),
    (84, 44, 16),
    (120, 84, 12),
    (92, 124, 8),
    (36, 118, 5),
    (-6, 88, 4),
    (-44, 60, 7),
    (-92, 72, 11),
    (-128, 40, 13),
    (-116, -8, 10),
    (-76, -32, 6),
    (-74, -72, 2),
]  # x, y, z in metres


def course() -> Course:
    """Create the course: a dark, narrow road with rocks at its edge."""
    look = Look(
        asphalt=(104, 102, 104),
        grain="tarmac",
        edge_line=None,
        shoulder=(138, 126, 108),
        kerbs=False,
        grass=(92, 86, 56),
        dry=(112, 96, 70),
        rock=(112, 104, 96),
        tree="boulder",
        trees=60,
        relief=14,
        verge=2.5,
    )
    roadside = (
        RoadsideSection("cliff", 0.03, 0.2, 1),
        RoadsideSection("drop", 0.08, 0.22, -1),
        RoadsideSection("cliff", 0.26, 0.4, -1),
        RoadsideSection("drop", 0.28, 0.38, 1),
        RoadsideSection("cliff", 0.44, 0.6, 1),
        RoadsideSection("hill", 0.44, 0.56, -1),
        RoadsideSection("cliff", 0.62, 0.72, -1),
        RoadsideSection("drop", 0.64, 0.8, 1),
        RoadsideSection("cliff", 0.84, 0.96, 1),
    )
    return Course(closed_road("mountain", np.array(CORNERS, float), 3.6), look, "overcast", roadside, seed=3)
