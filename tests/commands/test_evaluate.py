"""python evaluate.py: what it prints and writes, and what it refuses."""

import contextlib
import json
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import av
import cv2
import pytest
from conftest import REPOSITORY

from pilot.commands import evaluate as evaluate_command
from pilot.evaluation.table import read_json
from pilot.model.build import build_network
from pilot.model.checkpoint import Model, save_model
from pilot.simulator.demonstration import DemonstrationConfig
from pilot.simulator.demonstrations import record

SHORT = ("--tracks", "mountain", "mountain reversed", "--laps", "0.01", "--jobs", "1")


@pytest.fixture(autouse=True)
def in_folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)


def save(name: str, seed: int = 1) -> Path:
    path = Path(name)
    path.parent.mkdir(exist_ok=True)
    save_model(path, Model("pilotnet", build_network("pilotnet", seed), {}, {}, {}))
    return path


def test_a_table_figures_and_pictures(capsys: pytest.CaptureFixture[str]) -> None:
    save("model.pt")
    assert evaluate_command.main(["model.pt", *SHORT]) == 0
    printed = capsys.readouterr().out
    lines = printed.splitlines()
    assert [line.split("  ")[0] for line in lines[1:4]] == ["mountain", "mountain reversed", "all"]
    assert "autonomy" in lines[0]
    assert "model: autonomy" in printed
    (evaluation,) = read_json(Path("evaluation/scores.json"))
    assert [scores.title for scores in evaluation.rows] == ["mountain", "mountain reversed"]
    assert evaluation.total.seconds == pytest.approx(sum(scores.seconds for scores in evaluation.rows))
    for name in ("mountain", "mountain-reversed"):
        drawn = cv2.imread(f"evaluation/model/{name}.png")
        assert drawn.shape[1] > 1000


def test_models_side_by_side_with_lights_start_places_and_video(capsys: pytest.CaptureFixture[str]) -> None:
    save("model.pt")
    arguments = [
        "model.pt",
        "expert",
        "--tracks",
        "mountain",
        "--lights",
        "evening",
        "--seeds",
        "3",
        "5",
        "--laps",
        "0.004",
        "--jobs",
        "1",
        "--video",
        "--out",
        "new/figures",
    ]
    assert evaluate_command.main(arguments) == 0
    head, _, row, *_ = capsys.readouterr().out.splitlines()
    assert "model" in head
    assert "expert" in head
    assert row.startswith("mountain, evening")
    written = json.loads(Path("new/figures/scores.json").read_text())
    assert [each["total"]["drives"] for each in written["evaluations"]] == [2, 2]
    assert written["options"]["conditions"]["laps"] == 0.004
    with av.open("new/figures/expert/mountain-evening-5.mp4") as clip:
        stream = clip.streams.video[0]
        assert float(stream.average_rate) == 25
        assert (stream.width, stream.height) == (640, 320)


def test_a_recording_is_replayed(capsys: pytest.CaptureFixture[str]) -> None:
    save("model.pt")
    record("lake", DemonstrationConfig(laps=0.09, rate=10), Path("mine/laps"))
    arguments = ["--recordings", "mine/laps", "--jobs", "1", "--out"]
    assert evaluate_command.main(["model.pt", *arguments, "whole"]) == 0
    assert capsys.readouterr().out.splitlines()[1].startswith("laps (by the ")
    assert evaluate_command.main(["model.pt", *arguments, "part", "--last-part", "0.6", "--video"]) == 0
    assert cv2.imread("part/model/replay-laps.png").shape[1] > 1000
    seconds = [read_json(Path(folder) / "scores.json")[0].total.seconds for folder in ("whole", "part")]
    assert seconds[1] == pytest.approx(0.6 * seconds[0], rel=0.05)
    with av.open("part/model/replay-laps.mp4") as clip:
        stream = clip.streams.video[0]
        assert stream.frames / float(stream.average_rate) == pytest.approx(seconds[1], rel=0.05)


