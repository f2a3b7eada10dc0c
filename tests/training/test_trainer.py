import math
from concurrent.futures import Future
from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
import torch
from conftest import write_recording
from torch import nn

from pilot.data.augment import AugmentConfig
from pilot.data.batches import Batch, MicroBatch
from pilot.data.driving_log import read_driving_logs
from pilot.data.samples import SampleConfig, make_samples
from pilot.driving.plan import SteeringPolicy, as_plan
from pilot.model.build import build_network
from pilot.model.checkpoint import Model, UnusableModel, save_model
from pilot.model.networks.pilotnet import PilotNet
from pilot.training.config import TrainingConfig, config_from_jsonable
from pilot.training.devices import choose_device, micro_batches_of
from pilot.training.optimisation import learning_rate, losses
from pilot.training.trainer import Training

CONFIG = TrainingConfig(network="pilotnet", epochs=3, batch_size=32, samples=SampleConfig(block_seconds=1))


def quiet(batches: object, _count: int, _title: str) -> object:
    return batches


@pytest.fixture(scope="module")
def samples(tmp_path_factory: pytest.TempPathFactory) -> tuple[pd.DataFrame, pd.DataFrame]:
    folder = write_recording(tmp_path_factory.mktemp("recordings") / "laps", moments=100)
    return make_samples(read_driving_logs([folder]).rows, CONFIG.samples, seed=0)


@pytest.fixture(scope="module")
def uninterrupted(samples: tuple[pd.DataFrame, pd.DataFrame]) -> Training:
    """A training that was never interrupted."""
    return trained(samples)


def trained(samples: tuple[pd.DataFrame, pd.DataFrame], config: TrainingConfig = CONFIG, **run: object) -> Training:
    training = Training(config, *samples)
    training.run(lambda _: None, quiet, **run)
    return training


def weights(training: Training) -> torch.Tensor:
    return torch.cat([value.flatten() for value in training.network.state_dict().values()])


def test_learns_to_steer(samples: tuple[pd.DataFrame, pd.DataFrame]) -> None:
    config = replace(CONFIG, epochs=6, learning_rate=2e-3, augment=AugmentConfig(viewpoint=0, shadow=0, brightness=0))
    training = trained(samples, config)
    assert training.history[training.best["epoch"] - 1]["validation_r2"] > 0.8


def test_same_seed_same_result(samples: tuple[pd.DataFrame, pd.DataFrame]) -> None:
    first, second, other = (trained(samples, replace(CONFIG, epochs=1, seed=seed)) for seed in (1, 1, 2))
    assert torch.equal(weights(first), weights(second))
    assert not torch.equal(weights(first), weights(other))


@pytest.mark.parametrize("stop_after", [2, 8, 9])
def test_an_interrupted_training_goes_on_to_the_same_result(
    samples: tuple[pd.DataFrame, pd.DataFrame], uninterrupted: Training, tmp_path: Path, stop_after: int
) -> None:
    interrupt_and_resume(samples, uninterrupted, tmp_path / "state.pt", stop_after)


def interrupt_and_resume(
    samples: tuple[pd.DataFrame, pd.DataFrame], uninterrupted: Training, state: Path, stop_after: int
) -> None:
    steps = 0

    def interrupted(batches: object, _count: int, _title: str) -> object:
        nonlocal steps
        for batch in batches:
            yield batch
            steps += 1
            if steps == stop_after:
                signal_self()

    with pytest.raises(KeyboardInterrupt):
        Training(CONFIG, *samples).run(lambda _: None, interrupted, state)
    resumed = Training(CONFIG, *samples)
    resumed.restore(torch.load(state, weights_only=True))
    assert resumed.epoch * 8 + resumed.step < 3 * 8
    resumed.run(lambda _: None, quiet)
    assert torch.equal(weights(resumed), weights(uninterrupted))
    for before, after in zip(uninterrupted.history, resumed.history, strict=True):
        assert {**before, "images_per_second": 0} == {**after, "images_per_second": 0}
    assert resumed.best["epoch"] == uninterrupted.best["epoch"]


class WithDropout(PilotNet):
    def __init__(self) -> None:
        super().__init__()
        self.layers.insert(11, nn.Dropout(0.5))


