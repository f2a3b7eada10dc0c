"""The modified LeNet of report 002."""

from torch import nn

from pilot.model.steering_network import SteeringNetwork, dense, pooled


class LeNet(SteeringNetwork):
    """Report 002's modified LeNet, 723,091 parameters."""

    columns = (1, 319)  # without the outermost columns: only this matches the report's parameter count

    def __init__(self) -> None:
        super().__init__()
        convolutions = pooled(3, 6, 5, nn.ReLU) + pooled(6, 6, 5, nn.ReLU)
        self.layers = nn.Sequential(*convolutions, nn.Flatten(), *dense(5928, 120, 84, 1))


NETWORK = LeNet
