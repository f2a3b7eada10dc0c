"""Inference for several frames at once, with the same results to the bit as for one frame at a time.

Many operations choose another algorithm for a batch, which rounds differently in the last bit. That is enough to change
the figures of a drive. Which operations do so depends on the processor and the size of the batch; therefore it is tried
out once for each size, and those that do are applied to one frame at a time. Most of the time is saved nevertheless.
"""

import itertools
from collections.abc import Sequence

import torch
from torch import Tensor

from pilot.model.inference import Operation, chained

TELLING = 1000  # fewer values per frame may be equal by chance, and are computed quickly


class SideBySide:
    """Computes a network's outputs (N x outputs, float32) for several frames (N x 160 x 320 x 3, uint8 RGB)."""

    def __init__(self, steps: Sequence[Operation]) -> None:
        """Create the function for a network's steps, see `inference.fast_steps`."""
        self._steps = steps
        self._by_size: dict[int, Operation] = {1: chained(steps)}

    def __call__(self, frames: Tensor) -> Tensor:
        """Compute the outputs for the frames."""
        size = len(frames)
        if size not in self._by_size:
            self._by_size[size] = self._for(frames)
        return self._by_size[size](frames)

    def _for(self, frames: Tensor) -> Operation:
        """Return the fastest function for as many frames whose results for these are those of single frames."""
        singles = _singles(frames)
        marked = []
        for step in self._steps:
            together = step(torch.cat(singles).clone())
            singles = [step(single.clone()) for single in singles]
            marked.append((singles[0].numel() >= TELLING and torch.equal(together, torch.cat(singles)), step))
        parts: list[Operation] = []
        for at_once, group in itertools.groupby(marked, lambda pair: pair[0]):
            part = chained([step for _, step in group])
            parts.append(part if at_once else _one_by_one(part))
        fast = chained(parts)
        # single frames of a batch lie differently in memory than those of the trial
        return fast if torch.equal(fast(frames), torch.cat(singles)) else _one_by_one(self._by_size[1])


def _one_by_one(operation: Operation) -> Operation:
    return lambda batch: torch.cat([operation(single) for single in _singles(batch)])


def _singles(batch: Tensor) -> list[Tensor]:
    return [batch[number : number + 1] for number in range(len(batch))]
