import pytest
import torch
from conftest import random_frames
from torch import nn

from pilot.model.build import build_network, count_parameters
from pilot.model.inference import fast_predict, fold_dense
from pilot.model.networks import network_names
from pilot.model.networks.pilotnet import PilotNet
from pilot.model.steering_network import SteeringNetwork

COUNTS = {
    "nvidia": 2_712_951,
    "pilotnet": 252_219,
    "pilotnet_standardised": 260_039,
    "pilotnet_speed": 260_050,
    "pilotnet_ahead": 260_094,
    "pilotnet_plan": 260_105,
    "pilotnet_history": 261_239,
    "lenet": 723_091,
    "simplenet": 183_683,
    "densenet": 187_469,
}


@pytest.mark.parametrize(("name", "count"), COUNTS.items())
def test_parameter_counts_are_the_documents(name: str, count: int) -> None:
    assert count_parameters(build_network(name)) == count


def test_densenet_without_batch_norm_is_the_documents() -> None:
    assert count_parameters(build_network("densenet"), [nn.Conv2d, nn.Linear]) == 185_789


@pytest.mark.parametrize("name", network_names())
def test_takes_raw_frames_and_returns_one_steering_each(name: str) -> None:
    network = build_network(name, seed=1).eval()
    frames = random_frames(network)
    with torch.inference_mode():
        together, alone = network(frames), network(frames[1:])
    assert together.shape == (2,)
    assert together.dtype == torch.float32
    torch.testing.assert_close(together[1:], alone, atol=1e-5, rtol=1e-4)


@pytest.mark.parametrize("name", network_names())
def test_sky_and_bonnet_do_not_matter_but_colours_do(name: str) -> None:
    network = build_network(name, seed=1).eval()
    frames = random_frames(network, 1)
    elsewhere = frames.clone()
    elsewhere[..., : network.rows[0], :, :] = 0
    elsewhere[..., network.rows[1] :, :, :] = 255
    with torch.inference_mode():
        assert torch.equal(network(frames), network(elsewhere))
        assert not torch.equal(network(frames), network(frames.flip(-1)))


def test_nvidia_layers_have_the_documents_shapes() -> None:
    network = build_network("nvidia")
    shapes = []
    maps = network.prepare(torch.zeros(1, 3, 65, 320))
    for layer in network.layers:
        maps = layer(maps)
        if isinstance(layer, nn.Conv2d | nn.Flatten):
            shapes.append(tuple(maps.shape[1:]))
    assert shapes == [(24, 31, 158), (36, 14, 77), (48, 5, 37), (64, 3, 35), (64, 1, 33), (2112,)]


def test_simplenet_standardises_each_picture() -> None:
    pixels = build_network("simplenet").prepare(torch.rand(2, 3, 76, 320) * 100 + 50)
    assert pixels.shape == (2, 3, 128, 128)
    torch.testing.assert_close(pixels.mean((1, 2, 3)), torch.zeros(2), atol=1e-4, rtol=0)
    torch.testing.assert_close(pixels.std((1, 2, 3)), torch.ones(2), atol=1e-3, rtol=0)
    assert torch.isfinite(build_network("simplenet").prepare(torch.full((1, 3, 76, 320), 7.0))).all()


def test_standardised_pilotnet_ignores_exposure_and_contrast() -> None:
    network = build_network("pilotnet_standardised", 1).eval()
    squares = torch.randint(100, 156, (2, 10, 20, 3), dtype=torch.uint8, generator=torch.Generator().manual_seed(0))
    # squares of 16 pixels: single pixels' noise averages out when resized, and what remains is mostly rounding
    frames = squares.repeat_interleave(16, 1).repeat_interleave(16, 2)
    brighter, stronger = frames + 60, (frames - 100) * 4 + 10
    with torch.inference_mode():
        torch.testing.assert_close(network(brighter), network(frames), atol=1e-4, rtol=0)
        torch.testing.assert_close(network(stronger), network(frames), atol=0.002, rtol=0)
        assert torch.isfinite(network(torch.zeros_like(frames))).all()


