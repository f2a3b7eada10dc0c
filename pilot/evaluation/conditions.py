"""Driving conditions of an evaluation (laps, latency, lost frames, speed), and ranges of tracks."""

import re
from collections.abc import Sequence
from dataclasses import dataclass, field

import tyro

from pilot.driving.controller import ControllerConfig
from pilot.vehicle import TICK

TICK_MS = round(1000 * TICK)
RANDOM_RANGE = re.compile(r"random:(\d+)-(\d+)( reversed)?")
MOST_TRACKS = 1000  # in a range; more are probably a typing error


@dataclass(frozen=True)
class Conditions:
    """Driving conditions of the episodes."""

    laps: float = 1.0
    """Laps per episode."""
    latency_ms: int = 40
    """Delay in milliseconds from a frame to its command, a multiple of 20. 40 is that of the built-in simulator with
    drive.py, where two frames are in transit (Unity simulator with drive.py on the same computer: 16 to 33, round
    trip); 0 applies a command at the instant of its frame, which no simulator achieves."""
    lost_frames: float = 0.0
    """Share of the frames (0..1) that are lost at random; the last command stays in effect."""
    speed: tyro.conf.OmitArgPrefixes[ControllerConfig] = field(default_factory=lambda: ControllerConfig(speed=30.0))

    def check(self) -> None:
        """Check the values.

        Raises:
            ValueError: a value is invalid; the message names the option, its value and the valid range.
        """
        self.speed.check()
        if self.speed.speed < 1:
            raise ValueError(f"--speed {self.speed.speed:g}: must be at least 1 mph, or no lap is completed")
        if not 0 < self.laps <= 1000:
            raise ValueError(f"--laps {self.laps:g}: must be greater than 0, and at most 1000")
        if not 0 <= self.latency_ms <= 2000 or self.latency_ms % TICK_MS:
            raise ValueError(f"--latency-ms {self.latency_ms}: must be a multiple of {TICK_MS} in 0..2000")
        if not 0 <= self.lost_frames < 1:
            raise ValueError(f"--lost-frames {self.lost_frames:g}: must be at least 0 and less than 1")


def expand_tracks(names: Sequence[str]) -> list[str]:
    """Return the names of the tracks without duplicates; ranges such as random:0-4 are expanded.

    Raises:
        ValueError: a range is empty or too large.
    """
    tracks = [track for name in names for track in _expand(name)]
    return list(dict.fromkeys(tracks))


def _expand(name: str) -> list[str]:
    match = RANDOM_RANGE.fullmatch(name)
    if match is None:
        return [name]
    first, last = int(match[1]), int(match[2])
    if not first <= last < first + MOST_TRACKS:
        raise ValueError(f"track {name!r}: a range goes from less to more, and over {MOST_TRACKS} tracks at most")
    return [f"random:{seed}{match[3] or ''}" for seed in range(first, last + 1)]
