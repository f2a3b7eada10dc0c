"""Augmentations: pure functions on what a camera sees and on the steering that goes with it.

The geometric ones change a `View`: a homography that says where each pixel of the recorded frame
goes, and the label. They are joined by multiplication, so the frame is warped just once, from the
whole recorded picture (no border of a crop is ever seen), and only the rows that the network looks
at are computed. The photometric ones change pixels in place and leave the label alone.
"""

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass

import cv2
import numpy as np

from pilot import camera
from pilot.arrays import Floats, Frame
from pilot.data.view import CROP_BOTTOM, CROP_TOP, MIRROR, View
from pilot.vehicle import COLUMNS, ROWS, curvature_to_steering, steering_to_curvature


@dataclass(frozen=True)
class AugmentConfig:
    """Which augmentations training uses: for each its probability (0: never) and range."""

    flip: float = 0.5
    """Probability of mirroring left and right; the steering changes its sign."""
    rotation: float = 0.0
    """Probability of rotating the picture about its middle; the angle in radians is added to the steering."""
    rotation_degrees: float = 5.0
    """Rotation angles are drawn from -degrees..degrees."""
    brightness: float = 0.5
    """Probability of a change of brightness."""
    brightness_range: tuple[float, float] = (0.25, 1.2)
    """Factor on the brightness (HSV value)."""
    shadow: float = 0.5
    """Probability of a shadow on one side of a random line."""
    shadow_range: tuple[float, float] = (0.25, 0.7)
    """Factor on the brightness in the shadow."""
    crop: float = 0.0
    """Probability of a random height crop, stretched back to the usual rows."""
    crop_top: tuple[float, float] = (0.325, 0.475)
    """Share of the frame's height cut off above."""
    crop_bottom: tuple[float, float] = (0.075, 0.175)
    """Share of the frame's height cut off below."""
    viewpoint: float = 0.5
    """Probability of showing the road from beside the driver's path, with steering that leads back to it."""
    viewpoint_metres: float = 1.0
    """The viewpoint is shifted by up to this, to either side."""
    viewpoint_degrees: float = 5.0
    """The viewpoint is turned by up to this, to either side."""
    viewpoint_lookahead: float = 15.0
    """Metres ahead at which the label's steering has brought the car back (7.2 m make a side camera's 0.2)."""

    def check(self) -> None:
        """Refuse values that cannot work.

        Raises:
            ValueError: names the option, its value and what it may be.
        """
        for name in [geometric.name for geometric in GEOMETRIC] + [photometric.name for photometric in PHOTOMETRIC]:
            probability = getattr(self, name)
            if not 0 <= probability <= 1:
                raise ValueError(f"--augment.{name} {probability}: must lie in 0..1")
        if self.viewpoint_lookahead <= 0:
            raise ValueError(f"--augment.viewpoint-lookahead {self.viewpoint_lookahead}: must be greater than 0")


# Geometry: what is seen, and the label


def flip(view: View) -> View:
    """Mirror left and right: the steering changes its sign."""
    return view.transformed(MIRROR, -view.steering)


def rotate(view: View, degrees: float | Floats) -> View:
    """Rotate counter-clockwise about the middle and add the angle in radians to the steering (report 000).

    The label may go beyond -1..1; it is left there, as in the report.
    """
    angle, x, y = np.radians(degrees), COLUMNS / 2, ROWS / 2
    sine, cosine = np.sin(angle), np.cos(angle)
    turn = camera.matrices(cosine, sine, x - cosine * x - sine * y, -sine, cosine, y + sine * x - cosine * y, 0, 0, 1)
    return view.transformed(turn, view.steering + angle)


def crop_height(view: View, top: float | Floats, bottom: float | Floats) -> View:
    """Cut shares of the height off above and below and stretch the rest over the usual rows (report 004)."""
    first, last = top * ROWS, (1 - bottom) * ROWS
    scale = (CROP_BOTTOM - CROP_TOP) / (last - first)
    return view.transformed(camera.matrices(1, 0, 0, 0, scale, CROP_TOP - first * scale, 0, 0, 1), view.steering)


