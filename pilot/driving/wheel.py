"""Steering by a person, who takes over from the model and gives back."""

import time
from collections.abc import Callable
from dataclasses import dataclass

HELD_SECONDS = 0.5  # after the last command until the wheel counts as released: the page may have been closed


@dataclass(frozen=True)
class PersonCommand:
    """What a person commands instead of the model.

    Attributes:
        steering: -1..1, right is positive.
        throttle: -1..1; None: the speed controller goes on.
    """

    steering: float
    throttle: float | None = None


class Wheel:
    """The steering wheel of a person; whoever holds it must say so again at least every `HELD_SECONDS`."""

    def __init__(self, clock: Callable[[], float] = time.monotonic) -> None:
        """Create a wheel that nobody holds; `clock` returns the time in s."""
        self._clock = clock
        self._held: PersonCommand | None = None
        self._held_at = 0.0

    def hold(self, command: PersonCommand) -> None:
        """Take over, or go on to steer."""
        self._held, self._held_at = command, self._clock()

    def release(self) -> None:
        """Let the model steer again."""
        self._held = None

    @property
    def command(self) -> PersonCommand | None:
        """The person's command; None: the model steers."""
        if self._clock() - self._held_at > HELD_SECONDS:
            self._held = None
        return self._held
