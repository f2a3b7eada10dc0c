"""Data that the page shows: the current state of the drive, and its last minute."""

import time
from collections import deque
from collections.abc import Callable
from typing import Any

from pilot.driving.autopilot import Answer, Autopilot
from pilot.driving.dashboard.summary import DriveSummary
from pilot.vehicle import FULL_LOCK_DEGREES

WAITING_AFTER = 2.0  # s without telemetry until the state is "waiting"
RATE_SECONDS = 2.0  # window over which frame rate and answer time are computed
SAMPLE_SECONDS = 0.095  # between points of the strip chart; below 0.1 s, to tolerate jitter of the telemetry
CHART_POINTS = 600  # points of the strip chart


class DriveState:
    """Collects the answers to the simulator and summarises them for the page.

    Attributes:
        number: of answers so far.
        answer: the last answer with a frame; None before the first.
        summary: of the current drive, or of the last one while waiting.
    """

    def __init__(self, autopilot: Autopilot, clock: Callable[[], float] = time.monotonic) -> None:
        """Create the state of a drive.

        Args:
            autopilot: that drives.
            clock: returns the time in s.
        """
        self.autopilot, self.clock = autopilot, clock
        self.number = 0
        self.answer: Answer | None = None
        self.summary = DriveSummary()
        self._last_time, self._last_event, self._steerer = float("-inf"), "", "model"
        self._recent: deque[tuple[float, float]] = deque(maxlen=400)  # time in s, s to answer
        self._samples: deque[dict[str, float | bool]] = deque(maxlen=CHART_POINTS)

    def observe(self, answer: Answer) -> None:
        """Add an answer; takes microseconds."""
        now = self.clock()
        self.number += 1
        if self.state == "waiting":
            self.summary = DriveSummary()
        self.summary.add(answer, now)
        self._last_time, self._last_event, self._steerer = now, answer.event, answer.steerer
        self._recent.append((now, answer.seconds))
        if answer.telemetry is not None:
            self.answer = answer
        if self.answer and (not self._samples or now - self._samples[-1]["time"] >= SAMPLE_SECONDS):
            self._samples.append(self._sample(now))

    def _sample(self, now: float) -> dict[str, float | bool]:
        """Return a point of the strip chart; in manual mode, the simulator tells nothing, and the last values stay."""
        answer = self.answer
        assert answer is not None
        assert answer.telemetry is not None
        return {
            "time": round(now, 3),
            "speed": round(answer.telemetry.speed, 2),
            "set_speed": round(self.autopilot.speed.target_speed(answer.steering, answer.predicted_speed), 2),
            "steering": round(answer.steering, 4),
            "throttle": round(answer.throttle, 3),
            "person": self._steerer == "person",
        }

    @property
    def state(self) -> str:
        """State of the drive: "waiting" (for telemetry), "driving", "corrected" (by a person) or "manual".

        In manual mode, the simulator's own keys steer.
        """
        if self.clock() - self._last_time > WAITING_AFTER:
            return "waiting"
        if self._last_event == "manual":
            return "manual"
        return "corrected" if self._steerer == "person" else "driving"

    def snapshot(self, since: float = 0.0) -> dict[str, Any]:
        """Return all values that the page shows, as JSON-serialisable objects.

        Args:
            since: time in s; only later points of the strip chart are included.
        """
        now = self.clock()
        recent = [(at, seconds) for at, seconds in self._recent if now - at < RATE_SECONDS]
        span = now - recent[0][0] if recent else 1.0
        times = sorted(seconds for _, seconds in recent)
        answer = self.answer
        return {
            "state": self.state,
            "time": round(now, 3),
            "set_speed": self.autopilot.speed.set_speed,
            "steering": round(answer.steering, 4) if answer else 0.0,
            "steering_degrees": round(answer.steering * FULL_LOCK_DEGREES, 2) if answer else 0.0,
            "throttle": round(answer.throttle, 3) if answer else 0.0,
            "speed": round(answer.telemetry.speed, 2) if answer and answer.telemetry else 0.0,
            "frames_per_second": round(len(recent) / max(span, 0.2), 1) if len(recent) > 1 else 0.0,
            "milliseconds": round(1000 * times[len(times) // 2], 2) if times else 0.0,
            "summary": self.summary.values(),
            "samples": [sample for sample in self._samples if sample["time"] > since],
        }
