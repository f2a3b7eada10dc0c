"""Random roads: closed lines with hairpins, S-bends, ramps, parts side by side and crossings, drawn from a generator.

A road is a polygon whose corners are rounded to arcs. It starts as a polygon around a centre; then detours are
inserted into its sides and loops at its corners.
"""

from dataclasses import dataclass, replace

import numpy as np

from pilot.arrays import Floats
from pilot.simulator.road_pieces import Piece, laid_out_road
from pilot.simulator.track import CLEARANCE, STEP, Track, closed_road, crossings, validated

SMALLEST_RADIUS = 8.0  # metres, of rounded corners
SHORTEST_SIDE = 45.0  # metres, of a polygon's side into which a detour is inserted
STEEPEST = 0.19  # rise over run
RISE_AT_CROSSING = CLEARANCE + 1.5  # metres between the two roads
LANES_FROM = 4.3  # metres, half width from which a road can have two lanes


@dataclass(frozen=True)
class Corner:
    """A corner of the polygon.

    Attributes:
        point: x, y in metres.
        radius: of the arc that rounds the corner, metres; it is smaller where the sides are short.
    """

    point: Floats
    radius: float


def random_road(name: str, random: np.random.Generator) -> Track:
    """Draw a road; the same state of the generator gives the same road."""
    gentle = random.uniform() < 0.35
    while True:  # until the road is valid, which takes a few attempts
        half_width = random.uniform(3.4, 5.0)
        try:
            track = _gentle_road(name, half_width, random) if gentle else _hard_road(name, half_width, random)
            return validated(_with_heights(track, random))
        except ValueError:
            continue


def _gentle_road(name: str, half_width: float, random: np.random.Generator) -> Track:
    """Return a smooth road around a centre, which cannot cross itself."""
    ring = _ring(random, int(random.integers(12, 20)))
    return closed_road(name, np.column_stack([ring, np.zeros(len(ring))]), half_width)


def _ring(random: np.random.Generator, count: int, low: float = 100.0, high: float = 150.0) -> Floats:
    """Return points (count x 2, metres) around the origin, in a random direction of rotation."""
    angles = 2 * np.pi * (np.arange(count) + random.uniform(-0.2, 0.2, count)) / count
    harmonics = np.arange(2, 6)
    waves = np.cos(np.outer(harmonics, angles) + random.uniform(0, 6.28, (4, 1)))
    shape = (random.normal(0, 0.5, 4) / harmonics) @ waves
    radius = random.uniform(low, high) * (1 + shape + random.uniform(-0.18, 0.18, count)).clip(0.35)
    return np.column_stack([radius * np.cos(angles), radius * np.sin(angles)])[:: random.choice([-1, 1])]


def _hard_road(name: str, half_width: float, random: np.random.Generator) -> Track:
    """Return a road with tight bends; at a loop it crosses itself, still at the same height."""
    tightest = random.uniform(SMALLEST_RADIUS, 18.0)
    points = _ring(random, int(random.integers(5, 9)), 80.0, 120.0)
    looped = int(random.integers(len(points))) if random.uniform() < 0.4 else None
    corners: list[Corner] = []
    for index, point in enumerate(points):
        following = points[(index + 1) % len(points)]
        if index == looped:
            corners += _loop(points[index - 1], point, following, tightest, random)
        else:
            corners.append(Corner(point, tightest * random.uniform(1.0, 3.0)))
        if np.linalg.norm(following - point) > SHORTEST_SIDE and random.uniform() < 0.6:
            corners += _detour(point, following, half_width, tightest, random)
    pieces, entry, heading = _rounded(corners)
    return laid_out_road(name, pieces, entry, heading, half_width)


def _loop(before: Floats, at: Floats, after: Floats, tightest: float, random: np.random.Generator) -> list[Corner]:
    """Return corners that turn the other way round, by a loop that crosses the road where the corner was."""
    ahead, onwards = (_unit(at - before), _unit(after - at))
    size = random.uniform(2.6, 4.0) * tightest
    return [
        Corner(at + size * ahead, tightest * 1.3),
        Corner(at + size * (ahead - onwards), tightest * 1.3),
        Corner(at - size * onwards, tightest * 1.3),
    ]


