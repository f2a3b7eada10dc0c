"""Augmentations: pure functions of frames and their labels.

Geometric augmentations change a `View`: the homography that maps the pixels of the recorded frame, and the label. They
are composed by matrix multiplication, so that the frame is warped only once and from the whole recorded image (the
borders of the crop never become visible), and only the rows that the network uses are computed. Photometric
augmentations change the colours of pixels and leave the label unchanged.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass

import cv2
import numpy as np

from pilot import camera
from pilot.arrays import Floats, Frame
from pilot.data.view import CROP_BOTTOM, CROP_TOP, MIRROR, View
from pilot.pursuit import EXPERT, PurePursuit
from pilot.vehicle import COLUMNS, ROWS, curvature_to_steering, steering_to_curvature

LOOKAHEAD_BY_RADIUS = 0.55  # of a bend; the point on the path then lies in a direction of 16 degrees


@dataclass(frozen=True)
class AugmentConfig:
    """Augmentations in training: the probability (0: never) and the range of each."""

    flip: float = 0.5
    """Probability of mirroring left and right, which changes the sign of the steering."""
    rotation: float = 0.0
    """Probability of rotating the image about its centre; the angle in radians is added to the steering."""
    rotation_degrees: float = 5.0
    """Largest rotation in degrees, in either direction."""
    brightness: float = 0.5
    """Probability of changing the brightness."""
    brightness_range: tuple[float, float] = (0.25, 1.2)
    """Range of the factor for the brightness (HSV value)."""
    shadow: float = 0.5
    """Probability of a shadow on one side of a random line."""
    shadow_range: tuple[float, float] = (0.25, 0.7)
    """Range of the factor for the brightness in the shadow."""
    saturation: float = 0.0
    """Probability of changing the saturation of the colours, against dependence on colours that differ elsewhere."""
    saturation_range: tuple[float, float] = (0.0, 1.5)
    """Range of the factor for the saturation; 0: grey."""
    crop: float = 0.0
    """Probability of cropping the height at random; the rest is scaled to the rows that the network uses."""
    crop_top: tuple[float, float] = (0.325, 0.475)
    """Range of the share (0..1) of the frame's height cropped at the top."""
    crop_bottom: tuple[float, float] = (0.075, 0.175)
    """Range of the share (0..1) of the frame's height cropped at the bottom."""
    viewpoint: float = 0.5
    """Probability of shifting and turning the viewpoint, with steering that returns to the driver's path."""
    viewpoint_metres: float = 1.0
    """Largest shift of the viewpoint in metres, to either side."""
    viewpoint_degrees: float = 5.0
    """Largest rotation of the viewpoint in degrees, to either side."""
    viewpoint_lookahead: float | None = 15.0
    """Metres ahead at which the steering has returned to the path (7.2 corresponds to a side correction of 0.2). None:
    the law of the built-in expert."""
    viewpoint_nearest: float | None = None
    """The same in the tightest bends, because people steer for a nearer point there: the lookahead is 0.55 of the
    bend's radius, between viewpoint-nearest and viewpoint-lookahead. None: viewpoint-lookahead everywhere."""

    def check(self) -> None:
        """Check the values.

        Raises:
            ValueError: a value is invalid; the message names the option, its value and the valid range.
        """
        for name in [geometric.name for geometric in GEOMETRIC] + [photometric.name for photometric in PHOTOMETRIC]:
            probability = getattr(self, name)
            if not 0 <= probability <= 1:
                raise ValueError(f"--augment.{name} {probability}: must lie in 0..1")
        for name in ("brightness_range", "shadow_range", "saturation_range", "crop_top", "crop_bottom"):
            low, high = getattr(self, name)
            if not 0 <= low <= high:
                raise ValueError(
                    f"--augment.{name.replace('_', '-')} {low} {high}: must not be negative, the smaller one first"
                )
        if self.crop_top[1] + self.crop_bottom[1] >= 1:
            raise ValueError(
                f"--augment.crop-top {self.crop_top[1]} and --augment.crop-bottom {self.crop_bottom[1]}: "
                "together must leave a part of the frame"
            )
        if self.viewpoint_lookahead is not None and self.viewpoint_lookahead <= 0:
            raise ValueError(f"--augment.viewpoint-lookahead {self.viewpoint_lookahead}: must be greater than 0")
        farthest = self.viewpoint_lookahead
        if self.viewpoint_nearest is not None and (farthest is None or not 0 < self.viewpoint_nearest <= farthest):
            raise ValueError(
                f"--augment.viewpoint-nearest {self.viewpoint_nearest}: must be greater than 0, and at most "
                f"--augment.viewpoint-lookahead, which is {farthest}"
            )


# Geometric augmentations: homography and label


def flip(view: View) -> View:
    """Mirror left and right, and change the sign of the steering."""
    return view.transformed(MIRROR, -view.steering)


