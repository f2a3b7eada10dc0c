"""Speed of the built-in simulator: python benchmarks/simulator.py [--against ANOTHER_CHECKOUT].

Every measurement runs in its own process. With --against, rounds alternate between this checkout and another one, such
as that of `git worktree add ../before COMMIT`, to measure the effect of a change. --evaluation also times complete runs
of evaluate.py, by the clock and by the processors' time, and says whether all tables are the same.
"""

import argparse
import json
import os
import resource
import statistics
import subprocess
import sys
import tempfile
import time
from pathlib import Path

REPOSITORY = Path(__file__).parents[1]
NAMED = ("lake", "jungle", "mountain")  # not from the catalogue: `pilot` is imported only once the checkout is known
PLACES = 200
MODEL = "models/built_in.pt"
Figures = dict[str, float]


# One round on a track, in its own process, in which `pilot` is that of the measured checkout


def measure(track: str) -> Figures:
    """Return all measurements on a track, by name."""
    from pilot.vehicle import CAMERAS

    began = time.perf_counter()
    scene, one = rendering(track, ("center",))
    _, three = rendering(track, CAMERAS)
    lap, times_real = lap_with_frames(track)
    return {
        "scene, s": scene,
        "one camera, frames/s": one,
        "three cameras, sets/s": three,
        "a lap with one camera, s": lap,
        "the same, times real time": times_real,
        "physics, times real time": physics(track),
        "most memory, MB": resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024,
        "all of this, s": time.perf_counter() - began,
    }


def rendering(track: str, cameras: tuple[str, ...]) -> tuple[float, float]:
    """Return the seconds to build a scene, and the sets of frames per second at positions along the whole track."""
    from pilot.simulator.simulator import Simulator

    began = time.perf_counter()
    with Simulator(cameras) as simulator:
        simulator.reset(track)
        built = time.perf_counter() - began
        began = time.perf_counter()
        for place in range(PLACES):
            simulator.episode.place(place / PLACES * simulator.episode.track.length)
            simulator.look()
        return built, PLACES / (time.perf_counter() - began)


def physics(track: str) -> float:
    """Return the simulated seconds per second while the expert drives without rendering."""
    from pilot.simulator.catalogue import load_track
    from pilot.simulator.episode import Episode
    from pilot.simulator.expert import Expert

    episode = Episode(load_track(track))
    expert = Expert(episode, 30.0)
    began = time.perf_counter()
    for _ in range(3000):
        episode.advance(*expert.command())
    return episode.state.time / (time.perf_counter() - began)


def lap_with_frames(track: str) -> tuple[float, float]:
    """Return the wall-clock seconds of an expert's lap with a frame every 40 ms, and simulated seconds per second."""
    from pilot.simulator.expert import Expert
    from pilot.simulator.simulator import Simulator

    with Simulator() as simulator:
        simulator.reset(track)
        expert = Expert(simulator.episode, 30.0)
        began = time.perf_counter()
        while simulator.episode.laps < 1:
            simulator.step(*expert.command())
        seconds = time.perf_counter() - began
        return seconds, simulator.episode.state.time / seconds


# Comparison of checkouts


def measure_apart(checkout: Path, track: str) -> Figures:
    """Run `measure` with the code of a checkout, in its own process."""
    command = [sys.executable, __file__, "--measure", track, "--checkout", str(checkout)]
    figures: Figures = json.loads(subprocess.run(command, check=True, capture_output=True, text=True).stdout)
    return figures


def evaluate(checkout: Path, track: str, jobs: int, laps: int) -> tuple[Figures, str]:
    """Return the laps per minute of a complete run of evaluate.py, from its start to its table, and the table."""
    with tempfile.TemporaryDirectory() as folder:
        command = [
            sys.executable,
            "evaluate.py",
            MODEL,
            "--tracks",
            track,
            "--jobs",
            str(jobs),
            "--out",
            folder,
            "--seeds",
            *map(str, range(1, laps + 1)),
        ]
        began, used = time.perf_counter(), children_seconds()
        shown = subprocess.run(command, cwd=checkout, check=True, capture_output=True, text=True).stdout
        seconds, used = time.perf_counter() - began, children_seconds() - used
        name = f"evaluation, {laps} laps, {jobs} processes, "
        speeds = {name + "laps a minute": laps / seconds * 60, name + "processor s a lap": used / laps}
        return speeds, shown.partition("scores and figures")[0]


def children_seconds() -> float:
    """Return the processor time of all child processes that have ended, in seconds."""
    usage = resource.getrusage(resource.RUSAGE_CHILDREN)
    return usage.ru_utime + usage.ru_stime


def compare(track: str, checkouts: list[Path], options: argparse.Namespace) -> None:
    """Print the medians of the measurements on a track for each checkout, and their ratios."""
    rounds: list[list[Figures]] = [[] for _ in checkouts]
    tables: set[str] = set()
    for _ in range(options.rounds):
        for checkout, result in zip(checkouts, rounds, strict=True):
            figures = measure_apart(checkout, track)
            for number in (1, os.cpu_count() or 1) if options.evaluation else ():
                evaluated, table = evaluate(checkout, track, number, options.laps)
                figures |= evaluated
                tables.add(table)
            result.append(figures)
    for name in rounds[0][0]:
        values = [statistics.median(figures[name] for figures in result) for result in rounds]
        ratio = f" {values[1] / values[0]:.2f} |" if len(values) > 1 else ""
        print(f"| {track} | {name} | " + " | ".join(f"{value:.3g}" for value in values) + f" |{ratio}", flush=True)
    if tables:
        print(f"| {track} | different tables of the evaluations | {len(tables)} |", flush=True)


def main() -> None:
    """Print a table of all measurements."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--tracks", nargs="+", default=NAMED)
    parser.add_argument("--against", type=Path, help="a checkout of another version, to be compared with this one")
    parser.add_argument("--evaluation", action="store_true")
    parser.add_argument("--laps", type=int, default=4, help="of an evaluation")
    parser.add_argument("--rounds", type=int, default=5)
    parser.add_argument("--measure", help=argparse.SUPPRESS)
    parser.add_argument("--checkout", help=argparse.SUPPRESS)
    options = parser.parse_args()
    if options.measure:
        sys.path.insert(0, options.checkout)
        print(json.dumps(measure(options.measure)))
        return
    checkouts = [options.against, REPOSITORY] if options.against else [REPOSITORY]
    columns = ["before", "now", "ratio"] if options.against else ["now"]
    print(
        f"{os.cpu_count()} cores\n\n| track | medians of {options.rounds} | "
        + " | ".join(columns)
        + " |\n|---|---|"
        + "---:|" * len(columns)
    )
    for track in options.tracks:
        compare(track, checkouts, options)


if __name__ == "__main__":
    main()
