"""What a step minimises and how: loss, Adam, learning rate."""

import math
from collections.abc import Sequence

import torch
from torch import Tensor
from torch.nn import functional
from torch.optim import Optimizer
from torch.optim.lr_scheduler import LambdaLR

from pilot.training.config import TrainingConfig


def losses(predicted: Tensor, steering: Tensor, config: TrainingConfig) -> Tensor:
    """The loss of each sample (n): the squared error, or Huber's."""
    if config.loss == "huber":
        return functional.huber_loss(predicted, steering, reduction="none", delta=config.huber_delta)
    return functional.mse_loss(predicted, steering, reduction="none")


def make_optimiser(parameters: Sequence[Tensor], config: TrainingConfig, device: torch.device) -> Optimizer:
    """Adam, with L2 regularisation of all parameters."""
    return torch.optim.Adam(
        # Adam adds weight_decay * w to the gradient; that of l2 * sum of w**2 is 2 * l2 * w
        parameters,
        lr=config.learning_rate,
        weight_decay=2 * config.l2,
        fused=device.type in ("cpu", "cuda"),
    )


def make_scheduler(optimiser: Optimizer, config: TrainingConfig, steps: int, done: int) -> LambdaLR:
    """Sets the learning rate of each step: that of its epoch, but rising over the first steps of the training.

    Args:
        optimiser: whose learning rate is set.
        config: schedule and warm-up.
        steps: in an epoch.
        done: steps of this training so far, when it is resumed.
    """

    def factor(step: int) -> float:
        return schedule(config, step // steps) * min((step + 1) / max(config.warm_up, 1), 1.0)

    for group in optimiser.param_groups:
        group["initial_lr"] = config.learning_rate
    return LambdaLR(optimiser, factor, last_epoch=done - 1)


def learning_rate(config: TrainingConfig, epoch: int) -> float:
    """The learning rate of an epoch (from 0), after the warm-up."""
    return config.learning_rate * schedule(config, epoch)


def schedule(config: TrainingConfig, epoch: int) -> float:
    """The share (0..1) of the learning rate that an epoch (from 0) has."""
    return (1 + math.cos(math.pi * epoch / config.epochs)) / 2 if config.schedule == "cosine" else 1.0
