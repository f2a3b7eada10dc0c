import os
from pathlib import Path

import cv2
import pytest
from conftest import picture, write_picture

from pilot.data.frames import UnreadableImage, decode_frame, read_frame


def test_frames_are_rgb_of_the_cameras_size(tmp_path: Path) -> None:
    write_picture(tmp_path / "a.jpg", picture(0)[::2, ::2])
    frame = read_frame(tmp_path / "a.jpg")
    assert frame.shape == (160, 320, 3)
    assert frame[100, 160, 0] > 200 > 120 > frame[100, 160, 2]


@pytest.mark.parametrize(
    ("content", "fault"),
    [(None, "image missing"), (b"", "image empty"), (b"\xff\xd8 no", "image corrupt"), (b"text", "image corrupt")],
)
def test_faults_are_named(tmp_path: Path, content: bytes | None, fault: str) -> None:
    path = tmp_path / "a.jpg"
    if content is not None:
        path.write_bytes(content)
    with pytest.raises(UnreadableImage, match=f"a.jpg: {fault}"):
        read_frame(path)


def test_a_cut_off_picture_is_damaged_not_half_grey() -> None:
    data = cv2.imencode(".jpg", picture(0))[1]
    assert decode_frame(data) is not None
    assert decode_frame(data[: len(data) // 2]) is None


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="there are no named pipes here")
def test_a_pipe_is_refused_instead_of_waited_for(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "center.jpg")
    with pytest.raises(UnreadableImage, match="image is not a regular file"):
        read_frame(tmp_path / "center.jpg")


def test_a_file_too_large_for_an_image_is_not_read(tmp_path: Path) -> None:
    with (tmp_path / "center.jpg").open("wb") as file:
        file.truncate(1 << 40)  # sparse
    with pytest.raises(UnreadableImage, match="image too large"):
        read_frame(tmp_path / "center.jpg")


def test_an_image_of_one_pixel_is_no_frame(tmp_path: Path) -> None:
    write_picture(tmp_path / "center.jpg", picture(0)[:1, :1])
    with pytest.raises(UnreadableImage, match="image too small"):
        read_frame(tmp_path / "center.jpg")
