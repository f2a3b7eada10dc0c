"""Atomic writing of files: a failure never destroys the previous content."""

import os
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import IO


def write_atomically(path: Path, write: Callable[[IO[bytes]], object]) -> None:
    """Write a file under a temporary name in the same folder, then rename it to `path`.

    If writing fails (full disk, Ctrl-C, power failure), `path` keeps its previous content.

    Args:
        path: path of the file; its folder is created if necessary.
        write: function that writes the content to the binary file that it is called with.

    Raises:
        OSError: the folder cannot be created or written to.
    """
    with move_when_done(path) as temporary, temporary.open("wb") as file:
        write(file)
        file.flush()
        os.fsync(file.fileno())


@contextmanager
def move_when_done(path: Path) -> Iterator[Path]:
    """Provide a temporary path in the same folder; it is renamed to `path` unless the block raises.

    Raises:
        OSError: the folder cannot be created or written to.
    """
    path.parent.mkdir(parents=True, exist_ok=True)
    temporary = path.with_name(f".{path.name}.{os.getpid()}.part")
    try:
        yield temporary
        temporary.replace(path)
    finally:
        temporary.unlink(missing_ok=True)
