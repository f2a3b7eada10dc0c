"""Training of a network to steer: python model.py --data RECORDING (see --help)."""

import argparse
import dataclasses
import os
import sys
from collections.abc import Sequence
from contextlib import AbstractContextManager, nullcontext
from pathlib import Path
from typing import TYPE_CHECKING

import tyro
from tqdm import tqdm

from pilot import cli, process_settings
from pilot.data.folders import DATA, has_own_recordings, with_demonstrations
from pilot.files import sole_use
from pilot.terminal import show
from pilot.training.config import TrainingConfig, config_from_jsonable
from pilot.training.recipes import RECIPES

if TYPE_CHECKING:
    from pilot.simulator.demonstrations import DemonstrationSet

PROGRAM = cli.program("model.py")
MAY_CHANGE = {"resume", "epochs", "patience", "min_delta", "tensorboard", "device", "cache_gb"}  # options, on --resume


def main(arguments: Sequence[str] | None = None) -> int:
    """Train, or improve a model, with the words in `arguments` (default: sys.argv); return the exit code."""
    words = list(sys.argv[1:] if arguments is None else arguments)
    if words[:1] == ["improve"]:
        return cli.run(PROGRAM, lambda: improve_model(words[1:]))

    def train() -> None:
        config = parse_options(words)
        config.check()
        run(config)

    return cli.run(PROGRAM, train)


def run(config: TrainingConfig) -> None:
    """Train; without --data, first record demonstrations if there are no recordings.

    Raises:
        NoUsableData, UnusableModel, ValueError, OSError: training is not possible; the message says what to do.
        InUseError: another training is writing the same model.
    """
    # imported here, so that --help, invalid options and the processes that record do not wait for PyTorch
    from pilot.training.devices import choose_device
    from pilot.training.distributed import join_processes
    from pilot.training.session import train

    process_settings.for_training()
    # what is not possible is refused before minutes of reading
    choose_device(config.device)
    check_replaceable(config.out)
    with join_processes() as processes, sole_training(config) if processes.is_main else nullcontext():
        demonstrations = needed_demonstrations(config)
        if processes.is_main:
            for each in demonstrations:
                record_missing(DATA, each)
        processes.barrier()
        if demonstrations:
            used = with_demonstrations(DATA, [each.folder for each in demonstrations])
            config = dataclasses.replace(config, data=used)
        train(config, processes, process_settings.use_threads)


def improve_model(words: Sequence[str]) -> None:
    """Improve a model in the built-in simulator, with the options in `words`."""
    from pilot.training.improvement import ImproveConfig, improve  # imports PyTorch

    config = tyro.cli(ImproveConfig, prog=f"{PROGRAM} improve", args=words)
    config.check()
    process_settings.for_training()
    check_replaceable(config.out)
    improve(config, process_settings.use_threads)


def check_replaceable(out: Path) -> None:
    """Check that a file which a model will replace is a model.

    Raises:
        ValueError: it is something else; the message says what to do.
    """
    from pilot.model.checkpoint import UnusableModel, load_model  # imports PyTorch

    if out.exists():
        try:
            load_model(out)
        except UnusableModel as error:
            cure = "it is not replaced: name another file, or remove it"
            raise ValueError(f"--out {out}: is there already, and is no model that can be used; {cure}") from error


def sole_training(config: TrainingConfig) -> AbstractContextManager[None]:
    """Return a context that refuses a second training with the same --out, which would overwrite this one's files.

    The lock stands for the folder of the metrics: model.pt and model.bin have the same one.
    """
    return sole_use(
        config.report.with_name(f".{config.report.name}.lock"),
        f"{config.out}: another training is writing it and {config.report}{os.sep}. Wait for its end, or name another "
        "file with --out",
    )


def needed_demonstrations(config: TrainingConfig) -> "list[DemonstrationSet]":
    """Return what the built-in simulator demonstrates for a training: nothing if there are recordings for it."""
    from pilot.model.networks import network_class
    from pilot.signature import STEERING_ONLY
    from pilot.simulator.demonstrations import BUILT_IN, SEQUENCES  # slow to import

    if config.data or has_own_recordings(DATA):
        return []
    return [BUILT_IN] if network_class(config.network).signature == STEERING_ONLY else [BUILT_IN, SEQUENCES]


def record_missing(folder: Path, demonstrations: "DemonstrationSet") -> None:
    """Record those demonstrations that are missing in their subfolder of a folder.

    Raises:
        OSError: the folder cannot be written to.
        InUseError: another training is recording them.
    """
    from pilot.simulator.demonstrations import record_demonstrations  # slow to import

    inside = folder / demonstrations.folder
    if missing := demonstrations.missing(inside):
        show(
            f"There are no recordings in {folder}{os.sep}: the built-in simulator records demonstration laps, normal "
            f"ones and recoveries, both ways round, into {inside}{os.sep}"
        )
        refusal = f"{inside}{os.sep}: another training is recording there. Wait until it trains, then start again"
        tracks = [(track, demonstrations.tracks[track]) for track in missing]
        with sole_use(folder / f".{demonstrations.folder}.lock", refusal):
            for _ in tqdm(record_demonstrations(inside, tracks), "recording", len(missing), unit=" tracks"):
                pass


# Options


def parse_options(arguments: Sequence[str]) -> TrainingConfig:
    """Return the training options: those of the recipe or the interrupted training, overridden by `arguments`.

    The network is that of the model to start from, if any.

    Raises:
        UnusableModel: there is no interrupted training to resume, or its state or the model to start from is damaged.
        ValueError: there is no such recipe, or an option must not change on --resume.
    """
    early = argparse.ArgumentParser(add_help=False, allow_abbrev=False)
    early.add_argument("--recipe")
    early.add_argument("--data", action="append")
    early.add_argument("--resume", action="store_true")
    early.add_argument("--start", type=Path)
    early.add_argument("--out", type=Path, default=TrainingConfig.out)
    first, _ = early.parse_known_args(arguments)
    if first.resume:
        return _resumed_options(arguments, first.out)
    own = first.data or has_own_recordings(DATA)
    recipe = first.recipe or ("built-in" if not own else "fine-tune" if first.start else "default")
    if recipe not in RECIPES:
        raise ValueError(f"--recipe {recipe}: there are {', '.join(RECIPES)}")
    options = _with_network_of(first.start, RECIPES[recipe]) if first.start else RECIPES[recipe]
    return tyro.cli(TrainingConfig, prog=PROGRAM, args=arguments, default=options)


def _with_network_of(start: Path, options: TrainingConfig) -> TrainingConfig:
    from pilot.model.checkpoint import load_model

    return dataclasses.replace(options, network=load_model(start).name)


def _resumed_options(arguments: Sequence[str], out: Path) -> TrainingConfig:
    from pilot.model.checkpoint import load_values
    from pilot.training.session import STATE
    from pilot.training.trainer import STATE_FORMAT

    state = load_values(
        dataclasses.replace(TrainingConfig(), out=out).report / STATE,
        STATE_FORMAT,
        "there is no interrupted training to resume; start one without --resume",
    )
    saved = config_from_jsonable(state["config"])
    config = tyro.cli(TrainingConfig, prog=PROGRAM, args=arguments, default=dataclasses.replace(saved, data=()))
    config = dataclasses.replace(config, data=config.data or saved.data)
    for field in dataclasses.fields(config):
        before, now = getattr(saved, field.name), getattr(config, field.name)
        if before != now and field.name not in MAY_CHANGE:
            raise ValueError(
                f"this training began with {field.name} {before}, not {now}: "
                "leave the option out, or start anew without --resume"
            )
    return config
