"""Augmentations: pure functions on what a camera sees and on the steering that goes with it.

The geometric ones change a `View`: a homography that says where each pixel of the recorded frame
goes, and the label. They are joined by multiplication, so the frame is warped just once, from the
whole recorded picture (no border of a crop is ever seen), and only the rows that the network looks
at are computed. The photometric ones change pixels in place and leave the label alone.
"""

import math
from dataclasses import dataclass, field

import cv2
import numpy as np
from numpy.typing import NDArray

from pilot import camera
from pilot.camera import Floats, Matrix
from pilot.data.frames import Frame
from pilot.vehicle import COLUMNS, ROWS, curvature_to_steering, steering_to_curvature

# Seed 004's crops in the mean: its networks look at these rows (40 % cut off above, 12.5 % below).
CROP_TOP, CROP_BOTTOM = 64, 140
IDENTITY: Matrix = np.eye(3)
MIRROR: Matrix = np.array([[-1.0, 0, COLUMNS - 1], [0, 1, 0], [0, 0, 1]])


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


@dataclass(frozen=True)
class View:
    """How a frame is seen, or n frames are.

    Attributes:
        steering: to learn (-1..1): a number, or n.
        homography: from the recorded frame's pixels to those seen: 3x3, or n x 3 x 3.
    """

    steering: float | Floats
    homography: Matrix = field(default_factory=lambda: IDENTITY)

    def moved(self, homography: Matrix, steering: float | Floats) -> "View":
        """This view after one more homography, with a new label."""
        return View(steering, homography @ self.homography)

    def where(self, chosen: NDArray[np.bool_], other: "View") -> "View":
        """This view of the chosen frames, another one of the rest."""
        homography = np.where(chosen[:, None, None], self.homography, other.homography)
        return View(np.where(chosen, self.steering, other.steering), homography)


# Geometry: what is seen, and the label


def flip(view: View) -> View:
    """Mirror left and right: the steering changes its sign."""
    return view.moved(MIRROR, -view.steering)


def rotate(view: View, degrees: float | Floats) -> View:
    """Rotate counter-clockwise about the middle and add the angle in radians to the steering (seed 000).

    The label may go beyond -1..1; it is left there, as in the seed.
    """
    angle, x, y = np.radians(degrees), COLUMNS / 2, ROWS / 2
    sine, cosine = np.sin(angle), np.cos(angle)
    turn = camera.matrices(cosine, sine, x - cosine * x - sine * y, -sine, cosine, y + sine * x - cosine * y, 0, 0, 1)
    return view.moved(turn, view.steering + angle)


def crop_height(view: View, top: float | Floats, bottom: float | Floats) -> View:
    """Cut shares of the height off above and below and stretch the rest over the usual rows (seed 004)."""
    first, last = top * ROWS, (1 - bottom) * ROWS
    scale = (CROP_BOTTOM - CROP_TOP) / (last - first)
    return view.moved(camera.matrices(1, 0, 0, 0, scale, CROP_TOP - first * scale, 0, 0, 1), view.steering)


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
    return view.moved(camera.viewpoint_homography(offset, heading), curvature_to_steering(back))


def render(frame: Frame, homography: Matrix, rows: tuple[int, int], first_row: int = 0) -> Frame:
    """The rows `rows[0]..rows[1]-1` of a 160x320x3 frame as a view shows it: a copy, same width.

    Args:
        frame: the frame, or its rows from `first_row` on, of which `rows_seen` says how many are enough.
        homography: 3x3, the view's.
        rows: of the whole frame.
        first_row: of the whole frame.
    """
    top, bottom = rows
    if np.array_equal(homography, IDENTITY):
        return frame[top - first_row : bottom - first_row].copy()
    if np.array_equal(homography, MIRROR):  # the most frequent one, without a warp
        return np.asarray(cv2.flip(frame[top - first_row : bottom - first_row], 1), np.uint8)
    size = (COLUMNS, bottom - top)
    matrix = from_rows(homography, first_row, top)
    if np.array_equal(matrix[2], [0, 0, 1]):  # the same pixels, a little faster
        return np.asarray(cv2.warpAffine(frame, matrix[:2], size), np.uint8)
    # a black corner would tell the network how far the viewpoint was shifted, so the border is continued
    return np.asarray(cv2.warpPerspective(frame, matrix, size, borderMode=cv2.BORDER_REPLICATE), np.uint8)


