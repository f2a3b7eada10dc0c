"""Detection of the road's middle in the images of a recording.

In a bird's-eye view that is straightened along the driven path, a road consists of parallel stripes: ground, kerb or
edge line, asphalt, and the same in reverse order. The road's middle is their axis of symmetry. Dynamic programming
(R. Bellman, Dynamic Programming, 1957) tracks it through a segment: the score rewards strong and symmetric edges, and
penalises changes of the road's width and lateral movement from row to row.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from pilot import camera
from pilot.arrays import Floats, Frame
from pilot.data.frames import read_frame
from pilot.data.motion import Motion
from pilot.evaluation.reference_path import Line, fit_line
from pilot.vehicle import BONNET_ROW, CAMERA_AHEAD_OF_REAR_AXLE, COLUMNS

CELL = 0.1  # metres; resolution of the lateral grid
ACROSS = np.arange(-90, 91) * CELL  # metres to the right of the line at which colours are sampled
AHEAD = np.arange(3.0, 8.01, 0.5)  # metres from the camera; the bonnet hides what is nearer, hills distort the rest
PLACES = np.arange(-40, 41) * CELL  # metres to the right of the line; candidates for the middle
HALF_WIDTHS = np.arange(30, 61) * CELL  # metres; candidates for the half width; smaller ones would match a single lane
REACH = 4  # cells on each side of an edge whose mean colours are compared
STRONG = 30.0  # grey levels; contrast from which the strength of an edge is 1
JUMPS = (-3, -2, -1, 1, 2, 3)  # cells by which the middle may move from one row to the next
STIFFNESS = 1.0  # cost of a lateral movement divided by the distance driven
WIDENING = 5.0  # cost of a change of the width from one row to the next, such as at a bridge
NEARNESS = 0.02  # cost per metre from the line, which decides where no edge is visible
OVERALL = 0.1  # weight of the symmetry of all stripes relative to that of the road's edges

PATH_SPREAD = 1.5  # metres; prior standard deviation of a car's lateral offset
SIGHT_SPREAD = 0.5  # metres; standard deviation of the detected middle
ROUNDS = 3  # iterations of straightening along the line and fitting it again


@dataclass(frozen=True)
class Road:
    """The detected road of a segment of n rows.

    Attributes:
        line: the road's middle, with the recorded car's position relative to it.
        half_widths: n, metres from the middle to the clearest pair of edges.
        clarity: 0..1, mean strength and symmetry of these edges.
    """

    line: Line
    half_widths: Floats
    clarity: float


def find_road(pictures: Sequence[str], motion: Motion) -> Road:
    """Detect the road in a segment.

    Args:
        pictures: n, image files of the centre camera.
        motion: motion of the recorded car; n rows.

    Raises:
        UnreadableImage: an image cannot be read.
    """
    count = len(pictures)
    line = fit_line(motion, np.zeros(count), np.full(count, PATH_SPREAD))
    for _ in range(ROUNDS):
        poses = zip(pictures, line.offsets, line.headings, line.curvatures, strict=True)
        edges = np.array([_edges(_stripes(read_frame(path), *pose)) for path, *pose in poses])
        aside, half_widths = _follow(edges, motion.steps)
        line = _robust_fit(motion, line.offsets - aside)
    return Road(line, half_widths, _clarity(edges, aside, half_widths))


def _robust_fit(motion: Motion, seen: Floats) -> Line:
    """Fit a line robustly, by iteratively reweighted least squares with Cauchy weights."""
    spread = np.full(len(seen), SIGHT_SPREAD)
    for _ in range(4):
        line = fit_line(motion, seen, spread)
        spread = SIGHT_SPREAD * np.sqrt(1 + ((line.offsets - seen) / SIGHT_SPREAD) ** 2)
    return line


def _stripes(frame: Frame, offset: float, heading: float, curvature: float) -> Floats:
    """Return the mean colours (n x 3) along the line at the n offsets `ACROSS`; NaN where the ground is not visible."""
    ahead = AHEAD[:, None]
    axle = ahead + CAMERA_AHEAD_OF_REAR_AXLE
    right = ACROSS - offset - heading * axle + curvature * axle**2 / 2
    ground = np.stack([right.ravel(), np.broadcast_to(ahead, right.shape).ravel(), np.ones(right.size)])
    u, v, w = camera.ground_to_pixel() @ ground
    columns, rows = ((values / w).reshape(right.shape).astype(np.float32) for values in (u, v))
    seen = ((columns >= 0) & (columns <= COLUMNS - 1) & (rows < BONNET_ROW))[..., None]
    colours = cv2.remap(frame, columns, rows, cv2.INTER_LINEAR) * seen
    count = seen.sum(0)
    return np.where(count >= 2, colours.sum(0, dtype=float) / np.maximum(count, 1), np.nan)


def _edges(stripes: Floats) -> Floats:
    """Return the changes of colour from left to right (n x 3), of norm 1 at most; 0 where not visible."""
    sums = np.vstack([np.zeros(3), np.nancumsum(stripes, axis=0)])
    edges = np.zeros_like(stripes)
    edges[REACH:-REACH] = (sums[2 * REACH : -1] - 2 * sums[REACH : -REACH - 1] + sums[: -2 * REACH - 1]) / (
        REACH * STRONG
    )
    hidden = np.convolve(np.isnan(stripes[:, 0]), np.ones(2 * REACH + 1), "same") > 0
    edges[hidden] = 0
    return np.asarray(edges / np.maximum(np.linalg.norm(edges, axis=1, keepdims=True), 1))


def _follow(edges: Floats, steps: Floats) -> tuple[Floats, Floats]:
    """Track the road through a segment of n rows.

    Args:
        edges: n x cells x 3, from `_edges`.
        steps: n, metres driven to the next row.

    Returns:
        metres by which the road's middle is to the right of the line, and its half width in metres; n each.
    """
    score = np.zeros((len(HALF_WIDTHS), len(PLACES)))
    jumps = np.zeros((len(edges), *score.shape), np.int8)
    widths = np.zeros_like(jumps)
    for row, across in enumerate(edges):
        if row:
            score, jumps[row] = _best_jump(score, STIFFNESS * CELL / max(steps[row - 1], 0.3))
            score, widths[row] = _best_width(score)
        score += _evidence(across)
    width, place = np.unravel_index(score.argmax(), score.shape)
    found = [(width, place)]
    for row in range(len(edges) - 1, 0, -1):
        width = widths[row, width, place]
        place = place - jumps[row, width, place]
        found.append((width, place))
    width_of, place_of = np.array(found[::-1]).T
    return np.asarray(PLACES[place_of]), np.asarray(HALF_WIDTHS[width_of])


def _best_width(score: Floats) -> tuple[Floats, NDArray[np.int8]]:
    """Return each width's and place's best score after a possible change of width, and the width before it."""
    best = score.argmax(0)
    changed = score.max(0) - WIDENING
    kept = np.arange(len(score))[:, None]
    return np.maximum(score, changed), np.where(changed > score, best, kept).astype(np.int8)


def _best_jump(score: Floats, cost: float) -> tuple[Floats, NDArray[np.int8]]:
    """Return each width's and place's best score after a possible jump from the previous row, and the jump in cells."""
    best, jumps = score.copy(), np.zeros(score.shape, np.int8)
    for jump in JUMPS:
        to, source = (np.s_[:, jump:], np.s_[:, :-jump]) if jump > 0 else (np.s_[:, :jump], np.s_[:, -jump:])
        reached = score[source] - cost * abs(jump)
        better = reached > best[to]
        best[to][better], jumps[to][better] = reached[better], jump
    return best, jumps


_MIDDLE = len(ACROSS) // 2
_LEFT = _MIDDLE + np.rint((PLACES - HALF_WIDTHS[:, None]) / CELL).astype(int)
_RIGHT = _MIDDLE + np.rint((PLACES + HALF_WIDTHS[:, None]) / CELL).astype(int)
_INSIDE = (_LEFT >= 0) & (len(ACROSS) > _RIGHT)


def _evidence(edges: Floats) -> Floats:
    """Return the score of a row's edges for each half width and place of the middle."""
    strength, symmetry = _pairs(edges)
    return np.asarray(strength + symmetry + OVERALL * symmetry.clip(0).sum(0) - NEARNESS * np.abs(PLACES))


def _pairs(edges: Floats) -> tuple[Floats, Floats]:
    """Return strength (0..1) and symmetry (-1..1) of the two edges for each half width and place of the middle."""
    left, right = (edges[index.clip(0, len(ACROSS) - 1)] * _INSIDE[..., None] for index in (_LEFT, _RIGHT))
    return (np.linalg.norm(left, axis=2) + np.linalg.norm(right, axis=2)) / 2, -(left * right).sum(2)


def _clarity(edges: Floats, aside: Floats, half_widths: Floats) -> float:
    widths = np.rint((half_widths - HALF_WIDTHS[0]) / CELL).astype(int)
    places = np.rint((aside - PLACES[0]) / CELL).astype(int)
    found = [
        [kind[width, place] for kind in _pairs(across)]
        for across, width, place in zip(edges, widths, places, strict=True)
    ]
    return float(np.mean(found))
