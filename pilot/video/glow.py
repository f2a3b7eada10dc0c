"""Saliency for clips, drawn in several threads."""

import copy
import threading
from collections.abc import Sequence

from pilot.arrays import Frame
from pilot.model.saliency import overlay, saliency_of_all
from pilot.model.steering_network import SteeringNetwork


class Glow:
    """Draws the saliency of a network into frames; each thread has a copy of the network, which the saliency hooks."""

    def __init__(self, network: SteeringNetwork) -> None:
        """Create it for a network in evaluation mode."""
        self._network = network
        self._own = threading.local()

    def __call__(self, frames: Sequence[Frame]) -> list[Frame]:
        """Return the frames (160x320x3, uint8 RGB) with relevant pixels highlighted in green."""
        if not hasattr(self._own, "network"):
            self._own.network = copy.deepcopy(self._network)
        relevances = saliency_of_all(self._own.network, frames)
        return [overlay(frame, relevance) for frame, relevance in zip(frames, relevances, strict=True)]
