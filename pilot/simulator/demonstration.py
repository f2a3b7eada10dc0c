"""How the expert drives while it is recorded: laps, and recoveries from beside the lane."""

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
RECOVERY_METRES = 20.0  # about, for the progress bar
RECOVERY_HEADING = math.radians(6.0)  # typical heading error that is recovered from
RECOVERED = (0.15, math.radians(1.0))  # metres and radians, when the car is back


@dataclass(frozen=True)
class DemonstrationConfig:
    """How the expert drives while it is recorded.

    Attributes:
        laps: that are recorded as they are driven.
        recoveries: that follow all along the road: the car is put beside its lane or askew, and only the way back is
            recorded (NVIDIA, arXiv 1604.07316: shift and rotation; DART, arXiv 1703.09327: disturbances).
        rate: rows a second.
        speed: mph, where the road allows it.
        wander: metres, that a person typically strays from the middle of the lane.
        seed: of everything random.
    """

    laps: float = 1.0
    recoveries: int = 0
    rate: float = RECORDING_RATE
    speed: float = 30.0
    wander: float = 0.0
    seed: int = 0

    def check(self) -> None:
        """Refuse what cannot be driven.

        Raises:
            ValueError: an option's value makes no sense.
        """
        for name, least, most in (
            ("laps", 0, 1000),
            ("recoveries", 0, 10000),
            ("rate", 0.1, 1 / TICK),
            ("speed", 1, TOP_SPEED_MPH),
            ("wander", 0, 3),
        ):
            if not least <= getattr(self, name) <= most:
                raise ValueError(f"{name} {getattr(self, name):g}: takes {least:g} to {most:g}")


@dataclass(frozen=True)
class DemonstrationStep:
    """What is to be recorded.

    Attributes:
        command: steering and throttle, -1..1 each, that the expert gives at what the cameras see now.
        done: share of the demonstration that has been driven, 0..1.
    """

    command: tuple[float, float]
    done: float


def demonstrate(episode: Episode, config: DemonstrationConfig) -> Iterator[DemonstrationStep]:
    """Drive a demonstration; stops at each moment that is to be recorded, before its command is carried out."""
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
    """Have the expert drive until it is over; yields its command at the moments to be recorded."""
    first = episode.ticks
    while not over():
        command = expert.command()
        if is_due(episode.ticks - first, rate):
            yield command
        episode.advance(*command)


def _displace(episode: Episode, number: int, config: DemonstrationConfig) -> None:
    """Put the car beside its lane and askew, but on the road, as fast as suits it there."""
    random = np.random.default_rng([config.seed, number])
    start = episode.track.length * (number + float(random.uniform())) / config.recoveries
    edge = float(episode.track.half_widths.min()) - HALF_TRACK
    offset, heading = float(random.uniform(-edge, edge)) - episode.track.lane, float(random.normal(0, RECOVERY_HEADING))
    episode.place(start, offset, heading)
    fastest = Expert(episode, config.speed).allowed_speed() / MPH
    episode.place(start, offset, heading, fastest * float(random.uniform(0.5, 1)))


def _recovered(episode: Episode, latest: int) -> bool:
    """Whether the car is back in its lane, or has had its time (ticks)."""
    state = episode.state
    back = abs(state.cross_track_error) < RECOVERED[0] and abs(state.heading_error) < RECOVERED[1]
    return back or episode.ticks >= latest
