from pathlib import Path

import numpy as np
import pytest

from pilot.data.driving_log import read_driving_logs
from pilot.data.recording_writer import RecordingWriter
from pilot.vehicle import CAMERAS

PLAIN = {camera: np.zeros((160, 320, 3), np.uint8) for camera in CAMERAS}  # smaller than a log of 20 rows
DETAILED = {camera: np.random.default_rng(0).integers(0, 256, (160, 320, 3), np.uint8) for camera in CAMERAS}


def files(folder: Path) -> set[str]:
    return {str(path.relative_to(folder)) for path in folder.rglob("*")}


def test_a_full_disk_leaves_the_rows_before_and_nothing_of_the_last_one(tmp_path: Path) -> None:
    resource = pytest.importorskip("resource")  # not on Windows
    limits = resource.getrlimit(resource.RLIMIT_FSIZE)
    with RecordingWriter(tmp_path / "laps") as writer:
        for second in range(20):
            writer.write(PLAIN, second, (0.1, 0.2), 20)
        before, log = files(tmp_path), (tmp_path / "laps" / "driving_log.csv").read_text()
        resource.setrlimit(resource.RLIMIT_FSIZE, (len(log) + 9, limits[1]))
        try:
            with pytest.raises(OSError, match=r"laps: cannot be written \(File too large\): make room on the disk"):
                writer.write(DETAILED, 21, (0.1, 0.2), 20)
            with pytest.raises(OSError, match="laps: cannot be written .No space left on device"):
                writer.write(PLAIN, 22, (0.1, 0.2), 20)
        finally:
            resource.setrlimit(resource.RLIMIT_FSIZE, limits)
        assert files(tmp_path) == before
        assert (tmp_path / "laps" / "driving_log.csv").read_text() == log
        writer.write(PLAIN, 23, (0.1, 0.2), 20)
    assert len(read_driving_logs([tmp_path / "laps"]).rows) == 21


def test_a_recording_into_a_file_is_refused_by_name(tmp_path: Path) -> None:
    (tmp_path / "laps").write_text("precious")
    with pytest.raises(OSError, match="laps: cannot be written .*: name another place"):
        RecordingWriter(tmp_path / "laps")
