"""The car's bonnet at the bottom of each camera's frame, positioned as in the Unity simulator."""

import functools

import cv2
import numpy as np
from numpy.typing import NDArray

from pilot.arrays import Frame
from pilot.simulator.course import Light
from pilot.vehicle import BONNET_ROW, COLUMNS, ROWS

FINE = 4  # supersampling factor, for smooth edges
Points = list[tuple[float, float]]

# outlines: columns and rows of the frame
MIDDLE: Points = [
    (36, 160),
    (70, 150),
    (104, 143),
    (122, 138),
    (142, 136.5),
    (178, 136.5),
    (196, 138),
    (210, 143),
    (240, 151),
    (265, 160),
]
SIDE: Points = [
    (186, 160),
    (188, 154),
    (196, 148),
    (210, 143),
    (240, 139),
    (268, 137),
    (300, 137.5),
    (320, 139),
    (320, 160),
]
HEADLIGHT: Points = [(201, 150), (206, 145), (219, 143), (217, 148), (208, 153)]
PAINT, EDGE, GLASS, LAMP = (196, 168, 128), (150, 128, 98), (196, 204, 200), (252, 250, 240)


def add_bonnet(frame: Frame, camera: str, light: Light, last: int = ROWS) -> Frame:
    """Draw the bonnet into a camera's frame (160x320x3 uint8 RGB), in place, down to row `last`; returns the frame."""
    colour, alpha = _picture(camera, light)
    below = frame[BONNET_ROW:last]
    below[:] = (below * (1 - alpha[: len(below)]) + colour[: len(below)]).astype(np.uint8)
    return frame


@functools.cache
def _picture(camera: str, light: Light) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    """Return the bonnet's lit colours (24x320x3, 0..255, premultiplied by alpha) and its alpha (24x320x1, 0..1)."""
    canvas = np.zeros(((ROWS - BONNET_ROW) * FINE, COLUMNS * FINE, 4), np.float32)
    if camera == "center":
        _draw_middle(canvas)
    else:
        _draw_side(canvas)
    small = cv2.resize(canvas, (COLUMNS, ROWS - BONNET_ROW), interpolation=cv2.INTER_AREA)
    small = small[:, ::-1] if camera == "right" else small
    shine = np.array(light.sun, np.float32) * 0.8 + np.array(light.ambient, np.float32)
    return np.ascontiguousarray(small[:, :, :3] * shine), np.ascontiguousarray(small[:, :, 3:] / 255)


def _draw_middle(canvas: NDArray[np.float32]) -> None:
    _fill(canvas, MIDDLE, EDGE)
    _fill(canvas, [(column, row + 2.5) for column, row in MIDDLE], PAINT)
    for grow, colour in ((2.0, EDGE), (0.0, GLASS)):
        centre = (int(154 * FINE), int((162 - BONNET_ROW) * FINE))
        cv2.ellipse(canvas, centre, (int((62 + grow) * FINE), int((10 + grow) * FINE)), 0, 180, 360, (*colour, 255), -1)


def _draw_side(canvas: NDArray[np.float32]) -> None:
    _fill(canvas, SIDE, EDGE)
    _fill(canvas, [(column + 1, row + 1.5) for column, row in SIDE], PAINT)
    _fill(canvas, HEADLIGHT, LAMP)


def _fill(canvas: NDArray[np.float32], points: Points, colour: tuple[int, int, int]) -> None:
    outline = np.array([(column * FINE, (row - BONNET_ROW) * FINE) for column, row in points])
    cv2.fillPoly(canvas, [outline.astype(np.int32)], (*colour, 255))
