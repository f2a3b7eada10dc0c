"""PilotNet, NVIDIA's network."""

import torch
from torch import Tensor, nn
from torch.nn import functional

from pilot.model.steering_network import NVIDIA_MAPS, SteeringNetwork, dense, nvidia_convolutions


class PilotNet(SteeringNetwork):
    """NVIDIA's network (arXiv 1604.07316) with 66x200 YUV input, 252,219 parameters.

    Attributes:
        maps: number of feature maps of each convolution.
    """

    maps: tuple[int, ...] = NVIDIA_MAPS
    colours: Tensor
    shift: Tensor

    def __init__(self) -> None:
        super().__init__()
        head = dense(1152, 100, 50, 10, self.signature.outputs, activation=nn.ReLU)
        convolutions = nvidia_convolutions(self.maps, 3 * self.signature.frames)
        self.layers = nn.Sequential(*convolutions, nn.Flatten(), *head)
        yuv = torch.tensor([[0.299, 0.587, 0.114], [-0.147, -0.289, 0.436], [0.615, -0.515, -0.100]])
        self.register_buffer("colours", yuv[:, :, None, None] / 127.5, persistent=False)
        self.register_buffer("shift", -yuv.sum(1), persistent=False)

    def resize(self, pixels: Tensor) -> Tensor:
        """Resize to 66x200 (float32, 0..255)."""
        if pixels.device.type != "cpu":  # on CPUs, uint8 is twelve times faster than float32; GPUs need float32
            pixels = pixels.float()
        return functional.interpolate(pixels, (66, 200), mode="bilinear", antialias=True).float()

    def normalise(self, pixels: Tensor) -> Tensor:
        """Convert to YUV (ITU-R BT.601), scaled to about -1..1."""
        return functional.conv2d(pixels, self.colours, self.shift)


NETWORK = PilotNet
