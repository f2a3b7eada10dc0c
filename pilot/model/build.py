"""Construction and initialisation of networks by name."""

from collections.abc import Sequence

import torch
from torch import nn

from pilot.model.networks import network_class
from pilot.model.steering_network import SteeringNetwork


def build_network(name: str, seed: int | None = None) -> SteeringNetwork:
    """Build a network, initialised as in Keras (Glorot uniform weights, zero biases).

    Args:
        name: one of `network_names()`.
        seed: seed of the initialisation; None: PyTorch's global random generator is used.

    Raises:
        ValueError: there is no network of this name.
    """
    with torch.random.fork_rng(devices=[], enabled=seed is not None):
        if seed is not None:
            torch.manual_seed(seed)
        network = network_class(name)()
        network.apply(_initialise)
    # channels-last convolutions are about twice as fast on a CPU, and frames already have this layout
    return network.to(memory_format=torch.channels_last)  # type: ignore[call-overload, no-any-return]


def _initialise(layer: nn.Module) -> None:
    if isinstance(layer, nn.Conv2d | nn.Linear):
        nn.init.xavier_uniform_(layer.weight)
        if layer.bias is not None:
            nn.init.zeros_(layer.bias)


def count_parameters(network: nn.Module, kinds: Sequence[type[nn.Module]] = (nn.Module,)) -> int:
    """Count the parameters of a network, or of its layers of the given kinds; shared ones are counted once."""
    layers = [layer for layer in network.modules() if isinstance(layer, tuple(kinds))]
    return sum({id(p): p.numel() for layer in layers for p in layer.parameters()}.values())
