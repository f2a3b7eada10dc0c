"""The folder next to model.pt: metrics of every epoch, and figures."""

import logging
from collections.abc import Hashable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from pilot.data.driving_log import DrivingLog
from pilot.data.samples import make_samples, smooth_steering
from pilot.files import write_atomically
from pilot.training import plots
from pilot.training.config import TrainingConfig
from pilot.training.metrics import Agreement, agreement
from pilot.training.trainer import Training

if TYPE_CHECKING:
    from torch.utils.tensorboard import SummaryWriter

log = logging.getLogger("pilot")

SMOOTHED_SECONDS = 0.5  # averages out the jerky steering of keyboard driving, which no model should be blamed for


@dataclass(frozen=True)
class ValidationResult:
    """Predictions and metrics of a network on the validation set.

    Attributes:
        predicted: n, predicted steering of the validation samples (not clipped to -1..1).
        recorded: metrics against the steering as recorded.
        smoothed: metrics against the recorded steering averaged over `SMOOTHED_SECONDS`.
    """

    predicted: NDArray[np.float64]
    recorded: Agreement
    smoothed: Agreement


class History:
    """Writes the metrics of each epoch to history.csv, and optionally to TensorBoard."""

    def __init__(self, folder: Path, *, tensorboard: bool) -> None:
        """Create a history in `folder`.

        Raises:
            ValueError: the package tensorboard is needed and not installed.
        """
        self.folder = folder
        self.events: SummaryWriter | None = _event_writer(folder) if tensorboard else None

    def write(self, history: list[dict[str, float]]) -> None:
        """Write the metrics of all epochs so far to history.csv, and those of the last one to TensorBoard."""
        text = pd.DataFrame(history).to_csv(index=False)
        try:
            write_atomically(self.folder / "history.csv", lambda file: file.write(text.encode()))
        except OSError as error:  # a spreadsheet shows it: no reason to end the training
            log.warning("%s. It is written again after the next epoch", error)
        if self.events:
            for name, value in history[-1].items():
                self.events.add_scalar(name, value, int(history[-1]["epoch"]))
            self.events.flush()


def _event_writer(folder: Path) -> "SummaryWriter":
    try:
        from torch.utils.tensorboard import SummaryWriter  # noqa: PLC0415 - an optional package
    except ImportError as error:
        raise ValueError("--tensorboard needs the package tensorboard: pip install tensorboard") from error
    return SummaryWriter(str(folder))


def validate_model(training: Training) -> ValidationResult:
    """Compute predictions and metrics of the current network on the validation set; called by all processes."""
    validation = training.validation
    predicted = training.predict(validation)
    smooth = smooth_steering(validation.assign(steering=validation["recorded"]), SMOOTHED_SECONDS)
    return ValidationResult(
        predicted,
        agreement(predicted, validation["recorded"], training.training_mean),
        agreement(predicted, smooth, training.training_mean),
    )


def draw_samples(log: DrivingLog, training: Training) -> None:
    """Draw the steering histograms and the sheet of sample images into the folder of the metrics."""
    config = training.config
    before = _unbalanced(log, config)["steering"]
    after, weight = training.training["steering"], training.training["weight"]
    histogram = plots.steering_histogram(log.rows["steering"], before, after, weight)
    plots.save(histogram, config.report / "steering_histogram.png")
    moment = _example_row(log.rows)
    sheet = plots.sample_sheet(moment, config.samples, config.augment, training.network.rows)
    plots.save(sheet, config.report / "samples.png")


def draw_results(training: Training, result: ValidationResult) -> None:
    """Draw the learning curves and the predictions of the epoch that was kept."""
    best, baseline = training.chosen["epoch"], result.recorded.baseline_mse
    folder = training.config.report
    plots.save(plots.training_curves(training.history, best, baseline), folder / "training_curves.png")
    plots.save(plots.predictions(training.validation, result.predicted), folder / "predictions.png")


def _unbalanced(log: DrivingLog, config: TrainingConfig) -> pd.DataFrame:
    training, _ = make_samples(log.rows, replace(config.samples, balance="none"), config.seed)
    return training


def _example_row(rows: pd.DataFrame) -> dict[Hashable, Any]:
    """Return a row in a gentle curve (steering near 0.1), if possible with all cameras, to check labels by eye."""
    complete = rows[(rows["left"] != "") & (rows["right"] != "")]
    chosen = complete if len(complete) else rows
    return chosen.loc[[(chosen["steering"].abs() - 0.1).abs().idxmin()]].to_dict("records")[0]
