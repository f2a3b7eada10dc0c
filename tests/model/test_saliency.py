import numpy as np
import pytest
from conftest import picture

from pilot.model.build import build_network
from pilot.model.networks import network_names
from pilot.model.saliency import overlay, saliency


@pytest.mark.parametrize("name", network_names())
def test_relevance_is_where_the_network_looks(name: str) -> None:
    network = build_network(name, 1).eval()
    relevance = saliency(network, picture(0.2))
    assert relevance.shape == (160, 320)
    assert relevance.dtype == np.float32
    assert relevance.min() >= 0
    assert relevance.max() == pytest.approx(1)
    assert (relevance[: network.rows[0]] == 0).all()
    assert (relevance[network.rows[1] :] == 0).all()


def test_the_only_thing_on_the_road_stands_out() -> None:
    """Edges of the post are more relevant than the empty road, even to an untrained network."""
    relevance = saliency(build_network("nvidia", 1).eval(), picture(0.0))
    assert relevance[75:128, 140:180].mean() > 2 * relevance[75:128, 30:90].mean()


def test_hooks_are_taken_away_again() -> None:
    network = build_network("nvidia", 1).eval()
    saliency(network, picture(0))
    assert not any(layer._forward_hooks for layer in network.modules())


def test_the_overlay_glows_green() -> None:
    frame = picture(0)
    relevance = np.zeros((160, 320), np.float32)
    relevance[100, 100] = 1
    glowing = overlay(frame, relevance).astype(int)
    assert glowing[100, 100, 1] > glowing[100, 100, 0] + 50
    assert (glowing[10, 10] <= frame[10, 10]).all()
