"""Plans: steering for the moment at which it takes effect, frames of before, and the predicted speed."""

import numpy as np
import pytest
from conftest import picture

from pilot.driving.autopilot import Autopilot
from pilot.driving.controller import ControllerConfig, SpeedController
from pilot.driving.dashboard.state import DriveState
from pilot.driving.loop_delay import LoopDelay
from pilot.driving.plan import FrameHistory, Plan
from pilot.driving.telemetry import Telemetry
from pilot.signature import Signature

HORIZONS = (0.0, 0.1, 0.2, 0.5)


def test_a_plan_is_interpolated() -> None:
    plan = Plan((0.0, 0.1, 0.2, 0.5), HORIZONS)
    assert [plan.at(seconds) for seconds in (0.0, 0.15, 0.3, 2.0)] == pytest.approx([0.0, 0.15, 0.3, 0.5])
    assert Plan((0.3,)).at(1.0) == 0.3


@pytest.mark.parametrize("frames", [1, 3, 10])
def test_the_delay_is_found_from_what_the_car_reports(frames: int) -> None:
    delay, sent = LoopDelay(), [0.0] * 20
    random = np.random.default_rng(0)
    for number in range(200):
        delay.see(number * 0.04, round(sent[-frames], 4))
        sent.append(sent[-1] + float(random.normal(0, 0.02)))
        delay.send(number * 0.04, sent[-1])
    # of the command that is `frames` frames old when it is reported, and was in effect for a frame until then
    assert delay.seconds == pytest.approx(0.04 * (frames - 0.5), abs=0.011)


def test_without_movement_the_delay_stays_as_it_was() -> None:
    delay = LoopDelay()
    for number in range(200):
        delay.see(number * 0.04, 0.0)
        delay.send(number * 0.04, 0.0)
    assert delay.seconds == 0.0


def test_the_history_holds_the_frames_nearest_to_the_wanted_times() -> None:
    history = FrameHistory(Signature(history=(0.2, 0.4)))
    frames = [np.full((160, 320, 3), number, np.uint8) for number in range(12)]
    seen = [history.add(0.05 * number, frame)[:, 0, 0, 0].tolist() for number, frame in enumerate(frames)]
    assert seen[0] == [0, 0, 0]
    assert seen[5] == [5, 1, 0]
    assert seen[11] == [11, 7, 3]
    history.clear()
    assert history.add(1.0, frames[7])[:, 0, 0, 0].tolist() == [7, 7, 7]
    assert history.add(0.0, frames[3])[:, 0, 0, 0].tolist() == [3, 3, 3]  # another drive
    assert FrameHistory(Signature()).add(0.0, frames[1]) is frames[1]


def test_a_predicted_speed_takes_the_place_of_what_bends_allow() -> None:
    control = SpeedController(ControllerConfig(speed=25.0))
    assert control.target_speed(1.0) < 15
    assert control.target_speed(1.0, 22.0) == 22.0
    assert control.target_speed(0.0, 29.0) == 25.0  # never faster than asked for
    assert control.target_speed(0.0, 1.0) == 5.0
    assert control.throttle(20.0, 0.0, 0.04, 10.0) < 0 < control.throttle(20.0, 0.0, 0.04, 24.0)


def test_the_autopilot_steers_for_when_the_command_takes_effect() -> None:
    """The car reports each command three frames later; the plan says its own time."""
    now, sent = 0.0, [0.0] * 3
    wave = [0.2 * np.sin(0.3 * number) for number in range(400)]

    class Policy:
        signature = Signature(horizons=(0.0, 1.0))

        def __call__(self, _frame: np.ndarray) -> Plan:
            base = wave[round(now / 0.04)]
            return Plan((base, base + 1.0), (0.0, 1.0))  # 1 more for each second

    pilot = Autopilot(Policy(), ControllerConfig(smoothing=0.0), lambda: now)
    leads = []
    for number in range(300):
        now = 0.04 * number
        telemetry = Telemetry(picture(0), b"", 20.0, sent[-3], 0.0, commas=False)
        sent.append(pilot.answer(telemetry).steering)
        leads.append(sent[-1] - wave[number])
    assert leads[0] == 0.0
    assert leads[-1] == pytest.approx(0.04 * 2.5, abs=0.011)


def test_the_page_shows_the_predicted_speed_as_the_target() -> None:
    pilot = Autopilot(lambda _: Plan((0.0,), speed=12.0), ControllerConfig(speed=25.0))
    state = DriveState(pilot)
    state.observe(pilot.answer(Telemetry(picture(0), b"", 20.0, 0.0, 0.0, commas=False)))
    [point] = state.snapshot()["samples"]
    assert point["set_speed"] == 12.0