@pytest.mark.parametrize("stop_after", [2, 9])
def test_dropout_draws_the_same_however_often_a_training_is_interrupted(
    samples: tuple[pd.DataFrame, pd.DataFrame], tmp_path: Path, stop_after: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("pilot.training.trainer.build_network", lambda _name, _seed: seeded(WithDropout))
    before = torch.random.get_rng_state()
    interrupt_and_resume(samples, trained(samples), tmp_path / "state.pt", stop_after)
    assert torch.equal(torch.random.get_rng_state(), before)  # of the program around the training


def seeded(network: type[nn.Module]) -> nn.Module:
    with torch.random.fork_rng(devices=[]):
        torch.manual_seed(0)
        return network()


def test_driving_checks_are_counted_where_float64_is_known(samples: tuple[pd.DataFrame, pd.DataFrame]) -> None:
    """Apple's GPUs have no float64: the figures must not go there. `meta` stands for such a device."""
    training = Training(replace(CONFIG, select="driving"), *samples, driving_check=lambda _: (1, 0.25))
    training.history.append({})
    training.device = torch.device("meta")
    training._check_driving()
    assert training.history[-1] == {"interventions": 1, "cross_track_error": 0.25}


def signal_self() -> None:
    import signal

    signal.raise_signal(signal.SIGINT)


def test_a_state_of_other_data_is_refused(samples: tuple[pd.DataFrame, pd.DataFrame]) -> None:
    state = Training(CONFIG, *samples).state()
    other = Training(CONFIG, samples[0].assign(steering=0.0), samples[1])
    with pytest.raises(UnusableModel, match="recordings have changed"):
        other.restore(state)


def test_stops_early_and_keeps_the_best_epoch(
    samples: tuple[pd.DataFrame, pd.DataFrame], monkeypatch: pytest.MonkeyPatch
) -> None:
    errors = iter([0.5, 0.3, 0.299995, 0.4, 0.6, 0.1])
    kept: list[torch.Tensor] = []
    training = Training(replace(CONFIG, epochs=6, patience=3, min_delta=1e-5), *samples)
    real = training.validate

    def fake() -> object:
        kept.append(weights(training).clone())
        return replace(real(), mse=next(errors))

    monkeypatch.setattr(training, "validate", fake)
    training.run(lambda _: None, quiet)
    assert training.epoch == 5
    assert training.best["epoch"] == 2
    training.load_weights_of(training.best)
    assert torch.equal(weights(training), kept[1])


def test_starts_from_a_model(samples: tuple[pd.DataFrame, pd.DataFrame], tmp_path: Path) -> None:
    first = trained(samples)
    path = tmp_path / "first.pt"
    save_model(path, Model(CONFIG.network, first.network, {}, {}, {}))
    begun = Training(replace(CONFIG, start=path), *samples)
    assert torch.equal(weights(begun), weights(first))
    with pytest.raises(UnusableModel, match="is a pilotnet; start from it with --network pilotnet"):
        Training(replace(CONFIG, start=path, network="nvidia"), *samples)


def test_the_finished_weights_are_the_average_with_the_model_it_started_from(
    samples: tuple[pd.DataFrame, pd.DataFrame], tmp_path: Path
) -> None:
    path = tmp_path / "first.pt"
    save_model(path, Model(CONFIG.network, build_network(CONFIG.network, seed=5), {}, {}, {}))
    found = {}
    for share in (0.0, 0.25, 1.0):
        training = trained(samples, replace(CONFIG, epochs=1, select="last", start=path, start_share=share))
        training.load_weights_of(training.chosen)
        found[share] = weights(training)
    torch.testing.assert_close(found[0.25], 0.75 * found[0.0] + 0.25 * found[1.0])
    assert torch.equal(found[1.0], weights(Training(replace(CONFIG, start=path), *samples)))
    assert not torch.allclose(found[0.0], found[1.0], atol=1e-3)


def test_keeps_the_epoch_that_drives_best_beside_that_of_the_lowest_error(
    samples: tuple[pd.DataFrame, pd.DataFrame],
) -> None:
    drives = iter([(1, 0.2), (0, 0.4), (0, 0.3), (2, 0.1)])  # fewer interventions first, then the smaller offset
    kept: list[torch.Tensor] = []

    def check(policy: SteeringPolicy) -> tuple[int, float]:
        assert -1 <= as_plan(policy(np.full((160, 320, 3), 90, np.uint8))).steering[0] <= 1
        kept.append(weights(training).clone())
        return next(drives)

    training = Training(replace(CONFIG, epochs=4, select="driving"), *samples, driving_check=check)
    training.run(lambda _: None, quiet)
    assert training.chosen is training.best_driving
    assert training.best_driving["epoch"] == 3
    assert training.best_driving["error"] == (0, 0.3)
    assert [epoch["interventions"] for epoch in training.history] == [1, 0, 0, 2]
    training.load_weights_of(training.chosen)
    assert torch.equal(weights(training), kept[2])
    training.load_weights_of(training.best)
    assert training.validate().mse == pytest.approx(training.best["error"])


def test_keeps_the_last_epoch_if_asked_for(samples: tuple[pd.DataFrame, pd.DataFrame]) -> None:
    training = Training(replace(CONFIG, select="last", min_delta=10), *samples)  # no epoch improves on the first
    training.run(lambda _: None, quiet)
    last, chosen = weights(training).clone(), training.chosen
    assert (training.best["epoch"], chosen["epoch"]) == (1, 3)
    training.load_weights_of(training.best)
    assert not torch.equal(weights(training), last)
    training.load_weights_of(chosen)
    assert torch.equal(weights(training), last)


def test_l2_is_the_penalty_added_to_the_loss(samples: tuple[pd.DataFrame, pd.DataFrame]) -> None:
    """One Adam step with `l2` equals one on loss + l2 * sum of squares of all weights and biases."""
    config = replace(CONFIG, l2=0.01)
    ours, reference = Training(config, *samples), Training(replace(config, l2=0.0), *samples)
    micro_batch = whole(ours)
    next(ours.steps([Batch(32, [lambda: micro_batch])]))
    loss = ((reference.network(micro_batch.frames) - micro_batch.labels[:, 0]) ** 2).mean()
    (loss + 0.01 * sum(p.square().sum() for p in reference.network.parameters())).backward()
    reference.optimiser.step()
    torch.testing.assert_close(weights(ours), weights(reference), atol=1e-5, rtol=1e-4)


def test_weights_of_samples_count_in_the_loss(samples: tuple[pd.DataFrame, pd.DataFrame]) -> None:
    training, other = Training(CONFIG, *samples), Training(CONFIG, *samples)
    micro_batch = whole(training)
    next(training.steps([Batch(32, [lambda: micro_batch])]))
    next(other.steps([Batch(32, [lambda: replace(micro_batch, weight=torch.linspace(0, 2, 32))])]))
    assert not torch.equal(weights(training), weights(other))


def test_an_unreadable_picture_does_not_end_the_training(
    samples: tuple[pd.DataFrame, pd.DataFrame], tmp_path: Path
) -> None:
    (tmp_path / "empty.jpg").touch()
    damaged = samples[0].copy(), samples[1].copy()
    damaged[0].loc[0, "image"] = str(tmp_path / "missing.jpg")
    damaged[1].loc[0, "image"] = str(tmp_path / "empty.jpg")
    training = trained(damaged, replace(CONFIG, epochs=1))
    assert np.isfinite(training.history[0]["validation_mse"])
    assert len(training.loader.unreadable) == 1


def test_a_training_that_diverges_says_so(samples: tuple[pd.DataFrame, pd.DataFrame]) -> None:
    with pytest.raises(ValueError, match="diverged in epoch 1.*smaller --learning-rate than 1e"):
        trained(samples, replace(CONFIG, learning_rate=1e30))


def test_a_network_that_steers_the_same_for_all_pictures_is_dead(samples: tuple[pd.DataFrame, pd.DataFrame]) -> None:
    training = Training(CONFIG, *samples)
    for parameter in training.parameters:
        parameter.data.zero_()
    with pytest.raises(ValueError, match="the network collapsed in epoch 1: .*Try another --seed"):
        training.validate()


def test_the_learning_rate_warms_up_over_epochs(samples: tuple[pd.DataFrame, pd.DataFrame]) -> None:
    steps = math.ceil(len(samples[0]) / CONFIG.batch_size)
    config = replace(CONFIG, schedule="constant", epochs=3, warm_up=2 * steps, learning_rate=0.5e-3)
    training = Training(config, *samples)
    rates: list[float] = []
    training.optimiser.register_step_pre_hook(lambda adam, *_: rates.append(adam.param_groups[0]["lr"]))
    for epoch in range(3):
        for _ in training.steps(training.loader.epoch(epoch)):
            pass
        training._end_epoch(1.0)
    rising, after = rates[: 2 * steps], rates[2 * steps :]
    assert rising == pytest.approx([0.5e-3 * (step + 1) / (2 * steps) for step in range(2 * steps)])
    assert after == pytest.approx([0.5e-3] * steps)


def test_huber_counts_large_errors_less() -> None:
    config = replace(CONFIG, loss="huber", huber_delta=0.1)
    small, large = losses(torch.tensor([[0.01], [1.0]]), torch.zeros(2, 1), config).tolist()
    assert small == pytest.approx(0.01**2 / 2)
    assert large == pytest.approx(0.1 * (1.0 - 0.05))


def test_learning_rate_schedules() -> None:
    assert learning_rate(replace(CONFIG, schedule="constant"), 2) == CONFIG.learning_rate
    cosine = replace(CONFIG, schedule="cosine", epochs=10)
    rates = [learning_rate(cosine, epoch) for epoch in range(10)]
    assert rates[0] == CONFIG.learning_rate
    assert rates == sorted(rates, reverse=True)
    assert 0 < rates[-1] < 0.05 * CONFIG.learning_rate


def test_an_absent_device_is_an_error_that_names_those_there_are() -> None:
    with pytest.raises(ValueError, match="--device vulkan: not on this machine; here are: auto, cpu"):
        choose_device("vulkan")


def test_parts_add_up_to_the_whole_batch(samples: tuple[pd.DataFrame, pd.DataFrame]) -> None:
    training = Training(CONFIG, *samples)
    micro_batch = whole(training)
    halves = [
        replace(
            micro_batch,
            frames=micro_batch.frames[half],
            labels=micro_batch.labels[half],
            weight=micro_batch.weight[half],
            index=micro_batch.index[half],
        )
        for half in (slice(0, 20), slice(20, 32))
    ]
    together, error = training.gradients(read(micro_batch), 32)
    (first, first_error), (second, second_error) = (training.gradients(read(half), 32) for half in halves)
    for a, b, both in zip(first, second, together, strict=True):
        torch.testing.assert_close(a + b, both, atol=1e-6, rtol=1e-3)
    torch.testing.assert_close(first_error + second_error, error)


def read(micro_batch: MicroBatch) -> Future[MicroBatch]:
    future: Future[MicroBatch] = Future()
    future.set_result(micro_batch)
    return future


def whole(training: Training) -> MicroBatch:
    """The first batch of a training, as one micro-batch."""
    micro_batches = [micro_batch() for micro_batch in next(training.loader.epoch(0)).micro_batches]
    names = ("frames", "labels", "weight")
    return MicroBatch(
        *(torch.cat([getattr(micro_batch, name) for micro_batch in micro_batches]) for name in names),
        index=np.concatenate([micro_batch.index for micro_batch in micro_batches]),
    )


@pytest.mark.parametrize(
    ("network", "device", "batch_size", "micro_batches"),
    [
        ("pilotnet", "cpu", 64, 2),
        ("pilotnet", "cpu", 24, 1),
        ("pilotnet", "cuda", 64, 1),
        ("densenet", "cpu", 64, 1),  # normalises over the whole batch
    ],
)
def test_a_batch_is_divided_among_the_cores(
    network: str, device: str, batch_size: int, micro_batches: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("pilot.training.devices.CORES", 2)
    assert micro_batches_of(build_network(network), torch.device(device), batch_size) == micro_batches


def test_a_training_on_a_gpu_is_the_same_but_for_rounding(samples: tuple[pd.DataFrame, pd.DataFrame]) -> None:
    """What is done for a GPU, done by the CPU: batches read ahead, augmented by the device.

    In one step, because Adam's first steps turn rounding errors of small gradients into steps of full size.
    """
    config = replace(CONFIG, epochs=1, batch_size=len(samples[0]))
    on_cpu, on_device = trained(samples, config), Training(config, *samples)
    on_device.loader.for_gpu, on_device.loader.micro_batches = True, 1
    on_device.run(lambda _: None, quiet)
    assert on_device.history[0]["training_mse"] == pytest.approx(on_cpu.history[0]["training_mse"], rel=0.002)


def test_configurations_survive_as_plain_values() -> None:
    from pilot.model.checkpoint import to_jsonable

    config = replace(CONFIG, data=(Path("a"), Path("b")), augment=AugmentConfig(crop_top=(0.1, 0.2)))
    assert config_from_jsonable(to_jsonable(config)) == config
