"""Closed-loop evaluation in the built-in simulator, as fast as possible; the car is put back when it leaves the road.

All of drive.py is used except its socket: the telemetry with its JPEG image, and the autopilot with its speed
controller and steering filter, on the simulator's clock.
"""

import functools
import logging
import tempfile
from collections import deque
from collections.abc import Callable, Generator, Sequence
from dataclasses import dataclass
from datetime import datetime, timedelta
from pathlib import Path

import numpy as np

from pilot.arrays import Frame
from pilot.data.frames import encoded_with
from pilot.driving.autopilot import Answer, Autopilot
from pilot.driving.driver import Driver
from pilot.driving.plan import FrameHistory, Plan, SteeringPolicy, signature_of
from pilot.driving.recorder import Recorder
from pilot.driving.telemetry import parse_telemetry
from pilot.evaluation.conditions import Conditions
from pilot.signature import STEERING_ONLY, Signature
from pilot.simulator.episode import Episode
from pilot.simulator.expert import Expert
from pilot.simulator.referee import Referee, time_limit
from pilot.simulator.simulator import TICKS, Simulator
from pilot.simulator.trajectory import Trajectory
from pilot.simulator.wire.client import build_telemetry, parse_steer
from pilot.vehicle import COLUMNS, NO_ROWS, ROWS, TICK, WHOLE_FRAME, Rows
from pilot.video.clip import Overlays, make_clip

FRAMES_PER_SECOND = 1 / (TICKS * TICK)
CLIP_START = datetime(2000, 1, 1)  # time 0 of the simulator in the names of the frames of a clip

log = logging.getLogger("pilot")

PolicyFactory = Callable[[Episode], SteeringPolicy]
Command = tuple[float, float]
Answered = float | Plan
Drive = Generator[Frame, Answered, Trajectory]


# Steering policies


@dataclass(frozen=True)
class ModelPolicy:
    """Makes the steering policy of a trained model; picklable.

    Attributes:
        path: path of the model file.
    """

    path: Path

    def __call__(self, _drive: Episode | None = None) -> Driver:
        """Load the model, which is the steering policy.

        Raises:
            UnusableModel: the file is missing, damaged, or not a model of this project.
        """
        return self.load()

    def load(self) -> Driver:
        """Return the model, which is loaded once.

        Raises:
            UnusableModel: as for `__call__`.
        """
        return _load(self.path)

    @property
    def seen_rows(self) -> Rows:
        """Rows of a frame on which the model's steering depends.

        Raises:
            UnusableModel: as for `__call__`.
        """
        return self.load().seen_rows


@functools.lru_cache(8)
def _load(path: Path) -> Driver:
    return Driver.load(path)


def expert_policy(episode: Episode) -> SteeringPolicy:
    """Return the steering policy of the expert, who knows the road and ignores the frame: the best case."""
    expert = Expert(episode)
    return lambda _frame: expert.command()[0]


def seen_rows(driver: PolicyFactory) -> Rows:
    """Return the rows of a frame on which a driver's steering depends."""
    if driver is expert_policy:
        return NO_ROWS
    return driver.seen_rows if isinstance(driver, ModelPolicy) else WHOLE_FRAME


# A single episode


class Delay:
    """Queue of the commands between autopilot and car; the one that arrived last is in effect."""

    def __init__(self, ticks: int) -> None:
        """Delay commands by a number of ticks of 20 ms."""
        self.ticks = ticks
        self._waiting: deque[tuple[int, Command]] = deque()
        self._current: Command = (0.0, 0.0)

    def send(self, tick: int, command: Command) -> None:
        """Send the command for the frame of a tick."""
        self._waiting.append((tick + self.ticks, command))

    def at(self, tick: int) -> Command:
        """Return the command that is in effect at a tick."""
        while self._waiting and self._waiting[0][0] <= tick:
            self._current = self._waiting.popleft()[1]
        return self._current

    def straighten(self) -> None:
        """Discard the commands in transit and steer straight until the next one arrives: the car was put back."""
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
    """Drive an episode to its end; the result is deterministic.

    Args:
        episode: the car on its track, at the start position.
        picture: renders the centre camera's frame: 160x320x3 uint8 RGB.
        steer: steering policy.
        conditions: laps, speed, latency and lost frames.
        seed: seed of the random choice of lost frames.
        observe: called with every answer of the autopilot.

    Returns:
        the trajectory, with its interventions.

    Raises:
        RuntimeError: `steer` raised an exception, which is logged.
    """
    drive = driving(episode, picture, conditions, signature_of(steer), seed=seed, observe=observe)
    return drive_together([drive], lambda frames: [steer(frame) for frame in frames])[0]


def driving(
    episode: Episode,
    picture: Callable[[Episode], Frame],
    conditions: Conditions,
    signature: Signature = STEERING_ONLY,
    *,
    seed: int = 0,
    observe: Callable[[Answer], None] = lambda _: None,
) -> Drive:
    """Drive an episode like `drive_laps`, as a generator that leaves the steering to its caller.

    Yields:
        each frame as the autopilot receives it, 160x320x3 uint8 RGB (with a history in the signature: K x 160 x 320 x
            3); the steering or plan for it is to be sent.

    Returns:
        the trajectory, with its interventions.
    """
    answered: Answered = 0.0
    autopilot = Autopilot(lambda _: answered, conditions.speed, clock=lambda: episode.ticks * TICK)
    delay = Delay(round(conditions.latency_ms / 1000 / TICK))
    longest = time_limit(episode.track, conditions.laps, conditions.speed.speed)
    history = FrameHistory(signature)

    def put_back() -> None:
        delay.straighten()
        history.clear()

    referee = Referee(episode, laps=conditions.laps, seconds=longest, on_put_back=put_back)
    random = np.random.default_rng(seed)
    while not referee.over:
        if random.random() >= conditions.lost_frames:
            telemetry = parse_telemetry(build_telemetry(episode, picture(episode)))
            answered = yield history.add(episode.ticks * TICK, telemetry.frame)
            answer = autopilot.answer(telemetry)
            delay.send(episode.ticks, parse_steer(answer.message))
            observe(answer)
        for _ in range(TICKS):
            referee.observe(episode.advance(*delay.at(episode.ticks)))
    return referee.trajectory


