"""Runs all attacks and prints a table of what they achieved: python tests/hostile/report.py (see --help).

Takes 10 minutes. Waits and times are meaningful on an idle computer only.
"""

import argparse
import logging
import math
import multiprocessing
import os
import resource
import signal
import sys
import tempfile
import time
from collections.abc import Iterator
from concurrent.futures import ProcessPoolExecutor
from dataclasses import replace
from pathlib import Path

sys.path[:0] = [str(Path(__file__).parents[depth]) for depth in (2, 1, 0)]

from driven_car import attacking, long_drive, withstand
from file_attacks import FILE_ATTACKS, FileAttack, Finding
from power_attacks import POWER_ATTACKS
from server_attacks import ATTACKS, Attack, many_floods, rebinding
from serving import Server

HEADS = ("test", "count", "got through", "worst wait of the car, s", "time, s", "memory, MB")
LONGEST_WAIT = 0.1  # s, of the driven car; an attack that makes it wait longer has got through
OPEN_FILES = 256  # as macOS allows


def title(attack: Attack | FileAttack) -> str:
    """Return what an attack does, as its docstring says."""
    return (attack.__doc__ or attack.__name__).partition("\n")[0].rstrip(".")


def row(name: str, count: int, through: int, wait: float, seconds: float, memory: float) -> str:
    """Return a line of a Markdown table; figures that are NaN are left empty."""
    figures = [f"{wait:.2f}", f"{seconds:.1f}", f"{memory:.0f}"]
    return " | ".join(["", name, f"{count:,}", f"{through}", *figures, ""]).strip().replace("nan", "")


# The server


def server_rows(seconds: float, frames: int) -> Iterator[str]:
    """Yield a row for each attack on a server that drives a car, for the long drive, and for Ctrl-C."""
    with tempfile.TemporaryDirectory() as folder:
        server = Server(Path(folder), open_files=OPEN_FILES)
        try:
            for attack in ATTACKS:
                outcome = withstand(server, attack, seconds)
                through = int(outcome.worst > LONGEST_WAIT)
                yield row(title(attack), outcome.count, through, outcome.worst, math.nan, outcome.memory)
            through = rebinding(server.port, time.monotonic() + 10)
            yield row(title(rebinding), 8, through, math.nan, math.nan, math.nan)
            if frames:
                began, outcome = time.monotonic(), long_drive(server, frames)
                taken = time.monotonic() - began
                through = int(outcome.worst > LONGEST_WAIT)
                yield row("A drive as fast as it is answered", frames, through, outcome.worst, taken, outcome.memory)
            yield row("Ctrl-C during an attack", 1, 0, math.nan, _end(server), math.nan)
        finally:
            server.process.kill()


def _end(server: Server) -> float:
    """Return the time in s from Ctrl-C to the end of the process, while it is flooded."""
    with attacking(server, many_floods, 2.0):
        time.sleep(0.5)
        began = time.monotonic()
        server.process.send_signal(signal.SIGINT)
        server.process.wait(60)
        return time.monotonic() - began


# Files


def file_row(attack: FileAttack) -> str:
    """Return the row of an attack with files, which is made by a process of its own."""
    with tempfile.TemporaryDirectory() as folder, ProcessPoolExecutor(1, multiprocessing.get_context("spawn")) as pool:
        found = pool.submit(_measured, attack, Path(folder)).result()
    return row(title(attack), found.tries, found.through, math.nan, found.seconds, found.memory)


def _measured(attack: FileAttack, folder: Path) -> Finding:
    logging.disable()
    os.environ["XDG_CACHE_HOME"] = str(folder / "user_cache")
    os.chdir(folder)
    began, before = time.monotonic(), _peak()
    found = attack(folder)
    if math.isnan(found.seconds):
        return replace(found, seconds=time.monotonic() - began, memory=_peak() - before)
    return found


def _peak() -> float:
    """Return this process's peak memory so far in MB."""
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024


def main() -> None:
    """Print the table, row by row."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seconds", type=float, default=4.0, help="duration of each attack on the server")
    parser.add_argument("--frames", type=int, default=100_000, help="length of the long drive")
    parser.add_argument("--files-only", action="store_true", help="skip the attacks on the server")
    options = parser.parse_args()
    print(" | ".join(["", *HEADS, ""]).strip(), "|".join(["", *(["---"] * len(HEADS)), ""]), sep="\n", flush=True)
    for line in [] if options.files_only else server_rows(options.seconds, options.frames):
        print(line, flush=True)
    for attack in [*FILE_ATTACKS, *POWER_ATTACKS]:
        print(file_row(attack), flush=True)


if __name__ == "__main__":
    main()
