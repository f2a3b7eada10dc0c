"""Light and shadow on the ground, computed once: the renderer only multiplies with it."""

import math
from dataclasses import dataclass

import cv2
import numpy as np

from pilot.arrays import Floats
from pilot.simulator.course import Light
from pilot.simulator.rendering.ground import Plants
from pilot.simulator.rendering.terrain import CELL, Terrain

SIZE = 2048  # pixels along each side
COARSE = 512  # pixels along each side where hills cast their shadows
CROWN = {"pine": 0.55, "palm": 0.8, "boulder": 0.5}  # where its middle is, in the plant's heights
REACH = 60.0  # metres, longest shadow of a hill


@dataclass(frozen=True, eq=False)
class LightMap:
    """Light on the ground, seen from above.

    Attributes:
        picture: 2048 x 2048 x 3, uint8 RGB, which the ground's colour is multiplied with; rows go north.
        corner, size: its southwestern corner and its extent to the east and north, metres.
    """

    picture: "np.ndarray[tuple[int, int, int], np.dtype[np.uint8]]"
    corner: Floats
    size: Floats

    def texels(self, points: Floats) -> Floats:
        """Texture coordinates (0..1) of points (... x 3, metres)."""
        return np.asarray((points[..., :2] - self.corner) / self.size)

    def light_at(self, points: Floats) -> Floats:
        """Light at points (n x 3, metres): n x 3, 0..1."""
        pixels = (self.texels(points) * SIZE).astype(int).clip(0, SIZE - 1)
        return np.asarray(self.picture[pixels[:, 1], pixels[:, 0]] / 255.0)


def bake_light(terrain: Terrain, plants: Plants, light: Light, tree: str) -> LightMap:
    """The light on a terrain with its plants' shadows, for a sun."""
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
    """Unit vector towards the sun: east, north, up."""
    azimuth, elevation = math.radians(light.azimuth), math.radians(light.elevation)
    return (math.sin(azimuth) * math.cos(elevation), math.cos(azimuth) * math.cos(elevation), math.sin(elevation))


def _slopes(terrain: Terrain, light: Light) -> Floats:
    """How much of the sun each part of the ground gets by its slope, 1 where it is level; 512 x 512."""
    east, north, up = _sun(light)
    heights = cv2.resize(cv2.GaussianBlur(terrain.heights, (0, 0), 0.7), (COARSE, COARSE))
    rows, columns = terrain.heights.shape
    to_north, to_east = np.gradient(heights, CELL * rows / COARSE, CELL * columns / COARSE)
    facing = (up - to_east * east - to_north * north) / np.sqrt(1 + to_east**2 + to_north**2)
    return np.asarray((facing / up).clip(0, 1.25))


def _hill_shadows(terrain: Terrain, light: Light) -> Floats:
    """1 in the sun, less in the shadow of a hill; 512 x 512."""
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
    """Draw the plants' shadows, as they fall on level ground; 255 where nothing of the sun comes through."""
    east, north, up = _sun(light)
    away = -np.array([east, north]) / up  # of a shadow's tip, per metre of height
    scale = SIZE / terrain.size  # pixels a metre
    angle = math.degrees(math.atan2(away[1] * scale[1], away[0] * scale[0]))
    for point, width, height in zip(plants.points, plants.widths, plants.heights, strict=True):
        foot = (point[:2] - terrain.corner) * scale
        tip = foot + away * height * crown * scale
        long = np.hypot(*(away * height * (1 - crown) * scale)) + width * 0.25 * scale[0]
        cv2.line(shade, foot.astype(int).tolist(), tip.astype(int).tolist(), 200, 2)
        axes = int(long) + 1, int(width * 0.4 * scale[1]) + 1
        cv2.ellipse(shade, tip.astype(int).tolist(), axes, angle, 0, 360, 215, -1)
