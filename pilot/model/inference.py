"""Fast CPU inference of a trained network, for driving.

In a small network, overhead takes much of the time. It is removed by merging consecutive dense layers (fewer weights to
read), by folding the normalisation of colours into the first convolution, and by calling the operations instead of the
modules (which look up their weights and hooks by name at each call).
"""

import copy
from collections.abc import Callable, Sequence
from functools import partial
from typing import TypeGuard

import torch
from torch import Tensor, nn
from torch.nn import functional

from pilot.model.steering_network import SteeringNetwork

Operation = Callable[[Tensor], Tensor]


def fast_predict(network: SteeringNetwork) -> Operation:
    """Return a fast function that computes all of a network's outputs, as `SteeringNetwork.predict`.

    Its result equals the network's except for rounding.

    Args:
        network: a network in evaluation mode; later changes of its weights have no effect.
    """
    return chained(fast_steps(network))


def fast_steps(network: SteeringNetwork) -> list[Operation]:
    """Return the operations of the fast forward function, to be applied one after another."""
    folded = fold_dense(network)
    if type(network).predict is not SteeringNetwork.predict or type(network.layers) is not nn.Sequential:
        return [folded.predict]
    layers = list(folded.layers.children())
    own = type(network).prepare is not SteeringNetwork.prepare
    prepare: list[Operation] = [folded.prepare] if own else [folded.resize, folded.normalise]
    if (convolution := _fold_colours(folded, layers[0])) is not None:
        prepare, layers[0] = [folded.resize], convolution
    split, join = ([folded.split], [folded.join]) if network.signature.history else ([], [])
    return [*split, folded.crop, *prepare, *join, *map(_operation, layers)]


def chained(operations: Sequence[Operation]) -> Operation:
    """Return a function that applies operations one after another."""

    def forward(maps: Tensor) -> Tensor:
        for operation in operations:
            maps = operation(maps)
        return maps

    return forward


def _fold_colours(network: SteeringNetwork, first: nn.Module) -> nn.Conv2d | None:
    """Fold the normalisation into the first convolution; return None if it is not one affine map for all pixels."""
    if type(first) is not nn.Conv2d or first.padding != (0, 0) or first.groups != 1 or first.bias is None:
        return None
    if network.signature.history:
        return None
    if type(network).prepare is not SteeringNetwork.prepare:
        return None
    with torch.inference_mode():
        basis = 255 * torch.eye(3, 4).reshape(1, 3, 1, 4)  # red, green, blue, black
        probe = 5.0 * torch.arange(48).reshape(1, 3, 4, 4)
        images = network.normalise(basis.clone())[0, :, 0]
        shift = images[:, 3]
        matrix = (images[:, :3] - shift[:, None]) / 255
        expected = torch.einsum("ij,njhw->nihw", matrix, probe) + shift[:, None, None]
        if not torch.allclose(network.normalise(probe.clone()), expected, atol=1e-5):
            return None
        folded = copy.deepcopy(first)
        weight = first.weight.double()
        folded.weight.data = torch.einsum("oihw,ij->ojhw", weight, matrix.double()).float()
        bias = first.bias.double() + torch.einsum("oihw,i->o", weight, shift.double())
        folded.bias = nn.Parameter(bias.float())
    return folded.to(memory_format=torch.channels_last)  # type: ignore[call-overload, no-any-return]


def _operation(layer: nn.Module) -> Operation:
    """Return a function equivalent to a layer, with as little Python overhead as possible."""
    if type(layer) is nn.Conv2d and layer.padding_mode == "zeros":
        bias = None if layer.bias is None else layer.bias.detach()
        return partial(
            torch.conv2d,
            weight=layer.weight.detach(),
            bias=bias,
            stride=layer.stride,
            padding=layer.padding,
            dilation=layer.dilation,
            groups=layer.groups,
        )
    if type(layer) is nn.Linear:
        bias = None if layer.bias is None else layer.bias.detach()
        return partial(functional.linear, weight=layer.weight.detach(), bias=bias)
    if type(layer) is nn.ReLU:
        return torch.relu_ if layer.inplace else torch.relu
    return layer


def fold_dense(network: SteeringNetwork) -> SteeringNetwork:
    """Return a copy in which consecutive dense layers with biases (no activation between them) are merged.

    Most of the reports' networks have such layers; `nvidia` then reads 2,112 of these weights per frame instead of 2.6
    million. The steering is the same except for rounding.
    """
    folded = copy.deepcopy(network)
    if type(network.layers) is not nn.Sequential:  # its `forward` may connect the layers differently
        return folded
    layers: list[nn.Module] = []
    for layer in folded.layers.children():
        before = layers[-1] if layers else None
        if _with_bias(before) and _with_bias(layer):
            layers[-1] = _joined(before, layer)
        else:
            layers.append(layer)
    folded.layers = nn.Sequential(*layers)
    return folded


def _with_bias(layer: nn.Module | None) -> TypeGuard[nn.Linear]:
    return type(layer) is nn.Linear and layer.bias is not None


def _joined(first: nn.Linear, second: nn.Linear) -> nn.Linear:
    joined = nn.Linear(first.in_features, second.out_features)
    weight = second.weight.detach().double()
    joined.weight.data = (weight @ first.weight.detach().double()).float()
    joined.bias.data = (weight @ first.bias.detach().double() + second.bias.detach().double()).float()
    return joined
