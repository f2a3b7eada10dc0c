"""The built-in simulator: what its cameras see, and that it always does the same."""

import itertools
import math

import cv2
import numpy as np
import pytest
from conftest import straightest

from pilot.camera import ground_to_pixel, viewpoint_homography
from pilot.simulator.course import LIGHTS
from pilot.simulator.simulator import Simulator
from pilot.vehicle import CAMERAS, SIDE_CAMERA_OFFSET

ABOVE_BONNET = slice(0, 134)


@pytest.fixture(scope="module")
def simulator() -> Simulator:
    return Simulator(CAMERAS)


def difference(first: np.ndarray, second: np.ndarray, rows: slice = ABOVE_BONNET) -> float:
    """Mean difference in grey levels."""
    return float(np.abs(first[rows].astype(float) - second[rows]).mean())


def test_frames_are_as_the_real_simulators(simulator: Simulator) -> None:
    frames = simulator.reset("lake").frames
    assert set(frames) == set(CAMERAS)
    for frame in frames.values():
        assert frame.shape == (160, 320, 3)
        assert frame.dtype == np.uint8
    sky, road = frames["center"][5].mean(0), frames["center"][120, 130:190].mean(0)
    assert sky[2] > sky[0] + 20  # RGB: the sky is blue
    assert np.ptp(road) < 30  # and asphalt grey


def test_the_same_commands_give_the_same_frames(simulator: Simulator) -> None:
    runs = []
    for _ in range(2):
        simulator.reset("random:3", seed=5)
        runs.append([simulator.step(0.05, 1.0) for _ in range(20)])
    for first, second in zip(*runs, strict=True):
        assert first.state == second.state
        assert all(np.array_equal(first.frames[camera], second.frames[camera]) for camera in CAMERAS)


def test_reset_again_in_another_simulator_gives_the_same_frames(simulator: Simulator) -> None:
    first = simulator.reset("lake").frames["left"]
    with Simulator(CAMERAS) as other:
        assert np.array_equal(first, other.reset("lake").frames["left"])


def test_two_simulators_do_not_draw_each_others_frames(simulator: Simulator) -> None:
    simulator.reset("lake")
    before = simulator.step(0.0, 1.0).frames["center"]
    with Simulator() as other:
        other.reset("mountain")
        assert not simulator.renderer._output.is_active()  # or the other's frames would take its time too
        other.step(0.0, 1.0)
        assert np.array_equal(before, simulator.look()["center"])


def test_without_cameras_no_scene_is_built() -> None:
    with Simulator(()) as simulator:
        assert simulator.reset("lake").frames == {}
        assert simulator.step(0.0, 1.0).state.speed > 0
        assert not hasattr(simulator, "renderer")


@pytest.mark.parametrize(("camera", "side"), [("left", -1), ("right", 1)])
def test_a_side_camera_sees_what_the_middle_one_sees_from_there(simulator: Simulator, camera: str, side: int) -> None:
    simulator.reset("lake")
    simulator.episode.place(30.0)
    seen = simulator.look()[camera]
    simulator.episode.place(30.0, side * SIDE_CAMERA_OFFSET)
    assert difference(simulator.look()["center"], seen) < 1.0


def test_lines_on_the_road_are_where_the_cameras_geometry_says(simulator: Simulator) -> None:
    simulator.reset("lake")
    simulator.episode.place(330.0)  # straight, and not on the bridge, which has no lines
    frame = simulator.look()["center"].astype(int)
    yellow = frame[:, :, :2].mean(2) - frame[:, :, 2] > 60
    yellow[:, 158:162] = False
    line = 4.8 - 1.15 - 0.08  # metres from the middle of the road
    for distance, side in itertools.product((4.5, 6.0, 8.0), (-1, 1)):
        u, v, w = ground_to_pixel() @ (side * line, distance, 1)
        column, row = u / w, v / w
        rows = np.flatnonzero(yellow[:, round(column)]) if 0 <= column < 320 else []
        if len(rows):
            assert abs(np.array(rows) - row).min() < 2.0, (distance, side)
    assert yellow[:, 0:4].any()
    assert yellow[:, 316:].any()


@pytest.mark.parametrize(("offset", "heading"), [(0.8, 0.0), (0.0, 0.07), (-0.6, -0.05)])
def test_a_warped_frame_looks_like_one_taken_from_there(simulator: Simulator, offset: float, heading: float) -> None:
    """What training's shifted viewpoints and the replay of recordings rest on."""
    simulator.reset("lake")
    start = straightest(simulator.episode.track)
    simulator.episode.place(start)
    before = simulator.look()["center"]
    simulator.episode.place(start, offset, heading)
    there = simulator.look()["center"]
    warped = cv2.warpPerspective(before, viewpoint_homography(offset, heading), (320, 160))
    road = np.zeros((160, 320), bool)
    road[75:132, 40:280] = True
    wrong = np.abs(warped.astype(float) - there).mean(2)[road].mean()
    unwarped = np.abs(before.astype(float) - there).mean(2)[road].mean()
    assert wrong < 0.7 * unwarped


def test_light_changes_the_picture_and_not_the_road(simulator: Simulator) -> None:
    frames = {light: simulator.reset("lake", light=light).frames["center"] for light in LIGHTS}
    for first, second in itertools.combinations(frames.values(), 2):
        assert difference(first, second) > 5
    assert len({simulator.episode.track.length for _ in LIGHTS}) == 1


def test_seeds_choose_the_start(simulator: Simulator) -> None:
    starts = [simulator.reset("lake", seed=seed).state for seed in (None, 1, 2, 1)]
    assert starts[1] == starts[3]
    assert len({(state.x, state.y) for state in starts}) == 3


def test_says_when_a_wheel_leaves_the_road_and_how_far_it_went(simulator: Simulator) -> None:
    observation = simulator.reset("lake")
    assert observation.state.on_road
    for _ in range(200):
        observation = simulator.step(0.3, 1.0)
        if not observation.state.on_road:
            break
    assert not observation.state.on_road
    assert abs(observation.state.cross_track_error) > 1.5
    start = simulator.episode.track.at(0)
    straight = math.hypot(observation.state.x - start[0], observation.state.y - start[1])
    assert observation.state.progress == pytest.approx(straight, rel=0.2)


def test_reversed_is_driven_the_other_way(simulator: Simulator) -> None:
    forward = simulator.reset("mountain").state.heading
    backward = simulator.reset("mountain reversed").state.heading
    assert math.cos(forward - backward) == pytest.approx(-1, abs=0.05)


@pytest.mark.parametrize("bad", [{"track": "moon"}, {"light": "night"}])
def test_says_what_there_is(simulator: Simulator, bad: dict[str, str]) -> None:
    with pytest.raises(ValueError, match="there are"):
        simulator.reset(**bad)


def test_the_road_hides_the_land_and_the_bonnet_is_there(simulator: Simulator) -> None:
    simulator.reset("jungle")
    for start in np.arange(0, 1300, 40.0):
        simulator.episode.place(start)
        frames = simulator.look()
        green = frames["center"][100:130, 130:200].astype(int)
        assert (green[:, :, 1] - green[:, :, 0] > 25).mean() < 0.02, start
    bonnet, glass = frames["center"][145, 150:160].mean(0), frames["center"][157, 150:160].mean()
    assert bonnet[0] > bonnet[2] + 30  # the car is of a sandy colour
    assert glass > bonnet.mean()
