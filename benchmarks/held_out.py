"""How well a recipe steers for drivers whom it has not seen: each driver's recordings are held out of one training.

    python benchmarks/held_out.py RECORDING... [--together NAME NAME] [--with FOLDER] [--beside MODEL] -- [OPTION...]

The options after -- are those of model.py, such as --recipe real --start models/built_in.pt. Recordings of one driver
(--together, by their folders' names) are held out together. Trained models and figures are kept in --out, and are not
made again, so that a long run can be interrupted and continued.

Figures of each recording: correlation with the driver's steering averaged over half a second; squared error, divided by
that of always answering its mean; the delay of the driver behind the network at which the correlation is highest, and
that correlation; autonomy in the replay.
"""

import argparse
import functools
import subprocess
import sys
from pathlib import Path

import numpy as np
import pandas as pd
from tqdm import tqdm

sys.path.insert(0, str(Path(__file__).parents[1]))

from pilot.arrays import Floats
from pilot.data.driving_log import read_driving_logs
from pilot.data.samples import smooth_steering
from pilot.driving.driver import Driver, steering_on
from pilot.evaluation.reference_path import UnusableRecording
from pilot.evaluation.replay import Replayable, prepare, replay
from pilot.simulator.scores import score
from pilot.training.report import SMOOTHED_SECONDS

LONGEST_DELAY = 0.6  # s


def groups_of(recordings: list[Path], together: list[list[str]]) -> list[list[Path]]:
    """Return the recordings by driver.

    Raises:
        ValueError: a name in `together` is no recording's.
    """
    by_name = {folder.name: folder for folder in recordings}
    if unknown := {name for names in together for name in names} - set(by_name):
        raise ValueError(f"--together {' '.join(sorted(unknown))}: no recording is called so")
    grouped = {name for names in together for name in names}
    alone = [[name] for name in by_name if name not in grouped]
    return [[by_name[name] for name in names] for names in together + alone]


def train(model: Path, folders: list[Path], options: list[str]) -> None:
    """Train a model on recordings, unless it exists.

    Raises:
        subprocess.CalledProcessError: the training failed; its message has been printed.
    """
    if not model.exists():
        data = [word for folder in folders for word in ("--data", str(folder))]
        program = Path(__file__).parents[1] / "model.py"
        subprocess.run([sys.executable, str(program), *data, "--out", str(model), *options], check=True)


def judge(model: Path, rows: pd.DataFrame, recording: Replayable | None) -> dict[str, float | str]:
    """Return the figures of a model on a recording; `recording` is None if it cannot be replayed."""
    driver = Driver.load(model)
    predicted = np.array(list(steering_on(driver, rows)))
    steering = np.asarray(smooth_steering(rows, SMOOTHED_SECONDS), np.float64)
    delay, delayed = best_delay(predicted, steering, float(rows["time"].diff().median()))
    return {
        "correlation": float(np.corrcoef(predicted, steering)[0, 1]),
        "error": float(((predicted - steering) ** 2).mean() / steering.var()),
        "delay": delay,
        "delayed": delayed,
        "replay": score("", replay(recording, driver)).autonomy if recording else float("nan"),
        "reference": recording.reference if recording else "",
    }


def best_delay(predicted: Floats, steering: Floats, pause: float) -> tuple[float, float]:
    """Return the delay of the steering behind the prediction with the highest correlation, in s, and the correlation.

    Args:
        predicted, steering: n each.
        pause: time between two rows in s.
    """
    rows = range(int(LONGEST_DELAY / pause) + 1)
    found = [(float(np.corrcoef(predicted[: len(predicted) - row], steering[row:])[0, 1]), row) for row in rows]
    correlation, row = max(found)
    return row * pause, correlation


def read(folder: Path, *, replayed: bool) -> tuple[pd.DataFrame, Replayable | None]:
    """Return the rows of a recording and, if it is to be replayed, what `prepared` makes of them."""
    rows = read_driving_logs([folder]).rows
    return rows, prepared(rows) if replayed else None


def prepared(rows: pd.DataFrame) -> Replayable | None:
    """Return a recording that is ready for replays; None if it cannot be replayed, for a reason that is printed."""
    try:
        return prepare(rows)
    except UnusableRecording as error:
        tqdm.write(f"no replay: {error}")
        return None


def split_words(words: list[str]) -> tuple[list[str], list[str]]:
    """Return the words before and after the first "--"."""
    end = words.index("--") if "--" in words else len(words)
    return words[:end], words[end + 1 :]


def summary(results: pd.DataFrame) -> pd.DataFrame:
    """Return the figures with the means of each model's recordings of a track (their names' first word) below."""
    numbers = results.assign(recording=results["recording"].str.extract(r"(^[a-z]+)")[0] + ", mean")
    means = numbers.groupby(["model", "recording"], as_index=False).mean(numeric_only=True)
    return pd.concat([results, means], ignore_index=True)


def main() -> None:
    """Train and judge what is missing, and print the figures."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("recordings", type=Path, nargs="+")
    parser.add_argument("--together", nargs="+", action="append", default=[], help="recordings of one driver")
    parser.add_argument("--with", type=Path, nargs="*", default=[], dest="always", help="data of all trainings")
    parser.add_argument("--beside", type=Path, nargs="*", default=[], help="models to judge on all recordings too")
    parser.add_argument("--out", type=Path, default=Path("held_out"), help="folder for models and figures")
    parser.add_argument("--no-replay", action="store_true", help="leave out the replays, which take most of the time")
    words, training = split_words(sys.argv[1:])
    options = parser.parse_args(words)
    options.out.mkdir(parents=True, exist_ok=True)
    figures = options.out / "figures.csv"
    results = pd.read_csv(figures) if figures.exists() else pd.DataFrame(columns=["model", "recording"])
    jobs: list[tuple[str, Path, Path]] = []
    for held_out in groups_of(options.recordings, options.together):
        model = options.out / f"without-{'-'.join(folder.name for folder in held_out)}.pt"
        others = [folder for folder in options.recordings if folder not in held_out]
        train(model, others + options.always, training)
        jobs += [("held out", model, folder) for folder in held_out]
    jobs += [(str(model), model, folder) for folder in options.recordings for model in options.beside]
    known = set(zip(results["model"], results["recording"], strict=True))
    ready = functools.lru_cache(maxsize=1)(functools.partial(read, replayed=not options.no_replay))
    jobs = sorted((job for job in jobs if (job[0], job[2].name) not in known), key=lambda job: job[2].name)
    for name, model, folder in tqdm(jobs, "judging"):
        found = judge(model, *ready(folder))
        results = pd.concat([results, pd.DataFrame([{"model": name, "recording": folder.name, **found}])])
        results.to_csv(figures, index=False)
    print(summary(results).to_string(index=False, float_format="{:.3g}".format))


if __name__ == "__main__":
    main()
