"""A PilotNet that predicts the steering of the next half second, to bridge latency."""

from pilot.model.networks.pilotnet_standardised import StandardisedPilotNet
from pilot.signature import Signature


class AheadPilotNet(StandardisedPilotNet):
    """The standardised PilotNet with the steering of now and of five later moments, 260,094 parameters.

    As the chunks of actions of T. Z. Zhao et al., Learning Fine-Grained Bimanual Manipulation with Low-Cost Hardware
    (2023), arXiv 2304.13705. Driven is by the steering for the moment at which it takes effect.
    """

    signature = Signature(horizons=(0.0, 0.1, 0.2, 0.3, 0.4, 0.5))


NETWORK = AheadPilotNet
