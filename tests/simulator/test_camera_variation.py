"""Random variation of the cameras in recordings: pictures change, within bounds, and come again."""

from pathlib import Path

import cv2
import numpy as np

from pilot.simulator.camera_variation import STANDARD, CameraVariation, draw_variation
from pilot.simulator.demonstration import DemonstrationConfig
from pilot.simulator.demonstrations import record
from pilot.simulator.simulator import Simulator


def horizon(frame: np.ndarray) -> int:
    """First row from below that is not road, in the middle of the frame."""
    grey = frame[:130, 150:170].astype(int).mean(axis=(1, 2))
    return int(np.abs(np.diff(cv2.GaussianBlur(grey.astype(np.float32), (0, 0), 2).ravel())).argmax())


def test_pitch_height_and_exposure_change_the_frames() -> None:
    with Simulator() as simulator:
        plain = simulator.reset("lake").frames["center"]
        assert np.array_equal(simulator.look(STANDARD)["center"], plain)
        pitched = simulator.look(CameraVariation(pitch=0.03))["center"]
        assert 2 <= horizon(plain) - horizon(pitched) <= 6  # 0.03 rad are 4.2 rows
        bright = simulator.look(CameraVariation(channels=(1.2, 1.2, 1.2)))["center"]
        assert bright[100:130].mean() > 1.15 * plain[100:130].mean()
        assert not np.array_equal(simulator.look(CameraVariation(height=0.2))["center"], plain)


def test_draws_stay_within_plausible_bounds() -> None:
    random = np.random.default_rng(0)
    drawn = [draw_variation(random) for _ in range(200)]
    assert np.abs([variation.height for variation in drawn]).max() < 0.3
    assert np.abs([(variation.pitch, variation.roll) for variation in drawn]).max() < 0.06
    assert 55 <= min(variation.quality for variation in drawn) < max(variation.quality for variation in drawn) <= 95
    assert np.min([variation.channels for variation in drawn]) > 0.6


def test_a_recording_with_varied_cameras_comes_again(tmp_path: Path) -> None:
    config = DemonstrationConfig(laps=0.01, rate=5.0, vary_cameras=True)
    pictures = []
    for name in ("first", "second", "plain"):
        record("lake", config if name != "plain" else DemonstrationConfig(laps=0.01, rate=5.0), tmp_path / name)
        pictures.append([file.read_bytes() for file in sorted((tmp_path / name / "IMG").glob("center*"))])
    assert pictures[0] == pictures[1] != pictures[2]
