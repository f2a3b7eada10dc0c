"""Overlays for frames: steering wheel, speed, path on the road."""

import functools
import math

import cv2
import numpy as np
from PIL import Image, ImageDraw, ImageFont

from pilot.arrays import Frame
from pilot.camera import path_pixels
from pilot.vehicle import COLUMNS, FULL_LOCK, HALF_TRACK

WHITE, AMBER, DARK, GREEN = (255, 255, 255), (255, 170, 40), (30, 30, 30), (70, 220, 120)
WHEEL_TURN = 4  # angle of the drawn steering wheel relative to that of the front wheels, to be clearly visible
SUBPIXEL = 4  # fractional bits of coordinates, for antialiased lines


def draw_path(frame: Frame, steering: float, colour: tuple[int, int, int] = GREEN) -> None:
    """Draw the path of the wheels for a steering (-1..1) into a frame (RGB, 2:1, any size)."""
    scale = frame.shape[1] / COLUMNS
    sides = [path_pixels(steering, lateral=side * HALF_TRACK) * scale for side in (-1, 1)]
    area = np.vstack([sides[0], sides[1][::-1]]).astype(np.int32)
    shade = frame.copy()
    cv2.fillPoly(shade, [area], colour, cv2.LINE_AA)
    cv2.addWeighted(shade, 0.35, frame, 0.65, 0, frame)
    for side in sides:
        points = (side * (1 << SUBPIXEL)).astype(np.int32)
        cv2.polylines(frame, [points], False, colour, 2, cv2.LINE_AA, SUBPIXEL)


def draw_wheel(frame: Frame, steering: float) -> None:
    """Draw a steering wheel, turned by `steering` (-1..1), into the lower left corner of a frame."""
    radius = frame.shape[0] // 8
    middle = np.array([radius * 1.4, frame.shape[0] - radius * 1.4])
    turn = steering * FULL_LOCK * WHEEL_TURN
    for color, width in ((DARK, radius // 4 + 3), (WHITE, radius // 5)):
        cv2.circle(frame, *_fixed(middle, radius), color, width, cv2.LINE_AA, SUBPIXEL)
        for angle in (math.pi / 2, math.pi, 0.0):
            spoke = middle + radius * np.array([math.cos(turn + angle), math.sin(turn + angle)])
            cv2.line(frame, _fixed(middle)[0], _fixed(spoke)[0], color, max(width - 2, 1), cv2.LINE_AA, SUBPIXEL)
    mark = middle + radius * np.array([math.sin(turn), -math.cos(turn)])
    cv2.circle(frame, *_fixed(mark, radius / 6), AMBER, -1, cv2.LINE_AA, SUBPIXEL)


def _fixed(point: np.ndarray, radius: float = 0) -> tuple[tuple[int, int], int]:
    """Convert a point and a radius to OpenCV's fixed-point pixels."""
    x, y = (point * (1 << SUBPIXEL)).astype(int).tolist()
    return (x, y), int(radius * (1 << SUBPIXEL))


def draw_speed(frame: Frame, speed: float) -> Frame:
    """Return a copy of a frame with the speed in mph drawn into its lower right corner."""
    picture = Image.fromarray(frame)
    height, width = frame.shape[:2]
    place = (width - height // 16, height - height // 16)
    ImageDraw.Draw(picture).text(
        place, f"{speed:.1f} mph", WHITE, _font(height // 9), anchor="rs", stroke_width=2, stroke_fill=DARK
    )
    return np.asarray(picture)


@functools.cache
def _font(size: int) -> ImageFont.FreeTypeFont | ImageFont.ImageFont:
    return ImageFont.load_default(size)
