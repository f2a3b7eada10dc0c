"""Registry of the networks: each is a module of this package, named like the network, that sets NETWORK to its class.

All networks take frames as the simulator sends them, N x 160 x 320 x 3, uint8 RGB, and return the steering, N, float32.
The names are available without importing PyTorch, because the command lines list them.
"""

import importlib
import pkgutil
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from pilot.model.steering_network import SteeringNetwork


def network_names() -> list[str]:
    """Return the names of all networks in alphabetical order."""
    return sorted(module.name for module in pkgutil.iter_modules(__path__) if not module.name.startswith("_"))


def network_class(name: str) -> "type[SteeringNetwork]":
    """Return the class of a network.

    Raises:
        ValueError: there is no network of this name.
    """
    if name not in network_names():
        raise ValueError(f"no network is called {name!r}; there are: {', '.join(network_names())}")
    network: type[SteeringNetwork] = importlib.import_module(f"{__name__}.{name}").NETWORK
    return network
