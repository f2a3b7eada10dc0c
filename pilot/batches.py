"""Samples → batches, in parts: each is read, decoded and augmented by the thread that works on it.

The order of an epoch and every random draw follow from (seed, epoch, sample) alone: not from the number of threads
or processes, nor from where an interrupted epoch is taken up again.
"""

import functools
import os
from collections import deque
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass

import numpy as np
import pandas as pd
import torch
from numpy.typing import NDArray
from torch import Tensor

from pilot.augment import AugmentConfig, Light, View, flip, random_light, random_view, render, rotate
from pilot.camera import COLUMNS, ROWS
from pilot.device_augment import Draws
from pilot.frame_cache import FrameCache
from pilot.frames import Frame, UnreadableImage


@dataclass(frozen=True)
class Part:
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
    draws: Draws | None = None


@dataclass(frozen=True)
class Batch:
    """The samples of one step.

    Attributes:
        size: samples over all processes, before those with unreadable pictures fall out.
        parts: this process's; each is made when it is called.
    """

    size: int
    parts: Sequence[Callable[[], Part]]


class BatchLoader:
    """Batches of a set of samples, for one of `world` processes (its share of every batch)."""

    def __init__(self, samples: pd.DataFrame, rows: tuple[int, int], batch_size: int, *,
                 augment: AugmentConfig | None = None, cache: FrameCache | None = None, seed: int = 0, rank: int = 0,
                 world: int = 1, parts: int = 1, for_gpu: bool = False) -> None:
        """Prepare for `samples`; without `augment` frames come as recorded, in the samples' order.

        Args:
            rows: of the frames, that the network looks at.
            cache: reads the frames.
            parts: that each batch is divided into.
            for_gpu: batches are read ahead, and the device augments them. (On a CPU, threads that read ahead would
                fight the network's for the cores, which costs more than it gains.)
        """
        self.images = samples["image"].tolist()
        self.steering = samples["steering"].to_numpy(np.float32)
        self.weight = samples["weight"].to_numpy(np.float32)
        self.flip = samples["flip"].tolist()
        self.rotation = samples["rotation"].tolist()
        self.rows, self.batch_size, self.augment, self.seed = rows, batch_size, augment, seed
        self.rank, self.world, self.parts, self.for_gpu = rank, world, parts, for_gpu
        self.cache = cache or FrameCache()
        self.unreadable: set[str] = set()

    def epoch(self, epoch: int, first_batch: int = 0) -> Iterator[Batch]:
        """The batches of an epoch from `first_batch` on; samples whose picture is damaged fall out."""
        order = self._order(epoch)
        starts = range(first_batch * self.batch_size, len(order), self.batch_size)
        batches = (self._batch(order[start : start + self.batch_size], epoch) for start in starts)
        return read_ahead(batches) if self.for_gpu else batches

    def _order(self, epoch: int) -> NDArray[np.int64]:
        numbers = np.arange(len(self.images))
        return numbers if self.augment is None else np.random.default_rng([self.seed, epoch]).permutation(numbers)

    def _batch(self, index: NDArray[np.int64], epoch: int) -> Batch:
        parts = np.array_split(index[self.rank :: self.world], self.parts)
        return Batch(len(index), [functools.partial(self._load, part, epoch) for part in parts])

    def _load(self, index: NDArray[np.int64], epoch: int) -> Part:
        """Read samples; augment them, or leave that to the device."""
        first, last = self.cache.rows if self.for_gpu else (0, ROWS)
        frames = np.empty((len(index), last - first, COLUMNS, 3), np.uint8)  # rows not filled are never touched
        drawn: list[tuple[View, Light]] = []
        readable = np.array([self._fill(frames, int(sample), epoch, drawn) for sample in index], bool)
        views, lights = [view for view, _ in drawn], [light for _, light in drawn]
        steering = torch.tensor([view.steering for view in views], dtype=torch.float32)
        index = index[readable]
        weight, pictures = torch.from_numpy(self.weight[index]), torch.from_numpy(frames[: len(index)])
        if not self.for_gpu:
            return Part(pictures, steering, weight, index)
        pictures = pictures.pin_memory() if torch.cuda.is_available() else pictures  # copied while the GPU computes
        return Part(pictures, steering, weight, index, Draws.of(views, lights, first, self.rows[0]))

    def _fill(self, frames: Frame, sample: int, epoch: int, drawn: list[tuple[View, Light]]) -> bool:
        """Put a sample behind those already drawn; False if its picture cannot be read."""
        try:
            kept = self.cache.read(self.images[sample])
        except UnreadableImage:
            self.unreadable.add(self.images[sample])
            return False
        view, light = self._draw(sample, epoch)
        if self.for_gpu:
            frames[len(drawn)] = kept
        else:
            frames[len(drawn), slice(*self.rows)] = light.on(render(kept, view, self.rows, self.cache.rows[0]))
        drawn.append((view, light))
        return True

    def _draw(self, sample: int, epoch: int) -> tuple[View, Light]:
        """How a sample is to be seen, with its label."""
        view = View(float(self.steering[sample]))
        if self.rotation[sample]:
            view = rotate(view, self.rotation[sample])
        if self.flip[sample]:
            view = flip(view)
        if self.augment is None:
            return view, Light()
        rng = np.random.default_rng([self.seed, epoch, sample])
        return random_view(view, self.augment, rng), random_light(self.augment, rng)


def read_ahead(batches: Iterator[Batch]) -> Iterator[Batch]:
    """The same batches, some of them already being read, by a thread for each core."""
    cores = os.cpu_count() or 1
    with ThreadPoolExecutor(cores) as threads:
        ahead: deque[Batch] = deque()
        try:
            for batch in batches:
                futures = [threads.submit(part) for part in batch.parts]
                ahead.append(Batch(batch.size, [future.result for future in futures]))
                if len(ahead) > cores:
                    yield ahead.popleft()
            yield from ahead
        finally:  # Ctrl-C or an error in the step: don't read what nobody will use
            threads.shutdown(cancel_futures=True)
