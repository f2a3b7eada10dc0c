from pathlib import Path

import numpy as np
import pytest
from conftest import Recording, picture, stamp, steering_of, write_picture

from pilot.data.driving_log import NoUsableData, read_driving_logs
from pilot.data.left_out import LeftOut, read_left_out, write_left_out
from pilot.data.steered_by import STEERED_BY, format_steered_by

WINDOWS = "C:\\Users\\Doe, John\\IMG\\"
NUMBERS = ["steering", "throttle", "brake", "speed"]


def names(moment: int, folder: str = "IMG/", between: str = ",") -> str:
    return between.join(f"{folder}{camera}_{stamp(moment)}.jpg" for camera in ("center", "left", "right"))


def steering_read(folder: Path) -> list[float]:
    return read_driving_logs([folder]).rows["steering"].tolist()


EXPECTED = [steering_of(moment) for moment in range(12)]


@pytest.mark.parametrize(
    ("head", "line", "end"),
    [
        ("", lambda m: f"{names(m)},{steering_of(m)},1,0,30.1", "\n"),
        ("center,left,right,steering,throttle,brake,speed\n", lambda m: f"{names(m)},{steering_of(m)},1,0,30.1", "\n"),
        (
            "center,left,right,steering,throttle,brake,speed\n",
            lambda m: f"{names(m, between=', ')}, {steering_of(m)}, 1, 0, 30.1",
            "\n",
        ),
        ("", lambda m: f"{names(m, '/home/somebody else/IMG/')},{steering_of(m)},1,0,30.1", "\n"),
        ("", lambda m: f"{names(m, WINDOWS)},{steering_of(m)},1,0,30.1", "\r\n"),
        ("﻿", lambda m: f"{names(m)},{steering_of(m)},1,0,30.1", "\r\n"),
        ("", lambda m: f"{names(m)},{steering_of(m)},1,0,30.1,,laps,IMG,center_{stamp(m)},jpg,", "\r\n"),
        ("", lambda m: f"{names(m)},{steering_of(m):.6e},1,0,30.1", "\n"),
        ("", lambda m: f"{names(m, between=';')};{str(steering_of(m)).replace('.', ',')};1;0;30,1", "\n"),
        ("", lambda m: f'{names(m)},"{str(steering_of(m)).replace(".", ",")}",1,0,"30,1"', "\n"),
        ("center,left,right,brake,steering\n", lambda m: f"{names(m)},0,{steering_of(m)}", "\n"),
    ],
    ids=[
        "plain",
        "header",
        "spaces",
        "absolute",
        "windows",
        "bom",
        "spreadsheet",
        "scientific",
        "semicolons",
        "quoted",
        "reordered",
    ],
)
def test_reads_every_variant_of_the_format(recording: Recording, head: str, line: object, end: str) -> None:
    folder = recording(moments=12, head=head, line=line, end=end)
    rows = read_driving_logs([folder]).rows
    np.testing.assert_allclose(rows["steering"], EXPECTED, atol=1e-6)
    assert rows["center"].iloc[3] == str(folder / "IMG" / f"center_{stamp(3)}.jpg")
    np.testing.assert_allclose(np.diff(rows["time"]), 0.1, atol=1e-6)


def test_tells_decimal_commas_from_separators(recording: Recording) -> None:
    truth = [
        (-0.1447982, 1, 0, 30.1844),
        (0, 1, 0, 30.19027),
        (-0.35, 0.5, 0, 30.16378),
        (0, 0, 0, 12),
        (0.1, 0, 0, 9.5),
        (7.6e-05, 0.25, 0.125, 0.01438605),
        (1, 1, 0, 30.19),
        (-1, 0, 0, 30),
    ]

    def line(moment: int) -> str:
        return f"{names(moment)}," + ",".join(f"{v:.7g}".replace(".", ",").replace("e", "E") for v in truth[moment])

    rows = read_driving_logs([recording(moments=len(truth), line=line)]).rows
    np.testing.assert_allclose(rows[NUMBERS], truth)


