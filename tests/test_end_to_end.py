"""The whole job on a fresh machine: record, train, drive the lake through the socket (minutes; `--long` runs it)."""

import contextlib
import os
import re
import signal
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest
from conftest import REPOSITORY
from wire import free_port

LAPS = 3


def command(script: str, *arguments: str) -> list[str]:
    return [sys.executable, str(REPOSITORY / script), *arguments]


@contextlib.contextmanager
def serving(folder: Path, *arguments: str) -> Iterator[subprocess.Popen[str]]:
    """drive.py, once it says that it is ready."""
    with subprocess.Popen(command("drive.py", *arguments), cwd=folder, stdout=subprocess.PIPE, text=True) as process:
        assert process.stdout is not None
        assert "is ready" in process.stdout.readline()
        try:
            yield process
        finally:
            os.kill(process.pid, signal.SIGINT)
            process.wait(20)


@pytest.mark.long
def test_a_model_of_the_default_command_drives_the_lake(tmp_path: Path) -> None:
    trained = subprocess.run(command("model.py"), cwd=tmp_path, capture_output=True, text=True, timeout=1500)
    assert trained.returncode == 0, trained.stderr
    assert "the built-in simulator records demonstration laps" in trained.stdout
    port = str(free_port())
    with serving(tmp_path, "model.pt", "--port", port, "--speed", "20", "--frame-seconds", "0.04"):
        driven = subprocess.run(
            command(
                "simulator.py",
                "connect",
                "--track",
                "lake",
                "--laps",
                str(LAPS),
                "--headless",
                "--fast",
                "--port",
                port,
            ),
            cwd=tmp_path,
            capture_output=True,
            text=True,
            timeout=900,
        )
    assert driven.returncode == 0, driven.stderr
    print(trained.stdout, driven.stdout)
    laps = re.search(r"lake: ([\d.]+) laps", driven.stdout)
    assert laps
    assert float(laps[1]) >= LAPS
    assert "0 departures from the road" in driven.stdout, driven.stdout
