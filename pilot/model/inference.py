"""A trained network as fast as PyTorch runs it on a CPU, for driving.

What costs time in a small network beside its arithmetic goes here: weights that are read for nothing (dense layers in a
row), a normalisation of colours that the first convolution can do as well, and Python's own calls (a module looks up
its weights and hooks by name each time it is called).
"""

import copy
from collections.abc import Callable
from functools import partial

import torch
from torch import Tensor, nn
from torch.nn import functional

from pilot.model.steering_network import SteeringNetwork

Operation = Callable[[Tensor], Tensor]


def fast_forward(network: SteeringNetwork) -> Operation:
    """The steering (N) of a network in evaluation mode for frames (N x 160 x 320 x 3, uint8 RGB), as fast as it goes.

    The same but for rounding. Later changes of the network's weights do not show.
    """
    folded = fold_dense(network)
    if type(network).forward is not SteeringNetwork.forward or type(network.layers) is not nn.Sequential:
        return folded
    prepare = folded.prepare
    layers = list(folded.layers.children())
    if (convolution := _fold_colours(folded, layers[0])) is not None:
        prepare, layers[0] = folded.resize, convolution
    operations = [_operation(layer) for layer in layers]

    def forward(frames: Tensor) -> Tensor:
        maps = prepare(folded.crop(frames))
        for operation in operations:
            maps = operation(maps)
        return maps.squeeze(1)

    return forward


def _fold_colours(network: SteeringNetwork, first: nn.Module) -> nn.Conv2d | None:
    """The first convolution with the normalisation in it; None where that is not one 3x3 matrix for every pixel."""
    if type(first) is not nn.Conv2d or first.padding != (0, 0) or first.groups != 1 or first.bias is None:
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
    """What a layer does to its input, with as few steps of Python as possible."""
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
    """A copy for driving: dense layers with nothing between them are one, as those of the reports are.

    The same steering but for rounding; `nvidia` then reads 2,112 weights for a frame instead of 2.6 million.
    """
    folded = copy.deepcopy(network)
    if type(network.layers) is not nn.Sequential:  # its layers may be joined by a forward of its own
        return folded
    layers: list[nn.Module] = []
    for layer in folded.layers.children():
        before = layers[-1] if layers else None
        if isinstance(before, nn.Linear) and isinstance(layer, nn.Linear):
            layers[-1] = _joined(before, layer)
        else:
            layers.append(layer)
    folded.layers = nn.Sequential(*layers)
    return folded


def _joined(first: nn.Linear, second: nn.Linear) -> nn.Linear:
    joined = nn.Linear(first.in_features, second.out_features)
    weight = second.weight.detach().double()
    joined.weight.data = (weight @ first.weight.detach().double()).float()
    joined.bias.data = (weight @ first.bias.detach().double() + second.bias.detach().double()).float()
    return joined