def test_same_seed_same_weights() -> None:
    first, second, other = (build_network("pilotnet", seed).state_dict() for seed in (1, 1, 2))
    assert all(torch.equal(first[key], second[key]) for key in first)
    assert not torch.equal(first["layers.0.weight"], other["layers.0.weight"])


def test_unknown_network_names_those_there_are() -> None:
    with pytest.raises(ValueError, match="'alexnet'; there are: .*nvidia, pilotnet"):
        build_network("alexnet")


@pytest.mark.parametrize(("name", "dense"), [("nvidia", 1), ("lenet", 1), ("pilotnet", 4), ("densenet", 1)])
def test_dense_layers_in_a_row_are_folded_into_one_for_driving(name: str, dense: int) -> None:
    network = build_network(name, 0).eval()
    folded = fold_dense(network)
    frames = torch.randint(0, 256, (2, 160, 320, 3), dtype=torch.uint8)
    with torch.inference_mode():
        torch.testing.assert_close(folded(frames), network(frames), atol=1e-6, rtol=1e-4)
    assert sum(isinstance(layer, nn.Linear) for layer in folded.modules()) == dense


class Residual(nn.Sequential):
    """Two dense layers with a way round the second: joined as a sequence they would be another network."""

    def forward(self, maps: torch.Tensor) -> torch.Tensor:
        hidden = self[1](self[0](maps))
        return self[3](hidden + self[2](hidden))


def test_folding_leaves_layers_alone_that_have_a_forward_of_their_own() -> None:
    network = build_network("pilotnet", 1).eval()
    network.layers = Residual(nn.Flatten(), nn.Linear(3 * 66 * 200, 8), nn.Linear(8, 8), nn.Linear(8, 1))
    frames = torch.randint(0, 256, (2, 160, 320, 3), dtype=torch.uint8)
    with torch.inference_mode():
        assert torch.equal(fold_dense(network)(frames), network(frames))


def test_dense_layers_without_bias_are_left_alone() -> None:
    network = build_network("pilotnet", 1).eval()
    network.layers = nn.Sequential(nn.Flatten(), nn.Linear(3 * 66 * 200, 8, bias=False), nn.Linear(8, 1))
    frames = torch.randint(0, 256, (2, 160, 320, 3), dtype=torch.uint8)
    with torch.inference_mode():
        torch.testing.assert_close(fast_predict(network)(frames), network.predict(frames))


@pytest.mark.parametrize("name", network_names())
def test_the_fast_predict_of_driving_steers_the_same(name: str) -> None:
    network = build_network(name, 3).eval()
    frames = random_frames(network)
    with torch.inference_mode():
        torch.testing.assert_close(fast_predict(network)(frames), network.predict(frames), atol=1e-5, rtol=1e-4)


class Gamma(PilotNet):
    """Normalises in a way that no convolution can do."""

    def normalise(self, pixels: torch.Tensor) -> torch.Tensor:
        return super().normalise(pixels).abs().sqrt()


class OwnPreparation(PilotNet):
    def prepare(self, pixels: torch.Tensor) -> torch.Tensor:
        return super().prepare(pixels.flip(1))


@pytest.mark.parametrize("kind", [Gamma, OwnPreparation])
def test_a_preparation_of_another_kind_is_not_folded_away(kind: type[PilotNet]) -> None:
    network = kind().eval()
    frames = torch.randint(0, 256, (2, 160, 320, 3), dtype=torch.uint8)
    with torch.inference_mode():
        torch.testing.assert_close(fast_predict(network)(frames), network.predict(frames), atol=1e-5, rtol=1e-4)


@pytest.mark.parametrize("name", network_names())
def test_the_steering_depends_only_on_the_rows_that_the_network_names(name: str) -> None:
    network = build_network(name, 0).eval()
    first, last = network.seen_rows
    frame = random_frames(network, 1)
    other = torch.zeros_like(frame)
    other[..., first:last, :, :] = frame[..., first:last, :, :]
    with torch.inference_mode():
        assert torch.equal(network(frame), network(other))


def test_a_network_that_crops_in_its_own_way_sees_the_whole_frame() -> None:
    class Whole(SteeringNetwork):
        def crop(self, frames: torch.Tensor) -> torch.Tensor:
            return frames.permute(0, 3, 1, 2)

    assert Whole().seen_rows == (0, 160)