def test_models_of_the_same_name_are_told_apart() -> None:
    assert evaluate_command.name_paths([Path("a/model.pt"), Path("b/model.pt"), Path("c/other.pt")]) == [
        "a-model",
        "b-model",
        "other",
    ]


def wait_until_gone(group: int) -> None:
    for _ in range(200):
        try:
            os.killpg(group, 0)
        except ProcessLookupError:
            return
        time.sleep(0.05)
    pytest.fail("something of it lived on")


@pytest.mark.parametrize("ended_by", [signal.SIGINT, signal.SIGTERM, signal.SIGKILL])
def test_it_ends_with_all_its_processes(ended_by: signal.Signals) -> None:
    command = [
        sys.executable,
        str(REPOSITORY / "evaluate.py"),
        "expert",
        "--tracks",
        "mountain",
        "lake",
        "--laps",
        "9",
        "--jobs",
        "2",
    ]
    with subprocess.Popen(command, stderr=subprocess.PIPE, start_new_session=True) as process:
        try:
            assert process.stderr is not None
            assert b"driving" in process.stderr.read(10)  # the bar
            time.sleep(1)
            process.send_signal(ended_by)
            assert process.wait(60) == (130 if ended_by == signal.SIGINT else -ended_by)
            wait_until_gone(process.pid)
        finally:
            with contextlib.suppress(ProcessLookupError):
                os.killpg(process.pid, signal.SIGKILL)
    assert not Path("evaluation").exists()


@pytest.mark.parametrize(
    ("arguments", "says"),
    [
        (["absent.pt"], "absent.pt: no such file"),
        (["expert", "--tracks", "moon"], "track 'moon': there are lake, jungle, mountain"),
        (["expert", "--tracks", "random:9-3"], "a range goes from less to more"),
        (["expert", "--laps", "0"], "--laps 0: must be greater than 0"),
        (["expert", "--speed", "60"], "--speed 60: must lie in 0..30"),
        (["expert", "--speed", "0"], "--speed 0: must be at least 1 mph"),
        (["expert", "--latency-ms", "30"], "--latency-ms 30: must be a multiple of 20"),
        (["expert", "--lost-frames", "1"], "--lost-frames 1: must be at least 0 and less than 1"),
        (["expert", "--jobs", "0"], "--jobs 0: must be at least 1"),
        (["expert", "--seeds", "-1"], "--seeds -1: must not be negative"),
        (["model.pt", "--socket", "--latency-ms", "80"], "--socket: --latency-ms and --lost-frames"),
        (["expert", "--socket"], "the expert knows the road of the built-in simulator: not with --socket"),
        (["expert", "--recordings", "laps"], "the expert knows the road of the built-in simulator"),
        (["model.pt", "--recordings", "laps", "--last-part", "0"], "--last-part 0: must be greater than 0"),
        (["expert", "expert"], "a model or a recording is given twice"),
        ([], "no model given"),
    ],
)
def test_errors_in_one_sentence(arguments: list[str], says: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert evaluate_command.main(arguments) == 1
    error = capsys.readouterr().err.strip()
    assert error.startswith(f"evaluate.py: {says}") or says in error
    assert "\n" not in error
    assert not Path("evaluation").exists()


def test_what_cannot_be_replayed_is_refused(capsys: pytest.CaptureFixture[str]) -> None:
    save("model.pt")
    Path("empty").mkdir()
    assert evaluate_command.main(["model.pt", "--recordings", "empty", "--jobs", "1"]) == 1
    assert "empty" in capsys.readouterr().err
    record("mountain", DemonstrationConfig(laps=0.01, rate=10), Path("short"))
    assert evaluate_command.main(["model.pt", "--recordings", "short", "--jobs", "1"]) == 1
    assert "no segment of at least 5 s" in capsys.readouterr().err


def test_the_report_of_before_stays_when_it_goes_wrong() -> None:
    Path("evaluation").mkdir()
    Path("evaluation/scores.json").write_text("precious")
    assert evaluate_command.main(["absent.pt"]) == 1
    assert Path("evaluation/scores.json").read_text() == "precious"
