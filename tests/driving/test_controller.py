import pytest

from pilot.driving.controller import ControllerConfig, SpeedController, SteeringFilter
from pilot.vehicle import GRAVITY, MPH, steering_to_curvature


def simulate(config: ControllerConfig, seconds: float, step: float) -> list[float]:
    """Speeds (mph) of a car with the simulator's acceleration and drag."""
    controller, speed, speeds = SpeedController(config), 0.0, []
    for _ in range(int(seconds / step)):
        throttle = controller.throttle(speed, 0.0, step)
        speed = max(speed + (throttle * 8 - 0.08 * speed) * step, 0.0)
        speeds.append(speed)
    return speeds


@pytest.mark.parametrize("wanted", [5.0, 9.0, 20.0, 30.0])
@pytest.mark.parametrize("step", [0.02, 0.1])
def test_holds_the_set_speed(wanted: float, step: float) -> None:
    speeds = simulate(ControllerConfig(speed=wanted), 60, step)
    assert speeds[-1] == pytest.approx(wanted, abs=0.3)
    assert max(speeds) < wanted + 2.5


def test_the_integral_is_bounded_and_does_not_wind_up() -> None:
    controller = SpeedController(ControllerConfig(speed=30))
    for _ in range(1000):  # held back, as against a wall
        controller.throttle(0.0, 0.0, 0.1)
    assert abs(controller.integral) <= 1
    throttles = [controller.throttle(33.0, 0.0, 0.1) for _ in range(30)]
    assert throttles[-1] < 0.2


def test_a_long_pause_does_not_fill_the_integral() -> None:
    controller = SpeedController(ControllerConfig(speed=20))
    controller.throttle(19.0, 0.0, 1000.0)
    assert controller.integral < 0.1


def test_brakes_only_where_that_does_not_drive_backwards() -> None:
    controller = SpeedController(ControllerConfig(speed=0))
    assert controller.throttle(25.0, 0.0, 0.1) < 0
    assert all(controller.throttle(speed, 0.0, 0.1) == 0 for speed in (6.0, 4.0, 1.0, 0.0))


def test_throttle_stays_within_its_range() -> None:
    controller = SpeedController(ControllerConfig(speed=30, kp=10))
    assert controller.throttle(0.0, 0.0, 0.1) == 1
    assert controller.throttle(200.0, 0.0, 0.1) == -1


def test_slows_down_with_the_steering_where_asked() -> None:
    plain, careful = (
        SpeedController(ControllerConfig(speed=30, lateral_g=0)),
        SpeedController(ControllerConfig(speed=30, lateral_g=0, slow_in_curves=0.6)),
    )
    assert plain.target_speed(1.0) == 30
    assert careful.target_speed(0.0) == 30
    assert careful.target_speed(-0.5) == pytest.approx(21)
    assert careful.target_speed(1.0) == pytest.approx(12)
    assert SpeedController(ControllerConfig(speed=30, slow_in_curves=1)).target_speed(1.0) == 5


def test_smoothing_follows_with_its_time_constant() -> None:
    smooth = SteeringFilter(0.2)
    assert smooth.smooth(0.0, 0.05) == 0
    values = [smooth.smooth(1.0, 0.05) for _ in range(20)]
    assert 0 < values[0] < 0.3
    assert values == sorted(values)
    assert values[-1] > 0.95
    assert [SteeringFilter(0).smooth(value, 0.05) for value in (0.3, -0.7)] == [0.3, -0.7]


@pytest.mark.parametrize("bad", [{"speed": -1}, {"speed": 99}, {"slow_in_curves": 2}, {"kp": -1}, {"smoothing": -0.1}])
def test_impossible_settings_are_refused(bad: dict[str, float]) -> None:
    with pytest.raises(ValueError, match="must"):
        ControllerConfig(**bad).check()


def test_slows_down_to_what_the_tyres_hold() -> None:
    controller = SpeedController(ControllerConfig(speed=30, lateral_g=0.45))
    assert controller.target_speed(0.1) == 30  # a bend of 66 m radius
    assert controller.target_speed(1.0) == controller.target_speed(-1.0)
    for steering in (0.4, 1.0):
        speed = controller.target_speed(steering) * MPH
        assert speed**2 * steering_to_curvature(steering) / GRAVITY == pytest.approx(0.45)
    assert SpeedController(ControllerConfig(speed=3, lateral_g=0.01)).target_speed(1.0) == 3
    with pytest.raises(ValueError, match="--lateral-g -1"):
        ControllerConfig(lateral_g=-1).check()


def test_speeds_up_slowly_after_a_bend() -> None:
    slow, at_once = (SpeedController(ControllerConfig(speed=30, speed_gain=gain)) for gain in (2.0, 0.0))
    for controller in (slow, at_once):
        assert controller.target_speed(0.0) == 30
        controller.throttle(20.0, -0.8, 0.1)
    in_bend = slow.target_speed(0.0)
    assert in_bend == slow.target_speed(-0.8) < 15
    for _ in range(10):
        slow.throttle(20.0, 0.0, 0.1)
        at_once.throttle(20.0, 0.0, 0.1)
        assert at_once.target_speed(0.0) == 30
    assert slow.target_speed(0.0) == pytest.approx(in_bend + 2.0)
    slow.reset()
    assert slow.target_speed(0.0) == 30
