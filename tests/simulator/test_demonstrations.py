"""The expert's recordings: read by the same code as the real simulator's, and whole or not there."""

import re
import subprocess
import sys
from collections.abc import Iterable
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pandas as pd
import pytest
from conftest import REPOSITORY

from pilot.commands import train as train_command
from pilot.data import folders
from pilot.data.driving_log import read_driving_logs
from pilot.data.folders import with_demonstrations
from pilot.data.frames import decode_frame, encode_frame
from pilot.data.log_format import LOG_NAME
from pilot.data.segments import segment_numbers
from pilot.data.steered_by import STEERED_BY
from pilot.simulator import demonstrations
from pilot.simulator.demonstration import DemonstrationConfig
from pilot.simulator.demonstrations import DemonstrationSet
from pilot.simulator.simulator import Simulator
from pilot.training.config import TrainingConfig

SHORT = DemonstrationConfig(laps=0.02, recoveries=0, rate=15.0)


def quiet(paths: Iterable[str], _count: int, _title: str) -> Iterable[str]:
    return paths


def test_writes_what_the_real_simulator_writes(tmp_path: Path) -> None:
    rows = demonstrations.record("lake", SHORT, tmp_path / "laps")
    lines = (tmp_path / "laps" / LOG_NAME).read_text().splitlines()
    assert len(lines) == rows > 30
    paths = r",".join(
        rf"{re.escape(str(tmp_path))}/laps/IMG/{camera}_[\d_]{{23}}\.jpg" for camera in ("center", "left", "right")
    )
    for line in lines:
        assert re.fullmatch(paths + r"(,-?\d+(\.\d+)?(e-\d+)?){4}", line), line
    frame = cv2.imread(lines[5].split(",")[1])
    assert frame.shape == (160, 320, 3)
    assert len(list((tmp_path / "laps" / "IMG").iterdir())) == 3 * rows


def test_the_centre_camera_alone_is_recorded_if_asked_for(tmp_path: Path) -> None:
    rows = demonstrations.record("lake", replace(SHORT, cameras="center"), tmp_path)
    assert len(list((tmp_path / "IMG").iterdir())) == rows
    log = read_driving_logs([tmp_path], quiet).rows
    assert len(log) == rows
    assert log["center"].str.contains("center_").all()
    assert (log[["left", "right"]] == "").all(axis=None)


def test_is_read_like_any_recording_at_the_rate_asked_for(tmp_path: Path) -> None:
    rows = demonstrations.record("jungle", SHORT, tmp_path)
    log = read_driving_logs([tmp_path], quiet)
    assert len(log.rows) == rows
    assert log.rows["steering"].abs().max() < 1
    assert log.rows["speed"].max() > 8
    assert 1 / log.rows["time"].diff().mean() == pytest.approx(15, rel=0.1)


def test_goes_on_in_a_recording_that_is_there(tmp_path: Path) -> None:
    first = demonstrations.record("lake", SHORT, tmp_path)
    second = demonstrations.record("lake", SHORT, tmp_path)
    assert len((tmp_path / LOG_NAME).read_text().splitlines()) == first + second


def test_each_recovery_is_a_segment_of_its_own(tmp_path: Path) -> None:
    demonstrations.record("lake", DemonstrationConfig(laps=0, recoveries=7, rate=5.0), tmp_path)
    rows = read_driving_logs([tmp_path], quiet).rows
    assert rows["steering"].groupby(segment_numbers(rows)).size().between(2, 13).sum() == 7


def test_recoveries_show_the_way_back_and_only_that(tmp_path: Path) -> None:
    demonstrations.record("lake", DemonstrationConfig(laps=0, recoveries=12, rate=5.0), tmp_path)
    log = pd.read_csv(tmp_path / LOG_NAME, header=None)
    assert len(log) > 12 * 5
    assert log[3].abs().mean() > 0.05  # every row steers back
    assert log[3].min() < -0.05
    assert log[3].max() > 0.05


def test_the_steering_belongs_to_the_picture(tmp_path: Path) -> None:
    """Driving by the recorded commands shows the recorded pictures again."""
    demonstrations.record("mountain", DemonstrationConfig(laps=0.01, rate=50.0), tmp_path)
    log = pd.read_csv(tmp_path / LOG_NAME, header=None)
    with Simulator(ticks=1) as simulator:
        frame = simulator.reset("mountain").frames["center"]
        for center, steering, throttle, brake in log[[0, 3, 4, 5]].itertuples(index=False):
            recorded = cv2.imread(center)[:, :, ::-1]
            seen = decode_frame(np.frombuffer(encode_frame(frame), np.uint8))
            assert seen is not None
            assert np.abs(recorded.astype(int) - seen).mean() < 0.5
            frame = simulator.step(steering, throttle - brake).frames["center"]


@pytest.mark.parametrize(
    ("plan", "message"),
    [
        (DemonstrationConfig(laps=-1), "laps -1: takes 0 to 1000"),
        (DemonstrationConfig(rate=100), "rate 100: takes 0.1 to 50"),
        (DemonstrationConfig(speed=90), "speed 90: takes 1 to 30"),
    ],
)
def test_refuses_what_cannot_be_driven(plan: DemonstrationConfig, message: str, tmp_path: Path) -> None:
    with pytest.raises(ValueError, match=message):
        demonstrations.record("lake", plan, tmp_path / "new")
    assert not (tmp_path / "new").exists()


