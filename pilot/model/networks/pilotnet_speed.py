"""A PilotNet that also predicts the speed to drive."""

from pilot.model.networks.pilotnet_standardised import StandardisedPilotNet
from pilot.signature import Signature


class SpeedPilotNet(StandardisedPilotNet):
    """The standardised PilotNet with a second output, the speed to be reached within a second, 260,050 parameters.

    The car brakes before bends instead of in them, and accelerates as soon as the road is seen to be straight.
    """

    signature = Signature(speed=True)


NETWORK = SpeedPilotNet
