"""Replays of recordings: a model steers a car whose frames are warped from the recorded ones.

The method follows NVIDIA's simulator (Bojarski et al., End to End Learning for Self-Driving Cars, arXiv 1604.07316,
section 6): the recorded frame is warped to the position of the replayed car, the model steers, a bicycle model moves
the car at the recorded speed, and an intervention is counted when the car is too far from a reference line.

NVIDIA labelled the lane's middle by hand. Here a network finds the road in the images (replay_road.py), and the
reference line runs parallel to it, at the median lateral offset of the recorded car. The recorded path itself is a
worse reference: a person's lateral offset varies by about a metre, which would count as an error of a model that keeps
to the middle. The smoothed recorded path is used only if the images do not show the road.
Positions close to that of the recorded car are always allowed, because the person accepted them.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
import pandas as pd

from pilot.arrays import Floats, Frame, sums_before
from pilot.data.motion import Motion, motion_of
from pilot.driving.plan import FrameHistory, SteeringPolicy, as_plan, signature_of
from pilot.evaluation.reference_path import SHORTEST_SEGMENT, Line, UnusableRecording, continuous_segments, fit_line
from pilot.evaluation.replay_road import PATH_SPREAD, find_road
from pilot.evaluation.replay_view import view
from pilot.simulator.trajectory import Intervention, Trajectory
from pilot.vehicle import CAMERAS, HALF_TRACK, MPH, path_curvature

Reference = Literal["road", "path"]

UNCLEAR = 0.2  # below this clarity, the road is not seen
LIMITS: dict[Reference, float] = {
    "road": 3.0,
    "path": 2.0,
}  # metres; frames that are warped farther show little of the road
DRIVER_MARGIN = 0.5  # metres to each side of the recorded car that are always allowed


@dataclass(frozen=True)
class ReplayConfig:
    """When a replay counts an intervention, and where the car starts.

    An intervention is counted if a wheel is off the road or the cross-track error exceeds the limit.
    """

    limit: float | None = None
    """Largest absolute cross-track error in metres; None: the default of the reference (`LIMITS`)."""
    start: float | None = None
    """Cross-track error in metres at the start of each segment; None: that of the recorded car."""

    def check(self) -> None:
        """Check the values.

        Raises:
            ValueError: a value is invalid; the message names the option, its value and the valid range.
        """
        limit = min(LIMITS.values()) if self.limit is None else self.limit
        if not 0.1 <= limit <= 4.0:
            raise ValueError(f"limit {limit:g}: must be in 0.1..4 m")
        if self.start is not None and not abs(self.start) < limit:
            raise ValueError(f"start {self.start:g}: must lie within the limit of {limit:g} m")


@dataclass(frozen=True, eq=False)
class ReplayStep:
    """One time step of a replay, before the model steers.

    Attributes:
        row: row of the driving log.
        frame: 160x320x3 uint8 RGB, warped to the replayed car's position.
        offset: cross-track error of the replayed car in metres.
        heading: heading error of the replayed car in radians.
        lateral_shift: metres by which the replayed car is to the right of the recorded car.
        heading_shift: radians by which it is turned to the right relative to the recorded car.
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
    """A segment of a recording of n rows, with the data for replaying it.

    Attributes:
        rows: rows of the driving log.
        motion: motion of the recorded car.
        line: line along the road, with the recorded car's position relative to it.
        half_widths: n, metres from the line to the road's edge; infinite if unknown.
        lane: lateral offset of the reference line from `line` in metres, right is positive.
    """

    rows: pd.DataFrame
    motion: Motion
    line: Line
    half_widths: Floats
    lane: float = 0.0

    @property
    def driver(self) -> Floats:
        """Cross-track error of the recorded car in metres (n)."""
        return self.line.offsets - self.lane

    def allowed_errors(self, limit: float) -> tuple[Floats, Floats]:
        """Return the lowest and the highest allowed cross-track error in metres (n each).

        Args:
            limit: largest absolute cross-track error in metres. The range is narrower where a wheel would be off the
                road, and always includes `DRIVER_MARGIN` to each side of the recorded car.
        """
        edges = self.half_widths - HALF_TRACK
        lowest = np.minimum(np.maximum(-limit, -edges - self.lane), self.driver - DRIVER_MARGIN)
        highest = np.maximum(np.minimum(limit, edges - self.lane), self.driver + DRIVER_MARGIN)
        return lowest, highest


@dataclass(frozen=True)
class Replayable:
    """A recording that is prepared for replays with any number of models.

    Attributes:
        segments: segments of the recording.
        reference: reference line: parallel to the road's middle ("road"), or the smoothed recorded path ("path").
        clarity: 0..1, how clearly the road is visible, see `Road`.
    """

    segments: tuple[ReplaySegment, ...]
    reference: Reference
    clarity: float


