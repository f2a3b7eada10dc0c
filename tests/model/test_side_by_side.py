"""Inference for several frames at once gives the same to the bit as for one at a time."""

import pytest
import torch
from conftest import random_frames
from torch import Tensor

from pilot.model.build import build_network
from pilot.model.inference import fast_predict, fast_steps
from pilot.model.networks import network_names
from pilot.model.side_by_side import SideBySide


@pytest.mark.parametrize("name", network_names())
def test_every_network_steers_the_same(name: str) -> None:
    network = build_network(name, 1).eval()
    alone, together = fast_predict(network), SideBySide(fast_steps(network))
    with torch.inference_mode():
        frames = [random_frames(network, count, count) for count in (1, 2, 3)]
        together(frames[2])
        for batch in (frames[0], frames[1], frames[2].flip(0), frames[2]):
            assert torch.equal(together(batch), torch.cat([alone(frame[None]) for frame in batch]))


def test_a_step_that_rounds_differently_in_a_batch_is_applied_to_single_frames() -> None:
    calls: list[int] = []

    def batched(maps: Tensor) -> Tensor:
        calls.append(len(maps))
        return maps + 1.0

    def rounding(maps: Tensor) -> Tensor:
        return maps + 1e-3 * len(maps)

    together = SideBySide([batched, rounding])
    maps = torch.zeros(4, 2000)
    expected = torch.full((4, 2000), 1.0) + 1e-3
    assert torch.equal(together(maps), expected)
    calls.clear()
    assert torch.equal(together(maps), expected)
    assert calls == [4]  # and the other one to all at once


def test_equal_results_of_few_values_prove_nothing() -> None:
    def rounding(maps: Tensor) -> Tensor:
        return maps + (1e-3 if len(maps) > 1 and bool(maps.any()) else 0.0)

    together = SideBySide([rounding])
    together(torch.zeros(2, 10))
    assert torch.equal(together(torch.ones(2, 10)), torch.ones(2, 10))
