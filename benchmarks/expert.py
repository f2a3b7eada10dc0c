"""Accuracy of the expert on all tracks in both directions: python benchmarks/expert.py."""

import itertools
import sys
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from tqdm import tqdm

sys.path.insert(0, str(Path(__file__).parents[1]))

from pilot.simulator.catalogue import load_course, track_names
from pilot.simulator.episode import CarState, Episode
from pilot.simulator.expert import Expert

SPEED = 30.0  # mph


def laps(name: str, count: int, *, backwards: bool) -> list[CarState]:
    """Drive `count` laps, and return the state at every tick."""
    track = load_course(name).track
    episode = Episode(track.reversed() if backwards else track)
    expert = Expert(episode, SPEED)
    states = []
    while episode.laps < count:
        states.append(episode.advance(*expert.command()))
    return states


def row(title: str, names: Sequence[str], count: int) -> str:
    """Return a row of the table about `count` laps of each track in each direction."""
    drives = [laps(name, count, backwards=way) for name in tqdm(names, title, leave=False) for way in (False, True)]
    departures = sum(
        before.on_road and not after.on_road for states in drives for before, after in itertools.pairwise(states)
    )
    offsets = np.abs([state.cross_track_error for states in drives for state in states])
    speed = np.mean([state.speed for states in drives for state in states])
    return (
        f"| {title} | {count * len(drives)} | {departures} | {offsets.mean():.2f} | "
        f"{np.percentile(offsets, 95):.2f} | {offsets.max():.2f} | {speed:.1f} |"
    )


def main() -> None:
    """Print the table."""
    print("| both directions | laps | road departures | cross-track error, m: mean | 95 % | max | mph |")
    print("|---|---:|---:|---:|---:|---:|---:|")
    for name in track_names():
        print(row(name, [name], 10), flush=True)
    print(row("20 random roads", [f"random:{seed}" for seed in range(20)], 1))


if __name__ == "__main__":
    main()
