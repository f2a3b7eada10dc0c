"""Earlier images and later labels: the right ones, from the same drive, and none where nobody knows them."""

import numpy as np
import pandas as pd
import pytest
import torch
from conftest import Recording, steering_of

from pilot.data.augment import AugmentConfig
from pilot.data.batches import BatchLoader
from pilot.data.driving_log import read_driving_logs
from pilot.data.frames import read_frame
from pilot.data.other_times import earlier, image_columns, later, with_other_times
from pilot.data.samples import SampleConfig, make_samples
from pilot.pursuit import EXPERT, PurePursuit
from pilot.signature import Signature

ROWS = (70, 135)
ALL = Signature(history=(0.2,), horizons=(0.0, 0.1, 0.5), speed=True)


def rows_at(times: list[float], **columns: object) -> pd.DataFrame:
    return pd.DataFrame({"time": times, "recording": 0, **columns})


def test_later_values_are_interpolated_and_end_with_the_drive() -> None:
    rows = rows_at([0.0, 0.1, 0.2, 0.3, 5.0, 5.1], speed=[0.0, 1.0, 2.0, 3.0, 7.0, 8.0])
    np.testing.assert_allclose(later(rows, rows["speed"], 0.15), [1.5, 2.5, *[np.nan] * 4])
    np.testing.assert_allclose(later(rows, rows["speed"], 0.1), [1, 2, 3, np.nan, 8, np.nan])


def test_the_earlier_row_is_the_nearest_one_of_the_same_drive() -> None:
    rows = rows_at([0.0, 0.1, 0.19, 0.31, 0.4, 5.0, 5.2, 6.0])
    assert earlier(rows, 0.2).tolist() == [0, 0, 0, 1, 2, 5, 5, 7]  # the row itself where there is none


def test_samples_hold_the_labels_and_images_of_other_times(recording: Recording) -> None:
    rows = read_driving_logs([recording(moments=80)]).rows
    training, _ = make_samples(rows, SampleConfig(block_seconds=1, cameras="center"), 0, ALL)
    for sample in training.to_dict("records"):
        moment = sample["moment"]
        known = moment + 5 < len(rows)
        expected = steering_of(moment + 5) if known else np.nan
        assert sample["steering +0.5 s"] == pytest.approx(expected, nan_ok=True)
        assert sample["image -0.2 s"] == (rows["center"][moment - 2] if moment > 1 else sample["image -0.2 s"])
        assert sample["speed ahead"] == pytest.approx(25.5 if moment + 10 < len(rows) else np.nan, nan_ok=True)


def test_the_speed_of_a_corrected_drive_is_not_learned() -> None:
    times = [0.1 * number for number in range(21)]
    rows = rows_at(times, center="c", left="", right="", steering=0.0, speed=20.0, correction=[False] * 15 + [True] * 6)
    found = with_other_times(rows, Signature(speed=True))["speed ahead"]
    assert (found.notna().to_numpy() == [True] * 5 + [False] * 16).all()


def test_rows_without_a_next_one_teach_no_plan(recording: Recording) -> None:
    rows = read_driving_logs([recording(moments=80)]).rows
    sparse = rows.assign(time=rows["time"].iloc[0] + 2.5 * rows.index)
    make_samples(sparse, SampleConfig(block_seconds=5), 0)
    with pytest.raises(ValueError, match="no row is followed by others.*'steering \\+0.1 s'.*Without --data"):
        make_samples(sparse, SampleConfig(block_seconds=5), 0, ALL)


def test_a_displaced_car_returns_as_its_labels_say() -> None:
    """The closed form of the return, against small steps of the law itself."""
    for law in (EXPERT, PurePursuit(15.0, 0.0)):
        offset, heading = 1.2, -0.1
        for _ in range(6000):
            curvature = float(law.curvature(0.0, offset, heading))
            offset, heading = offset + heading * 1e-3, heading + curvature * 1e-3
        np.testing.assert_allclose(law.after(6.0, 1.2, -0.1), (offset, heading), atol=1e-3)
    assert EXPERT.after(0.0, 1.2, -0.1) == (1.2, -0.1)
    np.testing.assert_allclose(EXPERT.after(-3.0, 1.2, -0.1), (1.5, -0.1))  # came straight


def test_batches_hold_histories_and_the_labels_of_displaced_views(recording: Recording) -> None:
    rows = read_driving_logs([recording(moments=80)]).rows
    samples, _ = make_samples(rows, SampleConfig(block_seconds=1), 0, ALL)
    plain = BatchLoader(samples, ROWS, 16, signature=ALL)
    batch = next(plain.epoch(0)).micro_batches[0]()
    assert batch.frames.shape == (16, 2, 160, 320, 3)
    for number, sample in enumerate(samples.head(16).to_dict("records")):
        for age, column in enumerate(image_columns(ALL)):
            expected = read_frame(sample[column])[slice(*ROWS)]
            np.testing.assert_array_equal(batch.frames[number, age, slice(*ROWS)], expected)
    np.testing.assert_allclose(batch.labels[:, 3], 25.5 / 30, rtol=1e-6)
    views = AugmentConfig(flip=0, brightness=0, shadow=0, viewpoint=1, viewpoint_lookahead=None)
    displaced = next(BatchLoader(samples, ROWS, 16, augment=views, signature=ALL).epoch(0)).micro_batches[0]()
    change = displaced.labels[:, :3] - torch.from_numpy(
        samples[["steering", "steering +0.1 s", "steering +0.5 s"]].to_numpy(np.float32)[displaced.index]
    )
    now, _, later_on = change.abs().nanmean(0).tolist()
    assert 0 < later_on < 0.3 * now  # by then, it is on its way back
    assert displaced.labels[:, 3].nanmean() == pytest.approx(25.5 / 30)
    on_device = next(BatchLoader(samples, ROWS, 16, augment=views, signature=ALL, for_gpu=True).epoch(0))
    assert on_device.micro_batches[0]().frames.shape == (32, 160, 320, 3)  # one after another
