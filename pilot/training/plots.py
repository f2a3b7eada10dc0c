"""Figures about a training: steering histograms, sample images, learning curves and predictions."""

from collections.abc import Hashable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import ArrayLike, NDArray

from pilot.arrays import Frame
from pilot.camera import path_pixels
from pilot.data.augment import GEOMETRIC, PHOTOMETRIC, AugmentConfig
from pilot.data.frames import read_frame
from pilot.data.samples import SampleConfig, side_steering
from pilot.data.view import View, render
from pilot.files import write_atomically
from pilot.vehicle import CAMERAS, COLUMNS, ROWS

WHOLE = (0, ROWS)
BINS = np.linspace(-1.25, 1.25, 101)


def save(figure: Figure, path: Path) -> None:
    """Write a figure to a PNG file, atomically."""
    write_atomically(path, lambda file: figure.savefig(file, format="png", dpi=110))


def steering_histogram(recorded: ArrayLike, before: ArrayLike, after: ArrayLike, weight: ArrayLike) -> Figure:
    """Draw histograms of the recorded steering, and of the labels before and after balancing (with their weights)."""
    figure = Figure((11, 4), layout="constrained")
    left, right = figure.subplots(1, 2)
    left.hist(np.asarray(recorded), BINS, color="tab:grey")
    left.set(title="recorded steering", xlabel="steering (right is positive)", ylabel="time steps")
    right.hist(np.asarray(before), BINS, color="tab:grey", label="before balancing")
    weights = np.asarray(weight)
    right.hist(np.asarray(after), BINS, weights=weights, color="tab:blue", alpha=0.7, label="after balancing")
    right.set(title="labels of the training pictures", xlabel="steering (right is positive)", ylabel="pictures")
    right.legend(loc="upper right")
    return figure


def sample_sheet(
    moment: Mapping[Hashable, Any], samples: SampleConfig, augment: AugmentConfig, rows: tuple[int, int]
) -> Figure:
    """Draw the camera images of a time step and all augmentations of its centre image, each with its label.

    A line shows the path that results from the label; rows outside `rows` (first, and one after the last), which the
    network does not use, are dimmed. `moment` is a row of a driving log.
    """
    steering = float(moment["steering"])
    tiles = [
        (f"{camera} camera", read_frame(moment[camera]), float(side_steering(steering, camera, samples)))
        for camera in CAMERAS
        if moment[camera]
    ]
    tiles += _augmented(read_frame(moment["center"]), steering, augment)
    figure = Figure((12, 2.15 * -(-len(tiles) // 3)), layout="constrained")
    axes = figure.subplots(-(-len(tiles) // 3), 3).flat
    for axis, tile in zip(axes, tiles, strict=False):
        _draw_tile(axis, *tile, rows)
    for axis in list(axes)[len(tiles) :]:
        axis.axis("off")
    return figure


def _augmented(frame: Frame, steering: float, config: AugmentConfig) -> list[tuple[str, Frame, float]]:
    """Return title, frame and label of each augmentation at the ends of its range, even if its probability is 0."""
    views = {
        name: view for augmentation in GEOMETRIC for name, view in augmentation.examples(View(steering), config).items()
    }
    tiles = [(name, render(frame, view.homography, WHOLE), float(view.steering)) for name, view in views.items()]
    return tiles + [
        (name, augmentation.apply(frame, numbers), steering)
        for augmentation in PHOTOMETRIC
        for name, numbers in augmentation.examples(config).items()
    ]


def _draw_tile(axis: Axes, title: str, frame: Frame, steering: float, rows: tuple[int, int]) -> None:
    shown = frame // 2
    shown[slice(*rows)] = frame[slice(*rows)]
    axis.imshow(shown)
    path = path_pixels(steering)
    axis.plot(path[:, 0], path[:, 1], color="yellow", linewidth=2)
    axis.set(xlim=(0, COLUMNS - 1), ylim=(ROWS - 1, 0), xticks=[], yticks=[])
    axis.set_title(f"{title}: {steering:+.3f}", fontsize=9)


def training_curves(history: Sequence[dict[str, float]], best_epoch: int, baseline: float) -> Figure:
    """Draw the mean squared errors by epoch, and the results of the driving checks if there are any.

    The epoch that was kept (from 1) and the error of always predicting the mean label are marked.
    """
    table = pd.DataFrame(history)
    driven = "cross_track_error" in table
    figure = Figure((8, 7.5 if driven else 4.5), layout="constrained")
    axes = figure.subplots(1 + driven, squeeze=False)[:, 0]
    axes[0].plot(table["epoch"], table["training_mse"], "o-", label="training (augmented)")
    axes[0].plot(table["epoch"], table["validation_mse"], "o-", label="validation")
    axes[0].axhline(baseline, color="grey", linestyle="--", label="validation, predicting the mean")
    axes[0].set(ylabel="mean squared error of the steering", yscale="log")
    if driven:
        axes[1].bar(table["epoch"], table["interventions"], color="tab:red", alpha=0.4, label="interventions")
        axes[1].plot(
            table["epoch"], table["cross_track_error"], "o-", color="tab:purple", label="mean cross-track error, m"
        )
        axes[1].set(ylabel="on short drives", ylim=(0, None))
    for axis in axes:
        axis.axvline(best_epoch, color="tab:green", linestyle=":", label=f"kept: epoch {best_epoch}")
        axis.set(xlabel="epoch")
        axis.grid(alpha=0.3)
        axis.legend(loc="upper right")
    return figure


def predictions(samples: pd.DataFrame, predicted: NDArray[np.float64]) -> Figure:
    """Draw predicted (n) and recorded steering of n validation samples over time; thin lines mark gaps."""
    figure = Figure((12, 4.5), layout="constrained")
    axis = figure.subplots()
    axis.plot(samples["recorded"].to_numpy(), color="tab:grey", linewidth=1, label="recorded")
    axis.plot(predicted, color="tab:blue", linewidth=1.2, label="predicted")
    for start in np.flatnonzero(np.diff(samples["moment"]) != 1):
        axis.axvline(start + 0.5, color="black", linewidth=0.4, alpha=0.5)
    axis.set(xlabel="validation time steps in order (thin line: gap)", ylabel="steering", ylim=(-1.05, 1.05))
    axis.margins(x=0)
    axis.legend(loc="upper right")
    return figure
