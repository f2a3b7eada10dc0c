import base64
import math

import numpy as np
import pytest
from conftest import picture
from wire import telemetry

from pilot.data.frames import encode_frame
from pilot.driving.telemetry import BadTelemetry, parse_telemetry, steer_message, uses_commas

IMAGE = encode_frame(picture(0))


def test_reads_the_strings_of_the_wire() -> None:
    read = parse_telemetry(telemetry(IMAGE, speed="29.8572", steering="-12.5000", throttle="0.3"))
    assert (read.speed, read.steering, read.throttle, read.commas) == (29.8572, -0.5, 0.3, False)
    assert read.frame.shape == (160, 320, 3)
    assert read.frame[100, 160, 0] > 200 > 100 > read.frame[100, 160, 2]  # red before blue: RGB
    assert read.jpeg == IMAGE


def test_reads_and_writes_decimal_commas() -> None:
    read = parse_telemetry(telemetry(IMAGE, speed="29,8572", steering="2,5000", throttle="0"))
    assert (read.speed, read.steering, read.commas) == (29.8572, 0.1, True)
    assert steer_message(0.25, -0.5, commas=True) == {"steering_angle": "0,250000", "throttle": "-0,500000"}
    assert not uses_commas(telemetry(IMAGE))
    assert not uses_commas("29,8")


@pytest.mark.parametrize(
    ("change", "says"),
    [
        ({"speed": "nan"}, "speed is 'nan'"),
        ({"speed": "inf"}, "speed is 'inf'"),
        ({"speed": None}, "speed is 'None'"),
        ({"speed": "900"}, "implausible"),
        ({"speed": "-3"}, "implausible"),
        ({"speed": []}, "speed"),
        ({"steering_angle": "left"}, "steering_angle is 'left'"),
        ({"image": ""}, "no image"),
        ({"image": None}, "no image"),
        ({"image": 5}, "no image"),
        ({"image": "%%%"}, "not base64"),
        ({"image": base64.b64encode(b"text").decode()}, "damaged"),
        ({"image": base64.b64encode(IMAGE[:-200]).decode()}, "damaged"),
    ],
)
def test_what_cannot_be_driven_by_is_named(change: dict[str, object], says: str) -> None:
    with pytest.raises(BadTelemetry, match=says):
        parse_telemetry({**telemetry(IMAGE), **change})


@pytest.mark.parametrize("data", ["text", 5, [], [1, 2], True])
def test_other_types_are_no_telemetry(data: object) -> None:
    with pytest.raises(BadTelemetry, match="not an object"):
        parse_telemetry(data)


@pytest.mark.parametrize("value", [5.0, -5.0, math.nan, math.inf, 1e-9, np.float32(0.3)])
def test_what_leaves_is_finite_bounded_and_a_string(value: float) -> None:
    for text in steer_message(value, value, commas=False).values():
        assert isinstance(text, str)
        assert -1 <= float(text) <= 1
