"""How much corrections should weigh: interventions on unseen roads after learning from them with several weights.

    python benchmarks/correction_weight.py MODEL --data RECORDING... [--weights 1 4 16] [--seeds 2] [--roads 50]

As when a person takes the wheel, only the expert's steering while it corrects the model is recorded, in the first
400 m of hard random roads. Then the model learns from that and from --data by the recipe `corrections`, and drives
other hard roads. The trained models and the corrections are kept in --out and are not made again.
"""

import argparse
import itertools
import sys
from dataclasses import dataclass
from pathlib import Path

from tqdm import tqdm

sys.path.insert(0, str(Path(__file__).parents[1]))

from benchmarks.held_out import train
from benchmarks.improve import first_part, hard_roads, interventions, print_interventions
from pilot import process_settings
from pilot.arrays import Frame
from pilot.data.recording_writer import RecordingWriter
from pilot.evaluation.closed_loop import drive_laps, simulator_at
from pilot.evaluation.corrected_drive import CorrectedPolicy
from pilot.simulator.camera_variation import STANDARD
from pilot.simulator.catalogue import file_name
from pilot.workers import run_tasks


@dataclass(frozen=True)
class Correction:
    """A road on which a model is corrected, in any process."""

    model: Path
    road: str
    folder: Path


class PersonLikePolicy(CorrectedPolicy):
    """Records only the rows in which the expert steers."""

    def record(self, frame: Frame, command: tuple[float, float], pause: float, quality: int = STANDARD.quality) -> None:
        """Record a row, if the expert steers."""
        if self.corrects:
            super().record(frame, command, pause, quality)


def correct(task: Correction) -> int:
    """Drive and record a road; returns the number of corrections."""
    request = first_part(task.model, task.road)
    simulator = simulator_at(request)
    with RecordingWriter(task.folder) as writer:
        corrected = PersonLikePolicy(simulator.episode, request.driver(simulator.episode), writer)
        drive_laps(simulator.episode, lambda _: simulator.look()["center"], corrected, request.conditions)
    return len(corrected.takeovers)


def record_corrections(model: Path, roads: list[str], folder: Path) -> None:
    """Record the corrections on all roads."""
    tasks = [Correction(model, road, folder / file_name(road)) for road in roads]
    driven = tqdm(run_tasks(correct, tasks, None, process_settings.for_driving), "correcting", len(tasks), leave=False)
    print(f"{sum(number for _, number in driven)} corrections on {len(roads)} roads")


def learned(weight: float, seed: int, options: argparse.Namespace) -> Path:
    """Learn from the corrections with a weight, unless that was done before; returns the path of the model."""
    out: Path = options.out / f"weight-{weight:g}-{seed}.pt"
    words = ["--recipe", "corrections", "--start", str(options.model), "--seed", str(seed)]
    words += ["--samples.correction-weight", str(weight)]
    train(out, [options.out / "corrections", *options.data], words)
    return out


def main() -> None:
    """Record corrections, learn from them, drive, and print the figures."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("model", type=Path)
    parser.add_argument("--data", type=Path, nargs="+", required=True, help="recordings that the model learned from")
    parser.add_argument("--weights", type=float, nargs="+", default=[1.0, 4.0, 16.0])
    parser.add_argument("--seeds", type=int, default=2)
    parser.add_argument("--roads", type=int, default=50, help="to drive; as many others are corrected before")
    parser.add_argument(
        "--out", type=Path, default=Path("correction_weights"), help="folder for models and corrections"
    )
    options = parser.parse_args()
    process_settings.for_driving()
    roads = hard_roads(2 * options.roads)
    if not (options.out / "corrections").exists():
        record_corrections(options.model, roads[options.roads :], options.out / "corrections")
    models = {"before": options.model}
    for weight, seed in itertools.product(options.weights, range(options.seeds)):
        models[f"weight {weight:g}, seed {seed}"] = learned(weight, seed, options)
    for name, model in models.items():
        print_interventions(name, interventions(model, roads[: options.roads])["interventions"])


if __name__ == "__main__":
    main()
