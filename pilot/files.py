"""Atomic writing of files, and locks: neither a failure nor a second program destroys what is there."""

import errno
import glob
import os
import platform
import re
import shutil
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import IO

from filelock import FileLock, Timeout

FULL = {errno.ENOSPC, errno.EDQUOT, errno.EFBIG}
DAY = 24 * 60 * 60  # s
WITHOUT_LOCKS = {errno.ENOLCK, errno.EOPNOTSUPP}  # some network drives


class InUseError(RuntimeError):
    """Another program is using what was asked for; the message names it and what to do."""


def write_atomically(path: Path, write: Callable[[IO[bytes]], object]) -> None:
    """Write a file under a temporary name in the same folder, then rename it to `path`.

    If writing fails (full disk, Ctrl-C, power failure), `path` keeps its previous content.

    Args:
        path: path of the file; its folder is created if necessary.
        write: function that writes the content to the binary file that it is called with.

    Raises:
        OSError: the file cannot be written; the message names it and what to do.
    """
    with move_when_done(path) as temporary, temporary.open("wb") as file:
        write(file)
        file.flush()
        os.fsync(file.fileno())


@contextmanager
def move_when_done(path: Path) -> Iterator[Path]:
    """Provide a temporary path in the same folder, for a file or a folder.

    It is renamed to `path` unless the block raises; otherwise, what the block has written is removed.

    Raises:
        OSError: the file cannot be written; the message names it and what to do.
    """
    temporary = path.with_name(f".{path.name}.{platform.node()}-{os.getpid()}.part")
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        _remove_abandoned(path)
        yield temporary
        temporary.replace(path)
    except OSError as error:
        raise unwritable(path, error) from error
    finally:
        if temporary.is_dir():
            shutil.rmtree(temporary, ignore_errors=True)
        with suppress(OSError):
            temporary.unlink(missing_ok=True)


def refuse_existing(folder: Path) -> None:
    """Check that a folder that will be written does not exist.

    Raises:
        FileExistsError: it does.
    """
    if folder.exists():
        raise FileExistsError(f"{folder}: is there already; name another folder")


def _remove_abandoned(path: Path) -> None:
    """Remove what killed programs have left of their attempts to write a file."""
    name = re.compile(rf"\.{re.escape(path.name)}\.(?:(.*)-)?(\d+)\.part")
    for file in path.parent.glob(f".{glob.escape(path.name)}.*.part"):
        if found := name.fullmatch(file.name):
            with suppress(OSError):  # on Windows, a file that is being written cannot be removed
                if _has_ended(found[1], int(found[2])) or file.stat().st_mtime < time.time() - DAY:
                    file.unlink()


def _has_ended(host: str | None, process: int) -> bool:
    """Return whether a process has certainly ended; of those on other computers of a shared folder, nothing is known.

    Windows has no harmless signal to ask with. There, and if another program has got the process's number since, the
    file's age decides.
    """
    if host != platform.node() or os.name != "posix":
        return False
    try:
        os.kill(process, 0)
    except (ProcessLookupError, OverflowError):
        return True
    except PermissionError:  # it lives, and is another user's
        pass
    return False


def unwritable(path: Path, error: OSError) -> OSError:
    """Return an error that names the file which cannot be written, why, and what to do."""
    cure = "make room on the disk" if error.errno in FULL else "name another place"
    if isinstance(error, PermissionError):  # on Windows also while, say, a spreadsheet shows it
        cure = f"close the program that has it open, or {cure}"
    return OSError(f"{path}: cannot be written ({error.strerror or error}): {cure}")


@contextmanager
def sole_use(lock: Path, refusal: str) -> Iterator[None]:
    """Keep other programs out of the block that use the same lock file; it is removed at the end.

    The operating system holds the lock: that of a program that crashes or is killed ends with it, and the file that is
    left behind locks nothing. A drive without locks is used without: its user is not worse off than before.

    Args:
        lock: path of the lock file; its folder is created if necessary.
        refusal: message of the error if another program is in such a block.

    Raises:
        InUseError: another program holds the lock.
        OSError: the folder cannot be created or written to.
    """
    held = FileLock(lock, timeout=0)
    try:
        lock.parent.mkdir(parents=True, exist_ok=True)
        held.acquire()
    except Timeout:
        raise InUseError(refusal) from None
    except OSError as error:
        if error.errno not in WITHOUT_LOCKS:
            raise unwritable(lock.parent, error) from error
    try:
        yield
    finally:
        if os.name != "nt":  # removed while it is held, so that nobody else's is; on Windows, `release` does it
            with suppress(OSError):
                lock.unlink(missing_ok=True)
        held.release()
