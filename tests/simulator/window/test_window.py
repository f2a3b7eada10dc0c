"""The window on a virtual display, driven by real key presses."""

import contextlib
import csv
import logging
import os
import signal
import subprocess
import sys
from pathlib import Path

import cv2
import numpy as np
import pytest
from conftest import REPOSITORY, circle
from screen import PATIENCE, Screen, wait_for

from pilot.simulator.episode import Episode
from pilot.simulator.simulator import Simulator
from pilot.simulator.window.capture import Capture
from pilot.simulator.window.hud import LapClock
from pilot.vehicle import CAMERAS

BY_HAND = """
import logging, sys
from pathlib import Path
from pilot import cli
from pilot.simulator.window.window import drive_manually
logging.basicConfig(level=logging.INFO, format="%(message)s")
sys.exit(cli.run("simulator.py", lambda: drive_manually("lake", None, Path(sys.argv[1])), verbose=True))
"""
BY_OTHERS = """
from pilot.simulator.window import window
from pilot.simulator.simulator import Simulator

class Control:
    done = said = False
    keys = note = ""
    def advance(self, seconds):
        if self.ends:
            self.done = drive.advance(0, 1).time > 0.1
        elif drive.on_road and not drive.car.speed and not self.said:
            self.said = not print("back on the road", flush=True)

window.PIPES = ("p3missing", *window.PIPES[1:])  # as where there is no OpenGL
with Simulator() as simulator:
    simulator.reset("random:12")
    drive, control = simulator.episode, Control()
    for control.ends in (True, False):
        control.done = False
        with window.Window(drive, simulator.renderer.scene, title="others") as opened:
            opened.behind = True
            opened.run(control)
        print("closed", flush=True)
        drive.place(50, offset=9, speed=20)
"""
IN_A_SLOPE = """
from pilot.simulator.simulator import Simulator
from pilot.simulator.window.window import Window

class Control:
    done = False
    keys = note = ""
    def advance(self, seconds):
        pass

with Simulator() as simulator:
    simulator.reset("jungle", light="noon")
    simulator.episode.place(48.4, offset=16, heading_error=1.23)
    with Window(simulator.episode, simulator.renderer.scene, title="slope") as window:
        window.run(Control())
"""


def is_road(picture: np.ndarray) -> bool:
    """Whether there is blue sky above and something grey, the road, below."""
    sky, road = picture[60:90, 180:390].reshape(-1, 3).mean(0), picture[430:465, 400:560].reshape(-1, 3)
    return sky[2] > sky[0] + 30 and float(np.ptp(road.mean(0))) < 25 and road.std() > 3


def rows_of(folder: Path) -> list[list[str]]:
    with (folder / "driving_log.csv").open() as log:
        return list(csv.reader(log))


def test_driving_by_hand_as_it_is_recorded(screen: Screen, tmp_path: Path) -> None:
    folder = tmp_path / "mine"
    with screen.run(BY_HAND, str(folder)) as process:
        wait_for(lambda: is_road(screen.picture()))
        road_ahead = screen.picture()[260:340, 420:540].astype(int)
        screen.do("key", "c")
        wait_for(lambda: np.abs(screen.picture()[260:340, 420:540] - road_ahead).mean() > 15)  # the car is in the way
        screen.do("key", "r")  # the car stands
        wait_for(lambda: len(recorded(folder)) > 2)
        screen.do("keydown", "Up")
        wait_for(lambda: np.count_nonzero(recorded(folder)[:, 1]) > 15)
        screen.do("keydown", "Right")
        wait_for(lambda: np.count_nonzero(recorded(folder)[:, 0] == 1) > 1)
        screen.do("keyup", "Right")
        wait_for(lambda: recorded(folder)[-1, 0] == 0)
        drag_left(screen, folder)
        screen.do("mouseup", "1")
        wait_for(lambda: recorded(folder)[-1, 0] == 0)
        screen.do("keyup", "Up")
        wait_for(lambda: recorded(folder)[-1, 1] == 0)
        screen.do("keydown", "s")
        wait_for(lambda: recorded(folder)[-1, 2] == 1)
        process.send_signal(signal.SIGINT)
        _, errors = process.communicate(timeout=PATIENCE)
    rows = rows_of(folder)
    assert process.returncode == 130
    assert errors.splitlines()[-3:] == [f"{len(rows)} rows recorded in {folder}", "", "Interrupted."]
    check_commands(np.array([row[3:] for row in rows], float))
    check_pictures(rows[0])


