"""Summary of a drive, from its first answer to the last one."""

from typing import Any

from pilot.driving.autopilot import Answer
from pilot.vehicle import MPH

LONGEST_STEP = 1.0  # s between two answers; a longer pause counts as this much


class DriveSummary:
    """Sums up the answers to one car.

    Attributes:
        seconds: duration of the drive.
        metres: distance driven.
        person_seconds: time in which a person steered.
        takeovers: number of times that a person took over.
        top_speed: mph.
    """

    def __init__(self) -> None:
        """Begin a drive."""
        self.seconds = self.metres = self.person_seconds = self.top_speed = 0.0
        self.takeovers = 0
        self._last: float | None = None
        self._steerer = "model"

    def add(self, answer: Answer, now: float) -> None:
        """Add an answer at a time in s."""
        step = min(now - self._last, LONGEST_STEP) if self._last is not None else 0.0
        self._last = now
        self.seconds += step
        if answer.steerer == "person":
            self.person_seconds += step
            self.takeovers += self._steerer != "person"
        self._steerer = answer.steerer
        if answer.telemetry is not None:
            self.metres += answer.telemetry.speed * MPH * step
            self.top_speed = max(self.top_speed, answer.telemetry.speed)

    def values(self) -> dict[str, Any]:
        """Return the figures as JSON-serialisable values."""
        return {
            "seconds": round(self.seconds, 1),
            "metres": round(self.metres),
            "mph": round(self.metres / MPH / self.seconds, 1) if self.seconds else 0.0,
            "top_speed": round(self.top_speed, 1),
            "takeovers": self.takeovers,
            "person_seconds": round(self.person_seconds, 1),
        }