def test_the_command_records_and_says_what_to_do_next(tmp_path: Path) -> None:
    command = [
        sys.executable,
        str(REPOSITORY / "simulator.py"),
        "record",
        "--track",
        "random:3",
        "--reverse",
        "--laps",
        "0.01",
        "--out",
        "laps",
    ]
    done = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, timeout=60)
    assert done.returncode == 0, done.stderr
    assert re.search(r"\d+ rows in laps. To learn from them: python model.py --data laps", done.stdout)
    assert (tmp_path / "laps" / LOG_NAME).exists()


@pytest.mark.parametrize(
    "arguments",
    [
        ["record", "--track", "moon", "--out", "x"],
        ["record", "--out", "/dev/null/x"],
        ["record", "--laps", "-2", "--out", "x"],
    ],
)
def test_the_command_refuses_in_a_sentence(arguments: list[str], tmp_path: Path) -> None:
    done = subprocess.run(
        [sys.executable, str(REPOSITORY / "simulator.py"), *arguments],
        cwd=tmp_path,
        capture_output=True,
        text=True,
        timeout=60,
    )
    assert done.returncode == 1
    assert re.fullmatch(r"simulator\.py: .*\n", done.stderr.splitlines(keepends=True)[-1])
    assert "Traceback" not in done.stderr


# The demonstration that `python model.py` records where there is nothing


SMALL = DemonstrationSet("built_in", {"lake": SHORT, "random:5 reversed": SHORT})


@pytest.fixture
def in_this_process(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(demonstrations, "run_tasks", lambda do, tasks, *_: enumerate(map(do, tasks)))


@pytest.mark.usefixtures("in_this_process")
def test_an_empty_folder_gets_a_demonstration_once(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    train_command.record_missing(tmp_path / "data", SMALL)
    assert "the built-in simulator records demonstration laps" in capsys.readouterr().out
    logs = sorted((tmp_path / "data").rglob(LOG_NAME))
    assert [log.parent.name for log in logs] == ["lake", "random-5-reversed"]
    assert Path(logs[0].read_text().split(",")[0]).exists()  # the log names the final place
    train_command.record_missing(tmp_path / "data", SMALL)
    assert capsys.readouterr().out == ""
    assert TrainingConfig().folders == (Path("data"),)


@pytest.mark.usefixtures("in_this_process")
def test_an_interrupted_demonstration_goes_on_and_is_never_half(tmp_path: Path) -> None:
    demonstrations._record_whole(tmp_path / "data" / "built_in", ("lake", SHORT))
    before = (tmp_path / "data" / "built_in" / "lake" / LOG_NAME).read_bytes()
    leftover = tmp_path / "data" / "built_in" / ".random-5-reversed.part"
    (leftover / "IMG").mkdir(parents=True)
    (leftover / LOG_NAME).write_text("half a")
    train_command.record_missing(tmp_path / "data", SMALL)
    assert (tmp_path / "data" / "built_in" / "lake" / LOG_NAME).read_bytes() == before
    assert not leftover.exists()
    assert len(read_driving_logs([tmp_path / "data"], quiet).recordings) == 2


def test_demonstrations_are_made_only_where_there_are_none_of_a_person(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)

    def needed(*words: str) -> list[DemonstrationSet]:
        return train_command.needed_demonstrations(train_command.parse_options(words))

    assert train_command.parse_options([]).recipe == "built-in"
    assert needed() == [demonstrations.BUILT_IN]
    both = [demonstrations.BUILT_IN, demonstrations.SEQUENCES]
    assert needed("--network", "pilotnet_history") == needed("--recipe", "sequences") == both
    for name in ("built_in", "built_in_sequences", "corrections"):
        demonstrations.record("lake", SHORT, tmp_path / "data" / name / "lake")
    (tmp_path / "data" / "corrections" / "lake" / STEERED_BY).write_text("")
    (tmp_path / "data" / "empty").mkdir()
    used = with_demonstrations(Path("data"), ["built_in"])
    assert used == (Path("data/built_in"), Path("data/corrections"))
    assert len(with_demonstrations(Path("data"), folders.DEMONSTRATIONS)) == 3
    assert needed() == [demonstrations.BUILT_IN]
    demonstrations.record("lake", SHORT, tmp_path / "data" / "mine")
    assert needed() == []
    assert train_command.parse_options([]).recipe == "default"


def test_built_in_laps_are_not_mirrored_and_named_ones_are(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The expert keeps to the right of two lanes: a mirrored picture would show it on the left."""
    monkeypatch.chdir(tmp_path)
    assert train_command.parse_options([]).augment.flip == 0
    assert train_command.parse_options([]).augment.viewpoint_lookahead is None  # the expert's law of coming back
    assert train_command.parse_options([]).samples.side_rule == "pursuit"
    assert train_command.parse_options(["--data", "laps"]).augment.flip == 0.5
    assert train_command.parse_options(["--augment.flip", "0.3"]).augment.flip == 0.3
    assert train_command.parse_options(["--recipe", "lenet-drop-zeros"]).network == "lenet"
