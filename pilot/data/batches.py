"""Samples → batches, in parts: each is read, decoded and augmented by the thread that works on it.

The order of an epoch and every random draw follow from the seed, the epoch and the sample's number alone: not from how
many threads or processes there are, nor from where an interrupted epoch is taken up again.
"""

import functools
import os
from collections import deque
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace

import numpy as np
import pandas as pd
import torch
from numpy.typing import NDArray
from torch import Tensor

from pilot.arrays import Floats, Frame, Matrix
from pilot.data.augment import AugmentConfig, apply_photometric, draw_photometric, draw_views, flip, rotate
from pilot.data.device_augment import DrawnAugmentations
from pilot.data.frame_cache import FrameCache
from pilot.data.frames import UnreadableImage
from pilot.data.view import View, render
from pilot.vehicle import COLUMNS, ROWS


@dataclass(frozen=True)
class MicroBatch:
    """Samples to work on.

    Attributes:
        frames: n x 160 x 320 x 3, uint8 RGB; only the rows that the network looks at are filled. With `draws`: only
            the rows that the cache keeps, as recorded.
        steering: n, float32: the labels.
        weight: n, float32: weights in the loss.
        index: n, int64: numbers of the samples.
        draws: how the device is to augment the frames.
    """

    frames: Tensor
    steering: Tensor
    weight: Tensor
    index: NDArray[np.int64]
    draws: DrawnAugmentations | None = None


@dataclass(frozen=True)
class Batch:
    """The samples of one step.

    Attributes:
        size: samples over all processes, before those with unreadable pictures fall out.
        parts: this process's; each is made when it is called.
    """

    size: int
    micro_batches: Sequence[Callable[[], MicroBatch]]


class BatchLoader:
    """Batches of a set of samples, for one of `world_size` processes (its share of every batch)."""

    def __init__(
        self,
        samples: pd.DataFrame,
        rows: tuple[int, int],
        batch_size: int,
        *,
        augment: AugmentConfig | None = None,
        cache: FrameCache | None = None,
        seed: int = 0,
        rank: int = 0,
        world_size: int = 1,
        micro_batches: int = 1,
        for_gpu: bool = False,
    ) -> None:
        """Prepare for `samples`; without `augment` frames come as recorded, in the samples' order.

        Args:
            rows: of the frames, that the network looks at.
            cache: reads the frames.
            parts: that each batch is divided into.
            for_gpu: batches are read ahead, and the device augments them. (On a CPU, threads that read ahead would
                fight the network's for the cores, which costs more than it gains.)
        """
        self.images = samples["image"].tolist()
        self.steering = samples["steering"].to_numpy(float)
        self.weight = samples["weight"].to_numpy(np.float32)
        self.flip = samples["flip"].to_numpy(bool)
        self.rotation = samples["rotation"].to_numpy(float)
        self.rows, self.batch_size, self.augment, self.seed = rows, batch_size, augment, seed
        self.rank, self.world_size, self.micro_batches, self.for_gpu = rank, world_size, micro_batches, for_gpu
        self.cache = cache or FrameCache()
        self.unreadable: set[str] = set()

    def epoch(self, epoch: int, first_batch: int = 0) -> Iterator[Batch]:
        """The batches of an epoch from `first_batch` on; samples whose picture is damaged fall out."""
        order, drawn = self._order(epoch), self._draw(epoch)
        starts = range(first_batch * self.batch_size, len(order), self.batch_size)
        batches = (self._batch(order[start : start + self.batch_size], drawn) for start in starts)
        return read_ahead(batches) if self.for_gpu else batches

    def _order(self, epoch: int) -> NDArray[np.int64]:
        numbers = np.arange(len(self.images))
        return numbers if self.augment is None else np.random.default_rng([self.seed, epoch]).permutation(numbers)

    def _draw(self, epoch: int) -> "_EpochViews":
        """How all samples are to be seen in an epoch."""
        n = len(self.images)
        view = View(self.steering)
        view = rotate(view, self.rotation).where(self.rotation != 0, view)
        view = flip(view).where(self.flip, view)
        photometric = np.empty((n, 0))
        if self.augment:
            rng = np.random.default_rng([self.seed, epoch, 1])
            view, photometric = draw_views(view, self.augment, rng), draw_photometric(n, self.augment, rng)
        return _EpochViews(np.asarray(view.steering), view.homography, photometric)

    def _batch(self, index: NDArray[np.int64], drawn: "_EpochViews") -> Batch:
        micro_batches = np.array_split(index[self.rank :: self.world_size], self.micro_batches)
        load = self._load_for_gpu if self.for_gpu else self._load
        return Batch(len(index), [functools.partial(load, micro_batch, drawn) for micro_batch in micro_batches])

    def _load(self, index: NDArray[np.int64], drawn: "_EpochViews") -> MicroBatch:
        """Read samples, and augment them."""
        top, bottom = self.rows
        frames = np.empty((len(index), ROWS, COLUMNS, 3), np.uint8)  # pages of rows not filled are never touched
        readable: list[int] = []
        for sample, kept in self._read(index):
            pixels = render(kept, drawn.homographies[sample], self.rows, self.cache.rows[0])
            frames[len(readable), top:bottom] = apply_photometric(pixels, drawn.photometric[sample])
            readable.append(sample)
        return self._micro_batch(torch.from_numpy(frames[: len(readable)]), readable, drawn)

    def _load_for_gpu(self, index: NDArray[np.int64], drawn: "_EpochViews") -> MicroBatch:
        """Read samples for the device to augment."""
        first, last = self.cache.rows
        read = list(self._read(index))
        frames = torch.from_numpy(np.array([kept for _, kept in read]).reshape(-1, last - first, COLUMNS, 3))
        micro_batch = self._micro_batch(frames, [sample for sample, _ in read], drawn)
        draws = DrawnAugmentations.of(
            drawn.homographies[micro_batch.index], drawn.photometric[micro_batch.index], first, self.rows[0]
        )
        pinned = frames.pin_memory() if torch.cuda.is_available() else frames  # copied while the GPU computes
        return replace(micro_batch, frames=pinned, draws=draws)

    def _read(self, index: NDArray[np.int64]) -> Iterator[tuple[int, Frame]]:
        """The samples that can be read, and what is kept of their frames."""
        for sample in index.tolist():
            try:
                yield sample, self.cache.read(self.images[sample])
            except UnreadableImage:
                self.unreadable.add(self.images[sample])

    def _micro_batch(self, frames: Tensor, readable: list[int], drawn: "_EpochViews") -> MicroBatch:
        index = np.array(readable, np.int64)
        steering, weight = torch.from_numpy(drawn.steering[index]).float(), torch.from_numpy(self.weight[index])
        return MicroBatch(frames, steering, weight, index)


@dataclass(frozen=True)
class _EpochViews:
    """How each sample is seen in an epoch: label, homography (3x3), light (the photometric augmentations' numbers)."""

    steering: Floats
    homographies: Matrix
    photometric: Floats


def read_ahead(batches: Iterator[Batch]) -> Iterator[Batch]:
    """The same batches, some of them already being read, by a thread for each core."""
    cores = os.cpu_count() or 1
    with ThreadPoolExecutor(cores) as threads:
        ahead: deque[Batch] = deque()
        try:
            for batch in batches:
                futures = [threads.submit(micro_batch) for micro_batch in batch.micro_batches]
                ahead.append(Batch(batch.size, [future.result for future in futures]))
                if len(ahead) > cores:
                    yield ahead.popleft()
            yield from ahead
        finally:  # Ctrl-C or an error in the step: don't read what nobody will use
            threads.shutdown(cancel_futures=True)
