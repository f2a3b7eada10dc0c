"""Saliency of image regions by VisualBackProp (Bojarski et al., arXiv 1611.05418)."""

from collections.abc import Sequence
from typing import Any

import cv2
import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor, nn
from torch.nn import functional

from pilot.arrays import Frame
from pilot.model.steering_network import SteeringNetwork
from pilot.vehicle import COLUMNS, ROWS

SPATIAL = (nn.Conv2d, nn.MaxPool2d, nn.AvgPool2d)


def saliency(network: SteeringNetwork, frame: Frame) -> NDArray[np.float32]:
    """Return the contribution of each pixel of a 160x320x3 uint8 RGB frame: 160x320, 0..1."""
    return saliency_of_all(network, [frame])[0]


def saliency_of_all(network: SteeringNetwork, frames: Sequence[Frame]) -> list[NDArray[np.float32]]:
    """Return the contribution of each pixel of n frames (160x320x3, uint8 RGB): n of 160x320, 0..1.

    The feature maps that enter each convolution or pooling layer are averaged over their channels. From the last layer
    to the first, the relevance is spread over each unit's receptive field and multiplied by the average there, so that
    a pixel counts if all layers are activated by it.
    """
    entering: list[tuple[nn.Module, Tensor]] = []

    def note(layer: nn.Module, inputs: tuple[Any, ...], _output: Tensor) -> None:
        entering.append((layer, inputs[0].clone()))  # later layers may change it in place

    hooks = [layer.register_forward_hook(note) for layer in network.modules() if isinstance(layer, SPATIAL)]
    try:
        with torch.inference_mode():
            network(torch.from_numpy(np.stack([network.signature.standing(frame) for frame in frames])))
            relevance = _spread_back(entering, len(frames))
    finally:
        for hook in hooks:
            hook.remove()
    return [_into_frame(each, network) for each in relevance]


def _spread_back(entering: list[tuple[nn.Module, Tensor]], count: int) -> Tensor:
    """Return the relevance (n x rows x columns) at the first layer's input."""
    relevance = torch.ones(())
    for number, (layer, maps) in reversed(list(enumerate(entering))):
        average = maps.relu().mean(1, keepdim=True)
        seen = average.shape[-2:]
        spread = relevance if relevance.dim() == 0 else _spread(layer, relevance, seen)
        relevance = spread * average if number else spread  # the intensity of the pixels themselves does not count
        relevance = relevance / relevance.amax((1, 2, 3), keepdim=True).clamp_min(1e-12)
    return relevance[:, 0] if relevance.dim() else torch.ones(count, 1, 1)


def _spread(layer: nn.Module, relevance: Tensor, size: torch.Size) -> Tensor:
    """Spread relevance over the receptive fields of the layer's units by a transposed convolution with ones."""
    kernel, stride, padding = (_pair(getattr(layer, name)) for name in ("kernel_size", "stride", "padding"))
    spread = functional.conv_transpose2d(relevance, torch.ones(1, 1, *kernel), stride=stride, padding=padding)
    missing = (size[0] - spread.shape[-2], size[1] - spread.shape[-1])  # rows and columns omitted by the stride
    return functional.pad(spread, (0, missing[1], 0, missing[0]))


def _pair(value: int | tuple[int, int]) -> tuple[int, int]:
    return (value, value) if isinstance(value, int) else value


def _into_frame(relevance: Tensor, network: SteeringNetwork) -> NDArray[np.float32]:
    (top, bottom), (left, right) = network.rows, network.columns
    whole = np.zeros((ROWS, COLUMNS), np.float32)
    size = (right - left, bottom - top)
    whole[top:bottom, left:right] = cv2.resize(relevance.numpy(), size, interpolation=cv2.INTER_LINEAR)
    return whole / max(float(whole.max()), 1e-12)


def overlay(frame: Frame, relevance: NDArray[np.float32]) -> Frame:
    """Return the frame (160x320x3, uint8 RGB) with relevant pixels (160x320, 0..1) highlighted in green."""
    glow = np.zeros_like(frame)
    glow[..., 1] = (255 * np.sqrt(relevance)).astype(np.uint8)
    return np.asarray(cv2.addWeighted(frame, 0.75, glow, 0.9, 0), np.uint8)
