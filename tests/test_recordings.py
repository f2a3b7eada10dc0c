"""Checks on real recordings: run with `pytest --recordings DIR` (a folder with lake, jungle and quirks)."""

from pathlib import Path

import cv2
import numpy as np
import pytest
from conftest import straightest

from pilot import camera
from pilot.data.driving_log import read_driving_logs
from pilot.data.frames import read_frame
from pilot.simulator.simulator import Simulator


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
    commas, points = (
        read_driving_logs([recordings / "quirks" / name]).rows for name in ("decimal_comma", "absolute_posix_paths")
    )
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


def line_rows(frame: np.ndarray) -> tuple[float, float] | None:
    """The rows at which the yellow lines meet the frame's left and right border; None if one is not seen."""
    rows = []
    for columns in (slice(0, 5), slice(315, 320)):
        strip = frame[80:136, columns].astype(float).mean(1)
        yellow = (strip[:, 0] + strip[:, 1]) / 2 - strip[:, 2]
        ridge = [
            yellow[row] - max(yellow[row - 5 : row - 2].max(), yellow[row + 3 : row + 6].max()) for row in range(5, 51)
        ]
        if max(ridge) < 20:
            return None
        rows.append(80 + 5 + float(np.argmax(ridge)))
    return rows[0], rows[1]


def offset_in(rows: tuple[float, float]) -> float:
    """Metres that the middle between the lines lies to the right of the camera."""
    to_ground = np.linalg.inv(camera.ground_to_pixel())
    left, right = (to_ground @ (column, row, 1) for column, row in zip((2, 317), rows, strict=True))
    return float(left[0] / left[2] + right[0] / right[2]) / 2


def test_the_built_in_lakes_lines_meet_the_border_where_the_real_ones_do(recordings: Path) -> None:
    rows = read_driving_logs([recordings / "lake"]).rows
    straight = rows["steering"].abs().rolling(15, center=True).max() < 0.03
    real = [found for path in rows["center"][straight] if (found := line_rows(read_frame(path)))]
    with Simulator() as simulator:
        simulator.reset("lake")
        start = straightest(simulator.episode.track)
        differences = []
        for found in real:
            simulator.episode.place(start, -offset_in(found))
            rendered = line_rows(simulator.look()["center"])
            if rendered:
                differences.append(np.subtract(rendered, found))
    assert len(differences) > 100
    assert np.abs(differences).mean() < 3
