import os
from pathlib import Path

import cv2
import numpy as np
import pytest
from conftest import picture, write_picture

from pilot.data import frame_cache
from pilot.data.frame_cache import FrameCache
from pilot.data.frames import UnreadableImage, read_frame

ROWS = (60, 150)
FRAME = 90 * 320 * 3  # bytes
LIMIT = 10 * FRAME


@pytest.fixture
def pictures(tmp_path: Path) -> list[str]:
    return write_pictures(tmp_path / "IMG", 4)


def write_pictures(folder: Path, count: int) -> list[str]:
    for number in range(count):
        write_picture(folder / f"{number}.jpg", picture(0.1 * number))
    return [str(folder / f"{number}.jpg") for number in range(count)]


def checked(cache: FrameCache, pictures: list[str]) -> FrameCache:
    cache.check(pictures)
    return cache


def decoded(monkeypatch: pytest.MonkeyPatch) -> list[str]:
    """Fills with the pictures that are decoded from now on."""
    paths: list[str] = []
    monkeypatch.setattr(frame_cache, "read_frame", lambda path: (paths.append(path), read_frame(path))[1])
    return paths


def test_a_picture_is_decoded_once_and_never_again(
    pictures: list[str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    paths = decoded(monkeypatch)
    for _ in range(2):
        cache = checked(FrameCache(ROWS, limit=LIMIT, folder=tmp_path / "cache"), pictures)
        for path in pictures:
            np.testing.assert_array_equal(cache.read(path), read_frame(path)[60:150])
    assert sorted(paths) == pictures


def test_faults_are_remembered(pictures: list[str], tmp_path: Path) -> None:
    Path(pictures[1]).write_bytes(b"")
    for _ in range(2):
        cache = FrameCache(ROWS, limit=LIMIT, folder=tmp_path / "cache")
        assert cache.check([*pictures, str(tmp_path / "gone.jpg")]) == {
            pictures[1]: "image empty",
            str(tmp_path / "gone.jpg"): "image missing",
        }
    with pytest.raises(UnreadableImage, match="image missing"):
        cache.read("absent.jpg")


def test_a_changed_picture_is_decoded_anew(pictures: list[str], tmp_path: Path) -> None:
    checked(FrameCache(ROWS, limit=LIMIT, folder=tmp_path / "cache"), pictures)
    write_picture(Path(pictures[2]), picture(0.9))
    os.utime(pictures[2], (0, 0))
    cache = checked(FrameCache(ROWS, limit=LIMIT, folder=tmp_path / "cache"), pictures)
    np.testing.assert_array_equal(cache.read(pictures[2]), read_frame(pictures[2])[60:150])


def test_a_picture_replaced_with_the_same_size_and_time_is_decoded_anew(pictures: list[str], tmp_path: Path) -> None:
    for brightness in (0, 0x77):
        frame = np.full((160, 320, 3), brightness, np.uint8)
        png = cv2.imencode(".png", frame, [cv2.IMWRITE_PNG_COMPRESSION, 0])[1]  # not compressed: always the same size
        Path(pictures[0]).write_bytes(png.tobytes())
        os.utime(pictures[0], (0, 0))
        cache = checked(FrameCache(ROWS, limit=LIMIT, folder=tmp_path / "cache"), pictures)
        assert cache.read(pictures[0]).min() == brightness


@pytest.mark.parametrize("place", [0, FRAME + 4321, 2 * FRAME - 1, 4 * FRAME, 4 * FRAME + 31, -33, -1])
def test_damaged_bytes_are_never_served(
    pictures: list[str], tmp_path: Path, caplog: pytest.LogCaptureFixture, place: int
) -> None:
    Path(pictures[3]).write_bytes(b"")
    folder = tmp_path / "cache"
    early = checked(FrameCache(ROWS, limit=LIMIT, folder=folder), pictures)
    (file,) = folder.iterdir()
    damaged = bytearray(file.read_bytes())
    damaged[place] ^= 0x10
    file.write_bytes(damaged)
    late = FrameCache(ROWS, limit=LIMIT, folder=folder)
    assert late.check(pictures) == {pictures[3]: "image empty"}
    for cache in (late, early):
        for path in pictures[:3]:
            np.testing.assert_array_equal(cache.read(path), read_frame(path)[60:150])
    if place < 3 * FRAME and place >= 0:
        assert "cached frames are discarded" in caplog.text
        assert list(folder.iterdir()) == []  # stored again by the next training


def test_a_shortened_file_is_not_used(pictures: list[str], tmp_path: Path) -> None:
    folder = tmp_path / "cache"
    checked(FrameCache(ROWS, limit=LIMIT, folder=folder), pictures)
    (file,) = folder.iterdir()
    for size in (3 * FRAME, 4 * FRAME, 4 * FRAME + 20):
        os.truncate(file, size)
        cache = checked(FrameCache(ROWS, limit=LIMIT, folder=folder), pictures)
        np.testing.assert_array_equal(cache.read(pictures[2]), read_frame(pictures[2])[60:150])


def test_the_longest_unused_recording_makes_room(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    first, second, third = (write_pictures(tmp_path / name, 4) for name in "abc")
    folder = tmp_path / "cache"
    for used, recording in enumerate((first, second, first)):
        checked(FrameCache(ROWS, limit=LIMIT, folder=folder), recording)
        for file in folder.iterdir():  # a clock with coarse ticks would make this a matter of luck
            if file.stat().st_mtime > 1000:
                os.utime(file, (used, used))
    checked(FrameCache(ROWS, limit=LIMIT, folder=folder), third)
    assert sum(file.stat().st_size for file in folder.iterdir()) <= LIMIT
    paths = decoded(monkeypatch)
    for recording in (first, third):
        checked(FrameCache(ROWS, limit=LIMIT, folder=folder), recording)
    assert paths == []
    checked(FrameCache(ROWS, limit=LIMIT, folder=folder), second)
    assert sorted(paths) == second


def test_what_can_never_fit_takes_nothing_away(tmp_path: Path) -> None:
    small, large = write_pictures(tmp_path / "a", 1), write_pictures(tmp_path / "b", 9)
    folder = tmp_path / "cache"
    checked(FrameCache(ROWS, limit=4 * FRAME, folder=folder), small)
    before = list(folder.iterdir())
    checked(FrameCache(ROWS, limit=4 * FRAME, folder=folder), large)
    assert list(folder.iterdir()) == before != []


def test_what_does_not_fit_is_decoded_each_time(pictures: list[str], tmp_path: Path) -> None:
    cache = checked(FrameCache(ROWS, limit=2 * FRAME, folder=tmp_path / "cache"), pictures)
    assert list((tmp_path / "cache").iterdir()) == []
    np.testing.assert_array_equal(cache.read(pictures[0]), read_frame(pictures[0])[60:150])


def test_a_cleared_cache_and_a_crash_half_way_do_no_harm(pictures: list[str], tmp_path: Path) -> None:
    folder = tmp_path / "cache"
    cache = checked(FrameCache(ROWS, limit=LIMIT, folder=folder), pictures)
    (file,) = folder.iterdir()
    file.unlink()
    np.testing.assert_array_equal(cache.read(pictures[0]), read_frame(pictures[0])[60:150])
    left_behind = folder / ".frames.1.part"
    left_behind.write_bytes(b"half")
    os.utime(left_behind, (0, 0))
    checked(FrameCache(ROWS, limit=LIMIT, folder=folder), pictures)
    assert not left_behind.exists()


def test_trouble_with_the_disk_is_told_and_does_not_stop(pictures: list[str], tmp_path: Path) -> None:
    (tmp_path / "cache").write_text("a file where the folder should be")
    cache = FrameCache(ROWS, limit=LIMIT, folder=tmp_path / "cache")
    assert cache.check(pictures) == {}
    assert "cache" in cache.error
    np.testing.assert_array_equal(cache.read(pictures[0]), read_frame(pictures[0])[60:150])


def test_ctrl_c_leaves_no_half_file(pictures: list[str], tmp_path: Path) -> None:
    def interrupted(paths: list[str], _count: int, _title: str) -> object:
        yield paths[0]
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        FrameCache(ROWS, limit=LIMIT, folder=tmp_path / "cache").check(pictures, interrupted)
    assert list((tmp_path / "cache").iterdir()) == []