def from_rows(homographies: Matrix, first_row: int, top: int) -> Matrix:
    """Homographies of whole frames as such from pictures that begin at `first_row` to ones that begin at `top`."""
    lift, lower = np.eye(3), np.eye(3)
    lift[1, 2], lower[1, 2] = -top, first_row
    return np.asarray(lift @ homographies @ lower)


def rows_seen(rows: tuple[int, int], config: AugmentConfig | None, rotation: float) -> tuple[int, int]:
    """The recorded frame's rows that any view of `rows` may show.

    Args:
        rows: what the network looks at.
        config: of the random augmentations; None without them.
        rotation: degrees, the largest of a sample's own.
    """
    views = [View(0.0)]
    if config and config.viewpoint:
        metres, radians = config.viewpoint_metres, math.radians(config.viewpoint_degrees)
        views += [
            shift_viewpoint(view, side * metres, turn * radians, config.viewpoint_lookahead)
            for view in views
            for side in (-1, 1)
            for turn in (-1, 1)
        ]
    turned = rotation + (config.rotation_degrees if config and config.rotation else 0)
    if turned:
        views += [rotate(view, sign * turned) for view in views for sign in (-1, 1)]
    if config and config.crop:
        views += [
            crop_height(view, top, bottom) for view in views for top in config.crop_top for bottom in config.crop_bottom
        ]
    corners = np.array([[x, y, 1] for x in (0, COLUMNS - 1) for y in (rows[0], rows[1] - 1)]).T
    sources = [np.linalg.inv(view.homography) @ corners for view in views]
    heights = np.concatenate([source[1] / source[2] for source in sources])
    return max(math.floor(heights.min()) - 1, 0), min(math.ceil(heights.max()) + 2, ROWS)


# Light: pixels only


def brightness(pixels: Frame, factor: float) -> Frame:
    """Scale the HSV value by a factor (seed 004): the same as scaling red, green and blue."""
    return np.asarray(cv2.convertScaleAbs(pixels, alpha=factor), np.uint8)


def shadow(pixels: Frame, top: float, bottom: float, right: bool, factor: float) -> Frame:
    """Darken one side of a line that enters at column `top` and leaves at column `bottom` (seed 004)."""
    height, width = pixels.shape[:2]
    edge = width if right else 0
    outline = np.array([[top, 0], [bottom, height], [edge, height], [edge, 0]], np.int32)
    mask = np.zeros((height, width), np.uint8)
    cv2.fillPoly(mask, [outline], 255)
    return np.asarray(cv2.copyTo(brightness(pixels, factor), mask, pixels.copy()), np.uint8)


def in_light(pixels: Frame, light: Floats) -> Frame:
    """Pixels in a light that `random_lights` has drawn."""
    factor, top, bottom, right, shade = light
    if factor != 1:
        pixels = brightness(pixels, factor)
    return pixels if shade == 1 else shadow(pixels, top, bottom, bool(right), shade)


# Drawing at random, for n frames at once: their draws cost as little as one frame's


def random_views(view: View, config: AugmentConfig, rng: np.random.Generator) -> View:
    """Draw the geometric augmentations of n frames; each with its probability."""
    n = np.size(view.steering)
    offset = rng.uniform(-config.viewpoint_metres, config.viewpoint_metres, n)
    heading = np.radians(rng.uniform(-config.viewpoint_degrees, config.viewpoint_degrees, n))
    shifted = shift_viewpoint(view, offset, heading, config.viewpoint_lookahead)
    view = shifted.where(rng.random(n) < config.viewpoint, view)
    turned = rotate(view, rng.uniform(-config.rotation_degrees, config.rotation_degrees, n))
    view = turned.where(rng.random(n) < config.rotation, view)
    cropped = crop_height(view, rng.uniform(*config.crop_top, n), rng.uniform(*config.crop_bottom, n))
    view = cropped.where(rng.random(n) < config.crop, view)
    return flip(view).where(rng.random(n) < config.flip, view)


def random_lights(n: int, config: AugmentConfig, rng: np.random.Generator) -> Floats:
    """Draw the photometric augmentations of n frames; each with its probability.

    Returns:
        n x 5: factor on the brightness; column where the shadow's line enters, and leaves; 1 if the shadow lies to
        its right; factor in the shadow.
    """
    factor = np.where(rng.random(n) < config.brightness, rng.uniform(*config.brightness_range, n), 1.0)
    shade = np.where(rng.random(n) < config.shadow, rng.uniform(*config.shadow_range, n), 1.0)
    top, bottom = rng.uniform(0, COLUMNS, (2, n))
    return np.stack([factor, top, bottom, rng.integers(2, size=n), shade], 1)
