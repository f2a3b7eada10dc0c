"""What faults in a recording do to a model, and what leaving suspicious moments out repairs.

    python benchmarks/spoilt_training.py RECORDING --on RECORDING... [--seed 0] [--share 0.05] -- [OPTION...]

Trained by the options of model.py after --, the recording's own rows first: as recorded; with planted faults (see
planted_faults.py); the same without the most suspicious rows of the share that the data page puts first. Judged are all
three on other recordings (--on), with the figures of held_out.py.
"""

import argparse
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd
import tyro

sys.path.insert(0, str(Path(__file__).parents[1]))

from benchmarks.held_out import judge, read, split_words
from benchmarks.planted_faults import find, plant
from pilot import process_settings
from pilot.data.driving_log import DrivingLog, read_driving_logs
from pilot.training.config import TrainingConfig
from pilot.training.session import keep, make_cache, samples_of, training_bar
from pilot.training.trainer import Training


def variants(rows: pd.DataFrame, seed: int, share: float) -> dict[str, pd.DataFrame]:
    """Return the rows as recorded, with faults, and with faults but without the most suspicious rows."""
    spoilt, _ = plant(rows, seed, share)
    suspicious = find(spoilt, networks=False, share=share)
    cleaned = spoilt[~np.isin(np.arange(len(spoilt)), suspicious)].reset_index(drop=True)
    return {"as recorded": rows, "spoilt": spoilt, "spoilt, suspicious rows left out": cleaned}


def train(config: TrainingConfig, log: DrivingLog) -> None:
    """Train a model on the rows of a log."""
    samples, validation = samples_of(log.rows, config)
    training = Training(config, samples, validation, cache=make_cache(config))
    process_settings.use_threads(training.cores.threads_each)
    training.run(lambda _: None, training_bar(hidden=False))
    keep(config.out, training.chosen, log, training)


def main() -> None:
    """Train, judge, and print the figures."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("recording", type=Path)
    parser.add_argument("--on", type=Path, nargs="+", required=True, help="recordings to judge on")
    parser.add_argument("--seed", type=int, default=0, help="of the faults and of the training")
    parser.add_argument("--share", type=float, default=0.05, help="of the rows that are spoilt, and left out")
    parser.add_argument("--out", type=Path, default=Path("spoilt"), help="folder for the models")
    words, training = split_words(sys.argv[1:])
    options = parser.parse_args(words)
    options.out.mkdir(parents=True, exist_ok=True)
    process_settings.for_training()
    config = replace(tyro.cli(TrainingConfig, args=training), seed=options.seed)
    log = read_driving_logs([options.recording], annotated=False)
    judged = {folder.name: read(folder, replayed=True) for folder in options.on}
    figures = []
    for name, rows in variants(log.rows, options.seed, options.share).items():
        model = options.out / f"{options.recording.name}-{options.seed}-{name.replace(', ', '-').replace(' ', '-')}.pt"
        if not model.exists():
            train(replace(config, out=model), replace(log, rows=rows))
        figures += [{"rows": name, "on": folder, **judge(model, *ready)} for folder, ready in judged.items()]
    print(
        pd.DataFrame(figures).drop(columns=["delay", "reference"]).to_string(index=False, float_format="{:.3g}".format)
    )


if __name__ == "__main__":
    main()
