"""What is found in recordings: the track, and suspicious moments."""

from pathlib import Path

import cv2
import numpy as np
import pandas as pd
import pytest
from conftest import picture, write_picture, write_recording

from pilot.data.left_out import read_left_out
from pilot.data.motion import motion_of
from pilot.inspection import cross_check
from pilot.inspection.app import create_app
from pilot.inspection.cross_check import cross_predictions
from pilot.inspection.examiner import Examiner
from pilot.inspection.inspected import InspectedRecording
from pilot.inspection.motion_seen import MotionSeen, see_motion
from pilot.inspection.overview import find_place, summary
from pilot.inspection.place_seen import PlaceSeen, see_place
from pilot.inspection.suspicion import (
    find_moments,
    row_scores,
    scores_of_images,
    scores_of_log,
    scores_of_places,
    scores_of_predictions,
)
from pilot.simulator.catalogue import load_track
from pilot.simulator.episode import Episode
from pilot.simulator.expert import Expert
from pilot.simulator.simulator import Simulator
from pilot.vehicle import CAMERAS, FOCAL_LENGTH, MPH, TICK

EVERY = 5  # ticks from row to row: 10 Hz


def driven(track: str, seconds: float, start: float = 100.0) -> pd.DataFrame:
    """Rows of the expert's drive, without images."""
    episode = Episode(load_track(track), start)
    expert, rows = Expert(episode, 20.0), []
    for tick in range(round(seconds / TICK)):
        steering, throttle = expert.command()
        if tick % EVERY == 0:
            rows.append({"time": tick * TICK, "steering": steering, "speed": episode.state.speed})
        episode.advance(steering, throttle)
    images = dict.fromkeys(CAMERAS, "")
    return pd.DataFrame(rows).assign(recording=0, throttle=0.3, brake=0.0, correction=False, **images)


@pytest.mark.parametrize("track", ["lake", "jungle reversed"])
def test_recognises_track_and_direction_by_the_path(track: str) -> None:
    rows = driven(track, 60)
    place = find_place(rows)
    assert place.track == track
    road = load_track(track)
    driven_metres = (rows["speed"] * MPH * EVERY * TICK).cumsum()
    for row in (200, 400):
        where = road.locate(*place.path[row], 100 + driven_metres[row])
        assert abs(where.lateral_offset) < 0.1  # on the map's line
        assert where.progress == pytest.approx((100 + driven_metres[row]) % road.length, abs=10)


def test_an_unknown_track_is_drawn_by_dead_reckoning() -> None:
    rows = driven("random:12", 60)
    place = find_place(rows)
    assert place.track == ""
    assert np.linalg.norm(np.diff(place.path, axis=0), axis=1).sum() == pytest.approx(
        float((rows["speed"] * MPH * EVERY * TICK).sum()), rel=0.02
    )
    assert find_place(rows.assign(speed=np.nan)).path.tolist() == [[0, 0]] * len(rows)


def test_summarises_a_recording() -> None:
    rows = driven("lake", 30)
    rows.loc[:29, "steering"] = 0.0
    rows.loc[30:59, "steering"] = -1.0
    figures = summary(rows)
    assert figures["minutes"] == pytest.approx(0.5, abs=0.01)
    assert (figures["hz"], figures["zeros"], figures["full_lock"]) == (10.0, 0.1, 0.1)
    assert sum(figures["histogram"]) == len(rows)
    assert figures["histogram"][0] >= 30


# Suspicious moments


def world(shifts: list[float], folder: Path) -> list[str]:
    """Images of a far landscape, displaced by columns, as a car that turns sees it."""
    far = cv2.GaussianBlur(np.random.default_rng(0).integers(0, 255, (160, 1000, 3)).astype(np.uint8), (9, 9), 0)
    paths = []
    for number, shift in enumerate(shifts):
        paths.append(str(folder / f"{number}.jpg"))
        left = round(300 + shift)
        write_picture(Path(paths[-1]), far[:, left : left + 320])
    return paths


def test_sees_turns_and_frozen_pictures(tmp_path: Path) -> None:
    seen = see_motion(world([0, 4, 8, 8, 2], tmp_path))
    np.testing.assert_allclose(seen.turns * FOCAL_LENGTH, [0, 4, 4, 0, -6], atol=0.5)
    assert seen.changes[3] == 0
    assert (seen.changes[[1, 2, 4]] > 2).all()


def seen_by(rows: pd.DataFrame, changes: float | np.ndarray = 9.0) -> MotionSeen:
    """What the images of a drive would show, with some noise."""
    motion = motion_of(rows)
    turns = np.concatenate([[0.0], (motion.curvatures * motion.steps)[:-1]])
    noise = np.random.default_rng(0).normal(0, 0.002, len(rows))
    return MotionSeen(turns + noise, np.broadcast_to(changes, len(rows)))


def test_steering_that_contradicts_where_the_car_went() -> None:
    rows = driven("jungle", 40)
    seen, steered = seen_by(rows), rows["steering"]
    wrong = rows.assign(steering=steered.where((rows.index <= 200) | (rows.index >= 240), -steered))
    score = scores_of_images(wrong, seen)["turn"]
    assert score[205:235].max() > 1
    assert (np.delete(score, range(185, 260)) < 1).all()
    assert (scores_of_images(rows, seen)["turn"] < 1).all()


