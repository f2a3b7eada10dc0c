"""Choosing the epoch by how it drives."""

from pathlib import Path

import pytest

from pilot.commands import train as train_command
from pilot.evaluation import selection
from pilot.evaluation.conditions import Conditions
from pilot.model.checkpoint import load_model
from pilot.simulator.demonstration import DemonstrationConfig
from pilot.simulator.demonstrations import record

OPTIONS = ["--network", "pilotnet", "--epochs", "2", "--samples.block-seconds", "6", "--samples.cameras", "center"]


@pytest.fixture(scope="module")
def laps(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("recordings") / "laps"
    record("mountain", DemonstrationConfig(laps=0.4, rate=5), folder)
    return folder


@pytest.mark.parametrize("select", ["driving", "replay"])
def test_a_training_keeps_what_drives_best_and_says_so(
    select: str, laps: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(selection, "ROADS", ("mountain",))
    monkeypatch.setattr(selection, "SHORT", Conditions(laps=0.01))
    assert train_command.main(["--data", str(laps), "--select", select, *OPTIONS]) == 0
    output = capsys.readouterr().out
    assert "interventions, " in output.split("epoch   2/2")[1]
    assert "drove best" in output
    kept, lowest = load_model(Path("model.pt")), load_model(Path("model_report/lowest_error.pt"))
    assert f"epoch {kept.metrics['epoch']} of 2 drove best" in output
    assert f"epoch {lowest.metrics['epoch']} has the lowest error" in output
    assert lowest.metrics["recorded"]["mse"] <= kept.metrics["recorded"]["mse"]


def test_single_moments_cannot_be_replayed(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert train_command.main(["--data", str(tmp_path), "--select", "replay", "--samples.split", "moments"]) == 1
    assert "--select replay with --samples.split moments" in capsys.readouterr().err
