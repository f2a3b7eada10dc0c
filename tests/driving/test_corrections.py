"""A person takes over from the model: who steers, and what is recorded of it."""

import signal
import time
from datetime import datetime, timedelta
from pathlib import Path
from types import SimpleNamespace

import pytest
from conftest import picture
from serving import IMAGE, Server, driven, post, steers
from wire import telemetry

from pilot.commands.drive import report
from pilot.data.driving_log import read_driving_logs
from pilot.data.frames import encode_frame
from pilot.data.steered_by import read_steered_by
from pilot.driving.autopilot import Answer, Autopilot
from pilot.driving.controller import ControllerConfig
from pilot.driving.corrections import Corrections
from pilot.driving.telemetry import parse_telemetry
from pilot.driving.wheel import HELD_SECONDS, PersonCommand, Wheel

MESSAGE = telemetry(encode_frame(picture(0)), speed="10")
FRAME_SECONDS = 0.1


class Clock:
    now = 100.0

    def __call__(self) -> float:
        return self.now


def test_the_wheel_is_released_by_itself_if_the_page_says_nothing_more() -> None:
    clock = Clock()
    wheel = Wheel(clock)
    wheel.hold(PersonCommand(0.5))
    clock.now += HELD_SECONDS - 0.01
    assert wheel.command == PersonCommand(0.5)
    clock.now += 0.02
    assert wheel.command is None


def test_a_person_steers_at_once_and_the_model_goes_on_from_there() -> None:
    clock = Clock()
    pilot = Autopilot(lambda _frame: 0.0, ControllerConfig(smoothing=0.2), clock)
    assert pilot.answer(MESSAGE).steerer == "model"
    pilot.wheel.hold(PersonCommand(-0.8, throttle=-0.5))
    clock.now += FRAME_SECONDS
    answer = pilot.answer(MESSAGE)
    assert answer.message == {"steering_angle": "-0.800000", "throttle": "-0.500000"}
    assert answer.steerer == "person"
    pilot.wheel.release()
    clock.now += FRAME_SECONDS
    answer = pilot.answer(MESSAGE)
    assert answer.steerer == "model"
    assert -0.8 < answer.steering < -0.4  # no jump


def test_without_a_pedal_the_speed_controller_goes_on() -> None:
    pilot = Autopilot(lambda _frame: 0.0, ControllerConfig(speed=20), Clock())
    pilot.wheel.hold(PersonCommand(0.1))
    assert pilot.answer(MESSAGE).throttle > 0


def drive(corrections: Corrections, time: datetime, steerers: str) -> datetime:
    """Observe an answer every `FRAME_SECONDS`: m is steered by the model (0.1), p by a person (0.9)."""
    parsed = parse_telemetry(MESSAGE)
    for steerer in steerers:
        time += timedelta(seconds=FRAME_SECONDS)
        corrections.now = lambda time=time: time
        steering = 0.9 if steerer == "p" else 0.1
        corrections.observe(Answer("steer", {}, steering, 0.3, parsed, 0, "person" if steerer == "p" else "model"))
    return time


def test_a_correction_is_recorded_with_the_seconds_before_it(tmp_path: Path) -> None:
    corrections = Corrections(tmp_path / "corrections")
    time = drive(corrections, datetime(2026, 1, 1), "m" * 100)
    assert not (tmp_path / "corrections").exists()
    time = drive(corrections, time, "p" * 20 + "m" * 100 + "p" * 10 + "m" * 100)
    corrections.close()
    assert corrections.number == 2
    assert corrections.frames == 31 + 20 + 31 + 10
    log = read_driving_logs([tmp_path / "corrections"])
    assert log.rows["steering"].tolist() == [0.9] * 30  # only what the person did is learned
    assert log.rows["correction"].all()
    assert log.left_out[0] == {"steered by the model": 62}
    assert log.rows["time"].diff().max() == pytest.approx(100 * FRAME_SECONDS + FRAME_SECONDS)


def test_a_drive_without_corrections_writes_nothing(tmp_path: Path) -> None:
    corrections = Corrections(tmp_path / "corrections")
    drive(corrections, datetime(2026, 1, 1), "m" * 50)
    corrections.close()
    assert list(tmp_path.iterdir()) == []


def test_a_folder_that_cannot_be_written_ends_the_recording_only(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    (tmp_path / "file").write_text("")
    corrections = Corrections(tmp_path / "file")
    drive(corrections, datetime(2026, 1, 1), "mmppp")
    corrections.close()
    assert caplog.text.count("the corrections are not recorded") == 1


def corrected(server: Server, steering: float, seconds: float) -> None:
    """Drive for a time with the wheel held, as the page does."""
    with server.free_client() as client:
        ends = time.monotonic() + seconds
        while time.monotonic() < ends:
            assert post(server.port, "/wheel", {"steering": steering, "throttle": None})["steerer"] == "person"
            name, argument = steers(client, telemetry(IMAGE))
            assert (name, float(argument["steering_angle"])) == ("steer", steering)
        post(server.port, "/wheel", {"steering": None})
        driven(client)


@pytest.mark.parametrize("end", [signal.SIGINT, signal.SIGKILL])
def test_nothing_of_a_correction_is_lost_when_drive_py_ends(tmp_path: Path, end: signal.Signals) -> None:
    server = Server(tmp_path)
    try:
        corrected(server, -0.25, 1.0)
        time.sleep(0.3)  # the recorder's thread writes
    finally:
        server.stop(end)
    [folder] = (tmp_path / "data" / "corrections").iterdir()
    log = read_driving_logs([folder])
    assert set(log.rows["steering"]) == {-0.25}
    assert len(log.rows) >= 10
    images = {path.name for path in folder.glob("*.jpg")}
    assert images == set(read_steered_by(folder))
    if end == signal.SIGINT:
        assert "1 correction in data/corrections" in server.folder.joinpath("drive.log").read_text()


def test_the_command_to_learn_from_corrections_starts_from_a_model_that_can_be_trained(tmp_path: Path) -> None:
    corrections = SimpleNamespace(number=1, folder=tmp_path / "now", parent=tmp_path)

    def says(path: str) -> str:
        session = SimpleNamespace(recordings=[], corrections=corrections, recipe="corrections", path=Path(path))
        return "".join(report(session))

    assert "--start model.pt --data" in says("model.pt")
    assert "--start MODEL_BEFORE_EXPORT.pt --data" in says("model.onnx")
