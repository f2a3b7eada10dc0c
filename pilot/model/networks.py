"""The networks by name. Preprocessing is their first layer, so it travels with the weights.

Every network takes frames as the simulator sends them, uint8 RGB of shape N x 160 x 320 x 3, and
returns the steering, float32 of shape N (-1..1). All cut off the sky and the bonnet: the bonnet
would tell a network which of the three cameras it looks through.
"""

import copy
import itertools
from collections.abc import Sequence

import torch
from torch import Tensor, nn
from torch.nn import functional

from pilot.data.augment import CROP_BOTTOM, CROP_TOP


class SteeringNetwork(nn.Module):
    """Frames to steering: a crop of `rows`, the subclass's `prepare`, then its `layers`."""

    rows: tuple[int, int] = (70, 135)  # the frame's rows that the network looks at
    columns: tuple[int, int] = (0, 320)
    layers: nn.Module

    def forward(self, frames: Tensor) -> Tensor:
        """Steering (N, float32, -1..1) for frames (N x 160 x 320 x 3, uint8 RGB)."""
        crop = frames[:, slice(*self.rows), slice(*self.columns)]
        steering: Tensor = self.layers(self.prepare(crop.permute(0, 3, 1, 2)))
        return steering.squeeze(1)

    def prepare(self, pixels: Tensor) -> Tensor:
        """Scale N x 3 x rows x columns pixels (uint8) for the first layer."""
        return pixels.float().div_(255).sub_(0.5)


class Nvidia(SteeringNetwork):
    """Seed 000: NVIDIA's layout on the cropped full-size picture, 2,712,951 parameters."""

    def __init__(self) -> None:
        super().__init__()
        self.layers = nn.Sequential(*_nvidia_convolutions(), nn.Flatten(), *_dense(2112, 1164, 100, 50, 10, 1))


class PilotNet(SteeringNetwork):
    """NVIDIA's own network (arXiv 1604.07316): 66x200 YUV, 252,219 parameters."""

    yuv: Tensor

    def __init__(self) -> None:
        super().__init__()
        dense = _dense(1152, 100, 50, 10, 1, activation=nn.ReLU)
        self.layers = nn.Sequential(*_nvidia_convolutions(), nn.Flatten(), *dense)
        yuv = torch.tensor([[0.299, 0.587, 0.114], [-0.147, -0.289, 0.436], [0.615, -0.515, -0.100]])
        self.register_buffer("yuv", yuv, persistent=False)

    def prepare(self, pixels: Tensor) -> Tensor:
        """Scale to 66x200, to YUV (ITU-R BT.601), to about -1..1."""
        if pixels.device.type != "cpu":  # CPUs scale bytes twelve times faster than floats; GPUs only floats
            pixels = pixels.float()
        small = functional.interpolate(pixels, (66, 200), mode="bilinear", antialias=True).float()
        return functional.conv2d(small, self.yuv[:, :, None, None] / 127.5, -self.yuv.sum(1))


class LeNet5(SteeringNetwork):
    """Seed 000's first try: the classical LeNet-5 layout (6 and 16 maps, 120, 84) on the cropped picture."""

    def __init__(self) -> None:
        super().__init__()
        convolutions = _pooled(3, 6, 5, nn.ReLU) + _pooled(6, 16, 5, nn.ReLU)
        dense = _dense(16 * 13 * 77, 120, 84, 1, activation=nn.ReLU)
        self.layers = nn.Sequential(*convolutions, nn.Flatten(), *dense)


class LeNet(SteeringNetwork):
    """Seed 002's modified LeNet, 723,091 parameters."""

    columns = (1, 319)  # one column less at each side: only that gives the document's count

    def __init__(self) -> None:
        super().__init__()
        convolutions = _pooled(3, 6, 5, nn.ReLU) + _pooled(6, 6, 5, nn.ReLU)
        self.layers = nn.Sequential(*convolutions, nn.Flatten(), *_dense(5928, 120, 84, 1))


class Standardised(SteeringNetwork):
    """Input of seed 004's networks: scaled to 128x128, each picture with mean 0 and deviation 1.

    The seed crops the height at random in training and does not say what it does in driving; here
    the network looks at the rows that those crops have in the mean.
    """

    rows = (CROP_TOP, CROP_BOTTOM)

    def prepare(self, pixels: Tensor) -> Tensor:
        """(x - mean) / max(deviation, 1 / root of the number of values), a picture at a time."""
        small = functional.interpolate(pixels.float(), (128, 128), mode="bilinear", align_corners=False)
        deviation, mean = torch.std_mean(small, dim=(1, 2, 3), keepdim=True, correction=0)
        return (small - mean) / deviation.clamp_min((3 * 128 * 128) ** -0.5)


