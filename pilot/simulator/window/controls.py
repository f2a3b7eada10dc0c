"""Steering and throttle from keys, mouse and gamepad; independent of the window."""

from collections.abc import Callable
from dataclasses import dataclass, field

from pilot.simulator.clock import TickClock
from pilot.simulator.episode import CarState, Episode

STEERING_STEP = 0.05  # per tick; a key reaches full lock in 0.4 s, as in the Unity simulator
MOUSE_SPAN = 0.25  # distance of dragging the mouse for full lock, as a share of the window's width
DEAD_ZONE = 0.1  # of the stick, because worn sticks do not return exactly to 0

NOTE_SECONDS = 4.0

LEFT, RIGHT = {"arrow_left", "a"}, {"arrow_right", "d"}
FORWARD, BACKWARD = {"arrow_up", "w"}, {"arrow_down", "s"}
MOUSE = "mouse1"
KEYS = {*LEFT, *RIGHT, *FORWARD, *BACKWARD, MOUSE}


@dataclass(frozen=True)
class Pad:
    """State of a gamepad.

    Attributes:
        stick: left stick's horizontal axis, -1..1, positive to the right.
        accelerator, brake: 0..1.
    """

    stick: float = 0.0
    accelerator: float = 0.0
    brake: float = 0.0


@dataclass
class Controls:
    """State of keys, mouse and gamepad, and the commands that result from it.

    Attributes:
        held: pressed driving keys and mouse button, by Panda3D's names.
        pointer: horizontal position of the mouse in the window, 0..1.
        pad: state of the gamepad; None without one.
        steering: current steering, -1..1.
    """

    held: set[str] = field(default_factory=set)
    pointer: float = 0.5
    pad: Pad | None = None
    steering: float = 0.0
    _grabbed: float = 0.5  # pointer when the mouse button was pressed

    def press(self, key: str) -> None:
        """Handle the press of a key; keys not used for driving are ignored."""
        if key in KEYS:
            self.held.add(key)
        if key == MOUSE:
            self._grabbed = self.pointer

    def release(self, key: str) -> None:
        """Handle the release of a key."""
        self.held.discard(key)

    @property
    def steers(self) -> bool:
        """Whether a person steers: a steering key, the mouse or the stick is held."""
        return bool(self.held & (LEFT | RIGHT | {MOUSE})) or (self.pad is not None and abs(self.pad.stick) > DEAD_ZONE)

    @property
    def pedals(self) -> bool:
        """Whether a person accelerates or brakes."""
        pad = self.pad is not None and max(self.pad.accelerator, self.pad.brake) > DEAD_ZONE
        return bool(self.held & (FORWARD | BACKWARD)) or pad

    def tick(self) -> tuple[float, float]:
        """Return the command (steering, throttle; -1..1 each) for the next tick; to be called once per tick."""
        self.steering = self._steer()
        return self.steering, self._throttle()

    def _steer(self) -> float:
        keys = bool(self.held & RIGHT) - bool(self.held & LEFT)
        if MOUSE in self.held:
            return _limit((self.pointer - self._grabbed) / MOUSE_SPAN)
        if self.pad and abs(self.pad.stick) > DEAD_ZONE and not keys:
            beyond = (abs(self.pad.stick) - DEAD_ZONE) / (1 - DEAD_ZONE)
            return _limit(beyond if self.pad.stick > 0 else -beyond)
        towards = float(keys)  # 0 without keys: the steering returns to the centre
        return self.steering + min(max(towards - self.steering, -STEERING_STEP), STEERING_STEP)

    def _throttle(self) -> float:
        keys = bool(self.held & FORWARD) - bool(self.held & BACKWARD)
        pedals = self.pad.accelerator - self.pad.brake if self.pad else 0.0
        return _limit(keys + pedals)


def _limit(value: float) -> float:
    return min(max(value, -1.0), 1.0)


class ManualDriving:
    """Moves the car of an episode by manual controls in real time, in ticks of 20 ms at any frame rate.

    Attributes:
        keys: text of the help.
        note: message to be displayed.
        done: always False; the drive ends when the window is closed.
    """

    keys, done = "Arrows/WASD drive    Mouse held steers    ", False

    def __init__(
        self,
        episode: Episode,
        controls: Controls,
        on_tick: Callable[[CarState], None] | None = None,
        is_lost: Callable[[Episode], bool] = lambda _: False,
    ) -> None:
        """Create a control.

        Args:
            episode: whose car is moved.
            controls: of the person.
            on_tick: called with the state after each tick.
            is_lost: whether the car is where it cannot drive, such as in the lake; it is put back onto the road then.
        """
        self.episode, self.controls, self.on_tick, self.is_lost = episode, controls, on_tick, is_lost
        self.note = ""
        self._noted = 0.0  # s since the note was made
        self._clock = TickClock()

    def advance(self, seconds: float) -> None:
        """Move the car by the time in s since the last call."""
        for _ in range(self._clock.ticks(seconds)):
            state = self.episode.advance(*self.controls.tick())
            if self.on_tick is not None:
                self.on_tick(state)
        self._noted += seconds
        if self.is_lost(self.episode):
            self.episode.place(self.episode.where.progress)
            self.note, self._noted = "too far from the road: the car was put back", 0.0
        elif self._noted > NOTE_SECONDS:
            self.note = ""
