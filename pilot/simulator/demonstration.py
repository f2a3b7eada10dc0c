"""Demonstrations: laps of the expert, and recoveries from disturbed positions."""

import functools
import math
import zlib
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Literal

import numpy as np

from pilot.data.recording_writer import RECORDING_RATE, is_due
from pilot.simulator.episode import Episode
from pilot.simulator.expert import EDGE_CLEARANCE, Expert
from pilot.simulator.track import STEP, Track
from pilot.vehicle import MPH, TICK, TOP_SPEED_MPH

LONGEST_RECOVERY = 2.4  # s
PAUSE = 2.0  # s between recoveries, so that readers of the recording do not take two of them for one drive
RECOVERY_METRES = 20.0  # approximate length of a recovery, for the progress bar
# Range of the standard deviation of the heading error at the start: small errors are the most frequent, but a car that
# turns into a hairpin 3 m too late is already 17 degrees off.
RECOVERY_HEADINGS = (math.radians(3.0), math.radians(18.0))
RECOVERY_AHEAD = 5.0  # metres before a bend where recoveries from it start
RECOVERED = (0.15, math.radians(1.0))  # limits of cross-track error (metres) and heading error (radians) at the end


@dataclass(frozen=True)
class DemonstrationConfig:
    """What the expert demonstrates.

    Attributes:
        laps: Laps to record.
        recoveries: Recoveries to record after the laps, half of them distributed evenly along the track, half in
            proportion to its curvature, because few metres of a road are tight bends: the car starts with random
            cross-track and heading errors, and its return to the middle of the lane, or to the nearest of the lines
            that `line_spread` allows, is recorded (similar to the
            shifts and rotations of arXiv 1604.07316 and the disturbances of DART, arXiv 1703.09327).
        rate: Rows per second.
        speed: Target speed in mph; bends are taken more slowly.
        line_spread: Share (0..1) of the free road beside the lane that is used too: each lap follows a line of its own,
            and each recovery leads to the nearest of these lines. On a road with two lanes, they reach across its
            middle. People, too, keep to the line that they are on, and correct it only towards the road's edges.
        wander: Standard deviation in metres of a random deviation from the line; imitates a person.
        cameras: Cameras to record: all three, as the Unity simulator does, or the centre camera only, which takes less
            time and disk space per row.
        vary_cameras: Vary the cameras' height and pitch, the exposure, the tint and the JPEG quality at random in each
            row, so that a network does not depend on them.
        seed: Seed of the random generators.
    """

    laps: float = 1.0
    recoveries: int = 0
    rate: float = RECORDING_RATE
    speed: float = 30.0
    line_spread: float = 0.0
    wander: float = 0.0
    cameras: Literal["all", "center"] = "all"
    vary_cameras: bool = False
    seed: int = 0

    def check(self) -> None:
        """Check the values.

        Raises:
            ValueError: a value is out of range; the message names the option, its value and the valid range.
        """
        for name, least, most in (
            ("laps", 0, 1000),
            ("recoveries", 0, 10000),
            ("rate", 0.1, 1 / TICK),
            ("speed", 1, TOP_SPEED_MPH),
            ("line_spread", 0, 1),
            ("wander", 0, 3),
            ("seed", 0, 1e9),
        ):
            if not least <= getattr(self, name) <= most:
                raise ValueError(f"--{name.replace('_', '-')} {getattr(self, name):g}: takes {least:g} to {most:g}")


@dataclass(frozen=True)
class DemonstrationStep:
    """A time step to be recorded.

    Attributes:
        command: the expert's steering and throttle in the episode's current state, -1..1 each.
        done: completed share of the demonstration, 0..1.
    """

    command: tuple[float, float]
    done: float


def demonstrate(episode: Episode, config: DemonstrationConfig) -> Iterator[DemonstrationStep]:
    """Drive a demonstration; yields at each time step to be recorded, before its command is applied."""
    lap_share = config.laps / (config.laps + config.recoveries * RECOVERY_METRES / episode.track.length or 1)
    random = np.random.default_rng([config.seed, zlib.crc32(episode.track.name.encode())])
    for lap in range(math.ceil(config.laps)):
        line, end = float(random.uniform(*lines(episode.track, config.line_spread))), min(lap + 1, config.laps)
        expert = Expert(episode, config.speed, line, config.wander, config.seed + lap)
        for command in _commands(episode, expert, config.rate, functools.partial(_driven, episode, end)):
            yield DemonstrationStep(command, lap_share * episode.laps / config.laps)
    last_row = round(math.floor(LONGEST_RECOVERY * config.rate) / config.rate / TICK)  # ticks after the start
    for number in range(config.recoveries):
        episode.ticks += round(PAUSE / TICK)
        expert = _displaced(episode, number, config)
        over = functools.partial(_recovered, expert, episode.ticks + last_row)
        for command in _commands(episode, expert, config.rate, over):
            yield DemonstrationStep(command, lap_share + (1 - lap_share) * number / config.recoveries)


def _driven(episode: Episode, laps: float) -> bool:
    return episode.laps >= laps


def lines(track: Track, spread: float) -> tuple[float, float]:
    """Return the leftmost and the rightmost line of a demonstration, metres to the right of the road's middle."""
    if not spread:
        return track.lane, track.lane
    room = max(track.largest_offset - EDGE_CLEARANCE, abs(track.lane))
    left, right = min(track.lane, 0.0), max(track.lane, 0.0)
    return left - spread * (room + left), right + spread * (room - right)


def _commands(episode: Episode, expert: Expert, rate: float, over: Callable[[], bool]) -> Iterator[tuple[float, float]]:
    """Let the expert drive until `over()` is true; yields its command at each time step to be recorded."""
    first = episode.ticks
    while not over():
        command = expert.command()
        if is_due(episode.ticks - first, rate):
            yield command
        episode.advance(*command)


def _displaced(episode: Episode, number: int, config: DemonstrationConfig) -> Expert:
    """Start a recovery: random lateral offset on the road, heading error, and 50 to 100 % of the allowed speed.

    Returns:
        The expert that returns to the nearest line.
    """
    random = np.random.default_rng([config.seed, number])
    track = episode.track
    start = recovery_start(track, (number + float(random.uniform())) / config.recoveries)
    edge = track.largest_offset
    offset, heading = float(random.uniform(-edge, edge)), float(random.normal(0, random.uniform(*RECOVERY_HEADINGS)))
    expert = Expert(episode, config.speed, float(np.clip(offset, *lines(track, config.line_spread))))
    episode.place(start, offset - track.lane, heading)
    fastest = expert.allowed_speed() / MPH
    episode.place(start, offset - track.lane, heading, fastest * float(random.uniform(0.5, 1)))
    return expert


def recovery_start(track: Track, share: float) -> float:
    """Return where (metres) a share (0..1) of all recoveries has started: half evenly, half by the curvature."""
    curvatures = np.abs(track.curvatures)
    density = 1 / len(curvatures) + curvatures / max(float(curvatures.sum()), 1e-9)
    index = int(np.searchsorted(np.cumsum(density), share * float(density.sum())))
    return (index * STEP - RECOVERY_AHEAD) % track.length


def _recovered(expert: Expert, latest: int) -> bool:
    """Return whether the car is back on the expert's line, or the tick `latest` is past."""
    back = abs(expert.error) < RECOVERED[0] and abs(expert.episode.state.heading_error) < RECOVERED[1]
    return back or expert.episode.ticks > latest
