"""Drives of a model that the expert corrects, recorded with the expert's labels.

Recorded is where the model leads the car, with the steering of the expert there: S. Ross et al., A Reduction of
Imitation Learning and Structured Prediction to No-Regret Online Learning (2011), arXiv 1011.0686 (DAgger). The expert
takes over only before the car would leave the road, as a person would do: M. Kelly et al., HG-DAgger: Interactive
Imitation Learning with Human Experts (2019), arXiv 1810.02890. The places of the takeovers, and places anywhere on the
road, are then recorded from many more positions, for which the car is simply put there: a view that needs no driving
costs a tenth of one that does.
"""

import math
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np

from pilot.arrays import Frame
from pilot.data.recording_writer import RecordingWriter
from pilot.driving.plan import Plan, SteeringPolicy, signature_of
from pilot.evaluation.closed_loop import DriveRequest, ModelPolicy, drive_laps, simulator_at
from pilot.evaluation.conditions import Conditions
from pilot.simulator.camera_variation import STANDARD, draw_variation
from pilot.simulator.demonstration import PAUSE, lines, recovery_start
from pilot.simulator.episode import Episode
from pilot.simulator.expert import Expert
from pilot.simulator.simulator import TICKS, Simulator
from pilot.simulator.track import STEP
from pilot.vehicle import TICK

AHEAD_SECONDS = 0.5  # the expert takes over if the car will be off the road then
CLEARANCE = 0.3  # metres from the edge at which it takes over
SAFE_METRES, SAFE_HEADING = 0.5, math.radians(4.0)  # deviations from the expert's line with which it gives back
FRAMES_PER_ROW = 5  # of 40 ms each; neighbouring frames are near duplicates
VIEWS = 60  # recorded around the place of each takeover, and as many anywhere on the road, from random positions
VIEWS_BEFORE, VIEWS_BEHIND = 20.0, 10.0  # metres before and behind the place of a takeover
VIEW_HEADING = math.radians(12.0)  # standard deviation of their heading errors
VIEW_MPH = 15.0  # the steering does not depend on the speed
# A drive through a bend, where models fail most, is short and begins at speed: a round sees the more roads for that.
BEFORE_BEND, BEND_METRES, BEND_MPH = 40.0, 70.0, 20.0
LINE_SPREAD = 0.3  # as in the demonstrations: the expert returns to the nearest line of the middle part of the road


@dataclass(frozen=True)
class CorrectedDrive:
    """Result of a drive.

    Attributes:
        track: name of the track.
        takeovers: number of times that the expert took over.
        rows: number of rows recorded.
        seconds: driven time, on the simulator's clock.
    """

    track: str
    takeovers: int
    rows: int
    seconds: float


@dataclass(frozen=True)
class CorrectedDriveRequest:
    """A drive to be made and recorded, in any process.

    Attributes:
        model: path of the model.
        track: name of the track, such as random:7 reversed.
        folder: of the recording.
        conditions: driving conditions.
        start: seed of the start position, and of all that is random; None: the start line, and seed 0.
        through_bend: drive only `BEND_METRES` through the track's tightest bend, in place of the laps from the start.
    """

    model: Path
    track: str
    folder: Path
    conditions: Conditions = field(default_factory=Conditions)
    start: int | None = None
    through_bend: bool = False


def drive_corrected(request: CorrectedDriveRequest) -> CorrectedDrive:
    """Drive and record one episode in this process.

    Raises:
        ValueError: there is no such track.
        UnusableModel: the model cannot be loaded.
        OSError: the recording cannot be written.
    """
    policy = ModelPolicy(request.model)
    simulator = simulator_at(DriveRequest(policy, request.track, request.conditions, start=request.start))
    conditions = to_tightest_bend(simulator.episode, request.conditions) if request.through_bend else request.conditions
    with RecordingWriter(request.folder) as writer:
        corrected = CorrectedPolicy(simulator.episode, policy(), writer)
        trajectory = drive_laps(
            simulator.episode,
            lambda _: simulator.look()["center"],
            corrected,
            conditions,
            seed=request.start or 0,
        )
        corrected.record_views(simulator, request.start or 0)
        return CorrectedDrive(request.track, len(corrected.takeovers), writer.rows, trajectory.seconds)


