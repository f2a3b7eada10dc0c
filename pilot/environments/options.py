"""Options of the environments."""

import math
from dataclasses import dataclass, fields, replace
from typing import Any, Literal, get_args

from pilot.simulator.course import LIGHTS
from pilot.vehicle import TICK, TOP_SPEED_MPH

Observations = Literal["image", "state"]
Actions = Literal["steering", "steering_throttle"]
RANDOM = "random"  # track: another random road in every episode
FIRST_ROAD, LAST_ROAD = 1_000_000_000, 1_999_999_999  # demonstrations, tests and improvements use lower seeds
TICK_MS = round(1000 * TICK)


@dataclass(frozen=True)
class DrivingOptions:
    """Options of an environment, given as keywords to `gymnasium.make`."""

    observations: Observations = "image"
    """image: the centre camera's frame; state: a vector, see `observations.py`."""
    actions: Actions = "steering"
    """steering: a controller holds the speed; steering_throttle: both are the agent's."""
    speed: float = 20.0
    """Target speed in mph; with actions="steering" bends are driven more slowly, as by drive.py."""
    light: str | None = None
    """noon, clear, evening or overcast; None: the track's default."""
    reversed: bool = False
    """Drive in the opposite direction."""
    random_start: bool = False
    """Start each episode at a random place of the road instead of the start line."""
    laps: float = 1.0
    """Laps after which the episode is completed."""
    seconds: float | None = None
    """Simulated seconds after which the episode is truncated; None: what a quarter of the target speed takes."""
    latency_ms: int = 0
    """Delay of the actions in milliseconds, a multiple of 20."""
    roads: tuple[int, int] = (FIRST_ROAD, LAST_ROAD)
    """Random-v0 only: first and last seed of the random roads that episodes are drawn from."""

    def check(self) -> None:
        """Check the values.

        Raises:
            ValueError: a value is invalid; the message names the option, its value and what is valid.
        """
        _check_choice("observations", self.observations, get_args(Observations))
        _check_choice("actions", self.actions, get_args(Actions))
        if self.light is not None:
            _check_choice("light", self.light, tuple(LIGHTS))
        _check_range("speed", self.speed, 1.0, TOP_SPEED_MPH, "mph")
        _check_range("laps", self.laps, 0.001, 1000.0, "laps")
        if self.seconds is not None:
            _check_range("seconds", self.seconds, 1.0, 1e6, "s")
        if self.latency_ms not in range(0, 2001, TICK_MS):
            raise ValueError(f"latency_ms={self.latency_ms!r}: must be a multiple of {TICK_MS} in 0..2000")
        if len(self.roads) != 2 or not 0 <= self.roads[0] <= self.roads[1]:
            raise ValueError(f"roads={self.roads!r}: must be the first and the last seed, such as (0, 99)")


def driving_options(values: dict[str, Any]) -> DrivingOptions:
    """Return checked options from keywords.

    Raises:
        ValueError: there is no such option, or a value is invalid.
    """
    names = [field.name for field in fields(DrivingOptions)]
    for name in values:
        _check_choice("option", name, tuple(names))
    options = replace(DrivingOptions(), **values)
    options.check()
    return options


def _check_choice(name: str, value: str, choices: tuple[str, ...]) -> None:
    if value not in choices:
        raise ValueError(f"{name}={value!r}: must be one of {', '.join(choices)}")


def _check_range(name: str, value: float, low: float, high: float, unit: str) -> None:
    if not (isinstance(value, int | float) and math.isfinite(value) and low <= value <= high):
        raise ValueError(f"{name}={value!r}: must lie in {low:g}..{high:g} {unit}")