def rotate(view: View, degrees: float | Floats) -> View:
    """Rotate counter-clockwise about the centre and add the angle in radians to the steering (report 000).

    As in the report, the label is not clipped and may exceed -1..1.
    """
    angle, x, y = np.radians(degrees), COLUMNS / 2, ROWS / 2
    sine, cosine = np.sin(angle), np.cos(angle)
    turn = camera.matrices(cosine, sine, x - cosine * x - sine * y, -sine, cosine, y + sine * x - cosine * y, 0, 0, 1)
    return view.transformed(turn, view.steering + angle)


def crop_height(view: View, top: float | Floats, bottom: float | Floats) -> View:
    """Crop shares (0..1) of the height at top and bottom and scale the rest to CROP_TOP..CROP_BOTTOM (report 004)."""
    first, last = top * ROWS, (1 - bottom) * ROWS
    scale = (CROP_BOTTOM - CROP_TOP) / (last - first)
    return view.transformed(camera.matrices(1, 0, 0, 0, scale, CROP_TOP - first * scale, 0, 0, 1), view.steering)


def shift_viewpoint(
    view: View,
    offset: float | Floats,
    heading: float | Floats,
    lookahead: float | None,
    nearest: float | None = None,
) -> View:
    """Show the road from a car displaced from the driver's path, with the steering that returns to it.

    Based on NVIDIA's shift and rotation (arXiv 1604.07316, section 5). There the label returns to the path within two
    seconds, here at the point of the driver's arc `lookahead` metres ahead.

    If `view.metres` is not 0, the car is shown so far from the place where it is displaced, on its way back.

    Args:
        view: the view from the driver's path.
        offset: distance of the car from the path in metres, positive to the right.
        heading: angle between the car and the path's direction in radians, positive to the right.
        lookahead: distance in metres along the driver's arc after which the path is reached; None: the expert's law.
        nearest: the same in the tightest bends; None: `lookahead` there, too.
    """
    curvature = steering_to_curvature(np.asarray(view.steering))
    law = EXPERT if lookahead is None else PurePursuit(_lookahead(curvature, lookahead, nearest), 0.0)
    there = law.after(view.metres, offset, heading)
    steering = curvature_to_steering(law.curvature(curvature, *there))
    return view.transformed(camera.viewpoint_homography(*there), steering)


def _lookahead(curvature: Floats, farthest: float, nearest: float | None) -> Floats:
    radius = 1 / np.maximum(np.abs(curvature), 1e-9)
    return np.clip(LOOKAHEAD_BY_RADIUS * radius, farthest if nearest is None else nearest, farthest)


# Photometric augmentations: pixels only


def brightness(pixels: Frame, factor: float) -> Frame:
    """Scale the HSV value by a factor (report 004), which is equivalent to scaling red, green and blue."""
    return np.asarray(cv2.convertScaleAbs(pixels, alpha=factor), np.uint8)


def shadow(pixels: Frame, top: float, bottom: float, right: bool, factor: float) -> Frame:
    """Scale the brightness right or left of the line from column `top` to column `bottom` by a factor (report 004)."""
    height, width = pixels.shape[:2]
    edge = width if right else 0
    outline = np.array([[top, 0], [bottom, height], [edge, height], [edge, 0]], np.int32)
    mask = np.zeros((height, width), np.uint8)
    cv2.fillPoly(mask, [outline], 255)
    return np.asarray(cv2.copyTo(brightness(pixels, factor), mask, pixels.copy()), np.uint8)


def saturation(pixels: Frame, factor: float) -> Frame:
    """Scale each pixel's colour differences from its mean of red, green and blue by a factor."""
    return np.asarray(cv2.transform(pixels, factor * np.eye(3) + (1 - factor) / 3), np.uint8)


# The augmentations used by training. A new one needs an entry in GEOMETRIC or PHOTOMETRIC and its fields in
# AugmentConfig; a photometric one also needs its counterpart in device_augment.py


@dataclass(frozen=True)
class Geometric:
    """An augmentation that moves pixels and may change the label.

    Attributes:
        name: name of the AugmentConfig field with its probability.
        draw: function that draws the parameters of n views: n x number of parameters.
        apply: function that changes n views by their parameters.
        examples: function that returns the views at the limits of the parameters' range, by description.
    """

    name: str
    draw: Callable[[int, AugmentConfig, np.random.Generator], Floats]
    apply: Callable[[View, Floats, AugmentConfig], View]
    examples: Callable[[View, AugmentConfig], dict[str, View]]


@dataclass(frozen=True)
class Photometric:
    """An augmentation that changes colours, controlled by `size` parameters.

    Attributes:
        name: name of the AugmentConfig field with its probability.
        size: number of parameters per frame.
        draw: function that draws the parameters of n frames: n x size. Frames not selected get a factor of 1.
        apply: function that changes the pixels of a frame by its parameters.
        examples: function that returns the parameters at the limits of their range, by description.
    """

    name: str
    size: int
    draw: Callable[[int, AugmentConfig, np.random.Generator], Floats]
    apply: Callable[[Frame, Floats], Frame]
    examples: Callable[[AugmentConfig], dict[str, Floats]]


