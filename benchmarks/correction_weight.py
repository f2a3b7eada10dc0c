"""How much corrections should weigh: interventions on unseen roads after learning from them with several weights.

    python benchmarks/correction_weight.py MODEL --data RECORDING... [--weights 1 4 16] [--seeds 2] [--roads 50]

As when a person takes the wheel, only the expert's steering while it corrects the model is recorded, in the first
`METRES` of hard random roads. Then the model learns from that and from --data by the recipe `corrections`, and drives
other hard roads. The trained models and the corrections are kept in --out and are not made again.
"""

import argparse
import itertools
import subprocess
import sys
from dataclasses import dataclass
from pathlib import Path

from tqdm import tqdm

sys.path.insert(0, str(Path(__file__).parents[1]))

from benchmarks.improve import METRES, hard_roads, interventions
from pilot import process_settings
from pilot.arrays import Frame
from pilot.data.recording_writer import RecordingWriter
from pilot.evaluation.closed_loop import DriveRequest, ModelPolicy, drive_laps, simulator_at
from pilot.evaluation.conditions import Conditions
from pilot.evaluation.corrected_drive import CorrectedPolicy
from pilot.simulator.camera_variation import STANDARD
from pilot.simulator.catalogue import file_name, load_track
from pilot.workers import run_tasks

REPOSITORY = Path(__file__).parents[1]


@dataclass(frozen=True)
class Correction:
    """A road on which a model is corrected, in any process."""

    model: Path
    road: str
    folder: Path


class PersonLikePolicy(CorrectedPolicy):
    """Records only the rows in which the expert steers."""

    def _record(
        self, frame: Frame, command: tuple[float, float], pause: float, quality: int = STANDARD.quality
    ) -> None:
        if self._corrects:
            super()._record(frame, command, pause, quality)


def correct(task: Correction) -> int:
    """Drive and record a road; returns the number of corrections."""
    policy, conditions = ModelPolicy(task.model), Conditions(laps=METRES / load_track(task.road).length)
    simulator = simulator_at(DriveRequest(policy, task.road, conditions))
    with RecordingWriter(task.folder) as writer:
        corrected = PersonLikePolicy(simulator.episode, policy(), writer)
        drive_laps(simulator.episode, lambda _: simulator.look()["center"], corrected, conditions)
    return len(corrected.takeovers)


def record_corrections(model: Path, roads: list[str], folder: Path) -> None:
    """Record the corrections on all roads."""
    tasks = [Correction(model, road, folder / file_name(road)) for road in roads]
    driven = tqdm(run_tasks(correct, tasks, None, process_settings.for_driving), "correcting", len(tasks), leave=False)
    print(f"{sum(number for _, number in driven)} corrections on {len(roads)} roads")


def learned(weight: float, seed: int, options: argparse.Namespace) -> Path:
    """Learn from the corrections with a weight, unless that was done before; returns the path of the model."""
    out: Path = options.out / f"weight-{weight:g}-{seed}.pt"
    if not out.exists():
        data = [word for folder in [options.out / "corrections", *options.data] for word in ("--data", str(folder))]
        words = ["--recipe", "corrections", "--start", str(options.model), *data, "--out", str(out)]
        words += ["--samples.correction-weight", str(weight), "--seed", str(seed)]
        subprocess.run([sys.executable, str(REPOSITORY / "model.py"), *words], check=True)
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
        driven = interventions(model, roads[: options.roads])["interventions"]
        print(f"{name:20} {driven.sum():4} interventions, {(driven == 0).sum()} of {len(driven)} roads without")


if __name__ == "__main__":
    main()