def recorded(folder: Path) -> np.ndarray:
    """Steering, throttle, brake and speed of the rows so far: n x 4."""
    log = folder / "driving_log.csv"
    lines = log.read_text().splitlines(keepends=True) if log.exists() else []
    return np.array([line.split(",")[3:] for line in lines if line.endswith("\n")], float).reshape(-1, 4)


def drag_left(screen: Screen, folder: Path) -> None:
    """Drag the mouse, slower if the window draws so seldom that it sees only the drag's end."""
    for pause in ("0.2", "1", "4", "10"):
        screen.do("mouseup", "1", "mousemove", "400", "300", "sleep", pause, "mousedown", "1", "sleep", pause)
        screen.do("mousemove", "280", "300", "sleep", pause)
        with contextlib.suppress(AssertionError):
            wait_for(lambda: np.count_nonzero(is_left(recorded(folder)[:, 0])) > 2, seconds=3)
            return
    pytest.fail("the mouse did not steer")


def is_left(steering: np.ndarray) -> np.ndarray:
    """Where the mouse steers: dragged by an eighth of the window's width."""
    return np.isclose(steering, -0.5, atol=0.01)


def check_commands(numbers: np.ndarray) -> None:
    steering, throttle, brake, speed = numbers.T
    assert steering[0] == throttle[0] == brake[0] == speed[0] == 0
    pressed = np.flatnonzero(throttle)
    assert set(throttle) == set(brake) == {0, 1}
    assert np.all(np.diff(pressed) == 1)  # held all the time, also while the key repeats
    assert np.all(np.diff(speed[pressed[0] : pressed[0] + 15]) > 0)
    assert np.all(brake[: pressed[-1]] == 0)
    assert brake[-1] == 1
    right = np.flatnonzero(steering == 1)
    left = np.flatnonzero(is_left(steering))
    assert pressed[0] < right[0] < right[-1] < left[0] < pressed[-1]
    by_keys = steering[: right[-1] + 6]
    assert np.abs(np.diff(by_keys)).max() < 0.201  # four ticks at most lie between two rows
    assert np.all(np.abs(steering[right[-1] + 7 : left[0] - 1]) <= 0.5)


def check_pictures(row: list[str]) -> None:
    """The cameras see the road as they would without a window, and not the car."""
    with Simulator(CAMERAS) as simulator:
        frames = simulator.reset("lake").frames
    for camera, name in zip(CAMERAS, row, strict=False):
        data = cv2.imencode(".jpg", frames[camera][:, :, ::-1], [cv2.IMWRITE_JPEG_QUALITY, 75])[1]
        alone = cv2.imdecode(data, cv2.IMREAD_COLOR)
        assert np.abs(cv2.imread(name).astype(int) - alone).mean() < 0.1


def test_showing_what_others_drive_without_opengl(screen: Screen) -> None:
    with screen.run(BY_OTHERS) as process:
        assert process.stdout.readline() == "closed\n"  # when the control was done
        screen.do("search", "--sync", "--name", "others")
        screen.do("key", "BackSpace")
        assert process.stdout.readline() == "back on the road\n"
        wait_for(lambda: is_road(screen.picture()))
        screen.do("key", "Escape")
        assert process.stdout.readline() == "closed\n"
        process.communicate(timeout=PATIENCE)
    assert process.returncode == 0


def test_beside_the_road_nobody_looks_into_the_land(screen: Screen) -> None:
    with screen.run(IN_A_SLOPE) as process:
        screen.do("search", "--sync", "--name", "slope")
        wait_for(lambda: screen.picture().std() > 20)
        below = screen.picture()[450:495, 350:700].reshape(-1, 3).mean(0)
        screen.do("key", "Escape")
        process.communicate(timeout=PATIENCE)
    red, green, blue = below
    assert min(red, green) > blue  # a slope, and not the blue below the land


