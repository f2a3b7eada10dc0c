"""What all networks have in common: raw frames in, steering out; and layers that several of them use.

Preprocessing is a network's first layer, so it travels with the weights: nobody who drives can get it wrong.
"""

import itertools

import torch
from torch import Tensor, nn
from torch.nn import functional

from pilot.data.view import CROP_BOTTOM, CROP_TOP


class SteeringNetwork(nn.Module):
    """Frames to steering: a crop of `rows` and `columns`, `resize`, `normalise`, then the subclass's `layers`.

    All cut off the sky and the bonnet, which would tell a network which of the three cameras it looks through.
    """

    rows: tuple[int, int] = (70, 135)  # the frame's rows that the network looks at
    columns: tuple[int, int] = (0, 320)
    layers: nn.Module

    def forward(self, frames: Tensor) -> Tensor:
        """Steering (N, float32, -1..1) for frames (N x 160 x 320 x 3, uint8 RGB)."""
        steering: Tensor = self.layers(self.prepare(self.crop(frames)))
        return steering.squeeze(1)

    def crop(self, frames: Tensor) -> Tensor:
        """The pixels that the network looks at: N x 3 x rows x columns, uint8."""
        return frames[:, slice(*self.rows), slice(*self.columns)].permute(0, 3, 1, 2)

    def prepare(self, pixels: Tensor) -> Tensor:
        """The first layer's input for N x 3 x rows x columns pixels (uint8)."""
        return self.normalise(self.resize(pixels))

    def resize(self, pixels: Tensor) -> Tensor:
        """The picture in the size that the layers want, float32 0..255; here: as it is."""
        return pixels.float()

    def normalise(self, pixels: Tensor) -> Tensor:
        """Values (float32 0..255, which may be changed in place) to the range that the layers want; here: -0.5..0.5."""
        return pixels.div_(255).sub_(0.5)


class Standardised(SteeringNetwork):
    """Input of report 004's networks: scaled to 128x128, each picture with mean 0 and deviation 1.

    The report crops the height at random in training and does not say what it does in driving; here
    the network looks at the rows that those crops have on average.
    """

    rows = (CROP_TOP, CROP_BOTTOM)

    def resize(self, pixels: Tensor) -> Tensor:
        """128x128."""
        return functional.interpolate(pixels.float(), (128, 128), mode="bilinear", align_corners=False)

    def normalise(self, pixels: Tensor) -> Tensor:
        """(x - mean) / max(deviation, 1 / root of the number of values), a picture at a time."""
        deviation, mean = torch.std_mean(pixels, dim=(1, 2, 3), keepdim=True, correction=0)
        return (pixels - mean) / deviation.clamp_min((3 * 128 * 128) ** -0.5)


def nvidia_convolutions() -> list[nn.Module]:
    """NVIDIA's five convolutions (arXiv 1604.07316), each with a ReLU."""
    shapes = [(3, 24, 5, 2), (24, 36, 5, 2), (36, 48, 5, 2), (48, 64, 3, 1), (64, 64, 3, 1)]
    layers: list[nn.Module] = []
    for channels, maps, size, stride in shapes:
        layers += [nn.Conv2d(channels, maps, size, stride), nn.ReLU(inplace=True)]
    return layers


def pooled(channels: int, maps: int, size: int, activation: type[nn.Module] | None = None) -> list[nn.Module]:
    """A convolution of `size` x `size`, an activation if one is given, and max-pooling by 2."""
    convolution = nn.Conv2d(channels, maps, size)
    return [convolution, *([activation(inplace=True)] if activation else []), nn.MaxPool2d(2)]


def dense(*sizes: int, activation: type[nn.Module] | None = None) -> list[nn.Module]:
    """Dense layers between the sizes, with an activation between two of them if one is given."""
    layers: list[nn.Module] = []
    for inputs, outputs in itertools.pairwise(sizes):
        layers += [activation()] if layers and activation else []
        layers.append(nn.Linear(inputs, outputs))
    return layers
