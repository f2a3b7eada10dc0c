"""Taking over from drive.py in the window of the built-in simulator."""

import logging
import signal
from pathlib import Path

import numpy as np
import pytest
from conftest import REPOSITORY, circle
from screen import PATIENCE, Screen, wait_for
from serving import Server

from pilot.data.driving_log import read_driving_logs
from pilot.data.steered_by import read_steered_by
from pilot.simulator.episode import Episode
from pilot.simulator.window.controls import STEERING_STEP, Controls
from pilot.simulator.window.takeover import CorrectionCapture, Takeover
from pilot.simulator.wire.client import Client
from pilot.vehicle import CAMERAS

FRAMES = dict.fromkeys(CAMERAS, np.zeros((160, 320, 3), np.uint8))


def test_a_held_key_takes_over_from_drive_py_and_is_recorded(screen: Screen, tmp_path: Path) -> None:
    server = Server(tmp_path, "run")
    folder = tmp_path / "corrections"

    def steerers() -> list[str]:
        return [steerer for path in folder.glob("*") for steerer in read_steered_by(path).values()]

    try:
        command = ("connect", "--port", str(server.port), "--corrections", str(folder))
        with screen.run(str(REPOSITORY / "simulator.py"), *command) as process:
            wait_for(lambda: len(list((tmp_path / "run").glob("*.jpg"))) > 20)  # the model drives
            screen.do("search", "--sync", "--name", "lake")
            screen.do("keydown", "Left")
            wait_for(lambda: steerers().count("person") > 20)
            screen.do("keyup", "Left")
            process.send_signal(signal.SIGINT)
            output, _ = process.communicate(timeout=PATIENCE)
    finally:
        server.stop()
    log = read_driving_logs([folder])
    assert f"1 correction ({len(steerers())} rows) in {folder}" in output
    assert log.left_out[0]["steered by the model"] == steerers().count("model") > 0
    assert log.rows["steering"].iloc[-1] == -1
    assert (log.rows[list(CAMERAS)] != "").all(axis=None)


def takeover() -> Takeover:
    return Takeover(Client(Episode(circle()), lambda _: FRAMES["center"], port=1), Controls())


def test_the_person_goes_on_from_the_steering_and_the_speed_of_the_model() -> None:
    control = takeover()
    control.client.episode.place(0, speed=12)
    control.client.episode.advance(0.6, 0.2)
    control.controls.press("a")
    control.advance(0.0)
    assert control.client.manual is not None
    steering, throttle = control.client.manual()
    assert steering == pytest.approx(0.6 - STEERING_STEP)
    assert abs(throttle) < 0.2
    control.controls.press("arrow_down")
    assert control.client.manual()[1] == -1
    control.controls.release("a")
    control.advance(0.0)
    assert control.client.manual is None


def test_only_corrections_are_recorded_with_the_seconds_before(tmp_path: Path) -> None:
    episode = Episode(circle())
    capture = CorrectionCapture(tmp_path / "corrections", lambda: FRAMES)
    for steerer, ticks in (("model", 500), ("person", 100), ("model", 500)):
        for _ in range(ticks):
            capture.add(episode.advance(0.5 if steerer == "person" else 0.1, 0.2), steerer)
    capture.close()
    assert capture.number == 1
    log = read_driving_logs([capture.folder])
    assert set(log.rows["steering"]) == {0.5}
    assert len(log.rows) == 30  # 2 s
    assert log.left_out[0]["steered by the model"] == 46  # 3 s, both ends included


def test_a_folder_that_cannot_be_written_ends_the_recording_only(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    (tmp_path / "file").write_text("")
    capture, episode = CorrectionCapture(tmp_path / "file", lambda: FRAMES), Episode(circle())
    with caplog.at_level(logging.ERROR, "pilot"):
        for _ in range(20):
            capture.add(episode.advance(0.5, 0.2), "person")
    assert caplog.text.count("not recorded any more") == 1