def shift_viewpoint(view: View, offset: float | Floats, heading: float | Floats, lookahead: float) -> View:
    """See the road from a car that stands beside the driver's path, and steer back to it.

    After NVIDIA's shift and rotation (arXiv 1604.07316, section 5): there the label leads back
    within two seconds, here to the point of the driver's arc `lookahead` metres ahead.

    Args:
        view: from the driver's path.
        offset: metres to the right of the path.
        heading: radians to the right of the path's direction.
        lookahead: metres.
    """
    curvature = steering_to_curvature(np.asarray(view.steering))
    back = curvature - 2 * (offset + lookahead * heading) / lookahead**2
    return view.transformed(camera.viewpoint_homography(offset, heading), curvature_to_steering(back))


# Light: pixels only


def brightness(pixels: Frame, factor: float) -> Frame:
    """Scale the HSV value by a factor (report 004): the same as scaling red, green and blue."""
    return np.asarray(cv2.convertScaleAbs(pixels, alpha=factor), np.uint8)


def shadow(pixels: Frame, top: float, bottom: float, right: bool, factor: float) -> Frame:
    """Darken one side of a line that enters at column `top` and leaves at column `bottom` (report 004)."""
    height, width = pixels.shape[:2]
    edge = width if right else 0
    outline = np.array([[top, 0], [bottom, height], [edge, height], [edge, 0]], np.int32)
    mask = np.zeros((height, width), np.uint8)
    cv2.fillPoly(mask, [outline], 255)
    return np.asarray(cv2.copyTo(brightness(pixels, factor), mask, pixels.copy()), np.uint8)


# Each of them, as training uses it. Another one is an entry here with its fields in AugmentConfig; one that changes
# pixels needs its counterpart in device_augment.py


@dataclass(frozen=True)
class Geometric:
    """An augmentation that moves pixels, and may change the label.

    Attributes:
        name: of its probability in AugmentConfig.
        draw: n views, each changed at random.
        examples: a view changed as much as it may be, by what is done.
    """

    name: str
    draw: Callable[[View, AugmentConfig, np.random.Generator], View]
    examples: Callable[[View, AugmentConfig], dict[str, View]]


@dataclass(frozen=True)
class Photometric:
    """An augmentation that changes pixels where they are, by some numbers.

    Attributes:
        name: of its probability in AugmentConfig.
        draw: those numbers for n frames, each frame with the probability: n x size.
        size: how many there are.
        apply: changes the pixels of a frame by its numbers.
        examples: numbers at the ends of the range, by what they do.
    """

    name: str
    size: int
    draw: Callable[[int, AugmentConfig, np.random.Generator], Floats]
    apply: Callable[[Frame, Floats], Frame]
    examples: Callable[[AugmentConfig], dict[str, Floats]]


def _draw_viewpoint(view: View, config: AugmentConfig, rng: np.random.Generator) -> View:
    n = np.size(view.steering)
    offset = rng.uniform(-config.viewpoint_metres, config.viewpoint_metres, n)
    heading = np.radians(rng.uniform(-config.viewpoint_degrees, config.viewpoint_degrees, n))
    return shift_viewpoint(view, offset, heading, config.viewpoint_lookahead)


def _viewpoint_examples(view: View, config: AugmentConfig) -> dict[str, View]:
    metres, degrees = config.viewpoint_metres, config.viewpoint_degrees
    return {
        f"viewpoint {side * metres:+g} m, {turn * degrees:+g}°": shift_viewpoint(
            view, side * metres, turn * math.radians(degrees), config.viewpoint_lookahead
        )
        for side in (-1, 1)
        for turn in (-1, 1)
    }


def _draw_rotation(view: View, config: AugmentConfig, rng: np.random.Generator) -> View:
    return rotate(view, rng.uniform(-config.rotation_degrees, config.rotation_degrees, np.size(view.steering)))


def _rotation_examples(view: View, config: AugmentConfig) -> dict[str, View]:
    degrees = config.rotation_degrees
    return {f"rotation by {sign * degrees:+g}°": rotate(view, sign * degrees) for sign in (-1, 1)}


def _draw_crop(view: View, config: AugmentConfig, rng: np.random.Generator) -> View:
    n = np.size(view.steering)
    return crop_height(view, rng.uniform(*config.crop_top, n), rng.uniform(*config.crop_bottom, n))


