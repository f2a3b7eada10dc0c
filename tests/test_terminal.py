"""What comes from files and the network reaches the terminal as text only."""

import subprocess
import sys
from pathlib import Path

import pytest
from conftest import REPOSITORY, Recording

from pilot import cli
from pilot.terminal import show

RED, TITLE, BACKWARDS = "\x1b[31m", "\x9d0;title\x07", "\u202egpj.exe"


def fail(message: str) -> None:
    raise ValueError(message)


def test_errors_show_control_characters_instead_of_obeying_them(capsys: pytest.CaptureFixture[str]) -> None:
    assert cli.run("video.py", lambda: fail(f"{RED}{TITLE}{BACKWARDS}\nvideo.py: all is well\x7f \udc80 – ° 路")) == 1
    assert capsys.readouterr().err == (
        r"video.py: \x1b[31m\x9d0;title\x07\u202egpj.exe\nvideo.py: all is well\x7f \udc80 – ° 路" + "\n"
    )


def test_a_very_long_error_is_cut_and_its_cure_remains(capsys: pytest.CaptureFixture[str]) -> None:
    cli.run("model.py", lambda: fail("log.csv: " + "x" * 3_000_000 + ". Record again"))
    error = capsys.readouterr().err
    assert len(error) < 2200
    assert error.startswith("model.py: log.csv: xxx")
    assert "[... 2998023 characters left out ...]" in error
    assert error.endswith(". Record again\n")


def test_tables_keep_their_own_lines(capsys: pytest.CaptureFixture[str]) -> None:
    show(f"recording  rows\n{RED}laps  60")
    assert capsys.readouterr().out == "recording  rows\n\\x1b[31mlaps  60\n"


LOGGING = """
import logging
from pilot import cli
def log():
    logging.getLogger("pilot").error("the server says: %s", "\\x1b[2J\\n12:00:00 all is well" + "x" * 5000)
    try:
        raise ValueError("\\x1b[2J")
    except ValueError:
        logging.getLogger("pilot").exception("failed")
cli.run("drive.py", log)
"""


def test_log_messages_are_single_lines_and_tracebacks_keep_theirs() -> None:
    result = subprocess.run([sys.executable, "-c", LOGGING], cwd=REPOSITORY, capture_output=True, text=True)
    first, second, *traceback = result.stderr.splitlines()
    assert r"the server says: \x1b[2J\n12:00:00 all is well" in first
    assert "characters left out" in first
    assert second.endswith("failed")
    assert traceback[-1] == r"ValueError: \x1b[2J"
    assert "\x1b" not in result.stderr


@pytest.mark.skipif(sys.platform == "win32", reason="no such file names on Windows")
def test_names_of_recordings_are_escaped_in_the_tables_of_a_training(recording: Recording, tmp_path: Path) -> None:
    recording(f"laps{RED}", moments=4)
    command = [sys.executable, str(REPOSITORY / "model.py"), "--data", ".", "--epochs", "1"]
    result = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True)
    assert r"laps\x1b[31m" in result.stdout
    assert RED not in result.stdout
