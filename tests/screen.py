"""A display that nobody sees, for tests of the window."""

import os
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np

REPOSITORY = Path(__file__).parents[1]
WIDTH, HEIGHT = 960, 540
PATIENCE = 30.0  # s


class Screen:
    """A display that nobody sees: what is on it, and keys pressed on it."""

    def __init__(self, number: int, folder: Path) -> None:
        self.environment = {**os.environ, "DISPLAY": f":{number}"}
        self._file = folder / "Xvfb_screen0"

    def picture(self) -> np.ndarray:
        """What is on it: rows x columns x 3, RGB."""
        data = self._file.read_bytes()
        head = np.frombuffer(data[:100], ">u4")  # XWD: size of the header, ..., columns, rows, ..., colours
        start = int(head[0] + 12 * head[19])
        pixels = np.frombuffer(data[start : start + 4 * WIDTH * HEIGHT], np.uint8)
        return pixels.reshape(HEIGHT, WIDTH, 4)[:, :, 2::-1]

    def do(self, *what: str) -> None:
        subprocess.run(["xdotool", *what], env=self.environment, check=True, capture_output=True, timeout=PATIENCE)

    @contextmanager
    def run(self, script: str, *arguments: str) -> Iterator[subprocess.Popen[str]]:
        with subprocess.Popen(
            [sys.executable, *(["-c"] if "\n" in script else []), script, *arguments],
            env=self.environment,
            cwd=REPOSITORY,
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
        ) as process:
            impatience = threading.Timer(10 * PATIENCE, process.kill)  # each step has its own limit
            impatience.start()
            try:
                yield process
            finally:
                impatience.cancel()
                process.kill()


def wait_for(true: Callable[[], bool], seconds: float = PATIENCE) -> None:
    deadline = time.monotonic() + seconds
    while not true():
        assert time.monotonic() < deadline
        time.sleep(0.05)
