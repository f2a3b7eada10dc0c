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

from pilot.arrays import Floats, Frame, Matrix
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
from pilot.data.other_times import SPEED_COLUMN, image_columns, steering_columns
from pilot.data.view import IDENTITY, View, render
from pilot.signature import SPEED_UNIT, STEERING_ONLY, Signature
from pilot.vehicle import COLUMNS, MPH, ROWS


@dataclass(frozen=True)
class MicroBatch:
    """The samples of a batch that one thread computes.

    Attributes:
        frames: n x 160 x 320 x 3, uint8 RGB; only the rows that the network uses are filled. With `draws`: n x height
            x 320 x 3, the rows that the cache stores, not augmented. For a network with a history: n x K x ... each.
        labels: n x the network's outputs, float32; NaN where unknown.
        weight: n, float32: weights in the loss.
        index: n, int64: numbers of the samples (rows of the table of samples).
        draws: augmentations still to be applied on the device; None: the frames are augmented.
    """

    frames: Tensor
    labels: Tensor
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
        signature: Signature = STEERING_ONLY,
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
            signature: what the network sees and predicts.
        """
        self.images = samples[image_columns(signature)].to_numpy(object)
        self.steering = samples[steering_columns(signature)].to_numpy(float)
        self.speed = samples[[SPEED_COLUMN] * signature.speed].to_numpy(float) / SPEED_UNIT
        self.metres_per_second = samples["speed"].fillna(0).to_numpy(float) * MPH
        self.weight = samples["weight"].to_numpy(np.float32)
        self.flip = samples["flip"].to_numpy(bool)
        self.rotation = samples["rotation"].to_numpy(float)
        self.rows, self.batch_size, self.augment, self.seed = rows, batch_size, augment, seed
        self.signature = signature
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
        homographies, labels = self._seen(index, drawn)
        # memory pages of unused rows are never touched
        frames = np.empty((len(index), self.signature.frames, ROWS, COLUMNS, 3), np.uint8)
        readable: list[int] = []
        for number, kept in self._read(index):
            for age, frame in enumerate(kept):
                pixels = render(frame, homographies[number, age], self.rows, self.cache.rows[0])
                lit = apply_photometric(pixels, drawn.photometric, index[number])
                frames[len(readable), age, top:bottom] = lit
            readable.append(number)
        stacked = torch.from_numpy(frames[: len(readable)])
        return self._micro_batch(stacked if self.signature.history else stacked[:, 0], labels, index, readable)

    def _load_for_gpu(self, index: NDArray[np.int64], drawn: "_Drawn") -> MicroBatch:
        """Load samples that are augmented on the device."""
        first, last = self.cache.rows
        read = list(self._read(index))
        readable = [number for number, _ in read]
        homographies, labels = self._seen(index, drawn)
        of_frames = np.repeat(index[readable], self.signature.frames)
        photometric = [of_all[of_frames] for of_all in drawn.photometric]
        kept = [frame for _, history in read for frame in history]
        frames = torch.from_numpy(np.array(kept).reshape(-1, last - first, COLUMNS, 3))
        micro_batch = self._micro_batch(frames, labels, index, readable)
        draws = DrawnAugmentations.of(homographies[readable].reshape(-1, 3, 3), photometric, first, self.rows[0])
        pinned = frames.pin_memory() if torch.cuda.is_available() else frames  # copied while the GPU computes
        return replace(micro_batch, frames=pinned, draws=draws)

    def _seen(self, index: NDArray[np.int64], drawn: "_Drawn") -> tuple[Matrix, Floats]:
        """Return the homographies of the frames of samples (n x K x 3 x 3) and their labels (n x outputs)."""
        now = self._views(index, drawn)
        earlier = [self._views(index, drawn, -seconds).homography for seconds in self.signature.history]
        horizons = list(enumerate(self.signature.horizons))[1:]
        later = [self._views(index, drawn, seconds, column).steering for column, seconds in horizons]
        labels = np.column_stack([now.steering, *later, self.speed[index]])
        return np.stack([now.homography, *earlier], axis=1), labels

    def _views(self, index: NDArray[np.int64], drawn: "_Drawn", seconds: float = 0.0, column: int = 0) -> View:
        """Return the views of samples: their fixed augmentations, followed by the drawn ones.

        Args:
            index: of the samples.
            drawn: augmentations.
            seconds: from the newest frame to the view.
            column: number of the steering that is the label.
        """
        rotation = self.rotation[index]
        start = np.broadcast_to(IDENTITY, (len(index), 3, 3))
        views = View(self.steering[index, column], start, seconds * self.metres_per_second[index])
        views = rotate(views, rotation).where(rotation != 0, views)
        views = flip(views).where(self.flip[index], views)
        return apply_geometric(views, drawn.geometric, index, self.augment) if self.augment else views

    def _read(self, index: NDArray[np.int64]) -> Iterator[tuple[int, list[Frame]]]:
        """Yield the number within `index` of each readable sample, and the cached rows of its frames."""
        for number, sample in enumerate(index):
            try:
                yield number, [self.cache.read(image) for image in self.images[sample]]
            except UnreadableImage as error:
                self.unreadable.add(error.path)

    def _micro_batch(self, frames: Tensor, labels: Floats, index: NDArray[np.int64], readable: list[int]) -> MicroBatch:
        kept = index[readable]
        return MicroBatch(frames, torch.from_numpy(labels[readable]).float(), torch.from_numpy(self.weight[kept]), kept)


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
