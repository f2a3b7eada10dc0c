"""Training with early stopping. A resumed training ends with exactly the weights of an uninterrupted one."""

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

from pilot.data.batches import Batch, BatchLoader, MicroBatch
from pilot.data.device_augment import augment
from pilot.data.frame_cache import FrameCache
from pilot.driving.driver import DrivingCheck, NetworkPolicy
from pilot.interrupt import Interrupt, catch_interrupt
from pilot.model.build import build_network
from pilot.model.checkpoint import UnusableModel, load_model, save_values, to_jsonable
from pilot.model.steering_network import SteeringNetwork
from pilot.progress import ProgressBar
from pilot.training.config import TrainingConfig
from pilot.training.devices import CoreThreads, autocast, choose_device, draws_at_random, micro_batches_of
from pilot.training.distributed import Processes
from pilot.training.metrics import Agreement, agreement
from pilot.training.optimisation import learning_rate, losses, make_optimiser, make_scheduler

STATE_FORMAT = "behavioral-cloning training state"
DRIVING_CRITERIA = ("driving", "replay")  # values of `config.select` that evaluate each epoch by driving
SAVE_SECONDS = 120  # between saved states; at most this much work is lost in a power failure


class Training:
    """A training: network, optimiser, progress, best epochs and metrics.

    Attributes:
        network: the network being trained.
        epoch, step: numbers of completed epochs, and of completed steps of the current epoch.
        history: metrics of each epoch: errors, learning rate, images/s and, if it drives, results of the driving check.
        best: lowest validation error so far, with its epoch (from 1) and weights.
        best_driving: the same for the best result of the driving check: (interventions, cross-track error in metres).
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
        """Create a training of the network of `config`.

        Args:
            config: training options.
            training, validation: tables of samples.
            processes: processes that train together; None: this one only.
            driving_check: evaluates each epoch by driving; needed in the main process if `config.select` is driving
                or replay.
            cache: cache that reads the frames; None: images are decoded at every read.

        Raises:
            UnusableModel: the model to start from is missing, damaged, or has another network.
            ValueError: the device is not available.
        """
        self.config, self.driving_check = config, driving_check
        self.processes = processes or Processes()
        self.device = choose_device(config.device, self.processes.local_rank)
        self.network = first_network(config).to(self.device)
        self.start_weights = copy.deepcopy(self.network.state_dict()) if config.start_share else {}
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

    def run(
        self, on_epoch: Callable[[dict[str, float]], None], progress: ProgressBar[Batch], state_file: Path | None = None
    ) -> None:
        """Train until early stopping or the last epoch.

        Args:
            on_epoch: called after each epoch with its metrics, an entry of `history`.
            progress: progress bar over the batches of an epoch, in samples.
            state_file: file to which the state is saved regularly and on Ctrl-C; None: not saved.

        Raises:
            ValueError: the training has diverged, or the network's output has become constant.
            KeyboardInterrupt: on Ctrl-C, after the current step.
        """
        with catch_interrupt() as interrupt:
            while not self.finished:
                self._train_epoch(self._batches(progress), state_file, interrupt)
                on_epoch(self.history[-1])
                self._save(state_file)

    @property
    def finished(self) -> bool:
        """Whether the training has ended by early stopping or by the maximum number of epochs."""
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
        """Train on batches, and yield the number of samples of each step; idle threads already load the next batch."""
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
        """Apply an optimisation step by the gradients summed over all micro-batches and processes."""
        for parameter, *gradients in zip(self.parameters, *(gradients for gradients, _ in micro_batches), strict=True):
            parameter.grad = functools.reduce(Tensor.add_, gradients)
        self.processes.sum_gradients(self.parameters)
        self.optimiser.step()
        self.scheduler.step()
        self.error_sum += torch.stack([errors for _, errors in micro_batches]).sum()
        self.step += 1

    def gradients(self, reading: Future[MicroBatch], size: int) -> tuple[Sequence[Tensor], Tensor]:
        """Return a micro-batch's gradients of the mean loss over `size` samples, and its sum of squared errors."""
        micro_batch = reading.result()
        if not len(micro_batch.index):
            return [torch.zeros_like(parameter) for parameter in self.parameters], torch.zeros((), device=self.device)
        labels, weight = micro_batch.labels.to(self.device), micro_batch.weight.to(self.device)
        with self._repeatable_draws(), autocast(self.device):
            predicted = self.network.predict(self._frames(micro_batch)).float()
        loss = (weight * losses(predicted, labels, self.config)).sum() / size
        return torch.autograd.grad(loss, self.parameters), (predicted.detach() - labels)[:, 0].square().sum()

    @contextlib.contextmanager
    def _repeatable_draws(self) -> Iterator[None]:
        """Seed dropout by seed, epoch, step and rank only, so that a resumed training draws the same numbers."""
        if not self.draws_at_random:
            yield
            return
        numbers = np.random.SeedSequence([self.config.seed, self.epoch, self.step, self.processes.rank])
        with torch.random.fork_rng([self.device] if self.device.type == "cuda" else []):
            torch.manual_seed(int(numbers.generate_state(1)[0]))
            yield

    def _frames(self, micro_batch: MicroBatch) -> Tensor:
        frames = micro_batch.frames.to(self.device, non_blocking=True)
        if not micro_batch.draws:
            return frames
        augmented = augment(frames, micro_batch.draws.to(self.device), self.network.rows)
        history = self.network.signature.history
        return augmented.reshape(-1, 1 + len(history), *augmented.shape[1:]) if history else augmented

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
            self.best = self._snapshot(validation.mse)
        if self.config.select in DRIVING_CRITERIA:
            self._check_driving()

    def _check_driving(self) -> None:
        drove = torch.zeros(2, dtype=torch.float64)  # on the CPU: Apple's GPUs have no float64
        if self.driving_check:  # in the main process only
            drove += torch.tensor(self.driving_check(NetworkPolicy(self.network, self.device)), dtype=torch.float64)
        interventions, cross_track_error = self.processes.sum(drove).tolist()
        self.history[-1] |= {"interventions": interventions, "cross_track_error": cross_track_error}
        if (interventions, cross_track_error) < self.best_driving["error"]:
            self.best_driving = self._snapshot((interventions, cross_track_error))

    def _snapshot(self, error: float | tuple[float, float]) -> dict[str, Any]:
        return {"error": error, "epoch": self.epoch, "weights": copy.deepcopy(self.network.state_dict())}

    def validate(self) -> Agreement:
        """Compute the metrics of the current network on the validation samples; called by all processes.

        Raises:
            ValueError: the training has diverged, or the network's output has become constant.
        """
        predicted = self.predict(self.validation)
        if not np.isfinite(predicted).all():
            raise ValueError(
                f"the training diverged in epoch {self.epoch + 1}: its steering is not finite. "
                f"Try a smaller --learning-rate than {self.config.learning_rate:g}"
            )
        if len(predicted) > 1 and np.ptp(predicted) == 0:
            raise ValueError(
                f"the network collapsed in epoch {self.epoch + 1}: it predicts the same steering for every image. "
                "Try another --seed, a longer --warm-up, or a smaller --learning-rate "
                f"than {self.config.learning_rate:g}"
            )
        return agreement(predicted, self.validation["recorded"], self.training_mean)

    def predict(self, samples: pd.DataFrame) -> NDArray[np.float64]:
        """Return the steering (n) for samples, not augmented; 0 for unreadable images. Called by all processes."""
        predicted = torch.zeros(len(samples), dtype=torch.float64)
        self.network.eval()

        def predict(micro_batch: Callable[[], MicroBatch]) -> None:
            loaded = micro_batch()
            if len(loaded.index):
                with torch.inference_mode(), autocast(self.device):
                    predicted[loaded.index] = self.network(self._frames(loaded)).cpu().double()

        for batch in self._loader(samples, augment=False).epoch(0):
            # batch by batch, to limit the number of loaded frames
            for done in self.cores.start(predict, batch.micro_batches):
                done.result()
        return np.asarray(self.processes.sum(predicted).numpy())

    @property
    def chosen(self) -> dict[str, Any]:
        """The epoch that `config.select` asks for: `best`, `best_driving`, or the last one with the current weights."""
        if self.config.select == "last":
            return self._snapshot(self.history[-1]["validation_mse"])
        return self.best if self.config.select == "error" else self.best_driving

    def load_weights_of(self, best: dict[str, Any]) -> SteeringNetwork:
        """Load the weights of an epoch such as `best`, if it has any, and return the network in evaluation mode.

        They are averaged with those of the model to start from, if `config.start_share` asks for it.
        """
        if best["weights"]:
            self.network.load_state_dict(blended(best["weights"], self.start_weights, self.config.start_share))
        return self.network.eval()

    def state(self) -> dict[str, Any]:
        """Return the state that `restore` needs, as tensors and plain values."""
        return {
            "format": STATE_FORMAT,
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
        """Restore a state returned by `state`.

        Raises:
            UnusableModel: the state belongs to a training on other samples.
        """
        if state["fingerprint"] != fingerprint(self.training):
            raise UnusableModel(
                "the recordings have changed since this training began: start a new one, without --resume"
            )
        self.network.load_state_dict(state["weights"])
        self.optimiser.load_state_dict(state["optimiser"])
        self.epoch, self.step = state["epoch"], state["step"]
        self.history, self.best, self.best_driving = state["history"], state["best"], state["best_driving"]
        self.error_sum.copy_(state["error_sum"])
        self.scheduler = self._scheduler()

    def _save(self, state_file: Path | None) -> None:
        if state_file and self.processes.is_main:
            save_values(state_file, self.state())
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
            signature=self.network.signature,
        )


def first_network(config: TrainingConfig) -> SteeringNetwork:
    """Return the network with random weights, or that of the model to start from.

    Raises:
        UnusableModel: the model to start from is missing, damaged, or has another network.
    """
    if config.start is None:
        return build_network(config.network, config.seed)
    model = load_model(config.start)
    if model.name != config.network:
        raise UnusableModel(f"{config.start}: is a {model.name}; start from it with --network {model.name}")
    return model.network


def blended(weights: dict[str, Tensor], start: dict[str, Tensor], share: float) -> dict[str, Tensor]:
    """Return the average of two networks' weights, with a share (0..1) of `start`; counters are those of `weights`."""
    return {
        key: torch.lerp(value, start[key], share) if share and value.is_floating_point() else value
        for key, value in weights.items()
    }


def fingerprint(samples: pd.DataFrame) -> str:
    """Return a digest of the samples: file names of the images, labels and fixed augmentations."""
    digest = hashlib.sha256(samples[["steering", "rotation", "flip"]].to_numpy(float).tobytes())
    for path in samples["image"]:
        digest.update(path.replace("\\", "/").rpartition("/")[2].encode())
    return digest.hexdigest()[:16]
