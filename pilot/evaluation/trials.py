"""What models are tried on, a row of the table each: tracks to drive, recordings to replay."""

import functools
import tempfile
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from datetime import timedelta
from pathlib import Path
from typing import Protocol

import numpy as np
import pandas as pd
from matplotlib.figure import Figure

from pilot.data.driving_log import part_of_each, read_driving_logs
from pilot.data.frames import encode_frame
from pilot.data.log_format import LOG_NAME
from pilot.driving.driver import Steer
from pilot.evaluation.closed_loop import CLIP_START, MakeSteer, ModelDriver, Task, film, run
from pilot.evaluation.over_socket import run_over_socket
from pilot.evaluation.pictures import draw_trajectories
from pilot.evaluation.plan import Setup
from pilot.evaluation.replay import Moment, Replayable, prepare, replay
from pilot.evaluation.replay_pictures import draw_replay
from pilot.evaluation.scores import Scores, Trajectory
from pilot.simulator.catalogue import load_track

Job = Callable[[], Sequence[Trajectory]]  # in any process: to be pickled


class Trial(Protocol):
    """A row of the table."""

    @property
    def title(self) -> str:
        """As the table names it."""

    @property
    def file(self) -> str:
        """As its pictures are called."""

    def jobs(self, driver: MakeSteer, clips: Path | None) -> list[Job]:
        """What is to be driven, in pieces that can be done side by side.

        Args:
            driver: who drives.
            clips: folder for a video of each; None makes none.
        """

    def draw(self, title: str, trajectories: Sequence[Trajectory], scores: Scores) -> Figure:
        """What came of it, as a picture."""


@dataclass(frozen=True)
class TrackTrial:
    """A track of the built-in simulator.

    Attributes:
        track: such as lake, or random:7 reversed. light: None is the track's own.
        starts: seeds of the start places; None starts at the start line.
        setup: how to drive.
        socket: whether through drive.py and its socket.
    """

    track: str
    light: str | None
    starts: tuple[int | None, ...]
    setup: Setup
    socket: bool = False

    @property
    def title(self) -> str:
        """As the table names it."""
        return self.track + (f", {self.light}" if self.light else "")

    @property
    def file(self) -> str:
        """As its pictures are called."""
        return self.title.replace(",", "").replace(":", "-").replace(" ", "-")

    def jobs(self, driver: MakeSteer, clips: Path | None) -> list[Job]:
        """A drive for each start place."""
        return [functools.partial(self._drive, driver, start, clips) for start in self.starts]

    def _drive(self, driver: MakeSteer, start: int | None, clips: Path | None) -> list[Trajectory]:
        clip = clips / f"{self.file}{'' if start is None else f'-{start}'}.mp4" if clips else None
        task = Task(driver, self.track, self.setup, self.light, start, clip)
        return [run_over_socket(task) if self.socket else run(task)]

    def draw(self, title: str, trajectories: Sequence[Trajectory], scores: Scores) -> Figure:
        """The road from above with the paths on it, and the place in the lane."""
        return draw_trajectories(title, load_track(self.track), trajectories, scores)


@dataclass(frozen=True, eq=False)
class RecordingTrial:
    """A recording that is replayed.

    Attributes:
        name: of it.
        recording: prepared.
    """

    name: str
    recording: Replayable

    @property
    def title(self) -> str:
        """As the table names it: with what a car is measured against."""
        return f"{self.name} (by the {'road' if self.recording.reference == 'road' else 'path of its driver'})"

    @property
    def file(self) -> str:
        """As its pictures are called."""
        return f"replay-{self.name}"

    def jobs(self, driver: MakeSteer, clips: Path | None) -> list[Job]:
        """All its stretches, one after another.

        Raises:
            ValueError: the driver steers by more than pictures.
        """
        if not isinstance(driver, ModelDriver):
            raise ValueError("the expert drives in the built-in simulator only: a recording has no road to know")
        return [functools.partial(self._replay, driver, clips / f"{self.file}.mp4" if clips else None)]

    def _replay(self, driver: ModelDriver, clip: Path | None) -> list[Trajectory]:
        if clip is None:
            return replay(self.recording, driver())
        with tempfile.TemporaryDirectory() as folder:
            return _filmed(Path(folder), self.recording, driver(), clip)

    def draw(self, title: str, trajectories: Sequence[Trajectory], scores: Scores) -> Figure:
        """The path, the place on the road, recorded and predicted steering."""
        return draw_replay(title, self.recording, trajectories, scores)


def prepare_trial(last_part: float, named: tuple[str, Path]) -> RecordingTrial:
    """Make the last share (0..1) of a recording, a name and its folder, ready to be replayed.

    Raises:
        NoUsableData: there is nothing in it.
        UnusableRecording: it cannot be replayed.
    """
    name, folder = named
    rows = part_of_each(read_driving_logs([folder]).rows, 1 - last_part, 1)
    return RecordingTrial(name, prepare(rows))


def _filmed(folder: Path, recording: Replayable, steer: Steer, clip: Path) -> list[Trajectory]:
    """Replay, and make a clip of what the model saw and did, by way of a drive as drive.py records it."""
    rows = pd.concat([stretch.rows for stretch in recording.stretches])
    fps = round(1 / float(rows["time"].diff().median()), 2)
    seen = [CLIP_START + timedelta(seconds=number / fps) for number in range(len(rows))]
    names = [f"{moment:%Y_%m_%d_%H_%M_%S}_{moment.microsecond // 1000:03d}.jpg" for moment in seen]
    unseen = iter(names)

    def keep(moment: Moment) -> None:
        (folder / next(unseen)).write_bytes(encode_frame(moment.frame))

    trajectory = replay(recording, steer, watch=keep)
    steering = np.concatenate([trajectory.steering for trajectory in trajectory])
    (folder / LOG_NAME).write_text(
        "".join(
            f"{name},,,{command:.6g},0,0,{speed:.6g}\n"
            for name, command, speed in zip(names, steering, rows["speed"], strict=True)
        )
    )
    film(folder, clip, fps)
    return trajectory
