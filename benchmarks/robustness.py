"""How a model's steering depends on the look of the frames, and where it is unsure.

    python benchmarks/robustness.py MODEL RECORDING... [--map map.png]

Every frame is also shown as other graphics settings, monitors and lights would show it. For each change: its
correlation with the driver's steering averaged over half a second, and how much the steering changes (root mean square,
as a share of the steering's standard deviation). Uncertainty is the standard deviation of a frame's steering over all
changes and its mirror image. It is worth something if the error is larger where the uncertainty is; with --map, it is
drawn where the recordings were driven.
"""

import argparse
import sys
from collections.abc import Callable
from pathlib import Path

import cv2
import numpy as np
import pandas as pd
from matplotlib.cm import ScalarMappable
from matplotlib.colors import Normalize
from matplotlib.figure import Figure
from tqdm import tqdm

sys.path.insert(0, str(Path(__file__).parents[1]))

from benchmarks.fidelity import LEAST_MATCH, find_segments
from pilot.arrays import Floats, Frame
from pilot.data.augment import brightness, saturation, shadow
from pilot.data.driving_log import read_driving_logs
from pilot.data.frames import encode_frame, read_frame
from pilot.data.samples import smooth_steering
from pilot.driving.driver import Driver
from pilot.simulator.catalogue import load_track
from pilot.training import plots
from pilot.training.report import SMOOTHED_SECONDS
from pilot.vehicle import COLUMNS, ROWS

Change = Callable[[Frame], Frame]
PARTS = 4  # equally large parts of the frames, by their uncertainty


def coarse(frame: Frame) -> Frame:
    """Return a frame of half the resolution, as of a small window without anti-aliasing."""
    small = frame[::2, ::2]
    return np.asarray(cv2.resize(small, (COLUMNS, ROWS), interpolation=cv2.INTER_NEAREST), np.uint8)


def soft(frame: Frame) -> Frame:
    """Return a blurred frame, as of coarse textures."""
    return np.asarray(cv2.GaussianBlur(frame, (0, 0), 1.5), np.uint8)


def flat(frame: Frame) -> Frame:
    """Return a frame of 60 % of the contrast, as in fog."""
    return np.asarray(0.6 * frame + 0.4 * frame.mean(), np.uint8)


def compressed(frame: Frame) -> Frame:
    """Return a frame after a JPEG compression of low quality."""
    return np.asarray(cv2.imdecode(np.frombuffer(encode_frame(frame, 25), np.uint8), cv2.IMREAD_COLOR_RGB), np.uint8)


def beside(right: bool) -> Change:
    """Return the change that lays one side of the road into a hard shadow."""
    return lambda frame: shadow(frame, 0.5 * COLUMNS, 0.5 * COLUMNS, right, 0.4)


CHANGES: dict[str, Change] = {
    "as recorded": lambda frame: frame,
    "half the resolution": coarse,
    "blurred": soft,
    "60 % of the contrast": flat,
    "half as bright": lambda frame: brightness(frame, 0.5),
    "1.4 times as bright": lambda frame: brightness(frame, 1.4),
    "no colours": lambda frame: saturation(frame, 0.0),
    "hard shadow on the left": beside(right=False),
    "hard shadow on the right": beside(right=True),
    "JPEG quality 25": compressed,
}
MIRRORED = "mirrored"


def steer_changed(steer: Callable[[Frame], float], frames: list[str]) -> pd.DataFrame:
    """Return the steering for each frame (rows) and change (columns)."""
    rows = []
    for path in tqdm(frames, "frames", leave=False):
        frame = read_frame(path)
        changed = {name: steer(change(frame)) for name, change in CHANGES.items()}
        rows.append({**changed, MIRRORED: -steer(np.ascontiguousarray(frame[:, ::-1]))})
    return pd.DataFrame(rows)


def change_table(steering: pd.DataFrame, driver: Floats) -> pd.DataFrame:
    """Return the figures of each change."""
    plain = steering["as recorded"]
    return pd.DataFrame(
        {
            "correlation": steering.corrwith(pd.Series(driver)),
            "change": np.sqrt(steering.sub(plain, axis=0).pow(2).mean()) / plain.std(),
        }
    )


def uncertainty_table(steering: pd.DataFrame, driver: Floats) -> pd.DataFrame:
    """Return the mean uncertainty, size of steering and error of equally large parts of the frames, by uncertainty."""
    plain = steering["as recorded"]
    figures = pd.DataFrame(
        {"uncertainty": steering.std(axis=1), "driver's steering": np.abs(driver), "error": np.abs(plain - driver)}
    )
    part = pd.qcut(figures["uncertainty"].rank(method="first"), PARTS, labels=[f"part {n + 1}" for n in range(PARTS)])
    return figures.groupby(part, observed=True).mean()


def draw_map(folders: list[Path], uncertainty: dict[str, float]) -> Figure:
    """Draw the uncertainty (by the centre image's path) where the recordings were driven."""
    figure = Figure((12, 6), layout="constrained")
    segments = [segment for segment in find_segments(folders) if segment.match.correlation >= LEAST_MATCH]
    scale = Normalize(0, float(np.percentile(list(uncertainty.values()), 98)))
    for axis, name in zip(figure.subplots(1, 2), ("lake", "jungle"), strict=True):
        axis.plot(*load_track(name).points[:, :2].T, color="0.8", linewidth=5, zorder=0)
        for segment in (each for each in segments if each.match.track.name.startswith(name)):
            track = segment.match.track
            points = np.array([track.at(progress)[:2] for progress in segment.match.progress])
            values = [uncertainty[path] for path in segment.rows["center"]]
            axis.scatter(*points.T, c=values, s=9, norm=scale)
        axis.set(title=name, aspect="equal", xlabel="east, m", ylabel="north, m")
    figure.colorbar(ScalarMappable(scale), ax=figure.axes, label="uncertainty of the steering")
    return figure


def main() -> None:
    """Print the tables of each recording and of all, and draw the map."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("model", type=Path)
    parser.add_argument("recordings", type=Path, nargs="+")
    parser.add_argument("--map", type=Path, help="draw the uncertainty on the tracks")
    options = parser.parse_args()
    steer = Driver.load(options.model).steer
    uncertainty: dict[str, float] = {}
    changes: dict[str, pd.DataFrame] = {}
    for folder in options.recordings:
        rows = read_driving_logs([folder]).rows
        driver = np.asarray(smooth_steering(rows, SMOOTHED_SECONDS), np.float64)
        steering = steer_changed(steer, list(rows["center"]))
        uncertainty |= dict(zip(rows["center"], steering.std(axis=1), strict=True))
        changes[folder.name] = change_table(steering, driver)
        print(f"\n{folder.name}\n{changes[folder.name].round(2)}\n{uncertainty_table(steering, driver).round(3)}")
    means = pd.concat(changes.values()).groupby(level=0, sort=False).mean()
    print(f"\nmean of the recordings\n{means.round(2)}")
    if options.map:
        plots.save(draw_map(options.recordings, uncertainty), options.map)


if __name__ == "__main__":
    main()
