"""Turns of the connections that share the server's thread, so that none delays the answers to the driven car."""

import time

import eventlet
from eventlet.event import Event
from eventlet.queue import LightQueue

PAUSE = 3.0  # length of the pause after a turn, in lengths of the turn: all others together take a quarter of the time
LONGEST_TURN = 0.001  # s; a connection with more data than this waits for another turn


class Turns:
    """Gives turns in the order of asking, one at a time, and pauses after each.

    The driven car's connection takes no turns: it runs in the pauses, and waits for one turn at most.
    """

    def __init__(self) -> None:
        """Create the queue; turns are given from the call of `run` on."""
        self._asking: LightQueue = LightQueue()

    def wait(self) -> None:
        """Return when it is the caller's turn, which ends at the caller's next wait for anything."""
        turn = Event()
        self._asking.put(turn)
        turn.wait()

    def run(self) -> None:
        """Give turns, without end."""
        while True:
            turn = self._asking.get()
            began = time.perf_counter()
            turn.send()
            eventlet.sleep(0)  # the turn is taken now: green threads run until they wait
            eventlet.sleep(PAUSE * (time.perf_counter() - began))
