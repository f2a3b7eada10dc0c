import math
from dataclasses import replace

import numpy as np
import pytest
from conftest import circle, picture

from pilot import vehicle
from pilot.data import augment, augment_batch
from pilot.data.augment import AugmentConfig
from pilot.data.samples import side_steering
from pilot.data.view import View, render
from pilot.simulator.catalogue import load_track
from pilot.simulator.episode import Episode
from pilot.simulator.expert import Expert
from pilot.training.recipes import RECIPES

WHOLE = (0, 160)
NOTHING = AugmentConfig(flip=0, rotation=0, brightness=0, shadow=0, crop=0, viewpoint=0)


def post_column(frame: np.ndarray) -> float:
    """Middle column of the bright post."""
    bright = (frame[72:130, :, 0] > 180) & (frame[72:130, :, 2] < 110)
    return float(np.argwhere(bright)[:, 1].mean())


def test_flip_mirrors_picture_and_steering() -> None:
    view = augment.flip(View(0.3))
    frame = picture(0.5)
    assert view.steering == -0.3
    np.testing.assert_array_equal(render(frame, view.homography, WHOLE), frame[:, ::-1])


@pytest.mark.parametrize("degrees", [-45.0, -5.0, 5.0, 45.0])
def test_rotation_adds_its_angle_in_radians(degrees: float) -> None:
    view = augment.rotate(View(0.1), degrees)
    assert view.steering == pytest.approx(0.1 + math.radians(degrees))
    # counter-clockwise: what is below the middle moves to the right
    low = np.array([160, 120, 1])
    moved = view.homography @ low
    assert np.sign(moved[0] - 160) == np.sign(degrees)


def test_rotation_uses_the_whole_frame_before_the_crop() -> None:
    frame = np.full((160, 320, 3), 200, np.uint8)
    rows = render(frame, augment.rotate(View(0), 5).homography, (70, 135))
    assert rows.shape == (65, 320, 3)
    assert rows[:, 40:280].min() == 200  # no black corner of a rotated crop


@pytest.mark.parametrize("offset", [-0.8, 0.8])
def test_a_shifted_viewpoint_steers_back_to_the_path(offset: float) -> None:
    view = augment.shift_viewpoint(View(0.1), offset, 0, 10)
    assert np.sign(view.steering - 0.1) == -np.sign(offset)
    moved = post_column(render(picture(0), view.homography, WHOLE))
    assert np.sign(moved - post_column(picture(0))) == -np.sign(offset)


@pytest.mark.parametrize("heading", [-0.05, 0.05])
def test_a_turned_viewpoint_steers_back_to_the_path(heading: float) -> None:
    view = augment.shift_viewpoint(View(0.1), 0, heading, 10)
    assert np.sign(view.steering - 0.1) == -np.sign(heading)


def test_the_recovery_label_reaches_the_path_at_the_lookahead() -> None:
    offset, heading, lookahead = 0.6, 0.03, 12.0
    view = augment.shift_viewpoint(View(0.2), offset, heading, lookahead)
    before, after = vehicle.steering_to_curvature(0.2), vehicle.steering_to_curvature(view.steering)
    assert offset + heading * lookahead + (after - before) * lookahead**2 / 2 == pytest.approx(0)


def test_in_a_tight_bend_a_displaced_view_returns_nearer() -> None:
    def correction(curvature: float) -> float:
        view = augment.shift_viewpoint(View(vehicle.curvature_to_steering(curvature)), 1.0, 0.0, 15.0, 8.0)
        return vehicle.steering_to_curvature(view.steering) - curvature

    assert correction(0.0) == pytest.approx(-2 / 15**2)
    assert correction(-1 / 20) == pytest.approx(-2 / 11**2)  # 0.55 of the bend's radius ahead
    assert correction(1 / 10) == pytest.approx(-2 / 8**2)


@pytest.mark.parametrize("recipe", ["default", "built-in"])
def test_a_shift_by_a_side_camera_means_the_side_cameras_correction(recipe: str) -> None:
    config = RECIPES[recipe]
    for camera, offset in vehicle.CAMERA_OFFSETS.items():
        view = augment.shift_viewpoint(View(0.1), offset, 0, config.augment.viewpoint_lookahead)
        assert view.steering == pytest.approx(side_steering(0.1, camera, config.samples), abs=0.006)


