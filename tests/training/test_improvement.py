"""A model drives, the expert corrects it, and it learns from that."""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from pilot.data.driving_log import read_driving_logs
from pilot.evaluation import corrected_drive
from pilot.evaluation.conditions import Conditions
from pilot.evaluation.corrected_drive import (
    CorrectedDrive,
    CorrectedDriveRequest,
    CorrectedPolicy,
    drive_corrected,
    to_tightest_bend,
)
from pilot.model.build import build_network
from pilot.model.checkpoint import Model, load_model, save_model
from pilot.simulator.catalogue import load_track
from pilot.simulator.episode import Episode
from pilot.simulator.expert import Expert
from pilot.simulator.simulator import Simulator
from pilot.simulator.track import STEP
from pilot.training import improvement
from pilot.training.improvement import ImproveConfig, drives, improve, mixed, request_for


@pytest.fixture
def model(tmp_path: Path) -> Path:
    """A model that has learned nothing: it steers straight on, more or less."""
    save_model(tmp_path / "model.pt", Model("pilotnet", build_network("pilotnet", 1), {}, {}, {}))
    return tmp_path / "model.pt"


@pytest.fixture(autouse=True)
def few_views(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(corrected_drive, "VIEWS", 8)


def test_the_expert_corrects_before_the_car_leaves_the_road(model: Path, tmp_path: Path) -> None:
    request = CorrectedDriveRequest(model, "random:12", tmp_path / "drive", Conditions(laps=0.05))
    drive = drive_corrected(request)
    log = read_driving_logs([tmp_path / "drive"])
    assert drive.takeovers > 0
    assert len(log.rows) == drive.rows > 8 * (drive.takeovers + 1)
    assert log.rows["correction"].all()
    assert np.ptp(log.rows["steering"]) > 0.5  # the views around a place lie left and right of the road's middle


def test_the_labels_are_the_experts_while_the_model_steers(tmp_path: Path) -> None:
    written: list[float] = []

    class Writer:
        def write(
            self, _frames: object, _seconds: float, command: tuple[float, float], *_: object, **_k: object
        ) -> None:
            written.append(command[0])

    with Simulator() as simulator:
        simulator.reset("lake")
        policy = CorrectedPolicy(simulator.episode, lambda _frame: 0.01, Writer())
        expert = Expert(simulator.episode, 30.0)
        wanted = expert.command()[0]
        assert policy(simulator.look()["center"]) == 0.01
    assert written == [pytest.approx(wanted)]
    assert policy.takeovers == []


def test_improves_for_a_time_and_keeps_the_corrections(
    model: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(improvement, "run_tasks", in_this_process)
    monkeypatch.setattr(improvement, "LAPS", 0.05)
    monkeypatch.setattr(improvement, "FEWEST_ROWS", 60)
    config = ImproveConfig(model, tmp_path / "improved.pt", minutes=0.5, tracks=("random:12",))
    improve(replace(config, minutes=0.1), lambda _threads: None)
    assert load_model(tmp_path / "improved.pt").name == "pilotnet"
    assert read_driving_logs([tmp_path / "improved_corrections"]).rows["correction"].all()
    assert "corrections in" in capsys.readouterr().out
    with pytest.raises(ValueError, match="is not empty"):
        improve(config, lambda _threads: None)


def test_a_few_roads_without_a_correction_do_not_end_it(
    model: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    takeovers = iter([0, 0, 1, 0, 0, 0])  # in each of the four drives of a round
    learned = []
    monkeypatch.setattr(improvement, "learn", lambda *_: learned.append(True))
    improve(
        ImproveConfig(model, tmp_path / "improved.pt", minutes=5.0),
        lambda _threads: None,
        lambda *_: [CorrectedDrive("random:1", number, 10, 20.0) for number in [next(takeovers)] * 4],
    )
    assert next(takeovers, "all done") == "all done"
    assert len(learned) == 1
    assert "No correction in 4.0 minutes of driving" in capsys.readouterr().out


def test_without_named_tracks_it_drives_through_the_tightest_bend_of_each_road(model: Path, tmp_path: Path) -> None:
    config = ImproveConfig(model, tmp_path / "improved.pt")
    assert request_for(config, model, "random:12", 5).through_bend
    assert not request_for(replace(config, tracks=("random:12",)), model, "random:12", 5).through_bend
    track = load_track("random:12")
    episode = Episode(track)
    tightest = np.argmax(np.abs(track.curvatures)) * STEP
    laps = to_tightest_bend(episode, config.conditions).laps
    begin = episode.where.progress
    assert begin < tightest < begin + laps * track.length


def in_this_process(do: Callable[[object], object], tasks: list[object], *_: object) -> object:
    yield from ((number, do(task)) for number, task in enumerate(tasks[:1]))


def test_each_seed_has_roads_of_its_own_in_both_directions() -> None:
    config = ImproveConfig(Path("model.pt"))
    names = [{next(each)[0] for _ in range(50)} for each in (drives(config), drives(replace(config, seed=1)))]
    assert not names[0] & names[1]
    assert sum(name.endswith("reversed") for name in names[0]) == 25


def test_earlier_recordings_are_mixed_in_equal_parts() -> None:
    corrections = pd.DataFrame({"recording": [0, 1, 1], "steering": [0.1, 0.2, 0.3]})
    before = pd.DataFrame({"recording": [0] * 10, "steering": [0.5] * 10})
    rows = mixed(corrections, before, np.random.default_rng(0))
    assert rows["steering"].tolist() == [0.1, 0.2, 0.3, 0.5, 0.5, 0.5]
    assert rows["recording"].tolist() == [0, 1, 1, 2, 2, 2]
    assert len(mixed(corrections, pd.DataFrame(), np.random.default_rng(0))) == 3


@pytest.mark.parametrize(("options", "words"), [({"minutes": 0}, "--minutes 0"), ({"tracks": ("moon",)}, "moon")])
def test_wrong_options_are_named(options: dict[str, object], words: str) -> None:
    with pytest.raises(ValueError, match=words):
        ImproveConfig(Path("model.pt"), **options).check()
