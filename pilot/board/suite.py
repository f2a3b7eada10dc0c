"""Suites: frozen lists of drives, by which models of different times and people are comparable.

A suite never changes once models were measured by it: what would change it becomes a new version.
"""

import hashlib
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from pilot.driving.controller import ControllerConfig
from pilot.evaluation.closed_loop import DriveRequest, PolicyFactory
from pilot.evaluation.conditions import Conditions
from pilot.simulator.catalogue import both_ways, load_track
from pilot.simulator.track import REVERSED

SPEED = 30.0  # mph


@dataclass(frozen=True)
class SuiteDrive:
    """A drive of a suite.

    Attributes:
        track: name of the track, such as lake or random:4000 reversed.
        light: noon, clear, evening or overcast.
        latency_ms: time from a frame to its command.
        lost_frames: share of the frames that are lost.
        start: seed of the start position and of the lost frames.
        half: 0 or 1; the halves of a suite are of the same kind.
        metres: length of the drive.
    """

    track: str
    light: str
    latency_ms: int
    lost_frames: float
    start: int
    half: int
    metres: float

    @property
    def title(self) -> str:
        """Name in tables."""
        return f"{self.track}, {self.light}, {self.latency_ms} ms"

    def request(self, driver: PolicyFactory, clip: Path | None = None) -> DriveRequest:
        """Return the drive for a driver; with a clip of it, if its path is given."""
        conditions = Conditions(
            self.metres / load_track(self.track).length,
            self.latency_ms,
            self.lost_frames,
            ControllerConfig(speed=SPEED),
        )
        return DriveRequest(driver, self.track, conditions, self.light, self.start, clip)


@dataclass(frozen=True)
class Suite:
    """A frozen list of drives.

    Attributes:
        version: its name.
        drives: in the order of the tables.
        description: of roads, lights and conditions, for the page.
    """

    version: str
    drives: tuple[SuiteDrive, ...]
    description: str

    @property
    def digest(self) -> str:
        """SHA-256 of the drives and of their roads, to centimetres: differs if anything of it has changed."""
        sha256 = hashlib.sha256(repr(self.drives).encode())
        for track in sorted({drive.track for drive in self.drives}):
            road = load_track(track)
            sha256.update(np.round(100 * road.points).astype(np.int64).tobytes())
            sha256.update(np.round(100 * road.half_widths).astype(np.int64).tobytes())
        return sha256.hexdigest()


LIGHTS = ("noon", "clear", "evening", "overcast")
CONDITIONS = ((40, 0.0), (140, 0.0), (40, 0.05), (140, 0.05))  # latency in ms, share of lost frames
ROADS = ("lake", "jungle", "mountain")
METRES = 400.0
LATENCIES = (40, 120, 200, 300, 400)  # ms
# seeds of the first random roads of each suite, which are in no demonstration
FIRST_RANDOM, FIRST_OF_LATENCY, FIRST_OF_LONG = 4000, 5000, 6000


def _of_all_kinds(version: str, turns: int, first_random: int) -> Suite:
    """Return drives on lake, jungle and mountain in both directions, and as many on random roads.

    Each road is driven in all lights and conditions, and each light occurs with each condition.

    Args:
        version: of the suite.
        turns: drives on each named road in each direction, a multiple of four.
        first_random: seed of the first random road.
    """
    named = [
        SuiteDrive(
            track,
            *_setting(road + (0, 2, 1, 3)[turn % 4], turn + turn // 4 + 2 * road),
            start=turn,
            half=turn // 2 % 2,
            metres=METRES,
        )
        for turn in range(turns)
        for road, track in enumerate(both_ways(list(ROADS)))
    ]
    random = [
        SuiteDrive(
            f"random:{first_random + number}" + REVERSED * (number // 2 % 2),
            *_setting(number // 2, number // 2 + number // 8),
            start=number,
            half=number % 2,
            metres=METRES,
        )
        for number in range(len(named))
    ]
    return Suite(
        version,
        (*named, *random),
        "on lake, jungle, mountain and random roads, in all lights, with latencies of 40 and 140 ms and up to 5 % of "
        "the frames lost",
    )


def _latency() -> Suite:
    """Return drives on eight roads, each with all latencies of `LATENCIES` and in the same light."""
    roads = [*ROADS, f"jungle{REVERSED}", *(f"random:{FIRST_OF_LATENCY + number}" for number in range(4))]
    drives = [
        SuiteDrive(track, LIGHTS[road % len(LIGHTS)], latency, 0.0, start=road, half=road % 2, metres=METRES)
        for road, track in enumerate(roads)
        for latency in LATENCIES
    ]
    shown = ", ".join(map(str, LATENCIES[:-1]))
    return Suite(
        "latency-v1",
        tuple(drives),
        f"on lake, jungle, mountain and random roads, each with latencies of {shown} and {LATENCIES[-1]} ms",
    )


def _setting(light: int, condition: int) -> tuple[str, int, float]:
    """Return light, latency and share of lost frames; the numbers may be of any size."""
    return (LIGHTS[light % len(LIGHTS)], *CONDITIONS[condition % len(CONDITIONS)])


SUITES = {
    suite.version: suite
    for suite in (_of_all_kinds("v1", 4, FIRST_RANDOM), _of_all_kinds("long-v1", 12, FIRST_OF_LONG), _latency())
}
