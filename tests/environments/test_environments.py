"""The Gymnasium environments: what their documentation promises to an agent."""

import os
import subprocess
import sys
from pathlib import Path
from typing import Any

import gymnasium
import numpy as np
import pytest
from conftest import REPOSITORY
from fixed_drive import digest
from gymnasium.utils.env_checker import check_env

import pilot.environments  # noqa: F401 - registers them
from pilot.environments.driving_env import DrivingEnv
from pilot.environments.observations import AHEAD, ENTRIES, SCALES
from pilot.environments.registration import environment_ids
from pilot.pursuit import EXPERT
from pilot.vehicle import curvature_to_steering

STRAIGHT = np.zeros(1, np.float32)


def make(name: str = "pilot/Mountain-v0", **options: Any) -> DrivingEnv:
    env = gymnasium.make(name, **{"observations": "state", **options}).unwrapped
    assert isinstance(env, DrivingEnv)
    return env


def pursue(observation: np.ndarray, offset: float = 0.0) -> np.ndarray:
    """Steer for the middle of the lane, or a line beside it, knowing nothing but the state vector."""
    values = observation * SCALES
    curvature = values[len(ENTRIES) - len(AHEAD) :][AHEAD.index(4)]
    curvature = EXPERT.curvature(curvature, values[2] - offset, values[3])
    return np.array([curvature_to_steering(float(curvature))], np.float32).clip(-1, 1)


def drive(env: DrivingEnv, offset: float = 0.0, seed: int = 0) -> tuple[float, bool, bool, dict[str, Any]]:
    """Drive until the episode ends; returns the sum of the rewards and what the last step returned."""
    observation, _ = env.reset(seed=seed)
    total = 0.0
    while True:
        observation, reward, terminated, truncated, info = env.step(pursue(observation, offset))
        total += reward
        if terminated or truncated:
            return total, terminated, truncated, info


def run_python(code: str) -> subprocess.CompletedProcess[str]:
    command = [sys.executable, "-W", "error", "-c", code]
    path = os.pathsep.join([str(REPOSITORY), str(Path(__file__).parent)])
    return subprocess.run(command, env={**os.environ, "PYTHONPATH": path}, capture_output=True, text=True, check=True)


@pytest.mark.parametrize("name", environment_ids())
@pytest.mark.parametrize("observations", ["state", "image"])
def test_gymnasiums_checker_has_no_complaints(name: str, observations: str) -> None:
    """Warnings are errors in these tests."""
    drawn = observations == "image"
    options = {"roads": (7, 7)} if drawn and name == "pilot/Random-v0" else {}  # a single scene, to be quick
    env = make(name, observations=observations, **options)
    assert (env.observation_space.shape, env.action_space.shape) == (
        (160, 320, 3) if drawn else (len(ENTRIES),),
        (1,),
    )
    check_env(env, skip_render_check=(name, observations) != ("pilot/Lake-v0", "image"))
    env.close()


def test_the_same_seed_and_actions_give_the_same_bytes_in_another_process() -> None:
    assert run_python("from fixed_drive import digest; print(digest())").stdout.strip() == digest()


def test_an_id_may_name_the_package_that_registers_it() -> None:
    code = "import gymnasium; print(gymnasium.make('pilot.environments:pilot/Lake-v0').unwrapped.track)"
    assert run_python(code).stdout.strip() == "lake"


def test_a_driver_who_sees_the_state_completes_a_lap() -> None:
    total, terminated, truncated, info = drive(make())
    assert (terminated, truncated, info["completed"], info["off_road"]) == (True, False, True, False)
    assert 1.0 <= info["laps"] < 1.01
    steps = info["time"] / 0.04
    assert 0.55 * steps < total < 0.67 * steps  # 20 of 30 mph, a little slower in bends


def test_driving_beside_the_lanes_middle_gives_less_reward() -> None:
    middle, beside = drive(make(laps=0.2)), drive(make(laps=0.2), 1.0)
    assert middle[3]["completed"]
    assert beside[3]["completed"]
    assert beside[0] < middle[0] - 0.05 * middle[3]["time"] / 0.04


@pytest.mark.parametrize("reversed_way", [False, True])
def test_leaving_the_road_ends_the_episode(reversed_way: bool) -> None:
    env = make("pilot/Lake-v0", reversed=reversed_way)
    env.reset()
    terminated = False
    while not terminated:
        assert env.simulator.episode.on_road
        *_, terminated, truncated, info = env.step(STRAIGHT)
    assert [info[name] for name in ("off_road", "completed", "standing")] == [True, False, False]
    assert not truncated
    assert abs(info["cross_track_error"]) > 2


