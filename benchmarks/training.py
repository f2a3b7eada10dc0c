"""Training speed. Every measurement runs in its own process; rounds alternate, so that drift affects all ways equally.

    python benchmarks/training.py --data RECORDING [--network nvidia] [--batch-size 64] [--load]
    python benchmarks/training.py --data RECORDING --sizes 3000 30000 300000

Ways: roofline: upper limit, from a large matrix multiplication; pure: steps on a batch in memory; pipeline: steps as in
`python model.py`, with decoded images in the cache; first: the same, but every image is decoded, as in the first epoch;
keras, loader: the same training with common Keras and PyTorch pipelines (classic_pipelines.py). --load keeps one core
busy. --sizes compares recordings of about these numbers of images, made by linking the recording repeatedly. Without
--data, synthetic images of the simulator's size are used.
"""

import argparse
import contextlib
import functools
import itertools
import os
import re
import resource
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterable, Iterator
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import torch
from torch.utils.flop_counter import FlopCounterMode

sys.path.insert(0, str(Path(__file__).parents[1]))

from benchmarks.classic_pipelines import data_loader_rate, keras_rate
from pilot import process_settings
from pilot.data.batches import Batch
from pilot.data.driving_log import read_driving_logs
from pilot.data.frame_cache import FrameCache
from pilot.data.log_format import LOG_NAME
from pilot.data.samples import make_samples
from pilot.model.build import build_network
from pilot.model.networks import network_names
from pilot.training.recipes import RECIPES
from pilot.training.session import make_cache, samples_of
from pilot.training.trainer import Training
from pilot.vehicle import CAMERAS

WARM_UP = 4  # steps that are not counted
WAYS = ("roofline", "pure", "pipeline", "first", "keras", "loader")


@contextlib.contextmanager
def synthetic_recording(moments: int = 400) -> Iterator[Path]:
    """Create a temporary recording with synthetic images that compress like those of the simulator (about 13 KB)."""
    rng = np.random.default_rng(0)
    with tempfile.TemporaryDirectory() as name:
        folder, lines = Path(name), []
        (folder / "IMG").mkdir()
        for step in range(moments):
            stamp = f"2016_12_01_13_{step // 600:02d}_{step // 10 % 60:02d}_{step % 10}00"
            for camera in CAMERAS:
                coarse = rng.integers(60, 200, (20, 40, 3), dtype=np.uint8)
                frame = cv2.resize(coarse, (320, 160)).astype(int) + rng.integers(-9, 10, (160, 320, 1))
                cv2.imwrite(
                    str(folder / "IMG" / f"{camera}_{stamp}.jpg"),
                    frame.clip(0, 255).astype(np.uint8),
                    [cv2.IMWRITE_JPEG_QUALITY, 75],
                )
            names = ",".join(f"IMG/{camera}_{stamp}.jpg" for camera in CAMERAS)
            lines.append(f"{names},{rng.normal(0, 0.2):.4f},1,0,30")
        (folder / LOG_NAME).write_text("\n".join(lines))
        yield folder


# One measurement, in its own process


def measure(way: str, options: argparse.Namespace) -> float:
    """Return the images per second of one way to train; for the roofline, at the speed of a matrix multiplication."""
    if way == "roofline":
        return multiplications() / flop_per_image(options.network)
    if way in {"keras", "loader"}:
        samples = make_samples(read_driving_logs([options.data]).rows, RECIPES["default"].samples, 0)[0]
        rate = keras_rate if way == "keras" else data_loader_rate
        return rate(samples["image"].tolist(), samples["steering"].tolist(), options.batch_size, options.steps)
    training = prepare(options, cached=way != "first")
    if way == "pure":
        made = [make() for make in next(training.loader.epoch(0)).micro_batches]
        in_memory = Batch(options.batch_size, [functools.partial(lambda each: each, each) for each in made])
        return rate_of(training, itertools.repeat(in_memory), options.steps)
    return rate_of(training, endless(training), options.steps)


def endless(training: Training) -> Iterator[Batch]:
    """Yield the batches of one epoch after another, without end."""
    return itertools.chain.from_iterable(training.loader.epoch(epoch) for epoch in itertools.count())


def multiplications() -> float:
    """Return the FLOP per second of a large float32 matrix multiplication on all cores."""
    a, b = torch.randn(2048, 2048), torch.randn(2048, 2048)
    times = []
    for _ in range(12):
        began = time.perf_counter()
        torch.mm(a, b)
        times.append(time.perf_counter() - began)
    return float(2 * 2048**3 / statistics.median(times[2:]))


def flop_per_image(name: str) -> float:
    """Return the FLOP of a training step per image: forward and backward pass, without the gradient of the images."""
    network = build_network(name, 0)
    with FlopCounterMode(display=False) as counter:
        network(torch.zeros((2, 160, 320, 3), dtype=torch.uint8)).sum().backward()
    return float(counter.get_total_flops()) / 2


def prepare(options: argparse.Namespace, *, cached: bool) -> Training:
    """Return a training on the recording `options.data`; `cached`: read the images from the cache of decoded images."""
    process_settings.for_training()
    config = replace(
        RECIPES["default"], network=options.network, batch_size=options.batch_size, cache_gb=options.cache_gb
    )
    cache = make_cache(config)
    rows = read_driving_logs([options.data], cache=cache).rows
    samples = samples_of(rows, config)
    training = Training(config, *samples, cache=cache if cached else FrameCache(cache.rows))
    process_settings.use_threads(training.cores.threads_each)
    return training


def rate_of(training: Training, batches: Iterable[Batch], steps: int) -> float:
    """Return the images per second of `steps` steps, after warm-up steps."""
    source = training.steps(batches)
    for _ in itertools.islice(source, WARM_UP):
        pass
    began = time.perf_counter()
    images = sum(itertools.islice(source, steps))
    return images / (time.perf_counter() - began)


