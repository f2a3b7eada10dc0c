"""Loss function, optimiser and learning rate schedule."""

import math
from collections.abc import Sequence

import torch
from torch import Tensor
from torch.nn import functional
from torch.optim import Optimizer
from torch.optim.lr_scheduler import LambdaLR

from pilot.training.config import TrainingConfig


def losses(predicted: Tensor, labels: Tensor, config: TrainingConfig) -> Tensor:
    """Return the loss of each sample (n): squared error, or Huber loss, averaged over the network's outputs.

    Args:
        predicted: n x outputs.
        labels: n x outputs; NaN where unknown, which counts as no error.
        config: training options; the loss is used.
    """
    labels = torch.where(labels.isnan(), predicted.detach(), labels)
    if config.loss == "huber":
        return functional.huber_loss(predicted, labels, reduction="none", delta=config.huber_delta).mean(1)
    return functional.mse_loss(predicted, labels, reduction="none").mean(1)


def make_optimiser(parameters: Sequence[Tensor], config: TrainingConfig, device: torch.device) -> Optimizer:
    """Return Adam with L2 regularisation of all parameters; a fused implementation on CPUs and NVIDIA GPUs."""
    return torch.optim.Adam(
        # weight_decay * w is added to the gradient; the gradient of l2 * sum(w**2) is 2 * l2 * w
        parameters,
        lr=config.learning_rate,
        weight_decay=2 * config.l2,
        fused=device.type in ("cpu", "cuda"),
    )


def make_scheduler(optimiser: Optimizer, config: TrainingConfig, steps: int, done: int) -> LambdaLR:
    """Return a scheduler that sets the learning rate of each step: the schedule, times the linear warm-up.

    Args:
        optimiser: optimiser whose learning rate is set.
        config: training options; the schedule and the warm-up are used.
        steps: number of steps per epoch.
        done: number of steps already done, if the training is resumed.
    """

    def factor(step: int) -> float:
        return schedule(config, step / steps) * min((step + 1) / max(config.warm_up, 1), 1.0)

    for group in optimiser.param_groups:
        group["initial_lr"] = config.learning_rate
    return LambdaLR(optimiser, factor, last_epoch=done - 1)


def learning_rate(config: TrainingConfig, epoch: int) -> float:
    """Return the learning rate of an epoch (from 0) after the warm-up."""
    return config.learning_rate * schedule(config, epoch)


def schedule(config: TrainingConfig, epoch: float) -> float:
    """Return the factor (0..1) of the initial learning rate after a number of epochs."""
    return (1 + math.cos(math.pi * epoch / config.epochs)) / 2 if config.schedule == "cosine" else 1.0