def test_standing_for_ten_seconds_ends_the_episode() -> None:
    env = make(actions="steering_throttle")
    env.reset()
    ends = [env.step(np.zeros(2, np.float32))[2:] for _ in range(250)]
    assert [terminated for terminated, *_ in ends] == [False] * 249 + [True]
    assert ends[-1][2]["standing"]


def test_out_of_time_is_no_end_of_its_own() -> None:
    *_, terminated, truncated, info = drive(make(seconds=2.0))
    assert (terminated, truncated) == (False, True)
    assert info["time"] == pytest.approx(2.0)


def test_the_controller_holds_the_speed_unless_throttle_is_the_agents() -> None:
    held, free = make(speed=12.0, seconds=8.0), make(actions="steering_throttle", seconds=8.0)
    assert drive(held)[3]["speed"] == pytest.approx(12.0, abs=0.5)
    free.reset()
    for throttle in (1.0, -1.0):
        for _ in range(50):
            info = free.step(np.array([0.0, throttle], np.float32))[4]
        assert (info["throttle"], info["speed"] > 8.0) == (throttle, throttle > 0)


def test_actions_arrive_after_the_latency() -> None:
    env = make(latency_ms=60)
    env.reset()
    steered = [env.step(np.array([number / 10], np.float32))[4]["steering"] for number in range(1, 5)]
    assert steered == pytest.approx([0.0, 0.1, 0.2, 0.3])  # 60 ms: half of a step later than the step before


def test_every_episode_of_random_has_another_road_from_the_seed() -> None:
    env = make("pilot/Random-v0", roads=(20, 29))
    roads = [env.reset(seed=3)[1]["track"], *(env.reset()[1]["track"] for _ in range(5))]
    assert len(set(roads)) > 2
    assert set(roads) <= {f"random:{seed}" for seed in range(20, 30)}
    assert roads == [env.reset(seed=3)[1]["track"], *(env.reset()[1]["track"] for _ in range(5))]


def test_random_starts_are_on_the_whole_road() -> None:
    env = make(random_start=True)
    env.reset(seed=1)
    starts = [env.reset() and env.simulator.episode.where.progress for _ in range(20)]
    assert np.ptp(starts) > 400
    assert env.reset()[1]["progress"] == 0


def test_nothing_is_drawn_unless_somebody_looks() -> None:
    env, seen = make(), make(render_mode="rgb_array")
    env.reset()
    seen.reset()
    assert not hasattr(env.simulator, "renderer")
    assert env.render() is None
    frame = seen.render()
    assert frame is not None
    assert (frame.shape, frame.dtype) == ((160, 320, 3), np.uint8)
    seen.close()


def test_environments_in_other_processes_see_what_one_sees_here() -> None:
    options: dict[str, Any] = {"observations": "image", "random_start": True}
    spawn = {"context": "spawn"}
    across = gymnasium.make_vec("pilot/Lake-v0", 2, "async", vector_kwargs=spawn, **options)
    here = make("pilot/Lake-v0", **options)
    try:
        frames = [across.reset(seed=4)[0], across.step(np.array([[0.1], [-0.1]], np.float32))[0]]
        for number, steering in enumerate((0.1, -0.1)):
            assert np.array_equal(frames[0][number], here.reset(seed=4 + number)[0])
            assert np.array_equal(frames[1][number], here.step(np.array([steering], np.float32))[0])
        assert not np.array_equal(frames[0][0], frames[0][1])
    finally:
        across.close()
        here.close()


@pytest.mark.parametrize(
    ("option", "named"),
    [
        ({"observations": "picture"}, "observations='picture': must be one of image, state"),
        ({"actions": "throttle"}, "actions='throttle': must be one of steering, steering_throttle"),
        ({"speed": 90}, "speed=90: must lie in 1..30 mph"),
        ({"laps": 0}, "laps=0: must lie in"),
        ({"seconds": float("nan")}, "seconds=nan: must lie in"),
        ({"light": "night"}, "light='night': must be one of noon"),
        ({"latency_ms": 30}, "latency_ms=30: must be a multiple of 20"),
        ({"roads": (5, 2)}, r"roads=\(5, 2\): must be the first and the last seed"),
        ({"track": "moon"}, "track='moon': must be one of lake, jungle, mountain, random"),
        ({"colour": "red"}, "option='colour': must be one of observations"),
    ],
)
def test_says_which_option_is_wrong_and_what_is_right(option: dict[str, Any], named: str) -> None:
    with pytest.raises(ValueError, match=named):
        make(**option)


@pytest.mark.parametrize("action", [[float("nan")], [0.0, 0.0], 0.5])
def test_refuses_actions_that_are_none(action: Any) -> None:
    env = make()
    env.reset()
    with pytest.raises(ValueError, match="must be an array of 1 finite numbers"):
        env.step(np.array(action, np.float32))