def test_ambiguous_decimal_commas_follow_the_neighbouring_rows(recording: Recording) -> None:
    # "0,1,0,0,12" is 0.1|0|0|12 or 0|1|0|0.12: the speed before and after tells
    lines = ["0,2,0,0,11,5", "0,1,0,0,12", "0,05,0,0,12,5"]
    rows = read_driving_logs([recording(moments=3, line=lambda m: f"{names(m)},{lines[m]}")]).rows
    assert rows["steering"].tolist() == [0.2, 0.1, 0.05]
    lines = ["0,1,0,0,115", "0,1,0,0,12", "0,1,0,0,125"]
    rows = read_driving_logs([recording(moments=3, line=lambda m: f"{names(m)},{lines[m]}")]).rows
    assert rows["throttle"].tolist() == [1, 1, 1]


def test_leaves_out_and_counts_what_cannot_be_used(recording: Recording) -> None:
    bad = {2: "nan", 3: "1.5", 4: "", 5: "left"}
    folder = recording(moments=20, line=lambda m: f"{names(m)},{bad.get(m, steering_of(m))},1,0,30.1")
    image = folder / "IMG" / f"center_{stamp(7)}.jpg"
    image.unlink()
    (folder / "IMG" / f"center_{stamp(8)}.jpg").write_bytes(b"")
    cut = folder / "IMG" / f"center_{stamp(9)}.jpg"
    cut.write_bytes(cut.read_bytes()[:-300])
    (folder / "IMG" / f"center_{stamp(10)}.jpg").write_text("not a picture")
    (folder / "IMG" / f"left_{stamp(11)}.jpg").write_bytes(b"")
    (folder / "IMG" / f"right_{stamp(12)}.jpg").unlink()
    log = folder / "driving_log.csv"
    log.write_text(log.read_text() + f"{names(0)[:70]}")
    result = read_driving_logs([folder])
    assert dict(result.left_out[0]) == {
        "steering not a number": 3,
        "steering outside -1..1": 1,
        "image missing": 1,
        "image empty": 1,
        "image corrupt": 2,
        "row incomplete": 1,
        "side image empty": 1,
        "side image missing": 1,
    }
    assert len(result.rows) == 12
    assert (result.rows["left"] == "").sum() == 1
    assert "image corrupt" in result.table()


def test_last_line_cut_in_its_numbers_is_left_out(recording: Recording) -> None:
    folder = recording(moments=5)
    log = folder / "driving_log.csv"
    log.write_text(log.read_text() + f"{names(4)},0.1,0.")
    result = read_driving_logs([folder])
    assert len(result.rows) == 5
    assert result.left_out[0]["row incomplete"] == 1


def test_logs_without_side_cameras(recording: Recording) -> None:
    folder = recording(moments=5, cameras=("center",))
    rows = read_driving_logs([folder]).rows
    assert rows["steering"].tolist() == EXPECTED[:5]
    assert (rows[["left", "right"]] == "").all(axis=None)
    line = lambda m: f"IMG/center_{stamp(m)}.jpg,,,{steering_of(m)},1,0,30.1"  # noqa: E731
    blank = recording("blank", 5, line, cameras=("center",))
    assert steering_read(blank) == EXPECTED[:5]


def test_searches_folders_and_reads_each_recording_once(recording: Recording, tmp_path: Path) -> None:
    recording("laps/one", 5)
    recording("laps/two", 7)
    log = read_driving_logs([tmp_path, tmp_path / "laps" / "one"])
    assert len(log.rows) == 12
    assert log.rows["recording"].nunique() == 2


def test_pictures_of_another_size_are_scaled(recording: Recording) -> None:
    folder = recording(moments=3)
    write_picture(folder / "IMG" / f"center_{stamp(1)}.jpg", np.repeat(np.repeat(picture(0), 2, 0), 2, 1))
    assert len(read_driving_logs([folder]).rows) == 3


