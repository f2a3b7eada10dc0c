"""Batches of samples, divided into micro-batches, each loaded and augmented by the thread that computes it.

The order of an epoch's samples and all random draws depend only on the seed, the epoch and the sample's number: neither
on the number of threads or processes, nor on where an interrupted epoch is resumed.
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

from pilot.arrays import Floats, Frame
from pilot.data.augment import AugmentConfig, flip, rotate
from pilot.data.augment_batch import (
    DrawnGeometric,
    apply_geometric,
    apply_photometric,
    draw_geometric,
    draw_photometric,
)
from pilot.data.device_augment import DrawnAugmentations
from pilot.data.frame_cache import FrameCache
from pilot.data.frames import UnreadableImage
from pilot.data.view import IDENTITY, View, render
from pilot.vehicle import COLUMNS, ROWS


@dataclass(frozen=True)
class MicroBatch:
    """The samples of a batch that one thread computes.

    Attributes:
        frames: n x 160 x 320 x 3, uint8 RGB; only the rows that the network uses are filled. With `draws`: n x height
            x 320 x 3, the rows that the cache stores, not augmented.
        steering: n, float32: the labels.
        weight: n, float32: weights in the loss.
        index: n, int64: numbers of the samples (rows of the table of samples).
        draws: augmentations still to be applied on the device; None: the frames are augmented.
    """

    frames: Tensor
    steering: Tensor
    weight: Tensor
    index: NDArray[np.int64]
    draws: DrawnAugmentations | None = None


@dataclass(frozen=True)
class Batch:
    """The samples of one optimisation step.

    Attributes:
        size: number of samples over all processes, including those whose images turn out to be unreadable.
        micro_batches: functions that load the micro-batches of this process.
    """

    size: int
    micro_batches: Sequence[Callable[[], MicroBatch]]


class BatchLoader:
    """Loads batches of samples; with several processes, this process's share of each batch.

    Attributes:
        unreadable: paths of the images that could not be read so far.
    """

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
        """Create a loader of `samples`, a table as described in samples.py.

        Args:
            samples: table of samples; each epoch loads every sample once.
            rows: first frame row that the network uses, and the one after the last.
            batch_size: number of samples per batch over all processes.
            augment: random augmentations; None: none, and samples are loaded in the table's order.
            cache: cache that reads the frames; None: images are decoded at every read.
            seed: seed of the order and the augmentations.
            rank, world_size: number of this process, from 0, and number of processes.
            micro_batches: number of micro-batches per batch.
            for_gpu: load batches ahead and leave augmentation to the device. (On a CPU, loading ahead is slower,
                because it competes with the network's threads for the cores.)
        """
        self.images = samples["image"].to_numpy(object)
        self.steering = samples["steering"].to_numpy(float)
        self.weight = samples["weight"].to_numpy(np.float32)
        self.flip = samples["flip"].to_numpy(bool)
        self.rotation = samples["rotation"].to_numpy(float)
        self.rows, self.batch_size, self.augment, self.seed = rows, batch_size, augment, seed
        self.rank, self.world_size, self.micro_batches, self.for_gpu = rank, world_size, micro_batches, for_gpu
        self.cache = cache or FrameCache()
        self.unreadable: set[str] = set()

    def epoch(self, epoch: int, first_batch: int = 0) -> Iterator[Batch]:
        """Yield the batches of an epoch from `first_batch` on; micro-batches omit samples with unreadable images."""
        order, drawn = self._order(epoch), self._draw(epoch)
        starts = range(first_batch * self.batch_size, len(order), self.batch_size)
        batches = (self._batch(order[start : start + self.batch_size], drawn) for start in starts)
        return read_ahead(batches) if self.for_gpu else batches

    def _order(self, epoch: int) -> NDArray[np.int64]:
        n = len(self.images)
        return np.arange(n) if self.augment is None else np.random.default_rng([self.seed, epoch]).permutation(n)

    def _draw(self, epoch: int) -> "_Drawn":
        """Draw the augmentations of all samples for an epoch."""
        n = len(self.images)
        if self.augment is None:
            return _Drawn([], [])
        rng = np.random.default_rng([self.seed, epoch, 1])
        return _Drawn(draw_geometric(n, self.augment, rng), draw_photometric(n, self.augment, rng))

    def _batch(self, index: NDArray[np.int64], drawn: "_Drawn") -> Batch:
        micro_batches = np.array_split(index[self.rank :: self.world_size], self.micro_batches)
        load = self._load_for_gpu if self.for_gpu else self._load
        return Batch(len(index), [functools.partial(load, micro_batch, drawn) for micro_batch in micro_batches])

    def _load(self, index: NDArray[np.int64], drawn: "_Drawn") -> MicroBatch:
        """Load and augment samples on the CPU."""
        top, bottom = self.rows
        views = self._views(index, drawn)
        frames = np.empty((len(index), ROWS, COLUMNS, 3), np.uint8)  # memory pages of unused rows are never touched
        readable: list[int] = []
        for number, kept in self._read(index):
            pixels = render(kept, views.homography[number], self.rows, self.cache.rows[0])
            frames[len(readable), top:bottom] = apply_photometric(pixels, drawn.photometric, index[number])
            readable.append(number)
        return self._micro_batch(torch.from_numpy(frames[: len(readable)]), index, views, readable)

    def _load_for_gpu(self, index: NDArray[np.int64], drawn: "_Drawn") -> MicroBatch:
        """Load samples that are augmented on the device."""
        first, last = self.cache.rows
        read = list(self._read(index))
        readable = [number for number, _ in read]
        views, photometric = self._views(index, drawn), [of_all[index[readable]] for of_all in drawn.photometric]
        frames = torch.from_numpy(np.array([kept for _, kept in read]).reshape(-1, last - first, COLUMNS, 3))
        micro_batch = self._micro_batch(frames, index, views, readable)
        draws = DrawnAugmentations.of(views.homography[readable], photometric, first, self.rows[0])
        pinned = frames.pin_memory() if torch.cuda.is_available() else frames  # copied while the GPU computes
        return replace(micro_batch, frames=pinned, draws=draws)

    def _views(self, index: NDArray[np.int64], drawn: "_Drawn") -> View:
        """Return the views of samples: their fixed augmentations, followed by the drawn ones."""
        rotation = self.rotation[index]
        views = View(self.steering[index], np.broadcast_to(IDENTITY, (len(index), 3, 3)))
        views = rotate(views, rotation).where(rotation != 0, views)
        views = flip(views).where(self.flip[index], views)
        return apply_geometric(views, drawn.geometric, index, self.augment) if self.augment else views

    def _read(self, index: NDArray[np.int64]) -> Iterator[tuple[int, Frame]]:
        """Yield the number within `index` of each readable sample, and the cached rows of its frame."""
        for number, sample in enumerate(index):
            try:
                yield number, self.cache.read(self.images[sample])
            except UnreadableImage:
                self.unreadable.add(self.images[sample])

    def _micro_batch(self, frames: Tensor, index: NDArray[np.int64], views: View, readable: list[int]) -> MicroBatch:
        kept = index[readable]
        steering = torch.from_numpy(np.asarray(views.steering)[readable]).float()
        return MicroBatch(frames, steering, torch.from_numpy(self.weight[kept]), kept)


@dataclass(frozen=True)
class _Drawn:
    """Augmentations drawn for all n samples in an epoch: the geometric ones, and the photometric ones' parameters.

    Homographies are computed for a micro-batch when it is loaded: those of a million samples would take long and much
    memory before the first step.
    """

    geometric: list[DrawnGeometric]
    photometric: list[Floats]


def read_ahead(batches: Iterator[Batch]) -> Iterator[Batch]:
    """Yield the same batches while later ones, one per core, are being loaded by one thread per core."""
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
        finally:  # after Ctrl-C or an error in the step, the remaining batches are not needed
            threads.shutdown(cancel_futures=True)
