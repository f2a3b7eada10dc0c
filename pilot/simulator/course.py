"""What a simulated road looks like: its paint, what lies beside it, and the light."""

from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from pilot.arrays import Floats
from pilot.simulator.track import STEP, Track

Colour = tuple[int, int, int]  # RGB, 0..255
Grain = Literal["asphalt", "tarmac"]  # coarse or fine
Plant = Literal["pine", "palm", "boulder"]
Roadside = Literal["hill", "cliff", "drop", "water", "dirt", "bridge", "grove"]
DIRT: Colour = (176, 128, 78)
RAMP = 12.0  # metres in which one kind of roadside goes over into the next


@dataclass(frozen=True)
class RoadsideSection:
    """A part of the road that has something beside it.

    Attributes:
        kind: what; elsewhere there are meadows.
        start, end: shares of the lap, 0..1.
        side: -1 left, 1 right, 0 both, in the direction that the course was laid out in.
    """

    kind: Roadside
    start: float
    end: float
    side: int = 0


@dataclass(frozen=True)
class Look:
    """Colours and kinds; RGB 0..255."""

    asphalt: Colour = (118, 113, 108)
    grain: Grain = "asphalt"
    edge_line: Colour | None = (205, 180, 60)
    middle_line: Colour | None = None
    paint_inside: float = 0.25
    """Metres of asphalt between the edge line and the road's edge."""
    shoulder: Colour | None = (214, 205, 186)
    kerbs: bool = True
    grass: Colour = (122, 120, 46)
    dry: Colour = (168, 132, 76)
    rock: Colour = (158, 148, 128)
    tree: Plant = "pine"
    trees: float = 16.0
    """Trees or boulders on a hectare."""
    relief: float = 5.0
    """Metres that the land away from the road goes up and down."""
    verge: float = 0.0
    """Metres by which tree and rock come nearer to the road than elsewhere."""


@dataclass(frozen=True)
class Light:
    """Where the sun stands and what colours its light has.

    Attributes:
        azimuth: degrees, compass direction of the sun.
        elevation: degrees above the horizon.
        sun, ambient: RGB, shares of a surface's colour that sun and sky give; up to 1 together.
        sky, horizon: RGB 0..255.
        shadows: how dark shadows are, 0 none .. 1.
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
    """A road with its surroundings.

    Attributes:
        track: the road, in the direction that it was laid out in.
        look: colours and kinds.
        light: name of its usual light, a key of LIGHTS.
        roadside: what lies beside it.
        seed: of everything random in its surroundings.
        water: metres, height of a lake; None where there is none.
    """

    track: Track
    look: Look
    light: str = "noon"
    roadside: tuple[RoadsideSection, ...] = ()
    seed: int = 0
    water: float | None = None

    def weight(self, kind: Roadside, side: int) -> Floats:
        """How much of a kind lies on a side (-1, 1) at each of the track's points, 0..1, with soft ends."""
        weight = self._within(kind, {0, side}).astype(float)
        ramp = np.ones(int(RAMP / STEP)) / int(RAMP / STEP)
        padded = np.concatenate([weight[-len(ramp) :], weight, weight[: len(ramp)]])
        return np.asarray(np.convolve(padded, ramp, "same")[len(ramp) : -len(ramp)])

    def on_bridge(self) -> NDArray[np.bool_]:
        """Which of the track's points lie on a bridge."""
        return self._within("bridge", {-1, 0, 1})

    def _within(self, kind: Roadside, sides: set[int]) -> NDArray[np.bool_]:
        """Which of the track's points lie within a section of a kind on one of some sides."""
        shares = np.arange(len(self.track.points)) / len(self.track.points)
        within = np.zeros(len(shares), bool)
        for section in self.roadside:
            if section.kind == kind and section.side in sides:
                within |= (shares >= section.start) & (shares < section.end)
        return within
