"""Profile of a training step on one thread: python benchmarks/step.py [--network nvidia] [--data RECORDING].

The first table contains the stages from the JPEG file to the updated weights. The second one contains the forward pass,
input gradient and weight gradient of each layer, measured separately on data in memory and compared with a large matrix
multiplication (the roofline). `lanes` is the share of the processor's vector lanes that the layer's channels can fill:
oneDNN computes channels in blocks of 16, so that 24 cost as much as 32. Without --data, synthetic images of the
simulator's size are used.
"""

import argparse
import contextlib
import itertools
import os
import statistics
import sys
import tempfile
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

os.environ["OMP_NUM_THREADS"] = "1"  # PyTorch reads it when it is imported

import numpy as np
import torch
from torch import Tensor, nn

sys.path.insert(0, str(Path(__file__).parents[1]))

from benchmarks.training import endless, prepare, rate_of, synthetic_recording
from pilot import process_settings
from pilot.data.augment_batch import apply_photometric
from pilot.data.cache_file import checksum
from pilot.data.frame_cache import FrameCache
from pilot.data.view import render
from pilot.model.build import build_network
from pilot.model.networks import network_names
from pilot.training.trainer import Training

PICTURES = 32  # samples of a micro-batch: the default batch of 64, divided between two cores
LANES = 16  # float32 values in an AVX-512 vector register


@dataclass(frozen=True)
class Operation:
    """The forward pass, input gradient or weight gradient of a layer.

    Attributes:
        name: name of the operation in the table.
        flop: number of floating-point operations for a batch.
        channels: number of channels that it computes.
        run: function that computes it.
    """

    name: str
    flop: float
    channels: int
    run: Callable[[], object]


def seconds(run: Callable[[], object], repeats: int = 20) -> float:
    """Return the median time of a call in seconds."""
    times = []
    for _ in range(repeats + 3):
        began = time.perf_counter()
        run()
        times.append(time.perf_counter() - began)
    return statistics.median(times[3:])


# Stages


def stages(training: Training) -> dict[str, float]:
    """Return the milliseconds per image of each stage of a step, and of the whole step."""
    loader, network = training.loader, training.network.train()
    drawn, numbers = loader._draw(0), np.arange(PICTURES)
    views = loader._views(numbers, drawn)
    paths = loader.images[:PICTURES]
    uncached = FrameCache(training.cache.rows)
    kept = [training.cache.read(path) for path in paths]

    def warp() -> list[Any]:
        return [
            render(frame, homography, loader.rows, training.cache.rows[0])
            for homography, frame in zip(views.homography, kept, strict=True)
        ]

    warped = warp()
    micro_batch = next(loader.epoch(0)).micro_batches[0]()
    crop = micro_batch.frames[:, slice(*network.rows)].permute(0, 3, 1, 2)
    pixels = network.prepare(crop)
    loss = network(micro_batch.frames).square().mean()
    loss.backward(retain_graph=True)
    times = {
        "decode the JPEG (the first time only)": seconds(lambda: [uncached.read(path) for path in paths]),
        "read what was decoded": seconds(lambda: [training.cache.read(path) for path in paths]),
        "draw the augmentations": seconds(lambda: loader._draw(0)) * PICTURES / len(loader.images)
        + seconds(lambda: loader._views(numbers, drawn)),
        "augment: warp": seconds(warp),
        "augment: light and shadow": seconds(
            lambda: [apply_photometric(pixels, drawn.photometric, number) for number, pixels in enumerate(warped)]
        ),
        "scale the pixels": seconds(lambda: network.prepare(crop)),
        "forward": seconds(lambda: network.layers(pixels)),
        "backward": seconds(lambda: torch.autograd.grad(loss, training.parameters, retain_graph=True)),
        "Adam": seconds(training.optimiser.step),
    }
    known = sum(itertools.islice(times.values(), 1, None))
    times["a whole step"] = PICTURES / rate_of(training, endless(training), 40)
    times["Python and all else"] = times["a whole step"] - known
    times["(of which: checksums of what was decoded)"] = seconds(lambda: [checksum(frame) for frame in kept])
    return {name: 1000 * took / PICTURES for name, took in times.items()}


def print_stages(options: argparse.Namespace) -> None:
    """Print the table of stages."""
    with contextlib.ExitStack() as stack:
        os.environ["XDG_CACHE_HOME"] = stack.enter_context(tempfile.TemporaryDirectory())
        options.data = options.data or stack.enter_context(synthetic_recording(100))
        times = stages(prepare(options, cached=True))
    print(f"{options.network}, one thread, batches of {PICTURES}\n\n| stage | ms a picture | share |\n|---|---:|---:|")
    for name, took in times.items():
        print(f"| {name} | {took:.3f} | {took / times['a whole step']:.0%} |")