@pytest.mark.parametrize(
    ("content", "says"),
    [
        (None, "no such folder"),
        ("", "no row can be used"),
        ("center,left,right,throttle\n", "steering"),
        ("IMG/center_1.jpg,IMG/left_1.jpg,IMG/right_1.jpg,0,0,0,0\n", "image missing (1)"),
        ("\0\0\0\0", "no row can be used"),
    ],
)
def test_nothing_usable_is_an_error_with_file_and_cure(tmp_path: Path, content: str | None, says: str) -> None:
    folder = tmp_path / "laps"
    if content is not None:
        folder.mkdir()
        (folder / "driving_log.csv").write_text(content)
    with pytest.raises(NoUsableData) as error:
        read_driving_logs([folder])
    assert says in str(error.value)
    assert "laps" in str(error.value)
    assert "record" in str(error.value).lower() or "columns" in str(error.value)


def test_an_empty_folder_says_what_to_do(tmp_path: Path) -> None:
    with pytest.raises(NoUsableData, match="no driving_log.csv in it or below. Record laps"):
        read_driving_logs([tmp_path])


def test_links_may_lead_to_files_of_the_recording_only(recording: Recording, tmp_path: Path) -> None:
    folder = recording(moments=12)
    images = folder / "IMG"
    outside = tmp_path / "holiday.jpg"
    write_picture(outside, picture(0))
    for moment, target in ((3, outside), (4, images / f"center_{stamp(5)}.jpg")):
        link = images / f"center_{stamp(moment)}.jpg"
        link.unlink()
        link.symlink_to(target)
    log = read_driving_logs([folder])
    assert log.left_out[0] == {"image linked from elsewhere": 1}
    assert len(log.rows) == 11


def test_a_folder_of_images_may_not_be_a_link_to_elsewhere(recording: Recording, tmp_path: Path) -> None:
    folder = recording(moments=12)
    (folder / "IMG").rename(tmp_path / "elsewhere")
    (folder / "IMG").symlink_to(tmp_path / "elsewhere")
    with pytest.raises(NoUsableData, match=r"image linked from elsewhere \(12\)"):
        read_driving_logs([folder])


def test_images_that_would_fill_the_memory_are_left_out(recording: Recording) -> None:
    folder = recording(moments=12)
    bomb = bytearray((folder / "IMG" / f"center_{stamp(2)}.jpg").read_bytes())
    at = bomb.index(b"\xff\xc0") + 5
    bomb[at : at + 4] = b"\xf0\x00\xf0\x00"
    (folder / "IMG" / f"center_{stamp(2)}.jpg").write_bytes(bomb)
    assert read_driving_logs([folder]).left_out[0] == {"image corrupt": 1}


def test_leaves_out_what_a_model_steered_before_it_was_corrected(recording: Recording) -> None:
    folder = recording(moments=12)
    lines = [
        format_steered_by(f"center_{stamp(moment)}.jpg", "model" if moment < 5 else "person") for moment in range(10)
    ]
    (folder / STEERED_BY).write_text("".join(lines) + "center_")  # cut off, as by a power failure
    log = read_driving_logs([folder])
    assert log.rows["steering"].tolist() == EXPECTED[5:]
    assert log.rows["correction"].tolist() == [True] * 5 + [False] * 2
    assert log.left_out[0] == {"steered by the model": 5}


def test_leaves_out_what_the_user_leaves_out(recording: Recording) -> None:
    folder = recording(moments=12)
    image = "center_{}.jpg".format
    before = (folder / "driving_log.csv").read_bytes()
    ranges = [LeftOut(image(stamp(2)), image(stamp(4)), "crash, and reset"), LeftOut("gone.jpg", image(stamp(9)))]
    write_left_out(folder, ranges)
    assert read_left_out(folder) == ranges
    log = read_driving_logs([folder])
    assert log.rows["steering"].tolist() == EXPECTED[:2] + EXPECTED[5:]
    assert log.left_out[0] == {"left out by hand": 3}
    write_left_out(folder, [])
    assert len(read_driving_logs([folder]).rows) == 12
    assert (folder / "driving_log.csv").read_bytes() == before


def test_a_recording_without_corrections_has_none(recording: Recording) -> None:
    assert not read_driving_logs([recording()]).rows["correction"].any()
