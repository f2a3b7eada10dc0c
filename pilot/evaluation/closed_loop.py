"""Has a model drive in the built-in simulator, as fast as it goes, and puts the car back when it leaves the road.

What drives is all of drive.py but its socket: the telemetry with its JPEG picture, the autopilot with
its speed controller and steering filter, on the simulator's clock.
"""

import functools
import tempfile
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass
from datetime import datetime, timedelta
from pathlib import Path

import numpy as np

from pilot.arrays import Frame
from pilot.driving.autopilot import Answer, Autopilot
from pilot.driving.driver import Driver, SteeringPolicy
from pilot.driving.recorder import Recorder
from pilot.evaluation.conditions import Conditions
from pilot.simulator.episode import Episode
from pilot.simulator.expert import Expert
from pilot.simulator.referee import Referee
from pilot.simulator.simulator import TICKS, Simulator
from pilot.simulator.track import Track
from pilot.simulator.trajectory import Trajectory
from pilot.simulator.wire.client import build_telemetry, parse_steer
from pilot.vehicle import MPH, TICK
from pilot.video.clip import Overlays, make_clip

SLOWEST = 0.25  # share of the set speed; who is slower on average does not get to the end of his laps
FRAMES_PER_SECOND = 1 / (TICKS * TICK)
CLIP_START = datetime(2000, 1, 1)  # frames of a clip are named by the simulator's clock

PolicyFactory = Callable[[Episode], SteeringPolicy]
Command = tuple[float, float]


# Who drives


@dataclass(frozen=True)
class ModelPolicy:
    """Makes the steering of a trained model.

    Attributes:
        path: the model file.
    """

    path: Path

    def __call__(self, _drive: Episode | None = None) -> SteeringPolicy:
        """Load it.

        Raises:
            UnusableModel: the file is missing, damaged, or no model of this program.
        """
        return _load(self.path).steer


@functools.lru_cache(8)
def _load(path: Path) -> Driver:
    return Driver.load(path)


def expert_policy(episode: Episode) -> SteeringPolicy:
    """Makes the steering of the expert, who knows the road and needs no picture: what can be reached at best."""
    expert = Expert(episode)
    return lambda _frame: expert.command()[0]


# One drive


def time_limit(track: Track, laps: float, set_speed: float) -> float:
    """Seconds that a drive may take; `set_speed` in mph."""
    return laps * track.length / (SLOWEST * set_speed * MPH)


class Delay:
    """Commands on their way to the car; the one that arrived last is in force."""

    def __init__(self, ticks: int) -> None:
        """Delay commands by so many ticks of 20 ms."""
        self.ticks = ticks
        self._waiting: deque[tuple[int, Command]] = deque()
        self._current: Command = (0.0, 0.0)

    def send(self, tick: int, command: Command) -> None:
        """A command for what was seen at a tick."""
        self._waiting.append((tick + self.ticks, command))

    def at(self, tick: int) -> Command:
        """The command in force at a tick."""
        while self._waiting and self._waiting[0][0] <= tick:
            self._current = self._waiting.popleft()[1]
        return self._current

    def straighten(self) -> None:
        """The car stands elsewhere: what is on its way is void, the wheels stand straight until the next arrives."""
        self._waiting.clear()
        self._current = (0.0, self._current[1])


def drive_laps(
    episode: Episode,
    picture: Callable[[Episode], Frame],
    steer: SteeringPolicy,
    conditions: Conditions,
    *,
    seed: int = 0,
    observe: Callable[[Answer], None] = lambda _: None,
) -> Trajectory:
    """Drive; the same arguments give the same drive.

    Args:
        drive: the car on its road, where it is to start.
        picture: what the centre camera sees: 160x320x3 uint8 RGB.
        steer: frame to steering, -1..1.
        conditions: laps, speed, latency, lost frames.
        seed: of the frames that get lost.
        observe: called with every answer of the autopilot.

    Raises:
        RuntimeError: `steer` failed.
    """
    autopilot = Autopilot(steer, conditions.speed, clock=lambda: episode.ticks * TICK)
    delay = Delay(round(conditions.latency_ms / 1000 / TICK))
    longest = time_limit(episode.track, conditions.laps, conditions.speed.speed)
    referee = Referee(episode, laps=conditions.laps, seconds=longest, on_put_back=delay.straighten)
    random = np.random.default_rng(seed)
    while not referee.over:
        if random.random() >= conditions.lost_frames:
            answer = autopilot.answer(build_telemetry(episode, picture(episode)))
            if answer.telemetry is None:
                raise RuntimeError("the driver failed; what went wrong stands above")
            delay.send(episode.ticks, parse_steer(answer.message))
            observe(answer)
        for _ in range(TICKS):
            referee.observe(episode.advance(*delay.at(episode.ticks)))
    return referee.trajectory


# Many drives


@dataclass(frozen=True)
class DriveRequest:
    """One drive that is to be done, in any process.

    Attributes:
        driver: makes the steering for a car; to be pickled.
        track: such as lake, or random:7 reversed. light: None is the track's own.
        start: seed of the start place and of the frames that get lost; None starts at the start line.
        conditions: how to drive.
        clip: where a video of it goes; None makes none.
    """

    driver: PolicyFactory
    track: str
    conditions: Conditions
    light: str | None = None
    start: int | None = None
    clip: Path | None = None


def run(request: DriveRequest) -> Trajectory:
    """Do a drive.

    Raises:
        ValueError: there is no such track or light.
        UnusableModel: the model cannot be loaded.
        RuntimeError: the driver failed.
        OSError: the clip cannot be written.
    """
    simulator = simulator_at(request)
    episode = simulator.episode
    do = functools.partial(
        drive_laps,
        episode,
        lambda _: simulator.look()["center"],
        request.driver(episode),
        request.conditions,
        seed=request.start or 0,
    )
    return do() if request.clip is None else _filmed(do, episode, request.clip)


def simulator_at(request: DriveRequest) -> Simulator:
    """The simulator with the car where a drive is to start.

    Raises:
        ValueError: there is no such track or light.
    """
    simulator = _simulator()
    simulator.reset(request.track, request.start, request.light)
    return simulator


@functools.cache
def _simulator() -> Simulator:
    """One for all drives of a process: the next on the same road finds it built."""
    return Simulator()


def _filmed(do: Callable[..., Trajectory], episode: Episode, clip: Path) -> Trajectory:
    """Drive, and make a clip of it."""
    with tempfile.TemporaryDirectory() as folder:
        recorder = Recorder(Path(folder), now=lambda: CLIP_START + timedelta(seconds=episode.ticks * TICK))
        try:
            trajectory = do(observe=recorder.observe)
        finally:
            recorder.close()
        film(Path(folder), clip)
    return trajectory


def film(folder: Path, clip: Path, fps: float = FRAMES_PER_SECOND) -> None:
    """Make a clip of a recorded drive, with all instruments; without `fps`, at the speed of the simulator's clock."""
    make_clip(folder, clip, fps=fps, overlays=Overlays(wheel=True, speed=True, path=True))