# Operations


def operations(name: str, layer: nn.Module, given: Tensor, returned: Tensor, *, first: bool) -> list[Operation]:
    """Return the operations of a convolution or dense layer.

    Args:
        name: name of the layer.
        layer: the layer.
        given, returned: its input and its output for a batch.
        first: whether it is the network's first layer, which needs no input gradient.
    """
    given, returned = given.detach(), returned.detach()
    gradient = torch.randn_like(returned)
    if isinstance(layer, nn.Conv2d):
        flop = 2.0 * returned.numel() * layer.weight[0].numel()
        backward = torch.ops.aten.convolution_backward

        def run(wanted: list[bool]) -> object:
            return backward(
                gradient,
                given,
                layer.weight,
                [layer.out_channels],
                layer.stride,
                [0, 0],
                [1, 1],
                False,
                [0, 0],
                1,
                wanted,
            )

        passes = [
            Operation(f"{name} forward", flop, layer.out_channels, lambda: layer(given)),
            Operation(f"{name} input gradient", flop, layer.in_channels, lambda: run([True, False, False])),
            Operation(f"{name} weight gradient", flop, layer.out_channels, lambda: run([False, True, True])),
        ]
    else:
        weight = layer.weight
        assert isinstance(weight, Tensor)
        flop = 2.0 * len(given) * weight.numel()
        passes = [
            Operation(f"{name} forward", flop, len(weight), lambda: layer(given)),
            Operation(f"{name} input gradient", flop, weight.shape[1], lambda: gradient @ weight),
            Operation(f"{name} weight gradient", flop, weight.shape[1], lambda: gradient.T @ given),
        ]
    return [step for step in passes if not (first and "input" in step.name)]


def print_operations(name: str) -> None:
    """Print the table of operations."""
    process_settings.for_training()
    network = build_network(name, 0)
    frames, steering = torch.randint(0, 256, (PICTURES, 160, 320, 3), dtype=torch.uint8), torch.zeros(PICTURES)
    seen: list[tuple[nn.Module, Tensor, Tensor]] = []
    hooks = [
        layer.register_forward_hook(lambda layer, given, returned: seen.append((layer, given[0], returned)))
        for layer in network.modules()
        if isinstance(layer, nn.Conv2d | nn.Linear)
    ]
    network(frames)
    a, b = torch.randn(1024, 1024), torch.randn(1024, 1024)
    roofline = 2 * 1024**3 / seconds(lambda: a @ b)

    def step() -> None:
        network.zero_grad()
        (network(frames) - steering).square().mean().backward()

    for hook in hooks:
        hook.remove()
    passes = [
        one
        for number, (layer, given, returned) in enumerate(seen)
        for one in operations(f"{type(layer).__name__} {number + 1}", layer, given, returned, first=number == 0)
    ]
    times = [seconds(one.run) for one in passes]
    whole = seconds(step)
    print(f"\nroofline {roofline / 1e9:.0f} GFLOP/s on one thread; {name}, {PICTURES} pictures\n")
    print("| operation | ms | share of the step | GFLOP/s | of the roofline | lanes |\n|---|---:|---:|---:|---:|---:|")
    for one, took in zip(passes, times, strict=True):
        if took > 0.01 * whole:
            lanes = one.channels / (-(-one.channels // LANES) * LANES)
            print(
                f"| {one.name} | {took * 1e3:.2f} | {took / whole:.0%} | {one.flop / took / 1e9:.0f} | "
                f"{one.flop / took / roofline:.2f} | {lanes:.2f} |"
            )
    flop, layers = sum(one.flop for one in passes), sum(times)
    print(
        f"| all layers | {layers * 1e3:.2f} | {layers / whole:.0%} | {flop / layers / 1e9:.0f} | "
        f"{flop / layers / roofline:.2f} | |"
    )
    print(
        f"| forward and backward | {whole * 1e3:.2f} | 100% | {flop / whole / 1e9:.0f} | "
        f"{flop / whole / roofline:.2f} | |"
    )


def main() -> None:
    """Print both tables."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--network", default="nvidia", choices=network_names())
    parser.add_argument("--data", type=Path)
    options = parser.parse_args()
    options.batch_size, options.cache_gb = PICTURES, 4.0
    print_stages(options)
    print_operations(options.network)


if __name__ == "__main__":
    main()
