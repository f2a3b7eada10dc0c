"""The track `jungle`: the road of the Unity simulator's second track, as measured in its published scene."""

import math

from pilot.simulator.course import Course, Look, Roadside, RoadsideSection, Shape
from pilot.simulator.road_pieces import laid_out_road, parse_layout
from pilot.simulator.track import Track, validated

NUMBER = 2
HALF_WIDTH, LANE = 4.6, 2.3  # metres
LAYOUT = """
    R20 R20 r+ 5S l- r 4S l L10 L20+ R20- L20+ L10 L10 R10 R10 S R20- l- L20+ L20- S r- l- S l r+ S L20+ S L20 R20+ 4S
    r+ R20 2S r R20+ R20+ S R10 L10 L10 r L20 R20 2S L20- R20- r- r- S r+ l+ R20+ R20 5S r- S L10 L10 r-
"""
ENTRY = (56.0, -64.0, -80.0)  # x, y, z of the first piece, metres
START = 774.5  # metres from the first piece to the start line
TERRAIN: list[tuple[Roadside, float, float, int, float, float, float]] = [
    ("cliff", 0, 82, -1, 15, 8, 8),
    ("drop", 0, 94, 1, -15, 6, 14),
    ("cliff", 82, 106, -1, 15, 18, 8),
    ("drop", 94, 224, 1, -5, 3, 4),
    ("cliff", 106, 140, -1, 20, 12, 14),
    ("cliff", 140, 152, -1, 20, 4, 22),
    ("cliff", 152, 172, -1, 20, 10, 22),
    ("hill", 172, 210, -1, 15, 1, 22),
    ("hill", 210, 314, -1, 3, 1, 14),
    ("drop", 224, 252, 1, -15, 2, 4),
    ("drop", 252, 274, 1, -15, 5, 4),
    ("drop", 274, 302, 1, -15, 2, 4),
    ("hill", 302, 362, 1, 1.5, 4, 22),
    ("cliff", 314, 426, -1, 20, 1, 22),
    ("drop", 362, 374, 1, -20, 1, 4),
    ("drop", 374, 404, 1, -10, 1, 4),
    ("drop", 404, 438, 1, -5, 1, 4),
    ("cliff", 426, 448, -1, 20, 12, 14),
    ("drop", 438, 454, 1, -15, 2, 8),
    ("cliff", 448, 478, -1, 26, 15, 8),
    ("drop", 454, 498, 1, -10, 2, 4),
    ("cliff", 478, 500, -1, 20, 12, 4),
    ("bank", 498, 552, 1, -3, 1, 8),
    ("drop", 500, 514, -1, -5, 1, 4),
    ("cliff", 514, 520, -1, 15, 1, 14),
    ("cliff", 520, 536, -1, 26, 1, 8),
    ("cliff", 536, 576, -1, 26, 5, 14),
    ("drop", 552, 608, 1, -5, 8, 4),
    ("cliff", 576, 598, -1, 10, 1, 8),
    ("hill", 598, 616, -1, 10, 3, 14),
    ("drop", 608, 620, 1, -20, 2, 8),
    ("bank", 616, 726, -1, -1.5, 1, 22),
    ("drop", 620, 670, 1, -15, 1, 14),
    ("drop", 670, 694, 1, -20, 1, 4),
    ("drop", 694, 720, 1, -20, 2, 8),
    ("hill", 720, 802, 1, 1.5, 10, 22),
    ("cliff", 726, 766, -1, 20, 1, 8),
    ("cliff", 766, 780, -1, 20, 8, 14),
    ("drop", 780, 796, -1, -15, 10, 4),
    ("drop", 796, 810, -1, -20, 1, 8),
    ("drop", 802, 852, 1, -20, 1, 1),
    ("drop", 810, 850, -1, -20, 1, 1),
    ("drop", 850, 874, -1, -15, 1, 22),
    ("drop", 852, 864, 1, -20, 1, 8),
    ("drop", 864, 950, 1, -7, 6, 22),
    ("cliff", 874, 938, -1, 5, 5, 2),
    ("cliff", 938, 962, -1, 5, 8, 4),
    ("cliff", 950, 970, 1, 5, 1, 4),
    ("cliff", 962, 1134, -1, 5, 22, 2),
    ("cliff", 970, 1004, 1, 26, 5, 22),
    ("hill", 1004, 1042, 1, 15, 10, 22),
    ("cliff", 1042, 1082, 1, 15, 8, 14),
    ("drop", 1082, 1102, 1, -5, 1, 2),
    ("drop", 1102, 1192, 1, -5, 15, 4),
    ("cliff", 1134, 1156, -1, 32, 2, 8),
    ("bank", 1156, 1176, -1, -1.5, 5, 22),
    ("drop", 1176, 1194, -1, -15, 1, 14),
    ("cliff", 1192, 1234, 1, 20, 8, 14),
    ("bank", 1194, 1272, -1, -1.5, 1, 4),
    ("cliff", 1234, 1258, 1, 20, 6, 4),
    ("cliff", 1258, 1268, 1, 32, 3, 14),
    ("cliff", 1268, 1298, 1, 32, 12, 4),
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
LOOK = Look(
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
    trees=34.0,
    relief=24.0,
    verge=1.5,
    deck="road",
)


def course() -> Course:
    """Create the course: hills, hairpin bends, two lanes of which the car uses the right one, cliffs, an overpass."""
    roadside = (
        *(RoadsideSection(kind, start, end, side, Shape(*shape)) for kind, start, end, side, *shape in TERRAIN),
        *(RoadsideSection("signs", *section) for section in SIGNS),
        RoadsideSection("bridge", *BRIDGE),
    )
    return Course(_track(), LOOK, "clear", roadside, seed=2)


def _track() -> Track:
    pieces = parse_layout(LAYOUT)
    return validated(laid_out_road("jungle", pieces, ENTRY, -math.pi / 2, HALF_WIDTH, lane=LANE, start=START))
