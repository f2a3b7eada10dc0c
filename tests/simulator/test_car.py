"""The car has the real one's figures, and always does the same."""

import math

import pytest

from pilot.simulator.car import TOP_SPEED, Car
from pilot.vehicle import MPH, TICK, WHEELBASE


def driven(seconds: float, steering: float = 0.0, throttle: float = 1.0, car: Car | None = None, **where: bool) -> Car:
    car = car or Car(0, 0, 0)
    for _ in range(round(seconds / TICK)):
        car.advance(steering, throttle, **where)
    return car


def test_the_same_commands_give_the_same_path_to_the_last_bit() -> None:
    assert driven(20, 0.123, 0.7) == driven(20, 0.123, 0.7)


def test_top_speed_is_thirty_mph_and_takes_some_seconds() -> None:
    assert driven(2).speed < TOP_SPEED
    assert driven(15).speed / MPH == 30.0
    assert driven(0.2).speed < 0.2 * 5  # the engine takes a second to give its torque


def test_full_lock_is_twenty_five_degrees() -> None:
    car = driven(3, 1.0, 0.3, Car(0, 0, 0, 2.0))
    assert 1 / car.curvature == pytest.approx(WHEELBASE / math.tan(math.radians(25)))
    assert car.heading > 0  # to the right


def test_tyres_slide_at_speed_and_sooner_on_grass() -> None:
    fast = driven(0.1, 1.0, 0.0, Car(0, 0, 0, TOP_SPEED))
    assert fast.speed**2 * fast.curvature == pytest.approx(0.95 * 9.81, rel=0.02)
    grass = driven(0.1, 1.0, 0.0, Car(0, 0, 0, TOP_SPEED), on_road=False)
    assert grass.curvature < 0.6 * fast.curvature


def test_brakes_then_reverses() -> None:
    car = driven(1.0, throttle=-1.0, car=Car(0, 0, 0, TOP_SPEED))
    assert 0 <= car.speed < 0.4 * TOP_SPEED
    assert driven(3.0, throttle=-1.0, car=car).speed < 0


def test_grass_and_hills_are_slow() -> None:
    flat = driven(6, throttle=0.5)
    assert driven(6, throttle=0.5, on_road=False).speed < 0.6 * flat.speed
    uphill = Car(0, 0, 0)
    for _ in range(300):
        uphill.advance(0.0, 0.5, slope=0.1)
    assert 0 < uphill.speed < flat.speed


def test_wheels_are_where_they_belong() -> None:
    rear_left, rear_right, front_left, front_right = Car(10, 20, 0).wheels()
    assert rear_left == pytest.approx((9, 20))
    assert rear_right == pytest.approx((11, 20))
    assert front_left == pytest.approx((9, 22.87))
    assert front_right == pytest.approx((11, 22.87))
