"""All augmentations together: drawing for the frames of an epoch, and applying what was drawn.

Drawing for n frames at once takes hardly longer than drawing for one.
"""

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pilot.arrays import Floats, Frame
from pilot.data.augment import GEOMETRIC, PHOTOMETRIC, AugmentConfig, Geometric, Photometric, rotate
from pilot.data.view import View
from pilot.vehicle import COLUMNS, ROWS


@dataclass(frozen=True)
class DrawnGeometric:
    """A geometric augmentation as drawn for n views.

    Attributes:
        augmentation: the augmentation.
        chosen: n booleans: the views that it changes.
        parameters: n x its number of parameters.
    """

    augmentation: Geometric
    chosen: NDArray[np.bool_]
    parameters: Floats


def draw_geometric(n: int, config: AugmentConfig, rng: np.random.Generator) -> list[DrawnGeometric]:
    """Draw the parameters of the geometric augmentations for n views; without those that change none of the views."""
    drawn = []
    for augmentation in GEOMETRIC:
        parameters = augmentation.draw(n, config, rng)
        chosen = rng.random(n) < getattr(config, augmentation.name)
        drawn += [DrawnGeometric(augmentation, chosen, parameters)] if chosen.any() else []
    return drawn


def apply_geometric(
    views: View, drawn: Sequence[DrawnGeometric], index: NDArray[np.int64], config: AugmentConfig
) -> View:
    """Change views, whose numbers among the n of `draw_geometric` are `index`, by what was drawn for them."""
    for draw in drawn:
        changed = draw.augmentation.apply(views, draw.parameters[index], config)
        views = changed.where(draw.chosen[index], views)
    return views


def draw_photometric(n: int, config: AugmentConfig, rng: np.random.Generator) -> list[Floats]:
    """Draw the parameters of each photometric augmentation for n frames: n x its size."""
    return [augmentation.draw(n, config, rng) for augmentation in PHOTOMETRIC]


def photometric_columns() -> Iterator[tuple[Photometric, slice]]:
    """Yield each photometric augmentation with its columns if the parameters of all are joined."""
    start = 0
    for augmentation in PHOTOMETRIC:
        yield augmentation, slice(start, start + augmentation.size)
        start += augmentation.size


def apply_photometric(pixels: Frame, drawn: Sequence[Floats], number: int) -> Frame:
    """Change the pixels of a frame, whose number among the n of `draw_photometric` is given, by what was drawn."""
    for augmentation, parameters in zip(PHOTOMETRIC, drawn, strict=False):  # nothing may be drawn
        pixels = augmentation.apply(pixels, parameters[number])
    return pixels


def rows_needed(rows: tuple[int, int], config: AugmentConfig | None, rotation: float) -> tuple[int, int]:
    """Return the range of the recorded frame's rows that views of `rows` may show.

    Args:
        rows: first row that the network uses, and the one after the last.
        config: configuration of the random augmentations; None: no random augmentations.
        rotation: largest rotation of copies that are drawn once (column `rotation` of the samples), in degrees.
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
