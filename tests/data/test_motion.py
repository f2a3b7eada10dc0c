"""Labels from where the car went."""

import numpy as np
import pandas as pd
import pytest

from pilot.data.motion import path_steering
from pilot.data.samples import SampleConfig, make_samples

METRES = 6.0


def log(steering: list[float], *, seconds: float = 0.1, mph: float = 20.0) -> pd.DataFrame:
    """Rows of one recording at a constant rate and speed."""
    count = len(steering)
    return pd.DataFrame(
        {
            "center": [f"{number}.jpg" for number in range(count)],
            "left": "",
            "right": "",
            "recording": 0,
            "time": np.arange(count) * seconds,
            "steering": steering,
            "speed": mph,
        }
    )


def test_steady_steering_is_its_own_label() -> None:
    assert path_steering(log([0.3] * 50), METRES).to_numpy() == pytest.approx(np.full(50, 0.3), abs=3e-3)


def test_pulses_of_a_keyboard_become_the_bend_that_they_drive() -> None:
    pulses = path_steering(log([0.4, 0.0, 0.0, 0.0] * 20), METRES)[:60]
    assert pulses.mean() == pytest.approx(0.1, abs=0.01)
    assert pulses.std() < 0.4 * np.std([0.4, 0.0, 0.0, 0.0])


def test_the_label_turns_before_the_driver_does() -> None:
    labels = path_steering(log([0.0] * 20 + [0.5] * 20), METRES)
    assert labels[10] == pytest.approx(0)
    assert 0.05 < labels[17] < labels[19] < 0.5


@pytest.mark.parametrize("change", ["pause", "reset"])
def test_a_path_ends_where_the_car_was_moved(change: str) -> None:
    rows = log([0.0] * 20 + [1.0] * 20)
    if change == "pause":
        rows.loc[20:, "time"] += 5
    else:
        rows.loc[20:, "speed"] = 0.0
    assert path_steering(rows, METRES)[:20].abs().max() < 1e-9


def test_rows_of_an_unknown_path_keep_the_recorded_steering() -> None:
    pulses = [0.4, 0.0] * 10
    without_speed = log(pulses).assign(speed=np.nan)
    assert path_steering(without_speed, METRES).tolist() == pulses
    apart = log(pulses, seconds=2.5)  # the demonstrations' recoveries
    assert path_steering(apart, METRES).tolist() == pulses


def test_training_learns_them_and_validation_compares_with_the_recorded_steering() -> None:
    rows = log([0.4, 0.0, 0.0, 0.0] * 50).assign(correction=False)
    training, validation = make_samples(rows, SampleConfig(cameras="center", path_metres=METRES), seed=0)
    assert set(validation["steering"]) == {0.0, 0.4}
    assert training["steering"].std() < 0.5 * training["recorded"].std()
