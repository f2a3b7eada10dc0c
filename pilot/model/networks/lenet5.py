"""LeNet-5, the first attempt of report 000."""

from torch import nn

from pilot.model.steering_network import SteeringNetwork, dense, pooled


class LeNet5(SteeringNetwork):
    """Report 000's first attempt: LeNet-5 (6 and 16 maps, 120, 84) on the cropped frame, 1,935,161 parameters."""

    def __init__(self) -> None:
        super().__init__()
        convolutions = pooled(3, 6, 5, nn.ReLU) + pooled(6, 16, 5, nn.ReLU)
        head = dense(16 * 13 * 77, 120, 84, 1, activation=nn.ReLU)
        self.layers = nn.Sequential(*convolutions, nn.Flatten(), *head)


NETWORK = LeNet5
