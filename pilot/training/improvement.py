"""Improvement of a model without a person: it drives new roads, the expert corrects it, and it learns from that."""

import time
from collections.abc import Callable, Iterator
from contextlib import closing
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Annotated

import numpy as np
import pandas as pd
import tyro
from tqdm import tqdm

from pilot import process_settings
from pilot.data import folders
from pilot.data.driving_log import DrivingLog, read_driving_logs
from pilot.driving.controller import ControllerConfig
from pilot.evaluation.conditions import Conditions
from pilot.evaluation.corrected_drive import CorrectedDrive, CorrectedDriveRequest, drive_corrected
from pilot.model.checkpoint import load_model
from pilot.progress import no_bar
from pilot.simulator.catalogue import file_name, load_track
from pilot.simulator.track import REVERSED
from pilot.terminal import show
from pilot.training.config import TrainingConfig
from pilot.training.recipes import IMPROVEMENT
from pilot.training.session import keep, make_cache, samples_of, training_bar
from pilot.training.trainer import Training
from pilot.workers import run_tasks

FIRST_ROAD = 10_000  # first seed of the random roads; those of demonstrations and tests are lower
ROADS_PER_SEED = 10_000
ROUND_SECONDS = 75.0  # approximate length of a round
DRIVING_SHARE = 0.45  # of a round's time; the rest is for learning
MOST_EPOCHS = 8  # of a round, if there are few rows
FEWEST_ROWS = 1000  # from which a round learns, also if that takes longer
TIMED_ROWS = 400  # with which the speed of learning is measured
CLEAN_SECONDS = 240.0  # of driving without a correction that end the improvement
LAPS = 0.5  # of each drive on a named track, from a random position


@dataclass(frozen=True)
class ImproveConfig:
    """Improve a model in the built-in simulator: it drives, the expert corrects it, and it learns from that."""

    model: tyro.conf.Positional[Path]
    """Model to improve."""
    out: Path = Path("improved.pt")
    """Model file to write; the corrections are recorded into a folder next to it."""
    minutes: float = 5.0
    """Time for driving and learning."""
    tracks: tuple[str, ...] = ()
    """Tracks on which to improve, such as jungle or "jungle reversed". Default: ever new random roads."""
    data: Annotated[tuple[Path, ...], tyro.conf.UseAppendAction] = ()
    """Recordings that the model learned from, or folders of them, of which it sees as many rows as of corrections, so
    that it does not forget. Default: the demonstrations in data/, if there are any."""
    speed: float = 30.0
    """Target speed in mph."""
    seed: int = 0
    """Seed of the roads and of the training."""

    def check(self) -> None:
        """Check the values.

        Raises:
            ValueError: a value is invalid; the message names the option, its value and the valid range.
        """
        if not 0.5 <= self.minutes <= 10_000:
            raise ValueError(f"--minutes {self.minutes:g}: must lie in 0.5..10000")
        if not 0 <= self.seed < 1000:
            raise ValueError(f"--seed {self.seed}: must lie in 0..999")
        self.conditions.check()
        for track in self.tracks:
            load_track(track)

    @property
    def conditions(self) -> Conditions:
        """Conditions of the drives."""
        return Conditions(laps=LAPS, speed=ControllerConfig(speed=self.speed))

    @property
    def corrections(self) -> Path:
        """Folder of the recorded corrections."""
        return self.out.with_name(f"{self.out.stem}_corrections")

    @property
    def before(self) -> tuple[Path, ...]:
        """Recordings that the model learned from."""
        return self.data or tuple(each for each in map(folders.DATA.joinpath, folders.DEMONSTRATIONS) if each.is_dir())


def improve(config: ImproveConfig, set_up: Callable[[int], None], collect: "Collect | None" = None) -> None:
    """Improve a model for a time, or until the expert need not correct it any more; writes it after each round.

    Args:
        config: options.
        set_up: called with the number of threads for the main thread's operations, as soon as it is known.
        collect: records what the model then learns from; None: `drive_round`. (A benchmark compares another way.)

    Raises:
        UnusableModel: the model cannot be loaded.
        NoUsableData: the recordings of `config.data` cannot be used.
        OSError: a file cannot be written.
        ValueError: the corrections folder contains something.
    """
    load_model(config.model)
    if config.corrections.exists() and any(config.corrections.iterdir()):
        raise ValueError(f"{config.corrections}: is not empty; remove it, or name another --out")
    before = read_driving_logs(config.before, no_bar).rows if config.before else pd.DataFrame()
    ends = time.monotonic() + 60 * config.minutes
    requests = drives(config)
    model, number, clean = config.model, 0, 0.0
    while not number or ends - time.monotonic() > ROUND_SECONDS / 2:
        left = ends - time.monotonic()
        length = left / max(round(left / ROUND_SECONDS), 1)
        round_ends = time.monotonic() + length
        driven = (collect or drive_round)(config, model, requests, number, length * DRIVING_SHARE)
        number += 1
        show(f"round {number}: {describe(driven)}")
        if any(drive.takeovers for drive in driven):
            learn(config, model, before, round_ends, set_up)
            model, clean = config.out, 0.0
        elif (clean := clean + sum(drive.seconds for drive in driven)) >= CLEAN_SECONDS:
            show(f"No correction in {clean / 60:.1f} minutes of driving: more of this kind teaches nothing new.")
            break
    show(f"model: {model}    corrections: {config.corrections}")


