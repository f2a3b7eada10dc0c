"""The track `jungle`, modelled loosely on the Unity simulator's second track."""

import numpy as np

from pilot.simulator.course import Course, Look, RoadsideSection
from pilot.simulator.track import closed_road

NUMBER = 2
CORNERS = [
    (0, -130, 0),
    (60, -132, 3),
    (118, -112, 8),
    (146, -60, 13),
    (128, -24, 16),
    (84, -34, 18),
    (44, -62, 20),
    (4, -56, 19),
    (2, -20, 17),
    (50, 0, 15),
    (104, 18, 12),
    (126, 56, 9),
    (96, 92, 8),
    (44, 80, 11),
    (0, 52, 15),
    (-40, 58, 18),
    (-48, 100, 16),
    (-92, 124, 12),
    (-138, 98, 8),
    (-132, 44, 10),
    (-88, 16, 13),
    (-52, -8, 13),
    (-60, -44, 10),
    (-104, -52, 6),
    (-130, -88, 2),
    (-96, -128, 0),
    (-50, -132, -1),
]  # x, y, z in metres


def course() -> Course:
    """Create the course: hills, hairpin bends, two lanes of which the car uses the right one, hard shadows, cliffs."""
    look = Look(
        asphalt=(136, 134, 132),
        grain="tarmac",
        edge_line=(232, 232, 228),
        middle_line=(232, 232, 228),
        shoulder=None,
        kerbs=False,
        grass=(78, 104, 38),
        dry=(100, 104, 54),
        rock=(112, 112, 88),
        tree="palm",
        trees=34,
        relief=10,
        verge=1.5,
    )
    roadside = (
        RoadsideSection("cliff", 0.04, 0.16, 1),
        RoadsideSection("drop", 0.06, 0.18, -1),
        RoadsideSection("cliff", 0.2, 0.28, -1),
        RoadsideSection("drop", 0.26, 0.36, 1),
        RoadsideSection("cliff", 0.33, 0.42, -1),
        RoadsideSection("hill", 0.42, 0.5, 1),
        RoadsideSection("grove", 0.45, 0.56, -1),
        RoadsideSection("cliff", 0.52, 0.6, 1),
        RoadsideSection("drop", 0.56, 0.64, -1),
        RoadsideSection("cliff", 0.66, 0.78, 1),
        RoadsideSection("grove", 0.7, 0.8, -1),
        RoadsideSection("cliff", 0.8, 0.88, -1),
        RoadsideSection("drop", 0.82, 0.9, 1),
        RoadsideSection("cliff", 0.93, 0.99, 1),
    )
    return Course(closed_road("jungle", np.array(CORNERS, float), 4.8, lane=2.3), look, "noon", roadside, seed=2)
