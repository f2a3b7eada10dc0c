"""DenseNet of report 004."""

import torch
from torch import Tensor, nn

from pilot.model.steering_network import Standardised, dense


class DenseNet(Standardised):
    """Report 004's DenseNet, 187,469 parameters (189,373 in the report, which normalises rows instead of channels)."""

    GROWTH, UNITS = 12, 3

    def __init__(self) -> None:
        super().__init__()
        channels = 16
        layers: list[nn.Module] = [nn.Conv2d(3, channels, 3, padding=1, bias=False)]
        for block in range(3):
            layers += [_DenseUnit(channels + self.GROWTH * unit, self.GROWTH) for unit in range(self.UNITS)]
            channels += self.GROWTH * self.UNITS
            layers += [nn.BatchNorm2d(channels), nn.ELU(inplace=True)]
            if block < 2:
                layers += [nn.Conv2d(channels, channels, 1, bias=False), nn.AvgPool2d(2)]
        layers += [nn.AdaptiveAvgPool2d(1), nn.Flatten(), *dense(channels, 500, 100, 1)]
        self.layers = nn.Sequential(*layers)


class _DenseUnit(nn.Module):
    """Batch normalisation, ELU and 3x3 convolution, whose maps are appended to the input's."""

    def __init__(self, channels: int, growth: int) -> None:
        super().__init__()
        convolution = nn.Conv2d(channels, growth, 3, padding=1, bias=False)
        self.grow = nn.Sequential(nn.BatchNorm2d(channels), nn.ELU(inplace=True), convolution)

    def forward(self, maps: Tensor) -> Tensor:
        return torch.cat([maps, self.grow(maps)], dim=1)


NETWORK = DenseNet
