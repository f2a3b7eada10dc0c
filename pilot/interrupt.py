"""Ctrl-C at a moment that suits us: between two steps, when everything is consistent."""

import signal
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from types import FrameType


class Interrupt:
    """Whether the user asked to stop; asking a second time stops at once."""

    def __init__(self) -> None:
        self.asked = False

    def ask(self, signal_number: int, _frame: FrameType | None) -> None:
        """Handle SIGINT or SIGTERM."""
        if self.asked:
            raise KeyboardInterrupt
        self.asked = True

    def raise_if_asked(self) -> None:
        """End with KeyboardInterrupt, now that everything is consistent, if the user asked to stop."""
        if self.asked:
            raise KeyboardInterrupt


@contextmanager
def catch_interrupt() -> Iterator[Interrupt]:
    """Turn SIGINT and SIGTERM into `Interrupt.asked` while the block runs (in the main thread only)."""
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
