"""Samples → batches of frames, read, decoded and augmented by a thread for each core.

The order of an epoch and every random draw follow from (seed, epoch, sample) alone: not from the
number of threads or processes, nor from where an interrupted epoch is taken up again.
"""

import os
from collections import deque
from collections.abc import Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import dataclass

import numpy as np
import pandas as pd
import torch
from numpy.typing import NDArray
from torch import Tensor

from pilot.augment import AugmentConfig, View, flip, random_light, random_view, render, rotate
from pilot.camera import COLUMNS, ROWS
from pilot.frames import Frame, FrameCache, UnreadableImage


@dataclass(frozen=True)
class Batch:
    """What one step needs; `index` says which samples these are.

    Attributes:
        frames: n x 160 x 320 x 3, uint8 RGB; only the rows that the network looks at are filled.
        steering: n, float32: the labels.
        weight: n, float32: weights in the loss.
        index: n, int64: numbers of the samples.
        size: samples in the batch over all processes, before unreadable pictures fell out.
    """

    frames: Tensor
    steering: Tensor
    weight: Tensor
    index: NDArray[np.int64]
    size: int


class BatchLoader:
    """Batches of a set of samples, for one of `world` processes (its share of every batch)."""

    def __init__(self, samples: pd.DataFrame, rows: tuple[int, int], batch_size: int, *,
                 augment: AugmentConfig | None = None, seed: int = 0, rank: int = 0, world: int = 1,
                 ahead: int = 0) -> None:
        """Prepare for `samples`; without `augment` frames come as recorded, in the samples' order.

        Args:
            ahead: batches prepared while the network works on another. For a GPU; on a CPU the threads
                would fight the network's for the cores, which costs more than it gains.
        """
        self.images = samples["image"].tolist()
        self.steering = samples["steering"].to_numpy(np.float32)
        self.weight = samples["weight"].to_numpy(np.float32)
        self.flip = samples["flip"].tolist()
        self.rotation = samples["rotation"].tolist()
        self.rows, self.batch_size, self.augment, self.seed = rows, batch_size, augment, seed
        self.rank, self.world, self.ahead = rank, world, ahead
        self.cache = FrameCache()
        self.unreadable: set[str] = set()
        self._threads = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1

    def epoch(self, epoch: int, first_batch: int = 0) -> Iterator[Batch]:
        """The batches of an epoch from `first_batch` on; samples whose picture is damaged fall out."""
        order = self._order(epoch)
        starts = range(first_batch * self.batch_size, len(order), self.batch_size)
        with ThreadPoolExecutor(self._threads) as pool:
            ahead: deque[_Pending] = deque()
            try:
                for start in starts:
                    ahead.append(self._begin(pool, order[start : start + self.batch_size], epoch))
                    if len(ahead) > self.ahead:
                        yield self._finish(ahead.popleft())
                while ahead:
                    yield self._finish(ahead.popleft())
            finally:  # Ctrl-C or an error in the step: don't read what nobody will use
                pool.shutdown(cancel_futures=True)

    def _order(self, epoch: int) -> NDArray[np.int64]:
        numbers = np.arange(len(self.images))
        return numbers if self.augment is None else np.random.default_rng([self.seed, epoch]).permutation(numbers)

    def _begin(self, pool: ThreadPoolExecutor, whole: NDArray[np.int64], epoch: int) -> "_Pending":
        index = whole[self.rank :: self.world]
        frames = np.empty((len(index), ROWS, COLUMNS, 3), np.uint8)  # pages of rows not filled are never touched
        pending = _Pending(frames, np.zeros(len(index), np.float32), np.ones(len(index), bool), index, len(whole), [])
        for part in np.array_split(np.arange(len(index)), self._threads):
            pending.futures.append(pool.submit(self._fill, pending, part, epoch))
        return pending

    def _fill(self, batch: "_Pending", part: NDArray[np.int64], epoch: int) -> None:
        top, bottom = self.rows
        for position in part:
            sample = int(batch.index[position])
            try:
                pixels, batch.steering[position] = self._sample(sample, epoch)
                batch.frames[position, top:bottom] = pixels
            except UnreadableImage:
                batch.readable[position] = False
                self.unreadable.add(self.images[sample])

    def _sample(self, index: int, epoch: int) -> tuple[Frame, float]:
        """One sample's rows and label, as recorded or augmented."""
        frame = self.cache.read(self.images[index])
        view = View(float(self.steering[index]))
        if self.rotation[index]:
            view = rotate(view, self.rotation[index])
        if self.flip[index]:
            view = flip(view)
        if self.augment is None:
            return render(frame, view, self.rows), view.steering
        rng = np.random.default_rng([self.seed, epoch, index])
        view = random_view(view, self.augment, rng)
        return random_light(render(frame, view, self.rows), self.augment, rng), view.steering

    def _finish(self, pending: "_Pending") -> Batch:
        for future in pending.futures:
            future.result()
        keep = pending.readable
        frames, steering, index = pending.frames, pending.steering, pending.index
        if not keep.all():
            frames, steering, index = frames[keep], steering[keep], index[keep]
        weight = torch.from_numpy(self.weight[index])
        return Batch(torch.from_numpy(frames), torch.from_numpy(steering), weight, index, pending.size)


@dataclass
class _Pending:
    """A batch that threads are filling."""

    frames: NDArray[np.uint8]
    steering: NDArray[np.float32]
    readable: NDArray[np.bool_]
    index: NDArray[np.int64]
    size: int
    futures: list[Future[None]]
