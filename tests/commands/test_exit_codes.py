"""Wrong options of simulator.py and drive.py, and the exit codes of all commands."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

from pilot import cli
from pilot.commands import drive, simulator


@pytest.mark.parametrize("word", ["connect", "drive"])  # drive: its former name
def test_connect_has_two_names(word: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert simulator.main([word, "--fast"]) == 1
    assert capsys.readouterr().err == "simulator.py: --fast: a window shows real time; add --headless\n"


@pytest.mark.parametrize(
    ("arguments", "says"),
    [
        (["connect", "--headless", "--port", "99999"], "--port 99999: must lie in 1..65535"),
        (["connect", "--headless", "--host", "no..host"], "--host no..host: no such computer"),
        (["connect", "--headless", "--host", "a\udcff"], "no such computer"),
        (["connect", "--headless", "--laps", "nan"], "--laps nan: must be greater than 0"),
        (["record", "--out", "laps", "--seed", "-1"], "seed -1: takes 0 to"),
    ],
)
def test_wrong_options_of_the_simulator_are_named(
    arguments: list[str], says: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert simulator.main(arguments) == 1
    assert says in capsys.readouterr().err


@pytest.mark.parametrize(
    ("arguments", "says"),
    [
        (["--port", "99999"], "--port 99999: must lie in 1..65535"),
        (["--host", "no..host"], "--host no..host: no such computer"),
        (["--kp", "nan"], "--kp nan: must be a number"),
        (["--smoothing", "inf"], "--smoothing inf: must be a number"),
        (["--ki", "-1"], "--ki -1: must be a number, and not negative"),
    ],
)
def test_wrong_options_of_the_server_are_named(
    arguments: list[str], says: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert drive.main(["model.pt", *arguments]) == 1
    assert says in capsys.readouterr().err


def test_errors_and_ctrl_c_end_every_command_alike(capsys: pytest.CaptureFixture[str]) -> None:
    def interrupted() -> None:
        raise KeyboardInterrupt("no clip was written")

    def failing() -> None:
        raise OSError("the disk is full: make room")

    assert cli.run("video.py", interrupted) == 130
    assert cli.run("video.py", failing) == 1
    assert cli.run("video.py", lambda: None) == 0
    assert capsys.readouterr().err == "\nInterrupted: no clip was written.\nvideo.py: the disk is full: make room\n"


@pytest.mark.parametrize("script", ["evaluate.py", "model.py"])
def test_the_help_may_be_read_in_part(script: str) -> None:
    command = [sys.executable, str(Path(cli.__file__).parents[1] / script), "--help"]
    reading, writing = os.pipe()
    os.close(reading)  # as head does
    done = subprocess.run(command, stdout=writing, stderr=subprocess.PIPE, text=True, check=False)
    os.close(writing)
    assert done.stderr == ""
