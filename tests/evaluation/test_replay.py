"""Replay of recordings: the road is found in them, the car goes where it is steered, and sees what it would see."""

import math
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from pilot.arrays import Frame
from pilot.data.driving_log import read_driving_logs
from pilot.data.frames import encode_frame, read_frame
from pilot.data.motion import Motion
from pilot.data.recording_writer import RecordingWriter
from pilot.evaluation.reference_path import UnusableRecording, continuous_segments, fit_line
from pilot.evaluation.replay import (
    DRIVER_MARGIN,
    LIMITS,
    UNCLEAR,
    Reference,
    Replayable,
    ReplayConfig,
    ReplayStep,
    along_path,
    prepare,
    replay,
)
from pilot.evaluation.replay_view import BONNET_ROW, view, warp
from pilot.simulator.catalogue import load_course
from pilot.simulator.demonstration import DemonstrationConfig, demonstrate
from pilot.simulator.simulator import Simulator
from pilot.vehicle import CAMERAS, HALF_TRACK, SIDE_CAMERA_OFFSET, curvature_to_steering

ROAD = np.s_[75:132, 60:260]
PLAN = DemonstrationConfig(laps=0.18, rate=10, wander=0.5)


@dataclass
class Recorded:
    """A recording of a wandering driver on a built-in track, and the truth about it.

    That is his offsets from the middle, his heading errors, and the road's half widths.
    """

    folder: Path
    rows: pd.DataFrame
    replayable: Replayable
    offsets: np.ndarray
    headings: np.ndarray
    half_widths: np.ndarray


@pytest.fixture(scope="module")
def recorded(tmp_path_factory: pytest.TempPathFactory) -> Recorded:
    # not beside the dirt road, where the road has one edge only
    return record_drive(tmp_path_factory.mktemp("replay"), "lake", seed=1)


def record_drive(folder: Path, track: str, seed: int) -> Recorded:
    truth = []
    with Simulator(CAMERAS) as simulator, RecordingWriter(folder) as writer:
        simulator.reset(track, seed=seed)
        for step in demonstrate(simulator.episode, PLAN):
            state, where = simulator.episode.state, simulator.episode.where
            truth.append((where.lateral_offset, state.heading_error, where.half_width))
            writer.write(simulator.look(), state.time, step.command, state.speed)
    rows = read_driving_logs([folder]).rows
    return Recorded(folder, rows, prepare(rows), *np.array(truth).T)


def difference(first: Frame, second: Frame) -> float:
    return float(np.abs(first[ROAD].astype(float) - second[ROAD]).mean())


class Follower:
    """Steers as recorded, and `correction` back to where the car should be."""

    def __init__(self, correction: float = 0.0) -> None:
        self.correction, self.moments = correction, []

    def watch(self, step: ReplayStep) -> None:
        self.moments.append(step)

    def steer(self, _frame: Frame) -> float:
        now, ahead = self.moments[-1], 12.0
        back = 2 * (now.lateral_shift + ahead * now.heading_shift) / ahead**2
        return float(now.row["steering"]) - self.correction * curvature_to_steering(back)


def log(moments: int = 100, rate: float = 10.0, **columns: object) -> pd.DataFrame:
    rows = pd.DataFrame({"recording": 0, "time": np.arange(moments) / rate, "steering": 0.0, "speed": 20.0})
    return rows.assign(**columns)


# The path


def test_a_pause_another_recording_and_a_leap_of_the_speed_end_a_drive() -> None:
    rows = log(300)
    rows.loc[100:, "time"] += 5.0
    rows.loc[170:, "recording"] = 1
    rows.loc[230:, "speed"] = 10.0
    assert [len(drive) for drive in continuous_segments(rows)] == [100, 70, 60, 70]


def test_what_is_too_short_is_left_out() -> None:
    rows = log(100)
    rows.loc[70:, "time"] += 5.0
    assert [len(drive) for drive in continuous_segments(rows)] == [70]


@pytest.mark.parametrize(("rows", "message"), [(log(rate=2.0), "2.0 rows a second"), (log(speed=math.nan), "no speed")])
def test_a_recording_that_cannot_be_replayed_says_why(rows: pd.DataFrame, message: str) -> None:
    with pytest.raises(UnusableRecording, match=message):
        list(continuous_segments(rows))


def test_a_recording_of_short_drives_only_is_refused() -> None:
    with pytest.raises(UnusableRecording, match="no segment of at least 5 s"):
        prepare(log(20))


def test_the_line_is_smooth_where_a_keyboard_driver_weaves_along_a_bend() -> None:
    step, bend = 1.0, 0.02
    weave = 0.05 * np.sign(np.sin(np.arange(300) / 3))  # full pulses to the left and right
    motion = Motion(np.full(300, 0.1), np.full(300, step), np.full(300, 10.0), bend + weave)
    line = fit_line(motion, np.zeros(300), np.full(300, 1.5))
    middle = slice(30, 270)
    assert line.curvatures[middle] == pytest.approx(bend, abs=0.004)
    assert np.ptp(line.headings[middle]) > 0.2


