"""The configuration of a training, whose fields are the command line's options."""

from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated, Any, Literal

import tyro

from pilot.data.augment import AugmentConfig
from pilot.data.samples import SampleConfig
from pilot.model.networks import network_names


@dataclass(frozen=True)
class TrainingConfig:
    """Learn to steer from recorded laps: reads recordings, trains a network, writes model.pt."""

    data: Annotated[tuple[Path, ...], tyro.conf.UseAppendAction] = ()
    """A recording, or a folder of recordings; may be given several times. Without it: data/."""
    out: Path = Path("model.pt")
    """Where the model goes; history and pictures go into a folder beside it."""
    recipe: str = "default"
    """Settings to start from (the options here override them): see the table in docs/training.md. Where there are
    only the built-in simulator's laps to learn from: built-in."""
    resume: bool = False
    """Go on with an interrupted training of this --out, with the options it was started with."""
    start: Path | None = None
    """Model to start from instead of random weights, such as models/built_in.pt: it learns on from your laps."""
    network: Annotated[str, tyro.conf.arg(help=f"Network to train: {', '.join(network_names())}.")] = "pilotnet"
    epochs: int = 15
    """Most passes over the data."""
    batch_size: int = 64
    """Pictures for one step."""
    learning_rate: float = 1e-3
    """Adam's learning rate."""
    schedule: Literal["constant", "cosine"] = "cosine"
    """Learning rate over the epochs: as it is, or falling along a cosine to zero in the last."""
    warm_up: int = 0
    """Steps in which the learning rate rises from zero: ReLUs that large first steps kill never come back."""
    loss: Literal["mse", "huber"] = "mse"
    """Loss: the squared error, or Huber's, which counts large errors only linearly."""
    huber_delta: float = 0.1
    """For loss=huber: error (-1..1) from which it counts linearly."""
    l2: float = 1e-4
    """This times the sum of squares of all weights and biases is added to the loss."""
    patience: int = 10
    """Stop after this many epochs without a better validation error; the best epoch is kept. Long by default: with
    a falling learning rate the error settles only in the last epochs."""
    min_delta: float = 1e-5
    """How much smaller the validation error must be to count as better."""
    select: Literal["error", "driving", "replay"] = "error"
    """Which epoch is kept: that of the lowest validation error; that which drives best on short stretches of unseen
    built-in roads (for networks that learn from the built-in simulator); or that which drives best when the
    recordings' validation blocks are replayed to it. The lowest error's is then kept, too, in the report's folder."""
    seed: int = 0
    """Seed of everything random: same seed, same split, same model (on a CPU)."""
    device: str = "auto"
    """cuda, mps or cpu; auto takes the fastest there is."""
    cache_gb: float = 4.0
    """Disk space for decoded pictures (1e9 bytes), in your cache folder: they are kept between trainings, the longest
    unused go first. 0: decode each picture each time."""
    tensorboard: bool = False
    """Also write TensorBoard events (pip install tensorboard)."""
    # a side camera 0.82 m off the middle comes back 15 m ahead, as the shifted viewpoints do; the students' 0.2
    # (7 m ahead) is so strong that the picture's place on the road outweighs what the driver did
    samples: SampleConfig = field(default_factory=lambda: SampleConfig(side_correction=0.05))
    augment: AugmentConfig = field(default_factory=AugmentConfig)

    def check(self) -> None:
        """Refuse values that cannot work.

        Raises:
            ValueError: names the option, its value and what it may be.
        """
        if self.network not in network_names():
            raise ValueError(f"--network {self.network}: there are {', '.join(network_names())}")
        self.augment.check()
        positive = {
            "epochs": self.epochs,
            "batch-size": self.batch_size,
            "learning-rate": self.learning_rate,
            "patience": self.patience,
            "huber-delta": self.huber_delta,
            "samples.block-seconds": self.samples.block_seconds,
            "samples.bins": self.samples.bins,
            "samples.cap": self.samples.cap,
            "samples.first-part": self.samples.first_part,
        }
        not_negative = {
            "l2": self.l2,
            "warm-up": self.warm_up,
            "min-delta": self.min_delta,
            "cache-gb": self.cache_gb,
            "samples.smooth-seconds": self.samples.smooth_seconds,
            "samples.rotated-copies": self.samples.rotated_copies,
        }
        shares = {"samples.drop-zeros": self.samples.drop_zeros, "samples.first-part": self.samples.first_part}
        _demand(positive, lambda value: value > 0, "must be greater than 0")
        _demand(not_negative, lambda value: value >= 0, "must not be negative")
        _demand(shares, lambda value: 0 <= value <= 1, "must lie in 0..1")
        if self.select == "replay" and self.samples.split != "blocks":
            raise ValueError(
                f"--select replay with --samples.split {self.samples.split}: single moments cannot be "
                "replayed; take blocks"
            )
        _demand(
            {"samples.validation-share": self.samples.validation_share},
            lambda value: 0 < value < 1,
            "must lie between 0 and 1: some data to learn from, some to check with",
        )

    @property
    def folders(self) -> tuple[Path, ...]:
        """The recordings to read."""
        return self.data or (Path("data"),)

    @property
    def report(self) -> Path:
        """The folder beside the model for history, pictures and the state of an interrupted training."""
        return self.out.with_name(f"{self.out.stem}_report")


def _demand(values: dict[str, float], holds: Callable[[float], bool], rule: str) -> None:
    for name, value in values.items():
        if not holds(value):
            raise ValueError(f"--{name} {value}: {rule}")


def config_from_jsonable(values: dict[str, Any]) -> TrainingConfig:
    """The configuration that `checkpoint.to_jsonable` turned into plain values."""

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