def _crop_examples(view: View, config: AugmentConfig) -> dict[str, View]:
    return {
        f"height crop {top:.0%} above, {bottom:.0%} below": crop_height(view, top, bottom)
        for top in config.crop_top
        for bottom in config.crop_bottom
    }


def _draw_brightness(n: int, config: AugmentConfig, rng: np.random.Generator) -> Floats:
    return np.where(rng.random(n) < config.brightness, rng.uniform(*config.brightness_range, n), 1.0)[:, None]


def _apply_brightness(pixels: Frame, numbers: Floats) -> Frame:
    return pixels if numbers[0] == 1 else brightness(pixels, numbers[0])


def _draw_shadow(n: int, config: AugmentConfig, rng: np.random.Generator) -> Floats:
    """Column where the shadow's line enters, and leaves; 1 if it lies to the right of it; factor in it."""
    factor = np.where(rng.random(n) < config.shadow, rng.uniform(*config.shadow_range, n), 1.0)
    top, bottom = rng.uniform(0, COLUMNS, (2, n))
    return np.stack([top, bottom, rng.integers(2, size=n), factor], 1)


def _apply_shadow(pixels: Frame, numbers: Floats) -> Frame:
    top, bottom, right, factor = numbers
    return pixels if factor == 1 else shadow(pixels, top, bottom, bool(right), factor)


GEOMETRIC: list[Geometric] = [
    Geometric("viewpoint", _draw_viewpoint, _viewpoint_examples),
    Geometric("rotation", _draw_rotation, _rotation_examples),
    Geometric("crop", _draw_crop, _crop_examples),
    Geometric("flip", lambda view, *_: flip(view), lambda view, _: {"flip": flip(view)}),
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
]


# All of them together. The draws for n frames at once cost as little as one frame's


def draw_views(view: View, config: AugmentConfig, rng: np.random.Generator) -> View:
    """Draw the geometric augmentations of n frames; each with its probability."""
    for augmentation in GEOMETRIC:
        changed = augmentation.draw(view, config, rng)
        view = changed.where(rng.random(np.size(view.steering)) < getattr(config, augmentation.name), view)
    return view


def draw_photometric(n: int, config: AugmentConfig, rng: np.random.Generator) -> Floats:
    """Draw the photometric augmentations of n frames: the numbers of all of them, side by side, a row a frame."""
    return np.concatenate([augmentation.draw(n, config, rng) for augmentation in PHOTOMETRIC], axis=1)


def photometric_columns() -> Iterator[tuple[Photometric, slice]]:
    """Which of the columns that `draw_photometric` draws belong to which augmentation."""
    start = 0
    for augmentation in PHOTOMETRIC:
        yield augmentation, slice(start, start + augmentation.size)
        start += augmentation.size


def apply_photometric(pixels: Frame, light: Floats) -> Frame:
    """Pixels in a light that `draw_photometric` has drawn, or as they are with no number at all."""
    if len(light):
        for augmentation, columns in photometric_columns():
            pixels = augmentation.apply(pixels, light[columns])
    return pixels


def rows_needed(rows: tuple[int, int], config: AugmentConfig | None, rotation: float) -> tuple[int, int]:
    """The recorded frame's rows that any view of `rows` may show.

    Args:
        rows: what the network looks at.
        config: of the random augmentations; None without them.
        rotation: degrees, the largest of a sample's own.
    """
    views = [View(0.0)]
    if rotation:
        views += [rotate(view, sign * rotation) for view in views for sign in (-1, 1)]
    for augmentation in GEOMETRIC:
        if config and getattr(config, augmentation.name):
            views += [changed for view in views for changed in augmentation.examples(view, config).values()]
    corners = np.array([[x, y, 1] for x in (0, COLUMNS - 1) for y in (rows[0], rows[1] - 1)]).T
    sources = [np.linalg.inv(view.homography) @ corners for view in views]
    heights = np.concatenate([source[1] / source[2] for source in sources])
    return max(math.floor(heights.min()) - 1, 0), min(math.ceil(heights.max()) + 2, ROWS)
