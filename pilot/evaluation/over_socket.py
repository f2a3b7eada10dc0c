"""Closed-loop evaluation of drive.py, which drives the built-in simulator through its socket, as fast as possible."""

import os
import socket
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import asdict
from pathlib import Path

from pilot.evaluation.closed_loop import DriveRequest, ModelPolicy, film, simulator_at
from pilot.simulator.referee import Referee, time_limit
from pilot.simulator.simulator import Simulator
from pilot.simulator.trajectory import Trajectory
from pilot.simulator.wire.client import TICKS_PER_ANSWER, Client
from pilot.vehicle import TICK

PACKAGE = Path(__file__).parents[2]  # folder that contains `pilot`, which is not installed in a clone
PATIENCE_SECONDS = 30.0  # wall-clock time without an answer
START_SECONDS = 120.0  # drive.py imports PyTorch in 1 to 20 s
EPISODE_LOG = "episode.log"


def run_over_socket(request: DriveRequest) -> Trajectory:
    """Drive an episode through drive.py and return its trajectory.

    The latency is that of the protocol; `latency_ms` and `lost_frames` of the request are ignored.

    Raises:
        ValueError: there is no such track or light, or the driver is not a `ModelPolicy`.
        RuntimeError: drive.py does not start or ends too early; the message is the last line that it logged.
        TimeoutError: drive.py does not answer.
        OSError: the clip cannot be written.
    """
    simulator = simulator_at(request)
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        with _serving(request, folder) as (process, port):
            trajectory = _drive_by_server(simulator, request, process, port, folder)
        if request.clip is not None:
            film(folder / "run", request.clip)
    return trajectory


def _drive_by_server(
    simulator: Simulator, request: DriveRequest, process: "subprocess.Popen[str]", port: int, folder: Path
) -> Trajectory:
    conditions = request.conditions
    longest = time_limit(simulator.episode.track, conditions.laps, conditions.speed.speed)
    referee = Referee(simulator.episode, laps=conditions.laps, seconds=longest)
    client = Client(
        simulator.episode,
        lambda _: simulator.look()["center"],
        port=port,
        realtime=False,
        referee=referee,
    )
    heard = time.monotonic()
    try:
        while not referee.over:
            if client.step(0.1):
                heard = time.monotonic()
            elif process.poll() is not None:
                raise RuntimeError(_last_words(folder))
            elif time.monotonic() - heard > PATIENCE_SECONDS:
                raise TimeoutError(f"drive.py did not answer for {PATIENCE_SECONDS:g} s")
    finally:
        client.close()
    return referee.trajectory


@contextmanager
def _serving(request: DriveRequest, folder: Path) -> Iterator[tuple["subprocess.Popen[str]", int]]:
    """Start drive.py, yield its process and port once it is ready, and terminate it at the end of the block."""
    port = _free_port()
    with (
        (folder / EPISODE_LOG).open("w") as words,
        subprocess.Popen(
            _command(request, folder, port),
            stdout=subprocess.PIPE,
            stderr=words,
            text=True,
            env=_environment(),
        ) as process,
    ):
        try:
            _wait_until_ready(process, folder)
            yield process, port
        finally:
            process.terminate()
            try:
                process.wait(10)
            except subprocess.TimeoutExpired:
                process.kill()


def _wait_until_ready(process: "subprocess.Popen[str]", folder: Path) -> None:
    assert process.stdout is not None
    giving_up = threading.Timer(START_SECONDS, process.kill)
    giving_up.start()
    try:
        if "is ready" not in process.stdout.readline():
            raise RuntimeError(_last_words(folder))
    finally:
        giving_up.cancel()


def _command(request: DriveRequest, folder: Path, port: int) -> list[str]:
    if not isinstance(request.driver, ModelPolicy):
        raise ValueError("--socket: drive.py needs a model file")
    run = [str(folder / "run")] if request.clip is not None else []
    options = [
        word
        for name, value in asdict(request.conditions.speed).items()
        for word in (f"--{name.replace('_', '-')}", str(value))
    ]
    clock = ["--frame-seconds", str(TICKS_PER_ANSWER * TICK)]
    return [
        sys.executable,
        "-m",
        "pilot.commands.drive",
        str(request.driver.path),
        *run,
        "--port",
        str(port),
        *clock,
        *options,
    ]


def _environment() -> dict[str, str]:
    paths = [str(PACKAGE), *filter(None, [os.environ.get("PYTHONPATH")])]
    return os.environ | {"OMP_NUM_THREADS": "1", "PYTHONPATH": os.pathsep.join(paths)}


def _free_port() -> int:
    with socket.create_server(("127.0.0.1", 0)) as probe:
        return int(probe.getsockname()[1])


def _last_words(folder: Path) -> str:
    lines = (folder / EPISODE_LOG).read_text().strip().splitlines()
    return lines[-1] if lines else "drive.py exited without an error message"
