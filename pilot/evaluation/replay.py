"""Replays a recording to a model: what it would have seen and where it would have gone, had it steered.

After NVIDIA (Bojarski et al., End to End Learning for Self-Driving Cars, arXiv 1604.07316, section 6):
recorded pictures are warped to where the model's car stands, the model steers, a bicycle model moves the
car at the recorded speed, and when it strays too far from where it should be, a person would have
intervened. NVIDIA's people marked by hand where the lane's middle was; here the road's middle is found
in the pictures (replay_road.py), and the car should be as far from it as the driver usually was. His
path itself would not do: a person wanders by a metre, and who keeps the middle would be blamed for it.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from pilot.driving_log import Progress, read_driving_logs
from pilot.evaluation.reference_path import (
    Array,
    Motion,
    UnusableRecording,
    drives,
    motion_of,
)
from pilot.evaluation.replay_road import Road, find_road
from pilot.evaluation.replay_view import view
from pilot.evaluation.scores import Driven, Intervention, Scores, measure
from pilot.frames import Frame
from pilot.log_format import CAMERAS
from pilot.simulator.car import MPH, path_curvature
from pilot.simulator.track import HALF_TRACK

Steer = Callable[[Frame], float]

UNCLEAR = 0.6  # clarity, below which the road's middle has been seen to be wrong


@dataclass(frozen=True)
class ReplayConfig:
    """When a replayed car has failed: with a wheel off the road, or too far from where it should be."""

    limit: float = 3.0
    """Metres from where it should be, at most; farther off, warped pictures show nothing useful."""
    start: float | None = None
    """Metres right of where it should be, where a drive begins; None: where the recorded car was, if on the road."""

    def check(self) -> None:
        """Refuse values that cannot work.

        Raises:
            ValueError: names the option, its value and what it may be.
        """
        if not 0.1 <= self.limit <= 4.0:
            raise ValueError(f"limit {self.limit:g}: takes 0.1 to 4 m; farther off the pictures show nothing useful")
        if self.start is not None and not abs(self.start) < self.limit:
            raise ValueError(f"start {self.start:g}: must lie within the limit of {self.limit:g} m")


@dataclass(frozen=True, eq=False)
class Moment:
    """What is shown to the model.

    Attributes:
        row: of the log; its Series.
        frame: 160x320x3 uint8 RGB, as the model's car sees it.
        offset: metres, heading: radians; to the right of where that car should be.
        beside: metres, turned: radians; to the right of the car that recorded.
        done: share of the drive, 0..1.
    """

    row: "pd.Series[Any]"
    frame: Frame
    offset: float
    heading: float
    beside: float
    turned: float
    done: float


Watch = Callable[[Moment], None]


@dataclass(frozen=True)
class ReplayResult:
    """What came of it.

    Attributes:
        drives: what the replayed car did in each stretch that was recorded without a break.
        half_widths: metres from the middle to the edge of the road, as seen in each.
        clarity: 0..1, how clearly the road was seen; below `UNCLEAR` the figures mean little.
        driver_failed: share of the moments (0..1) in which the driver who recorded was himself beyond the limit.
        limit: metres from where the car should be, that counted as an intervention.
    """

    drives: tuple[Driven, ...]
    half_widths: tuple[float, ...]
    clarity: float
    driver_failed: float
    limit: float

    def scores(self, title: str) -> Scores:
        """As of a drive in the simulator."""
        return measure(title, self.drives)


@dataclass(frozen=True)
class Stretch:
    """A stretch of a recording that was driven without a break, with what it takes to replay it.

    Attributes:
        rows: of the log. motion: of the car. road: that it drove on.
        lane: metres to the right of the road's middle, where the car should be: the driver's usual place.
    """

    rows: pd.DataFrame
    motion: Motion
    road: Road
    lane: float

    @property
    def driver(self) -> Array:
        """Metres by which the driver who recorded was to the right of where he should be, row by row."""
        return self.road.line.offsets - self.lane

    def failed(self, offset: Array | float, limit: float) -> NDArray[np.bool_]:
        """Whether a person would intervene, with a car that many metres to the right of where it should be."""
        off_road = np.abs(offset + self.lane) > self.road.half_width - HALF_TRACK
        return np.asarray(off_road | (np.abs(offset) > limit))


def prepare(rows: pd.DataFrame) -> list[Stretch]:
    """Find the road in a log's rows (`DrivingLog.rows`); once, for any number of models.

    Raises:
        UnusableRecording: nothing in it can be replayed.
        UnreadableImage: a picture cannot be read.
    """
    parts = list(drives(rows))
    if not parts:
        raise UnusableRecording("no drive of five seconds in it: record a lap without recoveries")
    motions = [motion_of(part) for part in parts]
    roads = [find_road(list(part["center"]), motion) for part, motion in zip(parts, motions, strict=True)]
    lane = float(np.median(np.concatenate([road.line.offsets for road in roads])))
    return [Stretch(*each, lane) for each in zip(parts, motions, roads, strict=True)]


def replay_recording(folder: Path, steer: Steer, config: ReplayConfig = ReplayConfig(), *,
                     progress: Progress | None = None, watch: Watch = lambda _: None) -> ReplayResult:
    """Replay a recording (a folder, or its driving_log.csv).

    Args:
        folder: it lies in.
        steer: frame → steering, such as `Driver.steer`.
        config: when the car has failed.
        progress: as in `read_driving_logs`.
        watch: is shown each moment before the model steers.

    Raises:
        NoUsableData: as `read_driving_logs`.
        UnusableRecording: as `prepare`.
    """
    return replay(read_driving_logs([folder], progress).rows, steer, config, watch)


def replay(rows: pd.DataFrame, steer: Steer, config: ReplayConfig = ReplayConfig(),
           watch: Watch = lambda _: None) -> ReplayResult:
    """Replay the rows of a log; as `replay_recording`."""
    return replay_stretches(prepare(rows), steer, config, watch)


def replay_stretches(stretches: list[Stretch], steer: Steer, config: ReplayConfig = ReplayConfig(),
                     watch: Watch = lambda _: None) -> ReplayResult:
    """Replay what has been prepared.

    Raises:
        ValueError: an option's value makes no sense.
    """
    config.check()
    driven = tuple(_replay(stretch, steer, config, watch) for stretch in stretches)
    rows = [len(stretch.rows) for stretch in stretches]
    clarity = np.average([stretch.road.clarity for stretch in stretches], weights=rows)
    beyond = [stretch.failed(stretch.driver, config.limit).mean() for stretch in stretches]
    half_widths = tuple(stretch.road.half_width for stretch in stretches)
    return ReplayResult(driven, half_widths, float(clarity), float(np.average(beyond, weights=rows)), config.limit)


def _replay(stretch: Stretch, steer: Steer, config: ReplayConfig, watch: Watch) -> Driven:
    car = _Car(stretch)
    if config.start is not None or stretch.failed(car.offset, config.limit):
        car.put(config.start or 0.0)
    offsets, headings, commands, failed = [], [], [], []
    for index, (_, row) in enumerate(stretch.rows.iterrows()):
        offsets.append(car.offset)
        headings.append(car.heading)
        if stretch.failed(car.offset, config.limit):
            failed.append(index)
            car.put(0.0)
        frame = view({name: row[name] for name in CAMERAS}, car.beside, car.turned)
        watch(Moment(row, frame, car.offset, car.heading, car.beside, car.turned, index / len(stretch.rows)))
        commands.append(min(max(steer(frame), -1.0), 1.0))
        car.advance(commands[-1])
    return _driven(stretch, np.array(offsets), np.array(headings), np.array(commands), failed)


class _Car:
    """The car that the model steers, beside the one that recorded; both drive at the same speed.

    Relative to the recorded car it moves by the difference of their steerings alone: whatever else moved
    that one (slip, slopes, a path reconstructed not quite right) moves both. Angles between the two are
    taken as small, and so are their distances against the radius of a bend.
    """

    def __init__(self, stretch: Stretch) -> None:
        self._stretch, self._index = stretch, 0
        self.beside, self.turned = 0.0, 0.0  # metres and radians to the right of the recorded car

    @property
    def offset(self) -> float:
        """Metres to the right of where it should be."""
        return float(self._stretch.driver[self._index]) + self.beside

    @property
    def heading(self) -> float:
        """Radians to the right of the road's direction."""
        return float(self._stretch.road.line.headings[self._index]) + self.turned

    def put(self, offset: float) -> None:
        """Put it `offset` metres to the right of where it should be, along the road."""
        self.beside, self.turned = self.beside + offset - self.offset, self.turned - self.heading

    def advance(self, steering: float) -> None:
        """Drive to the next row, unless this is the last."""
        motion, index = self._stretch.motion, self._index
        speed, step = float(motion.speeds[index]), float(motion.steps[index])
        turn = (path_curvature(steering, speed) - float(motion.curvatures[index])) * step
        self.beside += (self.turned + turn / 2) * step
        self.turned += turn
        self._index = min(index + 1, len(motion.steps) - 1)


def _driven(stretch: Stretch, offsets: Array, headings: Array, steering: Array, failed: Sequence[int]) -> Driven:
    """The drive as the simulator's are described; its map begins northwards at the origin."""
    motion, bends = stretch.motion, stretch.road.line.curvatures
    times, progress = _before(motion.seconds), _before(motion.steps)
    compass = _before(bends * motion.steps)
    right = np.stack([np.cos(compass), -np.sin(compass)], axis=1)
    middle = np.stack([_before(np.sin(compass) * motion.steps), _before(np.cos(compass) * motion.steps)], axis=1)
    positions = middle + offsets[:, None] * right
    interventions = tuple(Intervention(float(times[index]), float(positions[index, 0]), float(positions[index, 1]),
                                       float(progress[index]), "off the road") for index in failed)
    return Driven(times, positions, motion.speeds / MPH, steering, progress, offsets, headings, interventions)


def _before(amounts: Array) -> Array:
    """Sum of all before each entry."""
    return np.concatenate([[0.0], np.cumsum(amounts)[:-1]])
