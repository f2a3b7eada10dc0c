"""The models that come with the program."""

from pathlib import Path

import pytest
from conftest import REPOSITORY

from pilot.evaluation.closed_loop import DriveRequest, ModelPolicy, run
from pilot.evaluation.conditions import Conditions
from pilot.model.checkpoint import load_model

MODELS = sorted((REPOSITORY / "models").glob("*.pt"))


def test_there_are_some_and_the_readme_names_them() -> None:
    assert MODELS
    readme = (REPOSITORY / "README.md").read_text()
    assert all(f"models/{path.name}" in readme for path in MODELS)


@pytest.mark.parametrize("path", MODELS, ids=lambda path: path.stem)
def test_they_are_small_and_tell_what_they_were_trained_on(path: Path) -> None:
    assert path.stat().st_size < 5e6
    model = load_model(path)
    assert model.metrics["recorded"]["correlation"] > 0.5
    assert model.data["recordings"]
    assert not any(Path(folder).is_absolute() for folder in model.data["recordings"])


def test_the_one_for_the_built_in_simulator_keeps_to_the_road() -> None:
    driven = run(DriveRequest(ModelPolicy(REPOSITORY / "models" / "built_in.pt"), "lake", Conditions(laps=0.1)))
    assert not driven.interventions
    assert abs(driven.cross_track_errors).max() < 1
