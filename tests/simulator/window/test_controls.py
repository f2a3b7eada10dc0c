"""Keys, mouse and gamepad → steering and throttle, tick by tick."""

import pytest
from conftest import circle

from pilot.simulator.clock import LONGEST_FRAME
from pilot.simulator.episode import Episode
from pilot.simulator.window.controls import MOUSE_SPAN, Controls, ManualDriving, Pad
from pilot.vehicle import TICK


def steer(controls: Controls, ticks: int) -> list[float]:
    return [controls.tick()[0] for _ in range(ticks)]


@pytest.mark.parametrize(("key", "sign"), [("arrow_left", -1), ("a", -1), ("arrow_right", 1), ("d", 1)])
def test_a_key_turns_the_wheels_by_a_twentieth_a_tick_to_full_lock_and_back(key: str, sign: int) -> None:
    controls = Controls()
    controls.press(key)
    assert steer(controls, 22) == pytest.approx([sign * min(0.05 * tick, 1) for tick in range(1, 23)])
    controls.release(key)
    assert steer(controls, 22) == pytest.approx([sign * max(1 - 0.05 * tick, 0) for tick in range(1, 23)])


def test_counter_steering_passes_the_middle_at_the_same_pace() -> None:
    controls = Controls(steering=0.1)
    controls.press("a")
    assert steer(controls, 4) == pytest.approx([0.05, 0, -0.05, -0.1])
    controls.press("d")  # both: none
    assert steer(controls, 3) == pytest.approx([-0.05, 0, 0])


def test_wheels_come_to_rest_in_the_middle_exactly() -> None:
    controls = Controls(steering=0.333)
    assert steer(controls, 8)[-1] == 0.0


@pytest.mark.parametrize(
    ("keys", "throttle"),
    [({"arrow_up"}, 1), ({"w"}, 1), ({"s"}, -1), ({"arrow_down"}, -1), ({"w", "s"}, 0), (set(), 0), ({"r"}, 0)],
)
def test_throttle_by_keys(keys: set[str], throttle: float) -> None:
    controls = Controls()
    for key in keys:
        controls.press(key)
    assert controls.tick()[1] == throttle


def test_the_mouse_steers_in_proportion_to_how_far_it_is_dragged() -> None:
    controls = Controls(pointer=0.6)
    assert steer(controls, 1) == [0]  # not held
    controls.press("mouse1")
    assert steer(controls, 1) == [0]  # no jump where the mouse is taken
    for part in (0.5, -0.25, 1.0, 1.5):
        controls.pointer = 0.6 + part * MOUSE_SPAN
        assert steer(controls, 1) == pytest.approx([min(part, 1)])
    controls.release("mouse1")
    assert steer(controls, 2) == pytest.approx([0.95, 0.9])


def test_a_gamepad_steers_and_accelerates() -> None:
    controls = Controls(pad=Pad(0.55, accelerator=0.7, brake=0.1))
    assert controls.tick() == pytest.approx((0.5, 0.6))
    controls.pad = Pad(-1.0, brake=1.0)
    assert controls.tick() == (-1.0, -1.0)
    controls.pad = Pad(0.08)  # at rest, as far as a worn stick goes: the wheels come back
    assert controls.tick() == pytest.approx((-0.95, 0.0))


def test_keys_go_before_the_stick() -> None:
    controls = Controls(pad=Pad(1.0, accelerator=1.0))
    for key in ("a", "w"):
        controls.press(key)
    assert controls.tick() == pytest.approx((-0.05, 1.0))


@pytest.mark.parametrize("frames", [7, 50, 144])
def test_the_drive_is_the_same_at_any_frame_rate(frames: int) -> None:
    episode, states = Episode(circle()), []
    controls = Controls()
    controls.press("w")
    driving = ManualDriving(episode, controls, states.append)
    for _ in range(2 * frames):
        driving.advance(1 / frames)
    assert episode.ticks == len(states) == 100
    steady = Episode(circle())
    for _ in range(100):
        steady.advance(0, 1)
    assert episode.state == steady.state == states[-1]


def test_a_long_frame_does_not_send_the_car_off_unseen() -> None:
    episode = Episode(circle())
    ManualDriving(episode, Controls()).advance(20.0)
    assert episode.ticks == int(LONGEST_FRAME / TICK)
