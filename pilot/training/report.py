"""The folder beside model.pt: history of the training, figures and pictures."""

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

SMOOTHED_SECONDS = 0.5  # a driver's jerks on the keyboard are no model's fault


@dataclass(frozen=True)
class ValidationResult:
    """How a network agrees with the driver on the validation moments.

    Attributes:
        predicted: its steering, one a moment (-1..1).
        recorded: compared with the steering as it was recorded.
        smoothed: compared with the steering averaged over half a second.
    """

    predicted: NDArray[np.float64]
    recorded: Agreement
    smoothed: Agreement


class History:
    """Writes each epoch's figures to history.csv, and to TensorBoard if asked.

    Raises:
        ValueError: TensorBoard is asked for and not installed.
    """

    def __init__(self, folder: Path, *, tensorboard: bool) -> None:
        self.folder = folder
        self.events: SummaryWriter | None = _event_writer(folder) if tensorboard else None

    def write(self, history: list[dict[str, float]]) -> None:
        """Write the history so far."""
        text = pd.DataFrame(history).to_csv(index=False)
        write_atomically(self.folder / "history.csv", lambda file: file.write(text.encode()))
        if self.events:
            for name, value in history[-1].items():
                self.events.add_scalar(name, value, int(history[-1]["epoch"]))
            self.events.flush()


def _event_writer(folder: Path) -> "SummaryWriter":
    try:
        from torch.utils.tensorboard import SummaryWriter  # noqa: PLC0415 - seldom wanted, and an optional package
    except ImportError as error:
        raise ValueError("--tensorboard needs the package tensorboard: pip install tensorboard") from error
    return SummaryWriter(str(folder))


def validate_model(training: Training) -> ValidationResult:
    """Drive the validation moments with the network as it is; all processes take part."""
    validation = training.validation
    predicted = training.predict(validation)
    smooth = smooth_steering(validation.assign(steering=validation["recorded"]), SMOOTHED_SECONDS)
    return ValidationResult(
        predicted,
        agreement(predicted, validation["recorded"], training.training_mean),
        agreement(predicted, smooth, training.training_mean),
    )


def draw_samples(log: DrivingLog, training: Training) -> None:
    """Draw what is known before the first epoch: histograms and the sheet of samples."""
    config = training.config
    before = _unbalanced(log, config)["steering"]
    after, weight = training.training["steering"], training.training["weight"]
    histogram = plots.steering_histogram(log.rows["steering"], before, after, weight)
    plots.save(histogram, config.report / "steering_histogram.png")
    moment = _telling_moment(log.rows)
    sheet = plots.sample_sheet(moment, config.samples, config.augment, training.network.rows)
    plots.save(sheet, config.report / "samples.png")


def draw_results(training: Training, result: ValidationResult) -> None:
    """Draw how the training went and what the best epoch predicts."""
    best, baseline = training.chosen["epoch"], result.recorded.baseline_mse
    folder = training.config.report
    plots.save(plots.training_curves(training.history, best, baseline), folder / "training_curves.png")
    plots.save(plots.predictions(training.validation, result.predicted), folder / "predictions.png")


def _unbalanced(log: DrivingLog, config: TrainingConfig) -> pd.DataFrame:
    training, _ = make_samples(log.rows, replace(config.samples, balance="none"), config.seed)
    return training


def _telling_moment(rows: pd.DataFrame) -> dict[Hashable, Any]:
    """A moment with all cameras in a gentle bend, where a label can be judged by eye."""
    complete = rows[(rows["left"] != "") & (rows["right"] != "")]
    chosen = complete if len(complete) else rows
    return chosen.loc[[(chosen["steering"].abs() - 0.1).abs().idxmin()]].to_dict("records")[0]