def test_without_a_display_the_cure_is_named(tmp_path: Path) -> None:
    if sys.platform in {"win32", "darwin"}:
        pytest.skip("there is always a display")
    environment = {**os.environ, "DISPLAY": ":4000"}  # with none named, Panda3D tries :0, which may exist
    result = subprocess.run(
        [sys.executable, "-c", BY_HAND, str(tmp_path / "none")],
        env=environment,
        cwd=REPOSITORY,
        capture_output=True,
        text=True,
        timeout=PATIENCE,
    )
    assert "simulator.py: no window can be opened" in result.stderr
    assert "simulator.py connect --headless" in result.stderr
    assert not (tmp_path / "none").exists()


# Without a display


def test_fifteen_rows_a_second_from_the_moment_of_starting(tmp_path: Path) -> None:
    episode = Episode(circle())
    capture = Capture(tmp_path / "mine", lambda: dict.fromkeys(CAMERAS, np.zeros((160, 320, 3), np.uint8)))
    with capture:
        capture.add(episode.advance(0, 1))
        assert not (tmp_path / "mine").exists()
        for _ in range(2):
            capture.toggle()
            assert capture.rows == 0
            for _ in range(100):
                capture.add(episode.advance(0.25, 0.5))
            assert capture.rows == 30
            capture.toggle()
            assert capture.rows is None
    rows = rows_of(tmp_path / "mine")
    assert len(rows) == 60
    assert {tuple(row[3:6]) for row in rows} == {("0.25", "0.5", "0")}


def test_a_folder_that_cannot_be_written_to_is_said(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    (tmp_path / "file").write_text("")
    with caplog.at_level(logging.INFO, "pilot"), Capture(tmp_path / "file" / "mine", dict) as capture:
        capture.toggle()
        capture.add(Episode(circle()).state)
    assert capture.rows is None
    assert "cannot record" in capture.message
    assert capture.message in caplog.text


def test_a_full_disk_ends_the_recording_only(tmp_path: Path) -> None:
    def look() -> dict[str, np.ndarray]:
        raise OSError(28, "No space left on device")

    with Capture(tmp_path, look) as capture:
        capture.toggle()
        capture.add(Episode(circle()).state)
        capture.add(Episode(circle()).state)
    assert capture.rows is None
    assert "No space left" in capture.message


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="needs /dev/full")
def test_a_disk_that_is_full_at_the_end_is_said(tmp_path: Path) -> None:
    (tmp_path / "driving_log.csv").symlink_to("/dev/full")
    with Capture(tmp_path, lambda: dict.fromkeys(CAMERAS, np.zeros((160, 320, 3), np.uint8))) as capture:
        capture.toggle()
        capture.add(Episode(circle()).state)
    assert capture.rows is None
    assert "No space left" in capture.message


def test_laps_and_their_times() -> None:
    clock = LapClock()
    for time_now, laps in ((0.0, 0.0), (30.0, 0.5), (50.0, 0.4), (61.26, 1.001), (62.0, 0.999)):
        clock.update(time_now, laps, 20.0)
    assert clock.text() == "Lap 2    0:00.7    last 1:01.3"
    clock.update(100.0, 2.0, 20.0)
    assert clock.text() == "Lap 3    0:00.0    last 0:38.7"


def test_the_lap_clock_stops_while_the_car_stands() -> None:
    clock = LapClock()
    for tick in range(1000):  # has not driven yet
        clock.update(tick / 50, 0.0, 0.0)
    assert clock.text() == "Lap 1    0:00.0"
    for tick in range(1000, 1500):
        clock.update(tick / 50, 0.2, 20.0)
    for tick in range(1500, 99999):
        clock.update(tick / 50, 0.2, 0.1)
    assert clock.text() == "Lap 1    0:13.0"  # 10 s of driving, and 3 s before it counts as standing
