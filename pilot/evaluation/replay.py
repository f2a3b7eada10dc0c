"""Replays a recording to a model: what it would have seen and where it would have gone, had it steered.

After NVIDIA (Bojarski et al., End to End Learning for Self-Driving Cars, arXiv 1604.07316, section 6):
recorded pictures are warped to where the model's car stands, the model steers, a bicycle model moves the
car at the recorded speed, and when it strays too far from where it should be, a person would have
intervened. NVIDIA's people marked by hand where the lane's middle was; here the road's middle is found
in the pictures (replay_road.py), and the car should be as far from it as the driver usually was. His
path itself would not do: a person wanders by a metre, and who keeps the middle would be blamed for it.
Where the road does not show clearly (hard shadows, no edges), a smooth line through his path must do.
Where he drove himself, a person would not intervene: what was good enough for him is for the model, too.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
import pandas as pd

from pilot.arrays import Floats, Frame
from pilot.driving.driver import SteeringPolicy
from pilot.evaluation.reference_path import Line, Motion, UnusableRecording, continuous_segments, fit_line, motion_of
from pilot.evaluation.replay_road import PATH_SPREAD, find_road
from pilot.evaluation.replay_view import view
from pilot.simulator.car import path_curvature
from pilot.simulator.trajectory import Intervention, Trajectory
from pilot.vehicle import CAMERAS, HALF_TRACK, MPH

Reference = Literal["road", "path"]

UNCLEAR = 0.6  # clarity, below which the road's middle has been seen to be wrong
LIMITS: dict[Reference, float] = {"road": 3.0, "path": 2.0}  # metres; farther off, warped pictures show little
DRIVER_MARGIN = 0.5  # metres that a car may be farther off than the driver was himself


@dataclass(frozen=True)
class ReplayConfig:
    """When a replayed car has failed: with a wheel off the road, or too far from where it should be."""

    limit: float | None = None
    """Metres from where it should be, at most; None takes that of the reference (`LIMITS`)."""
    start: float | None = None
    """Metres right of where it should be, where a drive begins; None: where the recorded car was."""

    def check(self) -> None:
        """Refuse values that cannot work.

        Raises:
            ValueError: names the option, its value and what it may be.
        """
        limit = min(LIMITS.values()) if self.limit is None else self.limit
        if not 0.1 <= limit <= 4.0:
            raise ValueError(f"limit {limit:g}: takes 0.1 to 4 m; farther off the pictures show nothing useful")
        if self.start is not None and not abs(self.start) < limit:
            raise ValueError(f"start {self.start:g}: must lie within the limit of {limit:g} m")


@dataclass(frozen=True, eq=False)
class ReplayStep:
    """What is shown to the model.

    Attributes:
        row: of the log; its Series.
        frame: 160x320x3 uint8 RGB, as the model's car sees it.
        offset: metres, heading: radians; to the right of where that car should be.
        beside: metres, turned: radians; to the right of the car that recorded.
    """

    row: "pd.Series[Any]"
    frame: Frame
    offset: float
    heading: float
    lateral_shift: float
    heading_shift: float


StepObserver = Callable[[ReplayStep], None]


@dataclass(frozen=True, eq=False)
class ReplaySegment:
    """A part of a recording that was driven without a break, with what it takes to replay it.

    Attributes:
        rows: of the log.
        motion: of the car that recorded.
        line: along the road, and where that car stood beside it.
        lane: metres to the right of the line, where a car should be.
        half_widths: metres from the line to the road's edge, row by row; infinite where that is not known.
    """

    rows: pd.DataFrame
    motion: Motion
    line: Line
    half_widths: Floats
    lane: float = 0.0

    @property
    def driver(self) -> Floats:
        """Metres by which the car that recorded was to the right of where it should be, row by row."""
        return self.line.offsets - self.lane

    def allowed(self, limit: float) -> tuple[Floats, Floats]:
        """Metres to the right of where it should be, between which a person lets a car drive, row by row."""
        edges = self.half_widths - HALF_TRACK
        lowest = np.minimum(np.maximum(-limit, -edges - self.lane), self.driver - DRIVER_MARGIN)
        highest = np.maximum(np.minimum(limit, edges - self.lane), self.driver + DRIVER_MARGIN)
        return lowest, highest


@dataclass(frozen=True)
class Replayable:
    """A recording, prepared for any number of models.

    Attributes:
        segments: driven without a break.
        reference: what a car is measured against: its usual place on the road, or the smoothed path of the driver.
        clarity: 0..1, how clearly the road was seen.
    """

    segments: tuple[ReplaySegment, ...]
    reference: Reference
    clarity: float


def prepare(rows: pd.DataFrame) -> Replayable:
    """Find the road in a log's rows (`DrivingLog.rows`), or if it does not show clearly, the driver's smoothed path.

    Raises:
        UnusableRecording: nothing in it can be replayed.
        UnreadableImage: a picture cannot be read.
    """
    parts = list(continuous_segments(rows))
    if not parts:
        raise UnusableRecording("no drive of five seconds in it: record a lap without recoveries")
    motions = [motion_of(part) for part in parts]
    roads = [find_road(list(part["center"]), motion) for part, motion in zip(parts, motions, strict=True)]
    clarity = float(np.average([road.clarity for road in roads], weights=list(map(len, parts))))
    if clarity < UNCLEAR:
        return Replayable(tuple(map(along_path, parts, motions)), "path", clarity)
    lane = float(np.median(np.concatenate([road.line.offsets for road in roads])))
    segments = [
        ReplaySegment(part, motion, road.line, road.half_widths, lane)
        for part, motion, road in zip(parts, motions, roads, strict=True)
    ]
    return Replayable(tuple(segments), "road", clarity)


def along_path(rows: pd.DataFrame, motion: Motion) -> ReplaySegment:
    """A segment whose reference is the driver's own path, smoothed as roads are smooth."""
    count = len(rows)
    return ReplaySegment(
        rows, motion, fit_line(motion, np.zeros(count), np.full(count, PATH_SPREAD)), np.full(count, np.inf)
    )