def _draw_viewpoint(n: int, config: AugmentConfig, rng: np.random.Generator) -> Floats:
    """Draw the arguments of `shift_viewpoint`: n x (offset in metres, heading in radians)."""
    offset = rng.uniform(-config.viewpoint_metres, config.viewpoint_metres, n)
    heading = np.radians(rng.uniform(-config.viewpoint_degrees, config.viewpoint_degrees, n))
    return np.stack([offset, heading], 1)


def _apply_viewpoint(view: View, parameters: Floats, config: AugmentConfig) -> View:
    offset, heading = parameters.T
    return shift_viewpoint(view, offset, heading, config.viewpoint_lookahead, config.viewpoint_nearest)


def _viewpoint_examples(view: View, config: AugmentConfig) -> dict[str, View]:
    metres, degrees = config.viewpoint_metres, config.viewpoint_degrees
    return {
        f"viewpoint {side * metres:+g} m, {turn * degrees:+g}°": shift_viewpoint(
            view, side * metres, turn * math.radians(degrees), config.viewpoint_lookahead, config.viewpoint_nearest
        )
        for side in (-1, 1)
        for turn in (-1, 1)
    }


def _draw_rotation(n: int, config: AugmentConfig, rng: np.random.Generator) -> Floats:
    return rng.uniform(-config.rotation_degrees, config.rotation_degrees, (n, 1))


def _rotation_examples(view: View, config: AugmentConfig) -> dict[str, View]:
    degrees = config.rotation_degrees
    return {f"rotation by {sign * degrees:+g}°": rotate(view, sign * degrees) for sign in (-1, 1)}


def _draw_crop(n: int, config: AugmentConfig, rng: np.random.Generator) -> Floats:
    """Draw the arguments of `crop_height`: n x (top, bottom)."""
    return np.stack([rng.uniform(*config.crop_top, n), rng.uniform(*config.crop_bottom, n)], 1)


def _crop_examples(view: View, config: AugmentConfig) -> dict[str, View]:
    return {
        f"height crop {top:.0%} above, {bottom:.0%} below": crop_height(view, top, bottom)
        for top in config.crop_top
        for bottom in config.crop_bottom
    }


def _draw_factors(n: int, probability: float, limits: tuple[float, float], rng: np.random.Generator) -> Floats:
    """Draw n factors, which are 1 with the probability that an augmentation does not happen."""
    return np.where(rng.random(n) < probability, rng.uniform(*limits, n), 1.0)


def _draw_brightness(n: int, config: AugmentConfig, rng: np.random.Generator) -> Floats:
    return _draw_factors(n, config.brightness, config.brightness_range, rng)[:, None]


def _apply_brightness(pixels: Frame, parameters: Floats) -> Frame:
    return pixels if parameters[0] == 1 else brightness(pixels, parameters[0])


def _draw_shadow(n: int, config: AugmentConfig, rng: np.random.Generator) -> Floats:
    """Draw the arguments of `shadow`: n x (top, bottom, right as 0 or 1, factor)."""
    drawn = np.empty((n, 4))
    drawn[:, 3] = _draw_factors(n, config.shadow, config.shadow_range, rng)
    drawn[:, :2] = rng.uniform(0, COLUMNS, (2, n)).T
    drawn[:, 2] = rng.integers(2, size=n)
    return drawn


def _apply_shadow(pixels: Frame, parameters: Floats) -> Frame:
    top, bottom, right, factor = parameters
    return pixels if factor == 1 else shadow(pixels, top, bottom, bool(right), factor)


def _draw_saturation(n: int, config: AugmentConfig, rng: np.random.Generator) -> Floats:
    return _draw_factors(n, config.saturation, config.saturation_range, rng)[:, None]


def _apply_saturation(pixels: Frame, parameters: Floats) -> Frame:
    return pixels if parameters[0] == 1 else saturation(pixels, parameters[0])


GEOMETRIC: list[Geometric] = [
    Geometric("viewpoint", _draw_viewpoint, _apply_viewpoint, _viewpoint_examples),
    Geometric("rotation", _draw_rotation, lambda view, drawn, _: rotate(view, drawn[:, 0]), _rotation_examples),
    Geometric("crop", _draw_crop, lambda view, drawn, _: crop_height(view, drawn[:, 0], drawn[:, 1]), _crop_examples),
    Geometric(
        "flip", lambda n, *_: np.empty((n, 0)), lambda view, *_: flip(view), lambda view, _: {"flip": flip(view)}
    ),
]
PHOTOMETRIC: list[Photometric] = [
    Photometric(
        "brightness",
        1,
        _draw_brightness,
        _apply_brightness,
        lambda config: {f"brightness x {factor:g}": np.array([factor]) for factor in config.brightness_range},
    ),
    Photometric(
        "shadow",
        4,
        _draw_shadow,
        _apply_shadow,
        lambda config: {"shadow": np.array([0.35 * COLUMNS, 0.6 * COLUMNS, 1.0, config.shadow_range[0]])},
    ),
    Photometric(
        "saturation",
        1,
        _draw_saturation,
        _apply_saturation,
        lambda config: {f"saturation x {factor:g}": np.array([factor]) for factor in config.saturation_range},
    ),
]