def drive_together(drives: Sequence[Drive], steer: Callable[[list[Frame]], Sequence[Answered]]) -> list[Trajectory]:
    """Drive several episodes side by side to their ends, and return their trajectories.

    Args:
        drives: from `driving`.
        steer: returns the steering, or the plan, for the current frames of the drives that are not over.

    Raises:
        RuntimeError: `steer` raised an exception, which is logged.
    """
    frames: dict[int, Frame] = {}
    trajectories: dict[int, Trajectory] = {}

    def advance(number: int, answered: Answered | None) -> None:
        try:
            frames[number] = next(drives[number]) if answered is None else drives[number].send(answered)
        except StopIteration as end:
            frames.pop(number, None)
            trajectories[number] = end.value

    for number in range(len(drives)):
        advance(number, None)
    while frames:
        for number, answered in zip(list(frames), _steered(steer, list(frames.values())), strict=True):
            advance(number, answered)
    return [trajectories[number] for number in range(len(drives))]


def _steered(steer: Callable[[list[Frame]], Sequence[Answered]], frames: list[Frame]) -> Sequence[Answered]:
    try:
        return steer(frames)
    except Exception as error:
        log.exception("the model failed")
        raise RuntimeError("the model failed; see the error above") from error


# Episodes in worker processes


@dataclass(frozen=True)
class DriveRequest:
    """One episode to be driven, in any process.

    Attributes:
        driver: makes the steering policy; picklable.
        track: name of the track, such as lake or random:7 reversed.
        conditions: driving conditions.
        light: noon, evening or overcast; None: the track's default.
        start: seed of the start position and of the lost frames; None: the start line, and seed 0 for the lost frames.
        clip: path of the clip to be made; None: no clip.
    """

    driver: PolicyFactory
    track: str
    conditions: Conditions
    light: str | None = None
    start: int | None = None
    clip: Path | None = None


def run(request: DriveRequest) -> Trajectory:
    """Drive an episode in this process and return its trajectory.

    Raises:
        ValueError: there is no such track or light.
        UnusableModel: the model cannot be loaded.
        RuntimeError: the steering policy raised an exception.
        OSError: the clip cannot be written.
    """
    simulator = simulator_at(request)
    episode = simulator.episode
    rows = encoded_with(seen_rows(request.driver)) if request.clip is None else WHOLE_FRAME
    do = functools.partial(
        drive_laps,
        episode,
        functools.partial(_look_at, simulator, rows),
        request.driver(episode),
        request.conditions,
        seed=request.start or 0,
    )
    return do() if request.clip is None else _filmed(do, episode, request.clip)


def run_together(requests: Sequence[DriveRequest]) -> list[Trajectory]:
    """Drive several episodes on one track, with one model and without clips, side by side in this process.

    The network computes the steering for all of them at once. The trajectories are those of `run`, to the bit.

    Raises:
        ValueError, UnusableModel, RuntimeError: as for `run`.
    """
    driver = requests[0].driver
    if len(requests) == 1 or not isinstance(driver, ModelPolicy):  # only a model gains by it
        return [run(request) for request in requests]
    rows, model = encoded_with(seen_rows(driver)), driver.load()
    drives = []
    for request in requests:
        simulator = simulator_at(request)
        picture = functools.partial(_look_at, simulator, rows)
        drives.append(driving(simulator.episode, picture, request.conditions, model.signature, seed=request.start or 0))
    return drive_together(drives, model.plan_together)


def _look_at(simulator: Simulator, rows: Rows, episode: Episode) -> Frame:
    """Return the centre camera's frame in an episode on the simulator's track, of which only `rows` are rendered."""
    if rows == NO_ROWS:
        return np.zeros((ROWS, COLUMNS, 3), np.uint8)
    return simulator.renderer.render_episode(episode, rows=rows)["center"]


def simulator_at(request: DriveRequest) -> Simulator:
    """Return this process's simulator, with the car at the start position.

    Raises:
        ValueError: there is no such track or light.
    """
    simulator = _simulator()
    simulator.reset(request.track, request.start, request.light)
    return simulator


@functools.cache
def _simulator() -> Simulator:
    """Return the process's only simulator, because it keeps the scene of a track for the next episode."""
    return Simulator()


def _filmed(do: Callable[..., Trajectory], episode: Episode, clip: Path) -> Trajectory:
    """Drive an episode with `do` and make a clip of it."""
    with tempfile.TemporaryDirectory() as folder:
        recorder = Recorder(Path(folder), now=lambda: CLIP_START + timedelta(seconds=episode.ticks * TICK))
        try:
            trajectory = do(observe=recorder.observe)
        finally:
            recorder.close()
        film(Path(folder), clip)
    return trajectory


def film(folder: Path, clip: Path, fps: float = FRAMES_PER_SECOND) -> None:
    """Make a clip of a recording, with overlays of the steering wheel, the speed and the path.

    Args:
        folder: folder of the recording.
        clip: path of the video.
        fps: frames per second; by default those of the simulator's clock.

    Raises:
        OSError: the clip cannot be written.
    """
    make_clip(folder, clip, fps=fps, overlays=Overlays(wheel=True, speed=True, path=True))