def replay(
    recording: Replayable,
    steer: SteeringPolicy,
    config: ReplayConfig = ReplayConfig(),
    watch: StepObserver = lambda _: None,
) -> list[Trajectory]:
    """Replay a recording.

    Args:
        recording: as `prepare` returns it.
        steer: frame → steering, such as `Driver.steer`.
        config: when the car has failed.
        watch: is shown each moment before the model steers.

    Returns:
        what the replayed car did in each segment.

    Raises:
        ValueError: an option's value makes no sense.
    """
    config.check()
    limit = LIMITS[recording.reference] if config.limit is None else config.limit
    return [_replay(segment, steer, limit, config.start, watch) for segment in recording.segments]


def _replay(
    segment: ReplaySegment, steer: SteeringPolicy, limit: float, start: float | None, watch: StepObserver
) -> Trajectory:
    car = _ReplayedCar(segment)
    if start is not None:
        car.put(start)
    offsets, headings, commands, failed = [], [], [], []
    lowest, highest = segment.allowed(limit)
    for index, (_, row) in enumerate(segment.rows.iterrows()):
        offsets.append(car.offset)
        headings.append(car.heading)
        if not lowest[index] <= car.offset <= highest[index]:
            failed.append(index)
            car.put(0.0)
        frame = view({name: row[name] for name in CAMERAS}, car.lateral_shift, car.heading_shift)
        watch(ReplayStep(row, frame, car.offset, car.heading, car.lateral_shift, car.heading_shift))
        commands.append(min(max(steer(frame), -1.0), 1.0))
        car.advance(commands[-1])
    return _trajectory(segment, np.array(offsets), np.array(headings), np.array(commands), failed)


class _ReplayedCar:
    """The car that the model steers, beside the one that recorded; both drive at the same speed.

    Relative to the recorded car it moves by the difference of their steerings alone: whatever else moved
    that one (slip, slopes, a path reconstructed not quite right) moves both. Angles between the two are
    taken as small, and so are their distances against the radius of a bend.
    """

    def __init__(self, segment: ReplaySegment) -> None:
        self._segment, self._index = segment, 0
        self.lateral_shift, self.heading_shift = 0.0, 0.0  # metres and radians to the right of the recorded car

    @property
    def offset(self) -> float:
        """Metres to the right of where it should be."""
        return float(self._segment.driver[self._index]) + self.lateral_shift

    @property
    def heading(self) -> float:
        """Radians to the right of the road's direction."""
        return float(self._segment.line.headings[self._index]) + self.heading_shift

    def put(self, offset: float) -> None:
        """Put it `offset` metres to the right of where it should be, along the road."""
        self.lateral_shift, self.heading_shift = (
            self.lateral_shift + offset - self.offset,
            self.heading_shift - self.heading,
        )

    def advance(self, steering: float) -> None:
        """Drive to the next row, unless this is the last."""
        motion, index = self._segment.motion, self._index
        speed, step = float(motion.speeds[index]), float(motion.steps[index])
        turn = (path_curvature(steering, speed) - float(motion.curvatures[index])) * step
        self.lateral_shift += (self.heading_shift + turn / 2) * step
        self.heading_shift += turn
        self._index = min(index + 1, len(motion.steps) - 1)


def _trajectory(
    segment: ReplaySegment, offsets: Floats, headings: Floats, steering: Floats, failed: Sequence[int]
) -> Trajectory:
    """The drive as the simulator's are described; its map begins northwards at the origin."""
    motion, bends = segment.motion, segment.line.curvatures
    times, progress = _before(motion.seconds), _before(motion.steps)
    compass = _before(bends * motion.steps)
    right = np.stack([np.cos(compass), -np.sin(compass)], axis=1)
    middle = np.stack([_before(np.sin(compass) * motion.steps), _before(np.cos(compass) * motion.steps)], axis=1)
    positions = middle + offsets[:, None] * right
    interventions = tuple(
        Intervention(
            float(times[index]),
            float(positions[index, 0]),
            float(positions[index, 1]),
            float(progress[index]),
            "off the road",
        )
        for index in failed
    )
    return Trajectory(times, positions, motion.speeds / MPH, steering, progress, offsets, headings, interventions)


def _before(amounts: Floats) -> Floats:
    """Sum of all before each entry."""
    return np.concatenate([[0.0], np.cumsum(amounts)[:-1]])
