"""How near the built-in simulator is to the Unity simulator, measured on recordings of the latter.

python benchmarks/fidelity.py RECORDING... [--real MODEL...] [--built-in MODEL...] [--sheet sheet.png]

line: the built-in track whose curvature fits each recording, the correlation, and the scale of the distances.
look: colours (RGB) and contrasts of recorded and rendered frames at the same places, by region; and the distance of
    the first --real network's features: the mean difference of the channels' means and standard deviations, in
    recorded standard deviations, over all layers.
drive: models trained on recordings only (--real) on the built-in lake and jungle, and models trained on built-in
    tracks only (--built-in) on the recordings: correlation with the driver's steering averaged over half a second,
    and autonomy in the replay.
"""

import argparse
import sys
from dataclasses import dataclass, replace
from pathlib import Path

import pandas as pd

sys.path.insert(0, str(Path(__file__).parents[1]))

from benchmarks.held_out import judge, read
from benchmarks.look import compare_looks
from pilot.data.driving_log import read_driving_logs
from pilot.data.motion import Motion, motion_of
from pilot.driving.controller import ControllerConfig
from pilot.evaluation.closed_loop import DriveRequest, ModelPolicy, run
from pilot.evaluation.conditions import Conditions
from pilot.evaluation.map_matching import MapMatch, match_track
from pilot.evaluation.reference_path import continuous_segments
from pilot.simulator.catalogue import both_ways, load_track
from pilot.simulator.scores import score

TRACKS = both_ways(["lake", "jungle"])
LEAST_MATCH = 0.5  # correlation from which a place on the track counts as found
CAREFUL = Conditions(speed=ControllerConfig(speed=15.0, slow_in_curves=0.45))  # for --real models


@dataclass(frozen=True, eq=False)
class Segment:
    """A continuous part of a recording on a track.

    Attributes:
        name: of the recording.
        rows: of its log.
        motion: of the recorded car.
        match: the track, and where on it each row was driven.
    """

    name: str
    rows: pd.DataFrame
    motion: Motion
    match: MapMatch


def find_segments(folders: list[Path]) -> list[Segment]:
    """Return the parts of recordings, each with its place on the best of TRACKS."""
    tracks = [load_track(name) for name in TRACKS]
    found = []
    for folder in folders:
        for rows in continuous_segments(read_driving_logs([folder]).rows):
            motion = motion_of(rows)
            found.append(Segment(folder.name, rows, motion, match_track(motion, tracks)))
    return found


def print_lines(segments: list[Segment]) -> None:
    """Print how well the curvature of each part fits the line of a track."""
    print(f"{'line':<14}{'metres':>8}{'track':>18}{'correlation':>13}{'scale':>8}")
    for segment in segments:
        match, metres = segment.match, segment.motion.steps.sum()
        print(f"{segment.name:<14}{metres:8.0f}{match.track.name:>18}{match.correlation:13.2f}{match.scale:8.2f}")


def print_real_drives(models: list[Path], laps: float) -> None:
    """Print how models that were trained on recordings drive laps of the built-in tracks."""
    conditions = replace(CAREFUL, laps=laps)
    for model in models:
        for track in TRACKS:
            scores = score(track, [run(DriveRequest(ModelPolicy(model), track, conditions))])
            low, high = scores.autonomy_interval
            found = f"{scores.interventions} interventions"
            print(f"{model.name:<22}{track:<18}{found:>18}{scores.autonomy:8.1f} % ({low:.1f} to {high:.1f}) autonomy")


def print_built_in_drives(models: list[Path], folders: list[Path]) -> None:
    """Print how models that were trained on built-in tracks do on recordings."""
    for folder in folders:
        rows, recording = read(folder, replayed=True)
        for model in models:
            found = judge(model, rows, recording)
            replayed = f"{found['replay']:8.1f} % autonomy by the {found['reference']}" if recording else "  no replay"
            print(f"{model.name:<22}{folder.name:<18}{found['correlation']:6.2f} correlation{replayed}")


def main() -> None:
    """Print the tables."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("recordings", type=Path, nargs="+")
    parser.add_argument("--real", type=Path, nargs="*", default=[], help="models trained on recordings only")
    parser.add_argument("--built-in", type=Path, nargs="*", default=[], help="models trained on built-in tracks only")
    parser.add_argument("--laps", type=float, default=1.0, help="laps of each track with the --real models")
    parser.add_argument("--sheet", type=Path, help="also draw recorded above rendered frames; do not publish it")
    options = parser.parse_args()
    segments = find_segments(options.recordings)
    print_lines(segments)
    print()
    matched = [segment for segment in segments if segment.match.correlation >= LEAST_MATCH]
    places = [
        (path, segment.match.track.name, progress)
        for segment in matched
        for path, progress in zip(segment.rows["center"], segment.match.progress, strict=True)
    ]
    compare_looks(places, options.real[0] if options.real else None, options.sheet)
    print()
    print_real_drives(options.real, options.laps)
    print_built_in_drives(options.built_in, options.recordings)


if __name__ == "__main__":
    main()
