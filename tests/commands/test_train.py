"""The real command, as a user types it."""

import os
import re
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path

import pandas as pd
import pytest
import torch
from conftest import REPOSITORY, Recording

from pilot.commands import train as train_command
from pilot.files import InUseError, sole_use
from pilot.model.build import build_network
from pilot.model.checkpoint import Model, load_model, save_model
from pilot.simulator.demonstrations import BUILT_IN
from pilot.training.report import History

SMALL = ["--network", "pilotnet", "--samples.block-seconds", "1", "--batch-size", "32", "--augment.viewpoint", "0"]


def command(*arguments: str) -> list[str]:
    return [sys.executable, str(REPOSITORY / "model.py"), *arguments]


def run(folder: Path, *arguments: str, fails: bool = False) -> str:
    result = subprocess.run(command(*arguments), cwd=folder, capture_output=True, text=True, timeout=120)
    assert (result.returncode != 0) == fails, result.stdout + result.stderr
    assert "Traceback" not in result.stderr
    return result.stdout + result.stderr


@pytest.fixture
def train(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> Callable[..., str]:
    """`run` in tmp_path and in this process, which has imported everything already."""
    monkeypatch.chdir(tmp_path)

    def train(*arguments: str, fails: bool = False) -> str:
        assert (train_command.main(arguments) != 0) == fails
        return "".join(capsys.readouterr())

    return train


def weights(path: Path) -> torch.Tensor:
    return torch.cat([value.flatten() for value in load_model(path).network.state_dict().values()])


def test_trains_and_says_where_the_model_is_and_how_good(recording: Recording, tmp_path: Path) -> None:
    recording(moments=100)
    output = run(tmp_path, "--data", "laps", "--epochs", "3", "--tensorboard", *SMALL)
    trained = load_model(tmp_path / "model.pt")
    assert re.search(r"laps +100", output)
    assert "epoch   3/3: training MSE" in output
    assert "model: model.pt" in output
    assert f"R² {trained.metrics['recorded']['r2']:.3f}" in output
    assert trained.config["epochs"] == 3
    assert trained.data["rows"] == 100
    report = tmp_path / "model_report"
    assert pd.read_csv(report / "history.csv")["epoch"].tolist() == [1, 2, 3]
    pictures = {"steering_histogram.png", "samples.png", "training_curves.png", "predictions.png"}
    assert pictures <= {path.name for path in report.iterdir()}
    assert any(path.name.startswith("events.out.tfevents") for path in report.iterdir())


def test_few_samples_are_learned_from_in_more_epochs(recording: Recording, train: Callable[..., str]) -> None:
    recording(moments=60)
    output = train("--data", "laps", "--epochs", "1", "--min-steps", "8", *SMALL)
    samples = int(output.split(" training samples")[0].split()[-1])
    assert load_model(Path("model.pt")).config["epochs"] == -(-8 // -(-samples // 32)) > 1


def test_fine_tunes_a_model_with_its_own_network(
    recording: Recording, tmp_path: Path, train: Callable[..., str]
) -> None:
    recording(moments=60)
    save_model(tmp_path / "first.pt", Model("lenet5", build_network("lenet5", 1), {}, {}, {}))
    train("--data", "laps", "--start", "first.pt", "--epochs", "1", "--samples.block-seconds", "1")
    tuned = load_model(tmp_path / "model.pt")
    assert tuned.name == "lenet5"
    assert tuned.config["recipe"] == "fine-tune"
    assert tuned.config["start_share"] == 0.7
    assert "--start-share 0.25" in train("--data", "laps", "--recipe", "real", fails=True)
    assert "nothing.pt" in train("--data", "laps", "--start", "nothing.pt", fails=True)


def started(folder: Path, *arguments: str) -> subprocess.Popen[str]:
    """A training that has begun its second epoch."""
    pipe = subprocess.PIPE
    process = subprocess.Popen(command(*arguments), cwd=folder, stdout=pipe, stderr=pipe, text=True)
    deadline = time.monotonic() + 60
    while not (folder / "model_report" / "history.csv").exists():
        assert time.monotonic() < deadline, process.communicate()
        time.sleep(0.02)
    return process


def test_an_interrupted_training_resumes_to_the_same_model(
    recording: Recording, tmp_path: Path, train: Callable[..., str]
) -> None:
    """Ctrl-C, then kill -9, then to the end: the model is that of one uninterrupted training."""
    recording(moments=100)
    options = ["--data", "laps", "--epochs", "6", *SMALL]
    process = started(tmp_path, *options)
    process.send_signal(signal.SIGINT)
    output, errors = process.communicate(timeout=60)
    assert process.returncode == 130
    assert "python model.py --resume" in output
    assert "Traceback" not in errors
    (tmp_path / "model_report" / "history.csv").unlink()
    process = started(tmp_path, "--resume")
    process.kill()
    process.communicate()
    assert not (tmp_path / "model.pt").exists()
    train("--resume")
    train(*options, "--out", "whole.pt")
    assert torch.equal(weights(tmp_path / "model.pt"), weights(tmp_path / "whole.pt"))


def test_a_second_training_of_the_same_model_is_refused_while_the_first_lives(
    recording: Recording, tmp_path: Path, train: Callable[..., str]
) -> None:
    recording(moments=60)
    options = ["--data", "laps", *SMALL]
    process = started(tmp_path, *options, "--epochs", "1000", "--patience", "1000")
    try:
        assert "model: other.pt" in train(*options, "--epochs", "1", "--out", "other.pt")
        for second in ([*options, "--epochs", "1"], [*options, "--epochs", "1", "--out", "model.bin"], ["--resume"]):
            output = train(*second, fails=True)
            assert "another training is writing it" in output
            assert "name another file with --out" in output
        assert process.poll() is None
    finally:
        process.kill()
        process.communicate()
    assert "model: model.pt" in train(*options, "--epochs", "1")  # a killed one stands in nobody's way
    assert [path.name for path in tmp_path.iterdir() if path.name.endswith(".lock")] == []


def test_resuming_refuses_other_options_and_takes_more_epochs(recording: Recording, train: Callable[..., str]) -> None:
    recording(moments=60)
    train("--data", "laps", "--epochs", "1", *SMALL)
    output = train("--resume", "--batch-size", "16", fails=True)
    assert "batch_size 32, not 16" in output
    assert "epoch   2/2" in train("--resume", "--epochs", "2")
    output = train("--resume", "--out", "b.pt", fails=True)
    assert "state.pt: no such file; there is no interrupted training" in output


def test_a_full_disk_leaves_the_last_state_and_the_message_says_how_to_resume(
    recording: Recording, tmp_path: Path, train: Callable[..., str]
) -> None:
    resource = pytest.importorskip("resource")  # not on Windows
    recording(moments=60)
    train("--data", "laps", "--epochs", "1", *SMALL)
    state = (tmp_path / "model_report" / "state.pt").read_bytes()
    limits = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (len(state) // 2, limits[1]))
    try:
        output = train("--resume", "--epochs", "2", fails=True)
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, limits)
    assert re.search(r"state.pt: cannot be written \(File too large\): make room .*model.py --resume --out", output)
    assert (tmp_path / "model_report" / "state.pt").read_bytes() == state
    assert "epoch   2/2" in train("--resume", "--epochs", "2")


def test_two_processes_train_to_the_same_quality(
    recording: Recording, tmp_path: Path, train: Callable[..., str]
) -> None:
    recording(moments=100)
    options = ["--data", "laps", "--epochs", "2", *SMALL]
    train(*options, "--out", "alone.pt")
    launcher = [sys.executable, "-m", "torch.distributed.run", "--standalone", "--nproc-per-node=2"]
    environment = {**os.environ, "OMP_NUM_THREADS": "1"}
    together = subprocess.run(
        [*launcher, *command(*options)[1:]], cwd=tmp_path, env=environment, capture_output=True, text=True
    )
    assert together.returncode == 0, together.stderr
    assert together.stdout.count("model: model.pt") == 1
    difference = (weights(tmp_path / "model.pt") - weights(tmp_path / "alone.pt")).abs().max()
    assert difference < 2e-3  # the same steps but for rounding, which Adam's first steps enlarge
    errors = [load_model(tmp_path / name).metrics["recorded"]["mse"] for name in ("alone.pt", "model.pt")]
    assert errors[0] == pytest.approx(errors[1], rel=0.05)


def test_without_a_recording_where_one_should_be_it_says_what_to_do(tmp_path: Path, train: Callable[..., str]) -> None:
    (tmp_path / "laps").mkdir()
    output = train("--data", "laps", fails=True)
    assert "laps: no driving_log.csv in it or below. Record laps with the simulator" in output


@pytest.mark.parametrize(
    ("arguments", "says"),
    [
        (["--recipe", "resnet"], "there are default, built-in, sequences, nvidia-rotations"),
        (["--epochs", "0"], "--epochs 0: must be greater than 0"),
        (["--cache-gb", "inf"], "--cache-gb inf: must not be negative, and finite"),
        (["--samples.balance", "cap", "--samples.cap", "inf"], "--samples.cap inf: must be greater than 0, and finite"),
        (["--samples.side-correction", "nan"], "--samples.side-correction nan: must be finite"),
        (["--seed", "-1"], "--seed -1: must lie in 0..2^63-1"),
        (["--out", "notes.txt"], "--out notes.txt: is there already, and is no model that can be used"),
        (["--out", "."], "--out .: is a folder; name a file in it, such as model.pt"),
        (["--augment.crop-top", "0.4", "0.6", "--augment.crop-bottom", "0.4", "0.5"], "must leave a part of the frame"),
        (["--augment.shadow-range", "0.7", "0.2"], "--augment.shadow-range 0.7 0.2: must not be negative, the smaller"),
        (["--augment.viewpoint-nearest", "20"], "--augment.viewpoint-nearest 20.0: must be greater than 0, and at"),
        (["--augment.flip", "2"], "--augment.flip 2.0: must lie in 0..1"),
        (["--samples.validation-share", "1"], "--samples.validation-share 1.0: must be greater than 0 and less than 1"),
        (["--network", "resnet"], "--network resnet: there are densenet, lenet, lenet5, nvidia"),
        (["--nonsense"], "nonsense"),
        (["--device", "cuda:7"], "--device cuda:7: not on this machine"),
        (["--data", "nowhere"], "nowhere: no such folder"),
    ],
)
def test_wrong_options_are_named_and_the_old_model_stays(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], arguments: list[str], says: str
) -> None:
    monkeypatch.chdir(tmp_path)
    save_model(Path("model.pt"), Model("lenet", build_network("lenet", 1), {}, {}, {}))
    old = Path("model.pt").read_bytes()
    Path("notes.txt").write_text("precious")
    try:
        code = train_command.main(arguments)
    except SystemExit as stop:  # the option parser's own way
        code = stop.code
    assert code != 0
    assert says in "".join(capsys.readouterr())
    assert Path("model.pt").read_bytes() == old
    assert Path("notes.txt").read_text() == "precious"


@pytest.mark.parametrize("recipe", ["nvidia-rotations", "lenet-drop-zeros", "simplenet-spikes"])
def test_the_reports_recipes_run(recording: Recording, train: Callable[..., str], recipe: str) -> None:
    recording(moments=24)
    output = train("--recipe", recipe, "--data", "laps", "--epochs", "1")
    assert "model: model.pt" in output
    assert load_model(Path("model.pt")).name == recipe.partition("-")[0]


def test_help_explains_every_option() -> None:
    output = run(Path.cwd(), "--help")
    for words in ("learning rate of Adam", "side cameras", "--augment.shadow", "cosine"):
        assert words in output


def test_two_trainings_do_not_record_the_same_demonstrations(tmp_path: Path) -> None:
    with sole_use(tmp_path / ".built_in.lock", ""), pytest.raises(InUseError, match="another training is recording"):
        train_command.record_missing(tmp_path, BUILT_IN)


def test_a_history_that_cannot_be_written_does_not_end_the_training(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    (tmp_path / "history.csv").mkdir()  # cannot be replaced, like a file that a spreadsheet shows on Windows
    History(tmp_path, tensorboard=False).write([{"epoch": 1, "training_mse": 0.1}])
    assert "history.csv: cannot be written" in caplog.text
