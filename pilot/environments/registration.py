"""Registration of the environments with Gymnasium.

Gymnasium 1.0 removed the entry points by which installed packages were found: the package has to be imported, or be
named in the id, as in `gymnasium.make("pilot.environments:pilot/Lake-v0")`.
"""

import gymnasium

from pilot.environments.options import RANDOM
from pilot.simulator.catalogue import track_names

VERSION = 0  # to be raised with every change of observations, rewards or ends of episodes
ENTRY_POINT = "pilot.environments.driving_env:DrivingEnv"


def environment_ids() -> dict[str, str]:
    """Return the track of each environment by its id, such as pilot/Lake-v0: all named tracks, and random roads."""
    return {f"pilot/{track.capitalize()}-v{VERSION}": track for track in (*track_names(), RANDOM)}


def register_environments() -> None:
    """Register the environments; to be called once."""
    for name, track in environment_ids().items():
        gymnasium.register(name, entry_point=ENTRY_POINT, kwargs={"track": track})
