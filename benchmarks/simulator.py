"""How fast is the built-in simulator? python benchmarks/simulator.py [--tracks lake jungle mountain]."""

import argparse
import os
import resource
import statistics
import subprocess
import sys
import time
from pathlib import Path

REPOSITORY = Path(__file__).parents[1]
sys.path.insert(0, str(REPOSITORY))

from pilot.log_format import CAMERAS
from pilot.simulator.catalogue import NAMED
from pilot.simulator.drive import Drive
from pilot.simulator.expert import Expert
from pilot.simulator.simulator import Simulator

PLACES = 200


def main() -> None:
    """Measure, print a table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--tracks", nargs="+", default=NAMED)
    tracks = parser.parse_args().tracks
    print(f"{os.cpu_count()} cores; import {imported():.2f} s\n")
    print("| track | scene, s | one camera, frames/s | three cameras, sets/s | physics, times real time | "
          "a lap with one camera, s (times real time) |")
    print("|---|---:|---:|---:|---:|---:|")
    for track in tracks:
        scene, one = rendering(track, ("center",))
        _, three = rendering(track, CAMERAS)
        lap, times = lap_with_pictures(track)
        print(f"| {track} | {scene:.2f} | {one:.0f} | {three:.0f} | {physics(track):.0f} | {lap:.1f} ({times:.1f}) |")
    print(f"\nmost memory: {resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024:.0f} MB")


def imported() -> float:
    """Seconds to start Python with the simulator."""
    times = []
    for _ in range(5):
        begin = time.perf_counter()
        subprocess.run([sys.executable, "-c", "import pilot.simulator.simulator"], cwd=REPOSITORY, check=True)
        times.append(time.perf_counter() - begin)
    return statistics.median(times)


def rendering(track: str, cameras: tuple[str, ...]) -> tuple[float, float]:
    """Seconds to build a scene, and sets of frames a second at places all round a track (median of five rounds)."""
    begin = time.perf_counter()
    with Simulator(cameras) as simulator:
        simulator.reset(track)
        built = time.perf_counter() - begin
        rates = []
        for _ in range(5):
            begin = time.perf_counter()
            for place in range(PLACES):
                simulator.drive.place(place / PLACES * simulator.drive.track.length)
                simulator.look()
            rates.append(PLACES / (time.perf_counter() - begin))
    return built, statistics.median(rates)


def physics(track: str) -> float:
    """How many times as fast as real the car moves without pictures."""
    with Simulator() as simulator:
        simulator.reset(track)
        drive = Drive(simulator.drive.track)
    begin = time.perf_counter()
    for _ in range(3000):
        drive.advance(0.0, 0.1)
    return 3000 * 0.02 / (time.perf_counter() - begin)


def lap_with_pictures(track: str) -> tuple[float, float]:
    """Seconds that a lap of the expert's takes with a frame each 40 ms, and the car's seconds over that."""
    with Simulator() as simulator:
        simulator.reset(track)
        expert = Expert(simulator.drive, 30.0)
        begin = time.perf_counter()
        while simulator.drive.laps < 1:
            simulator.step(*expert.command())
        seconds = time.perf_counter() - begin
        return seconds, simulator.drive.state.time / seconds


if __name__ == "__main__":
    main()
