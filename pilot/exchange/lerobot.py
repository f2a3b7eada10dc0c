"""Recordings as LeRobot's data sets, version 3 (https://huggingface.co/docs/lerobot): writing and reading.

A data set holds one row per moment in Parquet files, one video per camera, and descriptions in meta/. Here an episode
is a drive without a pause; `action` is steering and throttle (-1..1), `observation.state` the speed in m/s. Its videos
have a constant rate; the column `recorded_time` keeps the times of the recording, `left_out` what its user leaves out.
"""

import json
from collections.abc import Iterator
from datetime import datetime, timedelta
from fractions import Fraction
from pathlib import Path
from typing import Any

import av
import numpy as np
import pandas as pd

from pilot.arrays import Floats
from pilot.data.driving_log import NoUsableData
from pilot.data.frames import encode_frame, read_frame
from pilot.data.left_out import LeftOut, is_left_out, read_left_out, write_left_out
from pilot.data.log_format import LOG_NAME, format_line, time_stamp
from pilot.data.segments import segment_numbers
from pilot.exchange.pictures import as_frame
from pilot.files import move_when_done, refuse_existing
from pilot.progress import ProgressBar, no_bar
from pilot.vehicle import CAMERAS, COLUMNS, MPH, ROWS

VERSION, TASK = "v3.0", "drive along the road"
INFO = Path("meta") / "info.json"
DATA = "data/chunk-{chunk_index:03d}/file-{file_index:03d}.parquet"
VIDEO = "videos/{video_key}/chunk-{chunk_index:03d}/file-{file_index:03d}.mp4"
EPISODES = "meta/episodes/chunk-000/file-000.parquet"
IMAGES = "observation.images."
ENCODING: dict[str, str] = {
    "crf": "18",
    "preset": "fast",
    "g": "10",
}  # a key frame every ten frames, so that players can jump
SCALARS = {"timestamp": "float32", "recorded_time": "float64", "left_out": "bool"} | dict.fromkeys(
    ("frame_index", "episode_index", "index", "task_index"), "int64"
)
Frames = dict[tuple[str, str], dict[int, int]]  # rows of frames, by their number, by camera and video file
STATISTICS_FRAMES = 50  # from which the images' statistics are computed


class NeedsPyArrow(RuntimeError):
    """The package that reads and writes Parquet files is not installed; the message says how to install it."""


def check_parquet() -> None:
    """Check that Parquet files can be read and written.

    Raises:
        NeedsPyArrow: they cannot.
    """
    try:
        import pyarrow  # noqa: F401, PLC0415 - not needed otherwise
    except ImportError as error:
        raise NeedsPyArrow("LeRobot's data sets need another package: pip install pyarrow==26.0.1") from error


# Writing


def write_dataset(rows: pd.DataFrame, recording: Path, dataset: Path, progress: ProgressBar[Any] = no_bar) -> None:
    """Write a recording as a data set.

    Args:
        rows: all rows of the recording, also those that are left out.
        recording: its folder, for what is left out.
        dataset: folder to write; must not exist.
        progress: progress bar over the images.

    Raises:
        NeedsPyArrow: Parquet files cannot be written.
        FileExistsError: the folder exists.
        OSError: it cannot be written.
    """
    check_parquet()
    refuse_existing(dataset)
    fps = max(round(1 / float(rows["time"].diff().median())), 1) if len(rows) > 1 else 10
    cameras = [camera for camera in CAMERAS if (rows[camera] != "").all()]
    table = _table(rows, is_left_out(rows["center"].tolist(), read_left_out(recording)), fps)
    with move_when_done(dataset) as unfinished:
        _write_parquet(table, unfinished / DATA.format(chunk_index=0, file_index=0))
        _write_parquet(_episodes(table, cameras, fps), unfinished / EPISODES)
        tasks = pd.DataFrame({"task_index": [0]}, index=pd.Index([TASK], name="task"))
        _write_parquet(tasks, unfinished / "meta" / "tasks.parquet")
        _write_json(_info(table, cameras, fps), unfinished / INFO)
        _write_json(_statistics(table, rows, cameras), unfinished / "meta" / "stats.json")
        for camera in cameras:
            paths = progress(rows[camera].tolist(), len(rows), f"{camera} camera")
            video = VIDEO.format(video_key=IMAGES + camera, chunk_index=0, file_index=0)
            _write_video(paths, unfinished / video, fps)


def _table(rows: pd.DataFrame, left_out: Any, fps: int) -> pd.DataFrame:
    """Return the rows of the data set."""
    episodes = segment_numbers(rows).to_numpy() - 1
    numbers = rows.groupby(episodes).cumcount().to_numpy()
    throttle = rows["throttle"].fillna(0).to_numpy(float) - rows["brake"].fillna(0).to_numpy(float)
    actions = np.stack([rows["steering"].to_numpy(float), throttle], 1).astype(np.float32)
    speeds = (rows["speed"].fillna(0).to_numpy(float) * MPH).astype(np.float32)
    return pd.DataFrame(
        {
            "observation.state": [[speed] for speed in speeds],
            "action": list(actions),
            "timestamp": (numbers / fps).astype(np.float32),
            "recorded_time": rows["time"].to_numpy(float),
            "left_out": left_out,
            "frame_index": numbers,
            "episode_index": episodes.astype(np.int64),
            "index": np.arange(len(rows)),
            "task_index": 0,
        }
    )


