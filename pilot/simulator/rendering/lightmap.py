"""Precomputed light and shadows on the ground; the renderer multiplies the ground's colours by them."""

import math
from dataclasses import dataclass

import cv2
import numpy as np

from pilot.arrays import Floats
from pilot.simulator.course import Light
from pilot.simulator.rendering.ground import Plants
from pilot.simulator.rendering.terrain import CELL, Terrain

SIZE = 2048  # pixels per side of the light map
COARSE = 512  # pixels per side for shading by slopes and shadows of hills
CROWN = {"pine": 0.55, "palm": 0.8, "boulder": 0.5}  # height of the crown's middle, relative to the plant's height
REACH = 60.0  # metres, maximum length of a hill's shadow


@dataclass(frozen=True, eq=False)
class LightMap:
    """Light on the ground as an image seen from above.

    Attributes:
        picture: factors of the ground's colour, 2048 x 2048 x 3, uint8 RGB (255 is 1); rows run from south to north.
        corner: southwestern corner (east, north), metres.
        size: extent (east, north), metres.
    """

    picture: "np.ndarray[tuple[int, int, int], np.dtype[np.uint8]]"
    corner: Floats
    size: Floats

    def texels(self, points: Floats) -> Floats:
        """Return the texture coordinates (... x 2, 0..1) of points (... x 3, metres)."""
        return np.asarray((points[..., :2] - self.corner) / self.size)

    def light_at(self, points: Floats) -> Floats:
        """Return the light (n x 3, RGB, 0..1) at points (n x 3, metres)."""
        pixels = (self.texels(points) * SIZE).astype(int).clip(0, SIZE - 1)
        return np.asarray(self.picture[pixels[:, 1], pixels[:, 0]] / 255.0)


def bake_light(terrain: Terrain, plants: Plants, light: Light, tree: str) -> LightMap:
    """Compute the light map of a terrain, including the shadows of its hills and plants (of kind `tree`)."""
    shine = np.asarray(_slopes(terrain, light) * _hill_shadows(terrain, light), np.float32)
    fine = np.asarray(cv2.resize(shine, (SIZE, SIZE), interpolation=cv2.INTER_LINEAR), np.float32)
    shade = np.zeros((SIZE, SIZE), np.uint8)
    _plant_shadows(shade, terrain, plants, light, crown=CROWN[tree])
    fine *= 1 - light.shadows * cv2.GaussianBlur(shade, (0, 0), 0.7).astype(np.float32) / 255
    colours = [
        cv2.convertScaleAbs(fine, alpha=255 * sun, beta=255 * ambient)
        for sun, ambient in zip(light.sun, light.ambient, strict=True)
    ]
    return LightMap(np.asarray(cv2.merge(colours), np.uint8), terrain.corner, terrain.size)


def _sun(light: Light) -> tuple[float, float, float]:
    """Return the unit vector towards the sun: east, north, up."""
    azimuth, elevation = math.radians(light.azimuth), math.radians(light.elevation)
    return (math.sin(azimuth) * math.cos(elevation), math.cos(azimuth) * math.cos(elevation), math.sin(elevation))


def _slopes(terrain: Terrain, light: Light) -> Floats:
    """Return the sunlight (512 x 512) on the ground depending on its slope, relative to level ground."""
    east, north, up = _sun(light)
    heights = cv2.resize(cv2.GaussianBlur(terrain.heights, (0, 0), 0.7), (COARSE, COARSE))
    rows, columns = terrain.heights.shape
    to_north, to_east = np.gradient(heights, CELL * rows / COARSE, CELL * columns / COARSE)
    facing = (up - to_east * east - to_north * north) / np.sqrt(1 + to_east**2 + to_north**2)
    return np.asarray((facing / up).clip(0, 1.25))


def _hill_shadows(terrain: Terrain, light: Light) -> Floats:
    """Return the factor (512 x 512, 0..1) of the sunlight after shadows of hills; 1 is in the sun."""
    east, north, up = _sun(light)
    heights = cv2.resize(terrain.heights, (COARSE, COARSE)).astype(np.float32)
    hidden = np.zeros((COARSE, COARSE), np.float32)
    per_metre = up / math.hypot(east, north)
    direction = np.array([east, north]) / math.hypot(east, north)
    longest = float(heights.max() - heights.min()) / per_metre
    for distance in np.arange(1.5, min(REACH, longest), 1.5):
        shift = direction * distance * COARSE / terrain.size
        shifted = cv2.warpAffine(
            heights,
            np.array([[1, 0, -shift[0]], [0, 1, -shift[1]]], np.float32),
            (COARSE, COARSE),
            borderMode=cv2.BORDER_REPLICATE,
        )
        hidden = np.maximum(hidden, shifted - heights - distance * per_metre)
    return np.asarray(1 - light.shadows * (hidden / 0.6).clip(0, 1))


def _plant_shadows(
    shade: "np.ndarray[tuple[int, ...], np.dtype[np.uint8]]",
    terrain: Terrain,
    plants: Plants,
    light: Light,
    *,
    crown: float,
) -> None:
    """Draw the plants' shadows, as on level ground, into `shade`: 0 is in the sun, 255 fully shaded."""
    east, north, up = _sun(light)
    away = -np.array([east, north]) / up  # horizontal displacement of the shadow per metre of height
    scale = SIZE / terrain.size  # pixels per metre
    angle = math.degrees(math.atan2(away[1] * scale[1], away[0] * scale[0]))
    for point, width, height in zip(plants.points, plants.widths, plants.heights, strict=True):
        foot = (point[:2] - terrain.corner) * scale
        tip = foot + away * height * crown * scale
        long = np.hypot(*(away * height * (1 - crown) * scale)) + width * 0.25 * scale[0]
        cv2.line(shade, foot.astype(int).tolist(), tip.astype(int).tolist(), 200, 2)
        axes = int(long) + 1, int(width * 0.4 * scale[1]) + 1
        cv2.ellipse(shade, tip.astype(int).tolist(), axes, angle, 0, 360, 215, -1)
