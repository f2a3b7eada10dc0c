from pathlib import Path

import numpy as np
import pandas as pd
import torch
from conftest import Recording

from pilot.data.augment import AugmentConfig
from pilot.data.augment_batch import rows_needed
from pilot.data.batches import Batch, BatchLoader, MicroBatch
from pilot.data.device_augment import augment
from pilot.data.driving_log import read_driving_logs
from pilot.data.frame_cache import FrameCache
from pilot.data.frames import read_frame
from pilot.data.samples import SampleConfig, make_samples

ROWS = (70, 135)


def training_samples(recording: Recording, **options: object) -> pd.DataFrame:
    rows = read_driving_logs([recording(moments=80)]).rows
    return make_samples(rows, SampleConfig(block_seconds=1, **options), seed=0)[0]


def whole(batch: Batch) -> MicroBatch:
    """A batch of one micro-batch."""
    (micro_batch,) = batch.micro_batches
    return micro_batch()


def seen(micro_batch: MicroBatch) -> torch.Tensor:
    return micro_batch.frames[:, slice(*ROWS)]


def test_frames_come_as_recorded_in_rgb_without_augmentation(recording: Recording) -> None:
    samples = training_samples(recording)
    batch = whole(next(BatchLoader(samples, ROWS, 8).epoch(0)))
    assert batch.frames.shape == (8, 160, 320, 3)
    assert batch.frames.dtype == torch.uint8
    for position in range(8):
        expected = read_frame(samples["image"][position])[slice(*ROWS)]
        np.testing.assert_array_equal(seen(batch)[position], expected)
    assert seen(batch)[..., 0].max() > 200 > 120 > seen(batch)[seen(batch)[..., 0] > 200][:, 2].min()  # red, not blue
    np.testing.assert_allclose(batch.labels[:, 0], samples["steering"][:8], rtol=1e-6)


def test_an_epoch_holds_every_sample_once_in_an_order_of_its_own(recording: Recording) -> None:
    samples = training_samples(recording)
    loader = BatchLoader(samples, ROWS, 32, augment=AugmentConfig(), seed=1)
    first, second = ([int(i) for batch in loader.epoch(epoch) for i in whole(batch).index] for epoch in (0, 1))
    assert sorted(first) == sorted(second) == list(range(len(samples)))
    assert first != second


def test_augmentation_depends_on_seed_epoch_and_sample_alone(recording: Recording) -> None:
    samples = training_samples(recording)
    loader = BatchLoader(samples, ROWS, 32, augment=AugmentConfig(), seed=1)
    batches = [whole(batch) for batch in loader.epoch(3)]
    resumed = whole(next(loader.epoch(3, first_batch=2)))
    assert torch.equal(seen(batches[2]), seen(resumed))
    assert torch.equal(batches[2].labels, resumed.labels)
    in_parts = next(BatchLoader(samples, ROWS, 32, augment=AugmentConfig(), seed=1, micro_batches=3).epoch(3))
    assert torch.equal(torch.cat([seen(micro_batch()) for micro_batch in in_parts.micro_batches]), seen(batches[0]))


def test_processes_share_every_batch(recording: Recording) -> None:
    samples = training_samples(recording)
    alone = next(BatchLoader(samples, ROWS, 32, augment=AugmentConfig()).epoch(0))
    loaders = [BatchLoader(samples, ROWS, 32, augment=AugmentConfig(), rank=rank, world_size=2) for rank in (0, 1)]
    shares = [next(loader.epoch(0)) for loader in loaders]
    assert [share.size for share in shares] == [32, 32]
    assert sorted([*whole(shares[0]).index, *whole(shares[1]).index]) == sorted(whole(alone).index)


def test_copies_are_rendered_with_their_label(recording: Recording) -> None:
    samples = training_samples(recording, cameras="center", flipped_copies=True, rotated_copies=1)
    loader = BatchLoader(samples, ROWS, len(samples))
    batch = whole(next(loader.epoch(0)))
    mirrored = np.flatnonzero(samples["flip"] & (samples["rotation"] == 0))[0]
    original = mirrored - len(samples) // 4
    assert batch.labels[:, 0][mirrored] == -batch.labels[:, 0][original]
    np.testing.assert_array_equal(seen(batch)[mirrored], seen(batch)[original].flip(1))
    turned = np.flatnonzero(~samples["flip"] & (samples["rotation"] != 0))[0]
    expected = samples["steering"][turned] + np.radians(samples["rotation"][turned])
    np.testing.assert_allclose(batch.labels[:, 0][turned], expected, rtol=1e-5)


def test_a_picture_that_breaks_meanwhile_falls_out(recording: Recording) -> None:
    samples = training_samples(recording)
    broken = samples["image"][4]
    loader = BatchLoader(samples, ROWS, 8)
    Path(broken).write_bytes(b"\xff\xd8 broken")
    batch = next(loader.epoch(0))
    micro_batch = whole(batch)
    assert len(micro_batch.frames) == len(micro_batch.labels[:, 0]) == len(micro_batch.weight) == 7
    assert batch.size == 8
    assert loader.unreadable == {broken}


def test_the_device_augments_as_the_cpu_does(recording: Recording) -> None:
    samples = training_samples(recording)
    config = AugmentConfig(rotation=0.5, crop=0.5, saturation=0.5)
    rows = rows_needed(ROWS, config, 0)
    assert rows[0] > 0
    cache = FrameCache(rows)
    on_cpu = BatchLoader(samples, ROWS, 64, augment=config, cache=cache)
    on_device = BatchLoader(samples, ROWS, 64, augment=config, cache=cache, for_gpu=True)
    for expected, batch in zip(on_cpu.epoch(0), on_device.epoch(0), strict=True):
        wanted, micro_batch = whole(expected), whole(batch)
        assert torch.equal(micro_batch.labels[:, 0], wanted.labels[:, 0])
        shown = augment(micro_batch.frames, micro_batch.draws.to(torch.device("cpu")), ROWS)
        difference = (shown[:, slice(*ROWS)].int() - seen(wanted).int()).abs().float()
        # grey levels: OpenCV rounds its coefficients, and shades the pixels on a shadow's very edge
        assert difference.mean() < 0.3
        assert difference.mean(dim=(1, 2, 3)).max() < 1.5
        assert not shown[:, : ROWS[0]].any()


def test_the_rows_kept_of_a_frame_are_enough(recording: Recording) -> None:
    samples = training_samples(recording)
    config = AugmentConfig(rotation=0.5, crop=0.5, viewpoint=0.9)
    whole_frames = BatchLoader(samples, ROWS, len(samples), augment=config)
    some_rows = BatchLoader(samples, ROWS, len(samples), augment=config, cache=FrameCache(rows_needed(ROWS, config, 0)))
    difference = (seen(whole(next(whole_frames.epoch(0)))).int() - seen(whole(next(some_rows.epoch(0)))).int()).abs()
    assert difference.max() <= 12  # at edges: OpenCV rounds places to 1/32 of a pixel
    assert difference.float().mean() < 0.05
    too_few = BatchLoader(samples, ROWS, len(samples), augment=config, cache=FrameCache((68, 137)))
    difference = (seen(whole(next(whole_frames.epoch(0)))).int() - seen(whole(next(too_few.epoch(0)))).int()).abs()
    assert difference.max() > 12
