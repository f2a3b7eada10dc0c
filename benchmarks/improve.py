"""What `model.py improve` brings: interventions on unseen roads before, after it, and after other use of the time.

    python benchmarks/improve.py MODEL [--minutes 5] [--seeds 5] [--roads 100] [--data RECORDING...]

The other way to spend the time is to record more demonstrations of the built-in expert (laps and recoveries on new
random roads), and to learn from them in the same manner. Of the random roads from the seed 3100 on, those are taken
whose tightest bend has a radius of less than `TIGHT` metres; their first `METRES` are driven. Models and figures are
kept in --out, and are not made again, so that a long run can be interrupted and continued.
"""

import argparse
import itertools
import shutil
import sys
import time
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pandas as pd
from tqdm import tqdm

sys.path.insert(0, str(Path(__file__).parents[1]))

from pilot import process_settings
from pilot.evaluation.closed_loop import DriveRequest, ModelPolicy, run
from pilot.evaluation.conditions import Conditions
from pilot.evaluation.corrected_drive import CorrectedDrive
from pilot.simulator.catalogue import file_name, load_track
from pilot.simulator.demonstrations import RANDOM_TRACKS, record
from pilot.simulator.scores import score
from pilot.training.improvement import ImproveConfig, improve
from pilot.workers import run_tasks

FIRST_ROAD, TIGHT = 3100, 18.0
METRES = 400.0  # driven on each road
WAYS = ("improve", "demonstrations")


@dataclass(frozen=True)
class Demonstration:
    """A road to be demonstrated, in any process."""

    track: str
    folder: Path


def hard_roads(number: int) -> list[str]:
    """Return names of unseen random roads with tight bends."""
    found: list[str] = []
    seed = FIRST_ROAD
    while len(found) < number:
        if np.abs(load_track(f"random:{seed}").curvatures).max() > 1 / TIGHT:
            found.append(f"random:{seed}")
        seed += 1
    return found


def demonstrate(task: Demonstration) -> CorrectedDrive:
    """Record the expert's laps and recoveries on one road."""
    rows = record(task.track, RANDOM_TRACKS, task.folder)
    return CorrectedDrive(task.track, 1, rows, rows / RANDOM_TRACKS.rate)


def demonstrate_round(
    config: ImproveConfig, _model: Path, drives: Iterator[tuple[str, int]], _number: int, seconds: float
) -> list[CorrectedDrive]:
    """Record demonstrations for a time, on the roads that the model would have driven."""
    ends, done = time.monotonic() + seconds, []
    tasks = [
        Demonstration(track, config.corrections / f"{file_name(track)}-{start}")
        for track, start in (next(drives) for _ in range(max(round(seconds), 4)))
    ]
    for _, drive in run_tasks(demonstrate, tasks, None, process_settings.for_images):
        done.append(drive)
        if time.monotonic() > ends:
            break
    return done


def first_part(model: Path, road: str) -> DriveRequest:
    """Return a drive of the first part of a road."""
    return DriveRequest(ModelPolicy(model), road, Conditions(laps=METRES / load_track(road).length))


def interventions(model: Path, roads: list[str]) -> pd.DataFrame:
    """Drive the first part of each road; return the interventions per road."""
    requests = [first_part(model, road) for road in roads]
    results = tqdm(run_tasks(run, requests, None, process_settings.for_driving), model.stem, len(roads), leave=False)
    found = {number: score(roads[number], [trajectory]) for number, trajectory in results}
    return pd.DataFrame(
        [{"road": roads[number], "interventions": found[number].interventions} for number in sorted(found)]
    )


def print_interventions(name: str, driven: "pd.Series[int]") -> None:
    """Print the sum of the interventions on all roads, and the number of roads without."""
    clean = (driven == 0).sum()
    print(f"{name:20} {driven.sum():4} interventions, {clean} of {len(driven)} roads without", flush=True)


def improved(model: Path, way: str, seed: int, options: argparse.Namespace) -> Path:
    """Improve a model in a way, unless that was done before; returns the path of the improved one."""
    out: Path = options.out / f"{way}-{seed}.pt"
    if not out.exists():  # an interrupted one has another name
        unfinished = out.with_name(f"unfinished-{out.name}")
        shutil.rmtree(out.with_name(f"{unfinished.stem}_corrections"), ignore_errors=True)
        config = ImproveConfig(model, unfinished, options.minutes, (), tuple(options.data), seed=seed)
        improve(config, process_settings.use_threads, demonstrate_round if way == "demonstrations" else None)
        unfinished.replace(out)
    return out


def main() -> None:
    """Improve, drive, and print the figures."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("model", type=Path)
    parser.add_argument("--minutes", type=float, default=5.0)
    parser.add_argument("--seeds", type=int, default=5)
    parser.add_argument("--roads", type=int, default=100)
    parser.add_argument("--data", type=Path, nargs="*", default=[], help="recordings that the model learned from")
    parser.add_argument("--out", type=Path, default=Path("improvements"), help="folder for models and figures")
    options = parser.parse_args()
    options.out.mkdir(parents=True, exist_ok=True)
    process_settings.for_training()
    roads, models = hard_roads(options.roads), {"before": options.model}
    for seed, way in itertools.product(range(options.seeds), WAYS):
        models[f"{way}-{seed}"] = improved(options.model, way, seed, options)
    for name, model in models.items():
        figures = options.out / f"{name}.csv"
        if not figures.exists():
            interventions(model, roads).to_csv(figures, index=False)
        driven = pd.read_csv(figures)["interventions"]
        print_interventions(name, driven)


if __name__ == "__main__":
    main()
