import logging

import pytest
from conftest import picture
from wire import telemetry

from pilot.arrays import Frame
from pilot.data.frames import encode_frame
from pilot.driving.autopilot import Autopilot, FrameClock
from pilot.driving.controller import ControllerConfig
from pilot.driving.dashboard.state import DriveState

GOOD = telemetry(encode_frame(picture(0)), speed="10")


class Clock:
    now = 100.0

    def __call__(self) -> float:
        return self.now


def autopilot(steer: object = lambda frame: 0.25, **config: float) -> tuple[Autopilot, Clock]:
    clock = Clock()
    return Autopilot(steer, ControllerConfig(**config), clock), clock


def test_answers_with_the_drivers_steering_and_a_throttle() -> None:
    pilot, _ = autopilot(speed=20)
    answer = pilot.answer(GOOD)
    assert answer.event == "steer"
    assert answer.message["steering_angle"] == "0.250000"
    assert float(answer.message["throttle"]) > 0
    assert answer.telemetry.speed == 10


def test_a_driver_that_fails_leaves_the_last_command(caplog: pytest.LogCaptureFixture) -> None:
    fails = False

    def steer(_frame: Frame) -> float:
        if fails:
            raise ZeroDivisionError
        return 0.25

    pilot, _ = autopilot(steer)
    good = pilot.answer(GOOD)
    fails = True
    with caplog.at_level(logging.ERROR, "pilot"):
        assert pilot.answer(GOOD).message == good.message
    assert "the model failed" in caplog.text


def test_without_a_last_command_the_safe_one_is_straight_on() -> None:
    pilot, _ = autopilot()
    assert pilot.answer({}).message == {"steering_angle": "0.000000", "throttle": "0.000000"}
    assert pilot.answer(None).event == "manual"
    assert pilot.answer({}).message["throttle"] == "0.000000"


def test_a_long_pause_begins_the_controllers_anew() -> None:
    pilot, clock = autopilot(speed=20)
    for _ in range(40):
        pilot.answer({**GOOD, "speed": "18"})
        clock.now += 0.1
    grown = pilot.speed.integral
    clock.now += 60
    pilot.answer(GOOD)
    assert grown > 0.3
    assert pilot.speed.integral == 0


def test_a_frame_clock_gives_every_answer_the_same_time() -> None:
    """However fast the telemetry comes: the speed's integral grows by the simulator's time."""
    clock = FrameClock(0.1)
    pilot = Autopilot(lambda _: 0.0, ControllerConfig(speed=20), clock)
    for _ in range(40):
        clock.tick(pilot.answer({**GOOD, "speed": "18"}))
    slow, by_hand = autopilot(speed=20)
    for _ in range(40):
        slow.answer({**GOOD, "speed": "18"})
        by_hand.now += 0.1
    assert pilot.speed.integral == pytest.approx(slow.speed.integral)
    assert pilot.speed.integral > 0.3


def test_each_kind_of_warning_is_said_once_a_second(caplog: pytest.LogCaptureFixture) -> None:
    pilot, clock = autopilot()
    with caplog.at_level(logging.WARNING, "pilot"):
        for _ in range(10):
            pilot.answer({})
        pilot.warnings.warn("another kind", "x")
        clock.now += 2
        pilot.answer({})
    assert len(caplog.records) == 3
    assert "9 more of these" in caplog.text


def test_the_pages_state_follows_the_drive() -> None:
    pilot, clock = autopilot(speed=20)
    state = DriveState(pilot, clock)
    assert state.state == "waiting"
    for _ in range(50):
        state.observe(pilot.answer(GOOD))
        clock.now += 0.05
    shown = state.snapshot()
    assert (shown["state"], shown["speed"], shown["set_speed"]) == ("driving", 10, 20)
    assert shown["frames_per_second"] == pytest.approx(20, abs=1)
    assert len(shown["samples"]) == pytest.approx(25, abs=2)
    assert state.snapshot(since=shown["samples"][-1]["time"])["samples"] == []
    state.observe(pilot.answer(None))
    assert state.state == "manual"
    clock.now += 3
    assert state.state == "waiting"
    for _ in range(3000):  # two minutes: one is kept
        state.observe(pilot.answer(GOOD))
        clock.now += 0.05
    assert len(state.snapshot()["samples"]) == 600