def test_labels_of_displaced_views_are_the_experts_steering_from_there() -> None:
    """On a straight and in a bend of 60 m radius, to the left and to the right of the path, and askew."""
    for track, start in ((load_track("lake"), 750.0), (circle(), 20.0)):
        episode = Episode(track)
        for offset, heading in ((0.8, 0.0), (-1.5, 0.0), (0.5, 0.05)):
            episode.place(start)
            plain = Expert(episode).command()[0]
            episode.place(start, offset, heading)
            view = augment.shift_viewpoint(View(plain), offset, heading, None)
            assert view.steering == pytest.approx(Expert(episode).command()[0], abs=0.02)


def test_height_crop_stretches_the_rows_left_and_keeps_the_label() -> None:
    top, bottom = 0.475, 0.075
    view = augment.crop_height(View(0.4), top, bottom)
    assert view.steering == 0.4
    frame = np.repeat(np.arange(160, dtype=np.uint8)[:, None, None], 320, 1).repeat(3, 2)
    seen = render(frame, view.homography, (augment.CROP_TOP, augment.CROP_BOTTOM))[:, 100, 0]
    assert seen[0] == pytest.approx(top * 160, abs=1.5)
    assert seen[-1] == pytest.approx((1 - bottom) * 160, abs=2.5)


def test_without_saturation_every_colour_is_grey() -> None:
    frame = picture(0)
    grey = augment.saturation(frame, 0.0)
    np.testing.assert_allclose(grey, frame.mean(2, keepdims=True).repeat(3, 2), atol=1)  # OpenCV truncates coefficients
    np.testing.assert_array_equal(augment.saturation(frame, 1.0), frame)
    assert np.ptp(augment.saturation(frame, 1.5), axis=2).sum() > np.ptp(frame, axis=2).sum()


def test_brightness_scales_the_value_and_stays_in_range() -> None:
    frame = picture(0)
    np.testing.assert_allclose(augment.brightness(frame, 0.5), frame * 0.5, atol=0.51)
    assert augment.brightness(frame, 1.2).max() == 255
    np.testing.assert_array_equal(frame, picture(0))


def test_shadow_darkens_one_side_only() -> None:
    frame = picture(0)
    shaded = augment.shadow(frame, 100, 200, True, 0.5)
    np.testing.assert_array_equal(shaded[:, :90], frame[:, :90])
    np.testing.assert_allclose(shaded[:, 210:], frame[:, 210:] * 0.5, atol=0.51)
    np.testing.assert_array_equal(frame, picture(0))


def test_views_are_joined_in_order() -> None:
    """Rotated, then mirrored: one warp gives what two would."""
    frame = picture(0.3)
    turned, mirrored = augment.rotate(View(0), 10), augment.flip(View(0))
    joined = render(frame, augment.flip(turned).homography, WHOLE)
    one_by_one = render(render(frame, turned.homography, WHOLE), mirrored.homography, WHOLE)
    assert np.abs(joined.astype(int) - one_by_one).mean() < 1


def drawn_views(config: AugmentConfig, rng: np.random.Generator) -> View:
    """400 views of a steering of 0.5, changed by the geometric augmentations."""
    drawn = augment_batch.draw_geometric(400, config, rng)
    return augment_batch.apply_geometric(View(np.full(400, 0.5)), drawn, np.arange(400), config)


def test_each_augmentation_happens_with_its_probability() -> None:
    rng = np.random.default_rng(0)
    unchanged = drawn_views(NOTHING, rng)
    assert (unchanged.steering == 0.5).all()
    assert (unchanged.homography == np.eye(3)).all()
    assert (drawn_views(replace(NOTHING, flip=1), rng).steering == -0.5).all()
    mirrored = (drawn_views(replace(NOTHING, flip=0.5), rng).steering < 0).sum()
    assert 150 < mirrored < 250
    frame = picture(0)
    drawn = augment_batch.draw_photometric(9, NOTHING, rng)
    for number in range(9):
        np.testing.assert_array_equal(augment_batch.apply_photometric(frame, drawn, number), frame)
    shaded = (augment_batch.draw_photometric(400, replace(NOTHING, shadow=0.5), rng)[1][:, 3] < 1).sum()
    assert 150 < shaded < 250


def test_many_views_are_what_each_would_be() -> None:
    steering, offset, heading = np.array([-0.3, 0.2]), np.array([0.5, -0.8]), np.array([0.02, -0.05])
    together = augment.rotate(augment.shift_viewpoint(View(steering), offset, heading, 10), np.array([3, -2]))
    for number, degrees in enumerate((3, -2)):
        alone = augment.shift_viewpoint(View(steering[number]), offset[number], heading[number], 10)
        alone = augment.rotate(alone, degrees)
        assert together.steering[number] == pytest.approx(alone.steering)
        np.testing.assert_allclose(together.homography[number], alone.homography)
