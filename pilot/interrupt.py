"""Deferred handling of Ctrl-C: programs stop between two steps, when their state is consistent."""

import signal
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from types import FrameType


class Interrupt:
    """A request by the user to stop; a second request raises KeyboardInterrupt immediately.

    Attributes:
        asked: whether the user has requested to stop.
    """

    def __init__(self) -> None:
        self.asked = False

    def ask(self, signal_number: int, _frame: FrameType | None) -> None:
        """Handle SIGINT or SIGTERM (a signal handler)."""
        if self.asked:
            raise KeyboardInterrupt
        self.asked = True

    def raise_if_asked(self) -> None:
        """Raise KeyboardInterrupt if the user has requested to stop; to be called between two steps."""
        if self.asked:
            raise KeyboardInterrupt


@contextmanager
def catch_interrupt() -> Iterator[Interrupt]:
    """Turn SIGINT and SIGTERM into `Interrupt.asked` within the block; no effect outside the main thread."""
    interrupt = Interrupt()
    if threading.current_thread() is not threading.main_thread():
        yield interrupt
        return
    before = {number: signal.signal(number, interrupt.ask) for number in (signal.SIGINT, signal.SIGTERM)}
    try:
        yield interrupt
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)
