"""A PilotNet that sees how the picture moves."""

from pilot.model.networks.pilotnet_standardised import StandardisedPilotNet
from pilot.signature import Signature


class HistoryPilotNet(StandardisedPilotNet):
    """The standardised PilotNet on the present frame and that of 0.2 s before, stacked as channels."""

    signature = Signature(history=(0.2,))


NETWORK = HistoryPilotNet