def _episodes(table: pd.DataFrame, cameras: list[str], fps: int) -> pd.DataFrame:
    """Return a row per episode; all lie in the same files, one after another."""
    spans = table.groupby("episode_index")["index"].agg(["min", "max"])
    found = []
    for number, (first, last) in enumerate(spans.to_numpy().tolist()):
        episode: dict[str, Any] = {"episode_index": number, "tasks": [TASK], "length": last - first + 1}
        episode |= {"dataset_from_index": first, "dataset_to_index": last + 1}
        episode |= dict.fromkeys(("data/chunk_index", "data/file_index"), 0)
        episode |= dict.fromkeys(("meta/episodes/chunk_index", "meta/episodes/file_index"), 0)
        for camera in cameras:
            name = f"videos/{IMAGES}{camera}"
            episode |= {f"{name}/chunk_index": 0, f"{name}/file_index": 0}
            episode |= {f"{name}/from_timestamp": first / fps, f"{name}/to_timestamp": (last + 1) / fps}
        found.append(episode)
    return pd.DataFrame(found)


def _info(table: pd.DataFrame, cameras: list[str], fps: int) -> dict[str, Any]:
    features: dict[str, Any] = {
        "observation.state": {"dtype": "float32", "shape": [1], "names": ["speed"]},
        "action": {"dtype": "float32", "shape": [2], "names": ["steering", "throttle"]},
        **{name: {"dtype": kind, "shape": [1], "names": None} for name, kind in SCALARS.items()},
    }
    coded = {"video.fps": fps, "video.codec": "h264", "video.pix_fmt": "yuv420p", "video.is_depth_map": False}
    size = {"video.height": ROWS, "video.width": COLUMNS, "video.channels": 3, "has_audio": False}
    names = ["height", "width", "channels"]
    for camera in cameras:
        features[IMAGES + camera] = {
            "dtype": "video",
            "shape": [ROWS, COLUMNS, 3],
            "names": names,
            "info": coded | size,
        }
    episodes = int(table["episode_index"].max()) + 1
    return {
        "codebase_version": VERSION,
        "robot_type": "udacity_car",
        "total_episodes": episodes,
        "total_frames": len(table),
        "total_tasks": 1,
        "chunks_size": 1000,
        "data_files_size_in_mb": 100,
        "video_files_size_in_mb": 200,
        "fps": fps,
        "splits": {"train": f"0:{episodes}"},
        "data_path": DATA,
        "video_path": VIDEO,
        "features": features,
    }


def _statistics(table: pd.DataFrame, rows: pd.DataFrame, cameras: list[str]) -> dict[str, Any]:
    """Return minimum, maximum, mean and standard deviation of each feature; of images per channel, 0..1."""
    values = {name: np.stack(table[name].tolist()) for name in ("observation.state", "action")}
    values |= {name: table[[name]].to_numpy(float) for name in SCALARS}
    found = {name: _described(each) for name, each in values.items()}
    some = np.linspace(0, len(rows) - 1, min(STATISTICS_FRAMES, len(rows))).astype(int)
    for camera in cameras:
        pixels = np.concatenate([read_frame(path).reshape(-1, 3) for path in rows[camera].iloc[some]]) / 255
        found[IMAGES + camera] = {
            name: [[[each]] for each in value] if name != "count" else [len(some)]
            for name, value in _described(pixels).items()
        }
    return found


def _described(values: Floats) -> dict[str, Any]:
    figures = {"min": values.min(0), "max": values.max(0), "mean": values.mean(0), "std": values.std(0)}
    return {name: np.asarray(each, float).tolist() for name, each in figures.items()} | {"count": [len(values)]}


def _write_parquet(table: pd.DataFrame, path: Path) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    table.to_parquet(path, engine="pyarrow")


def _write_json(content: dict[str, Any], path: Path) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(json.dumps(content, indent=4) + "\n", encoding="utf-8")


def _write_video(paths: Any, video: Path, fps: int) -> None:
    video.parent.mkdir(parents=True, exist_ok=True)
    with av.open(str(video), "w", format="mp4") as container:
        stream = container.add_stream("libx264", rate=Fraction(fps))
        stream.width, stream.height, stream.pix_fmt = COLUMNS, ROWS, "yuv420p"
        stream.options = {**ENCODING}
        for path in paths:
            container.mux(stream.encode(av.VideoFrame.from_ndarray(read_frame(path), format="rgb24")))
        container.mux(stream.encode())


# Reading


