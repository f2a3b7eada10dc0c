"""Trains NVIDIA's network with Keras on recordings, as many did; uses nothing of this project. See docs/models.md.

python simulator.py record --track lake --laps 1 --recoveries 20 --rate 4 --wander 0.3 --out data/lake
python examples/train_keras.py data/lake     # with TensorFlow; writes nvidia.keras
python export.py nvidia.keras                # without TensorFlow; writes nvidia.onnx
python evaluate.py nvidia.onnx --tracks lake

The network: M. Bojarski et al., End to End Learning for Self-Driving Cars (2016), arXiv 1604.07316. Cropping and
scaling are layers, so that it takes frames as they come from the simulator.
"""

import argparse
import csv
import math
import os
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import cv2
import numpy as np

os.environ.setdefault("TF_CPP_MIN_LOG_LEVEL", "2")  # read by TensorFlow when it is imported

try:
    import keras
    from keras import layers
except ModuleNotFoundError as error:
    raise SystemExit(f"{error}: this example needs pip install tensorflow-cpu") from None

CAMERAS = {0: 0, 1: 1, 2: -1}  # column of the log (centre, left, right): factor of the correction
BATCH = 64


class Batches(keras.utils.PyDataset):  # type: ignore[misc]
    """Images of all three cameras (64 x 160 x 320 x 3, uint8 RGB) and steering (64, -1..1), half of them mirrored."""

    def __init__(self, recordings: Sequence[Path], correction: float, seed: int) -> None:
        """Read the logs of recordings; `correction` is added to the steering for left, subtracted for right cameras."""
        super().__init__()
        self.samples = [
            (folder / "IMG" / Path(row[column].strip()).name, float(row[3]) + factor * correction)
            for folder in recordings
            for row in csv.reader((folder / "driving_log.csv").read_text().splitlines())
            for column, factor in CAMERAS.items()
        ]
        self.random = np.random.default_rng(seed)
        self.on_epoch_end()

    def __len__(self) -> int:
        return math.ceil(len(self.samples) / BATCH)

    def __getitem__(self, number: int) -> tuple[Any, Any]:
        images, steering = [], []
        for index in self.order[number * BATCH : (number + 1) * BATCH]:
            path, label = self.samples[index]
            image = cv2.imread(str(path))
            if image is None:
                raise SystemExit(f"{path}: is missing or cannot be read")
            mirrored = self.random.random() < 0.5
            images.append(image[:, :: -1 if mirrored else 1, ::-1])  # OpenCV reads BGR
            steering.append(-label if mirrored else label)
        return np.stack(images), np.array(steering, np.float32)

    def on_epoch_end(self) -> None:
        """Shuffle."""
        self.order = self.random.permutation(len(self.samples))


def nvidia_network() -> Any:
    """Return NVIDIA's network for frames of the simulator, with dropout before the dense layers."""
    return keras.Sequential(
        [
            layers.Input((160, 320, 3)),
            layers.Cropping2D(((60, 24), (0, 0))),
            layers.Rescaling(1 / 127.5, -1),
            *[
                layers.Conv2D(maps, size, stride, activation="elu")
                for maps, size, stride in ((24, 5, 2), (36, 5, 2), (48, 5, 2), (64, 3, 1), (64, 3, 1))
            ],
            layers.Flatten(),
            layers.Dropout(0.3),
            *[layers.Dense(units, activation="elu") for units in (100, 50, 10)],
            layers.Dense(1),
        ]
    )


def main(arguments: Sequence[str] | None = None) -> None:
    """Train on recordings, and save the network."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("recordings", type=Path, nargs="+")
    parser.add_argument("--out", type=Path, default=Path("nvidia.keras"))
    parser.add_argument("--epochs", type=int, default=10)
    parser.add_argument("--correction", type=float, default=0.2, help="of the steering for the side cameras")
    parser.add_argument("--seed", type=int, default=0)
    options = parser.parse_args(arguments)
    for folder in options.recordings:
        if not (folder / "driving_log.csv").is_file():
            parser.error(f"{folder}: contains no driving_log.csv, so it is no recording")
    keras.utils.set_random_seed(options.seed)
    network = nvidia_network()
    network.compile(keras.optimizers.Adam(1e-3), "mse")
    network.fit(Batches(options.recordings, options.correction, options.seed), epochs=options.epochs)
    network.save(options.out)
    print(f"network: {options.out}")


if __name__ == "__main__":
    main()
