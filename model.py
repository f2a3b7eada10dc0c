"""Train a network to steer: python model.py --data RECORDING (see --help)."""

import argparse
import dataclasses
import os
import sys
from collections.abc import Callable, Iterable, Sequence
from pathlib import Path

import tyro
from tqdm import tqdm

from pilot.batches import Batch
from pilot.checkpoint import Model, UnusableModel, load_plain, plain, save_model
from pilot.distributed import Processes, join_processes
from pilot.driving_log import DrivingLog, NoUsableData, read_driving_logs
from pilot.recipes import RECIPES, TrainingConfig, config_from_plain
from pilot.report import SMOOTHED_SECONDS, History, Measured, draw_results, draw_samples, measure
from pilot.samples import make_samples
from pilot.training import Progress, Training, choose_device

STATE = "state.pt"
MAY_CHANGE = {"resume", "epochs", "patience", "min_delta", "tensorboard", "device"}  # in a resumed training


def main(arguments: Sequence[str]) -> int:
    """Train as the options say; returns the exit code."""
    try:
        config = parse_options(arguments)
        config.check()
        choose_device(config.device)  # refuse a wrong one before minutes of reading
        with join_processes() as processes:
            train(config, processes)
    except KeyboardInterrupt:
        print("\nInterrupted.", file=sys.stderr)
        return 130
    except (NoUsableData, UnusableModel, ValueError, OSError) as error:
        print(f"model.py: {error}", file=sys.stderr)
        return 1
    return 0


# Options


def parse_options(arguments: Sequence[str]) -> TrainingConfig:
    """The configuration: the recipe's or the interrupted training's, changed by the options.

    Raises:
        ValueError: an option's value cannot work, or does not fit the training to be resumed.
    """
    early = argparse.ArgumentParser(add_help=False, allow_abbrev=False)
    early.add_argument("--recipe", default="default")
    early.add_argument("--resume", action="store_true")
    early.add_argument("--out", type=Path, default=TrainingConfig.out)
    first, _ = early.parse_known_args(arguments)
    if first.resume:
        return _resumed_options(arguments, first.out)
    if first.recipe not in RECIPES:
        raise ValueError(f"--recipe {first.recipe}: there are {', '.join(RECIPES)}")
    return tyro.cli(TrainingConfig, prog="model.py", args=arguments, default=RECIPES[first.recipe])


def _resumed_options(arguments: Sequence[str], out: Path) -> TrainingConfig:
    state = load_plain(dataclasses.replace(TrainingConfig(), out=out).report / STATE,
                       "there is no interrupted training to resume; start one without --resume")
    saved = config_from_plain(state["config"])
    config = tyro.cli(TrainingConfig, prog="model.py", args=arguments, default=dataclasses.replace(saved, data=()))
    config = dataclasses.replace(config, data=config.data or saved.data)
    for field in dataclasses.fields(config):
        before, now = getattr(saved, field.name), getattr(config, field.name)
        if before != now and field.name not in MAY_CHANGE:
            raise ValueError(f"this training began with {field.name} {before}, not {now}: "
                             "leave the option out, or start anew without --resume")
    return config


# Training


def train(config: TrainingConfig, processes: Processes) -> None:
    """Read, train, report.

    Raises:
        NoUsableData: there is nothing to train on.
        KeyboardInterrupt: on Ctrl-C, after saying how to go on.
    """
    say: Callable[[str], None] = print if processes.leads else lambda _: None
    log = read_driving_logs(config.folders, checking_bar(hidden=not processes.leads))
    say(log.table())
    training = Training(config, *make_samples(log.rows, config.samples, config.seed), processes)
    say(f"{len(training.training)} pictures to train on, {len(training.validation)} moments to validate with; "
        f"network {config.network} on {training.device.type}")
    _prepare_state(config, training)
    history = History(config.report, tensorboard=config.tensorboard and processes.leads)
    if processes.leads:
        draw_samples(log, training)

    def on_epoch(figures: dict[str, float]) -> None:
        say(epoch_line(figures, config.epochs))
        if processes.leads:
            history.write(training.history)

    try:
        training.run(on_epoch, training_bar(hidden=not processes.leads), config.report / STATE)
    except KeyboardInterrupt:
        say(f"\nStopped in epoch {training.epoch + 1}. To go on: python model.py --resume --out {config.out}")
        raise
    training.best_network()
    measured = measure(training)
    if processes.leads:
        finish(config, log, training, measured)
    processes.wait()


def _prepare_state(config: TrainingConfig, training: Training) -> None:
    """Restore the state to resume, or put an unfinished one of another training aside."""
    state = config.report / STATE
    if config.resume:
        training.restore(load_plain(state, "start anew without --resume"))
    elif training.processes.leads and state.exists():
        state.replace(state.with_name("previous_state.pt"))


def finish(config: TrainingConfig, log: DrivingLog, training: Training, measured: Measured) -> None:
    """Write the model and its pictures; say where it is and how good."""
    data = {"recordings": list(map(str, log.recordings)), "rows": len(log.rows),
            "left_out": list(map(dict, log.left_out)), "training_pictures": len(training.training),
            "validation_moments": len(training.validation)}
    metrics = {"epoch": training.best["epoch"], "recorded": measured.recorded, "smoothed": measured.smoothed}
    save_model(config.out, Model(config.network, training.network, plain(config), data, plain(metrics)))
    draw_results(training, measured)
    if training.loader.unreadable:
        print(f"{len(training.loader.unreadable)} pictures became unreadable during the training and were left out")
    print(f"\nepoch {training.best['epoch']} of {training.epoch} was the best. "
          "Against the driver's steering, on moments not trained on:\n"
          f"  as recorded:           {measured.recorded}\n"
          f"  averaged over {SMOOTHED_SECONDS} s:   {measured.smoothed}\n"
          f"model: {config.out}    history and pictures: {config.report}{os.sep}")


# What the person sees


def epoch_line(figures: dict[str, float], epochs: int) -> str:
    """One line about an epoch."""
    return (f"epoch {figures['epoch']:3.0f}/{epochs}: training MSE {figures['training_mse']:.4f}, "
            f"validation MSE {figures['validation_mse']:.4f}, R² {figures['validation_r2']:+.3f}, "
            f"{figures['images_per_second']:.0f} images/s")


def checking_bar(*, hidden: bool) -> Callable[[Iterable[str], int], Iterable[str]]:
    """A bar over the pictures while they are checked."""
    return lambda paths, count: tqdm(paths, "checking pictures", count, leave=False, disable=hidden)


def training_bar(*, hidden: bool) -> Progress:
    """A bar over the batches of an epoch that shows images/s."""

    def wrap(batches: Iterable[Batch], images: int, title: str) -> Iterable[Batch]:
        with tqdm(total=images, desc=title, unit=" images", leave=False, disable=hidden) as bar:
            for batch in batches:
                yield batch
                bar.update(batch.size)

    return wrap


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
