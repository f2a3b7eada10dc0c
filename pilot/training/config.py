"""Training options; the fields of the dataclass are the options of the command line."""

import math
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated, Any, Literal

import tyro

from pilot.data.augment import AugmentConfig
from pilot.data.folders import DATA
from pilot.data.samples import SampleConfig
from pilot.model.networks import network_names


@dataclass(frozen=True)
class TrainingConfig:
    """Train a network to steer on recorded laps, and write it to model.pt.

    Another command: model.py improve --help, with which the built-in expert corrects a model.
    """

    data: Annotated[tuple[Path, ...], tyro.conf.UseAppendAction] = ()
    """A recording, or a folder of recordings; may be given several times. Default: data/."""
    out: Path = Path("model.pt")
    """Model file to write; metrics and figures are written to a folder next to it."""
    recipe: str = "default"
    """Set of default options, overridden by the options given here; see the table in docs/training.md. Default:
    built-in if there are only recordings of the built-in simulator, real with --start, otherwise default."""
    resume: bool = False
    """Resume the interrupted training of this --out with its options."""
    start: Path | None = None
    """Model to fine-tune, such as models/built_in.pt, instead of starting from random weights; decides the network."""
    start_share: float = 0.0
    """With --start: share (0..1) of that model in the finished one, whose weights are the average of both (arXiv
    2109.01903). It keeps more of what the model could do before."""
    network: Annotated[str, tyro.conf.arg(help=f"Network to train: {', '.join(network_names())}.")] = "pilotnet"
    epochs: int = 15
    """Maximum number of epochs."""
    min_steps: int = 0
    """Minimum number of optimisation steps: few data are learned from in more epochs than --epochs."""
    batch_size: int = 64
    """Number of samples per optimisation step, over all processes."""
    learning_rate: float = 1e-3
    """Initial learning rate of Adam."""
    schedule: Literal["constant", "cosine"] = "cosine"
    """Learning rate schedule: constant, or cosine annealing to zero."""
    warm_up: int = 0
    """Number of steps of linear learning rate warm-up, because large first steps can leave ReLUs permanently dead."""
    loss: Literal["mse", "huber"] = "mse"
    """Loss: squared error, or Huber loss, which is linear for large errors."""
    huber_delta: float = 0.1
    """For loss=huber: absolute error of the steering above which the loss is linear."""
    l2: float = 1e-4
    """L2 regularisation: factor of the sum of squares of all weights and biases, which is added to the loss."""
    patience: int = 10
    """Stop early after this many epochs without a lower validation error. Large by default, because with a decreasing
    learning rate the error converges only in the last epochs."""
    min_delta: float = 1e-5
    """Minimum decrease of the validation error that counts as an improvement."""
    select: Literal["error", "last", "driving", "replay"] = "error"
    """Criterion for the epoch that is kept: lowest validation error; the last one, if the validation set is so
    small that the error's noise exceeds the differences between the last epochs; best driving on short sections of
    unseen random tracks (for training on the built-in simulator's recordings); or best driving in replays of the
    validation blocks. For driving and replay, the epoch with the lowest error is also kept, in the folder of the
    metrics."""
    seed: int = 0
    """Seed of all random generators; on a CPU, the same seed gives the same split and the same model."""
    device: str = "auto"
    """cuda, mps or cpu; auto: the fastest one available."""
    cache_gb: float = 4.0
    """Disk space in GB (1e9 bytes) for decoded images, which are kept in the user's cache folder between trainings; the
    least recently used are removed first. 0: no cache, every image is decoded in every epoch."""
    tensorboard: bool = False
    """Also write TensorBoard events; needs the package tensorboard."""
    # steers a side camera's image, 0.82 m off the middle, back within 15 m, like the shifted viewpoints; with the
    # students' 0.2 (back within 7 m), the camera's position influences the label more than the driver's steering does
    samples: SampleConfig = field(default_factory=lambda: SampleConfig(side_correction=0.05))
    """Conversion of the rows of the recordings to samples."""
    augment: AugmentConfig = field(default_factory=AugmentConfig)
    """Augmentations in training: the probability (0: never) and the range of each."""

    def check(self) -> None:
        """Check the values.

        Raises:
            ValueError: a value is invalid; the message names the option, its value and the valid range.
        """
        if self.network not in network_names():
            raise ValueError(f"--network {self.network}: there are {', '.join(network_names())}")
        self.augment.check()
        if self.start_share and not self.start:
            raise ValueError(
                f"--start-share {self.start_share:g}: is the share of the model that --start names: add --start, for "
                "example --start models/built_in.pt, or --start-share 0"
            )
        positive = {
            "epochs": self.epochs,
            "batch-size": self.batch_size,
            "learning-rate": self.learning_rate,
            "patience": self.patience,
            "huber-delta": self.huber_delta,
            "samples.correction-weight": self.samples.correction_weight,
            "samples.block-seconds": self.samples.block_seconds,
            "samples.bins": self.samples.bins,
            "samples.cap": self.samples.cap,
            "samples.first-part": self.samples.first_part,
        }
        not_negative = {
            "l2": self.l2,
            "warm-up": self.warm_up,
            "min-steps": self.min_steps,
            "min-delta": self.min_delta,
            "cache-gb": self.cache_gb,
            "samples.path-metres": self.samples.path_metres,
            "samples.smooth-seconds": self.samples.smooth_seconds,
            "samples.rotated-copies": self.samples.rotated_copies,
        }
        finite = {
            "samples.min-speed": self.samples.min_speed,
            "samples.side-correction": self.samples.side_correction,
            "samples.rotation-range": self.samples.rotation_range,
        }
        shares = {
            "start-share": self.start_share,
            "samples.drop-zeros": self.samples.drop_zeros,
            "samples.first-part": self.samples.first_part,
        }
        _require(positive, lambda value: 0 < value < math.inf, "must be greater than 0, and finite")
        _require(not_negative, lambda value: 0 <= value < math.inf, "must not be negative, and finite")
        _require(finite, math.isfinite, "must be finite")
        _require({"seed": self.seed}, lambda value: 0 <= value < 1 << 63, "must lie in 0..2^63-1")
        if self.out.is_dir():
            raise ValueError(f"--out {self.out}: is a folder; name a file in it, such as {self.out / 'model.pt'}")
        _require(shares, lambda value: 0 <= value <= 1, "must lie in 0..1")
        if self.select == "replay" and self.samples.split == "moments":
            raise ValueError(
                f"--select replay with --samples.split {self.samples.split}: replay needs contiguous "
                "segments; use blocks or recordings"
            )
        _require(
            {"samples.validation-share": self.samples.validation_share},
            lambda value: 0 < value < 1,
            "must be greater than 0 and less than 1",
        )

    @property
    def folders(self) -> tuple[Path, ...]:
        """Recordings, or folders of recordings, to read."""
        return self.data or (DATA,)

    @property
    def report(self) -> Path:
        """Folder next to the model for metrics, figures and the state of an interrupted training."""
        return self.out.with_name(f"{self.out.stem}_report")


def _require(values: dict[str, float], holds: Callable[[float], bool], rule: str) -> None:
    for name, value in values.items():
        if not holds(value):
            raise ValueError(f"--{name} {value}: {rule}")


def config_from_jsonable(values: dict[str, Any]) -> TrainingConfig:
    """Restore a configuration from the plain values that `checkpoint.to_jsonable` made of it."""

    def restore(values: dict[str, Any]) -> dict[str, Any]:
        return {name: tuple(value) if isinstance(value, list) else value for name, value in values.items()}

    top = restore(values)
    return TrainingConfig(
        **{
            **top,
            "data": tuple(map(Path, top["data"])),
            "out": Path(top["out"]),
            "start": Path(top["start"]) if top["start"] else None,
            "samples": SampleConfig(**restore(top["samples"])),
            "augment": AugmentConfig(**restore(top["augment"])),
        }
    )
