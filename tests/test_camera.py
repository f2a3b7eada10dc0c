import math

import numpy as np
import pytest

from pilot import camera, vehicle


def pixel(x: float, z: float) -> np.ndarray:
    """Pixel of a point on the road, metres right and ahead of the camera."""
    u, v, w = camera.ground_to_pixel() @ [x, z, 1]
    return np.array([u, v]) / w


def moved(homography: np.ndarray, point: np.ndarray) -> np.ndarray:
    u, v, w = homography @ [*point, 1]
    return np.array([u, v]) / w


def test_nearer_road_is_lower_and_right_is_right() -> None:
    assert pixel(0, 5)[1] > pixel(0, 20)[1] > 55
    assert pixel(2, 10)[0] > pixel(-2, 10)[0] + 40


def test_a_shift_to_the_right_moves_the_road_to_the_left() -> None:
    shifted = moved(camera.viewpoint_homography(1.5, 0), pixel(2.5, 8))
    np.testing.assert_allclose(shifted, pixel(1.0, 8), atol=1e-6)


def test_a_turn_to_the_right_moves_the_road_to_the_left() -> None:
    assert moved(camera.viewpoint_homography(0, math.radians(5)), pixel(0, 15))[0] < pixel(0, 15)[0] - 10


def test_moving_there_and_back_changes_nothing() -> None:
    point = np.array([200.0, 110.0])
    there = moved(camera.viewpoint_homography(0.7, 0), point)
    np.testing.assert_allclose(moved(camera.viewpoint_homography(-0.7, 0), there), point, atol=1e-6)


@pytest.mark.parametrize("steering", [-1.0, -0.2, 0.0, 0.5, 1.0])
def test_steering_and_curvature_are_each_others_inverse(steering: float) -> None:
    assert vehicle.curvature_to_steering(vehicle.steering_to_curvature(steering)) == pytest.approx(steering)
    assert np.sign(vehicle.steering_to_curvature(steering)) == np.sign(steering)


def test_the_path_bends_where_the_steering_points() -> None:
    left, straight, right = (camera.path_pixels(steering)[-1, 0] for steering in (-0.3, 0.0, 0.3))
    assert left < straight - 10 < straight + 10 < right
