from pathlib import Path

import numpy as np
import pytest
import torch
from conftest import picture

from pilot.driving.driver import Driver
from pilot.model.build import build_network
from pilot.model.checkpoint import Model, UnusableModel, save_model
from pilot.model.networks import network_names


@pytest.mark.parametrize("name", network_names())
def test_the_driver_steers_as_the_network_says(tmp_path: Path, name: str) -> None:
    network = build_network(name, 3).eval()
    save_model(tmp_path / "model.pt", Model(name, network, {}, {}, {}))
    driver = Driver.load(tmp_path / "model.pt")
    for steering in (-0.5, 0.0, 0.5):
        frame = picture(steering)
        with torch.inference_mode():
            expected = float(network(torch.from_numpy(network.signature.standing(frame)[None])))
        assert driver.steer(frame) == pytest.approx(min(max(expected, -1), 1), abs=1e-5)


def test_steering_is_bounded() -> None:
    network = build_network("pilotnet", 1).eval()
    network.layers[-1].bias.data.fill_(7.0)
    assert Driver(Model("pilotnet", network, {}, {}, {})).steer(picture(0)) == 1.0


def test_takes_frames_that_are_views() -> None:
    driver = Driver(Model("pilotnet", build_network("pilotnet", 1).eval(), {}, {}, {}))
    frame = picture(0.3)
    assert driver.steer(frame[:, ::-1][:, ::-1]) == driver.steer(frame)
    assert driver.steer(np.asfortranarray(frame)) == driver.steer(frame)


def test_refuses_what_is_no_model(tmp_path: Path) -> None:
    (tmp_path / "model.pt").write_text("no model")
    with pytest.raises(UnusableModel, match="python model.py"):
        Driver.load(tmp_path / "model.pt")
