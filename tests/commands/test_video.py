import re
import shutil
from pathlib import Path

import av
import numpy as np
import pytest
from conftest import picture, stamp, steering_of, write_picture

from pilot.commands import video as video_command
from pilot.model.build import build_network
from pilot.model.checkpoint import Model, save_model
from pilot.video.clip import frame_rate


@pytest.fixture
def run(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A drive of 30 frames at 10 a second, with its log."""
    monkeypatch.chdir(tmp_path)
    folder = tmp_path / "run1"
    for log_entry in range(30):
        write_picture(folder / f"{stamp(log_entry)}.jpg", picture(steering_of(log_entry)))
    rows = [f"{stamp(log_entry)}.jpg,,,{steering_of(log_entry)},0.2,0,{log_entry}\n" for log_entry in range(30)]
    (folder / "driving_log.csv").write_text("".join(rows))
    return folder


def frames_of(path: Path) -> list[np.ndarray]:
    with av.open(str(path)) as container:
        return [frame.to_ndarray(format="rgb24") for frame in container.decode(video=0)]


def test_makes_a_clip_that_browsers_play(run: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert video_command.main(["run1"]) == 0
    with av.open(str(tmp_path / "run1.mp4")) as container:
        stream = container.streams.video[0]
        assert (stream.codec_context.name, stream.codec_context.pix_fmt) == ("h264", "yuv420p")
        assert float(stream.average_rate) == pytest.approx(10)
    frames = frames_of(tmp_path / "run1.mp4")
    assert len(frames) == 30
    assert frames[0].shape == (160, 320, 3)
    assert np.abs(frames[7].astype(int) - picture(steering_of(7))).mean() < 6  # right order, right colours
    assert "run1.mp4: 30 frames, 3.0 s" in capsys.readouterr().out


def test_frames_a_second_can_be_chosen_and_come_from_the_names(run: Path, tmp_path: Path) -> None:
    assert video_command.main(["run1/", "--fps", "30", "--out", "fast.mp4"]) == 0
    with av.open("fast.mp4") as container:
        assert float(container.streams.video[0].average_rate) == 30
    assert frame_rate([Path("a.jpg"), Path("b.jpg")]) == 15


@pytest.mark.parametrize("option", ["--wheel", "--speed", "--path"])
def test_each_overlay_draws_something(run: Path, option: str) -> None:
    video_command.main(["run1", "--speed", "--wheel", "--path", "--out", "all.mp4"])
    others = {"--wheel", "--speed", "--path"} - {option}
    video_command.main(["run1", *others, "--out", "without.mp4"])
    with_it, without = frames_of(Path("all.mp4"))[9], frames_of(Path("without.mp4"))[9]
    assert with_it.shape == (320, 640, 3)
    assert (np.abs(with_it.astype(int) - without) > 60).sum() > 200


def test_saliency_of_a_model(run: Path) -> None:
    save_model(Path("model.pt"), Model("pilotnet", build_network("pilotnet", 1), {}, {}, {}))
    assert video_command.main(["run1", "--saliency", "model.pt"]) == 0
    assert video_command.main(["run1", "--saliency", "absent.pt"]) == 1


def test_works_without_a_log_and_says_so(run: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (run / "driving_log.csv").unlink()
    assert video_command.main(["run1", "--wheel"]) == 0
    assert "there is no driving_log.csv" in capsys.readouterr().out


def test_damaged_frames_are_counted_and_other_sizes_scaled(run: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (run / f"{stamp(3)}.jpg").write_bytes(b"")
    (run / f"{stamp(4)}.jpg").write_text("no picture")
    write_picture(run / f"{stamp(5)}.jpg", picture(0)[::2, ::2])
    write_picture(run / f"{stamp(0)}.jpg", picture(0)[:159, :319])  # odd sizes are cut to even ones
    write_picture(run / f"{stamp(6)}.jpg", picture(0)[:1, :1])
    write_picture(run / f"{stamp(7)}.jpg", picture(0)[:, :1])
    assert video_command.main(["run1"]) == 0
    assert "26 frames, 2.6 s; 4 pictures could not be read" in capsys.readouterr().out
    assert {frame.shape for frame in frames_of(Path("run1.mp4"))} == {(158, 318, 3)}


def test_a_recording_of_the_simulator_makes_a_clip_too(run: Path) -> None:
    (run / "IMG").mkdir()
    for path in run.glob("*.jpg"):
        shutil.move(path, run / "IMG" / f"center_{path.name}")
    assert video_command.main(["run1"]) == 0
    assert len(frames_of(Path("run1.mp4"))) == 30


@pytest.mark.parametrize("value", ["nan", "inf", "1e30", "-1e300", "much"])
def test_overlays_are_left_out_where_the_log_has_no_plausible_value(run: Path, value: str) -> None:
    log = run / "driving_log.csv"
    lines = log.read_text().splitlines(keepends=True)
    log.write_text("".join([f"{stamp(0)}.jpg,,,{value},0.2,0,{value}\n", *lines[1:]]))
    assert video_command.main(["run1", "--wheel", "--path", "--speed"]) == 0
    bare, drawn = frames_of(Path("run1.mp4"))[:2]
    assert (np.abs(bare.astype(int) - drawn) > 60).sum() > 200


def test_only_overlays_need_the_columns_of_the_log(run: Path, capsys: pytest.CaptureFixture[str]) -> None:
    log = run / "driving_log.csv"
    log.write_text("center,left,right,wheel\n" + log.read_text())
    assert video_command.main(["run1"]) == 0
    assert video_command.main(["run1", "--wheel"]) == 1
    assert re.search("run1.driving_log.csv: the header .* leave out --wheel", capsys.readouterr().err)


@pytest.mark.parametrize("name", [f"run1/{stamp(0)}.jpg", "run1/driving_log.csv", "model.pt"])
def test_a_clip_replaces_no_frame_log_or_model(run: Path, capsys: pytest.CaptureFixture[str], name: str) -> None:
    Path("model.pt").write_text("precious")
    before = Path(name).read_bytes()
    assert video_command.main(["run1", "--out", name]) == 1
    assert f"--out {Path(name)}: a clip is an .mp4 file" in capsys.readouterr().err
    assert Path(name).read_bytes() == before


@pytest.mark.parametrize(
    ("prepare", "arguments", "says"),
    [
        (lambda run: None, ["nowhere"], "nowhere: no such folder"),
        (lambda run: shutil.rmtree(run) or run.mkdir(), ["run1"], "no frames"),
        (lambda run: [path.write_bytes(b"") for path in run.glob("*.jpg")], ["run1"], "none of its 30 images"),
        (lambda run: None, ["run1", "--fps", "0"], "--fps 0: must lie between"),
    ],
)
def test_errors_name_the_cure_and_the_old_clip_stays(
    run: Path, capsys: pytest.CaptureFixture[str], prepare: object, arguments: list[str], says: str
) -> None:
    Path("run1.mp4").write_text("precious")
    prepare(run)
    assert video_command.main(arguments) == 1
    assert says in capsys.readouterr().err
    assert Path("run1.mp4").read_text() == "precious"
    assert not list(Path().glob(".*.part"))
