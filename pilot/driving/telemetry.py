"""Parsing of the simulator's telemetry messages, and formatting of steer messages.

All values are transmitted as strings. Numbers follow the computer's locale: with a German one, the simulator sends
"29,8572" and reads "0.25" as 25, which is full lock. Therefore telemetry with decimal commas is answered with decimal
commas.
"""

import base64
import binascii
import math
import re
from dataclasses import dataclass
from typing import Any

import numpy as np

from pilot.arrays import Frame
from pilot.data.frames import decode_frame
from pilot.vehicle import FULL_LOCK_DEGREES, PLAUSIBLE_SPEED_MPH


class BadTelemetry(ValueError):
    """The telemetry message is invalid; the message says why."""


@dataclass(frozen=True)
class Telemetry:
    """A parsed telemetry message.

    Attributes:
        frame: of the centre camera, 160x320x3 uint8 RGB.
        jpeg: the same image as received.
        speed: mph.
        steering: current steering, -1..1 (transmitted in degrees); 0 if missing.
        throttle: current throttle, 0..1; 0 if missing.
        commas: whether the numbers have decimal commas.
    """

    frame: Frame
    jpeg: bytes
    speed: float
    steering: float
    throttle: float
    commas: bool


def parse_telemetry(data: Any) -> Telemetry:
    """Parse the argument of a telemetry event.

    Raises:
        BadTelemetry: the argument is not an object, a field is missing or not a finite number, the speed is
            implausible, or the image is damaged.
    """
    if not isinstance(data, dict):
        raise BadTelemetry(f"telemetry is a {type(data).__name__}, not an object")
    speed = _number(data, "speed")
    if not 0 <= speed <= PLAUSIBLE_SPEED_MPH:
        raise BadTelemetry(f"speed {speed:g} mph is implausible")
    jpeg = _jpeg(data)
    frame = decode_frame(np.frombuffer(jpeg, np.uint8))
    if frame is None:
        raise BadTelemetry("its image is damaged")
    steering, throttle = _number(data, "steering_angle", "0") / FULL_LOCK_DEGREES, _number(data, "throttle", "0")
    return Telemetry(frame, jpeg, speed, steering, throttle, uses_commas(data))


def uses_commas(data: Any) -> bool:
    """Return whether the numbers in the argument of a telemetry event have decimal commas."""
    return isinstance(data, dict) and any(
        isinstance(data.get(name), str) and re.fullmatch(r"\s*-?\d+,\d+(E-?\d+)?\s*", data[name], re.IGNORECASE)
        for name in ("speed", "steering_angle", "throttle")
    )


def _number(data: dict[str, Any], name: str, default: str | None = None) -> float:
    value = data.get(name, default)
    try:
        number = float(str(value).replace(",", "."))
    except ValueError:
        number = math.nan
    if not math.isfinite(number):
        raise BadTelemetry(f"its {name} is {str(value)[:40]!r}")
    return number


def _jpeg(data: dict[str, Any]) -> bytes:
    image = data.get("image")
    if not isinstance(image, str) or not image:
        raise BadTelemetry("it has no image")
    try:
        return base64.b64decode(image, validate=True)
    except (binascii.Error, ValueError) as error:
        raise BadTelemetry("its image is not base64") from error


def steer_message(steering: float, throttle: float, *, commas: bool) -> dict[str, str]:
    """Return the argument of a steer event: both values as strings, clipped to -1..1.

    A value that is not finite becomes 0, because the simulator would never send telemetry again after receiving it.

    Args:
        steering, throttle: commands.
        commas: write decimal commas.
    """
    texts = (f"{_bounded(value):.6f}" for value in (steering, throttle))
    angle, pedal = (text.replace(".", ",") if commas else text for text in texts)
    return {"steering_angle": angle, "throttle": pedal}


def _bounded(value: float) -> float:
    return min(max(value, -1.0), 1.0) if math.isfinite(value) else 0.0
