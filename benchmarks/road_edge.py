"""Training and accuracy of the network that tells a recorded car's position on the road (replay_road.py).

    python benchmarks/road_edge.py [RECORDING...] [--train]

--train makes pilot/evaluation/road_edge.pt anew: frames of the built-in tracks and of 130 random roads, the car
anywhere on the road, each with its distance from the left edge in the column of the steering.

Accuracy on roads that are in no training, driven by the expert with 0.6 m of wandering: mean errors of the car's offset
from the middle, of its heading and of the road's half width, and the clarity. On recordings: the offset of the side
cameras from the centre camera (they are 0.82 m apart), and the car's usual place on the road.
"""

import argparse
import functools
import math
import shutil
import subprocess
import sys
import tempfile
import zlib
from pathlib import Path

import numpy as np
import pandas as pd
from tqdm import tqdm

sys.path.insert(0, str(Path(__file__).parents[1]))

from pilot import process_settings
from pilot.arrays import Floats
from pilot.data.driving_log import read_driving_logs
from pilot.data.motion import motion_of
from pilot.data.recording_writer import RecordingWriter
from pilot.evaluation.reference_path import continuous_segments
from pilot.evaluation.replay_road import NETWORK_FILE, distance_label, find_road
from pilot.simulator.camera_variation import draw_variation
from pilot.simulator.catalogue import both_ways, file_name
from pilot.simulator.demonstration import DemonstrationConfig, demonstrate
from pilot.simulator.demonstrations import BUILT_IN
from pilot.simulator.simulator import Simulator
from pilot.simulator.track import REVERSED
from pilot.vehicle import SIDE_CAMERA_OFFSET
from pilot.workers import run_tasks

NAMED_FRAMES = {"lake": 700, "jungle": 1500, "mountain": 400}
RANDOM_FRAMES = 130
FRAMES = {track: NAMED_FRAMES.get(track.removesuffix(REVERSED), RANDOM_FRAMES) for track in BUILT_IN.tracks}
HEADINGS = math.radians(7.0)  # standard deviation
WHEEL_ON_ROAD = 0.3  # metres between the rear axle's middle and the edge, at least
TRAINING = {
    "recipe": "built-in",
    "epochs": "10",
    "augment.viewpoint": "0",
    "augment.saturation": "0.5",
    "augment.shadow": "0.3",
}
FIGURES = ("offset, m", "heading, °", "half width, m")
CHECKED = (*both_ways(["lake", "jungle"]), *(f"random:{seed}" for seed in range(3000, 3008)))
WANDERING = DemonstrationConfig(laps=0.3, rate=10, wander=0.6, line_spread=0.3, seed=5)


def record(folder: Path, track: str) -> None:
    """Record frames of a built-in track with the distances from the left edge as their labels."""
    random = np.random.default_rng(zlib.crc32(track.encode()))
    with Simulator() as simulator, RecordingWriter(folder / file_name(track)) as writer:
        simulator.reset(track)
        episode, length = simulator.episode, simulator.episode.track.length
        for number in range(FRAMES[track]):
            start = (number + random.uniform()) / FRAMES[track] * length
            episode.place(start)
            room = episode.where.half_width - WHEEL_ON_ROAD
            offset = random.uniform(-room, room) - episode.track.lane
            episode.place(start, offset, random.normal(0, HEADINGS))
            variation, mirrored = draw_variation(random), bool(random.integers(2))
            frame, place = simulator.look(variation)["center"], episode.where
            # half of the frames are mirrored, because the right edge is found in mirrored ones
            label = distance_label(place.half_width + place.lateral_offset * (-1 if mirrored else 1))
            shown = {"center": np.ascontiguousarray(frame[:, ::-1]) if mirrored else frame}
            # 20 mph, because standing cars are left out; 2 s apart, because it is not a drive
            writer.write(shown, 2.0 * number, (label, 0.0), 20.0, quality=variation.quality)


def train() -> None:
    """Record, train and replace the network's file."""
    with tempfile.TemporaryDirectory() as temporary:
        folder = Path(temporary)
        jobs = run_tasks(functools.partial(record, folder / "data"), list(FRAMES), None, process_settings.for_images)
        for _ in tqdm(jobs, "recording", len(FRAMES), unit=" tracks"):
            pass
        program = Path(__file__).parents[1] / "model.py"
        words = [word for name, value in TRAINING.items() for word in (f"--{name}", value)]
        subprocess.run([sys.executable, str(program), *words], cwd=folder, check=True)
        shutil.move(folder / "model.pt", NETWORK_FILE)


def built_in_errors(track: str) -> dict[str, float | str]:
    """Return the mean errors of the found road on a built-in track, driven by a wandering expert."""
    with tempfile.TemporaryDirectory() as name:
        rows, truth = _drive(Path(name), track)
        road = find_road(list(rows["center"]), motion_of(rows))
        found = (road.line.offsets, np.degrees(road.line.headings), road.half_widths)
        errors = [float(np.abs(one - other).mean()) for one, other in zip(found, truth.T, strict=True)]
    return {"track": track, **dict(zip(FIGURES, errors, strict=True)), "clarity": road.clarity}


def _drive(folder: Path, track: str) -> tuple[pd.DataFrame, Floats]:
    """Return the rows of a drive, and the true offset, heading error in degrees, and half width of each."""
    truth = []
    with Simulator() as simulator, RecordingWriter(folder) as writer:
        simulator.reset(track, seed=3)
        for step in demonstrate(simulator.episode, WANDERING):
            state, where = simulator.episode.state, simulator.episode.where
            truth.append((where.lateral_offset, math.degrees(state.heading_error), where.half_width))
            writer.write(simulator.look(), state.time, step.command, state.speed)
    return read_driving_logs([folder]).rows, np.array(truth)


def recording_figures(folder: Path) -> dict[str, float | str]:
    """Return what is found in a recording."""
    parts = list(continuous_segments(read_driving_logs([folder]).rows))
    motions = [motion_of(part) for part in parts]
    by_camera = {
        camera: [find_road(list(part[camera]), motion) for part, motion in zip(parts, motions, strict=True)]
        for camera in ("left", "center", "right")
    }
    left, centre, right = (np.concatenate([road.line.offsets for road in roads]) for roads in by_camera.values())
    return {
        "recording": folder.name,
        f"left camera (-{SIDE_CAMERA_OFFSET})": float(np.median(left - centre)),
        f"right camera ({SIDE_CAMERA_OFFSET})": float(np.median(right - centre)),
        **{f"offset, {share} %": float(np.percentile(centre, share)) for share in (5, 50, 95)},
        "half width": float(np.median(np.concatenate([road.half_widths for road in by_camera["center"]]))),
        "clarity": float(np.mean([road.clarity for road in by_camera["center"]])),
    }


def table(figures: list[dict[str, float | str]]) -> str:
    """Return figures as a table, one row each."""
    return pd.DataFrame(figures).to_string(index=False, float_format="{:.2f}".format)


def main() -> None:
    """Train if asked to, and print the tables."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("recordings", type=Path, nargs="*")
    parser.add_argument("--train", action="store_true", help="make the network's file anew first")
    options = parser.parse_args()
    if options.train:
        train()
    print(table([built_in_errors(track) for track in CHECKED]))
    if options.recordings:
        print("\n" + table([recording_figures(folder) for folder in options.recordings]))


if __name__ == "__main__":
    main()
