"""Several processes for independent jobs, which end with us: on Ctrl-C, when a job fails, or when we are killed."""

import multiprocessing
import os
import signal
import sys
import threading
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from types import FrameType
from typing import Generic, TypeVar

Job = TypeVar("Job")
Result = TypeVar("Result")


def run_jobs(
    do: Callable[[Job], Result],
    jobs: Sequence[Job],
    processes: int | None = None,
) -> Iterator[tuple[int, Result]]:
    """Do jobs side by side; yields the number of each and its result as it is done.

    Args:
        do: what is done with a job; like the jobs and results, it must be picklable.
        jobs: what is to be done.
        processes: at the same time; one for each core if None.

    Raises:
        Whatever `do` raises; the other jobs are given up.
    """
    processes = min(processes or os.cpu_count() or 1, len(jobs))
    if processes <= 1:
        yield from ((number, do(job)) for number, job in enumerate(jobs))
        return
    # spawned, not forked: the renderer and torch keep threads
    with _holding_ctrl_c():
        pool = multiprocessing.get_context("spawn").Pool(processes, _begin)
    with pool:
        yield from pool.imap_unordered(_Numbered(do), enumerate(jobs))


def _begin() -> None:
    """A worker leaves Ctrl-C to its parent, which ends it; and does not outlive that one."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    threading.Thread(target=_end_with_parent, daemon=True).start()


def _end_with_parent() -> None:
    parent = multiprocessing.parent_process()
    if parent is not None:
        parent.join()
        os.kill(os.getpid(), signal.SIGTERM)


@contextmanager
def _holding_ctrl_c() -> Iterator[None]:
    """Ctrl-C waits; processes that are started meanwhile do not see it either until they ignore it (not on Windows)."""
    if not hasattr(signal, "pthread_sigmask"):
        yield
        return
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


@dataclass(frozen=True)
class _Numbered(Generic[Job, Result]):
    """Does a job in a worker; when the parent ends us, what the job started and wrote is cleared away."""

    do: Callable[[Job], Result]

    def __call__(self, numbered: tuple[int, Job]) -> tuple[int, Result]:
        signal.signal(signal.SIGTERM, _leave)
        try:
            return numbered[0], self.do(numbered[1])
        except SystemExit:
            os._exit(1)  # at once: the interpreter's own end may wait for locks that others hold
        finally:
            signal.signal(signal.SIGTERM, signal.SIG_DFL)


def _leave(_signal: int, _frame: FrameType | None) -> None:
    sys.exit(1)
