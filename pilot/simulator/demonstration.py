"""Demonstrations: laps of the expert, and recoveries from disturbed positions."""

import functools
import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass

import numpy as np

from pilot.data.recording_writer import RECORDING_RATE, is_due
from pilot.simulator.episode import Episode
from pilot.simulator.expert import Expert
from pilot.vehicle import HALF_TRACK, MPH, TICK, TOP_SPEED_MPH

LONGEST_RECOVERY = 2.5  # s
RECOVERY_METRES = 20.0  # approximate length of a recovery, for the progress bar
RECOVERY_HEADING = math.radians(6.0)  # standard deviation of the heading error at the start
RECOVERED = (0.15, math.radians(1.0))  # limits of cross-track error (metres) and heading error (radians) at the end


@dataclass(frozen=True)
class DemonstrationConfig:
    """What the expert demonstrates.

    Attributes:
        laps: Laps to record.
        recoveries: Recoveries to record after the laps, distributed along the track: the car starts with random
            cross-track and heading errors, and its return to the middle of the lane is recorded (similar to the
            shifts and rotations of arXiv 1604.07316 and the disturbances of DART, arXiv 1703.09327).
        rate: Rows per second.
        speed: Target speed in mph; bends are taken more slowly.
        wander: Standard deviation in metres of a random offset from the middle of the lane; imitates a person.
        vary_cameras: Vary the cameras' height and pitch, the exposure, the tint and the JPEG quality at random in each
            row, so that a network does not depend on them.
        seed: Seed of the random generators.
    """

    laps: float = 1.0
    recoveries: int = 0
    rate: float = RECORDING_RATE
    speed: float = 30.0
    wander: float = 0.0
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
            ("wander", 0, 3),
            ("seed", 0, 1e9),
        ):
            if not least <= getattr(self, name) <= most:
                raise ValueError(f"{name} {getattr(self, name):g}: takes {least:g} to {most:g}")


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
    expert = Expert(episode, config.speed, config.wander, config.seed)
    for command in _commands(episode, expert, config.rate, lambda: episode.laps >= config.laps):
        yield DemonstrationStep(command, lap_share * episode.laps / config.laps)
    for number in range(config.recoveries):
        _displace(episode, number, config)
        latest = episode.ticks + round(LONGEST_RECOVERY / TICK)
        over = functools.partial(_recovered, episode, latest)
        for command in _commands(episode, Expert(episode, config.speed), config.rate, over):
            yield DemonstrationStep(command, lap_share + (1 - lap_share) * number / config.recoveries)


def _commands(episode: Episode, expert: Expert, rate: float, over: Callable[[], bool]) -> Iterator[tuple[float, float]]:
    """Let the expert drive until `over()` is true; yields its command at each time step to be recorded."""
    first = episode.ticks
    while not over():
        command = expert.command()
        if is_due(episode.ticks - first, rate):
            yield command
        episode.advance(*command)


def _displace(episode: Episode, number: int, config: DemonstrationConfig) -> None:
    """Start a recovery: random lateral offset on the road, heading error, and 50 to 100 % of the allowed speed."""
    random = np.random.default_rng([config.seed, number])
    start = episode.track.length * (number + float(random.uniform())) / config.recoveries
    edge = float(episode.track.half_widths.min()) - HALF_TRACK
    offset, heading = float(random.uniform(-edge, edge)) - episode.track.lane, float(random.normal(0, RECOVERY_HEADING))
    episode.place(start, offset, heading)
    fastest = Expert(episode, config.speed).allowed_speed() / MPH
    episode.place(start, offset, heading, fastest * float(random.uniform(0.5, 1)))


def _recovered(episode: Episode, latest: int) -> bool:
    """Return whether the car is back in the middle of its lane, or the tick `latest` is reached."""
    state = episode.state
    back = abs(state.cross_track_error) < RECOVERED[0] and abs(state.heading_error) < RECOVERED[1]
    return back or episode.ticks >= latest
