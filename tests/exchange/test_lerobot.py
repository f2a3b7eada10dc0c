"""Recordings as LeRobot's data sets, and back."""

import json
from pathlib import Path

import av
import numpy as np
import pandas as pd
import pytest
from conftest import Recording

from pilot.commands.inspect_data import main
from pilot.data.driving_log import NoUsableData, read_driving_logs
from pilot.data.frames import read_frame
from pilot.data.left_out import LeftOut, write_left_out
from pilot.exchange.lerobot import import_dataset
from pilot.vehicle import CAMERAS


@pytest.fixture
def folder(recording: Recording) -> Path:
    """A recording with a pause, and two rows that are left out."""
    folder = recording(moments=60)
    log = (folder / "driving_log.csv").read_text().splitlines(keepends=True)
    (folder / "driving_log.csv").write_text("".join(log[:25] + log[45:]))
    names = [line.split(",")[0].removeprefix("IMG/") for line in log]
    write_left_out(folder, [LeftOut(names[5], names[6], "bump")])
    return folder


def test_a_recording_survives_the_round_trip(folder: Path, tmp_path: Path) -> None:
    assert main(["export", str(folder), str(tmp_path / "set"), "--format", "lerobot"]) == 0
    assert main(["import", str(tmp_path / "set"), str(tmp_path / "back")]) == 0
    before, after = read_driving_logs([folder]), read_driving_logs([tmp_path / "back"])
    assert after.left_out == before.left_out == ({"left out by hand": 2},)
    for name, error in (("steering", 1e-6), ("throttle", 1e-6), ("speed", 1e-4), ("time", 2e-3)):
        np.testing.assert_allclose(after.rows[name], before.rows[name], atol=error)
    for camera in CAMERAS:
        for row in (0, 20, 30):
            frames = [read_frame(rows[camera].iloc[row]).astype(int) for rows in (before.rows, after.rows)]
            assert np.abs(frames[1] - frames[0]).mean() < 6  # the video is compressed


def test_a_data_set_is_as_lerobot_reads_it(folder: Path, tmp_path: Path) -> None:
    main(["export", str(folder), str(tmp_path / "set"), "--format", "lerobot"])
    info = json.loads((tmp_path / "set" / "meta" / "info.json").read_text())
    assert (info["codebase_version"], info["fps"], info["total_episodes"], info["total_frames"]) == ("v3.0", 10, 2, 40)
    data = pd.read_parquet(tmp_path / "set" / info["data_path"].format(chunk_index=0, file_index=0))
    assert set(data.columns) == {name for name, feature in info["features"].items() if feature["dtype"] != "video"}
    np.testing.assert_allclose(data["timestamp"], data["frame_index"] / 10, atol=1e-6)
    assert data["episode_index"].tolist() == [0] * 25 + [1] * 15
    episodes = pd.read_parquet(tmp_path / "set" / "meta" / "episodes" / "chunk-000" / "file-000.parquet")
    assert episodes[["length", "dataset_from_index", "dataset_to_index"]].to_numpy().tolist() == [
        [25, 0, 25],
        [15, 25, 40],
    ]
    tasks = pd.read_parquet(tmp_path / "set" / "meta" / "tasks.parquet")
    assert tasks["task_index"].tolist() == [0]
    for camera in CAMERAS:
        key = f"observation.images.{camera}"
        assert episodes[f"videos/{key}/from_timestamp"].tolist() == [0.0, 2.5]
        path = info["video_path"].format(video_key=key, chunk_index=0, file_index=0)
        with av.open(str(tmp_path / "set" / path)) as video:
            assert video.streams.video[0].average_rate == 10
            assert sum(1 for _ in video.decode(video=0)) == 40
    statistics = json.loads((tmp_path / "set" / "meta" / "stats.json").read_text())
    assert np.shape(statistics["observation.images.center"]["mean"]) == (3, 1, 1)
    assert statistics["action"]["max"][0] == pytest.approx(data["action"].str[0].max())


def test_reads_a_data_set_of_another_robot(folder: Path, tmp_path: Path) -> None:
    """One camera of another name, no times, no speed, no names of actions."""
    main(["export", str(folder), str(tmp_path / "set"), "--format", "lerobot"])
    path = tmp_path / "set" / "meta" / "info.json"
    info = json.loads(path.read_text())
    unusual = ("observation.state", "recorded_time", "left_out")
    for name in ("observation.images.left", "observation.images.right", *unusual):
        del info["features"][name]
    info["features"]["observation.images.front"] = info["features"].pop("observation.images.center")
    info["features"]["action"]["names"] = None
    path.write_text(json.dumps(info))
    (tmp_path / "set" / "videos" / "observation.images.center").rename(
        tmp_path / "set" / "videos" / "observation.images.front"
    )
    for file in ("data/chunk-000/file-000.parquet", "meta/episodes/chunk-000/file-000.parquet"):
        table = pd.read_parquet(tmp_path / "set" / file).drop(columns=["recorded_time", "left_out"], errors="ignore")
        table.columns = [name.replace("images.center", "images.front") for name in table.columns]
        table.to_parquet(tmp_path / "set" / file)
    assert import_dataset(tmp_path / "set", tmp_path / "mine") == 40
    rows = read_driving_logs([tmp_path / "mine"]).rows
    assert rows["time"].diff().max() > 5  # between the episodes
    assert rows["speed"].isna().all()
    assert (rows["left"] == "").all()


@pytest.mark.parametrize("content", ["", "{}", '{"features": {}, "fps": 10}'])
def test_what_is_no_data_set_is_named(tmp_path: Path, content: str) -> None:
    (tmp_path / "set" / "meta").mkdir(parents=True)
    (tmp_path / "set" / "meta" / "info.json").write_text(content)
    with pytest.raises(NoUsableData, match="no data set of LeRobot"):
        import_dataset(tmp_path / "set", tmp_path / "mine")
    assert not (tmp_path / "mine").exists()
