"""A training from reading to reporting: recordings → model.pt and the pictures beside it."""

import os
from collections.abc import Callable, Iterable

from tqdm import tqdm

from pilot.batches import Batch
from pilot.checkpoint import Model, load_plain, plain, save_model
from pilot.distributed import Processes
from pilot.driving_log import DrivingLog, read_driving_logs
from pilot.recipes import TrainingConfig
from pilot.report import SMOOTHED_SECONDS, History, Measured, draw_results, draw_samples, measure
from pilot.samples import make_samples
from pilot.training import Progress, Training

STATE = "state.pt"


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