def _detour(
    start: Floats, end: Floats, half_width: float, tightest: float, random: np.random.Generator
) -> list[Corner]:
    """Return corners between two points: out and back over a hairpin, the same with a narrow neck, or an S-bend."""
    along = _unit(end - start)
    aside = np.array([along[1], -along[0]]) * random.choice([-1, 1])
    middle = start + (end - start) * random.uniform(0.35, 0.65)
    kind = random.choice(["hairpin", "neck", "shift"], p=[0.5, 0.2, 0.3])
    if kind == "shift":
        out = random.uniform(8, 16)
        places = [(-25.0, 0.0), (-8.0, out), (8.0, out), (25.0, 0.0)]
        return [Corner(middle + x * along + y * aside, tightest * random.uniform(1.0, 2.0)) for x, y in places]
    width = 2 * tightest * random.uniform(1.0, 1.2)
    depth = random.uniform(1.6, 5.0) * tightest
    neck = width if kind == "hairpin" else 2 * half_width + random.uniform(0.8, 4.0)
    places = [(-neck / 2, 0.0), (-width / 2, depth), (width / 2, depth), (neck / 2, 0.0)]
    if kind == "neck":
        places = [(-neck / 2, 0.0), (-neck / 2, depth), (-width / 2, depth + width), (-width / 2, depth + 2 * width)]
        places += [(-x, y) for x, y in reversed(places)]
    return [Corner(middle + x * along + y * aside, tightest * random.uniform(1.0, 1.6)) for x, y in places]


def _unit(vector: Floats) -> Floats:
    return np.asarray(vector / np.linalg.norm(vector))


def _rounded(corners: list[Corner]) -> tuple[list[Piece], tuple[float, float, float], float]:
    """Return the straights and arcs of a polygon with rounded corners, where they begin, and the first heading.

    Raises:
        ValueError: sides are too short for arcs of SMALLEST_RADIUS.
    """
    points = np.array([corner.point for corner in corners])
    sides = np.roll(points, -1, axis=0) - points
    lengths, headings = np.linalg.norm(sides, axis=1), np.arctan2(sides[:, 0], sides[:, 1])
    turns = (headings - np.roll(headings, 1) + np.pi) % (2 * np.pi) - np.pi
    tangents = np.abs(np.tan(turns / 2))
    room = np.minimum(lengths, np.roll(lengths, 1)) / 2 - 0.1
    radii = np.minimum([corner.radius for corner in corners], room / np.maximum(tangents, 1e-9))
    if radii.min() < SMALLEST_RADIUS:
        raise ValueError(f"a corner of {radii.min():.1f} m radius is too tight")
    ends = radii * tangents  # distance from the corner to the ends of its arc
    straights = lengths - ends - np.roll(ends, -1)
    pieces = []
    for index, straight in enumerate(straights):
        following = (index + 1) % len(corners)
        pieces.append(Piece("S", straight))
        pieces.append(Piece("R" if turns[following] > 0 else "L", radii[following], abs(turns[following])))
    entry = points[0] + ends[0] * sides[0] / lengths[0]
    return pieces, (float(entry[0]), float(entry[1]), 0.0), float(headings[0])


def _with_heights(track: Track, random: np.random.Generator) -> Track:
    """Return the track with hills, and with one of two crossing parts above the other.

    Raises:
        ValueError: a ramp to a crossing is too steep, or there are too many crossings.
    """
    count = len(track.points)
    along = 2 * np.pi * np.arange(count) / count
    waves = [random.normal() / k * np.cos(k * along + random.uniform(0, 6.28)) for k in range(1, 9)]
    heights = np.sum(waves, axis=0)
    steepest = float(np.abs(np.diff(heights)).max()) / STEP
    heights *= random.uniform(0.02, 0.15) / steepest
    for first, second in crossings(track):
        heights = _lifted(heights, first, second)
    slopes = np.abs(np.diff(heights, append=heights[:1])) / STEP
    if slopes.max() > STEEPEST:
        raise ValueError(f"{track.name}: a slope of {slopes.max():.2f} is too steep")
    return replace(track, points=np.column_stack([track.points[:, :2], heights]))


def _lifted(heights: Floats, first: int, second: int) -> Floats:
    """Return heights in which the points `first` and `second` are RISE_AT_CROSSING apart, by a bridge and a dip."""
    count = len(heights)
    apart = min(abs(first - second), count - abs(first - second))
    upper, lower = (first, second) if heights[first] > heights[second] else (second, first)
    missing = max(RISE_AT_CROSSING - (heights[upper] - heights[lower]), 0.0)
    steps = np.arange(count)
    for place, change in ((upper, missing / 2), (lower, -missing / 2)):
        away = np.abs(steps - place)
        away = np.minimum(away, count - away)
        part = (1 - (away - 16 / STEP).clip(0) / (apart / 2 - 16 / STEP)).clip(0, 1)
        heights = heights + change * part * part * (3 - 2 * part)
    return heights
