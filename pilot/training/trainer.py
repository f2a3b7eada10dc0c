"""Train a network on samples: epochs with early stopping, interruptible and resumable.

A `Training` holds all that changes while it runs; `state()` is written to disk regularly, and a
training that goes on from there ends with exactly the weights of one that was never interrupted.
"""

import contextlib
import copy
import functools
import hashlib
import math
import time
from collections.abc import Callable, Iterable, Iterator, Sequence
from concurrent.futures import Future
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import torch
from numpy.typing import NDArray
from torch import Tensor
from torch.optim.lr_scheduler import LambdaLR

from pilot.arrays import Frame
from pilot.data.batches import Batch, BatchLoader, MicroBatch
from pilot.data.device_augment import augment
from pilot.data.frame_cache import FrameCache
from pilot.driving.driver import DrivingCheck
from pilot.files import write_atomically
from pilot.interrupt import Interrupt, catch_interrupt
from pilot.model.build import build_network
from pilot.model.checkpoint import UnusableModel, load_model, to_jsonable
from pilot.model.steering_network import SteeringNetwork
from pilot.progress import ProgressBar
from pilot.training.config import TrainingConfig
from pilot.training.devices import CoreThreads, autocast, choose_device, draws_at_random, micro_batches_of
from pilot.training.distributed import Processes
from pilot.training.metrics import Agreement, agreement
from pilot.training.optimisation import learning_rate, losses, make_optimiser, make_scheduler

SAVE_SECONDS = 120  # a power cut costs at most this much work


