"""The board of this project's recipes and networks: each trained several times on the same laps, and measured.

    python benchmarks/recipes.py [--seeds 3] [--suite v1] [--out recipes] [--board docs/board] [--only NAME...]

The laps are what a person records in half an hour: one of lake, jungle and mountain in each direction, by a driver who
wanders by 0.3 m, and 20 recoveries each. They are recorded with one row per second, which makes the whole board take
hours instead of days, and with five for networks that see an earlier frame or predict the next ones. The students'
recipes have a network each; all networks are also trained by the default recipe or by `sequences`.

Recordings and models are kept in --out and are not made again; results are kept in --board, and what has one is neither
trained nor measured again, so that a long run can be interrupted and continued. Those of this project belong in
docs/board, in a folder for each suite: another --board makes all of them anew.
"""

import argparse
import itertools
import sys
from pathlib import Path

import numpy as np
from tqdm import tqdm

sys.path.insert(0, str(Path(__file__).parents[1]))

from benchmarks.held_out import train
from pilot import process_settings
from pilot.board.measurement import Contestant, Result, in_processes, measure_all, results_in
from pilot.board.page import text_table, write_page
from pilot.board.points import mean_points, rank_agreement
from pilot.board.suite import SUITES, Suite
from pilot.simulator.catalogue import both_ways
from pilot.simulator.demonstration import DemonstrationConfig
from pilot.simulator.demonstrations import DemonstrationSet, record_demonstrations

REPOSITORY = Path(__file__).parents[1]


def laps_at(rate: float, folder: str) -> DemonstrationSet:
    """Return the laps of all ways with a number of rows per second."""
    each = DemonstrationConfig(laps=1, recoveries=20, rate=rate, wander=0.3)
    return DemonstrationSet(folder, dict.fromkeys(both_ways(["lake", "jungle", "mountain"]), each))


SPARSE, DENSE = laps_at(1.0, "laps"), laps_at(5.0, "dense_laps")
SEQUENCES = "sequences"
# options of model.py by name in the table
WAYS = {
    name: ("--recipe", name)
    for name in (
        "default",
        "built-in",
        SEQUENCES,
        "nvidia-rotations",
        "nvidia-rotations-no-l2",
        "lenet5-rotations",
        "lenet-drop-zeros",
        "nvidia-drop-zeros",
        "simplenet-spikes",
        "densenet-spikes",
    )
} | {
    f"{recipe}-{name}": ("--recipe", recipe, "--network", name)
    for recipe, names in (
        ("default", ("pilotnet_standardised", "nvidia", "lenet5", "lenet", "simplenet", "densenet")),
        (SEQUENCES, ("pilotnet_standardised", "pilotnet_speed", "pilotnet_ahead", "pilotnet_history")),
    )
    for name in names
}


def laps_of(way: str, out: Path) -> Path:
    """Record what is missing of the laps of a way; returns their folder."""
    laps = DENSE if way.startswith(SEQUENCES) else SPARSE
    folder = out / laps.folder
    tracks = [(track, laps.tracks[track]) for track in laps.missing(folder)]
    for _ in tqdm(record_demonstrations(folder, tracks), "recording", len(tracks), unit=" tracks", leave=False):
        pass
    return folder


def print_board(suite: Suite, results: list[Result]) -> None:
    """Print a Markdown table with the figures of each way's seeds, the best first, and the agreement of the halves.

    Ways are compared by the mean of their trainings; the agreement of single trainings is lower, because those of the
    same way differ by little.
    """
    by_way: dict[str, list[Result]] = {}
    for result in results:
        way = result.name.rpartition("-")[0]
        by_way.setdefault(way if way in WAYS else result.name, []).append(result)
    points = {way: [mean_points(each.drives) for each in found] for way, found in by_way.items()}
    print("| recipe, network | points | of each seed | interventions of each | mph |\n|---|---:|---|---|---:|")
    for way in sorted(points, key=lambda each: -float(np.mean(points[each]))):
        found = by_way[way]
        interventions = ", ".join(str(sum(drive.interventions for drive in each.drives)) for each in found)
        speed = np.mean([drive.speed for each in found for drive in each.drives])
        each_seed = ", ".join(f"{value:.1f}" for value in points[way])
        print(f"| `{way}` | {np.mean(points[way]):.1f} | {each_seed} | {interventions} | {speed:.1f} |")
    halves = [drive.half for drive in suite.drives]
    trainings = rank_agreement([each.drives for each in results], halves)
    ways = rank_agreement([[drive for each in found for drive in each.drives] for found in by_way.values()], halves)
    print(f"rank agreement of the halves: {ways:.2f} of the {len(by_way)} rows, {trainings:.2f} of all trainings")


def main() -> None:
    """Record, train and measure what is missing, and print the board."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seeds", type=int, default=3)
    parser.add_argument("--suite", choices=SUITES, default="v1")
    parser.add_argument("--out", type=Path, default=Path("recipes"))
    parser.add_argument(
        "--board", type=Path, default=REPOSITORY / "docs/board", help="folder of results and pages, by suite"
    )
    parser.add_argument("--only", nargs="+", choices=WAYS, default=list(WAYS))
    parser.add_argument("--beside", type=Path, nargs="*", default=[], help="other models to measure")
    options = parser.parse_args()
    process_settings.for_driving()
    suite, board = SUITES[options.suite], options.board / options.suite
    board.mkdir(parents=True, exist_ok=True)
    measured = {result.name for result in results_in(board, suite)}
    for seed, way in itertools.product(range(options.seeds), options.only):
        model = options.out / f"{way}-{seed}.pt"
        if model.stem not in measured:
            train(model, [laps_of(way, options.out)], [*WAYS[way], "--seed", str(seed)])
            measure_all(suite, [Contestant(model.stem, model)], board, in_processes())
    measure_all(suite, [Contestant(model.stem, model) for model in options.beside], board, in_processes())
    results = list(results_in(board, suite))
    print(text_table(suite, results))
    print_board(suite, results)
    print(f"page: {write_page(board, suite, results)}")


if __name__ == "__main__":
    main()
