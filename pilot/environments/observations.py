"""Observations of the environments: the centre camera's frame, or the car's state relative to the road."""

from dataclasses import dataclass
from typing import Any

import gymnasium
import numpy as np
from numpy.typing import NDArray

from pilot.environments.options import Observations
from pilot.simulator.episode import CarState, Episode
from pilot.simulator.track import STEP
from pilot.vehicle import COLUMNS, ROWS, TOP_SPEED_MPH

State = NDArray[np.float32]
AHEAD = (0, 4, 8, 12, 16, 20, 25, 30, 40, 50)  # metres along the road from the rear axle


@dataclass(frozen=True)
class Entry:
    """One entry of the state vector.

    Attributes:
        name: the quantity and its unit.
        scale: by which the quantity is divided, so that typical values are about 1.
        limit: the largest absolute value after that; larger ones are clipped.
    """

    name: str
    scale: float
    limit: float


ENTRIES = (
    Entry("speed, mph", TOP_SPEED_MPH, 1.0),
    Entry("last steering, -1..1", 1.0, 1.0),
    Entry("cross-track error, m", 2.0, 5.0),
    Entry("heading error, rad", 0.5, 6.3),
    Entry("distance to the road's left edge, m", 5.0, 3.0),
    Entry("distance to the road's right edge, m", 5.0, 3.0),
    *(Entry(f"curvature of the road {distance} m ahead, 1/m", 0.1, 2.0) for distance in AHEAD),
)
SCALES = np.array([entry.scale for entry in ENTRIES])
LIMITS = np.array([entry.limit for entry in ENTRIES], np.float32)


def observation_space(kind: Observations) -> gymnasium.spaces.Box[Any]:
    """Return the space of a kind of observations: 160x320x3 uint8 RGB, or float32 of one value per entry."""
    if kind == "image":
        return gymnasium.spaces.Box(0, 255, (ROWS, COLUMNS, 3), np.uint8)
    return gymnasium.spaces.Box(-LIMITS, LIMITS, dtype=np.float32)


def state_vector(episode: Episode, state: CarState) -> State:
    """Return the state vector of an episode in a state: the values of ENTRIES, float32."""
    track, where = episode.track, episode.where
    steps = int(where.progress / STEP) + np.array(AHEAD) * round(1 / STEP)
    values = [
        state.speed,
        state.steering,
        state.cross_track_error,
        state.heading_error,
        where.half_width + where.lateral_offset,
        where.half_width - where.lateral_offset,
        *track.curvatures[steps % len(track.curvatures)],
    ]
    scaled = (np.array(values) / SCALES).astype(np.float32)
    return np.asarray(scaled.clip(-LIMITS, LIMITS))
