"""The longest wait of the driven car while the server is attacked."""

import contextlib
import multiprocessing
import time
from collections.abc import Iterator
from concurrent.futures import Future, ProcessPoolExecutor
from dataclasses import dataclass

from server_attacks import MESSAGE, Attack
from serving import Server
from wire import WireClient

FRAME_SECONDS = 0.04  # between two telemetry messages of the driven car, as in the simulator
PATIENCE = 60.0  # s, longest wait that is measured


@dataclass(frozen=True)
class Outcome:
    """What an attack did.

    Attributes:
        count: how often the attack tried.
        answers: number of telemetry messages of the driven car that were answered meanwhile.
        worst: longest time in s from a telemetry message to its answer.
        memory: growth of the server's resident memory in MB.
    """

    count: int
    answers: int
    worst: float
    memory: float


def withstand(server: Server, attack: Attack, seconds: float, *, rest: float = 1.0) -> Outcome:
    """Drive a car while the server is attacked, for the duration of the attack and `rest` seconds more."""
    with server.client() as car, attacking(server, attack, seconds) as count:
        car.socket.settimeout(PATIENCE)
        _answer(car)  # the car before may have to be recognised as gone first
        memory, waits, end = server.memory(), [0.0], float("inf")
        while time.monotonic() < end:
            waits.append(_answer(car))
            time.sleep(FRAME_SECONDS)
            if count.done():
                end = min(end, time.monotonic() + rest)
        return Outcome(count.result(), len(waits), max(waits), (server.memory() - memory) / 1024)


def _answer(car: WireClient) -> float:
    """Return the time in s from a telemetry message to the answer that drives the car."""
    began = time.perf_counter()
    car.send(MESSAGE)
    while car.answer()[0] != "steer":  # "manual": another car is driven
        car.send(MESSAGE)
    return time.perf_counter() - began


@contextlib.contextmanager
def attacking(server: Server, attack: Attack, seconds: float) -> Iterator[Future[int]]:
    """Attack a server in another process, which does not slow down the car that measures."""
    with ProcessPoolExecutor(1, multiprocessing.get_context("spawn")) as pool:
        pool.submit(attack, server.port, time.monotonic()).result()  # the process is ready
        yield pool.submit(attack, server.port, time.monotonic() + seconds)


def long_drive(server: Server, frames: int) -> Outcome:
    """Drive a car as fast as the server answers: `frames` at 25 per second of simulated time (100,000: 67 minutes)."""
    with server.client() as car:
        car.socket.settimeout(PATIENCE)
        waits = [_answer(car) for _ in range(frames // 100)]
        memory = server.memory()  # once all caches are warm
        waits += [_answer(car) for _ in range(frames - len(waits))]
        return Outcome(frames, len(waits), max(waits), (server.memory() - memory) / 1024)
