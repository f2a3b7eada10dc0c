"""Tasks in several processes."""

import functools
import multiprocessing
import os
import signal
import time
from pathlib import Path

import pytest

from pilot.workers import WorkerKilledError, run_tasks


def square(number: int) -> int:
    return number * number


def die(number: int) -> int:
    if number == 1:
        os.kill(os.getpid(), signal.SIGKILL)
    time.sleep(0.2)
    return number


def fail(number: int) -> int:
    if number == 1:
        raise ValueError("task 1 cannot be done")
    time.sleep(60)
    return number


def hold_on(number: int) -> int:
    """Go on for ever, as a task whose SystemExit is lost in a callback."""
    while number:
        try:
            time.sleep(60)
        except SystemExit:
            continue
    time.sleep(2)
    raise ValueError("zero")


def note(folder: Path) -> None:
    (folder / str(os.getpid())).touch()


def ended() -> bool:
    deadline = time.monotonic() + 10
    while multiprocessing.active_children() and time.monotonic() < deadline:
        time.sleep(0.05)
    return not multiprocessing.active_children()


@pytest.mark.parametrize("processes", [1, 2])
def test_every_task_is_done_once(processes: int) -> None:
    assert dict(run_tasks(square, range(5), processes)) == {number: number * number for number in range(5)}


def test_a_killed_worker_is_an_error_at_once_and_not_a_wait_for_ever() -> None:
    began = time.monotonic()
    with pytest.raises(WorkerKilledError, match="memory"):
        dict(run_tasks(die, range(4), 2))
    assert time.monotonic() - began < 30
    assert ended()


def test_an_error_ends_the_other_tasks() -> None:
    with pytest.raises(ValueError, match="task 1 cannot be done"):
        dict(run_tasks(fail, [1, 2], 2))
    assert ended()


def test_a_task_that_does_not_end_is_killed(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("pilot.workers.GRACE_SECONDS", 0.5)
    with pytest.raises(ValueError, match="zero"):
        list(run_tasks(hold_on, [0, 1], 2))
    assert ended()


def test_who_stops_listening_ends_the_tasks() -> None:
    results = run_tasks(functools.partial(square), range(1000), 2)
    next(results)
    results.close()
    assert ended()


def test_workers_are_set_up(tmp_path: Path) -> None:
    dict(run_tasks(square, range(4), 2, functools.partial(note, tmp_path)))
    assert {int(path.name) for path in tmp_path.iterdir()} - {os.getpid()}
    assert str(os.getpid()) not in os.listdir(tmp_path)
