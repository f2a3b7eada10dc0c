"""What a driver's own laps add to a ready-made model: fine-tuned on their first part, judged on the rest.

    python benchmarks/fine_tune.py RECORDING --start MODEL [--elsewhere RECORDING...] -- [OPTION...]

MODEL must not have seen RECORDING, for example one of benchmarks/held_out.py. The options after -- are those of
model.py. Printed are the figures of that benchmark before and after, on the last part of the recording and on the
recordings of other drivers, and how long the training took.
"""

import argparse
import sys
import time
from pathlib import Path

import pandas as pd

sys.path.insert(0, str(Path(__file__).parents[1]))

from benchmarks.held_out import judge, prepared, split_words, train
from pilot.data.driving_log import read_driving_logs, share_of_each


def main() -> None:
    """Fine-tune, judge both models, and print the figures."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("recording", type=Path)
    parser.add_argument("--start", type=Path, required=True)
    parser.add_argument("--elsewhere", type=Path, nargs="*", default=[], help="recordings of other drivers")
    parser.add_argument("--first-part", type=float, default=0.75, help="share of the recording to train on")
    parser.add_argument("--out", type=Path, default=Path("fine_tuned.pt"))
    words, training = split_words(sys.argv[1:])
    options = parser.parse_args(words)
    began = time.monotonic()
    part = ["--samples.first-part", str(options.first_part), "--start", str(options.start)]
    train(options.out, [options.recording], [*part, *training])
    print(f"trained in {time.monotonic() - began:.0f} s")
    rows = {"own": share_of_each(read_driving_logs([options.recording]).rows, options.first_part, 1.0)}
    rows |= {folder.name: read_driving_logs([folder]).rows for folder in options.elsewhere}
    figures = [
        {"recording": name, "model": moment, **judge(model, part_rows, replayable)}
        for name, part_rows in rows.items()
        for replayable in [prepared(part_rows)]  # once for both models
        for moment, model in (("before", options.start), ("after", options.out))
    ]
    print(pd.DataFrame(figures).to_string(index=False, float_format="{:.3g}".format))


if __name__ == "__main__":
    main()