# Comparison


def measure_apart(way: str, options: argparse.Namespace, data: Path) -> tuple[float, float]:
    """Return images per second and peak memory (MB) of one way to train, in its own process; NaN if that fails."""
    arguments = [
        "--measure",
        way,
        "--data",
        str(data),
        "--network",
        options.network,
        "--cache-gb",
        str(options.cache_gb),
        "--batch-size",
        str(options.batch_size),
        "--steps",
        str(options.steps),
    ]
    quiet = {**os.environ, "TF_CPP_MIN_LOG_LEVEL": "3", "XDG_CACHE_HOME": str(options.cache)}
    command = [sys.executable, __file__, *arguments]
    done = subprocess.run(command, env=quiet, capture_output=True, text=True, check=False)
    if done.returncode:
        print(f"{way}: {done.stderr.strip().splitlines()[-1]}", flush=True)
        return float("nan"), float("nan")
    rate, memory = map(float, done.stdout.split()[-2:])
    return rate, memory


def compare(options: argparse.Namespace, data: Path) -> None:
    """Print the rates of every round, and the medians of the rates and of their ratios."""
    rounds = []
    for number in range(options.rounds):
        rounds.append([measure_apart(way, options, data)[0] for way in options.ways])
        shown = ", ".join(f"{way} {rate:.0f}" for way, rate in zip(options.ways, rounds[-1], strict=True))
        print(f"round {number + 1}, images/s: {shown}", flush=True)
    columns = dict(zip(options.ways, zip(*rounds, strict=True), strict=True))
    print(
        f"\n{options.network}, batch {options.batch_size}, {os.cpu_count()} cores"
        f"{', one of them busy with something else' if options.load else ''}; medians of {options.rounds}:"
    )
    for name, above, below in (
        ("pure / roofline", "pure", "roofline"),
        ("pipeline / pure", "pipeline", "pure"),
        ("first epoch's pipeline / pure", "first", "pure"),
        ("pipeline / keras", "pipeline", "keras"),
        ("pipeline / loader", "pipeline", "loader"),
    ):
        if above in columns and below in columns:
            ratios = [a / b for a, b in zip(columns[above], columns[below], strict=True)]
            print(
                f"{name}: {statistics.median(ratios):.2f}  "
                f"({statistics.median(columns[above]):.0f} / {statistics.median(columns[below]):.0f} images/s)"
            )


def grow(options: argparse.Namespace, data: Path) -> None:
    """Print the time per image and the peak memory for recordings of all sizes."""
    own = len(list((data / "IMG").iterdir()))
    sizes = {max(round(size / own), 1) * own: options.cache / str(size) for size in options.sizes}
    for size, folder in sizes.items():
        multiply(data, folder, size // own)
    result: dict[int, list[tuple[float, float]]] = {size: [] for size in sizes}
    for number in range(options.rounds):
        for size, folder in sizes.items():
            apart = argparse.Namespace(**{**vars(options), "cache": folder / "cache"})
            result[size].append(measure_apart("pipeline", apart, folder))
        shown = ", ".join(f"{1000 / rounds[-1][0]:.2f} ({size} pictures)" for size, rounds in result.items())
        print(f"round {number + 1}, ms an image: {shown}", flush=True)
    print(f"\nmedians of {options.rounds}:")
    for size, rounds in result.items():
        print(
            f"{size} pictures: {1000 / statistics.median(rate for rate, _ in rounds):.2f} ms an image, "
            f"most memory {max(memory for _, memory in rounds):.0f} MB"
        )


def multiply(data: Path, folder: Path, copies: int) -> None:
    """Create copies of a recording, with links to its images; the years in their names make all of them distinct."""
    log = (data / LOG_NAME).read_text(encoding="utf-8")
    for copy in range(copies):
        images = folder / f"copy {copy}" / "IMG"
        images.mkdir(parents=True)
        move = functools.partial(re.sub, r"_20\d\d_", f"_{2000 + copy}_")
        (images.parent / LOG_NAME).write_text(move(log), encoding="utf-8")
        for picture in (data / "IMG").iterdir():
            (images / move(picture.name)).hardlink_to(picture)


@contextlib.contextmanager
def busy_core() -> Iterator[None]:
    """Keep one core busy with another process."""
    with subprocess.Popen([sys.executable, "-c", "while True: pass"]) as other:
        try:
            yield
        finally:
            other.kill()


def main() -> None:
    """Print the comparison of ways, or of recordings of several sizes."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--data", type=Path)
    parser.add_argument("--network", default="nvidia", choices=network_names())
    parser.add_argument("--batch-size", type=int, default=RECIPES["default"].batch_size)
    parser.add_argument("--cache-gb", type=float, default=RECIPES["default"].cache_gb)
    parser.add_argument("--rounds", type=int, default=5)
    parser.add_argument("--steps", type=int, default=40)
    parser.add_argument("--ways", nargs="+", default=WAYS, choices=WAYS)
    parser.add_argument("--load", action="store_true")
    parser.add_argument("--sizes", nargs="+", type=int)
    parser.add_argument("--measure", choices=WAYS, help=argparse.SUPPRESS)
    options = parser.parse_args()
    if options.measure:
        print(measure(options.measure, options), resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024)
        return
    with contextlib.ExitStack() as stack:
        options.cache = Path(stack.enter_context(tempfile.TemporaryDirectory()))
        data = options.data or stack.enter_context(synthetic_recording())
        if options.load:
            stack.enter_context(busy_core())
        grow(options, data) if options.sizes else compare(options, data)


if __name__ == "__main__":
    main()
