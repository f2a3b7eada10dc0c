"""PI speed controller: throttle that holds a set speed."""

from dataclasses import dataclass

from pilot.vehicle import REVERSE_BELOW_MPH, TOP_SPEED_MPH

BRAKES_FROM = 6.0  # mph: with a margin for telemetry that is a moment old
LONGEST_STEP = 0.5  # s: after a longer pause the integral does not make up for it


@dataclass(frozen=True)
class ControllerConfig:
    """How fast to drive."""

    speed: float = 20.0
    """Set speed in mph; the car's top speed is 30."""
    slow_in_curves: float = 0.0
    """Lower the set speed with the steering: by this share at full lock (0: not at all, 1: down to 5 mph)."""
    smoothing: float = 0.1
    """Smooth the steering over about this many seconds (0: as the network says). 0.1 halves the jerks and drives as
    well."""
    kp: float = 0.15
    """Throttle for each mph too slow."""
    ki: float = 0.05
    """Throttle for each mph too slow and second."""

    def check(self) -> None:
        """Refuse values that cannot work.

        Raises:
            ValueError: names the option, its value and what it may be.
        """
        if not 0 <= self.speed <= TOP_SPEED_MPH:
            raise ValueError(f"--speed {self.speed:g}: must lie in 0..{TOP_SPEED_MPH:g} mph")
        if not 0 <= self.slow_in_curves <= 1:
            raise ValueError(f"--slow-in-curves {self.slow_in_curves:g}: must lie in 0..1")
        if min(self.smoothing, self.kp, self.ki) < 0:
            raise ValueError("--smoothing, --kp and --ki must not be negative")


class SpeedController:
    """Throttle (-1..1) from measured and wanted speed, with a time step and a bounded integral."""

    def __init__(self, config: ControllerConfig) -> None:
        self.config = config
        self.set_speed = config.speed
        self.integral = 0.0

    def reset(self) -> None:
        """Forget the past: a new drive begins."""
        self.integral = 0.0

    def wanted_speed(self, steering: float) -> float:
        """The speed in mph to drive at with this steering (-1..1)."""
        slower = self.config.slow_in_curves * min(abs(steering), 1.0)
        return max(self.set_speed * (1 - slower), min(self.set_speed, REVERSE_BELOW_MPH))

    def throttle(self, speed: float, steering: float, seconds: float) -> float:
        """Throttle -1..1 for a speed in mph, `seconds` after the last call.

        The integral grows only while the throttle is within its bounds (anti-windup), and a negative
        throttle, which brakes, is given only where it cannot drive the car backwards.
        """
        error = self.wanted_speed(steering) - speed
        grown = self.integral + self.config.ki * error * min(max(seconds, 0.0), LONGEST_STEP)
        wanted = self.config.kp * error + grown
        if -1 <= wanted <= 1 or abs(grown) < abs(self.integral):
            self.integral = min(max(grown, -1.0), 1.0)
        lowest = -1.0 if speed > BRAKES_FROM else 0.0
        return min(max(self.config.kp * error + self.integral, lowest), 1.0)


class SteeringFilter:
    """Exponential smoothing of the steering over time; off with 0 seconds."""

    def __init__(self, seconds: float) -> None:
        self.seconds = seconds
        self.value: float | None = None

    def reset(self) -> None:
        """Forget the past."""
        self.value = None

    def smooth(self, steering: float, seconds: float) -> float:
        """The smoothed steering (-1..1), `seconds` after the last call."""
        if self.value is None or self.seconds <= 0:
            self.value = steering
        else:
            self.value += (steering - self.value) * min(seconds / (self.seconds + seconds), 1.0)
        return self.value
