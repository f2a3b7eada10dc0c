"""The courses by name: lake, jungle, mountain, and random:SEED, any number of them."""

import functools
from dataclasses import replace

import numpy as np

from pilot.simulator.course import LIGHTS, Colour, Course, Grain, Look, Plant, Roadside, RoadsideSection
from pilot.simulator.track import REVERSED, Array, Track, closed_road

NAMED = ("lake", "jungle", "mountain")

LAKE = [
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
]
JUNGLE = [
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
]
MOUNTAIN = [
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
]


@functools.lru_cache(32)
def load_course(name: str) -> Course:
    """A course by name: lake, jungle, mountain or random:SEED (SEED a whole number from 0).

    Raises:
        ValueError: there is none of that name.
    """
    builders = {"lake": lake, "jungle": jungle, "mountain": mountain}
    if name in builders:
        return builders[name]()
    kind, _, seed = name.partition(":")
    if kind == "random" and seed.isdecimal():
        return random_course(int(seed))
    raise ValueError(f"track {name!r}: there are {', '.join(NAMED)} and random:SEED, such as random:7")


def load_track(name: str) -> Track:
    """The road of a course, in the direction of driving: with " reversed" behind its name, the other way round.

    Raises:
        ValueError: there is none of that name.
    """
    track = load_course(name.removesuffix(REVERSED)).track
    return track.reversed() if name.endswith(REVERSED) else track


def lake() -> Course:
    """After the simulator's first track: wide bends round a lake, one sharp left and one sharp right, a bridge."""
    corners = np.array(LAKE, float) * (1.155, 1.155, 1)
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


def jungle() -> Course:
    """After the second track: hills, hairpins, two lanes, hard shadows, cliffs; the car keeps to the right."""
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
    return Course(closed_road("jungle", np.array(JUNGLE, float), 4.8, lane=2.3), look, "noon", roadside, seed=2)


def mountain() -> Course:
    """After the older simulator's track: dark, narrow, rocks at the edge."""
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
    return Course(closed_road("mountain", np.array(MOUNTAIN, float), 3.6), look, "overcast", roadside, seed=3)


# Random courses

PAINTS: tuple[Colour | None, ...] = ((205, 180, 60), (230, 230, 226), None)
GROUNDS: tuple[Colour, ...] = ((122, 120, 46), (78, 104, 38), (150, 128, 84), (90, 86, 60))
GRAINS: tuple[Grain, ...] = ("asphalt", "tarmac")
TREES: tuple[Plant, ...] = ("pine", "palm", "boulder")
NARROWEST_LANES = 4.3  # metres from the middle line to the edge
SIDES: tuple[Roadside, ...] = ("hill", "cliff", "drop", "dirt", "grove")


def random_course(seed: int) -> Course:
    """A course that nobody has seen: another road, width, paint, land and light for each seed."""
    random = np.random.default_rng([0x70AD, seed])
    track = _random_track(f"random:{seed}", random)
    look = _random_look(random)
    if look.middle_line:  # two lanes, if there is room for them
        wide = track.half_widths.min() > NARROWEST_LANES
        track, look = (replace(track, lane=2.2), look) if wide else (track, replace(look, middle_line=None))
    light = str(random.choice(list(LIGHTS)))
    return Course(track, look, light, _random_roadside(random), seed=1000 + seed)


def _random_track(name: str, random: np.random.Generator) -> Track:
    while True:  # until one is well formed, which takes a few trials
        half_width = random.uniform(3.4, 5.0)
        try:
            return closed_road(name, _random_corners(random), half_width)
        except ValueError:
            continue


def _random_corners(random: np.random.Generator) -> Array:
    """Corners around a circle, so that the road cannot cross itself, and hills that a car can climb."""
    count = int(random.integers(12, 20))
    angles = 2 * np.pi * (np.arange(count) + random.uniform(-0.2, 0.2, count)) / count
    harmonics = np.arange(2, 6)
    waves = np.cos(np.outer(harmonics, angles) + random.uniform(0, 6.28, (4, 1)))
    shape = (random.normal(0, 0.5, 4) / harmonics) @ waves
    radius = random.uniform(100, 150) * (1 + shape + random.uniform(-0.18, 0.18, count)).clip(0.35)
    heights = sum(random.uniform(-5, 5) / k * np.cos(k * angles + random.uniform(0, 6.28)) for k in (1, 2, 3))
    direction = random.choice([-1, 1])
    return np.column_stack([radius * np.cos(angles), radius * np.sin(angles), heights])[::direction]


def _random_look(random: np.random.Generator) -> Look:
    grey = (np.array([118, 116, 113]) * random.uniform(0.75, 1.2) + random.uniform(-6, 6, 3)).clip(60, 190)
    ground = np.array(GROUNDS[random.integers(len(GROUNDS))]) * random.uniform(0.8, 1.2, 3)
    edge = PAINTS[random.integers(len(PAINTS))]
    return Look(
        asphalt=_colour(grey),
        grain=GRAINS[random.integers(len(GRAINS))],
        edge_line=edge,
        middle_line=PAINTS[random.integers(len(PAINTS))],
        paint_inside=float(random.uniform(0.1, 0.8)),
        shoulder=Look.shoulder if edge is None or random.uniform() < 0.5 else None,
        kerbs=bool(random.uniform() < 0.5),
        grass=_colour(ground),
        dry=_colour(ground * random.uniform(0.7, 1.3, 3)),
        rock=_colour(np.array([140, 132, 118]) * random.uniform(0.6, 1.1)),
        tree=TREES[random.integers(len(TREES))],
        trees=float(random.uniform(5, 50)),
        relief=float(random.uniform(2, 12)),
        verge=float(random.uniform(0, 2)),
    )


def _colour(values: Array) -> tuple[int, int, int]:
    red, green, blue = (int(value) for value in np.clip(values, 0, 255))
    return red, green, blue


def _random_roadside(random: np.random.Generator) -> tuple[RoadsideSection, ...]:
    roadside = []
    for side in (-1, 1):
        start = float(random.uniform(0, 0.1))
        while start < 0.9:
            length = float(random.uniform(0.04, 0.14))
            roadside.append(RoadsideSection(SIDES[random.integers(len(SIDES))], start, min(start + length, 0.98), side))
            start += length + float(random.uniform(0.02, 0.15))
    if random.uniform() < 0.5:
        start = float(random.uniform(0.1, 0.8))
        roadside.append(RoadsideSection("bridge", start, start + 0.05))
    return tuple(roadside)
