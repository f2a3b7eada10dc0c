"""Attacks with files: damaged models, recordings from strangers, folders of others, power cuts.

Each attack is a function of an empty folder; it returns what it tried, and how often it got through.
"""

import contextlib
import io
import math
import os
import random
import struct
import zipfile
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
import torch
from conftest import picture, stamp, write_picture, write_recording
from server_attacks import png_bomb

from pilot.commands import drive, evaluate, simulator, train, video
from pilot.data.driving_log import NoUsableData, read_driving_logs
from pilot.data.frame_cache import FrameCache
from pilot.data.frames import read_frame
from pilot.driving.recorder import FolderInUseError, Recorder
from pilot.model.build import build_network
from pilot.model.checkpoint import FORMAT, Model, UnusableModel, load_model, save_model

ESCAPE = "\x1b"
LONGEST_OUTPUT = 10_000  # characters that a command prints about a hostile log


@dataclass(frozen=True)
class Finding:
    """What an attack found.

    Attributes:
        tries: how often it tried.
        through: how often it had the effect that it must not have.
        seconds: how long it took; NaN: as long as the function.
        memory: peak memory in MB; NaN: that of the process.
    """

    tries: int
    through: int
    seconds: float = math.nan
    memory: float = math.nan


FileAttack = Callable[[Path], Finding]


# Models


def flipped_models(folder: Path) -> Finding:
    """A model file with one bit changed: it loads with other weights."""
    model = _saved(folder / "model.pt")
    content, rng = (folder / "model.pt").read_bytes(), random.Random(1)
    through = 0
    for _ in range(300):
        damaged = bytearray(content)
        damaged[rng.randrange(len(content))] ^= 1 << rng.randrange(8)
        (folder / "flipped.pt").write_bytes(damaged)
        with contextlib.suppress(UnusableModel):
            through += not _same_weights(load_model(folder / "flipped.pt"), model)
    return Finding(300, through)


def _saved(path: Path) -> Model:
    model = Model("lenet", build_network("lenet", 1), {}, {}, {})
    save_model(path, model)
    return model


def _same_weights(first: Model, second: Model) -> bool:
    states = first.network.state_dict(), second.network.state_dict()
    return all(torch.equal(value, states[1][key]) for key, value in states[0].items())


class _Command:
    """Runs a command when it is unpickled."""

    def __reduce__(self) -> tuple[object, tuple[str]]:
        return os.system, ("touch owned",)


def crafted_models(folder: Path) -> Finding:
    """Model files with weights that are not finite, code, tensors of terabytes, compressed zeros: they load."""
    network = build_network("lenet", 1)
    for name, value in (("nan", torch.nan), ("infinite", torch.inf)):
        next(network.parameters()).data[0] = value
        save_model(folder / f"{name}.pt", Model("lenet", network, {}, {}, {}))
    torch.save({"format": _Command()}, folder / "code.pt")
    torch.save({"format": FORMAT, "weights": {"a": torch.zeros(1).expand(1 << 40)}}, folder / "repeated.pt")
    torch.save({"format": FORMAT, "weights": {"a": torch.zeros(1000)}}, folder / "small.pt")
    longer = (b"M" + struct.pack("<H", 1000), b"J" + struct.pack("<i", 2_000_000_000))  # the pickled number of elements
    _copy_archive(folder / "small.pt", folder / "declared.pt", longer)
    with zipfile.ZipFile(folder / "compressed.pt", "w", zipfile.ZIP_DEFLATED) as bomb:
        bomb.writestr("data.pkl", bytes(500_000_000))
    models = sorted(folder.glob("*.pt"))
    return Finding(len(models), sum(map(loads, models)) + (folder / "owned").exists())


def _copy_archive(source: Path, target: Path, replaced: tuple[bytes, bytes]) -> None:
    with zipfile.ZipFile(source) as old, zipfile.ZipFile(target, "w") as new:
        for name in old.namelist():
            new.writestr(name, old.read(name).replace(*replaced))


def loads(model: Path) -> bool:
    """Whether a model file can be used."""
    try:
        load_model(model)
    except UnusableModel:
        return False
    return True


# Recordings


def image_bombs(folder: Path) -> Finding:
    """Images in a recording that decode to gigabytes: they are not left out."""
    recording, count = write_recording(folder / "laps", 40, cameras=("center",)), 20
    small = (recording / "IMG" / f"center_{stamp(0)}.jpg").read_bytes()
    jpeg = bytearray(small)
    at = jpeg.index(b"\xff\xc0") + 5  # height and width in the header
    jpeg[at : at + 4] = struct.pack(">HH", 60_000, 60_000)
    png = png_bomb(30_000)
    for moment in range(count):
        (recording / "IMG" / f"center_{stamp(moment)}.jpg").write_bytes(png if moment % 2 else jpeg)
    return Finding(count, len(read_driving_logs([recording]).rows) - 20)


def pipes_and_links(folder: Path) -> Finding:
    """Pipes, devices, folders and files from elsewhere instead of images: they are read."""
    recording = write_recording(folder / "laps", 40, cameras=("center",))
    write_picture(folder / "private.jpg", picture(0))
    images = [recording / "IMG" / f"center_{stamp(moment)}.jpg" for moment in range(8)]
    for image in images:
        image.unlink()
    for image in images[:2]:
        os.mkfifo(image)
    images[2].mkdir()
    for image, target in zip(images[3:], ["/dev/zero", "/dev/stdin", "../../private.jpg", images[7], "x"], strict=True):
        image.symlink_to(target)
    return Finding(len(images), len(read_driving_logs([recording]).rows) - 32)


