"""How fast is the built-in simulator? python benchmarks/simulator.py [--against ANOTHER_CHECKOUT].

Every measurement is a process of its own; rounds alternate between this checkout and, to see what a change brought,
another one, such as `git worktree add ../before COMMIT` makes. --evaluation also times whole evaluations.
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
NAMED = ("lake", "jungle", "mountain")  # not the catalogue's: nothing of `pilot` before it is known which checkout's
PLACES = 200
MODEL = "models/built_in.pt"
EVALUATED_LAPS = 4
Figures = dict[str, float]


# One round of a track, in a process of its own; `pilot` is then that of the checkout that is measured


def measure(track: str) -> Figures:
    """All figures of a track."""
    from pilot.vehicle import CAMERAS

    began = time.perf_counter()
    scene, one = rendering(track, ("center",))
    _, three = rendering(track, CAMERAS)
    lap, times_real = lap_with_pictures(track)
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
    """Seconds to build a scene, and sets of frames a second at places all round a track."""
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
    """How many times as fast as real the expert drives without pictures."""
    from pilot.simulator.catalogue import load_track
    from pilot.simulator.episode import Episode
    from pilot.simulator.expert import Expert

    episode = Episode(load_track(track))
    expert = Expert(episode, 30.0)
    began = time.perf_counter()
    for _ in range(3000):
        episode.advance(*expert.command())
    return episode.state.time / (time.perf_counter() - began)


def lap_with_pictures(track: str) -> tuple[float, float]:
    """Seconds that a lap of the expert's takes with a frame each 40 ms, and the car's seconds over that."""
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


# Side by side


def measure_apart(checkout: Path, track: str) -> Figures:
    """`measure` with the code of a checkout."""
    command = [sys.executable, __file__, "--measure", track, "--checkout", str(checkout)]
    figures: Figures = json.loads(subprocess.run(command, check=True, capture_output=True, text=True).stdout)
    return figures


def evaluate(checkout: Path, track: str, jobs: int) -> Figures:
    """Laps a minute of wall time that a whole evaluation drives, from its start to its tables and pictures."""
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
            *map(str, range(1, EVALUATED_LAPS + 1)),
        ]
        began = time.perf_counter()
        subprocess.run(command, cwd=checkout, check=True, capture_output=True)
        return {f"evaluation, {jobs} at once, laps a minute": EVALUATED_LAPS / (time.perf_counter() - began) * 60}


def compare(track: str, checkouts: list[Path], options: argparse.Namespace) -> None:
    """Print the medians of a track for each checkout, and the ratios."""
    rounds: list[list[Figures]] = [[] for _ in checkouts]
    for _ in range(options.rounds):
        for checkout, result in zip(checkouts, rounds, strict=True):
            jobs = (1, os.cpu_count() or 1) if options.evaluation else ()
            evaluated = [evaluate(checkout, track, number) for number in jobs]
            result.append(
                {
                    name: value
                    for figures in (measure_apart(checkout, track), *evaluated)
                    for name, value in figures.items()
                }
            )
    for name in rounds[0][0]:
        values = [statistics.median(figures[name] for figures in result) for result in rounds]
        ratio = f" {values[1] / values[0]:.2f} |" if len(values) > 1 else ""
        print(f"| {track} | {name} | " + " | ".join(f"{value:.3g}" for value in values) + f" |{ratio}", flush=True)


def main() -> None:
    """Print a table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--tracks", nargs="+", default=NAMED)
    parser.add_argument("--against", type=Path, help="a checkout of another version, to be compared with this one")
    parser.add_argument("--evaluation", action="store_true")
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
