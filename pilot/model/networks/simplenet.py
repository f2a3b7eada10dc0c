"""SimpleNet of report 004."""

from torch import nn

from pilot.model.steering_network import Standardised, dense, pooled


class SimpleNet(Standardised):
    """Report 004's SimpleNet, 183,683 parameters."""

    def __init__(self) -> None:
        super().__init__()
        convolutions = [*pooled(3, 8, 5), *pooled(8, 8, 5, nn.ELU), *pooled(8, 16, 4), nn.Conv2d(16, 16, 5)]
        self.layers = nn.Sequential(*convolutions, nn.Flatten(), *dense(1296, 128, 50, 10, 1))


NETWORK = SimpleNet