def to_tightest_bend(episode: Episode, conditions: Conditions) -> Conditions:
    """Place the car before the track's tightest bend; returns the conditions of a drive through it."""
    track = episode.track
    bend = float(np.argmax(np.abs(track.curvatures))) * STEP
    episode.place((bend - BEFORE_BEND) % track.length, speed=BEND_MPH)
    return replace(conditions, laps=BEND_METRES / track.length)


class CorrectedPolicy:
    """Steering policy of a model that the expert corrects; records what the expert would do at each moment.

    Attributes:
        takeovers: where the expert took over, metres along the track.
        corrects: whether the expert steers.
        signature: what the model sees and answers.
    """

    def __init__(self, episode: Episode, steer: SteeringPolicy, writer: RecordingWriter) -> None:
        """Create the policy for an episode.

        Args:
            episode: that is driven.
            steer: the model's steering policy.
            writer: of the recording.
        """
        self.episode, self.steer, self.writer = episode, steer, writer
        self.signature = signature_of(steer)
        self.takeovers: list[float] = []
        self._expert = Expert(episode, speed=30.0)
        self._lines = lines(episode.track, LINE_SPREAD)
        self.corrects = False
        self._frames = 0
        self._seconds = 0.0  # time of the last row

    def __call__(self, frame: Frame) -> float | Plan:
        """Return the answer to a frame, or to a history of frames: the model's, or the expert's while it corrects."""
        command = self._expert_command()
        if self._frames % FRAMES_PER_ROW == 0:
            newest = frame[0] if self.signature.history else frame
            self.record(newest, command, FRAMES_PER_ROW * TICKS * TICK)
        self._frames += 1
        self._decide()
        return command[0] if self.corrects else self.steer(frame)

    def _expert_command(self) -> tuple[float, float]:
        self._expert.follow(float(np.clip(self.episode.where.lateral_offset, *self._lines)))
        return self._expert.command()

    def record(self, frame: Frame, command: tuple[float, float], pause: float, quality: int = STANDARD.quality) -> None:
        """Record what the expert would do.

        Args:
            frame: what is seen: 160x320x3 uint8 RGB.
            command: steering and throttle of the expert, -1..1 each.
            pause: seconds since the row before.
            quality: of the JPEG image, 0..100.
        """
        self._seconds += pause
        speed = max(self.episode.state.speed, 0.0)
        self.writer.write({"center": frame}, self._seconds, command, speed, quality=quality, steerer="expert")

    def _decide(self) -> None:
        """Let the expert take over, or give back."""
        state, where, track = self.episode.state, self.episode.where, self.episode.track
        drift = self.episode.car.speed * math.sin(state.heading_error) * AHEAD_SECONDS
        edge = track.largest_offset - CLEARANCE
        if not self.corrects and abs(where.lateral_offset + drift) > edge:
            self.corrects = True
            self.takeovers.append(where.progress)
        elif abs(self._expert.error) < SAFE_METRES and abs(state.heading_error) < SAFE_HEADING:
            self.corrects = False

    def record_views(self, simulator: Simulator, seed: int) -> None:
        """Record what the expert would do around the places of the takeovers, and anywhere on the road."""
        random = np.random.default_rng(seed)
        track, edge = self.episode.track, self.episode.track.largest_offset
        for place in self._view_places(random):
            offset, heading = float(random.uniform(-edge, edge)), float(random.normal(0, VIEW_HEADING))
            self.episode.place(place, offset - track.lane, heading, VIEW_MPH)
            variation = draw_variation(random)
            self.record(simulator.look(variation)["center"], self._expert_command(), PAUSE, variation.quality)

    def _view_places(self, random: np.random.Generator) -> list[float]:
        """Return places in metres along the track."""
        track = self.episode.track
        near = [
            (place + float(random.uniform(-VIEWS_BEFORE, VIEWS_BEHIND))) % track.length
            for place in self.takeovers
            for _ in range(VIEWS)
        ]
        return near + [recovery_start(track, float(random.uniform())) for _ in range(VIEWS)]
