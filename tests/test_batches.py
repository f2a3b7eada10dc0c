from pathlib import Path

import numpy as np
import pandas as pd
import torch
from conftest import Recording

from pilot.augment import AugmentConfig
from pilot.batches import Batch, BatchLoader
from pilot.driving_log import read_driving_logs
from pilot.frames import read_frame
from pilot.samples import SampleConfig, make_samples

ROWS = (70, 135)


def training_samples(recording: Recording, **options: object) -> pd.DataFrame:
    rows = read_driving_logs([recording(moments=80)]).rows
    return make_samples(rows, SampleConfig(block_seconds=1, **options), seed=0)[0]


def seen(batch: Batch) -> torch.Tensor:
    return batch.frames[:, slice(*ROWS)]


def test_frames_come_as_recorded_in_rgb_without_augmentation(recording: Recording) -> None:
    samples = training_samples(recording)
    batch = next(BatchLoader(samples, ROWS, 8).epoch(0))
    assert batch.frames.shape == (8, 160, 320, 3)
    assert batch.frames.dtype == torch.uint8
    for position in range(8):
        expected = read_frame(samples["image"][position])[slice(*ROWS)]
        np.testing.assert_array_equal(seen(batch)[position], expected)
    assert seen(batch)[..., 0].max() > 200 > 120 > seen(batch)[seen(batch)[..., 0] > 200][:, 2].min()  # red, not blue
    np.testing.assert_allclose(batch.steering, samples["steering"][:8], rtol=1e-6)


def test_an_epoch_holds_every_sample_once_in_an_order_of_its_own(recording: Recording) -> None:
    samples = training_samples(recording)
    loader = BatchLoader(samples, ROWS, 32, augment=AugmentConfig(), seed=1)
    first, second = ([int(i) for batch in loader.epoch(epoch) for i in batch.index] for epoch in (0, 1))
    assert sorted(first) == sorted(second) == list(range(len(samples)))
    assert first != second


def test_augmentation_depends_on_seed_epoch_and_sample_alone(recording: Recording) -> None:
    samples = training_samples(recording)
    loader = BatchLoader(samples, ROWS, 32, augment=AugmentConfig(), seed=1)
    whole = list(loader.epoch(3))
    resumed = next(loader.epoch(3, first_batch=2))
    assert torch.equal(seen(whole[2]), seen(resumed))
    assert torch.equal(whole[2].steering, resumed.steering)
    loader._threads = 1
    assert torch.equal(seen(next(loader.epoch(3))), seen(whole[0]))


def test_processes_share_every_batch(recording: Recording) -> None:
    samples = training_samples(recording)
    whole = next(BatchLoader(samples, ROWS, 32, augment=AugmentConfig()).epoch(0))
    loaders = [BatchLoader(samples, ROWS, 32, augment=AugmentConfig(), rank=rank, world=2) for rank in (0, 1)]
    parts = [next(loader.epoch(0)) for loader in loaders]
    assert [part.size for part in parts] == [32, 32]
    assert sorted([*parts[0].index, *parts[1].index]) == sorted(whole.index)


def test_copies_are_rendered_with_their_label(recording: Recording) -> None:
    samples = training_samples(recording, cameras="center", flipped_copies=True, rotated_copies=1)
    loader = BatchLoader(samples, ROWS, len(samples))
    batch = next(loader.epoch(0))
    mirrored = np.flatnonzero(samples["flip"] & (samples["rotation"] == 0))[0]
    original = mirrored - len(samples) // 4
    assert batch.steering[mirrored] == -batch.steering[original]
    np.testing.assert_array_equal(seen(batch)[mirrored], seen(batch)[original].flip(1))
    turned = np.flatnonzero(~samples["flip"] & (samples["rotation"] != 0))[0]
    expected = samples["steering"][turned] + np.radians(samples["rotation"][turned])
    np.testing.assert_allclose(batch.steering[turned], expected, rtol=1e-5)


def test_a_picture_that_breaks_meanwhile_falls_out(recording: Recording) -> None:
    samples = training_samples(recording)
    broken = samples["image"][4]
    loader = BatchLoader(samples, ROWS, 8)
    Path(broken).write_bytes(b"\xff\xd8 broken")
    batch = next(loader.epoch(0))
    assert len(batch.frames) == len(batch.steering) == len(batch.weight) == 7
    assert batch.size == 8
    assert loader.unreadable == {broken}
