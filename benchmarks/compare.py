"""Comparison of variants of a recipe, trained on the same data.

    python benchmarks/compare.py networks --data DIR [--epochs 20] [--seeds 0 1]

Groups of variants: `networks`, `augmentations`, `balancing`, `labels`, `recipes`. Each result is appended to a CSV file
immediately, and variants in that file are not trained again, so that a long comparison can be interrupted and resumed.
"""

import argparse
import sys
import time
from collections.abc import Iterator
from dataclasses import asdict, replace
from pathlib import Path

import pandas as pd
from tqdm import tqdm

sys.path.insert(0, str(Path(__file__).parents[1]))

from pilot.data.driving_log import read_driving_logs
from pilot.model.build import count_parameters
from pilot.model.networks import network_names
from pilot.training import report
from pilot.training.config import TrainingConfig
from pilot.training.recipes import RECIPES
from pilot.training.session import samples_of
from pilot.training.trainer import Training


def variants(group: str, base: TrainingConfig) -> Iterator[tuple[str, TrainingConfig]]:
    """Yield the names and configurations of the variants in a group."""
    augment, samples = base.augment, base.samples
    if group == "networks":
        yield from ((name, replace(base, network=name)) for name in network_names())
    if group == "recipes":
        yield from RECIPES.items()
    if group == "augmentations":
        yield "default", base
        yield from (
            (f"no {name}", replace(base, augment=replace(augment, **{name: 0.0})))  # type: ignore[arg-type]
            for name in ("flip", "brightness", "shadow", "viewpoint")
        )
        yield "with rotation of 5 degrees", replace(base, augment=replace(augment, rotation=0.5))
        yield "with rotation of 45 degrees", replace(base, augment=replace(augment, rotation=0.5, rotation_degrees=45))
        yield "with random height crop", replace(base, augment=replace(augment, crop=0.5))
        yield "none at all", replace(base, augment=RECIPES["nvidia-rotations"].augment)
        yield "centre camera only", replace(base, samples=replace(samples, cameras="center"))
    if group == "balancing":
        yield from (
            (name, replace(base, samples=replace(samples, balance=name)))
            for name in ("none", "drop-zeros", "spikes", "cap", "weight")
        )
    if group == "labels":
        yield from (
            (f"smoothed over {seconds} s", replace(base, samples=replace(samples, smooth_seconds=seconds)))
            for seconds in (0.0, 0.5, 1.0)
        )
        yield from (
            (f"side correction {value}", replace(base, samples=replace(samples, side_correction=value)))
            for value in (0.05, 0.1, 0.2)
        )
        yield "side cameras by the geometric rule", replace(base, samples=replace(samples, side_rule="geometric"))
        yield "huber loss", replace(base, loss="huber")
        yield from ((f"l2 {value:g}", replace(base, l2=value)) for value in (0.0, 1e-5, 1e-4, 1e-3))


def train_and_validate(config: TrainingConfig, rows: pd.DataFrame) -> dict[str, float]:
    """Train a variant, and return its size, its speed and the validation metrics of its best epoch."""
    training, validation = samples_of(rows, config)
    run, began = Training(config, training, validation), time.monotonic()
    run.run(lambda _: None, lambda batches, count, title: tqdm(batches, title, count, leave=False))
    seconds = time.monotonic() - began
    run.load_weights_of(run.best)
    result = report.validate_model(run)
    smoothed = {f"smooth_{name}": value for name, value in asdict(result.smoothed).items() if name != "count"}
    return {
        "parameters": count_parameters(run.network),
        "samples": len(training),
        "images/s": pd.DataFrame(run.history)["images_per_second"].median(),
        "epochs": run.epoch,
        "best epoch": run.best["epoch"],
        "minutes": seconds / 60,
        **asdict(result.recorded),
        **smoothed,
    }


def main() -> None:
    """Train the variants that are missing from the results file, and print the results."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("group", choices=("networks", "augmentations", "balancing", "labels", "recipes"))
    parser.add_argument("--data", type=Path, action="append", required=True)
    parser.add_argument("--epochs", type=int, help="most epochs (default: the recipe's)")
    parser.add_argument("--network", default="nvidia", choices=network_names())
    parser.add_argument("--seeds", type=int, nargs="+", default=[0])
    parser.add_argument("--only", nargs="+", help="names of variants to train")
    parser.add_argument("--results", type=Path, default=Path("compare_results.csv"))
    options = parser.parse_args()
    rows = read_driving_logs(options.data).rows
    base = replace(RECIPES["default"], network=options.network)
    for seed in options.seeds:
        for name, variant in variants(options.group, base):
            done = pd.read_csv(options.results) if options.results.exists() else pd.DataFrame()
            data = " ".join(folder.name for folder in options.data)
            config = replace(variant, seed=seed, epochs=min(variant.epochs, options.epochs or variant.epochs))
            key = {"group": options.group, "variant": name, "seed": seed, "data": data}
            key |= {"network": config.network, "epochs": config.epochs}
            known = len(done) and (done.reindex(columns=list(key)) == pd.Series(key)).all(axis=1).any()
            if known or (options.only and name not in options.only):
                continue
            row = pd.DataFrame([{**key, **train_and_validate(config, rows)}])
            pd.concat([done, row]).to_csv(options.results, index=False)
            print(row.to_string(index=False), flush=True)
    results = pd.read_csv(options.results).query("group == @options.group")
    print(results.to_string(index=False, float_format="{:.4g}".format))


if __name__ == "__main__":
    main()
