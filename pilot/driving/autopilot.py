"""Telemetry in, answer out: joins driver and controllers, and never leaves a telemetry without an answer."""

import logging
import time
from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from pilot.arrays import Frame
from pilot.driving.controller import ControllerConfig, SpeedController, SteeringFilter
from pilot.driving.telemetry import BadTelemetry, Telemetry, parse_telemetry, steer_message, uses_commas

log = logging.getLogger("pilot")

LONGEST_PAUSE = 2.0  # s without telemetry after which the controllers begin anew


@dataclass(frozen=True)
class Answer:
    """What goes back to the simulator, and what it was made from.

    Attributes:
        event: "steer" or "manual".
        message: its argument.
        steering, throttle: -1..1, as commanded.
        telemetry: what was answered; None for manual driving, or when it could not be used.
        seconds: from telemetry to answer.
    """

    event: str
    message: dict[str, str]
    steering: float = 0.0
    throttle: float = 0.0
    telemetry: Telemetry | None = None
    seconds: float = 0.0


MANUAL = Answer("manual", {})


class Autopilot:
    """Drives one car.

    Attributes:
        last: the last answer; repeated when a telemetry cannot be used.
        speed: the speed controller, whose set speed may be changed while driving.
    """

    def __init__(
        self, steer: Callable[[Frame], float], config: ControllerConfig, clock: Callable[[], float] = time.perf_counter
    ) -> None:
        """Drive with `steer` (frame to -1..1)."""
        self.steer, self.clock = steer, clock
        self.speed, self.filter = SpeedController(config), SteeringFilter(config.smoothing)
        self.warnings = Warnings(clock)
        self.reset()

    def reset(self) -> None:
        """Forget the past: another car."""
        self.last = Answer("steer", steer_message(0.0, 0.0, commas=False))
        self._time: float | None = None
        self.speed.reset()
        self.filter.reset()

    def answer(self, data: Any) -> Answer:
        """The answer to a telemetry, whatever it holds; None is manual driving."""
        began = self.clock()
        if data is None:
            self._time = None
            self.last = MANUAL
            return MANUAL
        try:
            telemetry = parse_telemetry(data)
            self.last = self._drive(telemetry, began)
        except BadTelemetry as error:
            self.warnings.say("telemetry cannot be used, the last command stays", error)
            self.last = self.safe_command(commas=uses_commas(data))
        except Exception:  # whatever it is, the car gets its answer
            log.exception("the driver failed, the last command stays")
            self.last = self.safe_command(commas=uses_commas(data))
        return self.last

    def safe_command(self, *, commas: bool | None = None) -> Answer:
        """The last command once more (straight on without throttle if there is none yet)."""
        before = self.last
        if commas is None:
            return Answer(before.event, before.message, before.steering, before.throttle)
        message = steer_message(before.steering, before.throttle, commas=commas)
        return Answer("steer", message, before.steering, before.throttle)

    def _drive(self, telemetry: Telemetry, now: float) -> Answer:
        pause = now - self._time if self._time is not None else LONGEST_PAUSE + 1
        if pause > LONGEST_PAUSE:
            self.speed.reset()
            self.filter.reset()
            pause = 0.0
        self._time = now
        steering = self.filter.smooth(self.steer(telemetry.frame), pause)
        throttle = self.speed.throttle(telemetry.speed, steering, pause)
        message = steer_message(steering, throttle, commas=telemetry.commas)
        return Answer("steer", message, steering, throttle, telemetry, self.clock() - now)


class FrameClock:
    """The time of a simulator that runs as fast as it goes: the same from each telemetry to the next."""

    def __init__(self, seconds: float) -> None:
        """Pass `seconds` with each answer."""
        self.seconds, self.now = seconds, 0.0

    def __call__(self) -> float:
        """The time, s."""
        return self.now

    def tick(self, _answer: Answer) -> None:
        """An answer was given."""
        self.now += self.seconds


class Warnings:
    """Logs warnings, but each kind at most once a second, with how many there were meanwhile."""

    def __init__(self, clock: Callable[[], float]) -> None:
        self.clock = clock
        self._last: dict[str, float] = {}
        self._unsaid: Counter[str] = Counter()

    def say(self, kind: str, detail: object) -> None:
        """Log, or count for the next time."""
        now = self.clock()
        if now - self._last.get(kind, float("-inf")) < 1.0:
            self._unsaid[kind] += 1
            return
        more = self._unsaid.pop(kind, 0)
        log.warning("%s: %s%s", kind, detail, f" ({more} more of these)" if more else "")
        self._last[kind] = now
