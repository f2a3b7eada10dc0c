"""A complete training, from recordings to model.pt, metrics and figures."""

import math
import os
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import Any

import pandas as pd
from tqdm import tqdm

from pilot.data.augment_batch import rows_needed
from pilot.data.batches import Batch
from pilot.data.driving_log import DrivingLog, read_driving_logs
from pilot.data.frame_cache import FrameCache
from pilot.data.samples import make_samples
from pilot.driving.driver import DrivingCheck
from pilot.files import unwritable
from pilot.model.checkpoint import Model, load_values, save_model, to_jsonable
from pilot.model.networks import network_class
from pilot.progress import ProgressBar, no_bar, terminal_bar
from pilot.terminal import show
from pilot.training.config import TrainingConfig
from pilot.training.distributed import Processes
from pilot.training.report import (
    SMOOTHED_SECONDS,
    History,
    ValidationResult,
    draw_results,
    draw_samples,
    validate_model,
)
from pilot.training.trainer import DRIVING_CRITERIA, STATE_FORMAT, Training

STATE = "state.pt"
LOWEST_ERROR = "lowest_error.pt"


def train(config: TrainingConfig, processes: Processes, set_up: Callable[[int], None]) -> None:
    """Read the recordings, train, and write the model, the metrics and the figures.

    Args:
        config: training options.
        processes: processes that train together; each of them calls this function.
        set_up: called with the number of threads for the main thread's operations, as soon as it is known.

    Raises:
        NoUsableData: the recordings contain no usable rows.
        UnusableModel: the model to start from, or the state to resume, cannot be used.
        ValueError: an option does not fit the recordings, the device is not available, or the training diverged.
        OSError: a file cannot be written; the message says how to resume.
        KeyboardInterrupt: on Ctrl-C, after a message about how to resume.
    """
    say: Callable[[str], None] = show if processes.is_main else lambda _: None
    cache = make_cache(config)
    log = read_in_turn(config, cache, processes)
    say(log.table())
    if cache.error:
        say(f"decoded images cannot be cached ({cache.error}): each is decoded again in every epoch")
    samples, validation = samples_of(log.rows, config)
    config = with_enough_epochs(config, len(samples))
    # only the main process drives; its result is shared
    driving_check = make_driving_check(config, log, validation) if processes.is_main else None
    training = Training(config, samples, validation, processes=processes, driving_check=driving_check, cache=cache)
    say(
        f"{len(training.training)} training samples, {len(training.validation)} validation samples; "
        f"network {config.network} on {training.device.type}"
    )
    set_up(training.cores.threads_each)
    _prepare_state(config, training)
    history = History(config.report, tensorboard=config.tensorboard and processes.is_main)

    def on_epoch(figures: dict[str, float]) -> None:
        say(epoch_line(figures, config.epochs))
        if processes.is_main:
            history.write(training.history)
        if processes.is_main and training.epoch == 1:  # not earlier, so that the first step does not wait
            draw_samples(log, training)

    with resumable(config):
        try:
            training.run(on_epoch, training_bar(hidden=not processes.is_main), config.report / STATE)
        except KeyboardInterrupt:
            say(f"\nStopped in epoch {training.epoch + 1}. To resume: {resume_command(config)}")
            raise
        if config.select in DRIVING_CRITERIA:
            keep(config.report / LOWEST_ERROR, training.best, log, training)
        result = keep(config.out, training.chosen, log, training)
        if processes.is_main:
            finish(config, training, result)
    processes.barrier()


def samples_of(rows: pd.DataFrame, config: TrainingConfig) -> tuple[pd.DataFrame, pd.DataFrame]:
    """Return the training samples and the validation samples for the network of a training.

    Raises:
        ValueError: there are too few rows, or recordings, for a training and a validation set.
    """
    return make_samples(rows, config.samples, config.seed, network_class(config.network).signature)


def with_enough_epochs(config: TrainingConfig, samples: int) -> TrainingConfig:
    """Return the options with as many epochs as their minimum number of steps needs with a number of samples."""
    steps = math.ceil(samples / config.batch_size)
    return replace(config, epochs=max(config.epochs, math.ceil(config.min_steps / steps)))


@contextmanager
def resumable(config: TrainingConfig) -> Iterator[None]:
    """Add to the error of a file that cannot be written, as on a full disk, how to resume from the last saved state."""
    try:
        yield
    except OSError as error:
        state = config.report / STATE
        if not state.exists():
            raise
        raise OSError(f"{error}. {state} keeps the training; then resume: {resume_command(config)}") from error


def resume_command(config: TrainingConfig) -> str:
    """Return the command that resumes a training."""
    return f"python model.py --resume --out {config.out}"


def make_cache(config: TrainingConfig) -> FrameCache:
    """Return a cache of the frame rows that this training needs."""
    turned = config.samples.rotation_range if config.samples.rotated_copies else 0.0
    rows = rows_needed(network_class(config.network).rows, config.augment, turned)
    return FrameCache(rows, limit=int(config.cache_gb * 1e9))