Collect = Callable[[ImproveConfig, Path, Iterator[tuple[str, int]], int, float], list[CorrectedDrive]]


def drives(config: ImproveConfig) -> Iterator[tuple[str, int]]:
    """Yield track and seed of the start position of each drive, without end."""
    first = FIRST_ROAD + ROADS_PER_SEED * config.seed
    number = 0
    while True:
        road = f"random:{first + number}" + REVERSED * (number % 2)
        yield (config.tracks[number % len(config.tracks)] if config.tracks else road), first + number
        number += 1


def drive_round(
    config: ImproveConfig, model: Path, drives: Iterator[tuple[str, int]], number: int, seconds: float
) -> list[CorrectedDrive]:
    """Let the model drive for a time, and record the corrections; one drive at least is made."""
    ends = time.monotonic() + seconds
    most = max(round(seconds), 4)  # more than can be made
    requests = [request_for(config, model, *next(drives)) for _ in range(most)]
    done: list[CorrectedDrive] = []
    tasks = run_tasks(drive_corrected, requests, None, process_settings.for_driving)
    with closing(tasks), tqdm(total=round(seconds), desc=f"driving {number + 1}", unit=" s", leave=False) as bar:
        for _, drive in tasks:
            done.append(drive)
            bar.update(round(seconds - max(ends - time.monotonic(), 0)) - bar.n)
            if time.monotonic() > ends:
                break
    return done


def request_for(config: ImproveConfig, model: Path, track: str, seed: int) -> CorrectedDriveRequest:
    """Return a drive: half a lap on a named track, or through the tightest bend of a random road."""
    folder = config.corrections / f"{file_name(track)}-{seed}"
    return CorrectedDriveRequest(model, track, folder, config.conditions, seed, through_bend=not config.tracks)


def describe(driven: list[CorrectedDrive]) -> str:
    """Return a sentence about the drives of a round."""
    takeovers, minutes = sum(drive.takeovers for drive in driven), sum(drive.seconds for drive in driven) / 60
    rate = f" ({takeovers / minutes:.1f} per minute)" if minutes else ""
    return f"{takeovers} corrections in {minutes:.1f} minutes of driving on {len(driven)} roads{rate}"


def learn(config: ImproveConfig, model: Path, before: pd.DataFrame, ends: float, set_up: Callable[[int], None]) -> None:
    """Train the model with all corrections so far, and as many rows of earlier recordings, until a monotonic time."""
    training = replace(IMPROVEMENT, network=load_model(model).name, start=model, out=config.out, seed=config.seed)
    log = read_driving_logs([config.corrections], no_bar)
    random = np.random.default_rng(config.seed)
    rows = mixed(log.rows, before, random)
    speed = _images_per_second(training, rows)
    images = int((ends - time.monotonic()) * speed)  # that can be learned from until then
    number = max(images // training.epochs, FEWEST_ROWS)
    epochs = min(max(images // len(rows), training.epochs), MOST_EPOCHS)
    rows = _some(rows, number, random).reset_index(drop=True)
    _train(replace(training, epochs=epochs), replace(log, rows=rows), set_up)


def mixed(corrections: pd.DataFrame, before: pd.DataFrame, random: np.random.Generator) -> pd.DataFrame:
    """Return the corrections and as many random rows of earlier recordings."""
    earlier = _some(before, len(corrections), random)
    if len(earlier):
        earlier = earlier.assign(recording=earlier["recording"] + corrections["recording"].max() + 1)
    return pd.concat([corrections, earlier], ignore_index=True)


def _some(rows: pd.DataFrame, number: int, random: np.random.Generator) -> pd.DataFrame:
    """Return random rows, in their order; all if there are not more."""
    if len(rows) <= number:
        return rows
    return rows.iloc[np.sort(random.choice(len(rows), number, replace=False))]


def _images_per_second(config: TrainingConfig, rows: pd.DataFrame) -> float:
    training = Training(replace(config, epochs=1), *samples_of(rows[:TIMED_ROWS], config))
    training.run(lambda _: None, no_bar)
    return float(training.history[-1]["images_per_second"])


def _train(config: TrainingConfig, log: DrivingLog, set_up: Callable[[int], None]) -> None:
    samples, validation = samples_of(log.rows, config)
    training = Training(config, samples, validation, cache=make_cache(config))
    set_up(training.cores.threads_each)
    training.run(lambda _: None, training_bar(hidden=False))
    keep(config.out, training.chosen, log, training)
