"""Checks on real recordings: run with `pytest --recordings DIR` (a folder with lake, jungle and quirks)."""

from pathlib import Path

import cv2
import numpy as np
import pytest

from pilot import camera
from pilot.driving_log import read_driving_logs
from pilot.frames import read_frame


@pytest.fixture
def recordings(request: pytest.FixtureRequest) -> Path:
    folder = request.config.getoption("--recordings")
    if folder is None:
        pytest.skip("needs real recordings: pytest --recordings DIR")
    return folder


@pytest.mark.parametrize(("name", "count"), [("lake", 2400), ("jungle", 1167), ("quirks", 48)])
def test_every_row_of_real_recordings_is_read(recordings: Path, name: str, count: int) -> None:
    log = read_driving_logs([recordings / name])
    assert len(log.rows) == count
    assert not any(log.left_out)
    assert (log.rows[["left", "right"]] != "").all(axis=None)


def test_decimal_commas_read_like_the_same_log_with_points(recordings: Path) -> None:
    commas, points = (read_driving_logs([recordings / "quirks" / name]).rows
                      for name in ("decimal_comma", "absolute_posix_paths"))
    numbers = ["steering", "throttle", "brake", "speed"]
    np.testing.assert_array_equal(commas[numbers], points[numbers])


@pytest.mark.parametrize(("side", "offset"), [("left", -0.806), ("right", 0.825)])
def test_the_viewpoint_warp_makes_a_side_cameras_picture(recordings: Path, side: str, offset: float) -> None:
    homography = camera.viewpoint_homography(offset, 0)
    road = np.s_[75:132, 60:260]
    errors = []
    for _, row in read_driving_logs([recordings / "lake"]).rows.iloc[100::100].iterrows():
        centre, aside = (read_frame(row[name]).astype(np.float32) for name in ("center", side))
        warped = cv2.warpPerspective(centre, homography, (320, 160), borderMode=cv2.BORDER_REPLICATE)
        errors.append([np.abs(picture - aside)[road].mean() for picture in (centre, warped)])
    unwarped, warped = np.mean(errors, axis=0)
    assert warped < 0.55 * unwarped
