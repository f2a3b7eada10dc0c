"""Base classes of the networks, from unmodified frames to steering, and layers that several of them use.

Preprocessing is part of each network, so that training and driving always use the same.
"""

import itertools
from collections.abc import Sequence

import torch
from torch import Tensor, nn
from torch.nn import functional

from pilot.data.view import CROP_BOTTOM, CROP_TOP
from pilot.signature import STEERING_ONLY, Signature
from pilot.vehicle import WHOLE_FRAME, Rows

NVIDIA_MAPS = (24, 36, 48, 64, 64)  # feature maps of NVIDIA's convolutions (arXiv 1604.07316)


class SteeringNetwork(nn.Module):
    """Base class: crops frames to `rows` and `columns`, applies `resize` and `normalise`, then the subclass's `layers`.

    All networks crop the sky and the bonnet, which would reveal which of the three cameras took the image.

    Attributes:
        signature: what the network takes and returns.
        rows: first frame row that the network uses, and the one after the last.
        columns: first frame column that the network uses, and the one after the last.
        layers: maps the prepared images to N x `signature.outputs`; set by the subclass.
    """

    signature: Signature = STEERING_ONLY
    rows: Rows = (70, 135)
    columns: tuple[int, int] = (0, 320)
    layers: nn.Module

    @property
    def seen_rows(self) -> Rows:
        """Rows of a frame on which the steering depends: `rows`, or all if a subclass does not crop them."""
        own = (type(self).crop, type(self).forward, type(self).predict)
        crops = own == (SteeringNetwork.crop, SteeringNetwork.forward, SteeringNetwork.predict)
        return self.rows if crops else WHOLE_FRAME

    def forward(self, frames: Tensor) -> Tensor:
        """Compute the steering (N, float32) for frames (N x 160 x 320 x 3, uint8 RGB).

        Networks with a history take N x K x 160 x 320 x 3, the newest frame first.
        """
        return self.predict(frames)[:, 0]

    def predict(self, frames: Tensor) -> Tensor:
        """Compute all outputs for frames as in `forward`: N x `signature.outputs`, float32.

        They are the steering for each horizon and, if the network predicts it, the speed in units of `SPEED_UNIT`.
        """
        outputs: Tensor = self.layers(self.join(self.prepare(self.crop(self.split(frames)))))
        return outputs

    def split(self, frames: Tensor) -> Tensor:
        """Return the frames of all histories one after another: N * K x 160 x 320 x 3."""
        return frames.flatten(0, 1) if self.signature.history else frames

    def join(self, pixels: Tensor) -> Tensor:
        """Stack each history's prepared images as channels: N * K x 3 x height x width to N x 3K x height x width."""
        channels = 3 * self.signature.frames
        return pixels.reshape(-1, channels, *pixels.shape[2:]) if self.signature.history else pixels

    def crop(self, frames: Tensor) -> Tensor:
        """Crop frames (N x 160 x 320 x 3) to N x 3 x rows x columns; the dtype is kept."""
        return frames[:, slice(*self.rows), slice(*self.columns)].permute(0, 3, 1, 2)

    def prepare(self, pixels: Tensor) -> Tensor:
        """Resize and normalise cropped pixels (N x 3 x rows x columns, uint8) to the input of `layers` (float32)."""
        return self.normalise(self.resize(pixels))

    def resize(self, pixels: Tensor) -> Tensor:
        """Resize cropped pixels (uint8) to the input size of `layers` (float32, 0..255); by default unchanged."""
        return pixels.float()

    def normalise(self, pixels: Tensor) -> Tensor:
        """Normalise pixels (float32, 0..255), possibly in place, to the range of `layers`; by default -0.5..0.5."""
        return pixels.div_(255).sub_(0.5)


class Standardised(SteeringNetwork):
    """Base class of report 004's networks: images of 128x128, each standardised to mean 0 and standard deviation 1.

    The report crops the height at random in training and does not specify the crop used in driving; these networks use
    the mean of the random crops.
    """

    rows = (CROP_TOP, CROP_BOTTOM)

    def resize(self, pixels: Tensor) -> Tensor:
        """Resize to 128x128 (float32, 0..255)."""
        return functional.interpolate(pixels.float(), (128, 128), mode="bilinear", align_corners=False)

    def normalise(self, pixels: Tensor) -> Tensor:
        """Compute (x - mean) / max(deviation, 1 / square root of the number of values) of each image."""
        deviation, mean = torch.std_mean(pixels, dim=(1, 2, 3), keepdim=True, correction=0)
        return (pixels - mean) / deviation.clamp_min((3 * 128 * 128) ** -0.5)


def nvidia_convolutions(maps: Sequence[int] = NVIDIA_MAPS, inputs: int = 3) -> list[nn.Module]:
    """Return NVIDIA's five convolutions (arXiv 1604.07316), each followed by a ReLU.

    Args:
        maps: numbers of their feature maps.
        inputs: channels of the image.
    """
    layers: list[nn.Module] = []
    for channels, outputs, size, stride in zip((inputs, *maps), maps, (5, 5, 5, 3, 3), (2, 2, 2, 1, 1), strict=False):
        layers += [nn.Conv2d(channels, outputs, size, stride), nn.ReLU(inplace=True)]
    return layers


def pooled(channels: int, maps: int, size: int, activation: type[nn.Module] | None = None) -> list[nn.Module]:
    """Return a `size` x `size` convolution from `channels` to `maps`, an activation, if given, and 2x2 max-pooling."""
    convolution = nn.Conv2d(channels, maps, size)
    return [convolution, *([activation(inplace=True)] if activation else []), nn.MaxPool2d(2)]


def dense(*sizes: int, activation: type[nn.Module] | None = None) -> list[nn.Module]:
    """Return dense layers of the sizes (input first, output last), with an activation, if given, between them."""
    layers: list[nn.Module] = []
    for inputs, outputs in itertools.pairwise(sizes):
        layers += [activation()] if layers and activation else []
        layers.append(nn.Linear(inputs, outputs))
    return layers