class Training:
    """One training: network, optimiser, position, best epoch and history.

    Attributes:
        network: the network being trained.
        epoch, step: how many epochs, and batches of the running one, are done.
        history: one dictionary an epoch: errors, learning rate, images/s.
        best: the lowest validation error so far with its epoch and weights.
        best_driving: the same of the best drive so far, if there is a driving check.
    """

    def __init__(
        self,
        config: TrainingConfig,
        training: pd.DataFrame,
        validation: pd.DataFrame,
        *,
        processes: Processes | None = None,
        driving_check: DrivingCheck | None = None,
        cache: FrameCache | None = None,
    ) -> None:
        """Set up the network of `config` for these samples.

        Args:
            config: all options.
            training, validation: samples.
            processes: that train together.
            driving_check: judges each epoch, where `config.select` asks for it; of the process that leads.
            cache: reads the frames.
        """
        self.config, self.driving_check = config, driving_check
        self.processes = processes or Processes()
        self.device = choose_device(config.device, self.processes.local_rank)
        self.network = first_network(config).to(self.device)
        self.parameters = list(self.network.parameters())
        self.optimiser = make_optimiser(self.parameters, config, self.device)
        self.training, self.validation = training, validation
        self.training_mean = float(np.average(training["steering"], weights=training["weight"]))
        self.cache = cache or FrameCache()
        share = self.config.batch_size // self.processes.world_size
        self.micro_batches = micro_batches_of(self.network, self.device, share)
        self.draws_at_random = draws_at_random(self.network)
        self.cores = CoreThreads(self.micro_batches)
        self.loader = self._loader(training, augment=True)
        self.epoch = self.step = 0
        self.scheduler = self._scheduler()
        self.error_sum = torch.zeros((), device=self.device)
        self.history: list[dict[str, float]] = []
        self.best: dict[str, Any] = {"error": math.inf, "epoch": 0, "weights": {}}
        self.best_driving: dict[str, Any] = {"error": (math.inf, math.inf), "epoch": 0, "weights": {}}
        self._saved = time.monotonic()

    # Running

    def run(
        self, on_epoch: Callable[[dict[str, float]], None], progress: ProgressBar[Batch], state_file: Path | None = None
    ) -> None:
        """Train until early stopping or the last epoch.

        Args:
            on_epoch: called with each epoch's figures.
            progress: wraps the batches of an epoch (called with them, the number of pictures and a title).
            state_file: where to keep what `restore` needs; also written on Ctrl-C.

        Raises:
            KeyboardInterrupt: on Ctrl-C, after the running step.
        """
        with catch_interrupt() as interrupt:
            while not self.finished:
                self._train_epoch(self._batches(progress), state_file, interrupt)
                on_epoch(self.history[-1])
                self._save(state_file)

    @property
    def finished(self) -> bool:
        """Whether early stopping or the number of epochs ends the training."""
        return self.epoch >= self.config.epochs or self.epoch - self.best["epoch"] >= self.config.patience

    def _batches(self, progress: ProgressBar[Batch]) -> Iterable[Batch]:
        batches = self.loader.epoch(self.epoch, self.step)
        left = max(len(self.training) - self.step * self.config.batch_size, 0)
        return progress(batches, left, f"epoch {self.epoch + 1}/{self.config.epochs}")

    def _train_epoch(self, batches: Iterable[Batch], state_file: Path | None, interrupt: Interrupt) -> None:
        self.network.train()
        began, images = time.perf_counter(), 0
        for size in self.steps(batches):
            images += size
            if interrupt.asked or time.monotonic() - self._saved > SAVE_SECONDS:
                self._save(state_file)
            if interrupt.asked:
                raise KeyboardInterrupt
        self._end_epoch(images / (time.perf_counter() - began))

    def steps(self, batches: Iterable[Batch]) -> Iterator[int]:
        """Train on batches, each of which is read when the cores have done their part of the one before.

        Yields:
            the number of samples, over all processes, after each step.
        """
        source = iter(batches)
        read = self._read(next(source, None))
        while read:
            size, micro_batches = read
            work = self.cores.start(functools.partial(self.gradients, size=size), micro_batches)
            read = self._read(next(source, None))
            self._step([done.result() for done in work])
            yield size

    def _read(self, batch: Batch | None) -> tuple[int, list[Future[MicroBatch]]] | None:
        return (batch.size, self.cores.start(lambda micro_batch: micro_batch(), batch.micro_batches)) if batch else None

    def _step(self, micro_batches: Sequence[tuple[Sequence[Tensor], Tensor]]) -> None:
        """Adam's step by the sum of the parts' gradients; the mean loss is that over the batch of all processes."""
        for parameter, *gradients in zip(self.parameters, *(gradients for gradients, _ in micro_batches), strict=True):
            parameter.grad = functools.reduce(Tensor.add_, gradients)
        self.processes.sum_gradients(self.parameters)
        self.optimiser.step()
        self.scheduler.step()
        self.error_sum += torch.stack([errors for _, errors in micro_batches]).sum()
        self.step += 1

    def gradients(self, reading: Future[MicroBatch], size: int) -> tuple[Sequence[Tensor], Tensor]:
        """What a part adds to the gradients of the mean loss of `size` samples; its sum of squared errors."""
        micro_batch = reading.result()
        if not len(micro_batch.index):
            return [torch.zeros_like(parameter) for parameter in self.parameters], torch.zeros((), device=self.device)
        steering, weight = micro_batch.steering.to(self.device), micro_batch.weight.to(self.device)
        with self._repeatable_draws(), autocast(self.device):
            predicted = self.network(self._frames(micro_batch)).float()
        loss = (weight * losses(predicted, steering, self.config)).sum() / size
        return torch.autograd.grad(loss, self.parameters), (predicted.detach() - steering).square().sum()

    @contextlib.contextmanager
    def _repeatable_draws(self) -> Iterator[None]:
        """Have dropout draw by seed, epoch, step and process alone, so that a resumed training draws the same."""
        if not self.draws_at_random:
            yield
            return
        numbers = np.random.SeedSequence([self.config.seed, self.epoch, self.step, self.processes.rank])
        with torch.random.fork_rng([self.device] if self.device.type == "cuda" else []):
            torch.manual_seed(int(numbers.generate_state(1)[0]))
            yield

    def _frames(self, micro_batch: MicroBatch) -> Tensor:
        """The frames of a part on the device, augmented."""
        frames = micro_batch.frames.to(self.device, non_blocking=True)
        return augment(frames, micro_batch.draws.to(self.device), self.network.rows) if micro_batch.draws else frames

    def _end_epoch(self, images_per_second: float) -> None:
        self.processes.average_statistics(self.network)
        validation = self.validate()
        training_mse = self.processes.sum(self.error_sum.clone()).item() / len(self.training)
        self.history.append(
            {
                "epoch": self.epoch + 1,
                "training_mse": training_mse,
                "validation_mse": validation.mse,
                "validation_r2": validation.r2,
                "validation_correlation": validation.correlation,
                "learning_rate": learning_rate(self.config, self.epoch),
                "images_per_second": images_per_second,
            }
        )
        self.epoch, self.step = self.epoch + 1, 0
        self.error_sum.zero_()
        if validation.mse < self.best["error"] - self.config.min_delta:
            self.best = self._kept(validation.mse)
        if self.config.select != "error":
            self._check_driving()

    def _check_driving(self) -> None:
        drove = torch.zeros(2, dtype=torch.float64)  # on the CPU: Apple's GPUs have no float64
        if self.driving_check:  # one process drives for all
            drove += torch.tensor(self.driving_check(self.steer), dtype=torch.float64)
        interventions, cross_track_error = self.processes.sum(drove).tolist()
        self.history[-1] |= {"interventions": interventions, "cross_track_error": cross_track_error}
        if (interventions, cross_track_error) < self.best_driving["error"]:
            self.best_driving = self._kept((interventions, cross_track_error))

    def _kept(self, error: float | tuple[float, float]) -> dict[str, Any]:
        return {"error": error, "epoch": self.epoch, "weights": copy.deepcopy(self.network.state_dict())}

    def steer(self, frame: Frame) -> float:
        """What the network, as it is now, steers (-1..1) for a 160x320x3 uint8 RGB frame."""
        self.network.eval()
        with torch.inference_mode():
            return float(self.network(torch.from_numpy(frame)[None].to(self.device)).clamp(-1, 1))

    # Validation

    def validate(self) -> Agreement:
        """Compare the network, as it is now, with the driver on the validation samples.

        Raises:
            ValueError: the training has diverged, or the network has died.
        """
        predicted = self.predict(self.validation)
        if not np.isfinite(predicted).all():
            raise ValueError(
                f"the training diverged in epoch {self.epoch + 1}: its steering is no number any more. "
                f"Try a smaller --learning-rate than {self.config.learning_rate:g}"
            )
        if len(predicted) > 1 and np.ptp(predicted) == 0:
            raise ValueError(
                f"the network died in epoch {self.epoch + 1}: it steers the same for every picture, and "
                "would for ever. Try another --seed, a longer --warm-up, or a smaller --learning-rate "
                f"than {self.config.learning_rate:g}"
            )
        return agreement(predicted, self.validation["recorded"], self.training_mean)

    def predict(self, samples: pd.DataFrame) -> NDArray[np.float64]:
        """Steering (n) for samples, never augmented; 0 where a picture has become unreadable."""
        predicted = torch.zeros(len(samples), dtype=torch.float64)
        self.network.eval()

        def predict(micro_batch: Callable[[], MicroBatch]) -> None:
            loaded = micro_batch()
            if len(loaded.index):
                with torch.inference_mode(), autocast(self.device):
                    predicted[loaded.index] = self.network(self._frames(loaded)).cpu().double()

        for batch in self._loader(samples, augment=False).epoch(0):
            for done in self.cores.start(
                predict, batch.micro_batches
            ):  # batch by batch: what is read ahead stays bounded
                done.result()
        return np.asarray(self.processes.sum(predicted).numpy())

    @property
    def chosen(self) -> dict[str, Any]:
        """The epoch that is to be kept: that which drives best, or the lowest error's."""
        return self.best if self.config.select == "error" else self.best_driving

    def load_weights_of(self, best: dict[str, Any]) -> SteeringNetwork:
        """The network as it was in one of the best epochs, in evaluation mode."""
        if best["weights"]:
            self.network.load_state_dict(best["weights"])
        return self.network.eval()

    # State

    def state(self) -> dict[str, Any]:
        """All that is needed to go on later, as tensors and plain values."""
        return {
            "config": to_jsonable(self.config),
            "fingerprint": fingerprint(self.training),
            "epoch": self.epoch,
            "step": self.step,
            "error_sum": self.error_sum,
            "history": self.history,
            "best": self.best,
            "best_driving": self.best_driving,
            "weights": self.network.state_dict(),
            "optimiser": self.optimiser.state_dict(),
        }

    def restore(self, state: dict[str, Any]) -> None:
        """Go on from what `state` returned.

        Raises:
            UnusableModel: the state is of a training on other data.
        """
        if state["fingerprint"] != fingerprint(self.training):
            raise UnusableModel("the recordings have changed since this training began: train anew, without --resume")
        self.network.load_state_dict(state["weights"])
        self.optimiser.load_state_dict(state["optimiser"])
        self.epoch, self.step = state["epoch"], state["step"]
        self.history, self.best, self.best_driving = state["history"], state["best"], state["best_driving"]
        self.error_sum.copy_(state["error_sum"])
        self.scheduler = self._scheduler()

    def _save(self, state_file: Path | None) -> None:
        if state_file and self.processes.is_main:
            state = self.state()
            write_atomically(state_file, lambda file: torch.save(state, file))
        self._saved = time.monotonic()

    def _scheduler(self) -> LambdaLR:
        steps = math.ceil(len(self.training) / self.config.batch_size)
        return make_scheduler(self.optimiser, self.config, steps, self.epoch * steps + self.step)

    def _loader(self, samples: pd.DataFrame, *, augment: bool) -> BatchLoader:
        return BatchLoader(
            samples,
            self.network.rows,
            self.config.batch_size,
            augment=self.config.augment if augment else None,
            cache=self.cache,
            seed=self.config.seed,
            rank=self.processes.rank,
            world_size=self.processes.world_size,
            micro_batches=self.micro_batches,
            for_gpu=self.device.type != "cpu",
        )


def first_network(config: TrainingConfig) -> SteeringNetwork:
    """The network that a training begins with.

    Raises:
        UnusableModel: the model to start from is missing, damaged, or of another network.
    """
    if config.start is None:
        return build_network(config.network, config.seed)
    model = load_model(config.start)
    if model.name != config.network:
        raise UnusableModel(f"{config.start}: is a {model.name}; start from it with --network {model.name}")
    return model.network


def fingerprint(samples: pd.DataFrame) -> str:
    """A short text that changes with the samples: their pictures' names and labels."""
    names = samples["image"].str.replace(r".*[/\\]", "", regex=True)
    labels = samples[["steering", "rotation", "flip"]].astype(float)
    return hashlib.sha256(labels.to_numpy().tobytes() + "".join(names).encode()).hexdigest()[:16]