def read_in_turn(config: TrainingConfig, cache: FrameCache, processes: Processes) -> DrivingLog:
    """Read the recordings, first in the main process; the other processes then find all images in the cache."""
    if not processes.is_main:
        processes.barrier()
    log = read_driving_logs(config.folders, terminal_bar if processes.is_main else no_bar, cache)
    if processes.is_main:
        processes.barrier()
    return log


def make_driving_check(config: TrainingConfig, log: DrivingLog, validation: pd.DataFrame) -> DrivingCheck | None:
    """Return the driving check that `config.select` requires; None: none.

    A replay shows the rows of `log` that are in the table of validation samples.

    Raises:
        UnusableRecording: the validation blocks cannot be replayed.
    """
    if config.select not in DRIVING_CRITERIA:
        return None
    # imported here, because the simulator takes time to import and is seldom needed
    from pilot.evaluation.selection import driving_check, replay_check  # noqa: PLC0415

    if config.select == "driving":
        return driving_check()
    return replay_check(log.rows[log.rows["center"].isin(validation["image"])].reset_index(drop=True))


def _prepare_state(config: TrainingConfig, training: Training) -> None:
    """Restore the state to resume; otherwise rename the state of an earlier unfinished training, if there is one."""
    state = config.report / STATE
    if config.resume:
        training.restore(load_values(state, STATE_FORMAT, "start anew without --resume"))
    elif training.processes.is_main and state.exists():
        previous = state.with_name("previous_state.pt")
        try:
            state.replace(previous)
        except OSError as error:
            raise unwritable(previous, error) from error


def keep(path: Path, best: dict[str, Any], log: DrivingLog, training: Training) -> ValidationResult:
    """Load the weights of `training.best` or `training.chosen`, validate them and write a model file.

    Called by all processes.
    """
    network = training.load_weights_of(best)
    result = validate_model(training)
    data = {
        "recordings": list(map(str, log.recordings)),
        "rows": len(log.rows),
        "left_out": list(map(dict, log.left_out)),
        "training_pictures": len(training.training),
        "validation_moments": len(training.validation),
    }
    metrics = {"epoch": best["epoch"], "recorded": result.recorded, "smoothed": result.smoothed}
    if training.processes.is_main:
        save_model(
            path, Model(training.config.network, network, to_jsonable(training.config), data, to_jsonable(metrics))
        )
    return result


def finish(config: TrainingConfig, training: Training, result: ValidationResult) -> None:
    """Draw the figures, and print which epoch was kept, its metrics and the paths of the files."""
    draw_results(training, result)
    if training.loader.unreadable:
        show(f"{len(training.loader.unreadable)} images became unreadable during the training and were left out")
    show(
        f"\n{verdict(training)} "
        "Compared with the driver's steering on the validation set:\n"
        f"  as recorded:           {result.recorded}\n"
        f"  averaged over {SMOOTHED_SECONDS} s:   {result.smoothed}\n"
        f"model: {config.out}    metrics and figures: {config.report}{os.sep}"
    )


def verdict(training: Training) -> str:
    """Return a sentence about which epoch was kept, and why."""
    kept, lowest = training.chosen["epoch"], training.best["epoch"]
    if training.config.select == "error":
        return f"epoch {kept} of {training.epoch} was the best."
    if training.config.select == "last":
        return f"The last of {training.epoch} epochs was kept; epoch {lowest} has the lowest error."
    interventions, cross_track_error = training.chosen["error"]
    return (
        f"epoch {kept} of {training.epoch} drove best ({interventions:.0f} interventions, mean cross-track error "
        f"{cross_track_error:.2f} m); epoch {lowest} has the lowest error, and is {LOWEST_ERROR} in the folder below.\n"
    )


def epoch_line(figures: dict[str, float], epochs: int) -> str:
    """Return one line with the metrics of an epoch, an entry of `Training.history`."""
    drive = ""
    if "interventions" in figures:
        drive = f"{figures['interventions']:.0f} interventions, {figures['cross_track_error']:.2f} m, "
    return (
        f"epoch {figures['epoch']:3.0f}/{epochs}: training MSE {figures['training_mse']:.4f}, "
        f"validation MSE {figures['validation_mse']:.4f}, R² {figures['validation_r2']:+.3f}, {drive}"
        f"{figures['images_per_second']:.0f} images/s"
    )


def training_bar(*, hidden: bool) -> ProgressBar[Batch]:
    """Return a progress bar over the batches of an epoch, in images/s."""

    def wrap(batches: Iterable[Batch], images: int, title: str) -> Iterable[Batch]:
        with tqdm(total=images, desc=title, unit=" images", leave=False, disable=hidden) as bar:
            for batch in batches:
                yield batch
                bar.update(batch.size)

    return wrap
