"""Scenarios on which models are evaluated: tracks to drive and recordings to replay."""

import functools
import math
import tempfile
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from datetime import timedelta
from pathlib import Path
from typing import Protocol

import numpy as np
import pandas as pd
from matplotlib.figure import Figure

from pilot.data.driving_log import read_driving_logs, share_of_each
from pilot.data.frames import encode_frame
from pilot.data.log_format import LOG_NAME, format_line, time_stamp
from pilot.driving.plan import SteeringPolicy
from pilot.evaluation.closed_loop import CLIP_START, DriveRequest, ModelPolicy, PolicyFactory, film, run_together
from pilot.evaluation.conditions import Conditions
from pilot.evaluation.over_socket import run_over_socket
from pilot.evaluation.pictures import draw_trajectories
from pilot.evaluation.replay import Replayable, ReplayStep, prepare, replay
from pilot.evaluation.replay_pictures import draw_replay
from pilot.simulator.catalogue import file_name, load_track
from pilot.simulator.scores import Scores
from pilot.simulator.trajectory import Trajectory

DriveTask = Callable[[], Sequence[Trajectory]]  # picklable, because it runs in a worker process
MOST_TOGETHER = 8  # drives side by side; more save no more time


class Scenario(Protocol):
    """What a model is evaluated on: one row of the score table."""

    @property
    def title(self) -> str:
        """Name in the table."""

    @property
    def file(self) -> str:
        """Stem of the names of its figure and clips."""

    def drive_tasks(self, driver: PolicyFactory, clips: Path | None, processes: int) -> list[DriveTask]:
        """Return tasks that can run in parallel; each returns its trajectories.

        Args:
            driver: makes the steering policy.
            clips: folder for a clip of each drive; None: no clips.
            processes: number of processes in which the tasks will run.
        """

    def draw(self, title: str, trajectories: Sequence[Trajectory], scores: Scores) -> Figure:
        """Draw the trajectories and the main scores; `title` is the first part of the heading."""


@dataclass(frozen=True)
class TrackScenario:
    """A track of the built-in simulator.

    Attributes:
        track: name of the track, such as lake or random:7 reversed.
        light: noon, clear, evening or overcast; None: the track's default.
        starts: seeds of the start positions, one episode each; None: the start line.
        conditions: driving conditions.
        socket: whether drive.py drives through its socket.
    """

    track: str
    light: str | None
    starts: tuple[int | None, ...]
    conditions: Conditions
    socket: bool = False

    @property
    def title(self) -> str:
        """Name in the table."""
        return self.track + (f", {self.light}" if self.light else "")

    @property
    def file(self) -> str:
        """Stem of the names of its figure and clips."""
        return file_name(self.title)

    def drive_tasks(self, driver: PolicyFactory, clips: Path | None, processes: int) -> list[DriveTask]:
        """Return tasks for the start positions, of which each process drives its share side by side."""
        requests = [
            DriveRequest(driver, self.track, self.conditions, self.light, start, self._clip(clips, start))
            for start in self.starts
        ]
        if self.socket:
            return [functools.partial(_over_socket, request) for request in requests]
        together = 1 if clips else min(math.ceil(len(requests) / processes), MOST_TOGETHER)
        groups = [requests[first : first + together] for first in range(0, len(requests), together)]
        # not a method: a worker process would import all that scenarios need, such as matplotlib, to unpickle it
        return [functools.partial(run_together, group) for group in groups]

    def _clip(self, folder: Path | None, start: int | None) -> Path | None:
        return folder / f"{self.file}{'' if start is None else f'-{start}'}.mp4" if folder else None

    def draw(self, title: str, trajectories: Sequence[Trajectory], scores: Scores) -> Figure:
        """Draw the paths on the road from above, and the cross-track errors along the lap."""
        return draw_trajectories(title, load_track(self.track), trajectories, scores)


def _over_socket(request: DriveRequest) -> list[Trajectory]:
    return [run_over_socket(request)]


@dataclass(frozen=True, eq=False)
class RecordingScenario:
    """A recording that is replayed.

    Attributes:
        name: name of the recording.
        recording: recording from `prepare`.
    """

    name: str
    recording: Replayable

    @property
    def title(self) -> str:
        """Name in the table, with the kind of reference line."""
        return f"{self.name} (by the {'road' if self.recording.reference == 'road' else 'path of its driver'})"

    @property
    def file(self) -> str:
        """Stem of the names of its figure and clips."""
        return f"replay-{self.name}"

    def drive_tasks(self, driver: PolicyFactory, clips: Path | None, processes: int) -> list[DriveTask]:
        """Return one task that replays all segments.

        Raises:
            ValueError: the driver is the expert, which needs the track's geometry.
        """
        if not isinstance(driver, ModelPolicy):
            raise ValueError("the expert drives in the built-in simulator only: a recording has no track geometry")
        return [functools.partial(self._replay, driver, clips / f"{self.file}.mp4" if clips else None)]

    def _replay(self, driver: ModelPolicy, clip: Path | None) -> list[Trajectory]:
        if clip is None:
            return replay(self.recording, driver())
        with tempfile.TemporaryDirectory() as folder:
            return _filmed(Path(folder), self.recording, driver(), clip)

    def draw(self, title: str, trajectories: Sequence[Trajectory], scores: Scores) -> Figure:
        """Draw the paths, the cross-track errors, and the recorded and predicted steering."""
        return draw_replay(title, self.recording, trajectories, scores)


def prepare_scenario(last_part: float, named: tuple[str, Path]) -> RecordingScenario:
    """Read the last part of a recording and prepare it for replays.

    Args:
        last_part: share of the recording to replay, 0..1, counted from its end.
        named: name and folder of the recording.

    Raises:
        NoUsableData: the recording contains no usable rows.
        UnusableRecording: the recording cannot be replayed.
    """
    name, folder = named
    rows = share_of_each(read_driving_logs([folder]).rows, 1 - last_part, 1)
    return RecordingScenario(name, prepare(rows))


def _filmed(folder: Path, recording: Replayable, steer: SteeringPolicy, clip: Path) -> list[Trajectory]:
    """Replay, and make a clip of the warped frames and the steering, which are first recorded into `folder`."""
    rows = pd.concat([segment.rows for segment in recording.segments])
    fps = round(1 / float(rows["time"].diff().median()), 2)
    names = [f"{time_stamp(CLIP_START + timedelta(seconds=number / fps))}.jpg" for number in range(len(rows))]
    remaining_names = iter(names)

    def keep(step: ReplayStep) -> None:
        (folder / next(remaining_names)).write_bytes(encode_frame(step.frame))

    trajectories = replay(recording, steer, watch=keep)
    steering = np.concatenate([trajectory.steering for trajectory in trajectories])
    lines = [
        format_line([name, "", ""], command, 0.0, speed)
        for name, command, speed in zip(names, steering, rows["speed"], strict=True)
    ]
    (folder / LOG_NAME).write_text("".join(lines))
    film(folder, clip, fps)
    return trajectories
