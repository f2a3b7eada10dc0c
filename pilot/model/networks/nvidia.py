"""The network of report 000: NVIDIA's layers on the cropped frame."""

from torch import nn

from pilot.model.steering_network import SteeringNetwork, dense, nvidia_convolutions


class Nvidia(SteeringNetwork):
    """Report 000's network: NVIDIA's layers on the cropped frame without scaling, 2,712,951 parameters."""

    def __init__(self) -> None:
        super().__init__()
        self.layers = nn.Sequential(*nvidia_convolutions(), nn.Flatten(), *dense(2112, 1164, 100, 50, 10, 1))


NETWORK = Nvidia
