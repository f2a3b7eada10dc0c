"""Random courses: track, paint, terrain and light are generated from a seed."""

from collections.abc import Iterator
from dataclasses import fields, replace
from typing import Any

import numpy as np

from pilot.arrays import Floats
from pilot.simulator.course import LIGHTS, Course, Look, Roadside, RoadsideSection, Shape
from pilot.simulator.random_road import random_road
from pilot.simulator.track import STEP, Track, crossings
from pilot.simulator.tracks import jungle, lake, mountain

LOOKS = (lake.LOOK, jungle.LOOK, mountain.LOOK)
NARROWEST_LANES = 4.2  # metres, minimum half width of a road with two lanes
TINT = 0.07  # standard deviation of the factors of a colour's channels
BRIDGE_ENDS = 22.0  # metres from a crossing to the ends of the bridge
RISES: dict[Roadside, tuple[float, float]] = {  # height above the road, metres
    "hill": (3.0, 15.0),
    "cliff": (5.0, 26.0),
    "drop": (-20.0, -4.0),
    "bank": (-4.0, -1.0),
}
WIDTHS: dict[Roadside, tuple[float, float]] = {  # within which the rise is reached, metres
    "hill": (10.0, 30.0),
    "cliff": (1.0, 8.0),
    "drop": (1.0, 14.0),
    "bank": (2.0, 14.0),
}
FARTHEST = 16.0  # metres from the road's edge, where a rise begins at most
OTHERS: tuple[Roadside, ...] = ("dirt", "grove", "signs")


def random_course(seed: int) -> Course:
    """Generate a course from a seed; the same seed gives the same course."""
    random = np.random.default_rng([0x70AD, seed])
    track = random_road(f"random:{seed}", random)
    look = _random_look(random)
    if look.middle_line:  # two lanes, if the road is wide enough
        wide = track.half_widths.min() > NARROWEST_LANES
        track, look = (replace(track, lane=2.2), look) if wide else (track, replace(look, middle_line=None))
    roadside = (*_random_terrain(track.length, random), *_random_others(track.length, random), *_bridges(track))
    return Course(track, look, str(random.choice(list(LIGHTS))), roadside, seed=1000 + seed)


def _random_look(random: np.random.Generator) -> Look:
    """Return a mixture of two of LOOKS: colours and numbers in between, everything else from either."""
    first, second = (LOOKS[index] for index in random.integers(len(LOOKS), size=2))
    share = float(random.uniform())
    values = {}
    for name in (field.name for field in fields(Look)):
        one, other = getattr(first, name), getattr(second, name)
        values[name] = _between(one, other, share, random)
    return replace(Look(**values), kerbs=values["kerbs"] and values["edge_line"] is not None)


def _between(one: Any, other: Any, share: float, random: np.random.Generator) -> Any:
    """Return a value between two of the same attribute, with some variation."""
    if isinstance(one, float) and isinstance(other, float):
        return float((one + (other - one) * share) * random.uniform(0.8, 1.25))
    if isinstance(one, tuple) and isinstance(other, tuple) and len(one) == 3:
        mixed = np.array(one) + (np.array(other) - np.array(one)) * share
        return _colour(mixed * random.uniform(0.75, 1.3) * random.normal(1, TINT, 3))
    return one if random.uniform() < 1 - share else other


def _colour(values: Floats) -> tuple[int, int, int]:
    red, green, blue = (int(value) for value in np.clip(values, 0, 255))
    return red, green, blue


def _random_terrain(length: float, random: np.random.Generator) -> Iterator[RoadsideSection]:
    """Yield sections of hills, cliffs and slopes on both sides."""
    wildness = random.uniform(0.3, 1.0)  # share of the road that has them
    for side in (-1, 1):
        for start, end in _spans(length, (15.0, 80.0), wildness, random):
            kind = list(RISES)[random.integers(len(RISES))]
            shape = Shape(
                float(random.uniform(*RISES[kind])),
                float(FARTHEST * random.uniform() ** 2),
                float(random.uniform(*WIDTHS[kind])),
            )
            yield RoadsideSection(kind, start, end, side, shape)


def _random_others(length: float, random: np.random.Generator) -> Iterator[RoadsideSection]:
    """Yield sections of dirt without an edge line, groves, and boards on posts."""
    for side in (-1, 1):
        for start, end in _spans(length, (15.0, 50.0), 0.2, random):
            yield RoadsideSection(OTHERS[random.integers(len(OTHERS))], start, end, side)


def _spans(
    length: float, lengths: tuple[float, float], share: float, random: np.random.Generator
) -> Iterator[tuple[float, float]]:
    """Yield random parts (from, to; metres) of a road, which cover about a share of it."""
    mean = sum(lengths) / 2
    start = random.uniform(0, lengths[1])
    while (end := start + random.uniform(*lengths)) < length:
        yield start, end
        start = end + random.exponential(mean * (1 - share) / share)


def _bridges(track: Track) -> Iterator[RoadsideSection]:
    """Yield the bridges on which the road passes above itself."""
    for pair in crossings(track):
        upper = max(pair, key=lambda index: track.points[index, 2])
        start, end = upper * STEP - BRIDGE_ENDS, upper * STEP + BRIDGE_ENDS
        yield RoadsideSection("bridge", start % track.length, end % track.length)
