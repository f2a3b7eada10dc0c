"""Courses: a track with its appearance, roadside and light."""

from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from pilot.arrays import Floats
from pilot.simulator.track import STEP, Track

Colour = tuple[int, int, int]  # RGB, 0..255
Grain = Literal["asphalt", "tarmac"]  # coarse, fine
Plant = Literal["pine", "palm", "boulder"]
Roadside = Literal["hill", "cliff", "drop", "water", "dirt", "bridge", "grove"]
DIRT: Colour = (176, 128, 78)
RAMP = 12.0  # metres of transition at each end of a section of the roadside


@dataclass(frozen=True)
class RoadsideSection:
    """A section of the roadside; outside all sections there is grass.

    Attributes:
        kind: of the roadside.
        start, end: shares of the lap, 0..1.
        side: -1 left, 1 right, 0 both, in the direction of the course's track.
    """

    kind: Roadside
    start: float
    end: float
    side: int = 0


@dataclass(frozen=True)
class Look:
    """Colours (RGB, 0..255), textures and plants of a course."""

    asphalt: Colour = (118, 113, 108)
    grain: Grain = "asphalt"
    edge_line: Colour | None = (205, 180, 60)
    middle_line: Colour | None = None
    paint_inside: float = 0.25
    """Width of the asphalt between the edge line and the road's edge, metres."""
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
    verge: float = 0.0
    """Reduction of the plants' minimum distance from the road's edge, metres."""


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


LIGHTS = {
    "noon": Light(140, 42, (0.62, 0.60, 0.55), (0.40, 0.42, 0.46), (84, 118, 190), (196, 212, 232)),
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
        weight = self._within(kind, {0, side}).astype(float)
        ramp = np.ones(int(RAMP / STEP)) / int(RAMP / STEP)
        padded = np.concatenate([weight[-len(ramp) :], weight, weight[: len(ramp)]])
        return np.asarray(np.convolve(padded, ramp, "same")[len(ramp) : -len(ramp)])

    def on_bridge(self) -> NDArray[np.bool_]:
        """Return a mask of the track's points that lie on a bridge."""
        return self._within("bridge", {-1, 0, 1})

    def _within(self, kind: Roadside, sides: set[int]) -> NDArray[np.bool_]:
        """Return a mask of the track's points within the sections of a kind on any of the sides."""
        shares = np.arange(len(self.track.points)) / len(self.track.points)
        within = np.zeros(len(shares), bool)
        for section in self.roadside:
            if section.kind == kind and section.side in sides:
                within |= (shares >= section.start) & (shares < section.end)
        return within