def prepare(rows: pd.DataFrame) -> Replayable:
    """Detect the road in a recording; if it is not clearly visible, use the smoothed recorded path.

    Args:
        rows: rows of a driving log, as in `DrivingLog.rows`.

    Raises:
        UnusableRecording: the rows have no speed or are too few per second, or no segment is long enough.
        UnreadableImage: an image cannot be read.
    """
    parts = list(continuous_segments(rows))
    if not parts:
        raise UnusableRecording(f"no segment of at least {SHORTEST_SEGMENT:g} s: record a lap without recoveries")
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
    """Return a segment whose reference line is the recorded path, smoothed."""
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
        recording: recording from `prepare`.
        steer: steering policy, such as `Driver.steer`; its steering is clipped to -1..1.
        config: limit and start.
        watch: called at each time step before the model steers.

    Returns:
        one trajectory per segment.

    Raises:
        ValueError: a value of `config` is invalid.
        UnreadableImage: an image cannot be read.
    """
    config.check()
    limit = LIMITS[recording.reference] if config.limit is None else config.limit
    return [_replay(segment, steer, limit, config.start, watch) for segment in recording.segments]


def _replay(
    segment: ReplaySegment, steer: SteeringPolicy, limit: float, start: float | None, watch: StepObserver
) -> Trajectory:
    car, history = _ReplayedCar(segment), FrameHistory(signature_of(steer))
    if start is not None:
        car.put(start)
    offsets, headings, commands, intervention_rows = [], [], [], []
    lowest, highest = segment.allowed_errors(limit)
    for index, (_, row) in enumerate(segment.rows.iterrows()):
        offsets.append(car.offset)
        headings.append(car.heading)
        if not lowest[index] <= car.offset <= highest[index]:
            intervention_rows.append(index)
            car.put(0.0)
            history.clear()
        frame = view({name: row[name] for name in CAMERAS}, car.lateral_shift, car.heading_shift)
        watch(ReplayStep(row, frame, car.offset, car.heading, car.lateral_shift, car.heading_shift))
        wanted = as_plan(steer(history.add(row["time"], frame))).steering[0]
        commands.append(min(max(wanted, -1.0), 1.0))
        car.advance(commands[-1])
    return _trajectory(segment, np.array(offsets), np.array(headings), np.array(commands), intervention_rows)


class _ReplayedCar:
    """Pose of the replayed car relative to the recorded one; both have the same speed.

    Only the difference of their steering moves the replayed car relative to the recorded one, because everything else
    (slip, slopes, errors of the reconstructed path) is assumed to affect both alike. The angle between them is assumed
    to be small, and so is their distance relative to the radius of a bend.
    """

    def __init__(self, segment: ReplaySegment) -> None:
        self._segment, self._index = segment, 0
        self.lateral_shift, self.heading_shift = 0.0, 0.0  # metres and radians, right is positive

    @property
    def offset(self) -> float:
        """Cross-track error in metres."""
        return float(self._segment.driver[self._index]) + self.lateral_shift

    @property
    def heading(self) -> float:
        """Heading error in radians."""
        return float(self._segment.line.headings[self._index]) + self.heading_shift

    def put(self, offset: float) -> None:
        """Set the cross-track error to `offset` metres and the heading error to 0."""
        self.lateral_shift, self.heading_shift = (
            self.lateral_shift + offset - self.offset,
            self.heading_shift - self.heading,
        )

    def advance(self, steering: float) -> None:
        """Move the car to the next row; the last row has none."""
        motion, index = self._segment.motion, self._index
        speed, step = float(motion.speeds[index]), float(motion.steps[index])
        turn = (path_curvature(steering, speed) - float(motion.curvatures[index])) * step
        self.lateral_shift += (self.heading_shift + turn / 2) * step
        self.heading_shift += turn
        self._index = min(index + 1, len(motion.steps) - 1)


def _trajectory(
    segment: ReplaySegment, offsets: Floats, headings: Floats, steering: Floats, intervention_rows: Sequence[int]
) -> Trajectory:
    """Return the trajectory in a map where the reference line starts at the origin, heading north."""
    motion, bends = segment.motion, segment.line.curvatures
    times, progress = sums_before(motion.seconds), sums_before(motion.steps)
    compass = sums_before(bends * motion.steps)
    right = np.stack([np.cos(compass), -np.sin(compass)], axis=1)
    middle = np.stack(
        [sums_before(np.sin(compass) * motion.steps), sums_before(np.cos(compass) * motion.steps)], axis=1
    )
    positions = middle + offsets[:, None] * right
    interventions = tuple(
        Intervention(
            float(times[index]),
            float(positions[index, 0]),
            float(positions[index, 1]),
            float(progress[index]),
            "off the road",
        )
        for index in intervention_rows
    )
    return Trajectory(times, positions, motion.speeds / MPH, steering, progress, offsets, headings, interventions)
