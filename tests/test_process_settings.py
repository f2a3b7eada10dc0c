"""Who imports the library keeps the settings of his own process."""

import subprocess
import sys

from conftest import REPOSITORY

UNCHANGED = """
import os, pkgutil, importlib
import cv2, torch, matplotlib
cv2.setNumThreads(3)
torch.set_num_threads(2)
def settings():
    draws = torch.random.get_rng_state().sum().item()
    return cv2.getNumThreads(), torch.get_num_threads(), matplotlib.get_backend(), draws
before = settings()
import pilot
for module in pkgutil.walk_packages(pilot.__path__, "pilot."):
    if module.name != "pilot.commands.drive":
        importlib.import_module(module.name)
from pilot.driving.driver import Driver
from pilot.model.checkpoint import Model
from pilot.model.build import build_network
Driver(Model("pilotnet", build_network("pilotnet", 1).eval(), {}, {}, {}))
from pilot.training.devices import CoreThreads
CoreThreads(2)
assert settings() == before, (before, settings())
"""


def test_importing_and_making_things_changes_no_setting_of_the_process() -> None:
    result = subprocess.run([sys.executable, "-c", UNCHANGED], cwd=REPOSITORY, capture_output=True, text=True)
    assert result.returncode == 0, result.stderr


def test_what_is_loaded_before_driving_is_not_searched_for_garbage_again() -> None:
    """A full collection of PyTorch's objects would delay the answer to the driven car by 0.1 s."""
    code = "import gc, torch; from pilot import process_settings as s; s.after_loading(); print(len(gc.get_objects()))"
    result = subprocess.run([sys.executable, "-c", code], cwd=REPOSITORY, capture_output=True, text=True)
    assert int(result.stdout) < 1000