def test_standing_pauses_resets_and_frozen_pictures() -> None:
    rows = driven("lake", 40)
    rows.loc[100:109, "speed"] = 0.0  # a crash: from 20 mph to 0 at once
    rows.loc[200:, "time"] += 5.0
    scores = scores_of_log(rows)
    assert set(np.flatnonzero(scores["standing"] >= 1)) >= set(range(100, 110))
    assert scores["reset"][100] >= 1
    assert scores["pause"][200] >= 1
    assert row_scores(scores)[300] < 1
    changes = np.full(len(rows), 9.0)
    changes[300:320] = 0.0
    moments = find_moments({"frozen": scores_of_images(rows, seen_by(rows, changes))["frozen"]})
    assert [(moment.first, moment.last) for moment in moments] == [(299, 320)]


def test_swapped_cameras_and_a_car_off_the_road() -> None:
    rows = driven("lake", 40)
    count = len(rows)
    offsets, sides = np.zeros(count), np.full(count, 1.6)
    offsets[100:120], sides[200:220] = 6.0, -1.6
    scores = scores_of_places(rows, PlaceSeen(offsets, np.full(count, 4.0), sides))
    assert {moment.reason: (moment.first, moment.last) for moment in find_moments(scores)} == {
        "cameras": (200, 219),
        "off road": pytest.approx((100, 119), abs=3),
    }


def test_the_road_network_sees_swapped_cameras(tmp_path: Path) -> None:
    rows = []
    with Simulator(CAMERAS) as simulator:
        simulator.reset("lake")
        for number, frame in simulator.look().items():
            write_picture(tmp_path / f"{number}.jpg", frame)
    paths = {camera: str(tmp_path / f"{camera}.jpg") for camera in CAMERAS}
    rows = pd.DataFrame([paths] * 8)
    swapped = rows.rename(columns={"left": "right", "right": "left"})
    assert np.nanmin(see_place(rows).sides) > 0.8
    assert np.nanmax(see_place(swapped).sides) < -0.8
    assert np.abs(see_place(rows).offsets).max() < 1.0


def test_networks_are_trained_on_the_other_half(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(cross_check, "IMAGES", 400)
    monkeypatch.setattr(cross_check, "FEWEST_ROWS", 40)
    monkeypatch.setattr(cross_check, "BLOCK_SECONDS", 1.5)
    recording = InspectedRecording(write_recording(tmp_path / "laps", moments=60))
    predicted = cross_predictions(recording.rows)
    assert np.isfinite(predicted).all()
    scores = scores_of_predictions(recording.rows, predicted)["networks"]
    assert scores.shape == (60,)
    monkeypatch.setattr(cross_check, "FEWEST_ROWS", 61)
    assert np.isnan(cross_predictions(recording.rows)).all()


# The page's data


@pytest.fixture
def recording(tmp_path: Path) -> InspectedRecording:
    return InspectedRecording(write_recording(tmp_path / "laps", moments=60))


def test_the_examiner_goes_through_all_recordings(recording: InspectedRecording, tmp_path: Path) -> None:
    broken = InspectedRecording(write_recording(tmp_path / "broken", moments=30))
    Path(broken.rows["center"].iloc[10]).write_bytes(b"")  # damaged after it was read

    Examiner([broken, recording], lambda _frame: 0.25, networks=False).run()
    assert recording.state == ""
    assert recording.predicted.tolist() == [0.25] * 60
    assert {"frozen", "turn", "cameras", "off road"} <= recording.scores.keys()
    assert "center" in broken.state


def test_leaves_ranges_out_and_restores_them(recording: InspectedRecording) -> None:
    client = create_app([recording]).test_client()
    assert client.get("/recordings").json["recordings"][0]["rows"] == 60

    def post(**body: object) -> tuple[int, dict[str, object]]:
        answer = client.post("/recordings/0/left_out", json=body)
        return answer.status_code, answer.json

    assert post(first=10, last=19, reason="crash")[1]["left_out"] == [10 <= row < 20 for row in range(60)]
    post(first=30, last=30, reason="bump")
    assert [each.reason for each in read_left_out(recording.folder)] == ["crash", "bump"]
    assert client.get("/recordings").json["recordings"][0]["left_out"] == {"left out by hand": 11}
    assert sum(post(first=12, last=12, restore=True)[1]["left_out"]) == 1
    for first, last in ((50, 60), (3, 2), ("1", 2), (True, 2), (-1, 2)):
        assert post(first=first, last=last)[0] == 400
    assert client.post("/recordings/0/left_out", data=b"[" * 1000, content_type="application/json").status_code == 400
    assert client.post("/recordings/1/left_out", json={"first": 0, "last": 1}).status_code == 404


def test_series_moments_and_frames_are_served(recording: InspectedRecording) -> None:
    client = create_app([recording]).test_client()
    series = client.get("/recordings/0/series").json
    assert {len(series[name]) for name in ("time", "steering", "label", "speed", "score", "left_out")} == {60}
    assert isinstance(client.get("/recordings/0/moments").json["moments"], list)
    data = np.frombuffer(client.get("/recordings/0/frames/5/left").data, np.uint8)
    shown = cv2.imdecode(data, cv2.IMREAD_COLOR_RGB)
    assert np.abs(shown.astype(int) - picture(recording.rows["steering"].iloc[5], 20)).mean() < 8
    big = cv2.imdecode(np.frombuffer(client.get("/recordings/0/frames/5/center").data, np.uint8), cv2.IMREAD_COLOR)
    assert big.shape == (320, 640, 3)
    for path in ("frames/60/center", "frames/5/driving_log.csv", "frames/-1/center"):
        assert client.get(f"/recordings/0/{path}").status_code == 404
