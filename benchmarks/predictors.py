"""Correlation of the steering error and of replays with the autonomy of models in the closed loop.

    python benchmarks/predictors.py MODEL... --tracks mountain random:3000 random:3001

On each built-in track, the expert is recorded while it weaves in its lane by about half a metre. Each model drives a
lap of the track, and is also evaluated on the recording: by its error against the recorded steering, and by replays
whose reference line is the road detected in the images or the recorded path. Results are written to a CSV file
immediately, and models in that file are not evaluated again.
"""

import argparse
import functools
import operator
import sys
from pathlib import Path

import numpy as np
import pandas as pd
from matplotlib.figure import Figure
from tqdm import tqdm

sys.path.insert(0, str(Path(__file__).parents[1]))

from pilot import process_settings
from pilot.data.driving_log import read_driving_logs
from pilot.data.frames import read_frame
from pilot.driving.plan import SteeringPolicy
from pilot.evaluation.closed_loop import DriveRequest, ModelPolicy, run
from pilot.evaluation.conditions import Conditions, expand_tracks
from pilot.evaluation.replay import Replayable, ReplayConfig, along_path, prepare, replay
from pilot.simulator.demonstration import DemonstrationConfig
from pilot.simulator.demonstrations import record
from pilot.simulator.scores import score
from pilot.training import plots
from pilot.workers import run_tasks

WANDERING = DemonstrationConfig(laps=1, rate=10, wander=0.5)
PATH_LIMITS = (1.0, 2.0)
PREDICTORS = {
    "mse": "mean squared error",
    "road": "replay, by the road",
    **{f"path {limit:g} m": f"replay, by the driver's path, {limit:g} m" for limit in PATH_LIMITS},
}


def record_missing(folder: Path, track: str) -> Path:
    """Record the weaving expert on a track, unless it has been recorded, and return the folder of the recording."""
    target = folder / track.replace(":", "-").replace(" ", "-")
    if not target.exists():
        unfinished = target.with_name(f".{target.name}.part")
        record(track, WANDERING, unfinished, listed_as=target)
        unfinished.rename(target)
    return target


def judge(folder: Path, track: str, models: list[Path]) -> list[dict[str, object]]:
    """Return the results of the models on a track, one row per model."""
    rows = read_driving_logs([record_missing(folder, track)]).rows
    recording = prepare(rows)
    return [
        {
            "model": path.stem,
            "track": track,
            "reference": recording.reference,
            "clarity": recording.clarity,
            **_true(path, track),
            **_predicted(ModelPolicy(path)(), rows, recording),
        }
        for path in models
    ]


def _true(path: Path, track: str) -> dict[str, float]:
    scores = score(track, [run(DriveRequest(ModelPolicy(path), track, Conditions()))])
    return {"autonomy": scores.autonomy, "offset": scores.cross_track_mean}


def _predicted(steer: SteeringPolicy, rows: pd.DataFrame, recording: Replayable) -> dict[str, float]:
    predicted = np.array([steer(read_frame(path)) for path in rows["center"]])
    figures = {"mse": float(((predicted - rows["steering"]) ** 2).mean())}
    figures["road"] = score("", replay(recording, steer)).autonomy
    by_path = Replayable(tuple(along_path(each.rows, each.motion) for each in recording.segments), "path", 0.0)
    for limit in PATH_LIMITS:
        figures[f"path {limit:g} m"] = score("", replay(by_path, steer, ReplayConfig(limit))).autonomy
    return figures


def correlations(results: pd.DataFrame) -> pd.DataFrame:
    """Return the Spearman correlation of each predictor with the autonomy: per track, and of each model's means."""
    parts = dict(list(results.groupby("track")))
    parts["mean of the tracks"] = results.groupby("model").mean(numeric_only=True)
    return pd.DataFrame(
        {
            name: {title: part["autonomy"].corr(part[column], "spearman") for column, title in PREDICTORS.items()}
            for name, part in parts.items()
        }
    ).T


def draw(results: pd.DataFrame) -> Figure:
    """Draw the autonomy in the closed loop over three predictors, with a point for each model and track."""
    figure = Figure((14, 4.6), layout="constrained")
    for axis, column in zip(figure.subplots(1, 3, sharey=True), ("mse", "path 1 m", "road"), strict=True):
        for track, part in results.groupby("track"):
            axis.scatter(part[column], part["autonomy"], s=22, label=track)
        axis.set(xlabel=PREDICTORS[column] + ("" if column == "mse" else ": autonomy, %"))
        axis.grid(alpha=0.3)
    figure.axes[0].set(xscale="log", ylabel="autonomy in the closed loop, %")
    figure.axes[0].legend(fontsize=8)
    return figure


def main() -> None:
    """Evaluate what is missing from the results file, and print and draw the results."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("models", type=Path, nargs="+")
    parser.add_argument("--tracks", nargs="+", default=["mountain", "random:3000-3003"])
    parser.add_argument("--data", type=Path, default=Path("predictors"), help="folder for recordings and results")
    options = parser.parse_args()
    results_file = options.data / "results.csv"
    options.data.mkdir(parents=True, exist_ok=True)
    results = pd.read_csv(results_file) if results_file.exists() else pd.DataFrame(columns=["model", "track"])
    jobs = [
        (track, [path for path in options.models if path.stem not in set(results[results.track == track].model)])
        for track in expand_tracks(options.tracks)
    ]
    todo = [functools.partial(judge, options.data, *job) for job in jobs if job[1]]
    for _, rows in tqdm(run_tasks(operator.call, todo, None, process_settings.for_driving), "tracks", len(todo)):
        results = pd.concat([results, pd.DataFrame(rows)])
        results.to_csv(results_file, index=False)
    print(results.to_string(index=False, float_format="{:.4g}".format))
    print(correlations(results).to_string(float_format="{:.2f}".format))
    plots.save(draw(results), options.data / "predictors.png")


if __name__ == "__main__":
    main()
