"""What is to be driven, and how: tracks, start places, speed, and what is made difficult."""

import re
from collections.abc import Sequence
from dataclasses import dataclass, field

import tyro

from pilot.driving.controller import ControllerConfig
from pilot.vehicle import TICK

TICK_MS = round(1000 * TICK)
RANDOM_RANGE = re.compile(r"random:(\d+)-(\d+)( reversed)?")
MOST_TRACKS = 1000  # in a range: more is a slip of the finger


@dataclass(frozen=True)
class Conditions:
    """How to drive."""

    laps: float = 1.0
    """Laps of each drive."""
    latency_ms: int = 40
    """Milliseconds from picture to command, in steps of 20. 40 is what the wire of the built-in simulator has, where
    two pictures are under way (the real one, with drive.py on the same computer: 16 to 33 for the way there and back);
    0 is a command at the very moment of its picture, which no simulator gives."""
    lost_frames: float = 0.0
    """Share of the pictures (0..1) that get lost at random; the last command stays."""
    speed: tyro.conf.OmitArgPrefixes[ControllerConfig] = field(default_factory=lambda: ControllerConfig(speed=30.0))

    def check(self) -> None:
        """Refuse what cannot be driven.

        Raises:
            ValueError: names the option, its value and what it may be.
        """
        self.speed.check()
        if self.speed.speed < 1:
            raise ValueError(f"--speed {self.speed.speed:g}: must be at least 1 mph, or no lap comes to its end")
        if not 0 < self.laps <= 1000:
            raise ValueError(f"--laps {self.laps:g}: must be greater than 0, and at most 1000")
        if not 0 <= self.latency_ms <= 2000 or self.latency_ms % TICK_MS:
            raise ValueError(f"--latency-ms {self.latency_ms}: must be a multiple of {TICK_MS} in 0..2000")
        if not 0 <= self.lost_frames < 1:
            raise ValueError(f"--lost-frames {self.lost_frames:g}: must lie in 0..1, and some have to arrive")


def expand_tracks(names: Sequence[str]) -> list[str]:
    """Tracks by name, each once: ranges such as random:0-4 become their tracks.

    Raises:
        ValueError: a range is empty or absurd.
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
