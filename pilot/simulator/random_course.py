"""Random courses: track, width, paint, terrain and light are generated from a seed."""

from dataclasses import replace

import numpy as np

from pilot.arrays import Floats
from pilot.simulator.course import LIGHTS, Colour, Course, Grain, Look, Plant, Roadside, RoadsideSection
from pilot.simulator.track import Track, closed_road

PAINTS: tuple[Colour | None, ...] = ((205, 180, 60), (230, 230, 226), None)
GROUNDS: tuple[Colour, ...] = ((122, 120, 46), (78, 104, 38), (150, 128, 84), (90, 86, 60))
GRAINS: tuple[Grain, ...] = ("asphalt", "tarmac")
TREES: tuple[Plant, ...] = ("pine", "palm", "boulder")
NARROWEST_LANES = 4.3  # metres, minimum half width of a road with two lanes
SIDES: tuple[Roadside, ...] = ("hill", "cliff", "drop", "dirt", "grove")


def random_course(seed: int) -> Course:
    """Generate a course from a seed; the same seed gives the same course."""
    random = np.random.default_rng([0x70AD, seed])
    track = _random_track(f"random:{seed}", random)
    look = _random_look(random)
    if look.middle_line:  # two lanes, if the road is wide enough
        wide = track.half_widths.min() > NARROWEST_LANES
        track, look = (replace(track, lane=2.2), look) if wide else (track, replace(look, middle_line=None))
    light = str(random.choice(list(LIGHTS)))
    return Course(track, look, light, _random_roadside(random), seed=1000 + seed)


def _random_track(name: str, random: np.random.Generator) -> Track:
    while True:  # until the geometry is valid, which takes a few attempts
        half_width = random.uniform(3.4, 5.0)
        try:
            return closed_road(name, _random_corners(random), half_width)
        except ValueError:
            continue


def _random_corners(random: np.random.Generator) -> Floats:
    """Return corners (n x 3, metres) around a circle, so that the road cannot cross itself, with gentle slopes."""
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


def _colour(values: Floats) -> tuple[int, int, int]:
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