def import_dataset(dataset: Path, recording: Path, progress: ProgressBar[Any] = no_bar) -> int:
    """Write a data set as a recording, and return the number of rows.

    The first value of `action`, or that called steering, is the steering. The cameras left, center and right are taken
    over; if there is none called center, the first one is. Images of another shape are cropped to 2:1 and resized.

    Raises:
        NeedsPyArrow: Parquet files cannot be read.
        NoUsableData: the folder is no data set of version 3 with videos, or is damaged.
        FileExistsError: the recording exists.
        OSError: the recording cannot be written.
    """
    check_parquet()
    refuse_existing(recording)
    try:
        info = json.loads((dataset / INFO).read_text(encoding="utf-8"))
        table = pd.concat([pd.read_parquet(path) for path in sorted((dataset / "data").rglob("*.parquet"))])
        episodes = pd.concat([pd.read_parquet(path) for path in sorted((dataset / "meta/episodes").rglob("*.parquet"))])
        table = table.sort_values("index").reset_index(drop=True)
        names = _names(table)
        lines = list(_lines(table, info, names, _cameras(info)))
        frames = _frames_of(table, episodes, info)
    except (OSError, ValueError, LookupError, TypeError) as error:
        raise NoUsableData(f"{dataset}: is no data set of LeRobot, version 3, with videos ({error})") from error
    with move_when_done(recording) as unfinished:
        _write_images(dataset, unfinished / "IMG", frames, names, progress)
        (unfinished / LOG_NAME).write_text("".join(lines), encoding="utf-8", newline="")
        left_out = table["left_out"] if "left_out" in table else pd.Series(False, table.index)
        images = [f"center_{names[row]}" for row in np.flatnonzero(left_out)]
        write_left_out(unfinished, [LeftOut(image, image) for image in images])
    return len(lines)


def _cameras(info: dict[str, Any]) -> dict[str, str]:
    """Return the names of the videos by camera.

    Raises:
        LookupError: there is none.
    """
    videos = [name for name, feature in info["features"].items() if feature["dtype"] == "video"]
    if not videos:
        raise LookupError("it has no video")
    found = {camera: IMAGES + camera for camera in CAMERAS if IMAGES + camera in videos}
    return {"center": videos[0]} | found


def _names(table: pd.DataFrame) -> list[str]:
    """Return the second part of the images' names, with the time: recorded, or 10 s between two episodes."""
    times = table.get("recorded_time")
    if times is None:
        lengths = table.groupby("episode_index")["timestamp"].max() + 10.0
        times = table["timestamp"] + table["episode_index"].map(lengths.cumsum().shift(fill_value=0.0))
    return [f"{time_stamp(datetime(1970, 1, 1) + timedelta(seconds=round(float(each), 3)))}.jpg" for each in times]


def _lines(table: pd.DataFrame, info: dict[str, Any], names: list[str], cameras: dict[str, str]) -> Iterator[str]:
    actions, speeds = np.stack(table["action"].tolist()), _speeds(table, info)
    steering = _column(info["features"]["action"], "steering") or 0
    throttle = _column(info["features"]["action"], "throttle")
    for name, action, speed in zip(names, actions, speeds, strict=True):
        images = [f"IMG/{camera}_{name}" if camera in cameras else "" for camera in CAMERAS]
        pedal = float(action[throttle]) if throttle is not None else 0.0
        yield format_line(images, float(np.clip(action[steering], -1, 1)), float(np.clip(pedal, -1, 1)), float(speed))


def _speeds(table: pd.DataFrame, info: dict[str, Any]) -> Floats:
    """Return the speed in mph per row; NaN if the data set has none."""
    number = _column(info["features"].get("observation.state", {}), "speed")
    if number is None:
        return np.full(len(table), np.nan)
    return np.asarray(np.stack(table["observation.state"].tolist())[:, number] / MPH, float)


def _column(feature: dict[str, Any], name: str) -> int | None:
    names = feature.get("names")
    return names.index(name) if isinstance(names, list) and name in names else None


def _frames_of(table: pd.DataFrame, episodes: pd.DataFrame, info: dict[str, Any]) -> Frames:
    """Return the row of each frame, by its number, by camera and video file."""
    found: Frames = {}
    for camera, key in _cameras(info).items():
        for _, episode in episodes.iterrows():
            place = {name: int(episode[f"videos/{key}/{name}"]) for name in ("chunk_index", "file_index")}
            first = round(float(episode[f"videos/{key}/from_timestamp"]) * float(info["fps"]))
            rows = table.index[table["episode_index"] == episode["episode_index"]]
            file = found.setdefault((camera, info["video_path"].format(video_key=key, **place)), {})
            file |= {first + number: int(row) for number, row in enumerate(rows)}
    return found


def _write_images(videos: Path, images: Path, frames: Frames, names: list[str], progress: ProgressBar[Any]) -> None:
    images.mkdir(parents=True)
    for (camera, file), rows in frames.items():
        with av.open(str(videos / file)) as container:
            decoded = progress(container.decode(video=0), len(rows), f"{camera} camera")
            for number, picture in enumerate(decoded):
                if number in rows:
                    frame = as_frame(picture.to_ndarray(format="rgb24"))
                    (images / f"{camera}_{names[rows[number]]}").write_bytes(encode_frame(frame))
