"""What killed programs leave behind is removed by the next one that writes the same file."""

import os
import platform
import subprocess
import sys
import time
from pathlib import Path

import pytest
from conftest import REPOSITORY

from pilot.files import move_when_done, write_atomically

WRITING = """
import sys, time
from pathlib import Path
from pilot.files import write_atomically
def write(file):
    print("writing", flush=True)
    time.sleep(60)
write_atomically(Path(sys.argv[1]), write)
"""


def writing(path: Path) -> subprocess.Popen[str]:
    """A process that is writing a file."""
    command = [sys.executable, "-c", WRITING, str(path)]
    process = subprocess.Popen(command, cwd=REPOSITORY, stdout=subprocess.PIPE, text=True)
    assert process.stdout
    assert process.stdout.readline() == "writing\n"
    return process


def test_a_file_that_another_program_keeps_open_is_named(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def refuse(_self: Path, _target: Path) -> None:  # as Windows does
        raise PermissionError(13, "Access is denied")

    path = tmp_path / "history.csv"
    path.write_text("before")
    monkeypatch.setattr(Path, "replace", refuse)
    with pytest.raises(OSError, match=r"history.csv: cannot be written \(Access is denied\): close the program"):
        write_atomically(path, lambda file: file.write(b"new"))
    assert [file.name for file in tmp_path.iterdir()] == ["history.csv"]
    assert path.read_text() == "before"


@pytest.mark.skipif(os.name != "posix", reason="elsewhere only the age of a file tells")
def test_what_a_killed_program_left_is_removed_and_what_a_living_one_writes_is_not(tmp_path: Path) -> None:
    path = tmp_path / "samples.png"
    living, killed = writing(path), writing(path)
    try:
        killed.kill()
        killed.communicate()
        assert len(list(tmp_path.glob(".samples.png.*.part"))) == 2
        write_atomically(path, lambda file: file.write(b"new"))
        assert [file.name for file in tmp_path.glob(".*")] == [f".samples.png.{platform.node()}-{living.pid}.part"]
    finally:
        living.kill()
        living.communicate()
    assert path.read_bytes() == b"new"


def test_on_other_computers_only_what_is_older_than_a_day_is_removed(tmp_path: Path) -> None:
    old, new, other = (tmp_path / name for name in (".a.png.far-1.part", ".a.png.far-2.part", ".b.png.far-1.part"))
    for file in (old, new, other):
        file.write_bytes(b"")
    for file in (old, other):
        os.utime(file, (time.time() - 100_000,) * 2)
    write_atomically(tmp_path / "a.png", lambda file: file.write(b"new"))
    assert sorted(file.name for file in tmp_path.iterdir()) == [".a.png.far-2.part", ".b.png.far-1.part", "a.png"]


def test_of_a_folder_that_could_not_be_written_nothing_is_left(tmp_path: Path) -> None:
    def write(*, fails: bool) -> None:
        with move_when_done(tmp_path / "folder") as unfinished:
            unfinished.mkdir()
            (unfinished / "file").write_text("half")
            if fails:
                raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        write(fails=True)
    assert list(tmp_path.iterdir()) == []
    write(fails=False)
    assert (tmp_path / "folder" / "file").read_text() == "half"
