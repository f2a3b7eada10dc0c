"""A PilotNet that plans the next half second: the steering, and the speed to drive."""

from pilot.model.networks.pilotnet_ahead import AheadPilotNet
from pilot.model.networks.pilotnet_standardised import StandardisedPilotNet
from pilot.signature import Signature


class PlanPilotNet(StandardisedPilotNet):
    """`pilotnet_ahead` and `pilotnet_speed` in one, 260,105 parameters."""

    signature = Signature(horizons=AheadPilotNet.signature.horizons, speed=True)


NETWORK = PlanPilotNet
