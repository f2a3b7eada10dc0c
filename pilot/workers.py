"""Independent tasks in worker processes, which end with this process: on Ctrl-C, after an error, or if it is killed."""

import multiprocessing
import os
import signal
import sys
import threading
from collections.abc import Callable, Generator, Iterator, Sequence
from concurrent.futures import Future, ProcessPoolExecutor, as_completed
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager
from multiprocessing.process import BaseProcess
from types import FrameType
from typing import TypeVar

GRACE_SECONDS = 5.0  # for a task to clean up after itself
Task = TypeVar("Task")
Result = TypeVar("Result")


class WorkerKilledError(RuntimeError):
    """A worker process has died during a task; the message names the usual cause and what to do."""


def run_tasks(
    do: Callable[[Task], Result],
    tasks: Sequence[Task],
    processes: int | None = None,
    set_up: Callable[[], None] | None = None,
) -> Generator[tuple[int, Result], None, None]:
    """Run tasks in parallel.

    Args:
        do: function that is called with each task; it, the tasks, the results and `set_up` must be picklable.
        tasks: the arguments of `do`.
        processes: number of worker processes; None: one per core. With a single task or process, the tasks run in this
            process, and `set_up` is not called.
        set_up: called once in each worker process to apply process-wide settings.

    Yields:
        The index of each task and its result, in the order of completion.

    Raises:
        WorkerKilledError: a worker process was killed.
        Exception: any that `do` raises; the other tasks are cancelled.
    """
    processes = min(processes or os.cpu_count() or 1, len(tasks))
    if processes <= 1:
        yield from ((number, do(task)) for number, task in enumerate(tasks))
        return
    with _workers(processes, set_up) as executor:
        with _holding_ctrl_c():  # the first `submit` starts the processes
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
    """Provide worker processes for the block; they end with it, and tasks still running are terminated.

    Not waiting for their interpreters to exit by themselves saves almost a second.
    """
    others = set(multiprocessing.active_children())
    # spawned, because a fork would not copy the threads of the renderer and PyTorch
    executor = ProcessPoolExecutor(processes, multiprocessing.get_context("spawn"), _begin, (set_up,))
    try:
        yield executor
    finally:
        executor.shutdown(wait=False, cancel_futures=True)
        _end(set(multiprocessing.active_children()) - others)


def _end(workers: set[BaseProcess]) -> None:
    for worker in workers:
        worker.terminate()
    for worker in workers:
        worker.join(GRACE_SECONDS)
        if worker.is_alive():  # the SystemExit was lost, as it is in a finaliser or in a callback of a C++ library
            worker.kill()
            worker.join()


def _begin(set_up: Callable[[], None] | None) -> None:
    """Initialise a worker: it ignores Ctrl-C, which its parent handles, and ends when the parent does."""
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
    """Block SIGINT within the block (not on Windows).

    Processes started meanwhile inherit this, so that Ctrl-C does not reach them before they ignore it.
    """
    if not hasattr(signal, "pthread_sigmask"):
        yield
        return
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


def _do(do: Callable[[Task], Result], task: Task) -> Result:
    """Run a task in a worker; SIGTERM from the parent raises SystemExit, so that the task cleans up after itself."""
    signal.signal(signal.SIGTERM, _leave)
    try:
        return do(task)
    except SystemExit:
        os._exit(1)  # the interpreter's regular exit may wait for locks that others hold
    finally:
        signal.signal(signal.SIGTERM, signal.SIG_DFL)


def _leave(_signal: int, _frame: FrameType | None) -> None:
    sys.exit(1)
