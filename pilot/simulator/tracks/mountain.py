"""The track `mountain`, modelled loosely on the mountain track of an older version of the Unity simulator."""

import numpy as np

from pilot.simulator.course import Course, Look, RoadsideSection
from pilot.simulator.track import closed_road, validated

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
LOOK = Look(
    asphalt=(104, 102, 104),
    grain="tarmac",
    edge_line=None,
    shoulder=(138, 126, 108),
    kerbs=False,
    grass=(92, 86, 56),
    dry=(112, 96, 70),
    rock=(112, 104, 96),
    tree="boulder",
    trees=60.0,
    relief=14.0,
    verge=2.5,
)


def course() -> Course:
    """Create the course: a dark, narrow road with rocks at its edge."""
    roadside = (
        RoadsideSection("cliff", 25, 169, 1),
        RoadsideSection("drop", 68, 186, -1),
        RoadsideSection("cliff", 220, 338, -1),
        RoadsideSection("drop", 236, 321, 1),
        RoadsideSection("cliff", 372, 507, 1),
        RoadsideSection("hill", 372, 473, -1),
        RoadsideSection("cliff", 524, 608, -1),
        RoadsideSection("drop", 540, 676, 1),
        RoadsideSection("cliff", 709, 811, 1),
    )
    return Course(validated(closed_road("mountain", np.array(CORNERS, float), 3.6)), LOOK, "overcast", roadside, seed=3)
