"""How well predicted steering agrees with recorded steering.

Four lines of NumPy: importing scikit-learn's metrics would take 2.4 seconds of each start.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike


@dataclass(frozen=True)
class Agreement:
    """Predictions against the steering of the driver; steering in -1..1, so errors are too.

    Attributes:
        count: moments compared.
        mse: mean squared error.
        r2: share of the variance explained; 0 is as good as the mean of these moments; NaN where nothing varies.
        correlation: Pearson's; 0 where one of the two does not vary.
        baseline_mse: mean squared error of always answering the training set's mean.
    """

    count: int
    mse: float
    r2: float
    correlation: float
    baseline_mse: float

    def __str__(self) -> str:
        return (
            f"MSE {self.mse:.4f} (always the mean: {self.baseline_mse:.4f}), R² {self.r2:.3f}, "
            f"correlation {self.correlation:.3f}, {self.count} moments"
        )


def agreement(predicted: ArrayLike, recorded: ArrayLike, training_mean: float) -> Agreement:
    """Compare predicted and recorded steering (both of shape N, -1..1)."""
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
