"""Training pipelines as commonly written for this simulator, with which training.py compares this project's.

Both read, decode and augment image by image with OpenCV, on whole frames, and crop sky and bonnet afterwards. They use
the same network, batch size and augmentations as `python model.py --network nvidia`.
"""

import importlib
import itertools
import math
import random
import time
from collections.abc import Iterator
from typing import Any

import cv2
import numpy as np
import torch
from numpy.typing import NDArray
from torch import nn

from pilot.camera import viewpoint_homography
from pilot.data.augment import AugmentConfig

Picture = NDArray[np.uint8]
AUGMENT = AugmentConfig()
WARM_UP = 6  # steps that are not counted


def augmented(path: str, steering: float) -> tuple[Picture, float]:
    """Read an image, and augment it and its label with the default probabilities."""
    image: Any = cv2.cvtColor(np.asarray(cv2.imread(path)), cv2.COLOR_BGR2RGB)
    if random.random() < AUGMENT.viewpoint:
        offset = random.uniform(-AUGMENT.viewpoint_metres, AUGMENT.viewpoint_metres)
        heading = math.radians(random.uniform(-AUGMENT.viewpoint_degrees, AUGMENT.viewpoint_degrees))
        homography = viewpoint_homography(offset, heading)
        image = cv2.warpPerspective(image, homography, (320, 160), borderMode=cv2.BORDER_REPLICATE)
        steering -= 0.06 * offset + 0.9 * heading
    if random.random() < AUGMENT.flip:
        image, steering = np.fliplr(image), -steering
    if random.random() < AUGMENT.brightness:
        image = brightened(image, random.uniform(*AUGMENT.brightness_range))
    if random.random() < AUGMENT.shadow:
        image = shaded(image, random.uniform(*AUGMENT.shadow_range))
    return np.ascontiguousarray(image, np.uint8), steering


def brightened(image: Any, factor: float) -> Any:
    """Scale the HSV value by a factor."""
    hsv = cv2.cvtColor(image, cv2.COLOR_RGB2HSV).astype(np.float32)
    hsv[:, :, 2] = np.clip(hsv[:, :, 2] * factor, 0, 255)
    return cv2.cvtColor(hsv.astype(np.uint8), cv2.COLOR_HSV2RGB)


def shaded(image: Any, factor: float) -> Any:
    """Scale the brightness on one side of a random line by a factor."""
    height, width = image.shape[:2]
    top, bottom = random.uniform(0, width), random.uniform(0, width)
    x, y = np.meshgrid(np.arange(width), np.arange(height))
    side = x > top + (bottom - top) * y / height
    mask = side if random.random() < 0.5 else ~side
    image = image.copy()
    image[mask] = (image[mask] * factor).astype(np.uint8)
    return image


def shuffled(images: list[str], labels: list[float]) -> Iterator[tuple[str, float]]:
    """Yield images and labels in random order, epoch after epoch."""
    while True:
        yield from random.sample(list(zip(images, labels, strict=True)), len(images))


# Keras: generator and fit


def keras_rate(images: list[str], labels: list[float], batch_size: int, steps: int) -> float:
    """Return the images per second of Keras's `model.fit` on a generator."""
    keras = importlib.import_module("tensorflow").keras  # not at the top, because the other benchmarks run without it
    layers = keras.layers
    model = keras.Sequential(
        [
            layers.Input((160, 320, 3)),
            layers.Rescaling(1 / 255, -0.5),
            layers.Cropping2D(((70, 25), (0, 0))),
            *[
                layers.Conv2D(maps, size, stride, activation="relu")
                for maps, size, stride in ((24, 5, 2), (36, 5, 2), (48, 5, 2), (64, 3, 1), (64, 3, 1))
            ],
            layers.Flatten(),
            *[layers.Dense(units) for units in (1164, 100, 50, 10, 1)],
        ]
    )
    model.compile(optimizer=keras.optimizers.Adam(1e-3), loss="mse")

    def batches() -> Iterator[tuple[NDArray[Any], NDArray[Any]]]:
        samples = shuffled(images, labels)
        while True:
            pairs = [augmented(*sample) for sample in itertools.islice(samples, batch_size)]
            yield np.array([image for image, _ in pairs]), np.array([steering for _, steering in pairs])

    times: list[float] = []

    def note_time(batch: int, logs: Any = None) -> None:
        times.append(time.perf_counter())

    clock = keras.callbacks.LambdaCallback(on_train_batch_end=note_time)
    model.fit(batches(), steps_per_epoch=WARM_UP + steps, epochs=1, verbose=0, callbacks=[clock])
    return batch_size * steps / (times[-1] - times[WARM_UP - 1])


# PyTorch: Dataset and DataLoader


class Samples(torch.utils.data.Dataset[tuple[torch.Tensor, torch.Tensor]]):
    """Data set of augmented images as float tensors, with their labels."""

    def __init__(self, images: list[str], labels: list[float]) -> None:
        self.images, self.labels = images, labels

    def __len__(self) -> int:
        """Return the number of samples."""
        return len(self.images)

    def __getitem__(self, index: int) -> tuple[torch.Tensor, torch.Tensor]:
        """Return an image (3 x 65 x 320, float32, -0.5..0.5) and its label."""
        image, steering = augmented(self.images[index], self.labels[index])
        pixels = torch.from_numpy(image[70:135]).permute(2, 0, 1).float() / 255 - 0.5
        return pixels, torch.tensor(steering, dtype=torch.float32)


def data_loader_rate(images: list[str], labels: list[float], batch_size: int, steps: int, workers: int = 2) -> float:
    """Return the images per second of a common training loop over a DataLoader."""
    shapes = ((3, 24, 5, 2), (24, 36, 5, 2), (36, 48, 5, 2), (48, 64, 3, 1), (64, 64, 3, 1))
    convolutions = [layer for shape in shapes for layer in (nn.Conv2d(*shape), nn.ReLU())]
    sizes = (2112, 1164, 100, 50, 10, 1)
    network = nn.Sequential(*convolutions, nn.Flatten(), *itertools.starmap(nn.Linear, itertools.pairwise(sizes)))
    optimiser = torch.optim.Adam(network.parameters(), 1e-3)
    loader = torch.utils.data.DataLoader(
        Samples(images, labels), batch_size, shuffle=True, num_workers=workers, drop_last=True
    )
    endless = itertools.chain.from_iterable(loader for _ in itertools.count())
    began = 0.0
    for number, (pictures, steering) in enumerate(itertools.islice(endless, WARM_UP + steps)):
        if number == WARM_UP:
            began = time.perf_counter()
        optimiser.zero_grad()
        loss = nn.functional.mse_loss(network(pictures)[:, 0], steering)
        loss.backward()  # type: ignore[no-untyped-call]
        optimiser.step()
    return batch_size * steps / (time.perf_counter() - began)