def test_the_line_follows_where_the_car_was_seen_not_only_where_it_steered() -> None:
    truth = 1.5 * np.sin(np.arange(300) / 40)
    motion = Motion(np.full(300, 0.1), np.full(300, 1.0), np.full(300, 10.0), np.gradient(np.gradient(truth)))
    seen = truth + np.random.default_rng(0).normal(0, 0.5, 300)
    line = fit_line(motion, seen, np.full(300, 0.5))
    assert np.abs(line.offsets - truth).mean() < 0.15
    middle = slice(10, 290)
    assert line.headings[middle] == pytest.approx(np.gradient(truth)[middle], abs=0.05)


# The road


def test_the_roads_middle_is_found_where_it_is(recorded: Recorded) -> None:
    [segment] = recorded.replayable.segments
    assert np.abs(segment.line.offsets - recorded.offsets).mean() < 0.25
    assert np.corrcoef(segment.line.offsets, recorded.offsets)[0, 1] > 0.8
    assert np.abs(segment.line.headings - recorded.headings).mean() < 0.03
    assert segment.half_widths == pytest.approx(4.8, abs=0.3)
    assert recorded.replayable.clarity > UNCLEAR
    assert recorded.replayable.reference == "road"


def test_where_no_road_is_seen_its_middle_is_unclear(recorded: Recorded, tmp_path: Path) -> None:
    rows = recorded.rows.iloc[:80].assign(center=recorded.rows["center"].iloc[0])
    assert prepare(rows).clarity > UNCLEAR
    (tmp_path / "grey.jpg").write_bytes(encode_frame(np.full((160, 320, 3), 128, np.uint8)))
    assert prepare(rows.assign(center=str(tmp_path / "grey.jpg"))).clarity < UNCLEAR


def test_the_roads_middle_is_found_in_hairpins_and_where_the_road_is_wide(tmp_path: Path) -> None:
    jungle = record_drive(tmp_path, "jungle", seed=0)
    [segment] = jungle.replayable.segments
    assert np.abs(segment.line.offsets - jungle.offsets).mean() < 0.5
    assert np.percentile(np.abs(segment.line.offsets - jungle.offsets), 95) < 1.2
    assert np.median(segment.half_widths) == pytest.approx(4.6, abs=0.3)
    assert jungle.replayable.reference == "road"


