"""What hands do to keys, mouse and gamepad → steering and throttle; pure logic, without a window."""

from collections.abc import Callable
from dataclasses import dataclass, field

from pilot.simulator.clock import TickClock
from pilot.simulator.episode import CarState, Episode

STEERING_STEP = 0.05  # per tick: so a key takes 0.4 s to full lock, as in the real simulator
MOUSE_SPAN = 0.25  # of the window's width, that the mouse is dragged for full lock
DEAD_ZONE = 0.1  # of a stick: worn ones do not come to rest in their middle

LEFT, RIGHT = {"arrow_left", "a"}, {"arrow_right", "d"}
FORWARD, BACKWARD = {"arrow_up", "w"}, {"arrow_down", "s"}
MOUSE = "mouse1"
KEYS = {*LEFT, *RIGHT, *FORWARD, *BACKWARD, MOUSE}


@dataclass(frozen=True)
class Pad:
    """A gamepad now.

    Attributes:
        stick: -1..1, positive to the right.
        accelerator, brake: 0..1.
    """

    stick: float = 0.0
    accelerator: float = 0.0
    brake: float = 0.0


@dataclass
class Controls:
    """Hands on keys, mouse and gamepad.

    Attributes:
        held: keys (and mouse button) that are down, by Panda3D's names.
        pointer: 0..1, where the mouse is across the window.
        pad: the gamepad; None without one.
        steering: -1..1, where the wheels stand now.
    """

    held: set[str] = field(default_factory=set)
    pointer: float = 0.5
    pad: Pad | None = None
    steering: float = 0.0
    _grabbed: float = 0.5  # the pointer, when the mouse button went down

    def press(self, key: str) -> None:
        """A key goes down; keys that do not drive are ignored."""
        if key in KEYS:
            self.held.add(key)
        if key == MOUSE:
            self._grabbed = self.pointer

    def release(self, key: str) -> None:
        """A key goes up."""
        self.held.discard(key)

    def tick(self) -> tuple[float, float]:
        """The command (steering, throttle, -1..1 each) for the next 20 ms; call it once per tick."""
        self.steering = self._steer()
        return self.steering, self._throttle()

    def _steer(self) -> float:
        keys = bool(self.held & RIGHT) - bool(self.held & LEFT)
        if MOUSE in self.held:
            return _limit((self.pointer - self._grabbed) / MOUSE_SPAN)
        if self.pad and abs(self.pad.stick) > DEAD_ZONE and not keys:
            beyond = (abs(self.pad.stick) - DEAD_ZONE) / (1 - DEAD_ZONE)
            return _limit(beyond if self.pad.stick > 0 else -beyond)
        towards = float(keys)  # 0: released keys let the wheels come back
        return self.steering + min(max(towards - self.steering, -STEERING_STEP), STEERING_STEP)

    def _throttle(self) -> float:
        keys = bool(self.held & FORWARD) - bool(self.held & BACKWARD)
        pedals = self.pad.accelerator - self.pad.brake if self.pad else 0.0
        return _limit(keys + pedals)


def _limit(value: float) -> float:
    return min(max(value, -1.0), 1.0)


class ManualDriving:
    """Drives a car by hand in real time, a tick of 20 ms at a time whatever the frame rate.

    Attributes:
        done: never; the window ends it.
    """

    done = False

    def __init__(self, episode: Episode, controls: Controls, on_tick: Callable[[CarState], None] | None = None) -> None:
        self.episode, self.controls, self.on_tick = episode, controls, on_tick
        self._clock = TickClock()

    def advance(self, seconds: float) -> None:
        """Move the car by the time (s) that has passed."""
        for _ in range(self._clock.ticks(seconds)):
            state = self.episode.advance(*self.controls.tick())
            if self.on_tick is not None:
                self.on_tick(state)
