"""Recordings as the real simulator writes them: laps, and the way back from where one should not be."""

import functools
import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from datetime import datetime, timedelta
from pathlib import Path

import numpy as np

from pilot.data.frames import Frame, encode_frame
from pilot.data.log_format import LOG_NAME
from pilot.simulator.episode import Episode
from pilot.simulator.expert import Expert
from pilot.vehicle import CAMERAS, HALF_TRACK, MPH, TICK, TOP_SPEED_MPH

REAL_RATE = 15.0  # rows a second that the real simulator records
LONGEST_RECOVERY = 2.5  # s
METRES_OF_A_RECOVERY = 20.0  # about, for the progress bar
ASKEW = math.radians(6.0)  # typical heading error that is recovered from
RECOVERED = (0.15, math.radians(1.0))  # metres and radians, when the car is back


class RecordingWriter:
    """Appends to a recording: pictures of three cameras and lines of driving_log.csv.

    Attributes:
        rows: lines written so far.
    """

    def __init__(self, folder: Path, listed_as: Path | None = None) -> None:
        """Open the recording; one that is already there goes on.

        Args:
            folder: it lies in; made if need be.
            listed_as: folder that the log names as the pictures' place, where this one is to be moved there.

        Raises:
            OSError: the folder cannot be written to.
        """
        self.folder, self.listed_as = folder, (listed_as or folder).resolve()
        self.start = datetime.now()
        self.rows = 0
        (self.folder / "IMG").mkdir(parents=True, exist_ok=True)
        self._log = (self.folder / LOG_NAME).open("a", encoding="utf-8", newline="")

    def write(self, frames: dict[str, Frame], seconds: float, command: tuple[float, float], speed: float) -> None:
        """Add a moment.

        Args:
            frames: of the three cameras, 160x320x3 uint8 RGB.
            seconds: since the start.
            command: steering and throttle, -1..1 each; a negative throttle is written as brake.
            speed: mph.
        """
        moment = self.start + timedelta(seconds=seconds)
        stamp = f"{moment:%Y_%m_%d_%H_%M_%S}_{moment.microsecond // 1000:03d}"
        names = [f"{camera}_{stamp}.jpg" for camera in CAMERAS]
        for camera, name in zip(CAMERAS, names, strict=True):
            (self.folder / "IMG" / name).write_bytes(encode_frame(frames[camera]))
        steering, throttle = command
        values = (steering, max(0.0, throttle), max(0.0, -throttle), abs(speed))  # in this order: never -0
        listed = [str(self.listed_as / "IMG" / name) for name in names]
        self._log.write(",".join([*listed, *(f"{value:.7g}" for value in values)]) + "\n")
        self.rows += 1

    def __enter__(self) -> "RecordingWriter":
        return self

    def __exit__(self, *_error: object) -> None:
        self._log.close()


@dataclass(frozen=True)
class Demonstration:
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
    rate: float = REAL_RATE
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
class Moment:
    """What is to be recorded.

    Attributes:
        command: steering and throttle, -1..1 each, that the expert gives at what the cameras see now.
        done: share of the demonstration that has been driven, 0..1.
    """

    command: tuple[float, float]
    done: float


def demonstrate(episode: Episode, plan: Demonstration) -> Iterator[Moment]:
    """Drive as planned; stops at each moment that is to be recorded, before its command is carried out."""
    lap_share = plan.laps / (plan.laps + plan.recoveries * METRES_OF_A_RECOVERY / episode.track.length or 1)
    expert = Expert(episode, plan.speed, plan.wander, plan.seed)
    for command in _commands(episode, expert, plan.rate, lambda: episode.laps >= plan.laps):
        yield Moment(command, lap_share * episode.laps / plan.laps)
    for number in range(plan.recoveries):
        _displace(episode, number, plan)
        latest = episode.ticks + round(LONGEST_RECOVERY / TICK)
        over = functools.partial(_recovered, episode, latest)
        for command in _commands(episode, Expert(episode, plan.speed), plan.rate, over):
            yield Moment(command, lap_share + (1 - lap_share) * number / plan.recoveries)


def _commands(episode: Episode, expert: Expert, rate: float, over: Callable[[], bool]) -> Iterator[tuple[float, float]]:
    """Have the expert drive until it is over; yields its command at the moments to be recorded."""
    first = episode.ticks
    while not over():
        command = expert.command()
        if is_due(episode.ticks - first, rate):
            yield command
        episode.advance(*command)


def _displace(episode: Episode, number: int, plan: Demonstration) -> None:
    """Put the car beside its lane and askew, but on the road, as fast as suits it there."""
    random = np.random.default_rng([plan.seed, number])
    start = episode.track.length * (number + float(random.uniform())) / plan.recoveries
    edge = float(episode.track.half_widths.min()) - HALF_TRACK
    offset, heading = float(random.uniform(-edge, edge)) - episode.track.lane, float(random.normal(0, ASKEW))
    episode.place(start, offset, heading)
    fastest = Expert(episode, plan.speed).allowed_speed() / MPH
    episode.place(start, offset, heading, fastest * float(random.uniform(0.5, 1)))


def _recovered(episode: Episode, latest: int) -> bool:
    """Whether the car is back in its lane, or has had its time (ticks)."""
    state = episode.state
    back = abs(state.offset) < RECOVERED[0] and abs(state.heading_error) < RECOVERED[1]
    return back or episode.ticks >= latest


def is_due(tick: int, rate: float) -> bool:
    """Whether a row is to be written at a tick of a recording (its first is 0), at `rate` rows a second."""
    ticks = round(1 / TICK)
    return math.floor(tick * rate / ticks) != math.floor((tick - 1) * rate / ticks)
