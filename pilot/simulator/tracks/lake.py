"""The track `lake`, modelled loosely on the Unity simulator's first track."""

import numpy as np

from pilot.simulator.course import Course, Look, RoadsideSection
from pilot.simulator.track import closed_road

NUMBER = 1
CORNERS = [
    (-30, -118, 2),
    (40, -122, 2),
    (110, -108, 2.5),
    (158, -62, 3),
    (165, 0, 3),
    (142, 50, 2.4),
    (96, 72, 2),
    (56, 86, 3),
    (44, 126, 4),
    (12, 148, 5),
    (-40, 146, 4),
    (-96, 132, 2.5),
    (-144, 102, 2),
    (-162, 50, 2),
    (-152, 6, 3),
    (-156, -40, 3),
    (-118, -96, 2.4),
]  # x, y, z in metres


def course() -> Course:
    """Create the course: wide bends around a lake, one sharp left bend, one sharp right bend, and a bridge."""
    corners = np.array(CORNERS, float) * (1.155, 1.155, 1)
    roadside = (
        RoadsideSection("water", 0.06, 0.33, -1),
        RoadsideSection("hill", 0.02, 0.2, 1),
        RoadsideSection("cliff", 0.22, 0.29, 1),
        RoadsideSection("bridge", 0.53, 0.575),
        RoadsideSection("water", 0.515, 0.6),
        RoadsideSection("grove", 0.62, 0.72, 1),
        RoadsideSection("dirt", 0.425, 0.485, 1),
        RoadsideSection("dirt", 0.68, 0.74, -1),
        RoadsideSection("hill", 0.36, 0.43, 1),
        RoadsideSection("hill", 0.75, 0.88, 1),
        RoadsideSection("water", 0.8, 0.93, -1),
        RoadsideSection("cliff", 0.9, 0.95, 1),
    )
    return Course(closed_road("lake", corners, 4.8), Look(paint_inside=1.15, trees=26), "noon", roadside, 1, 1.0)
