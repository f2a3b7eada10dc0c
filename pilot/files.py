"""Writing files so that a failure never costs the user what was there before."""

import os
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import IO


def write_atomically(path: Path, write: Callable[[IO[bytes]], object]) -> None:
    """Write a file under a temporary name beside `path`, then rename it onto `path`.

    Whatever happens on the way (full disk, Ctrl-C, power), `path` holds either its old content
    or the whole new one.

    Raises:
        OSError: the folder cannot be made or written to.
    """
    with move_when_done(path) as temporary, temporary.open("wb") as file:
        write(file)
        file.flush()
        os.fsync(file.fileno())


@contextmanager
def move_when_done(path: Path) -> Iterator[Path]:
    """A temporary name beside `path` to write to; renamed onto `path` unless the block fails.

    Raises:
        OSError: the folder cannot be made or written to.
    """
    path.parent.mkdir(parents=True, exist_ok=True)
    temporary = path.with_name(f".{path.name}.{os.getpid()}.part")
    try:
        yield temporary
        temporary.replace(path)
    finally:
        temporary.unlink(missing_ok=True)
