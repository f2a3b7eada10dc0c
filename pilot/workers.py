"""Independent tasks in several processes, which end with this one: on Ctrl-C, after an error, or when it is killed."""

import multiprocessing
import os
import signal
import sys
import threading
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import Future, ProcessPoolExecutor, as_completed
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager
from multiprocessing.process import BaseProcess
from types import FrameType
from typing import TypeVar

Task = TypeVar("Task")
Result = TypeVar("Result")


class WorkerKilledError(RuntimeError):
    """A worker process has ended in the middle of a task; the message names the usual reason and the cure."""


def run_tasks(
    do: Callable[[Task], Result],
    tasks: Sequence[Task],
    processes: int | None = None,
    set_up: Callable[[], None] | None = None,
) -> Iterator[tuple[int, Result]]:
    """Do tasks side by side; yields the number of each and its result as it is done.

    Args:
        do: what is done with a task; like the tasks, the results and `set_up`, it must be picklable.
        tasks: what is to be done.
        processes: at the same time; one for each core if None. One task or process is done in this process.
        set_up: called once in each worker process, for its process-wide settings.

    Raises:
        WorkerKilledError: a worker process was killed.
        Whatever `do` raises; the other tasks are given up.
    """
    processes = min(processes or os.cpu_count() or 1, len(tasks))
    if processes <= 1:
        yield from ((number, do(task)) for number, task in enumerate(tasks))
        return
    with _workers(processes, set_up) as executor:
        with _holding_ctrl_c():  # the first call starts the processes
            numbers: dict[Future[Result], int] = {
                executor.submit(_do, do, task): number for number, task in enumerate(tasks)
            }
        try:
            for future in as_completed(numbers):
                yield numbers[future], future.result()
        except BrokenProcessPool as error:
            raise WorkerKilledError(
                "a worker process was killed, as the system does when memory runs out: close other programs, or run "
                "fewer at the same time (--jobs)"
            ) from error


@contextmanager
def _workers(processes: int, set_up: Callable[[], None] | None) -> Iterator[ProcessPoolExecutor]:
    """Processes for the block; when it fails or is left early, what they are doing is ended."""
    others = set(multiprocessing.active_children())
    # spawned, not forked: the renderer and torch keep threads
    executor = ProcessPoolExecutor(processes, multiprocessing.get_context("spawn"), _begin, (set_up,))
    try:
        yield executor
    except BaseException:
        executor.shutdown(wait=False, cancel_futures=True)
        _end(set(multiprocessing.active_children()) - others)
        raise
    executor.shutdown()


def _end(workers: set[BaseProcess]) -> None:
    for worker in workers:
        worker.terminate()
    for worker in workers:
        worker.join()


def _begin(set_up: Callable[[], None] | None) -> None:
    """A worker leaves Ctrl-C to its parent, which ends it; and does not outlive that one."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    threading.Thread(target=_end_with_parent, daemon=True).start()
    if set_up:
        set_up()


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


def _do(do: Callable[[Task], Result], task: Task) -> Result:
    """Do a task in a worker; when the parent ends us, what the task started and wrote is cleared away."""
    signal.signal(signal.SIGTERM, _leave)
    try:
        return do(task)
    except SystemExit:
        os._exit(1)  # at once: the interpreter's own end may wait for locks that others hold
    finally:
        signal.signal(signal.SIGTERM, signal.SIG_DFL)


def _leave(_signal: int, _frame: FrameType | None) -> None:
    sys.exit(1)
