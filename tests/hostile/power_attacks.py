"""Attacks on what is kept: power cuts, kills, full disks, two programs at once, very large data.

Each attack is a function of an empty folder, as in file_attacks.py. Most start the commands as processes.
"""

import contextlib
import os
import random
import re
import resource
import signal
import subprocess
import sys
import time
from collections.abc import Iterator, Sequence
from pathlib import Path

import numpy as np
import torch
from conftest import REPOSITORY, picture, stamp, write_picture, write_recording
from file_attacks import Finding, loads, output_of

from pilot.commands import train
from pilot.data.driving_log import read_driving_logs
from pilot.data.recording_writer import RecordingWriter
from pilot.files import write_atomically
from pilot.model.build import build_network
from pilot.model.checkpoint import Model, load_model, save_model

SMALL = ["--network", "lenet", "--samples.block-seconds", "1", "--batch-size", "32", "--cache-gb", "0"]
ROWS = 1_000_000


def _command(*options: str) -> list[str]:
    return [sys.executable, str(REPOSITORY / "model.py"), *options]


def _quiet(command: Sequence[str], folder: Path) -> "subprocess.Popen[bytes]":
    pipe = subprocess.DEVNULL
    return subprocess.Popen(command, cwd=folder, stdin=pipe, stdout=pipe, stderr=pipe, start_new_session=True)


def _wait_for(file: Path, seconds: float = 120) -> None:
    deadline = time.monotonic() + seconds
    while not file.exists():
        if time.monotonic() > deadline:
            raise TimeoutError(f"{file} was not written in {seconds:g} s")
        time.sleep(0.02)


def _weights(model: Path) -> torch.Tensor:
    return torch.cat([value.flatten() for value in load_model(model).network.state_dict().values()])


# Power cuts


@contextlib.contextmanager
def _forgetful_disk() -> Iterator[list[tuple[str, bool]]]:
    """Note of each file that is renamed whether a power cut just afterwards would leave it whole.

    A disk may write the new name before the data, unless the data was flushed with fsync before.
    """
    synced: dict[int, int] = {}  # size up to which a file is on the disk, by its number
    renamed: list[tuple[str, bool]] = []
    fsync, replace = os.fsync, os.replace

    def noting_fsync(file: int) -> None:
        fsync(file)
        status = os.fstat(file)
        synced[status.st_ino] = status.st_size

    def noting_replace(source: Path, target: Path) -> None:
        status = os.stat(source)
        renamed.append((Path(target).suffix, synced.get(status.st_ino) == status.st_size))
        replace(source, target)

    os.fsync, os.replace = noting_fsync, noting_replace
    try:
        yield renamed
    finally:
        os.fsync, os.replace = fsync, replace


def power_cuts_in_training(folder: Path) -> Finding:
    """A power cut after any renaming in a training, with all that was not flushed lost: a state or a model is torn."""
    write_recording(folder / "laps", 60)
    with _forgetful_disk() as renamed, contextlib.chdir(folder):
        output_of(train.main, "--data", "laps", "--epochs", "5", *SMALL)
    models = [whole for suffix, whole in renamed if suffix == ".pt"]
    return Finding(len(models), len(models) - sum(models))


