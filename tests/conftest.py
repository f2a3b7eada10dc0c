"""Recordings made for the tests: a bright post in the picture says how the driver steered."""

import os
import shutil
import signal
import subprocess
from collections.abc import Callable, Iterator
from pathlib import Path

import cv2
import numpy as np
import pytest
import torch
from screen import HEIGHT, WIDTH, Screen

from pilot.model.steering_network import SteeringNetwork
from pilot.simulator.track import STEP, Track, closed_road

REPOSITORY = Path(__file__).parents[1]
RADIUS = 60.0  # metres, of the circular road

# a shell starts jobs in the background with Ctrl-C ignored, which the programs that the tests start would inherit
signal.signal(signal.SIGINT, signal.default_int_handler)


def pytest_addoption(parser: pytest.Parser) -> None:
    parser.addoption("--recordings", type=Path, help="folder of real recordings: also run the tests that need them")
    parser.addoption("--long", action="store_true", help="also run the tests that take minutes")


def pytest_collection_modifyitems(config: pytest.Config, items: list[pytest.Item]) -> None:
    for item in items:
        if item.get_closest_marker("long") and not config.getoption("--long"):
            item.add_marker(pytest.mark.skip(reason="takes minutes: --long runs it"))


@pytest.fixture(autouse=True)
def _cache_of_its_own(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Tests neither read nor fill the user's cache folder."""
    for name in ("XDG_CACHE_HOME", "LOCALAPPDATA"):
        monkeypatch.setenv(name, str(tmp_path / "user_cache"))


@pytest.fixture(autouse=True)
def _process_settings_of_its_own() -> Iterator[None]:
    """Commands that a test calls in this process change its threads, which the next test must not inherit."""
    threads, opencv_threads = torch.get_num_threads(), cv2.getNumThreads()
    yield
    torch.set_num_threads(threads)
    cv2.setNumThreads(opencv_threads)


def picture(steering: float, shift: float = 0.0) -> np.ndarray:
    """A 160x320x3 RGB frame with a post at the column that belongs to the steering."""
    frame = np.full((160, 320, 3), (90, 120, 160), np.uint8)
    frame[60:] = (100, 100, 100)
    column = int(160 + 120 * steering + shift)
    frame[72:130, max(column - 12, 0) : max(column + 12, 1)] = (250, 240, 40)
    return frame


def write_picture(path: Path, frame: np.ndarray) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    cv2.imwrite(str(path), frame[:, :, ::-1], [cv2.IMWRITE_JPEG_QUALITY, 75])


def random_frames(network: SteeringNetwork, count: int = 2, seed: int = 0) -> torch.Tensor:
    """Input of a network: `count` frames of noise or, if it sees more, histories."""
    history = (network.signature.frames,) if network.signature.history else ()
    generator = torch.Generator().manual_seed(seed)
    return torch.randint(0, 256, (count, *history, 160, 320, 3), dtype=torch.uint8, generator=generator)


def stamp(moment: int) -> str:
    """The time in a picture's name, 0.1 s a moment."""
    seconds, tenth = divmod(moment, 10)
    minutes, seconds = divmod(seconds, 60)
    return f"2016_12_01_13_{minutes:02d}_{seconds:02d}_{tenth}00"


def steering_of(moment: int) -> float:
    return round(0.6 * float(np.sin(moment / 5)), 4)


Recording = Callable[..., Path]


def write_recording(
    folder: Path,
    moments: int = 60,
    line: Callable[[int], str] | None = None,
    head: str = "",
    cameras: tuple[str, ...] = ("center", "left", "right"),
    end: str = "\n",
) -> Path:
    """Write a recording of `moments` time steps; line(moment) may say how a row of the log reads."""
    lines = []
    for moment in range(moments):
        steering = steering_of(moment)
        for camera in cameras:
            shift = {"center": 0, "left": 20, "right": -20}[camera]
            write_picture(folder / "IMG" / f"{camera}_{stamp(moment)}.jpg", picture(steering, shift))
        paths = [f"IMG/{camera}_{stamp(moment)}.jpg" for camera in cameras]
        lines.append(line(moment) if line else ",".join([*paths, f"{steering:g}", "0.9", "0", "25.5"]))
    folder.mkdir(exist_ok=True)
    (folder / "driving_log.csv").write_bytes((head + end.join(lines) + end).encode())
    return folder


@pytest.fixture
def recording(tmp_path: Path) -> Recording:
    """`write_recording` into a folder of the test's own."""
    return lambda name="laps", *arguments, **options: write_recording(tmp_path / name, *arguments, **options)


def straightest(track: Track) -> float:
    """Where the next 30 m of a road are as straight as they get, metres from its start."""
    bend = np.abs(track.curvatures)
    ahead = np.stack([np.roll(bend, -shift) for shift in range(round(30 / STEP))]).max(0)
    return float(ahead.argmin()) * STEP


def circle(height: float = 0.0) -> Track:
    """A road of 60 m radius, driven clockwise; `height` tilts it."""
    angles = np.linspace(0, 2 * np.pi, 24, endpoint=False)
    corners = np.column_stack([RADIUS * np.sin(angles), RADIUS * np.cos(angles), height * np.cos(angles)])
    return closed_road("circle", corners, 4.0)


@pytest.fixture(scope="module")
def screen(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Screen]:
    """A display that nobody sees."""
    for tool in ("Xvfb", "xdotool"):
        if shutil.which(tool) is None:
            pytest.skip(f"{tool} is not installed")
    folder = tmp_path_factory.mktemp("screen")
    # not :0, where Panda3D would look for a display if none is named
    first = 90 + os.getpid() % 1000  # tests that run at the same time would take the same one
    number = next(number for number in range(first, 9999) if not Path(f"/tmp/.X{number}-lock").exists())
    size = ("-screen", "0", f"{WIDTH}x{HEIGHT}x24")
    command = ["Xvfb", f":{number}", "-displayfd", "1", *size, "-nolisten", "tcp", "-fbdir", str(folder)]
    with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL) as server:
        try:
            assert server.stdout.readline().split() == [str(number).encode()]  # it is ready
            yield Screen(number, folder)
        finally:
            server.terminate()
