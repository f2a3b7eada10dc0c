"""The networks by name: each is a file of this folder, named as the network is, that sets NETWORK to its class.

Every network takes frames as the simulator sends them, uint8 RGB of shape N x 160 x 320 x 3, and returns the steering,
float32 of shape N (-1..1). Names are known without importing torch: command lines list them.
"""

import importlib
import pkgutil
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from pilot.model.steering_network import SteeringNetwork


def network_names() -> list[str]:
    """All networks, in the order of the alphabet."""
    return sorted(module.name for module in pkgutil.iter_modules(__path__) if not module.name.startswith("_"))


def network_class(name: str) -> "type[SteeringNetwork]":
    """The class of a network.

    Raises:
        ValueError: there is no network of this name.
    """
    if name not in network_names():
        raise ValueError(f"no network is called {name!r}; there are: {', '.join(network_names())}")
    network: type[SteeringNetwork] = importlib.import_module(f"{__name__}.{name}").NETWORK
    return network
