"""The table "To add X, touch Y" of CONTRIBUTING.md, carried out on a copy of the program: one of each, then used."""

import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest
from conftest import REPOSITORY, Recording

from pilot.data.augment import PHOTOMETRIC
from pilot.data.device_augment import ON_DEVICE

NETWORK = """
from torch import nn

from pilot.model.steering_network import SteeringNetwork


class OneLayer(SteeringNetwork):
    def __init__(self) -> None:
        super().__init__()
        self.layers = nn.Sequential(nn.AvgPool2d(13), nn.Flatten(), nn.Linear(3 * 5 * 24, 1))


NETWORK = OneLayer
"""
TRACK = """
import numpy as np

from pilot.simulator.course import Course, Look
from pilot.simulator.track import closed_road

NUMBER = 9


def course() -> Course:
    corners = np.array([(0, 0, 0), (90, 0, 0), (90, 0, 90), (0, 0, 90)], float)[:, [0, 2, 1]]
    return Course(closed_road("square", corners, 4.0), Look())
"""
NEGATIVE_FIELD = '''
    negative: float = 0.0
    """Probability of a photographic negative."""
'''
NEGATIVE = """
PHOTOMETRIC.append(
    Photometric(
        "negative",
        1,
        lambda n, config, rng: (rng.random(n) < config.negative).astype(float)[:, None],
        lambda pixels, numbers: 255 - pixels if numbers[0] else pixels,
        lambda config: {"negative": np.ones(1)},
    )
)
"""
USE = """
import sys
from pathlib import Path

import numpy as np
import torch

from pilot.commands import train
from pilot.data.augment_batch import apply_photometric, draw_photometric
from pilot.data.device_augment import DrawnAugmentations, augment
from pilot.model.checkpoint import load_model
from pilot.simulator.catalogue import track_names
from pilot.simulator.simulator import Simulator
from pilot.training.recipes import RECIPES

options = ["--recipe", "tiny", "--samples.block-seconds", "1", "--cache-gb", "0"]
assert train.main(["--data", sys.argv[1], *options]) == 0
model = load_model(Path("model.pt"))
assert (model.name, type(model.network).__name__) == ("one_layer", "OneLayer")
assert model.config["augment"]["negative"] == 1.0
frames = np.full((1, 160, 320, 3), 100, np.uint8)
lights = draw_photometric(1, RECIPES["tiny"].augment, np.random.default_rng(0))
assert (apply_photometric(frames[0], lights, 0) == 155).all()
seen = augment(torch.from_numpy(frames), DrawnAugmentations.of(np.eye(3)[None], lights, 0, 0), (0, 160))
assert (seen[:, 1:-1, 1:-1] == 155).all()
assert track_names()[-1] == "square"
simulator = Simulator()
simulator.reset("square")
assert simulator.look()["center"].shape == (160, 320, 3)
"""


@pytest.fixture
def copy(tmp_path: Path) -> Path:
    """The program, in a folder of its own."""
    folder = tmp_path / "copy"
    shutil.copytree(REPOSITORY / "pilot", folder / "pilot", ignore=shutil.ignore_patterns("__pycache__"))
    return folder


def add_one_of_each(pilot: Path) -> None:
    (pilot / "model/networks/one_layer.py").write_text(NETWORK)
    (pilot / "simulator/tracks/square.py").write_text(TRACK)
    with (pilot / "training/recipes.py").open("a") as recipes:
        recipes.write('\nNEGATIVES = replace(NO_AUGMENTATION, negative=1.0)\nRECIPES["tiny"] = ')
        recipes.write('TrainingConfig(recipe="tiny", network="one_layer", epochs=1, augment=NEGATIVES)\n')
    augment = pilot / "data/augment.py"
    augment.write_text(augment.read_text().replace("\n    def check", f"{NEGATIVE_FIELD}\n    def check", 1) + NEGATIVE)
    with (pilot / "data/device_augment.py").open("a") as device:
        device.write('\nON_DEVICE["negative"] = lambda pixels, on: torch.where(on > 0, 255 - pixels, pixels)\n')


def test_one_of_each_is_added_where_contributing_says(copy: Path, recording: Recording) -> None:
    add_one_of_each(copy / "pilot")
    result = subprocess.run(
        [sys.executable, "-c", USE, str(recording(moments=30))],
        cwd=copy,
        env={**os.environ, "PYTHONPATH": str(copy)},
        capture_output=True,
        text=True,
        check=False,
    )
    assert result.returncode == 0, result.stderr


def test_what_changes_pixels_has_its_counterpart_on_the_device() -> None:
    assert set(ON_DEVICE) == {augmentation.name for augmentation in PHOTOMETRIC}
