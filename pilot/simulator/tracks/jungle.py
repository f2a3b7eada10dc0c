"""The track `jungle`: the road of the Unity simulator's second track, as measured in its published scene."""

import math

from pilot.simulator.course import Course, Look, RoadsideSection, Shape
from pilot.simulator.road_pieces import laid_out_road, parse_layout
from pilot.simulator.track import Track

NUMBER = 2
HALF_WIDTH, LANE = 4.6, 2.3  # metres
LAYOUT = """
    R20 R20 r+ 5S l- r 4S l L10 L20+ R20- L20+ L10 L10 R10 R10 S R20- l- L20+ L20- S r- l- S l r+ S L20+ S L20 R20+ 4S
    r+ R20 2S r R20+ R20+ S R10 L10 L10 r L20 R20 2S L20- R20- r- r- S r+ l+ R20+ R20 5S r- S L10 L10 r-
"""
ENTRY = (56.0, -64.0, -80.0)  # x, y, z of the first piece, metres
START = 773.5  # metres from the first piece to the start line
LAND = [
    ("cliff", 0, 82, -1, 15, 8, 8),
    ("drop", 0, 50, 1, -10, 6, 22),
    ("drop", 50, 70, 1, -5, 1, 2),
    ("drop", 70, 94, 1, -5, 8, 4),
    ("cliff", 82, 106, -1, 15, 18, 8),
    ("drop", 94, 224, 1, -5, 3, 4),
    ("cliff", 106, 170, -1, 20, 12, 14),
    ("hill", 170, 186, -1, 15, 2, 22),
    ("cliff", 186, 210, -1, 15, 3, 14),
    ("hill", 210, 316, -1, 3, 1, 14),
    ("drop", 224, 304, 1, -15, 4, 1),
    ("hill", 304, 362, 1, 1.5, 4, 22),
    ("cliff", 316, 350, -1, 20, 2, 14),
    ("hill", 350, 374, -1, 15, 1, 22),
    ("drop", 362, 404, 1, -10, 1, 4),
    ("cliff", 374, 430, -1, 20, 1, 22),
    ("drop", 404, 438, 1, -5, 1, 4),
    ("drop", 430, 450, -1, -5, 1, 4),
    ("drop", 438, 454, 1, -15, 2, 8),
    ("cliff", 450, 500, -1, 20, 15, 1),
    ("drop", 454, 498, 1, -10, 4, 1),
    ("bank", 498, 552, 1, -3, 1, 8),
    ("drop", 500, 516, -1, -5, 1, 4),
    ("cliff", 516, 538, -1, 20, 1, 8),
    ("cliff", 538, 576, -1, 20, 4, 14),
    ("drop", 552, 606, 1, -7, 8, 8),
    ("cliff", 576, 598, -1, 10, 1, 8),
    ("hill", 598, 618, -1, 10, 3, 14),
    ("drop", 606, 644, 1, -10, 4, 1),
    ("bank", 618, 740, -1, -1.5, 1, 22),
    ("drop", 644, 670, 1, -5, 1, 4),
    ("drop", 670, 692, 1, -20, 1, 4),
    ("drop", 692, 720, 1, -20, 2, 8),
    ("hill", 720, 802, 1, 1.5, 10, 22),
    ("cliff", 740, 764, -1, 20, 1, 8),
    ("cliff", 764, 780, -1, 20, 8, 14),
    ("drop", 780, 798, -1, -15, 12, 1),
    ("drop", 798, 850, -1, -20, 1, 1),
    ("drop", 802, 862, 1, -20, 1, 1),
    ("drop", 850, 874, -1, -15, 1, 22),
    ("drop", 862, 950, 1, -7, 6, 22),
    ("cliff", 874, 938, -1, 5, 5, 2),
    ("cliff", 938, 962, -1, 5, 8, 4),
    ("cliff", 950, 972, 1, 5, 1, 4),
    ("cliff", 962, 1134, -1, 5, 22, 2),
    ("cliff", 972, 1004, 1, 20, 6, 14),
    ("hill", 1004, 1042, 1, 15, 10, 22),
    ("cliff", 1042, 1082, 1, 15, 8, 14),
    ("drop", 1082, 1102, 1, -5, 1, 2),
    ("cliff", 1102, 1236, 1, 20, 15, 1),
    ("cliff", 1134, 1156, -1, 20, 1, 8),
    ("bank", 1156, 1176, -1, -1.5, 4, 22),
    ("drop", 1176, 1192, -1, -15, 1, 14),
    ("drop", 1192, 1214, -1, -10, 15, 1),
    ("bank", 1214, 1254, -1, -3, 2, 4),
    ("cliff", 1236, 1268, 1, 20, 6, 4),
    ("cliff", 1268, 1298, 1, 20, 12, 2),
    ("drop", 1272, 1292, -1, -7, 2, 4),
    ("drop", 1292, 1312, -1, -5, 1, 8),
    ("drop", 1298, 1312, 1, -3, 1, 2),
    ("hill", 1312, 1364, -1, 15, 10, 22),
    ("hill", 1312, 1342, 1, 1.5, 15, 22),
    ("drop", 1342, 1494, 1, -5, 1, 8),
    ("drop", 1364, 1402, -1, -5, 10, 2),
    ("drop", 1402, 1422, -1, -10, 1, 14),
    ("drop", 1422, 1494, -1, -10, 15, 1),
]  # kind, from, to (metres along the track), side, rise, distance from the road's edge, width (metres)
BRIDGE = (801, 849)  # metres along the track
SIGNS = [
    (227, 308, 1),
    (366, 382, 1),
    (419, 435, 1),
    (423, 463, -1),
    (439, 477, 1),
    (671, 687, 1),
    (804, 853, 0),
    (1081, 1097, 1),
    (1116, 1132, -1),
    (1160, 1176, -1),
]  # from, to (metres along the track), side


def course() -> Course:
    """Create the course: hills, hairpin bends, two lanes of which the car uses the right one, cliffs, an overpass."""
    look = Look(
        asphalt=(168, 166, 160),
        grain="tarmac",
        edge_line=(236, 236, 232),
        middle_line=(236, 236, 232),
        paint_inside=0.05,
        paint_width=0.24,
        shoulder=None,
        kerbs=False,
        grass=(104, 112, 58),
        dry=(116, 112, 72),
        rock=(104, 106, 86),
        tree="palm",
        trees=34,
        relief=14,
        verge=1.5,
        deck="road",
    )
    roadside = (
        *(RoadsideSection(kind, start, end, side, Shape(*shape)) for kind, start, end, side, *shape in LAND),
        *(RoadsideSection("signs", *section) for section in SIGNS),
        RoadsideSection("bridge", *BRIDGE),
    )
    return Course(_track(), look, "clear", roadside, seed=2)


def _track() -> Track:
    return laid_out_road("jungle", parse_layout(LAYOUT), ENTRY, -math.pi / 2, HALF_WIDTH, lane=LANE, start=START)
