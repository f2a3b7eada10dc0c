"""How well the data page finds faults: 5 % of each recording's rows are spoilt, and the top 5 % are looked at.

    python benchmarks/planted_faults.py RECORDING... [--seeds 3] [--networks]

Planted are, in stretches of at least `SHORTEST` rows: labels that come a second late, swapped side cameras, frozen
pictures, and a crash (the car stands with full lock and full throttle, and the picture stays). A short recording gets
one of them, another with each seed. Precision: the share of the top 5 % of the rows that are spoilt. Recall: the share
of the spoilt rows, of each kind, that are among the top 5 %. What a recording's driver did wrong by himself, such as a
real crash, counts as not spoilt.
"""

import argparse
import sys
from pathlib import Path

import numpy as np
import pandas as pd
from numpy.typing import NDArray

sys.path.insert(0, str(Path(__file__).parents[1]))

from pilot.data.driving_log import read_driving_logs
from pilot.inspection import suspicion
from pilot.inspection.cross_check import cross_predictions
from pilot.inspection.motion_seen import see_motion
from pilot.inspection.place_seen import see_place

KINDS = ("late labels", "swapped cameras", "frozen pictures", "crash")
SHARE = 0.05  # of the rows that are spoilt, and that are looked at
SHORTEST = 30  # rows of a stretch, two to three seconds
LATE_SECONDS = 1.0


def plant(rows: pd.DataFrame, seed: int, share: float = SHARE) -> tuple[pd.DataFrame, NDArray[np.object_]]:
    """Return a copy of the rows with faults, and the kind of each row's fault, "" without one."""
    random = np.random.default_rng(seed)
    rows, kind = rows.copy(), np.full(len(rows), "", object)
    count = min(max(int(share * len(rows)) // SHORTEST, 1), len(KINDS))
    length = int(share * len(rows)) // count
    for number in range(count):
        begin = int((number + random.uniform(0.1, 0.9)) * (len(rows) - length) / count)
        stretch = slice(max(begin, SHORTEST), max(begin, SHORTEST) + length)
        kind[stretch] = KINDS[(seed + number) % len(KINDS)]
        spoil(rows, stretch, KINDS[(seed + number) % len(KINDS)])
    return rows, kind


def spoil(rows: pd.DataFrame, stretch: slice, kind: str) -> None:
    """Plant one fault, in place."""
    index = rows.index[stretch]
    if kind == "late labels":
        late = round(LATE_SECONDS / float(rows["time"].diff().median()))
        rows.loc[index, "steering"] = rows["steering"].shift(late).loc[index].to_numpy()
    elif kind == "swapped cameras":
        rows.loc[index, ["left", "right"]] = rows.loc[index, ["right", "left"]].to_numpy()
    else:
        rows.loc[index, "center"] = rows.loc[index[0], "center"]
    if kind == "crash":
        rows.loc[index, ["speed", "steering", "throttle"]] = (0.0, 1.0, 1.0)


def find(rows: pd.DataFrame, *, networks: bool, share: float = SHARE) -> NDArray[np.int64]:
    """Return the numbers of the most suspicious rows, a share of all."""
    scores = {
        **suspicion.scores_of_log(rows),
        **suspicion.scores_of_images(rows, see_motion(rows["center"].tolist())),
        **suspicion.scores_of_places(rows, see_place(rows)),
    }
    if networks:
        scores |= suspicion.scores_of_predictions(rows, cross_predictions(rows))
    order = np.argsort(-suspicion.row_scores(scores), kind="stable")
    return np.asarray(order[: int(share * len(rows))])


def main() -> None:
    """Plant, find, and print the figures."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("recordings", type=Path, nargs="+")
    parser.add_argument("--seeds", type=int, default=3)
    parser.add_argument(
        "--networks", action="store_true", help="also train networks on the halves, which takes minutes"
    )
    options = parser.parse_args()
    figures = []
    for folder in options.recordings:
        rows = read_driving_logs([folder], annotated=False).rows
        for seed in range(options.seeds):
            spoilt, kind = plant(rows, seed)
            top = find(spoilt, networks=options.networks)
            found = np.isin(np.arange(len(rows)), top)
            figures.append(
                {
                    "recording": folder.name,
                    "seed": seed,
                    "precision": (kind[top] != "").mean(),
                    "recall": found[kind != ""].mean(),
                    **{name: found[kind == name].mean() for name in KINDS if (kind == name).any()},
                }
            )
    table = pd.DataFrame(figures)
    print(table.to_string(index=False, float_format="{:.2f}".format))
    print(
        table.groupby("recording").mean(numeric_only=True).drop(columns="seed").to_string(float_format="{:.2f}".format)
    )


if __name__ == "__main__":
    main()
