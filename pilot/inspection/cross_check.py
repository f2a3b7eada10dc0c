"""Cross-validation: two networks, each trained on one half of a recording, steer the half that they have not seen."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pandas as pd

from pilot.arrays import Floats
from pilot.data.augment import AugmentConfig
from pilot.data.batches import Batch
from pilot.data.samples import SampleConfig, block_numbers, make_samples
from pilot.progress import ProgressBar, no_bar
from pilot.training.config import TrainingConfig
from pilot.training.trainer import Training

BLOCK_SECONDS = 15.0  # of the halves, which alternate, so that each has a part of every bend's kind
IMAGES = 10_000  # that a network sees in its training
FEWEST_ROWS = 200  # of a recording, from which half a network learns something
CONFIG = TrainingConfig(
    network="pilotnet_standardised",
    batch_size=32,
    warm_up=50,
    select="last",
    samples=SampleConfig(cameras="center", smooth_seconds=0.5, validation_share=0.05, min_speed=0.0),
    augment=AugmentConfig(brightness=0, shadow=0, viewpoint=0.3),
)


def cross_predictions(rows: pd.DataFrame, progress: Callable[[int], ProgressBar[Batch]] | None = None) -> Floats:
    """Return for each of n rows the steering (-1..1) by the network that has not seen it; NaN for too few rows.

    Args:
        rows: of one recording.
        progress: returns the progress bar of the first (0) and the second (1) training.
    """
    predicted = np.full(len(rows), np.nan)
    if len(rows) < FEWEST_ROWS:
        return predicted
    rows = rows.reset_index(drop=True)
    second = block_numbers(rows, BLOCK_SECONDS).to_numpy() % 2 == 1
    for number, held_out in enumerate((second, ~second)):
        samples, validation = make_samples(rows[~held_out].reset_index(drop=True), CONFIG.samples, 0)
        epochs = max(round(IMAGES / len(samples)), 1)
        training = Training(replace(CONFIG, epochs=epochs), samples, validation)
        training.run(lambda _: None, progress(number) if progress else no_bar)
        training.network.eval()
        unseen = rows[held_out]
        predicted[held_out] = training.predict(_as_samples(unseen))
    return predicted


def _as_samples(rows: pd.DataFrame) -> pd.DataFrame:
    same = {"camera": "center", "steering": 0.0, "speed": 0.0, "weight": 1.0, "flip": False, "rotation": 0.0}
    return pd.DataFrame({"image": rows["center"], **same}).reset_index(drop=True)
