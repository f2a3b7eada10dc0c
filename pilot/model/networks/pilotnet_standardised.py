"""PilotNet on images of standardised contrast."""

import torch
from torch import Tensor

from pilot.model.networks.pilotnet import PilotNet

LEAST_DEVIATION = 0.01  # of the luminance, -1..1; less is only noise


class StandardisedPilotNet(PilotNet):
    """NVIDIA's network with each image's luminance standardised to mean 0 and standard deviation 1.

    The colour differences are divided by the same deviation. The network therefore does not have to learn that exposure
    and contrast are irrelevant, neither those of other lights nor those of another simulator.
    """

    def normalise(self, pixels: Tensor) -> Tensor:
        """Convert to YUV and standardise by the luminance."""
        yuv = super().normalise(pixels)
        deviation, mean = torch.std_mean(yuv[:, :1], dim=(2, 3), keepdim=True)
        return torch.cat([yuv[:, :1] - mean, yuv[:, 1:]], 1) / deviation.clamp_min(LEAST_DEVIATION)


NETWORK = StandardisedPilotNet
