"""Computation of the answer to each telemetry message: steering policy or a person, and speed controller.

Every message is answered, even if it is malformed or the model fails, because the simulator sends its next telemetry
only after an answer.
"""

import logging
import time
from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

from pilot.data.steered_by import Steerer
from pilot.driving.controller import ControllerConfig, SpeedController, SteeringFilter
from pilot.driving.loop_delay import LoopDelay
from pilot.driving.plan import FrameHistory, SteeringPolicy, as_plan, signature_of
from pilot.driving.telemetry import BadTelemetry, Telemetry, parse_telemetry, steer_message, uses_commas
from pilot.driving.wheel import Wheel

log = logging.getLogger("pilot")

LONGEST_PAUSE = 2.0  # s without telemetry after which the controllers are reset


@dataclass(frozen=True)
class Answer:
    """An answer to the simulator, with the telemetry from which it was computed.

    Attributes:
        event: "steer" or "manual".
        message: argument of the event.
        steering, throttle: commands, -1..1 each.
        telemetry: the message that is answered; None in manual mode and if the message was invalid.
        seconds: s from receiving the telemetry to the answer.
        steerer: who steers, the model or a person.
        predicted_speed: speed in mph that the model predicts; None: it predicts none.
    """

    event: str
    message: dict[str, str]
    steering: float = 0.0
    throttle: float = 0.0
    telemetry: Telemetry | None = None
    seconds: float = 0.0
    steerer: Steerer = "model"
    predicted_speed: float | None = None


MANUAL = Answer("manual", {}, steerer="person")


class Autopilot:
    """Answers the telemetry of one car.

    Attributes:
        last: the last answer; its command is repeated if a telemetry message is invalid.
        speed: the speed controller; its set speed may be changed during the drive.
        wheel: with which a person takes over from the model.
    """

    def __init__(
        self, policy: SteeringPolicy, config: ControllerConfig, clock: Callable[[], float] = time.perf_counter
    ) -> None:
        """Create an autopilot for a steering policy; `clock` returns the time in s."""
        self.clock = clock
        self.speed, self.filter = SpeedController(config), SteeringFilter(config.smoothing)
        self.delay = LoopDelay()
        self.wheel = Wheel()
        self.warnings = Warnings(clock)
        self.set_policy(policy)
        self.reset()

    def set_policy(self, policy: SteeringPolicy) -> None:
        """Let another policy drive."""
        self._policy, self._history = policy, FrameHistory(signature_of(policy))

    def reset(self) -> None:
        """Reset the controllers and the last answer, for another car."""
        self.last = Answer("steer", steer_message(0.0, 0.0, commas=False))
        self._time: float | None = None
        self._restart()

    def _restart(self) -> None:
        self.speed.reset()
        self.filter.reset()
        self.delay.reset()
        self._history.clear()

    def answer(self, data: Any) -> Answer:
        """Return the answer to the argument of a telemetry event. Never raises.

        Args:
            data: any value; None in manual mode; a `Telemetry` that was parsed from the argument before.
        """
        began = self.clock()
        if data is None:
            self._time = None
            self.last = MANUAL
            return MANUAL
        try:
            telemetry = data if isinstance(data, Telemetry) else parse_telemetry(data)
            self.last = self._drive(telemetry, began)
        except BadTelemetry as error:
            self.warnings.warn("invalid telemetry, repeating the last command", error)
            self.last = self.safe_command(commas=uses_commas(data))
        except Exception:  # without an answer, the simulator would send no more telemetry
            log.exception("the model failed, repeating the last command")
            self.last = self.safe_command(commas=uses_commas(data))
        return self.last

    def safe_command(self, *, commas: bool | None = None) -> Answer:
        """Return an answer that repeats the last command (at first: steering and throttle 0).

        Args:
            commas: format the numbers with decimal commas (True) or points (False) as a "steer" event;
                None: repeat the last event and message unchanged.
        """
        before = self.last
        if commas is None:
            return replace(before, telemetry=None, seconds=0.0)
        message = steer_message(before.steering, before.throttle, commas=commas)
        return Answer("steer", message, before.steering, before.throttle)

    def _drive(self, telemetry: Telemetry, now: float) -> Answer:
        pause = now - self._time if self._time is not None else LONGEST_PAUSE + 1
        if pause > LONGEST_PAUSE:
            self._restart()
            pause = 0.0
        self._time = now
        self.delay.see(now, telemetry.steering)
        seen = self._history.add(now, telemetry.frame)
        person, predicted_speed = self.wheel.command, None
        if person is None:
            plan = as_plan(self._policy(seen))
            steering = self.filter.smooth(plan.at(self.delay.seconds + self.filter.seconds), pause)
            predicted_speed = plan.speed
        else:
            steering = self.filter.value = person.steering  # from which the model then goes on
        self.delay.send(now, steering)
        throttle = self.speed.throttle(telemetry.speed, steering, pause, predicted_speed)
        if person is not None and person.throttle is not None:
            throttle = person.throttle
        message = steer_message(steering, throttle, commas=telemetry.commas)
        steerer: Steerer = "person" if person else "model"
        return Answer("steer", message, steering, throttle, telemetry, self.clock() - now, steerer, predicted_speed)


class FrameClock:
    """Clock for a simulator that does not run in real time: advances by a fixed time per telemetry."""

    def __init__(self, seconds: float) -> None:
        """Create a clock that starts at 0 and advances by `seconds` per answer."""
        self.seconds, self.now = seconds, 0.0

    def __call__(self) -> float:
        """Return the time in s."""
        return self.now

    def tick(self, _answer: Answer) -> None:
        """Advance the clock; to be called after each answer."""
        self.now += self.seconds


class Warnings:
    """Logs messages, each kind at most once per second, with the number of those suppressed since."""

    def __init__(self, clock: Callable[[], float]) -> None:
        self.clock = clock
        self._last: dict[str, float] = {}
        self._suppressed: Counter[str] = Counter()

    def warn(self, kind: str, detail: object, *, level: int = logging.WARNING) -> None:
        """Log a message, or count it if one of the same kind was logged less than 1 s ago."""
        now = self.clock()
        if now - self._last.get(kind, float("-inf")) < 1.0:
            self._suppressed[kind] += 1
            return
        more = self._suppressed.pop(kind, 0)
        log.log(level, "%s: %s%s", kind, detail, f" ({more} more of these)" if more else "")
        self._last[kind] = now