def escapes_in_logs(folder: Path) -> Finding:
    """Terminal escapes and a line of 3 MB in a log: they are printed as they are."""
    hostile = [f"{ESCAPE}]0;owned\a", f"{ESCAPE}[2J", "x" * 3_000_000, "\x9b31m", "\u202egnp.exe"]
    outputs = []
    for number, text in enumerate(hostile):
        recording = write_recording(folder / f"laps{number}", 3, head=f"center,left,right,{text}\n")
        outputs += [output_of(train.main, "--data", str(recording), "--epochs", "1")]
    raw = [any(text in output for text in hostile) or len(output) > LONGEST_OUTPUT for output in outputs]
    return Finding(len(hostile), sum(raw))


def mutated_logs(folder: Path) -> Finding:
    """Logs with random changes: reading them raises something else than a message for the user."""
    recording, rng, tries, through = write_recording(folder / "laps", 20), random.Random(1), 500, 0
    log = recording / "driving_log.csv"
    content = log.read_bytes()
    pieces = [b",", b"\n", b'"', b"\0", b"\xff\xfe", b"nan", b"1e999", b"-", b";", b"center.jpg", b"9" * 200_000]
    for _ in range(tries):
        mutated = bytearray(content)
        for _ in range(rng.randrange(1, 20)):
            at = rng.randrange(len(mutated))
            mutated[at : at + rng.randrange(3)] = rng.choice(pieces) if rng.random() < 0.7 else rng.randbytes(2)
        log.write_bytes(mutated)
        try:
            read_driving_logs([recording])
        except NoUsableData:
            pass
        except Exception:
            through += 1
    return Finding(tries, through)


# What the user has


def foreign_folders(folder: Path) -> Finding:
    """drive.py --overwrite on folders that are no recordings of its own: files are deleted."""
    for number in range(20):
        write_picture(folder / "holidays" / f"IMG_{number:04d}.jpg", picture(0))
    laps = write_recording(folder / "laps", 20)
    before = sorted(folder.rglob("*"))
    for run in (folder / "holidays", laps):
        with contextlib.suppress(FolderInUseError):
            Recorder(run, overwrite=True).close()
    return Finding(len(before), len(before) - len([path for path in before if path.exists()]))


def damaged_caches(folder: Path) -> Finding:
    """Cache files with one byte changed: another frame is served."""
    recording, rng, tries, through = write_recording(folder / "laps", 20), random.Random(1), 100, 0
    paths = sorted(map(str, (recording / "IMG").iterdir()))
    frames = [read_frame(path) for path in paths]
    for _ in range(tries):
        FrameCache(limit=1 << 30, folder=folder / "cache").check(paths)
        (file,) = (folder / "cache").iterdir()
        with file.open("r+b") as cached:
            cached.seek(at := rng.randrange(file.stat().st_size))
            byte = cached.read(1)[0]
            cached.seek(at)
            cached.write(bytes([byte ^ 1 << rng.randrange(8)]))
        cache = FrameCache(limit=1 << 30, folder=folder / "cache")
        cache.check(paths)
        through += not all(np.array_equal(cache.read(path), frame) for path, frame in zip(paths, frames, strict=True))
    return Finding(tries, through)


# Commands


def wrong_options(folder: Path) -> Finding:
    """Options without sense, and files of the wrong kind: a command ends with a traceback, or without an error."""
    _saved(folder / "model.pt")
    (folder / "text.pt").write_text("not a model")
    (folder / "dots").mkdir()
    cv2.imwrite(str(folder / "dots" / "dot.jpg"), np.zeros((1, 1, 3), np.uint8))
    with contextlib.chdir(folder):
        tries = [(main, options) for main, lines in WRONG_OPTIONS.items() for options in lines]
        return Finding(len(tries), sum(not _fails_with_a_message(main, options.split()) for main, options in tries))


WRONG_OPTIONS: dict[Callable[[list[str]], int], list[str]] = {
    train.main: [
        f"--data dots {options}"
        for options in ("", "--epochs 0", "--batch-size 0", "--learning-rate nan", "--seed -1", "--cache-gb inf")
    ],
    drive.main: ["text.pt", "dots", "nowhere.pt", "model.pt model.pt"]
    + [f"model.pt {options}" for options in ("--port 99999", "--kp nan", "--host a..b", "--speed inf", "--unknown")],
    video.main: ["dots", "text.pt", "nowhere", "dots --fps nan", "dots --out x"],
    evaluate.main: [
        "text.pt",
        "nowhere.pt",
        "model.pt --recording dots",
        "model.pt --laps nan",
        "model.pt --track moon",
    ],
    simulator.main: ["record --out text.pt", "connect --port 0", "record --laps -1 --out dots", "dance", ""],
}


def _fails_with_a_message(main: Callable[[list[str]], int], options: list[str]) -> bool:
    with contextlib.redirect_stdout(io.StringIO()), contextlib.redirect_stderr(io.StringIO()):
        try:
            return main(options) != 0
        except SystemExit as end:
            return end.code != 0
        except Exception:
            return False


def output_of(main: Callable[[list[str]], int], *options: str) -> str:
    """Run a command in this process and return all that it prints."""
    output = io.StringIO()
    with contextlib.redirect_stdout(output), contextlib.redirect_stderr(output):
        main(list(options))
    return output.getvalue()


FILE_ATTACKS: list[FileAttack] = [
    flipped_models,
    crafted_models,
    image_bombs,
    pipes_and_links,
    escapes_in_logs,
    mutated_logs,
    foreign_folders,
    damaged_caches,
    wrong_options,
]
