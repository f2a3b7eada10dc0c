"""Regression metrics of predicted steering against recorded steering.

They are computed with NumPy, because importing scikit-learn's metrics would add 2.4 seconds to every start.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike


@dataclass(frozen=True)
class Agreement:
    """Metrics of predicted steering (-1..1) against recorded steering.

    Attributes:
        count: number of time steps compared.
        mse: mean squared error.
        r2: coefficient of determination; 0: as good as the mean of the recorded steering; NaN if that is constant.
        correlation: Pearson correlation; 0 if the predicted or the recorded steering is constant.
        baseline_mse: mean squared error of always predicting the mean label of the training set.
    """

    count: int
    mse: float
    r2: float
    correlation: float
    baseline_mse: float

    def __str__(self) -> str:
        return (
            f"MSE {self.mse:.4f} (predicting the mean: {self.baseline_mse:.4f}), R² {self.r2:.3f}, "
            f"correlation {self.correlation:.3f}, {self.count} time steps"
        )


def agreement(predicted: ArrayLike, recorded: ArrayLike, training_mean: float) -> Agreement:
    """Compute the metrics of predicted against recorded steering.

    Args:
        predicted, recorded: n values each, -1..1.
        training_mean: mean label of the training set, for the baseline.
    """
    guess, truth = np.asarray(predicted, float), np.asarray(recorded, float)
    varies = len(truth) > 1 and guess.std() > 0 and truth.std() > 0
    mse = float(np.mean((guess - truth) ** 2))
    return Agreement(
        count=len(truth),
        mse=mse,
        r2=1 - mse / float(truth.var()) if truth.std() > 0 else float("nan"),
        correlation=float(np.corrcoef(guess, truth)[0, 1]) if varies else 0.0,
        baseline_mse=float(np.mean((training_mean - truth) ** 2)),
    )