def power_cuts_in_recordings(folder: Path) -> Finding:
    """The last images empty, cut off or zeros, and the log cut off: rows before are lost, or a wrong one is read."""
    rng, tries, through = random.Random(1), 100, 0
    log = _log_of(folder / "laps")
    steering = [float(row.split(",")[3]) for row in log.splitlines()]
    images = {path: path.read_bytes() for path in (folder / "laps" / "IMG").iterdir()}
    for _ in range(tries):
        kept = rng.randrange(10, 38)
        for path, content in images.items():
            remains = rng.choice([b"", content[: rng.randrange(len(content))], bytes(len(content))])
            path.write_bytes(remains if path.name >= f"center_{stamp(kept)}" else content)
        cut = log[: rng.randrange(len(log) * kept // 40, len(log))] + rng.choice(["", 100 * "\0"])
        (folder / "laps" / "driving_log.csv").write_text(cut)
        rows = read_driving_logs([folder / "laps"]).rows
        recorded = [steering[line - 1] for line in rows["line"]]
        through += len(rows) < kept - 1 or recorded != rows["steering"].tolist()
    return Finding(tries, through)


def _log_of(folder: Path) -> str:
    write_recording(folder, 40, cameras=("center",), line=_line)
    return (folder / "driving_log.csv").read_text()


def _line(moment: int) -> str:
    return f"center_{stamp(moment)}.jpg,,,{np.sin(moment):.6f},0.5,0,20.125"


# Kills and full disks


def killed_trainings(folder: Path) -> Finding:
    """A training killed and resumed five times: the model is not that of a training left alone."""
    write_recording(folder / "laps", 100)
    options, rng = ["--data", "laps", "--epochs", "20", *SMALL], random.Random(1)
    with _quiet(_command(*options, "--out", "whole.pt"), folder) as whole:
        whole.wait(300)
    for kill in range(5):
        with _quiet(_command(*([] if kill == 0 else ["--resume"]), *(options if kill == 0 else [])), folder) as process:
            _wait_for(folder / "model_report" / "state.pt")
            time.sleep(rng.uniform(1, 6))
            os.killpg(process.pid, signal.SIGKILL)
    if not (folder / "model.pt").exists():
        with _quiet(_command("--resume"), folder) as process:
            process.wait(300)
    return Finding(5, int(not torch.equal(_weights(folder / "model.pt"), _weights(folder / "whole.pt"))))


def killed_writers(folder: Path) -> Finding:
    """Programs killed while they write a file: the file is torn, or what they left stays after the next writing."""
    names = ["model.pt", "samples.png", "run1.mp4", "history.csv"]
    for name in names:
        write_atomically(folder / name, lambda file: file.write(b"old"))
        code = (
            "import os, sys; from pathlib import Path; from pilot.files import move_when_done\n"
            "with move_when_done(Path(sys.argv[1])) as path:\n path.write_bytes(b'half'); os.kill(os.getpid(), 9)"
        )
        subprocess.run([sys.executable, "-c", code, str(folder / name)], cwd=REPOSITORY, check=False)
    torn = sum((folder / name).read_bytes() != b"old" for name in names)
    for name in names:
        write_atomically(folder / name, lambda file: file.write(b"new"))
    return Finding(len(names), torn + len(list(folder.iterdir())) - len(names))


def full_disks(folder: Path) -> Finding:
    """A disk that becomes full while a model, a drive or a recording is saved: what was there is lost or torn."""
    rng, frame, through, limits = random.Random(1), picture(0), 0, resource.getrlimit(resource.RLIMIT_FSIZE)
    save_model(folder / "model.pt", Model("lenet", build_network("lenet", 1), {}, {}, {}))
    with RecordingWriter(folder / "laps") as writer:
        for moment in range(5):
            writer.write(dict.fromkeys(("center", "left", "right"), frame), moment / 10, (0.1, 0.2), 9.0)
        size = min(path.stat().st_size for path in (folder / "laps" / "IMG").iterdir())
        for moment in range(5, 55):
            resource.setrlimit(resource.RLIMIT_FSIZE, (rng.randrange(size), limits[1]))
            try:
                with contextlib.suppress(OSError):
                    save_model(folder / "model.pt", Model("lenet", build_network("lenet", 2), {}, {}, {}))
                with contextlib.suppress(OSError):
                    writer.write(dict.fromkeys(("center", "left", "right"), frame), moment / 10, (0.1, 0.2), 9.0)
            finally:
                resource.setrlimit(resource.RLIMIT_FSIZE, limits)
            through += not loads(folder / "model.pt") or len(list((folder / "laps" / "IMG").iterdir())) != 15
    return Finding(50, through + (len(read_driving_logs([folder / "laps"]).rows) != 5))


# Several processes


def second_trainings(folder: Path) -> Finding:
    """A second training with the same --out, under three names: it is not refused, or harms the first."""
    write_recording(folder / "laps", 60)
    options = ["--data", "laps", *SMALL]
    with _quiet(_command(*options, "--epochs", "10000", "--patience", "10000"), folder) as first:
        _wait_for(folder / "model_report" / "history.csv")
        seconds = [[*options, "--epochs", "1"], [*options, "--epochs", "1", "--out", "./model.bin"], ["--resume"]]
        through = sum(_quiet(_command(*second), folder).wait(120) == 0 for second in seconds)
        through += first.poll() is not None
        os.killpg(first.pid, signal.SIGKILL)
    with _quiet(_command(*options, "--epochs", "1"), folder) as after:  # the lock of a killed one holds nobody up
        return Finding(3, through + (after.wait(120) != 0))


def killed_ranks(folder: Path) -> Finding:
    """One of torchrun's two processes killed: the other trains on or hangs, or the training cannot be resumed."""
    write_recording(folder / "laps", 100)
    options = ["--data", "laps", "--epochs", "200", "--patience", "200", *SMALL]
    launcher = [sys.executable, "-m", "torch.distributed.run", "--standalone", "--nproc-per-node=2"]
    with _quiet([*launcher, *_command(*options)[1:]], folder) as launched:
        _wait_for(folder / "model_report" / "state.pt")
        ranks = _children(launched.pid)
        os.kill(ranks[-1], signal.SIGKILL)
        through = int(launched.wait(90) == 0) + sum(Path(f"/proc/{rank}").exists() for rank in ranks)
    with _quiet(_command("--resume", "--epochs", "3"), folder) as resumed:
        resumed.wait(120)
    return Finding(1, through + (not (folder / "model.pt").exists()))


def _children(process: int) -> list[int]:
    return [int(child) for child in Path(f"/proc/{process}/task/{process}/children").read_text().split()]


# Size


def million_rows(folder: Path) -> Finding:
    """A log of a million rows: the first step of the training takes more than 20 s."""
    images = [f"{camera}_{stamp(moment)}.jpg" for moment in range(300) for camera in ("center", "left", "right")]
    for image in images:
        write_picture(folder / "laps" / "IMG" / image, picture(0.1))
    rng = np.random.default_rng(0)
    with (folder / "laps" / "driving_log.csv").open("w") as log:
        for row, (steering, speed) in enumerate(rng.uniform((-1, 0), (1, 30), (ROWS, 2))):
            center, left, right = images[3 * (row % 300) :][:3]
            log.write(f"IMG/{center},IMG/{left},IMG/{right},{steering:.7g},0.5,0,{speed:.7g}\n")
    began, text, pipe = time.monotonic(), b"", subprocess.PIPE
    command = _command("--data", "laps", "--epochs", "1")
    process = subprocess.Popen(command, cwd=folder, stdout=subprocess.DEVNULL, stderr=pipe)
    assert process.stderr
    while not re.search(rb"epoch 1/1: .* [1-9][0-9]*/", text):
        text = text[-500:] + os.read(process.stderr.fileno(), 4096)
    seconds = time.monotonic() - began
    memory = int(re.search(r"VmHWM:\s+(\d+)", Path(f"/proc/{process.pid}/status").read_text())[1]) / 1024
    process.kill()
    process.wait()
    return Finding(ROWS, int(seconds > 20), seconds, memory)


POWER_ATTACKS = [
    power_cuts_in_training,
    power_cuts_in_recordings,
    killed_trainings,
    killed_writers,
    full_disks,
    second_trainings,
    killed_ranks,
    million_rows,
]