class SimpleNet(Standardised):
    """Seed 004's SimpleNet, 183,683 parameters."""

    def __init__(self) -> None:
        super().__init__()
        convolutions = [*_pooled(3, 8, 5), *_pooled(8, 8, 5, nn.ELU), *_pooled(8, 16, 4), nn.Conv2d(16, 16, 5)]
        self.layers = nn.Sequential(*convolutions, nn.Flatten(), *_dense(1296, 128, 50, 10, 1))


class DenseNet(Standardised):
    """Seed 004's DenseNet, 187,469 parameters (the document's 189,373 normalises rows, not channels)."""

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
        layers += [nn.AdaptiveAvgPool2d(1), nn.Flatten(), *_dense(channels, 500, 100, 1)]
        self.layers = nn.Sequential(*layers)


class _DenseUnit(nn.Module):
    """Batch norm, ELU, 3x3 convolution; its maps are put behind all maps before."""

    def __init__(self, channels: int, growth: int) -> None:
        super().__init__()
        convolution = nn.Conv2d(channels, growth, 3, padding=1, bias=False)
        self.grow = nn.Sequential(nn.BatchNorm2d(channels), nn.ELU(inplace=True), convolution)

    def forward(self, maps: Tensor) -> Tensor:
        return torch.cat([maps, self.grow(maps)], dim=1)


def _nvidia_convolutions() -> list[nn.Module]:
    shapes = [(3, 24, 5, 2), (24, 36, 5, 2), (36, 48, 5, 2), (48, 64, 3, 1), (64, 64, 3, 1)]
    layers: list[nn.Module] = []
    for channels, maps, size, stride in shapes:
        layers += [nn.Conv2d(channels, maps, size, stride), nn.ReLU(inplace=True)]
    return layers


def _pooled(channels: int, maps: int, size: int, activation: type[nn.Module] | None = None) -> list[nn.Module]:
    convolution = nn.Conv2d(channels, maps, size)
    return [convolution, *([activation(inplace=True)] if activation else []), nn.MaxPool2d(2)]


def _dense(*sizes: int, activation: type[nn.Module] | None = None) -> list[nn.Module]:
    """Dense layers between the sizes, with an activation between two of them if one is given."""
    layers: list[nn.Module] = []
    for inputs, outputs in itertools.pairwise(sizes):
        layers += [activation()] if layers and activation else []
        layers.append(nn.Linear(inputs, outputs))
    return layers


NETWORKS: dict[str, type[SteeringNetwork]] = {
    "nvidia": Nvidia,
    "pilotnet": PilotNet,
    "lenet5": LeNet5,
    "lenet": LeNet,
    "simplenet": SimpleNet,
    "densenet": DenseNet,
}


def build_network(name: str, seed: int | None = None) -> SteeringNetwork:
    """A network by its name, freshly initialised as Keras would (Glorot uniform, biases zero).

    Raises:
        ValueError: there is no network of this name.
    """
    if name not in NETWORKS:
        raise ValueError(f"no network is called {name!r}; there are: {', '.join(NETWORKS)}")
    with torch.random.fork_rng(devices=[], enabled=seed is not None):
        if seed is not None:
            torch.manual_seed(seed)
        network = NETWORKS[name]()
        network.apply(_initialise)
    # channels-last convolutions are about twice as fast on a CPU, and frames come that way anyhow
    return network.to(memory_format=torch.channels_last)  # type: ignore[call-overload, no-any-return]


def _initialise(layer: nn.Module) -> None:
    if isinstance(layer, nn.Conv2d | nn.Linear):
        nn.init.xavier_uniform_(layer.weight)
        if layer.bias is not None:
            nn.init.zeros_(layer.bias)


def fold_dense(network: SteeringNetwork) -> SteeringNetwork:
    """A copy for driving: dense layers with nothing between them are one, as the seeds' are.

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


def count_parameters(network: nn.Module, kinds: Sequence[type[nn.Module]] = (nn.Module,)) -> int:
    """Trainable parameters of a network, or of its layers of some kinds."""
    layers = [layer for layer in network.modules() if isinstance(layer, tuple(kinds))]
    return sum({id(p): p.numel() for layer in layers for p in layer.parameters()}.values())
