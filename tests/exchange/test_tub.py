"""Recordings as donkeycar's tubs, and back."""

import json
from pathlib import Path

import cv2
import numpy as np
import pytest
from conftest import Recording, picture

from pilot.commands.inspect_data import main
from pilot.data.driving_log import NoUsableData, read_driving_logs
from pilot.data.frames import read_frame
from pilot.data.left_out import LeftOut, write_left_out
from pilot.exchange.tub import RECORDS_PER_CATALOG, import_tub, read_tub


def test_a_recording_survives_the_round_trip(recording: Recording, tmp_path: Path) -> None:
    folder = recording(moments=40)
    before = read_driving_logs([folder], annotated=False).rows
    names = [Path(path).name for path in before["center"]]
    write_left_out(folder, [LeftOut(names[5], names[7])])
    assert main(["export", str(folder), str(tmp_path / "tub")]) == 0
    assert main(["import", str(tmp_path / "tub"), str(tmp_path / "back")]) == 0
    after = read_driving_logs([tmp_path / "back"])
    assert after.left_out[0] == {"left out by hand": 3}
    kept = before.drop(index=range(5, 8)).reset_index(drop=True)
    for name, error in (("steering", 1e-6), ("throttle", 1e-6), ("speed", 1e-4), ("time", 2e-3)):
        np.testing.assert_allclose(after.rows[name], kept[name], atol=error)
    difference = read_frame(after.rows["center"].iloc[3]).astype(int) - read_frame(kept["center"].iloc[3])
    assert np.abs(difference).mean() < 1


def test_a_tub_is_as_donkeycar_reads_it(recording: Recording, tmp_path: Path) -> None:
    main(["export", str(recording(moments=12)), str(tmp_path / "tub")])
    inputs, types, _, metadata, state = map(json.loads, (tmp_path / "tub" / "manifest.json").read_text().splitlines())
    assert dict(zip(inputs, types, strict=True))["cam/image_array"] == "image_array"
    assert metadata["created_at"] > 0
    assert state == {"paths": ["catalog_0.catalog"], "current_index": 12, "max_len": 1000, "deleted_indexes": []}
    catalog = (tmp_path / "tub" / "catalog_0.catalog").read_bytes()
    lengths = json.loads((tmp_path / "tub" / "catalog_0.catalog_manifest").read_text())["line_lengths"]
    fourth = json.loads(catalog[sum(lengths[:3]) : sum(lengths[:4])])  # as donkeycar seeks a record
    assert fourth["_index"] == 3
    assert (tmp_path / "tub" / "images" / fourth["cam/image_array"]).exists()
    assert -1 <= fourth["user/angle"] <= 1


def donkey_tub(folder: Path, records: int = 1100) -> Path:
    """A tub as donkeycar writes it: small pictures, two catalogs, no speed, one damaged picture, deleted records."""
    (folder / "images").mkdir(parents=True)
    small = cv2.resize(picture(0.0), (160, 120))
    paths = []
    for start in range(0, records, RECORDS_PER_CATALOG):
        lines = []
        for number in range(start, min(start + RECORDS_PER_CATALOG, records)):
            name = f"{number}_cam_image_array_.jpg"
            cv2.imwrite(str(folder / "images" / name), small)
            record = {"_index": number, "_timestamp_ms": 1_700_000_000_000 + 50 * number, "cam/image_array": name}
            lines.append(json.dumps({**record, "user/angle": -0.25, "user/throttle": 0.5, "user/mode": "user"}))
        paths.append(f"catalog_{len(paths)}.catalog")
        (folder / paths[-1]).write_text("\r\n".join(lines) + "\r\n", newline="")
    (folder / "images" / "7_cam_image_array_.jpg").write_bytes(b"")
    state = {"paths": paths, "current_index": records, "max_len": 1000, "deleted_indexes": [3, 1050]}
    (folder / "manifest.json").write_text("".join(json.dumps(each) + "\n" for each in ([], [], {}, {}, state)))
    return folder


def test_reads_a_tub_of_a_donkeycar(tmp_path: Path) -> None:
    assert import_tub(read_tub(donkey_tub(tmp_path / "tub")), tmp_path / "mine") == 1099
    log = read_driving_logs([tmp_path / "mine"])
    assert len(log.rows) == 1097
    assert set(log.rows["steering"]) == {-0.25}
    assert log.rows["speed"].isna().all()
    assert log.rows["time"].diff().median() == pytest.approx(0.05)
    assert read_frame(log.rows["center"].iloc[0]).shape == (160, 320, 3)


@pytest.mark.parametrize("content", [None, "", "[]\n", "[]\n[]\n{}\n{}\n[1]\n", "\x00" * 50])
def test_what_is_no_tub_is_named(tmp_path: Path, content: str | None) -> None:
    if content is not None:
        (tmp_path / "manifest.json").write_text(content)
    with pytest.raises(NoUsableData, match="manifest.json"):
        read_tub(tmp_path)


def test_nothing_that_is_there_is_overwritten(recording: Recording, tmp_path: Path) -> None:
    folder = recording(moments=12)
    (tmp_path / "tub").mkdir()
    assert main(["export", str(folder), str(tmp_path / "tub")]) == 1
    assert main(["import", str(donkey_tub(tmp_path / "other", 10)), str(folder)]) == 1
    assert len(read_driving_logs([folder]).rows) == 12
