"""Courses: a track with its appearance, roadside and light."""

import math
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from pilot.arrays import Floats
from pilot.simulator.track import STEP, Track

Colour = tuple[int, int, int]  # RGB, 0..255
Grain = Literal["asphalt", "tarmac"]  # coarse, fine
Plant = Literal["pine", "palm", "boulder", "bush"]
Roadside = Literal["hill", "cliff", "drop", "bank", "water", "dirt", "bridge", "grove", "signs"]
Deck = Literal["cobbles", "road"]
DIRT: Colour = (176, 128, 78)
RAMP = 8.0  # metres of transition at each end of a section of the roadside


@dataclass(frozen=True)
class Shape:
    """Cross-section of the terrain beside the road.

    Attributes:
        rise: height reached above the road, metres; negative below it.
        distance: from the road's edge, at which the rise begins, metres.
        width: within which it is reached, metres.
    """

    rise: float
    distance: float
    width: float


SHAPES: dict[Roadside, Shape] = {
    "hill": Shape(7.0, 3.0, 32.0),
    "cliff": Shape(14.0, 3.0, 4.0),
    "drop": Shape(-10.0, 3.0, 8.0),
    "bank": Shape(-3.0, 4.0, 12.0),
    "water": Shape(-8.0, 10.0, 16.0),
    "grove": Shape(1.5, 3.0, 30.0),
}


@dataclass(frozen=True)
class RoadsideSection:
    """A section of the roadside; outside all sections there is level grass.

    Attributes:
        kind: of the roadside.
        start, end: metres along the track; a section whose end is smaller than its start contains the start line.
        side: -1 left, 1 right, 0 both, in the direction of the course's track.
        shape: of the terrain; None: the kind's in SHAPES, if it has one.
    """

    kind: Roadside
    start: float
    end: float
    side: int = 0
    shape: Shape | None = None

    @property
    def terrain(self) -> Shape | None:
        """Cross-section of the terrain; None: it stays level."""
        return self.shape or SHAPES.get(self.kind)


@dataclass(frozen=True)
class Look:
    """Colours (RGB, 0..255), textures and plants of a course."""

    asphalt: Colour = (118, 113, 108)
    grain: Grain = "asphalt"
    edge_line: Colour | None = (205, 180, 60)
    middle_line: Colour | None = None
    paint_inside: float = 0.25
    """Width of the asphalt between the edge line and the road's edge, metres."""
    paint_width: float = 0.16
    """Width of the lines, metres."""
    dash: tuple[int, int] = (2, 1)
    """Length of a dash of the middle line and of the gap after it, in rows of quads of 1.5 m."""
    shoulder: Colour | None = (214, 205, 186)
    kerbs: bool = True
    grass: Colour = (122, 120, 46)
    dry: Colour = (168, 132, 76)
    rock: Colour = (158, 148, 128)
    tree: Plant = "pine"
    trees: float = 16.0
    """Trees or boulders per hectare, approximately."""
    relief: float = 5.0
    """Scale of the terrain's height variation away from the road, metres."""
    bushes: float = 0.0
    """Bushes per hectare, approximately."""
    verge: float = 0.0
    """Reduction of the plants' minimum distance from the road's edge, metres."""
    deck: Deck = "cobbles"
    """Surface of bridges: cobbles between walls, or the road as it is, without walls."""


@dataclass(frozen=True)
class Light:
    """The sun's position and the colours of its light and of the sky.

    Attributes:
        azimuth: compass direction of the sun, degrees.
        elevation: of the sun above the horizon, degrees.
        sun, ambient: RGB factors of the direct and of the ambient light; their sum is about 1 at most.
        sky, horizon: colours of the sky at the top and at the horizon, RGB, 0..255.
        shadows: strength of the shadows, from 0 (none) to 1.
    """

    azimuth: float
    elevation: float
    sun: tuple[float, float, float]
    ambient: tuple[float, float, float]
    sky: Colour
    horizon: Colour
    shadows: float = 1.0

    @property
    def direction(self) -> tuple[float, float, float]:
        """Unit vector towards the sun: east, north, up."""
        azimuth, elevation = math.radians(self.azimuth), math.radians(self.elevation)
        level = math.cos(elevation)
        return math.sin(azimuth) * level, math.cos(azimuth) * level, math.sin(elevation)


LIGHTS = {
    "noon": Light(90, 42, (0.72, 0.67, 0.56), (0.28, 0.32, 0.40), (66, 100, 160), (186, 204, 222), 0.6),
    "clear": Light(150, 50, (0.72, 0.70, 0.65), (0.28, 0.30, 0.36), (60, 92, 158), (140, 170, 208)),
    "evening": Light(255, 16, (0.66, 0.47, 0.28), (0.30, 0.32, 0.42), (84, 96, 156), (236, 190, 150)),
    "overcast": Light(180, 60, (0.18, 0.18, 0.18), (0.62, 0.63, 0.64), (168, 174, 182), (206, 209, 212), 0.3),
}


@dataclass(frozen=True, eq=False)
class Course:
    """A track with its surroundings.

    Attributes:
        track: in its original direction, never reversed.
        look: colours, textures and plants.
        light: default light, a key of LIGHTS.
        roadside: sections of the roadside.
        seed: of the random surroundings.
        water: height of the lake's surface, metres; None: no lake.
    """

    track: Track
    look: Look
    light: str = "noon"
    roadside: tuple[RoadsideSection, ...] = ()
    seed: int = 0
    water: float | None = None

    def weight(self, kind: Roadside, side: int) -> Floats:
        """Return the weight (0..1) of a kind on a side (-1, 1) at each point of the track, with ramps at the ends."""
        sections = [section for section in self.roadside if section.kind == kind and section.side in (0, side)]
        weights = [self.section_weight(section) for section in sections]
        return np.asarray(np.sum(weights, axis=0).clip(0, 1) if weights else np.zeros(len(self.track.points)))

    def section_weight(self, section: RoadsideSection) -> Floats:
        """Return the weight (0..1) of a section at each point of the track, with ramps at its ends."""
        ramp = np.ones(int(RAMP / STEP)) / int(RAMP / STEP)
        weight = self._within(section).astype(float)
        padded = np.concatenate([weight[-len(ramp) :], weight, weight[: len(ramp)]])
        return np.asarray(np.convolve(padded, ramp, "same")[len(ramp) : -len(ramp)])

    def on_bridge(self) -> NDArray[np.bool_]:
        """Return a mask of the track's points that lie on a bridge."""
        bridges = [self._within(section) for section in self.roadside if section.kind == "bridge"]
        return np.any(bridges, axis=0) if bridges else np.zeros(len(self.track.points), bool)

    def _within(self, section: RoadsideSection) -> NDArray[np.bool_]:
        """Return a mask of the track's points within a section."""
        along = STEP * np.arange(len(self.track.points))
        after, before = along >= section.start, along < section.end
        return np.asarray(after & before if section.start <= section.end else after | before)
