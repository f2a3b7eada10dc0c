"""PI speed controller and steering filter."""

import math
from dataclasses import dataclass

from pilot.vehicle import GRAVITY, MPH, REVERSE_BELOW_MPH, TOP_SPEED_MPH, steering_to_curvature

MIN_BRAKING_SPEED = 6.0  # mph; above REVERSE_BELOW_MPH because the telemetry is delayed
LONGEST_STEP = 0.5  # s; longer pauses are integrated over this time only


@dataclass(frozen=True)
class ControllerConfig:
    """Options of the speed controller and the steering filter."""

    speed: float = 20.0
    """Target speed in mph; the car's top speed is 30."""
    slow_in_curves: float = 0.0
    """Relative reduction (0..1) of the target speed at full lock, proportional to the steering; never below 5 mph."""
    lateral_g: float = 0.35
    """Maximum lateral acceleration in g: in bends the target speed is reduced to what keeps it, but never below 5 mph.
    0: no limit. The tyres hold about 0.95 g. Has no effect with a model that predicts the speed itself."""
    speed_gain: float = 2.0
    """How fast the target speed rises again after a bend, in mph per second, because bends seldom come alone and the
    camera shows the next one late. 0: at once."""
    smoothing: float = 0.1
    """Time constant of the steering filter in s; 0: off. 0.1 halves the steering jerk without loss of accuracy."""
    kp: float = 0.15
    """Proportional gain of the speed controller: throttle per mph of speed error."""
    ki: float = 0.05
    """Integral gain of the speed controller: throttle per mph of speed error and second."""

    def check(self) -> None:
        """Check the ranges of the options.

        Raises:
            ValueError: an option is out of range; the message contains its name and the range.
        """
        if not 0 <= self.speed <= TOP_SPEED_MPH:
            raise ValueError(f"--speed {self.speed:g}: must lie in 0..{TOP_SPEED_MPH:g} mph")
        if not 0 <= self.slow_in_curves <= 1:
            raise ValueError(f"--slow-in-curves {self.slow_in_curves:g}: must lie in 0..1")
        for name in ("lateral_g", "speed_gain", "smoothing", "kp", "ki"):
            if not 0 <= getattr(self, name) < math.inf:
                option = name.replace("_", "-")
                raise ValueError(f"--{option} {getattr(self, name):g}: must be a number, and not negative")


class SpeedController:
    """PI controller of the speed, with variable time step and bounded integral.

    Attributes:
        set_speed: target speed in mph before its reduction in curves; may be changed during the drive.
        integral: the integral term, as throttle, -1..1.
        bend_speed: target speed in mph that the present and the last bends allow.
    """

    def __init__(self, config: ControllerConfig) -> None:
        self.config = config
        self.set_speed = config.speed
        self.reset()

    def reset(self) -> None:
        """Reset the integral and forget the last bends, at the beginning of a drive."""
        self.integral, self.bend_speed = 0.0, math.inf

    def target_speed(self, steering: float, predicted: float | None = None) -> float:
        """Return the target speed in mph for a steering (-1..1): `set_speed`, reduced as configured.

        A speed that the model predicts (mph) takes the place of what bends allow: it knows of them earlier.
        """
        slower = self.config.slow_in_curves * min(abs(steering), 1.0)
        allowed = min(self._fastest_in_bend(steering), self.bend_speed) if predicted is None else predicted
        fastest = min(self.set_speed * (1 - slower), allowed)
        return max(fastest, min(self.set_speed, REVERSE_BELOW_MPH))

    def _fastest_in_bend(self, steering: float) -> float:
        """Return the speed in mph at which a steering gives the maximum lateral acceleration; infinite without one."""
        curvature = abs(steering_to_curvature(min(max(steering, -1.0), 1.0)))
        if self.config.lateral_g == 0 or curvature == 0:
            return math.inf
        return math.sqrt(self.config.lateral_g * GRAVITY / curvature) / MPH

    def _remember_bend(self, steering: float, seconds: float) -> None:
        """Lower `bend_speed` to what the present bend allows, or raise it by the configured gain."""
        risen = self.bend_speed + self.config.speed_gain * seconds if self.config.speed_gain else math.inf
        self.bend_speed = min(risen, self._fastest_in_bend(steering))

    def throttle(self, speed: float, steering: float, seconds: float, predicted: float | None = None) -> float:
        """Return the throttle (-1..1).

        The integral grows only while the throttle is within its bounds (anti-windup). A negative throttle brakes, but
        reverses at low speed; therefore it is used only above `MIN_BRAKING_SPEED`.

        Args:
            speed: measured speed in mph.
            steering: -1..1.
            seconds: since the last call.
            predicted: speed in mph that the model predicts; None: it predicts none.
        """
        seconds = min(max(seconds, 0.0), LONGEST_STEP)
        self._remember_bend(steering, seconds)
        error = self.target_speed(steering, predicted) - speed
        grown = self.integral + self.config.ki * error * seconds
        wanted = self.config.kp * error + grown
        if -1 <= wanted <= 1 or abs(grown) < abs(self.integral):
            self.integral = min(max(grown, -1.0), 1.0)
        lowest = -1.0 if speed > MIN_BRAKING_SPEED else 0.0
        return min(max(self.config.kp * error + self.integral, lowest), 1.0)


class SteeringFilter:
    """Exponential smoothing of the steering with a time constant in s; 0: off."""

    def __init__(self, seconds: float) -> None:
        self.seconds = seconds
        self.value: float | None = None

    def reset(self) -> None:
        """Reset the filter: the next value is returned unchanged."""
        self.value = None

    def smooth(self, steering: float, seconds: float) -> float:
        """Return the smoothed steering (-1..1), given the steering and the time in s since the last call."""
        if self.value is None or self.seconds <= 0:
            self.value = steering
        else:
            self.value += (steering - self.value) * min(seconds / (self.seconds + seconds), 1.0)
        return self.value