def test_the_roads_middle_is_found_where_its_width_changes(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    course = load_course("mountain")
    waves = np.sin(np.linspace(0, 10 * math.pi, len(course.track.points)))
    changing = replace(course, track=replace(course.track, half_widths=4.2 + 0.6 * waves))
    monkeypatch.setattr("pilot.simulator.simulator.load_course", lambda _: changing)
    monkeypatch.setattr("pilot.simulator.simulator.load_track", lambda _: changing.track)
    drive = record_drive(tmp_path, "mountain", seed=1)
    [segment] = drive.replayable.segments
    assert np.ptp(drive.half_widths) > 1.0
    assert np.abs(segment.half_widths - drive.half_widths).mean() < 0.3
    assert np.corrcoef(segment.half_widths, drive.half_widths)[0, 1] > 0.8
    assert np.abs(segment.line.offsets - drive.offsets).mean() < 0.3


# What is seen


@pytest.mark.parametrize(("side", "offset"), [("left", -SIDE_CAMERA_OFFSET), ("right", SIDE_CAMERA_OFFSET)])
def test_the_centre_picture_moved_to_a_side_camera_is_that_cameras_picture(
    recorded: Recorded, side: str, offset: float
) -> None:
    errors = []
    for _, row in recorded.rows.iloc[20::20].iterrows():
        centre, aside = read_frame(row["center"]), read_frame(row[side])
        errors.append((difference(centre, aside), difference(warp(centre, offset, 0.0), aside)))
        seen = view({name: row[name] for name in CAMERAS}, offset, 0.0)
        assert difference(seen, aside) < 1.0  # the nearer camera's own picture
        np.testing.assert_array_equal(seen[BONNET_ROW:], centre[BONNET_ROW:])
    unwarped, warped = np.mean(errors, axis=0)
    assert warped < 0.55 * unwarped


@pytest.mark.parametrize("degrees", [-8.0, 8.0])
def test_a_turned_car_sees_sky_and_road_turned(degrees: float) -> None:
    with Simulator() as simulator:
        simulator.reset("lake")
        simulator.episode.place(30.0)
        straight = simulator.look()["center"]
        simulator.episode.place(30.0, heading_error=math.radians(degrees))
        heading_shift = simulator.look()["center"]
    warped = warp(straight, 0.0, math.radians(degrees))
    for part in (ROAD, np.s_[20:55, 60:260]):
        unlike, like = (np.abs(frame[part].astype(float) - heading_shift[part]).mean() for frame in (straight, warped))
        assert like < 0.6 * unlike


def test_without_side_cameras_the_centre_picture_is_warped(recorded: Recorded) -> None:
    centre = recorded.rows["center"].iloc[50]
    seen = view({"center": centre, "left": "", "right": ""}, 1.0, 0.05)
    np.testing.assert_array_equal(seen, warp(read_frame(centre), 1.0, 0.05))


# The car


def test_the_recorded_steering_drives_the_recorded_path(recorded: Recorded) -> None:
    follower = Follower()
    [driven] = replay(recorded.replayable, follower.steer, watch=follower.watch)
    [segment] = recorded.replayable.segments
    assert not driven.interventions
    np.testing.assert_allclose(driven.cross_track_errors, segment.line.offsets - segment.lane, atol=1e-9)
    np.testing.assert_array_equal(follower.moments[40].frame[ROAD], read_frame(recorded.rows["center"][40])[ROAD])
    assert driven.distance == pytest.approx(PLAN.laps * 1137, rel=0.05)


@pytest.mark.parametrize("reference", ["road", "path"])
def test_always_straight_leaves_the_road_in_a_bend(recorded: Recorded, reference: Reference) -> None:
    replayable = recorded.replayable if reference == "road" else by_path(recorded)
    [driven] = replay(replayable, lambda _: 0.0)
    assert len(driven.interventions) >= 3
    for failure in driven.interventions:
        index = int(np.searchsorted(driven.times, failure.time))
        assert abs(driven.cross_track_errors[index]) > LIMITS[reference]
        assert abs(driven.cross_track_errors[index + 1]) < 0.5  # put back


def by_path(recorded: Recorded) -> Replayable:
    [segment] = recorded.replayable.segments
    return Replayable((along_path(segment.rows, segment.motion),), "path", 0.0)


def test_what_was_good_enough_for_the_driver_is_for_the_model(recorded: Recorded) -> None:
    [segment] = recorded.replayable.segments
    lowest, highest = segment.allowed_errors(0.2)  # he himself strays by more
    assert segment.driver.max() > 0.3
    assert (segment.driver < highest).all()
    assert (segment.driver > lowest).all()
    follower = Follower()
    [driven] = replay(recorded.replayable, follower.steer, ReplayConfig(limit=0.2), follower.watch)
    assert not driven.interventions
    aside = replay(recorded.replayable, lambda frame: follower.steer(frame) + 0.03, ReplayConfig(0.2), follower.watch)
    assert aside[0].interventions


def test_who_drives_beside_the_road_has_failed_however_wide_the_limit(recorded: Recorded) -> None:
    [segment] = recorded.replayable.segments
    lowest, highest = segment.allowed_errors(10.0)
    edges = segment.half_widths - HALF_TRACK
    np.testing.assert_allclose(highest, np.maximum(edges - segment.lane, segment.driver + DRIVER_MARGIN))
    np.testing.assert_allclose(lowest, -np.maximum(edges + segment.lane, DRIVER_MARGIN - segment.driver))


def test_steering_to_the_right_goes_to_the_right(recorded: Recorded) -> None:
    follower = Follower()
    [right] = replay(recorded.replayable, lambda frame: follower.steer(frame) + 0.1, watch=follower.watch)
    assert right.cross_track_errors[60] > recorded.replayable.segments[0].driver[60] + 0.5


@pytest.mark.parametrize("start", [-1.5, 1.5])
def test_a_start_beside_the_road_is_corrected_by_who_steers_back(recorded: Recorded, start: float) -> None:
    ends = {}
    for correction in (0.0, 1.0):
        follower = Follower(correction)
        [driven] = replay(recorded.replayable, follower.steer, ReplayConfig(start=start), follower.watch)
        assert driven.cross_track_errors[0] == pytest.approx(start)
        ends[correction] = float(np.mean([abs(step.lateral_shift) for step in follower.moments[60:90]]))
    assert ends[1.0] < 0.2
    assert ends[0.0] > 3 * ends[1.0]


@pytest.mark.parametrize("config", [ReplayConfig(limit=0.0), ReplayConfig(limit=9.0), ReplayConfig(start=-3.5)])
def test_a_limit_or_start_that_makes_no_sense_is_refused(recorded: Recorded, config: ReplayConfig) -> None:
    with pytest.raises(ValueError, match="limit|start"):
        replay(recorded.replayable, lambda _: 0.0, config)


@pytest.mark.parametrize(("name", "reference"), [("lake", "road"), ("jungle", "road")])
def test_a_real_drivers_own_steering_needs_no_intervention(
    name: str, reference: Reference, request: pytest.FixtureRequest
) -> None:
    recordings = request.config.getoption("--recordings")
    if recordings is None:
        pytest.skip("needs real recordings: pytest --recordings DIR")
    replayable = prepare(read_driving_logs([recordings / name]).rows.iloc[:600])
    follower = Follower()
    assert replayable.reference == reference
    assert not any(driven.interventions for driven in replay(replayable, follower.steer, watch=follower.watch))
    assert sum(len(driven.interventions) for driven in replay(replayable, lambda _: 0.0)) > 5
