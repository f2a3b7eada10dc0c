"""Images a second of the whole training pipeline beside the pure model step, in one run.

    python benchmarks/training.py [--data RECORDING] [--network nvidia] [--batch-size 64]

The pure step trains on one batch that is already in memory; the pipeline reads, decodes and augments
every picture, as `python model.py` does. Rounds alternate, so that a machine whose speed drifts does
not favour one. Without --data, pictures as large as the simulator's are made up.
"""

import argparse
import contextlib
import itertools
import resource
import statistics
import sys
import tempfile
import time
from collections.abc import Iterable, Iterator
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np

sys.path.insert(0, str(Path(__file__).parents[1]))

from pilot.batches import Batch
from pilot.devices import keep_memory
from pilot.driving_log import read_driving_logs
from pilot.networks import NETWORKS
from pilot.recipes import RECIPES
from pilot.samples import make_samples
from pilot.training import Training

WARM_UP = 4  # steps of a round that are not counted


@contextlib.contextmanager
def made_up_recording(moments: int = 400) -> Iterator[Path]:
    """A recording of pictures that compress like the simulator's (about 13 KB)."""
    rng = np.random.default_rng(0)
    with tempfile.TemporaryDirectory() as name:
        folder, lines = Path(name), []
        (folder / "IMG").mkdir()
        for moment in range(moments):
            stamp = f"2016_12_01_13_{moment // 600:02d}_{moment // 10 % 60:02d}_{moment % 10}00"
            for camera in ("center", "left", "right"):
                coarse = rng.integers(60, 200, (20, 40, 3), dtype=np.uint8)
                frame = cv2.resize(coarse, (320, 160)).astype(int) + rng.integers(-9, 10, (160, 320, 1))
                cv2.imwrite(str(folder / "IMG" / f"{camera}_{stamp}.jpg"), frame.clip(0, 255).astype(np.uint8),
                            [cv2.IMWRITE_JPEG_QUALITY, 75])
            names = ",".join(f"IMG/{camera}_{stamp}.jpg" for camera in ("center", "left", "right"))
            lines.append(f"{names},{rng.normal(0, 0.2):.4f},1,0,30")
        (folder / "driving_log.csv").write_text("\n".join(lines))
        yield folder


def rate(training: Training, batches: Iterable[Batch], steps: int) -> float:
    """Images a second of `steps` steps, after some to warm up."""
    source = iter(batches)
    for batch in itertools.islice(source, WARM_UP):
        training.train_batch(batch)
    began, images = time.perf_counter(), 0
    for batch in itertools.islice(source, steps):
        training.train_batch(batch)
        images += batch.size
    return images / (time.perf_counter() - began)


def main() -> None:
    """Print both rates of every round, their medians and the ratio."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--data", type=Path)
    parser.add_argument("--network", default="nvidia", choices=NETWORKS)
    parser.add_argument("--batch-size", type=int, default=RECIPES["default"].batch_size)
    parser.add_argument("--rounds", type=int, default=5)
    parser.add_argument("--steps", type=int, default=20)
    options = parser.parse_args()
    with contextlib.nullcontext(options.data) if options.data else made_up_recording() as folder:
        config = replace(RECIPES["default"], network=options.network, batch_size=options.batch_size)
        training = Training(config, *make_samples(read_driving_logs([folder]).rows, config.samples, 0))
        keep_memory()
        batch = next(iter(training.loader.epoch(0)))
        first = rate(training, training.loader.epoch(0), options.steps)
        print(f"first epoch, every picture decoded: {first:.0f} images/s; now the later ones, from memory", flush=True)
        for _ in training.loader.epoch(0):
            pass
        rounds = []
        for number in range(options.rounds):
            pure = rate(training, itertools.repeat(batch), options.steps)
            endless = itertools.chain.from_iterable(training.loader.epoch(epoch) for epoch in itertools.count(number))
            pipeline = rate(training, endless, options.steps)
            rounds.append((pure, pipeline))
            print(f"round {number + 1}: pure step {pure:.0f}, pipeline {pipeline:.0f} images/s", flush=True)
    pure, pipeline = (statistics.median(column) for column in zip(*rounds, strict=True))
    ratio = statistics.median(b / a for a, b in rounds)
    memory = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
    print(f"{options.network}, batch {options.batch_size}, {len(training.training)} pictures: pure step {pure:.0f}, "
          f"pipeline {pipeline:.0f} images/s, ratio {ratio:.2f}, most memory {memory:.0f} MB")


if __name__ == "__main__":
    main()
