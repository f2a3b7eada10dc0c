import errno
import threading
import time
from collections.abc import Callable
from datetime import datetime, timedelta
from pathlib import Path

import pytest
from conftest import picture, write_picture, write_recording
from wire import telemetry

from pilot.data.driving_log import read_driving_logs
from pilot.data.frames import encode_frame
from pilot.driving.autopilot import Answer
from pilot.driving.recorder import QUEUE_SIZE, FolderInUseError, Recorder
from pilot.driving.telemetry import parse_telemetry

IMAGE = encode_frame(picture(0.1))


def answer(steering: float = 0.25, throttle: float = 0.5) -> Answer:
    return Answer("steer", {}, steering, throttle, parse_telemetry(telemetry(IMAGE, speed="12.5")))


class Clock:
    """80 ms from frame to frame."""

    def __init__(self) -> None:
        self.time = datetime(2026, 5, 4, 13, 2, 1, 39_000)

    def __call__(self) -> datetime:
        self.time += timedelta(milliseconds=80)
        return self.time


def test_a_recorded_drive_can_be_read_like_any_recording(tmp_path: Path) -> None:
    recorder = Recorder(tmp_path / "run1", now=Clock())
    for throttle in (0.5, -0.25, 0.0):
        recorder.observe(answer(throttle=throttle))
    recorder.observe(Answer("manual", {}))
    recorder.close()
    assert recorder.frames == 3
    assert (tmp_path / "run1" / "2026_05_04_13_02_01_119.jpg").read_bytes() == IMAGE
    rows = read_driving_logs([tmp_path / "run1"]).rows
    assert rows["steering"].tolist() == [0.25] * 3
    assert rows["throttle"].tolist() == [0.5, 0, 0]
    assert rows["brake"].tolist() == [0, 0.25, 0]
    assert rows["speed"].tolist() == [12.5] * 3
    assert rows["time"].diff()[1:].tolist() == pytest.approx([0.08, 0.08], abs=1e-3)


def test_a_folder_with_frames_is_not_wiped_unless_asked(tmp_path: Path) -> None:
    run = tmp_path / "run1"
    run.mkdir()
    (run / "2018_08_20_15_07_36_039.jpg").write_bytes(IMAGE)
    (run / "notes.txt").write_text("mine")
    with pytest.raises(FolderInUseError, match="--overwrite"):
        Recorder(run)
    assert (run / "2018_08_20_15_07_36_039.jpg").exists()
    Recorder(run, overwrite=True).close()
    assert not (run / "2018_08_20_15_07_36_039.jpg").exists()
    assert (run / "notes.txt").exists()
    with pytest.raises(FolderInUseError, match="is a file"):
        Recorder(run / "notes.txt")


def test_a_full_disk_stops_the_recording_not_the_car(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    recorder = Recorder(tmp_path / "run1", now=Clock())
    recorder.observe(answer())
    wait_for(lambda: recorder.frames == 1)

    def full(_path: Path, _data: bytes) -> None:
        raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr(Path, "write_bytes", full)
    for _ in range(3):
        recorder.observe(answer())
    recorder.close()
    monkeypatch.undo()
    assert recorder.frames == 1
    assert recorder.failed == "the disk is full"
    assert "The car drives on" in caplog.text
    assert len(read_driving_logs([tmp_path / "run1"]).rows) == 1


def test_a_slow_disk_never_holds_up_the_car(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    slow = Path.write_bytes
    monkeypatch.setattr(Path, "write_bytes", lambda path, data: (time.sleep(0.02), slow(path, data))[1])
    recorder = Recorder(tmp_path / "run1", now=Clock())
    began = time.monotonic()
    for _ in range(50):
        recorder.observe(answer())
    assert time.monotonic() - began < 0.5
    wait_for(lambda: recorder.frames == 50)
    recorder.close()


def test_a_disk_that_hangs_never_holds_up_the_end(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    released = threading.Event()
    monkeypatch.setattr(Path, "write_bytes", lambda _path, _data: released.wait(60))
    recorder = Recorder(tmp_path / "run1", now=Clock())
    for _ in range(QUEUE_SIZE + 10):  # a full queue
        recorder.observe(answer())
    began = time.monotonic()
    recorder.close()
    assert time.monotonic() - began < 1
    assert f"the last {QUEUE_SIZE} frames were not recorded" in caplog.text
    released.set()


def test_a_full_disk_leaves_whole_frames_and_lines_only(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    recorder = Recorder(tmp_path / "run1", now=Clock())
    recorder.observe(answer())
    wait_for(lambda: recorder.frames == 1)
    write = Path.write_bytes

    def full(path: Path, data: bytes) -> None:
        write(path, data[:100])
        raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr(Path, "write_bytes", full)
    recorder.observe(answer())
    recorder.close()
    assert len(list((tmp_path / "run1").glob("*.jpg"))) == 1


def test_a_folder_that_cannot_be_written_to_is_refused_before_the_car_moves(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def read_only(path: Path, *_arguments: object, **_options: object) -> None:
        raise OSError(errno.EROFS, "Read-only file system", str(path))

    monkeypatch.setattr(Path, "open", read_only)
    with pytest.raises(OSError, match=r"run1: cannot record there \(Read-only file system\); name another folder"):
        Recorder(tmp_path / "run1")


@pytest.mark.parametrize("overwrite", [False, True])
def test_files_that_drive_py_did_not_record_are_never_deleted(tmp_path: Path, *, overwrite: bool) -> None:
    holidays, laps = tmp_path / "holidays", write_recording(tmp_path / "laps", 3)
    for number in range(20):
        write_picture(holidays / f"IMG_{number:04d}.jpg", picture(0))
    for folder, number in ((holidays, 20), (laps, 1)):
        before = sorted(folder.rglob("*"))
        with pytest.raises(FolderInUseError, match=rf"did not record \({number}, such as .*name another folder"):
            Recorder(folder, overwrite=overwrite)
        assert sorted(folder.rglob("*")) == before


def wait_for(condition: Callable[[], bool]) -> None:
    deadline = time.monotonic() + 20
    while not condition():
        assert time.monotonic() < deadline
        time.sleep(0.01)
